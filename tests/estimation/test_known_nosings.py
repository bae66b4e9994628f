"""Known nosings relative to the chair: their places, and where belts and flipper lie on them."""

import math

import pytest
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
    assert StairTracker().around(0.475) is None


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
    ("heights_m", "pitch_deg"),
    [
        pytest.param((0.10,), 11.96, id="a kerb"),
        pytest.param((0.60,), 90.0, id="higher than the rear reaches"),
        pytest.param((0.16, 0.32), 39.76, id="two steps"),
    ],
)
def test_with_the_edge_at_mid_track_the_rear_stands_on_the_floor(heights_m: tuple[float, ...], pitch_deg: float) -> None:
    """Test: steps before a level chair. Expected result: the edge's height is the distance to the rear pulley's axis times the
    sine, and its radius less its cosine part."""
    nosings = tuple(KnownNosing(0.5 + 0.30 * k, height_m, 0.001) for k, height_m in enumerate(heights_m))
    around = KnownNosings(0.0, nosings, rise_m=heights_m[0])
    assert around.floor_rad(AXIS_M, 0.07) / DEG == pytest.approx(pitch_deg, abs=0.01)


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
