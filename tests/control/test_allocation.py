"""Allocation of the controller's demand to the belts."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from treadline.control.belt_allocation import BeltLimits, back_safe, climb_safe, clipped, inner_speed_ratio
from treadline.core.angles import DEG

ROUNDING = 1e-12
asked_m_s = st.floats(min_value=-1e3, max_value=1e3)
climb_m_s = st.floats(min_value=0.05, max_value=0.3)


def limits(climb: float) -> BeltLimits:
    return BeltLimits(climb_speed_m_s=climb, max_speed_m_s=1.0)


@given(left=asked_m_s, right=asked_m_s, climb=climb_m_s, error=st.none() | st.floats(min_value=-1.0, max_value=1.0))
def test_the_inner_belt_keeps_the_ratio_of_its_heading_error_and_the_outer_its_limit(
    left: float, right: float, climb: float, error: float | None
) -> None:
    share = 0.25 if error is None else inner_speed_ratio(error)
    kept = limits(climb) if error is None else replace(limits(climb), min_inner_speed_ratio=share)
    given_m_s = climb_safe(np.array([left, right]), kept)
    assert given_m_s.min() >= share * climb - ROUNDING
    assert given_m_s.max() <= 1.0 + ROUNDING
    assert climb - ROUNDING <= given_m_s.mean() <= 0.55 + ROUNDING  # the guard's limit


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_near_straight_the_inner_belt_carries_the_chair_uphill(sign: float) -> None:
    # Ten degrees: the inner belt sticks on 28° with Table I's friction. The demand is half to a quarter of the climb speed.
    assert 0.25 <= inner_speed_ratio(sign * 9.9 * DEG) <= 0.5
    assert inner_speed_ratio(sign * 10.1 * DEG) < 0.25


@given(mean=asked_m_s, half=st.floats(min_value=-0.4, max_value=0.4), climb=climb_m_s)
def test_steering_does_not_depend_on_the_demanded_common_speed(mean: float, half: float, climb: float) -> None:
    # A half difference of 0.4 m/s remains between half the fastest climb speed and the mean's limit of 0.55 m/s.
    given_m_s = climb_safe(np.array([mean - half, mean + half]), limits(climb))
    # The sum of two floats of 1e3 m/s has a rounding error of 1e-13.
    assert abs((given_m_s[1] - given_m_s[0]) - 2.0 * half) < 1e-9


@pytest.mark.parametrize("safe", [climb_safe, back_safe])
@given(half=st.floats(min_value=-1e3, max_value=1e3), climb=climb_m_s)
def test_saturation_keeps_the_direction_of_turn(safe: Any, half: float, climb: float) -> None:
    given_m_s = safe(np.array([-half, half]), limits(climb))
    assert (given_m_s[1] - given_m_s[0]) * half >= 0.0


@given(climb=climb_m_s)
def test_a_square_chair_climbs_at_the_operators_speed(climb: float) -> None:
    np.testing.assert_allclose(climb_safe(np.zeros(2), limits(climb)), [climb, climb], atol=ROUNDING)


@given(left=asked_m_s, right=asked_m_s)
def test_the_papers_allocation_only_limits_each_belt(left: float, right: float) -> None:
    given_m_s = clipped(np.array([left, right]), limits(0.2))
    np.testing.assert_array_equal(given_m_s, [max(-1.0, min(1.0, left)), max(-1.0, min(1.0, right))])


@given(left=asked_m_s, right=asked_m_s, climb=climb_m_s)
def test_backing_down_every_belt_runs_at_half_to_one_and_a_half_times_the_speed(left: float, right: float, climb: float) -> None:
    given_m_s = back_safe(np.array([left, right]), limits(climb))
    assert given_m_s.max() <= -0.5 * climb + ROUNDING
    assert given_m_s.min() >= -1.5 * climb - ROUNDING
    # Within the belts' limit, because no commanded speed exceeds 0.3 m/s.
    assert given_m_s.min() >= -1.0


@given(left=asked_m_s, right=asked_m_s, climb=climb_m_s)
def test_backing_down_the_mean_speed_does_not_depend_on_the_demand(left: float, right: float, climb: float) -> None:
    assert abs(back_safe(np.array([left, right]), limits(climb)).mean() + climb) < ROUNDING


@given(share=st.floats(min_value=-0.5, max_value=0.5), climb=climb_m_s)
def test_backing_down_steering_is_kept_up_to_half_the_pace_and_turns_the_same_way(share: float, climb: float) -> None:
    half = share * climb
    given_m_s = back_safe(np.array([-half, half]), limits(climb))
    # Right minus left turns left, in both directions of travel.
    assert abs((given_m_s[1] - given_m_s[0]) - 2.0 * half) < ROUNDING
