"""Known nosings relative to the chair: what is crossed, how steep it is, and where a flipper lies."""

import math
from dataclasses import replace

import pytest
from chassis import known
from world import RISE_M, RUN_M, SLOPE_RAD, belts, imu, stair

from treadline.core.angles import DEG
from treadline.estimation.known_nosings import KnownNosing, KnownNosings
from treadline.estimation.stair_tracker import StairTracker

SLOPE = 28.0 * DEG
FLIPPER_M, AXIS_M = 0.45, 0.475


def line(*above_mm: float, sigma_m: float = 0.001) -> KnownNosings:
    """Return nosings 0.33 m apart from mid-track on, at these heights above the belts' line."""
    return KnownNosings(SLOPE, tuple(KnownNosing(0.33 * k, mm / 1000.0, sigma_m) for k, mm in enumerate(above_mm)))


def test_the_tracker_gives_places_along_the_belts_and_heights_above_them() -> None:
    """Test: a chair on the floor before a flight, then pitched on it. Expected result: the second nosing is one run further and one
    rise higher; on the flight all nosings lie on the belts' line, with standard deviations of millimetres."""
    tracker = StairTracker()
    for pitch_rad, places in (
        (0.0, [(0.8 + k * RUN_M, 0.0, (k + 1) * RISE_M) for k in range(4)]),
        (SLOPE_RAD, [(0.1 + k * math.hypot(RISE_M, RUN_M), 0.0, 0.0) for k in range(4)]),
    ):
        tracker = StairTracker()
        for k in range(10):
            tracker.update(imu(0.1 * k, pitch_rad))
            tracker.update(belts(0.1 * k, 0.0, 0.0))
            tracker.update(stair(0.1 * k, places))
        around = tracker.around(0.475)
        assert around is not None
        for found, (x, _, z) in zip(around.nosings, places, strict=True):
            assert (found.ahead_m, found.above_m) == pytest.approx((x, z), abs=1e-6)
        assert all(found.sigma_m < 0.005 for found in around.nosings)
        assert around.steepest[0] == pytest.approx(SLOPE_RAD)
    assert StairTracker().around(0.475) is None


@pytest.mark.parametrize(
    ("top_deg", "pitch_deg", "before_top"), [(28, 28, 0), (20, 28, 1), (20, 20, 0), (36, 33, 0), (27.5, 28, 0)]
)
def test_the_crossed_nosing_is_the_uppermost_that_bears_the_belts(top_deg: float, pitch_deg: float, before_top: int) -> None:
    """Test: last steps as steep as the flight, less steep, and steeper. Expected result: a chair on the flight below a low last
    step turns about the nosing before the last, and about the last once it lies on that; half a degree is no difference."""
    around = known(pitch_deg * DEG, 0.3, [top_deg * DEG, SLOPE, SLOPE])
    assert around.crossed == around.nosings[-1 - before_top]
    assert around.landing_m == pytest.approx(0.34 * math.sin(top_deg * DEG) * before_top)


@pytest.mark.parametrize(
    ("above_mm", "angle_deg"),
    [((0, 0, 0, 0, 0), 0.0), ((0, 0, 0, 10, 0), math.degrees(math.atan2(0.013, 0.45))), ((0, 0, -20, -30, -40), -3.43)],
    ids=["a regular flight", "a high nosing before its tip", "nosings lower than the one that bears"],
)
def test_a_flipper_lies_on_the_nosings_below_it_and_passes_over_those_before_it(
    above_mm: tuple[float, ...], angle_deg: float
) -> None:
    assert line(*above_mm).flipper_rad(AXIS_M, FLIPPER_M) / DEG == pytest.approx(angle_deg, abs=0.01)


@pytest.mark.parametrize(
    ("slopes_deg", "rise_m", "ahead_m", "lies_deg"),
    [
        ((28.0, 28.0), 0.16, 0.0, 28.0),
        ((), 0.10, 0.0, 11.96),
        ((), 0.10, 0.40, 6.53),
        ((), 0.60, 0.0, 90.0),
        ((28.0,), 0.16, 0.4, 21.09),
    ],
    ids=["a flight", "a kerb", "a kerb, the rear further away", "higher than the rear reaches", "two steps, the rear on the floor"],
)
def test_the_belts_lie_on_the_next_nosing_or_with_the_rear_on_the_floor(
    slopes_deg: tuple[float, ...], rise_m: float, ahead_m: float, lies_deg: float
) -> None:
    """Test: flights and single steps, the edge at mid-track or further ahead. Expected result: the slope, or if smaller the angle
    at which the edge's height is the distance to the rear pulley's axis times the sine, and its radius less its cosine part."""
    around = replace(known(0.0, -1.5, [deg * DEG for deg in slopes_deg]), rise_m=rise_m)
    assert around.lies(AXIS_M, ahead_m, 0.07)[0] / DEG == pytest.approx(lies_deg, abs=0.01)


@pytest.mark.parametrize(
    ("above_mm", "ahead_m", "falls_deg"),
    [
        pytest.param((0, 0, 0, 0), 0.5, 0.0, id="nosings on a line"),
        pytest.param((0, 10, 0, 0), 0.5, 3.47, id="about the high nosing, 10 mm in 0.33 m on either side of it"),
        pytest.param((0, 10, 0, 0), 0.3, 0.0, id="past the high nosing"),
        pytest.param((0, -10, 0, 0), 0.5, 0.0, id="a low nosing that does not bear"),
        pytest.param((0, 10), 0.2, 0.0, id="below the lowest pair"),
    ],
)
def test_a_chair_that_backs_down_falls_about_a_high_nosing(above_mm: tuple[float, ...], ahead_m: float, falls_deg: float) -> None:
    assert line(*above_mm).falls_rad(ahead_m) / DEG == pytest.approx(falls_deg, abs=0.01)
