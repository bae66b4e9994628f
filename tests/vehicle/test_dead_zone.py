"""The dead zone on a flight: rows of the table, and the condition written out by hand."""

import math

import pytest

from treadline.core.angles import DEG
from treadline.core.errors import MechanicsError
from treadline.scenario.chair import ChairDescription
from treadline.scenario.scenario import Chair
from treadline.vehicle.dead_zone import dead_zone_table, mean_distance_m, turning_room_m
from treadline.vehicle.quasi_static import steady_motion
from treadline.vehicle.stance import stair_stance

TABLE_I = (0.62, 0.5)
LOADING = Chair()


def test_square_to_a_flight_of_28_degrees_nothing_steers(chair: ChairDescription) -> None:
    rows = dead_zone_table(chair, LOADING, 28.0 * DEG, 0.30, TABLE_I, headings_rad=(0.0,), slow_m_s=(0.05, 0.2), phases=50)
    assert len(rows) == 2 * 14
    # Only the minimiser's rounding is left: 1e-8 of the fast belt's speed, more where a contact is close to slipping.
    assert max(abs(row.yaw_rad_s) for row in rows) < 1e-4 * DEG
    assert all(row.turning_share == 0.0 for row in rows)
    # The chair goes along with the slow belt.
    assert all(row.along_m_s == pytest.approx(row.slow_m_s, abs=1e-5) for row in rows)


def test_the_yaw_rate_grows_with_the_difference_alone_and_more_easily_towards_straight(chair: ChairDescription) -> None:
    rows = dead_zone_table(
        chair,
        LOADING,
        28.0 * DEG,
        0.30,
        TABLE_I,
        headings_rad=(30.0 * DEG,),
        slow_m_s=(0.05, 0.2),
        differences_m_s=(0.3, 0.6),
        phases=50,
    )
    yaw = {(row.slow_m_s, row.difference_m_s): row.yaw_rad_s / DEG for row in rows}
    for slow in (0.05, 0.2):
        assert yaw[slow, 0.6] == pytest.approx(2.0 * yaw[slow, 0.3], rel=1e-5)
        assert yaw[slow, -0.6] == pytest.approx(2.0 * yaw[slow, -0.3], rel=1e-5)
        # Published: 15 to 55 °/s from ±30° with differences of 0.6 to 1 m/s.
        assert 15.0 < yaw[slow, 0.6] < -yaw[slow, -0.6] < 55.0
    # The slow belt sticks, so that its speed does not matter.
    assert yaw[0.05, 0.6] == pytest.approx(yaw[0.2, 0.6], rel=1e-5)


@pytest.mark.parametrize("friction", [TABLE_I, (0.7, 0.5), (0.8, 0.5), (0.62, 0.3)])
@pytest.mark.parametrize("slope_deg", [25.0, 28.0, 30.0])
def test_every_phase_with_room_turns(chair: ChairDescription, slope_deg: float, friction: tuple[float, float]) -> None:
    slope = slope_deg * DEG
    stance = stair_stance(chair, LOADING, slope, 0.30 / math.cos(slope), phases=50)
    has_room = mean_distance_m(stance) < turning_room_m(slope, friction, chair.tracks.gauge_m) - 1e-3
    turns = abs(steady_motion(stance, friction, 0.15, 0.25).yaw_rad_s) > 1e-3 * DEG
    assert (turns | ~has_room).all()


@pytest.mark.parametrize(("slope_deg", "room_m"), [(0.0, 0.806), (25.0, 0.200), (28.0, 0.115), (30.0, 0.055)])
def test_the_room_to_turn_by_hand(chair: ChairDescription, slope_deg: float, room_m: float) -> None:
    # (0.62 - tan β) · 0.65 m / 0.5, to a millimetre.
    assert turning_room_m(slope_deg * DEG, TABLE_I, chair.tracks.gauge_m) == pytest.approx(room_m, abs=1e-3)


def test_a_difference_of_zero_is_refused(chair: ChairDescription) -> None:
    with pytest.raises(MechanicsError, match="belt difference 0 m/s"):
        dead_zone_table(chair, LOADING, 28.0 * DEG, 0.30, TABLE_I, differences_m_s=(0.0, 0.1))
