"""Traction: the friction ellipse, against forces added up by hand."""

import math
from functools import partial

import pytest
from hypothesis import given
from hypothesis import strategies as st

from treadline.core.angles import DEG
from treadline.core.errors import MechanicsError
from treadline.scenario.chair import read_chair
from treadline.scenario.scenario import Chair
from treadline.vehicle.bodies import centre_of_mass
from treadline.vehicle.quasi_static import stair_stance
from treadline.vehicle.traction import dead_zone_rad, friction_use, largest_heading_rad, turn_share

coefficients = st.floats(0.05, 2.0)
slopes = st.floats(0.0, 60.0 * DEG)
headings = st.floats(-math.pi, math.pi)


@given(slope=slopes, heading=headings, along=coefficients, across=coefficients, load=st.floats(1.0, 1e4))
def test_the_use_is_the_pull_over_the_ellipse_whatever_the_load(
    slope: float, heading: float, along: float, across: float, load: float
) -> None:
    normal, pull = load * math.cos(slope), load * math.sin(slope)
    ellipse = math.sqrt((pull * math.cos(heading) / (along * normal)) ** 2 + (pull * math.sin(heading) / (across * normal)) ** 2)
    assert friction_use(slope, heading, (along, across)) == pytest.approx(ellipse, rel=1e-12)


@given(slope=slopes, along=coefficients, across=coefficients)
def test_the_largest_heading_uses_all_of_the_friction(slope: float, along: float, across: float) -> None:
    friction = (along, across)
    if friction_use(slope, 0.0, friction) >= 1.0:
        with pytest.raises(MechanicsError, match="roughen the nosings"):
            largest_heading_rad(slope, friction)
        return
    largest = largest_heading_rad(slope, friction)
    use = friction_use(slope, largest, friction)
    if largest < 0.5 * math.pi:
        assert use == pytest.approx(1.0, abs=1e-9)
    else:
        assert use <= 1.0 + 1e-9


@pytest.mark.parametrize(("model", "payload_kg"), [("wheelchair", 50.0), ("wheelchair", 100.0), ("rescue", 3.0)])
@pytest.mark.parametrize("slope_deg", [22.0, 30.0])
def test_belts_turn_the_chair_outside_its_dead_zone_and_inside_only_with_more_friction(
    model: str, payload_kg: float, slope_deg: float
) -> None:
    chair, pitch_m = read_chair(model), 0.30 / math.cos(slope_deg * DEG)
    zone_rad = dead_zone_rad(chair, payload_kg)

    def share(heading_rad: float, ratio: float) -> float:
        stance = stair_stance(
            chair, partial(centre_of_mass, chair, Chair(payload_kg=payload_kg)), slope_deg * DEG, pitch_m, heading_rad, phases=20
        )
        along = ratio * math.tan(slope_deg * DEG)
        return turn_share(stance, chair.tracks.gauge_m, (along, 0.5 / 0.62 * along))

    # 1.05: the friction that check asks for. A twentieth of a turn without skidding is none, and 2° lie between two slopes.
    assert max(share(heading, 1.05) for heading in (0.0, 0.5 * zone_rad, zone_rad - 2.0 * DEG)) < 0.06
    assert share(zone_rad + 3.0 * DEG, 1.05) > 0.06
    assert share(0.0, 2.0) > 0.4
