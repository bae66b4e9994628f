"""Faults at the foot, over crest and edge, in physical terms: the rows of docs/explanation/safety.md.

``benchmarks/faults.py`` has each fault in each phase. The camera is the one without images.
"""

from functools import partial

import faulty_runs
import numpy as np
import pytest
from faulty_runs import TICK_S, hold_s, stands_still

from treadline.core.angles import DEG
from treadline.run.episode import Traverse
from treadline.scenario.faults import Process

WAITS_S = 3.0
"""Time until the flipper of a chair that wakes up on a flight is laid [s], up to 0.2 s more or less."""
CREST_S, EDGE_S = WAITS_S + 19.0, 13.0
"""Times at the middle of the pitch [s], from four steps below the crest and from the landing."""
PITCH_RATE = 20.0 * DEG
SEAT = 10.0 * DEG


fault = partial(faulty_runs.fault, for_s=1000.0)
ride = partial(faulty_runs.ride, direction="up", step=3, until_s=30.0, after_s=2.0, steps=8)
"""Drive on eight steps until the end, or until two seconds after a hold; crest and edge borrow the margin of the flipper."""


def pitches(run: Traverse, t_s: float, phase: str) -> None:
    """Check that the chair was in a phase then, and half-way between landing and flight."""
    assert [name for begin_s, name in run.scores.phases if begin_s <= t_s][-1] == phase
    assert 5.0 * DEG < run.trace["pitch_rad"][round(t_s / TICK_S)] < 25.0 * DEG


@pytest.mark.parametrize(("direction", "step", "at_s"), [("up", 3, WAITS_S + 4.0), ("down", 7, WAITS_S + 4.0)])
def test_7_a_gyro_that_begins_to_drift_where_no_stair_is_in_view(direction: str, step: int, at_s: float) -> None:
    """Test: a bias of 1 °/s from when the last nosings leave the view, for good. Expected result: HOLD, by the belts that turn
    the chair all the time, or by a heading that a chair which is left alone would not have; true heading within 5°."""
    run = ride(fault("imu_bias", 1.0, at_s=at_s), place="flight", direction=direction, step=step)
    assert run.verdict == "held", run.cause
    assert any(cause in run.cause for cause in ("with the heading from the gyro alone", "or the gyro errs"))
    assert float(np.abs(run.trace["heading_rad"]).max()) <= 5.0 * DEG
    stands_still(run)


def test_15_friction_too_low_to_climb() -> None:
    """Test: friction of 1.03 of the slope's tangent from the beginning. Expected result: refused at the foot after the traction
    test, backed off to the floor, never slid by more than 50 mm."""
    run = ride(fault("low_friction", 0.88, at_s=0.0), place="floor", until_s=40.0)
    assert run.verdict == "refused", run.cause
    assert "friction" in run.cause
    backed_s = next(t_s for t_s, phase in run.scores.phases if phase == "back_off")
    forth = run.trace["x_m"][: round(backed_s / TICK_S)]
    assert float((np.maximum.accumulate(forth) - forth).max()) <= 0.050
    assert abs(float(run.trace["pitch_rad"][-1])) < 2.0 * DEG


def test_19_a_seat_that_does_not_follow_over_the_crest() -> None:
    """Test: the seat's actuator is dead from before the crest on. Expected result: HOLD, seat within 10°."""
    run = ride(fault("seat_stuck", at_s=WAITS_S + 1.0), place="flight")
    assert run.verdict == "held", run.cause
    assert "seat" in run.cause
    assert float(np.abs(run.trace["seat_pitch_rad"]).max()) <= SEAT
    stands_still(run)


def test_11_late_orders_before_the_crest() -> None:
    """Test: orders come half a second late, and readings in bursts. Expected result: HOLD; the seat stands within 5°, for what
    answered an old reading moves it no more."""
    run = ride(fault("late_tick", 0.5, at_s=WAITS_S + 10.6, for_s=3.0), place="flight")
    assert run.verdict == "held", run.cause
    assert float(np.abs(run.trace["seat_pitch_rad"]).max()) <= 0.5 * SEAT
    stands_still(run)


