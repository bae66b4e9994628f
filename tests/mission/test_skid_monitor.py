"""A chair that turns against its belts is not steered, and for how long."""

import pytest
from world import belts, estimate

from treadline.core.angles import DEG
from treadline.core.signals import HeadingEstimate, TrackReading
from treadline.mission._skid_monitor import SkidMonitor

# Limits that the belts' skid and slip on 28° gave (docs/decisions/0022).
WINDOW_S, APART_M_S, AWAY_RAD = 0.2, 0.01, 0.15 * DEG
SQUARE_RAD, LOST_RAD, TURNS_RAD_S = 2.0 * DEG, 8.0 * DEG, AWAY_RAD / WINDOW_S
SLIPS_M_S, GRIPS_M_S, SLID_M = 0.04, 0.02, 0.03
BEYOND, WITHIN = 1.1, 0.95
TICK_S = 0.0125
TICKS = round(WINDOW_S / TICK_S)


def tracks(apart_m_s: float) -> TrackReading:
    return belts(0.0, 0.2 - 0.5 * apart_m_s, 0.2 + 0.5 * apart_m_s)


def heading(off_rad: float, rate_rad_s: float = 0.0) -> HeadingEstimate:
    return estimate(0.0, off_rad, rate_rad_s)


def square(aim_rad: float = 0.0) -> SkidMonitor:
    """Return the watch of a chair that was square ten seconds ago."""
    monitor = SkidMonitor()
    assert monitor.steering_allowed(-10.0, tracks(0.0), heading(aim_rad), aim_rad)
    return monitor


def turned(monitor: SkidMonitor, from_rad: float, by_rad: float, apart_m_s: float, aim_rad: float = 0.0, t_s: float = 0.0) -> bool:
    """Return whether a chair is still steered that turns evenly, its belts apart, for as long as the watch looks back."""
    rate = by_rad / WINDOW_S
    for k in range(TICKS):
        monitor.steering_allowed(t_s + k * TICK_S, tracks(apart_m_s), heading(from_rad + by_rad * k / TICKS, rate), aim_rad)
    return monitor.steering_allowed(t_s + WINDOW_S, tracks(apart_m_s), heading(from_rad + by_rad, rate), aim_rad)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("aim_rad", [0.0, 0.1])
@pytest.mark.parametrize(
    ("by_rad", "apart_m_s", "steers"),
    [
        (BEYOND * AWAY_RAD, -BEYOND * APART_M_S, False),
        (WITHIN * AWAY_RAD, -BEYOND * APART_M_S, True),  # it hardly turns
        (BEYOND * AWAY_RAD, -WITHIN * APART_M_S, True),  # it hardly steers
        (BEYOND * AWAY_RAD, BEYOND * APART_M_S, True),  # its belts turn it so
        (-BEYOND * AWAY_RAD, BEYOND * APART_M_S, True),  # it comes back, and its belts brake the turn
        (-BEYOND * AWAY_RAD, -BEYOND * APART_M_S, True),  # it comes back, as its belts ask
    ],
)
def test_only_what_turns_away_against_its_belts_is_not_steered(
    sign: float, aim_rad: float, by_rad: float, apart_m_s: float, *, steers: bool
) -> None:
    """Test: on either side, also next to a wall to keep off, a chair turns from its aim or to it. Expected result: as listed."""
    aim = sign * aim_rad
    assert turned(square(aim), aim + sign * 2.0 * DEG, sign * by_rad, sign * apart_m_s, aim) is steers


@pytest.mark.parametrize(("at_rad", "steers"), [(WITHIN * SQUARE_RAD, False), (BEYOND * SQUARE_RAD, True)])
def test_a_chair_that_began_with_a_heading_error_is_turned_back(at_rad: float, *, steers: bool) -> None:
    """Test: a chair that has come nearly square, or square, turns away against its belts. Expected: steered on, suspended."""
    monitor = SkidMonitor()
    assert turned(monitor, 0.2, 0.01, -0.1)
    assert monitor.steering_allowed(1.0, tracks(0.0), heading(at_rad))
    assert turned(monitor, 0.05, 0.01, -0.1, t_s=2.0) is steers


