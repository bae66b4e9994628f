"""The campaign's page: what its chart has across."""

import re
from pathlib import Path
from typing import Any

import pytest

from treadline.campaign.page import write_page
from treadline.campaign.summary import summarise

DRAWN = ["stair.texture", "stair.open_risers", "stair.friction.0", "chair.payload_kg", "start.heading_deg"]


def page_of(folder: Path, *runs: dict[str, Any]) -> str:
    rows = [
        {"index": index, "seed": index, "verdict": "arrived", "cause": None, "margin": 5.0 + index, "stair.slope_deg": 28.0} | run
        for index, run in enumerate(runs)
    ]
    summary = summarise(rows, DRAWN, [], "margin")
    summary["worst"] = []
    return write_page(folder, summary, {"traversals_per_cpu_hour": None}, rows, DRAWN).read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("key", "values", "ends"),
    [
        ("stair.slope_deg", (20.0, 30.0), ("20°", "30°")),
        ("start.heading_deg", (-5.0, 5.0), ("-5°", "5°")),
        ("chair.payload_kg", (0, 80), ("0 kg", "80 kg")),
        ("stair.friction.0", (0.5, 0.9), ("0.5", "0.9")),
    ],
)
def test_what_varies_goes_across_with_its_unit(
    tmp_path: Path, key: str, values: tuple[float, float], ends: tuple[str, str]
) -> None:
    others = {"stair.texture": "wood", "stair.open_risers": True}
    page = page_of(tmp_path, *({key: value} | others for value in values), others)
    assert f"<h2>margin by {key}</h2>" in page
    assert f">{ends[0]}</text>" in page
    assert f">{ends[1]}</text>" in page
    # Where a value is missing there is no dot.
    assert len(re.findall("<circle", page)) == (3 if key == "stair.slope_deg" else 2)


def test_the_slope_goes_across_wherever_it_varies(tmp_path: Path) -> None:
    page = page_of(tmp_path, {"chair.payload_kg": 0.0}, {"chair.payload_kg": 80.0, "stair.slope_deg": 30.0})
    assert "<h2>margin by stair.slope_deg</h2>" in page


def test_where_no_number_varies_there_is_no_chart(tmp_path: Path) -> None:
    assert "<svg" not in page_of(tmp_path, {"stair.open_risers": True}, {"stair.open_risers": False})