def test_14_a_belt_without_grip_near_the_crest() -> None:
    """Test: one belt slips for six seconds where the last nosings have left the view. Expected result: within 8°, rolled back by
    0.3 m at most; if it is held, it stands."""
    run = ride(fault("track_slip", -0.85, at_s=WAITS_S + 4.5, for_s=6.0), place="flight")
    assert float(np.abs(run.trace["heading_rad"]).max()) <= 8.0 * DEG
    assert run.scores.roll_back_m <= 0.30
    if run.verdict == "held":
        stands_still(run)


@pytest.mark.parametrize("seed", [0, 1])
def test_14_a_belt_that_loses_grip_before_the_foot(seed: int) -> None:
    """Test: backing down with 1.17 times the friction the slope asks for, a belt loses a seventh of its grip. Expected result:
    steering suspended, the chair stays within 4° of square (9° if steered) and gets down."""
    slip = fault("track_slip", -0.85, at_s=WAITS_S + 4.8, for_s=6.0)
    run = ride(slip, place="flight", direction="down", step=7, heavy=True, seed=seed, until_s=45.0)
    assert run.verdict == "arrived", run.cause
    assert float(np.abs(run.trace["heading_rad"]).max()) <= 4.0 * DEG


def test_18_a_flipper_planner_that_is_stuck_in_line_on_the_way_down() -> None:
    """Test: backing down, the section carries in line with the belts, and moves no more. Expected result: HOLD on the flight:
    with a flipper that does not rise it would drop off the last nosing (47 °/s)."""
    run = ride(fault("flipper_stuck", at_s=WAITS_S + 3.3), place="flight", direction="down", step=7)
    assert run.verdict == "held", run.cause
    assert "it does not rise" in run.cause
    assert run.scores.max_pitch_rate_deg_s <= PITCH_RATE / DEG
    stands_still(run)


@pytest.mark.parametrize(("direction", "step", "at_s"), [("up", 3, WAITS_S + 4.3), ("down", 7, WAITS_S + 4.7)])
def test_25_something_on_the_level_beyond_the_stair(direction: str, step: int, at_s: float) -> None:
    """Test: a box comes to stand 1.2 m ahead, on the landing or the floor, where no stair is in view any more. Expected result:
    HOLD for what stands in the way, 0.3 m before it."""
    run = ride(fault("obstacle", 1.2, at_s=at_s), place="flight", direction=direction, step=step)
    assert run.verdict == "held", run.cause
    assert run.cause.startswith("obstacle 0.3")
    stands_still(run)


def test_22_a_dead_controller() -> None:
    """Test: nothing is proposed any more. Expected result: HOLD, still within 0.8 s of the third missed period."""
    died_s = WAITS_S + 1.0
    run = ride(fault("process_killed", Process.CONTROLLER, at_s=died_s), place="flight", until_s=died_s + 5.0)
    assert run.verdict == "held", run.cause
    assert hold_s(run) - died_s <= 0.8
    stands_still(run)


@pytest.mark.parametrize(
    ("place", "direction", "at_s", "phase"), [("flight", "up", CREST_S, "crest"), ("landing", "down", EDGE_S, "edge")]
)
def test_18_a_dead_flipper_while_the_chair_pitches(place: str, direction: str, at_s: float, phase: str) -> None:
    """Test: the flipper's motor dies half-way. Expected result: let down at 20 °/s at most, upright, heading within 6°."""
    run = ride(fault("flipper_lost", at_s=at_s), place=place, direction=direction)
    pitches(run, at_s, phase)
    assert run.verdict in ("held", "arrived", "time_up"), run.cause
    assert float(np.abs(run.trace["pitch_rate_rad_s"]).max()) <= PITCH_RATE
    assert float(np.abs(run.trace["heading_rad"]).max()) <= 6.0 * DEG


@pytest.mark.parametrize(
    ("kind", "place", "direction", "at_s", "phase"),
    [("imu_lost", "flight", "up", CREST_S, "crest"), ("operator_stop", "landing", "down", EDGE_S, "edge")],
)
def test_9_21_a_hold_while_the_chair_pitches(kind: str, place: str, direction: str, at_s: float, phase: str) -> None:
    """Test: stop is pressed, or the IMU falls silent, half-way. Expected result: HOLD at once; the flipper stands, and the chair
    with it."""
    run = ride(fault(kind, at_s=at_s), place=place, direction=direction)
    pitches(run, at_s, phase)
    assert run.verdict == "held", run.cause
    assert hold_s(run) - at_s <= 0.12
    stands_still(run)
