"""``treadline demo``: the shipped recording is served, without a browser too."""

import json
import re
from typing import Any


def test_the_demo_plays_the_shipped_recording(run: Any) -> None:
    outcome = run("demo", "--port", "0", "--no-browser", "--seconds", "0.2", "--json")
    assert outcome.code == 0, outcome.err
    values = json.loads(outcome.out)
    assert values["verdict"] == "arrived"
    assert values["t_s"] > 30.0
    assert re.search(r"demo: http://127\.0\.0\.1:\d+/", outcome.err)
    assert "open the address in a browser" in outcome.err


def test_the_help_of_the_demo_names_what_it_shows_and_what_comes_next(run: Any) -> None:
    said = " ".join(run("demo", "--help").out.split())
    assert "Watch a tracked chair climb a stair" in said
    assert "treadline climb up-28 --out runs/first" in said