def test_a_chair_that_was_turned_far_is_turned_back() -> None:
    """Test: square once, suspended, then pushed beyond 8° of its aim. Expected result: steered at once, and on while it skids."""
    monitor = square()
    assert not turned(monitor, 0.05, 0.01, -0.1)
    assert not monitor.steering_allowed(1.0, tracks(0.0), heading(WITHIN * LOST_RAD))
    assert monitor.steering_allowed(1.1, tracks(0.0), heading(BEYOND * LOST_RAD))
    assert turned(monitor, 0.1, 0.01, -0.1, t_s=2.0)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_neither_a_better_heading_nor_another_aim_is_a_turn(sign: float) -> None:
    """Test: belts that steer, rightly, after a jump of the heading by 2°, and of the aim. Expected result: steered on."""
    for aims, offs in (((0.0, 0.0), (0.01, 0.045)), ((0.0, -0.035), (0.01, 0.01))):
        monitor = square()
        for k in range(4 * TICKS):
            late = int(k >= TICKS)
            assert monitor.steering_allowed(k * TICK_S, tracks(-sign * 0.1 * late), heading(sign * offs[late]), sign * aims[late])


def test_missing_data_is_no_reason_to_suspend_steering() -> None:
    """Test: no reading of the belts, no heading, and a jump of the heading over that gap. Expected result: steered on."""
    monitor = square()
    assert monitor.steering_allowed(0.0, tracks(-1.0), heading(0.02))
    assert monitor.steering_allowed(0.05, None, heading(0.03))
    assert monitor.steering_allowed(0.1, tracks(-1.0), heading(0.04))
    assert monitor.steering_allowed(0.15, tracks(-1.0), None)
    assert monitor.steering_allowed(0.2, tracks(-1.0), heading(0.05))
    assert monitor.steering_allowed(0.25, tracks(-1.0), heading(0.05, float("nan")))
    assert monitor.steering_allowed(0.3, tracks(-1.0), heading(float("nan")))
    assert not turned(monitor, 0.05, BEYOND * AWAY_RAD, -0.1, t_s=1.0), "and it is forgotten"


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(
    ("off_rad", "rate_rad_s", "roll_back_m", "steers"),
    [
        (WITHIN * SQUARE_RAD, 0.0, 0.0, False),
        (WITHIN * SQUARE_RAD, -BEYOND * TURNS_RAD_S, 0.0, False),  # nearly square, it can wait
        (BEYOND * SQUARE_RAD, 0.0, WITHIN * SLID_M, True),  # all tracks skid that turn
        (BEYOND * SQUARE_RAD, 0.0, SLID_M, False),  # it slides, and does not turn
        (BEYOND * SQUARE_RAD, -WITHIN * TURNS_RAD_S, SLID_M, False),
        (BEYOND * SQUARE_RAD, -BEYOND * TURNS_RAD_S, SLID_M, True),  # it slides as it turns back
        (WITHIN * LOST_RAD, 0.0, SLID_M, False),
        (BEYOND * LOST_RAD, 0.0, SLID_M, True),  # with a larger heading error it would not stop
    ],
)
def test_a_chair_that_slips_and_does_not_turn_is_not_steered(
    sign: float, off_rad: float, rate_rad_s: float, roll_back_m: float, *, steers: bool
) -> None:
    """Test: belts 5 cm/s faster than a chair with a heading error that turns back, or not. Expected result: as listed,
    whether square before or not; and none of it while the belts grip."""
    for slip_m_s, expected in ((BEYOND * SLIPS_M_S, steers), (WITHIN * SLIPS_M_S, True)):
        monitor = SkidMonitor()
        for k in range(TICKS + 1):
            seen = heading(sign * off_rad, sign * rate_rad_s)
            on = monitor.steering_allowed(k * TICK_S, tracks(-sign * 0.4), seen, 0.0, slip_m_s if k else 0.0, roll_back_m)
        assert on is expected


def test_steering_is_suspended_until_the_chair_grips_or_is_lost() -> None:
    """Test: steering suspended for slip, which falls to half and below; again, and pushed beyond 8°. Expected: resumed, twice."""
    monitor = SkidMonitor()
    assert monitor.steering_allowed(0.0, tracks(0.2), heading(0.05), 0.0, BEYOND * SLIPS_M_S, SLID_M), "one reading shows no turn"
    assert not monitor.steering_allowed(0.05, tracks(0.2), heading(0.05), 0.0, BEYOND * SLIPS_M_S, SLID_M)
    assert not monitor.steering_allowed(0.1, tracks(0.0), heading(0.05, -1.0), 0.0, BEYOND * GRIPS_M_S, SLID_M)
    assert not monitor.steering_allowed(0.2, tracks(0.0), None)
    assert monitor.steering_allowed(0.3, tracks(0.0), heading(0.05), 0.0, WITHIN * GRIPS_M_S, SLID_M)
    assert not monitor.steering_allowed(0.4, tracks(0.2), heading(0.05), 0.0, BEYOND * SLIPS_M_S, SLID_M)
    assert monitor.steering_allowed(0.5, tracks(0.0), heading(BEYOND * LOST_RAD), 0.0, BEYOND * SLIPS_M_S, SLID_M)
