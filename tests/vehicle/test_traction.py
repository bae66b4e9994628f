"""Traction: the friction ellipse, against forces added up by hand."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from treadline.core.angles import DEG
from treadline.core.errors import MechanicsError
from treadline.vehicle.tracks import friction_use, largest_heading_rad

TABLE_I = (0.62, 0.5)
coefficients = st.floats(0.05, 2.0)
slopes = st.floats(0.0, 60.0 * DEG)
headings = st.floats(-math.pi, math.pi)


@pytest.mark.parametrize(("slope_deg", "use"), [(25, 0.80), (28, 0.91), (30, 0.99)])
def test_a_heading_of_30_degrees_takes_this_share_of_the_friction_of_table_i(slope_deg: int, use: float) -> None:
    # Two digits: how little is left at 30° is what the paper's turns have to live with.
    assert friction_use(slope_deg * DEG, 30.0 * DEG, TABLE_I) == pytest.approx(use, abs=0.005)


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


def test_at_30_degrees_the_chair_holds_to_a_heading_of_32() -> None:
    # By hand: sin² = (1 - (t/0.62)²) / ((t/0.5)² - (t/0.62)²), t = tan 30°.
    t = math.tan(30.0 * DEG)
    by_hand = math.asin(math.sqrt((1 - (t / 0.62) ** 2) / ((t / 0.5) ** 2 - (t / 0.62) ** 2)))
    assert largest_heading_rad(30.0 * DEG, TABLE_I) == pytest.approx(by_hand, rel=1e-12)
    assert by_hand / DEG == pytest.approx(32.26, abs=0.01)
    # At 25° there is more grip across than any heading needs.
    assert largest_heading_rad(25.0 * DEG, TABLE_I) == 0.5 * math.pi
