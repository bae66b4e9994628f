"""``treadline demo``: the shipped recording is served, without a browser too."""

import re
from typing import Any


def test_the_demo_plays_the_shipped_recording(run: Any) -> None:
    outcome = run("demo", "--port", "0", "--no-browser", "--seconds", "0.2", "--json")
    assert outcome.code == 0, outcome.err
    assert outcome.values["verdict"] == "arrived"
    assert outcome.values["t_s"] > 30.0
    assert re.search(r"demo: http://127\.0\.0\.1:\d+/", outcome.err)
    assert "open the address in a browser" in outcome.err
