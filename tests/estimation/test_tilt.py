"""Attitude from gyro and accelerometer: gravity is found, kept through turns and jolts, and drift is bounded."""

from dataclasses import replace

import numpy as np
import pytest
from jaxtyping import Float

from treadline.core.angles import DEG
from treadline.core.rotations import levelling, quaternion_of, rotation_about, rotation_of, rotation_x, rotation_y, rotation_z
from treadline.core.signals import ImuSample
from treadline.estimation.tilt import Tilt

UP = np.array([0.0, 0.0, 1.0])


def sample(t_s: float, R_WB: Float[np.ndarray, "3 3"], rate_B: Float[np.ndarray, " 3"], *, g: float = 9.81) -> ImuSample:
    return ImuSample(t_s=t_s, orientation=np.zeros(4), angular_velocity_rad_s=rate_B, linear_acceleration_m_s2=g * (R_WB.T @ UP))


def off_level(orientation: Float[np.ndarray, " 4"] | None, R_WB: Float[np.ndarray, "3 3"]) -> float:
    """Return the angle between estimated and true gravity, in degrees."""
    found, true = rotation_of(orientation).T @ UP, R_WB.T @ UP
    return float(np.arctan2(np.linalg.norm(np.cross(found, true)), found @ true)) / DEG


@pytest.mark.parametrize("tilt", [np.eye(3), rotation_y(-28 * DEG), rotation_x(180 * DEG), rotation_y(90 * DEG)])
@pytest.mark.parametrize("g", [9.81, 1.0])
def test_the_first_sample_at_rest_gives_gravity(tilt: Float[np.ndarray, "3 3"], g: float) -> None:
    assert off_level(Tilt().step(sample(0.0, tilt, np.zeros(3), g=g)), tilt) < 1e-6


def test_before_the_first_force_there_is_no_attitude() -> None:
    tilt = Tilt()
    assert tilt.step(sample(0.0, np.eye(3), np.zeros(3), g=0.0)) is None
    assert tilt.step(sample(0.01, np.eye(3), np.zeros(3), g=np.nan)) is None
    assert tilt.step(sample(0.02, np.eye(3), np.zeros(3))) is not None


def test_a_gyro_with_a_bias_is_held_level_by_gravity() -> None:
    tilt, R_WB, bias = Tilt(), rotation_y(-28 * DEG), np.array([0.2, -0.2, 0.2]) * DEG
    rng = np.random.default_rng(1)
    for k in range(6000):
        measured = sample(0.01 * k, R_WB, bias)
        orientation = tilt.step(
            replace(measured, linear_acceleration_m_s2=measured.linear_acceleration_m_s2 + rng.normal(0.0, 0.2, 3))
        )
    # A bias of b leaves b·τ: 0.28 °/s over 2 s.
    assert off_level(orientation, R_WB) < 0.8


def test_the_yaw_is_the_gyros() -> None:
    tilt = Tilt()
    for k in range(101):
        orientation = tilt.step(sample(0.01 * k, np.eye(3), np.array([0.0, 0.0, 0.5])))
    np.testing.assert_allclose(orientation, quaternion_of(rotation_z(0.5)), atol=1e-9)


def test_after_a_pause_gravity_is_found_anew() -> None:
    tilt = Tilt()
    tilt.step(sample(0.0, np.eye(3), np.zeros(3)))
    tilted = rotation_x(0.4)
    assert off_level(tilt.step(sample(5.0, tilted, np.zeros(3))), tilted) < 1e-6


@pytest.mark.parametrize("seed", range(3))
def test_levelling_points_any_force_up(seed: int) -> None:
    force = np.random.default_rng(seed).normal(size=3)
    up = rotation_about(levelling(force)) @ force / np.linalg.norm(force)
    np.testing.assert_allclose(up, UP, atol=1e-12)


def test_a_turn_is_followed_during_a_jolt_and_past_a_rate_that_is_no_number() -> None:
    """Test: a steady turn with twice the usual force, which is no gravity, and one sample with a NaN rate. Expected result: no
    estimate for that sample, and the turn continues."""
    tilt, R_WB, rate = Tilt(), rotation_y(-28 * DEG), np.array([0.1, -0.3, 0.5])
    tilt.step(sample(0.0, R_WB, rate))
    for k in range(1, 301):
        R_WB = R_WB @ rotation_about(0.01 * rate)
        said = np.full(3, np.nan) if k == 20 else rate
        orientation = tilt.step(sample(0.01 * k, rotation_x(1.0), said, g=19.6))
        assert (orientation is None) == (k == 20)
    assert off_level(orientation, R_WB) < 1e-6
