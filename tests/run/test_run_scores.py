"""Scores on traces whose answers are known by hand."""

import math

import numpy as np
import pytest

from treadline.core.angles import DEG
from treadline.core.ports import Truth
from treadline.run.run_scores import Trace, lasting_minimum, roll_back, score, settling_time
from treadline.vehicle.comfort import comfort


def trace(heading_deg: np.ndarray, x_m: np.ndarray | None = None, y_m: np.ndarray | None = None) -> Trace:
    count = len(heading_deg)
    x = np.linspace(0.0, 1.0, count) if x_m is None else x_m
    y = np.zeros(count) if y_m is None else y_m
    columns = {name: np.zeros(count) for name in Truth.__slots__} | {"x_m": x, "y_m": y, "passenger_x_m": x}
    return Trace(columns=columns | {"t_s": np.arange(count) / 100, "heading_rad": heading_deg * DEG})


def test_a_ramp_of_t_seconds_has_the_rms_of_its_triangle() -> None:
    # 30° falling to zero in 4 s of 80: 30 √(4/240), as PHYSICS of a ramp has it; sampling at 100 Hz adds under 0.2 %.
    t = np.arange(8001) / 100
    heading = np.clip(30.0 * (1.0 - t / 4.0), 0.0, None)
    assert score(trace(heading)).rms_heading_deg == pytest.approx(30.0 * math.sqrt(4.0 / 240.0), rel=2e-3)


def test_the_heading_is_scored_on_flights_and_not_in_turns() -> None:
    """Test: 1° on two flights, and a turn by 90° between them. Expected: 1°, from the beginning on."""
    heading = np.concatenate([np.full(300, 1.0), np.linspace(0.0, 90.0, 300), np.full(300, 1.0)])
    scores = score(trace(heading), ((0.0, "climb"), (3.0, "turn"), (6.0, "search")))
    assert (scores.rms_heading_deg, scores.max_abs_heading_deg, scores.settle_s) == pytest.approx((1.0, 1.0, 0.0))


def test_settling_is_the_last_entry_into_the_band() -> None:
    t = np.arange(1001) / 100
    heading = np.where(t < 1.0, 10.0, 0.0)
    heading[500] = 2.5
    assert settling_time(t, heading * DEG) == pytest.approx(5.01)
    assert settling_time(t, np.zeros(1001)) == 0.0
    assert settling_time(t, np.full(1001, 3.0 * DEG)) is None


def test_only_a_retreat_on_the_flight_rolls_back() -> None:
    """Test: back by 0.3 m on the landing, by 0.1 and 0.2 m on the flight. Expected: 0.2 m, and nothing from the landing."""
    onward = np.array([0.0, 1.0, 0.7, 0.7, 2.0, 1.9, 2.5, 2.3, 3.0, 2.0])
    pitch = np.array([0.0, 0.0, 0.0, 20.0, 20.0, 20.0, 20.0, 20.0, 20.0, 0.0]) * DEG
    assert roll_back(onward, pitch) == pytest.approx(0.2)
    assert roll_back(onward, -pitch) == pytest.approx(0.2)
    assert roll_back(onward, 0.0 * pitch) == 0.0


def test_a_short_run_has_no_steady_part_and_lateral_drift_no_sign() -> None:
    scores = score(trace(np.zeros(200), y_m=np.linspace(0.3, -0.1, 200)))
    assert scores.steady_rms_heading_deg is None
    assert scores.lateral_m == pytest.approx(0.4)


def test_comfort_is_the_acceleration_that_lasts() -> None:
    # Test: half a second of 2 m/s² after standing, then steady. Expected result: 2 m/s², and a change of 2 m/s² within the
    # window of 50 ms, 40 m/s³ at most, at its two ends.
    t = np.arange(301) / 100
    after = np.clip(t - 1.0, 0.0, 0.5)
    x = after**2 + 1.0 * np.clip(t - 1.5, 0.0, None)
    ride = comfort(np.stack([x, np.zeros(301), np.zeros(301)]), np.zeros(301))
    assert ride.total_m_s2 == ride.longitudinal_m_s2 == pytest.approx(2.0, rel=1e-6)
    assert (ride.lateral_m_s2, ride.vertical_m_s2) == (0.0, 0.0)
    assert 0.0 < ride.jerk_m_s3 <= 40.0 + 1e-9


@pytest.mark.parametrize(("yaw_deg", "along", "across"), [(0.0, 1.0, 0.0), (180.0, 1.0, 0.0), (90.0, 0.0, 1.0), (30.0, 0.866, 0.5)])
def test_a_push_up_the_flight_is_split_by_the_yaw_of_the_chair(yaw_deg: float, along: float, across: float) -> None:
    x = 0.5 * (np.arange(301) / 100) ** 2
    place = np.stack([x, np.zeros(301), 0.5 * x])
    ride = comfort(place, np.full(301, yaw_deg * DEG))
    # cos and sin of 30° to three places.
    assert (ride.longitudinal_m_s2, ride.lateral_m_s2) == (pytest.approx(along, abs=1e-3), pytest.approx(across, abs=1e-3))
    assert ride.vertical_m_s2 == pytest.approx(0.5)
    assert ride.total_m_s2 == pytest.approx(math.hypot(1.0, 0.5))


def test_a_margin_counts_once_it_has_lasted_a_tenth_of_a_second() -> None:
    margin = np.full(100, 9.0)
    margin[40:49] = 2.0
    assert lasting_minimum(margin) == 9.0
    margin[40:50] = np.linspace(2.0, 3.0, 10)
    assert lasting_minimum(margin) == 3.0
    assert lasting_minimum(np.array([5.0, 4.0])) == 5.0


def test_creep_is_what_a_held_chair_moves_a_minute_once_it_has_come_to_rest() -> None:
    # 3 mm/min along and 4 across from 2 s after the hold on; before, half a metre of ramp and rocking.
    t = np.arange(3001) / 100
    x = np.where(t < 7.0, 0.1 * t, 0.7 + 0.003 / 60.0 * (t - 7.0))
    held = trace(np.zeros(3001), x, 0.004 / 60.0 * t)
    assert score(held, held_s=5.0).held_creep_mm_min == pytest.approx(5.0)
    assert score(held, held_s=19.0).held_creep_mm_min is None
    assert score(held).held_creep_mm_min is None


def test_time_below_seven_degrees_counts_every_sample() -> None:
    steady = trace(np.zeros(200))
    margin = np.full(200, 8.0 * DEG)
    margin[[3, 50, 51]] = 6.9 * DEG
    scores = score(Trace(columns=steady.columns | {"stability_margin_rad": margin}))
    assert scores.seconds_below_7_deg == pytest.approx(0.03)
    assert scores.min_stability_margin_deg == pytest.approx(8.0)
