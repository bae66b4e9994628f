"""The seat's linkage: the closed forms agree with each other, cover the range, and refuse what cannot be built."""

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from treadline.core.angles import DEG
from treadline.core.errors import MechanicsError
from treadline.scenario.chair import Seat, read_chair
from treadline.vehicle.linkage import SeatLinkage

SEAT = read_chair("wheelchair").seat
LOW, HIGH = SEAT.stroke_m


def changed(**values: object) -> Seat:
    return SEAT.model_copy(update=values)


@given(stroke=st.floats(LOW, HIGH))
def test_the_bar_keeps_its_length(stroke: float) -> None:
    angle = SeatLinkage(SEAT).angle(stroke)
    pin = (SEAT.lever_arm_m * math.cos(angle), -SEAT.lever_arm_m * math.sin(angle))
    slider = (-stroke, -SEAT.slider_drop_m)
    assert math.dist(pin, slider) == pytest.approx(SEAT.bar_m, rel=1e-12)


@given(stroke=st.floats(LOW + 1e-5, HIGH - 1e-5))
def test_the_rate_ratio_is_the_derivative_of_the_angle(stroke: float) -> None:
    linkage, h = SeatLinkage(SEAT), 1e-5
    numeric = (linkage.angle(stroke + h) - linkage.angle(stroke - h)) / (2.0 * h)
    # Central difference: h² times the third derivative (below 1e3 rad/m³) leaves 1e-7.
    assert linkage.rate_ratio(stroke) == pytest.approx(numeric, rel=1e-6)


def test_the_shipped_seat_covers_minus_5_to_40_degrees() -> None:
    low, high = SeatLinkage(SEAT).angle_range
    assert low <= -5.0 * DEG
    assert high >= 40.0 * DEG


@given(stroke=st.floats(LOW, HIGH))
def test_the_shipped_seat_turns_at_12_degrees_a_second_everywhere(stroke: float) -> None:
    assert SeatLinkage(SEAT).rate_ratio(stroke) * SEAT.max_rate_m_s >= 12.0 * DEG


DEAD_POINT = r"dead point at a stroke of -?0\.\d+ m; shorten the stroke"


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"bar_m": 0.35, "stroke_m": (-0.30, -0.04)}, DEAD_POINT),  # the slider would pass under the pin
        # Bar and lever arm fold onto one line.
        ({"lever_arm_m": 0.30, "bar_m": 0.31, "slider_drop_m": 0.02, "stroke_m": (-0.2, 0.005)}, DEAD_POINT),
        ({"stroke_m": (-0.04, 0.9)}, "does not join"),
        ({"stroke_m": (-1.2, 0.2)}, "does not join"),
        ({"stroke_m": (0.1, 0.1)}, "the first must be the smaller"),
        ({"stroke_m": (0.2, -0.04)}, "the first must be the smaller"),
    ],
)
def test_a_linkage_that_cannot_be_built_is_refused(values: dict[str, Any], message: str) -> None:
    with pytest.raises(MechanicsError, match=message):
        SeatLinkage(changed(**values))


@pytest.mark.parametrize("angle_deg", [-8.0, 45.0, math.nan, math.inf])
def test_an_angle_out_of_range_is_refused(angle_deg: float) -> None:
    with pytest.raises(MechanicsError, match=r"outside the linkage's -7\.0…44\.3°"):
        SeatLinkage(SEAT).stroke(angle_deg * DEG)


@pytest.mark.parametrize("stroke", [math.nan, math.inf, -math.inf])
def test_a_stroke_that_is_no_number_is_refused(stroke: float) -> None:
    linkage = SeatLinkage(SEAT)
    with pytest.raises(MechanicsError, match="does not join"):
        linkage.angle(stroke)
    with pytest.raises(MechanicsError, match="does not join"):
        linkage.rate_ratio(stroke)


lengths = st.floats(0.05, 0.6)


@given(lever_arm=lengths, bar=lengths, drop=lengths, low=st.floats(-0.5, 0.5), stroke=st.floats(0.01, 0.5), share=st.floats(0, 1))
def test_any_linkage_that_is_accepted_can_be_inverted(
    lever_arm: float, bar: float, drop: float, low: float, stroke: float, share: float
) -> None:
    seat = changed(lever_arm_m=lever_arm, bar_m=bar, slider_drop_m=drop, stroke_m=(low, low + stroke))
    try:
        linkage = SeatLinkage(seat)
    except MechanicsError:
        return
    angle = linkage.angle_range[0] + share * (linkage.angle_range[1] - linkage.angle_range[0])
    # Near a dead point the angle hardly depends on the stroke: what must return is the angle.
    assert linkage.angle(linkage.stroke(angle)) == pytest.approx(angle, abs=1e-6)
