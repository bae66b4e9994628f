"""Chart of the campaign page."""

import re
from pathlib import Path
from typing import Any

import pytest

from treadline.campaign._campaign_page import write_page
from treadline.campaign._results import summarise

DRAWN = ["stair.texture", "stair.open_risers", "stair.friction.0", "chair.payload_kg", "start.heading_deg"]


def page_of(folder: Path, *runs: dict[str, Any], score: str = "margin") -> str:
    rows = [
        {"index": index, "seed": index, "verdict": "arrived", "cause": None, "margin": 5.0 + index, "stair.slope_deg": 28.0} | run
        for index, run in enumerate(runs)
    ]
    summary = summarise(rows, DRAWN, [], score)
    summary["worst"] = []
    return write_page(folder, summary, {"traversals_per_cpu_hour": None}, rows, DRAWN).read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("key", "values", "title", "tick"),
    [
        ("stair.slope_deg", (20.0, 30.0), "stair.slope_deg [°]", "22"),
        ("start.heading_deg", (-5.0, 5.0), "start.heading_deg [°]", "-4"),
        ("chair.payload_kg", (0, 80), "chair.payload_kg [kg]", "40"),
        ("stair.friction.0", (0.5, 0.9), "stair.friction.0", "0.7"),
    ],
)
def test_a_varying_key_is_the_horizontal_axis_with_unit_and_round_ticks(
    tmp_path: Path, key: str, values: tuple[float, float], title: str, tick: str
) -> None:
    others = {"stair.texture": "wood", "stair.open_risers": True}
    page = page_of(tmp_path, *({key: value} | others for value in values), others)
    assert f"<h2>Margin by {key}</h2>" in page
    assert f">{title}</p>" in page
    assert f">{tick}</text>" in page
    # A missing value has no dot.
    assert len(re.findall("<circle", page)) == (3 if key == "stair.slope_deg" else 2)


def test_all_dots_are_inside_the_frame(tmp_path: Path) -> None:
    page = page_of(tmp_path, {"stair.slope_deg": 20.0}, {"stair.slope_deg": 30.0}, {"stair.slope_deg": 25.0})
    frame = {name: float(value) for name, value in re.findall(r'(x|y|width|height)="([\d.]+)"', page[page.index("<rect") :])[:4]}
    for x, y, r in re.findall(r'cx="([\d.]+)" cy="([\d.]+)" r="([\d.]+)"', page):
        assert frame["x"] + float(r) < float(x) < frame["x"] + frame["width"] - float(r)
        assert frame["y"] + float(r) < float(y) < frame["y"] + frame["height"] - float(r)


def test_a_fall_has_a_colour_of_its_own_and_is_drawn_over_the_others(tmp_path: Path) -> None:
    page = page_of(tmp_path, {"verdict": "fell", "stair.slope_deg": 20.0}, {"stair.slope_deg": 30.0}, {"verdict": "crashed"})
    colours = re.findall(r'<circle[^>]* fill="(#\w+)"', page)
    assert colours[-1] == "#e4002b"
    assert colours.count("#e4002b") == 1
    assert "#8a4fa0" in colours  # any other verdict
    assert '<span style="color: #e4002b">●</span> fell' in page


def test_a_score_is_shown_with_display_name_and_unit(tmp_path: Path) -> None:
    rows = [{"min_stability_margin_deg": 8.0 + k, "rms_heading_deg": 1.0, "stair.slope_deg": 20.0 + k} for k in range(3)]
    page = page_of(tmp_path, *rows, score="min_stability_margin_deg")
    assert "<h2>Smallest tip-over margin that lasts 0.1 s by stair.slope_deg</h2>" in page
    assert ">smallest tip-over margin that lasts 0.1 s [°]</p>" in page
    # The RMS of margins has no meaning, the RMS of RMS values does.
    cells = dict(re.findall(r'<code class="key">(\w+)</code></td>(.*?)</tr>', page))
    assert [("–</td>" in cells[key]) for key in ("min_stability_margin_deg", "rms_heading_deg")] == [True, False]


def test_without_a_varying_number_there_is_no_chart(tmp_path: Path) -> None:
    assert "<svg" not in page_of(tmp_path, {"stair.open_risers": True}, {"stair.open_risers": False})
