"""Eq. (5): the offset between heading and the IMU's yaw."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from world import heading, imu

from treadline.core.angles import DEG, wrap
from treadline.core.signals import HeadingMeasurement, ImuSample
from treadline.estimation import OffsetEstimator
from treadline.estimation.offset import heading_offset

angle = st.floats(min_value=-np.pi, max_value=np.pi, exclude_max=True)


def yawed(t_s: float, yaw_rad: float, rate_rad_s: float = 0.0) -> ImuSample:
    return imu(t_s, yaw_rad=yaw_rad, rates_rad_s=(0.0, 0.0, rate_rad_s))


def seen(t_s: float, heading_rad: float) -> HeadingMeasurement:
    return heading(t_s, heading_rad / DEG)


@given(theta=angle, gamma=angle)
def test_yaw_and_offset_add_up_to_the_heading(theta: float, gamma: float) -> None:
    # Rounding of angles near π.
    assert abs(wrap(gamma + heading_offset(theta, gamma) - theta)) < 1e-12


@settings(max_examples=50)
@given(theta=angle, gamma=angle, turn=st.floats(min_value=-1.0, max_value=1.0))
def test_between_frames_the_heading_follows_the_yaw(theta: float, gamma: float, turn: float) -> None:
    estimator = OffsetEstimator()
    estimator.step(yawed(0.0, gamma))
    estimator.step(seen(0.0, theta))
    estimate = estimator.step(yawed(0.01, wrap(gamma + turn)))
    # Through a quaternion and back: a few roundings.
    assert abs(wrap(estimate.heading_rad - theta - turn)) < 1e-9


@pytest.mark.parametrize("late_s", [0.0, 0.1, 0.4])
def test_a_late_frame_is_paired_with_the_yaw_of_its_time(late_s: float) -> None:
    rate, offset = 15.0 * DEG, 40.0 * DEG
    estimator = OffsetEstimator()
    estimate = None
    for k in range(300):
        t_s = 0.01 * k
        estimate = estimator.step(yawed(t_s, wrap(rate * t_s), rate))
        if k % 10 == 0 and t_s >= late_s:
            estimate = estimator.step(seen(t_s - late_s, wrap(rate * (t_s - late_s) + offset)))
    # Stamps are multiples of the IMU's period, so a sample at the same instant exists; with the newest yaw, 0.1 s would be 1.5°.
    assert abs(wrap(estimate.heading_rad - rate * estimate.t_s - offset)) < 1e-6


def test_a_jump_beyond_the_rule_is_an_aberration() -> None:
    estimator = OffsetEstimator()
    estimator.step(yawed(0.0, 0.0))
    before = estimator.step(seen(0.0, 0.1))
    # The threshold is 5°.
    assert estimator.step(seen(0.001, 0.1 + 5.1 * DEG)) == before
    assert estimator.rejected_count == 1
    assert estimator.step(seen(0.002, 0.1 + 4.9 * DEG)) != before


@pytest.mark.parametrize("stamp", [0.5, 0.4, -2.0, 7.0, np.nan])
def test_frames_that_repeat_go_back_or_belong_to_no_yaw_are_dropped(stamp: float) -> None:
    estimator = OffsetEstimator()
    for k in range(100):
        estimator.step(yawed(0.01 * k, 0.0))
    before = estimator.step(seen(0.5, 0.1))
    assert estimator.step(seen(stamp, 0.12)) == before


def test_samples_that_are_not_numbers_or_not_newer_are_dropped() -> None:
    estimator = OffsetEstimator()
    estimator.step(yawed(1.0, 0.0))
    before = estimator.step(seen(1.0, 0.1))
    for t_s, yaw, rate in ((1.0, 0.5, 0.0), (0.9, 0.5, 0.0), (np.nan, 0.5, 0.0), (1.01, 0.5, np.nan)):
        assert estimator.step(yawed(t_s, yaw, rate)) == before


def test_without_an_imu_there_is_no_heading() -> None:
    assert OffsetEstimator().step(seen(0.0, 0.1)) is None
