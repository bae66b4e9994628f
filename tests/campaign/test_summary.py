"""Summary of a campaign."""

from dataclasses import fields

import pytest
from hypothesis import given
from hypothesis import strategies as st

from treadline.campaign._results import clopper_pearson, summarise, worst
from treadline.campaign.sweep import SHOWN, lines
from treadline.run.run_scores import Scores


@pytest.mark.parametrize(
    ("count", "total", "bounds"),
    [
        # Closed form of Clopper and Pearson at the ends: 1 - 0.025^(1/n).
        (0, 10, (0.0, 1.0 - 0.025**0.1)),
        (10, 10, (0.025**0.1, 1.0)),
        (0, 1000, (0.0, 1.0 - 0.025**0.001)),
        # Textbook values to four decimals (Newcombe 1998, table I, method 5).
        (81, 263, (0.2527, 0.3676)),
        (15, 148, (0.0578, 0.1617)),
        (1, 29, (0.0009, 0.1776)),
        (0, 0, (0.0, 1.0)),
    ],
)
def test_bounds_equal_published_tables(count: int, total: int, bounds: tuple[float, float]) -> None:
    assert clopper_pearson(count, total) == pytest.approx(bounds, abs=5e-5)


@given(st.integers(1, 2000), st.data())
def test_bounds_contain_the_share_and_are_symmetric(total: int, data: st.DataObject) -> None:
    count = data.draw(st.integers(0, total))
    low, high = clopper_pearson(count, total)
    assert 0.0 <= low <= count / total <= high <= 1.0
    assert clopper_pearson(total - count, total) == pytest.approx((1.0 - high, 1.0 - low), abs=1e-9)


ROWS = [
    {"index": 0, "seed": 1, "verdict": "arrived", "cause": None, "min_margin": 9.0, "rate": 8.0, "side": "up"},
    {"index": 1, "seed": 2, "verdict": "held", "cause": "no frame for 0.3 s", "min_margin": 7.0, "rate": -12.0, "side": "up"},
    {"index": 2, "seed": 3, "verdict": "fell", "cause": "tilted 26°", "min_margin": None, "rate": 40.0, "side": "down"},
    {"index": 3, "seed": 4, "verdict": "held", "cause": "no frame for 0.4 s", "min_margin": 6.0, "rate": 3.0, "side": "down"},
    {"index": 4, "seed": 5, "verdict": "error", "cause": "no light", "side": "down"},
]


def test_the_worst_are_falls_then_failures_then_the_lowest_margins() -> None:
    assert [row["index"] for row in worst(ROWS, "min_margin")] == [2, 4, 3, 1, 0]
    assert [row["index"] for row in worst(ROWS, "rate", 3)] == [2, 4, 0]


def test_scores_are_those_of_the_runs_that_have_them() -> None:
    refused = ROWS[0] | {"index": 5, "verdict": "refused", "side": None, "min_margin": 1.0, "rate": 99.0}
    with_one = summarise([*ROWS, refused], ["side"], [], "min_margin")
    summary = summarise(ROWS, ["side"], ["side"], "min_margin")
    assert with_one["scores"] == summary["scores"]
    assert summary["verdicts"]["held"]["count"] == 2
    assert summary["by"]["side"] == {"down": {"error": 1, "fell": 1, "held": 1}, "up": {"arrived": 1, "held": 1}}
    assert (summary["scores"]["min_margin"]["count"], summary["scores"]["min_margin"]["worst_run"]) == (3, 3)
    assert summary["scores"]["rate"]["worst"] == 40.0
    assert summary["causes"]["held: no frame for s"] == 2
    assert set(summary["scores"]) == {"min_margin", "rate"}
    assert any("fell" in line for line in lines(summary))


def test_a_run_that_ended_early_enters_no_average_and_every_worst_value() -> None:
    ends = {"arrived": 2.0, "time_up": 4.0, "end_of_flight": 3.0, "fell": 40.0, "held": 30.0, "diverged": 0.1}
    rows = [
        {"index": k, "seed": 0, "verdict": verdict, "cause": None, "rms_heading_deg": value}
        for k, (verdict, value) in enumerate(ends.items())
    ]
    found = summarise(rows, [], [], "rms_heading_deg")
    score = found["scores"]["rms_heading_deg"]
    assert (score["count"], score["averaged"], score["mean"], score["median"]) == (6, 3, 3.0, 3.0)
    assert score["rms"] == pytest.approx((29.0 / 3.0) ** 0.5)
    assert (score["min"], score["max"], score["worst"], score["worst_run"]) == (0.1, 40.0, 40.0, 3)
    assert "  rms_heading_deg: RMS 3.11°, median 3°, worst 40° (run 0003; averages of 3 runs of 6)" in lines(found)
    none = summarise(rows[3:], [], [], "rms_heading_deg")
    assert none["scores"]["rms_heading_deg"]["mean"] is None
    assert "  rms_heading_deg: worst 40° (run 0003; averages of 0 runs of 3)" in lines(none)


def test_shown_scores_are_scores_of_a_traversal() -> None:
    assert set(SHOWN) <= {field.name for field in fields(Scores)}


def test_a_verdict_that_never_occurred_has_bounds() -> None:
    fell = summarise(ROWS[:1] * 300, [], [], "min_margin")["verdicts"]["fell"]
    assert (fell["count"], fell["bounds"]) == (0, [0.0, pytest.approx(0.01222, abs=1e-5)])


@pytest.mark.parametrize("ways", [(5.0, 0.2, 3.0), (-5.0, -0.2, -3.0)])
def test_the_shortest_distance_is_the_worst_up_and_down(ways: tuple[float, ...]) -> None:
    rows = [{"index": i, "seed": 0, "verdict": "held", "cause": "-", "climbed_m": way} for i, way in enumerate(ways)]
    summary = summarise(rows, (), (), "climbed_m")
    assert summary["scores"]["climbed_m"]["worst_run"] == 1
    assert [row["index"] for row in summary["worst"]] == [1, 2, 0]
