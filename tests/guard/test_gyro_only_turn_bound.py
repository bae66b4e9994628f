"""Bounds of the turn that the guard ascribes to the belts while the gyro alone gives the heading, against quasi-static friction."""

import math
from functools import partial

import pytest
from world import belts, known, limits

from treadline.core.angles import DEG
from treadline.core.signals import MotionPlan
from treadline.guard._gyro_only_turn import GyroOnlyTurn
from treadline.mission.mission_blocks import guard_config
from treadline.mission.mission_config import MissionConfig
from treadline.scenario.chair import read_chair
from treadline.scenario.scenario import Chair
from treadline.vehicle.bodies import centre_of_mass
from treadline.vehicle.quasi_static import floor_stance, stair_stance, steady_motion

TABLE_I = (0.62, 0.5)
CLIMB = MotionPlan(t_s=0.0, phase="climb", speed_m_s=0.1, needs_stair=False)


@pytest.mark.parametrize(("model", "payload_kg"), [("wheelchair", 50.0), ("rescue", 3.0)])
@pytest.mark.parametrize("friction", [TABLE_I, (0.9, 0.5), (0.9, 0.75), (0.9, 0.25)])
@pytest.mark.parametrize("slope_deg", [20.0, 28.0])
def test_no_belt_difference_turns_a_chair_on_nosings_by_more_than_belts_that_do_not_skid(
    model: str, payload_kg: float, friction: tuple[float, float], slope_deg: float
) -> None:
    chair = read_chair(model)
    centre = partial(centre_of_mass, chair, Chair(model=model, payload_kg=payload_kg))
    for heading_deg in (0.0, 5.0, 20.0):
        stance = stair_stance(chair, centre, slope_deg * DEG, 0.30 / math.cos(slope_deg * DEG), heading_deg * DEG, 20)
        for difference in (0.1, -0.1):
            motion = steady_motion(stance, friction, 0.1 + max(-difference, 0.0), 0.1 + max(difference, 0.0))
            # A belt's width is part of the gauge at its inner edge: a nosing phase may turn the chair by a few per cent more.
            assert motion.yaw_rad_s.max() / 0.1 < 1.05 / chair.tracks.gauge_m
            assert abs(motion.mean[2]) / 0.1 <= 1.0 / chair.tracks.gauge_m


def test_the_turn_on_the_level_is_the_quasi_static_one_of_the_wheelchair() -> None:
    chair = read_chair("wheelchair")
    motion = steady_motion(floor_stance(chair, partial(centre_of_mass, chair, Chair(payload_kg=50.0))), TABLE_I, 0.1, 0.2)
    share = guard_config(MissionConfig(chair=chair, payload_kg=50.0), 0.25).level_turn_share
    # The mission's centre of mass takes the flipper at its axis.
    assert motion.mean[2] / 0.1 == pytest.approx(share / chair.tracks.gauge_m, rel=0.01)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(("apart_m_s", "held_s"), [(0.01, 3.4), (0.02, 2.0), (0.5, 2.0)])
def test_belts_far_apart_count_no_faster_than_a_gyro_may_drift(sign: float, apart_m_s: float, held_s: float) -> None:
    """Test: belts that differ by 0.01, 0.02 and 0.5 m/s on the flight. Expected: a cause after 3° at 0.88, 1.5 and 1.5 °/s."""
    watch = GyroOnlyTurn(limits())
    t_s = 0.0
    while watch.cause(known(limits())) is None:
        t_s += 1 / 64
        watch.hear(belts(t_s, 0.0, sign * apart_m_s), known(limits(), plan=CLIMB))
        assert t_s < 10.0
    # The first reading begins the window; 1/64 s each for it and for the reading that goes beyond.
    assert t_s == pytest.approx(held_s + 1 / 64, abs=0.05)
