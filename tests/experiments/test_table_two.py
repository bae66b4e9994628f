"""Table II from runs: headings of completed runs alone, worst values of all, and the runs that ended early by name."""

from typing import Any

import pytest

from treadline.experiments._fig08_to_fig10 import table2

SCORES = (
    "rms_yaw_deg", "steady_rms_heading_deg", "roll_back_m", "lateral_m", "settle_s", "passenger_max_m_s2",
    "passenger_vertical_m_s2", "passenger_longitudinal_m_s2", "passenger_lateral_m_s2", "seconds_below_7_deg",
    "min_stability_margin_deg", "max_friction_use", "airborne_share", "max_contact_force_share", "unconverged_share",
    "max_belt_force_n", "peak_power_w",
)  # fmt: skip


def run(seed: int, rms_deg: float, **changes: Any) -> dict[str, Any]:
    labels = {"friction": (0.62, 0.5), "slope_deg": 30, "start_heading_deg": 30, "camera": "rendered"}
    end = {"verdict": "time_up", "cause": None, "duration_s": 80.0}
    return labels | dict.fromkeys(SCORES, 1.0) | end | {"seed": seed, "rms_heading_deg": rms_deg} | changes


def fall(seed: int) -> dict[str, Any]:
    fell = {"verdict": "fell", "cause": "slid 0.50 m down the flight by 1.70 s", "duration_s": 1.7}
    return run(seed, 11.0, roll_back_m=1.5, settle_s=0.57, steady_rms_heading_deg=None, **fell)


def test_a_run_that_fell_is_named_and_enters_no_mean() -> None:
    (row,) = table2([run(0, 2.0), fall(1), run(2, 3.0)])
    assert (row["rms_heading_deg"], row["sd"], row["rms_yaw_deg"]) == (2.5, pytest.approx(0.5**0.5), 1.0)
    assert (row["seeds"], row["averaged"]) == (3, 2)
    assert row["ended_early"] == ["seed 1 fell after 1.7 s: slid 0.50 m down the flight by 1.70 s"]
    assert row["roll_back_m"] == 1.5  # the worst of all runs, the fall among them
    assert row["settle_s"] is None  # it did not settle: it fell
    assert row["conditions"].startswith("80 s, seeds 0, 1, 2")


def test_falls_alone_have_no_mean() -> None:
    (row,) = table2([fall(0), fall(1)])
    assert (row["rms_heading_deg"], row["sd"], row["rms_yaw_deg"], row["steady_rms_heading_deg"]) == (None,) * 4
    assert (row["seeds"], row["averaged"], len(row["ended_early"])) == (2, 0, 2)


def test_completed_runs_are_averaged_as_before() -> None:
    (row,) = table2([run(0, 2.0), run(1, 3.0, verdict="end_of_flight")])
    assert (row["rms_heading_deg"], row["averaged"], row["ended_early"], row["settle_s"]) == (2.5, 2, [], 1.0)
