"""Page of a campaign: what it shows, and where its dots are."""

import re
from pathlib import Path
from typing import Any

import pytest
from page_text import PageText

from treadline.campaign._campaign_page import thumbnail, view_of, write_page
from treadline.campaign._results import summarise
from treadline.scenario.scenario import Scenario

from ..report.conftest import Transcript, climbing  # noqa: TID252 - pytest names the folders; outside of it they are no package
from .test_frontier import runs

DRAWN = ["stair.texture", "stair.open_risers", "stair.friction.0", "chair.payload_kg", "start.heading_deg"]
GOLDEN = Transcript(Path(__file__).with_name("sweep.txt"))
"""Pages as text; ``TREADLINE_ACCEPT=1 pytest tests/campaign/test_page.py`` writes them anew."""


def page_of(folder: Path, *changes: dict[str, Any], score: str = "margin", drawn: list[str] = DRAWN) -> str:
    rows = [
        {"index": index, "seed": index, "verdict": "arrived", "cause": None, "margin": 5.0 + index, "stair.slope_deg": 28.0}
        | change
        for index, change in enumerate(changes)
    ]
    summary = summarise(rows, drawn, drawn[:1], score)
    summary["worst"] = [row | {"replay": f"treadline climb {row['index']}"} for row in summary["worst"][:2]]
    scenario = Scenario()
    views = {row["index"]: thumbnail(rows[row["index"]], scenario) for row in summary["worst"] if "view" in rows[row["index"]]}
    return write_page(folder, summary, {"traversals_per_cpu_hour": 1234.5}, rows, drawn, views).read_text(encoding="utf-8")


def a_frontier(folder: Path) -> str:
    """Return the page of 200 runs of which half fail, two for a reason that differs in a number alone, one with its pose."""
    found = [row | {"min_stability_margin_deg": 8.0 + 0.01 * row["index"], "rms_heading_deg": 1.0} for row in runs(200, seed=1)]
    found[0] |= {"verdict": "held", "cause": "no frame for 0.3 s"}
    found[1] |= {"verdict": "held", "cause": "no frame for 0.4 s"}
    found[2] |= {"verdict": "fell", "cause": "<b>tilted</b>", "min_stability_margin_deg": 0.5} | view_of(climbing(seconds=1.0))
    return page_of(folder, *found, score="min_stability_margin_deg", drawn=["verdict", "slope_deg", "friction", "payload_kg"])


PAGES = {"half of the runs fail": a_frontier, "nothing varies": lambda folder: page_of(folder, {}, {"stair.open_risers": False})}


@pytest.mark.parametrize("title", PAGES)
def test_a_page_shows_what_its_golden_file_says_and_asks_for_nothing(title: str, tmp_path: Path) -> None:
    page = PAGES[title](tmp_path)
    text = PageText(page)
    assert not re.search(r"https?:|<script|\son\w+=", page)
    assert text.tags.isdisjoint({"b", "img", "link"})
    GOLDEN.check(title, text.lines)
