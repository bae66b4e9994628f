"""Samples of an inertial sensor from the motion of the chair, compiled."""

import math
from typing import NamedTuple

import numpy as np

from treadline.core.fma import dot, fused
from treadline.core.kernel_cache import njit
from treadline.core.signals import TICK_S
from treadline.estimation.tilt import AT_REST
from treadline.plant.sensors._pose_kernels import product, quaternion, rotation
from treadline.scenario.chair import GRAVITY_M_S2

MEMORY = np.dtype([(name, float, 3) for name in ("bias", "last_rate", "angle", "quadrature")] + [("attitude", float, 4)])
"""Memory of an IMU: gyro bias, last gyro sample, vibration angles and their quadrature, attitude of the filter (w, x, y, z)."""
DRAWS = 15
"""Number of normal random numbers per sample."""


class ImuFigures(NamedTuple):
    """Error parameters of an IMU per tick."""

    bias_kept: float
    bias_added: float
    force_share: float
    """Weight of the accelerometer in the attitude filter; zero for an attitude without error."""
    gyro_noise: float
    force_noise: float
    shake_turn: tuple[float, float]
    """Rotation of the vibration's phasor, a complex number."""
    shake_push: float
    """Excitation of the vibration by moving belts."""


@njit(cache=True)
def imu_sample(draw, R_WB, rate, acceleration, moving, figures, scale, bias_left, force_bias, memory, sample):
    """Fill ``sample`` with an IMU's orientation (w, x, y, z), angular velocity and specific force; ``memory`` advances by a tick.

    Args:
        draw: Normal random numbers: gyro bias, gyro, vibration, accelerometer, and quadrature of the vibration.
        rate: True angular velocity in B; ``acceleration`` in W.
        moving: Whether moving belts excite the vibration.
        scale: Gyro scale of each axis.
        bias_left: Residual gyro bias after calibration.
        force_bias: Accelerometer bias.
    """
    measured, force = sample[4:7], sample[7:10]
    upward = np.array((acceleration[0], acceleration[1], acceleration[2] + GRAVITY_M_S2))
    turn, turn_aside = figures.shake_turn
    bias, angles, quadrature = memory["bias"], memory["angle"], memory["quadrature"]
    for i in range(3):
        bias[i] = figures.bias_kept * bias[i] + figures.bias_added * draw[i]
        # The angle is the real part of a phasor; the rate is its finite difference, so the integrated rate is the angle itself.
        angle, aside = angles[i], quadrature[i]
        angles[i] = fused(turn, angle, -(turn_aside * aside))
        quadrature[i] = fused(turn, aside, turn_aside * angle)
        if moving:
            angles[i] += figures.shake_push * draw[6 + i]
            quadrature[i] += figures.shake_push * draw[12 + i]
        noise = figures.gyro_noise * draw[3 + i] + (angles[i] - angle) / TICK_S
        measured[i] = scale[i] * rate[i] + bias_left[i] + bias[i] + noise
        force[i] = dot(R_WB[:, i], upward) + force_bias[i] + figures.force_noise * draw[9 + i]
    attitude = memory["attitude"]
    blend_attitude(attitude, memory["last_rate"], measured, force, figures.force_share)
    if figures.force_share == 0.0:
        exact = product(about_up(heading_of(attitude) - math.atan2(R_WB[1, 0], R_WB[0, 0])), R_WB)
        attitude[:] = quaternion(exact)
    sample[:4] = attitude


@njit(cache=True)
def blend_attitude(attitude, last_rate, rate, force, share):
    """Advance an attitude (w, x, y, z) by a tick: a complementary filter with the proportional gain of Mahony's filter.

    The mean of two gyro samples rotates the attitude; the accelerometer then corrects the tilt by ``share`` of the angle between
    measured specific force and vertical, if the force is within ``AT_REST`` of g.
    """
    half = 0.25 * TICK_S * (last_rate + rate)  # half of the angle: the mean rate times half a tick
    last_rate[:] = rate
    turned = compose(attitude, np.array((1.0, half[0], half[1], half[2])))
    length = math.sqrt(dot(force, force))
    if abs(length - GRAVITY_M_S2) < AT_REST * GRAVITY_M_S2:
        turned /= math.sqrt(dot(turned, turned))
        R = np.empty((3, 3))
        rotation(turned[0], turned[1], turned[2], turned[3], R)
        # The shortest rotation of the force to the vertical is about the axis force × up.
        x, y = dot(R[1], force) / length, -dot(R[0], force) / length
        turned = compose(np.array((1.0, 0.5 * share * x, 0.5 * share * y, 0.0)), turned)
    attitude[:] = turned / math.sqrt(dot(turned, turned))


@njit(cache=True)
def compose(p, q):
    """Return the product of two quaternions (w, x, y, z)."""
    return np.array(
        (
            p[0] * q[0] - p[1] * q[1] - p[2] * q[2] - p[3] * q[3],
            p[0] * q[1] + p[1] * q[0] + p[2] * q[3] - p[3] * q[2],
            p[0] * q[2] - p[1] * q[3] + p[2] * q[0] + p[3] * q[1],
            p[0] * q[3] + p[1] * q[2] - p[2] * q[1] + p[3] * q[0],
        )
    )


@njit(cache=True)
def heading_of(q):
    """Return the yaw of a quaternion (w, x, y, z): the direction of its x axis in the horizontal plane."""
    return math.atan2(2.0 * (q[1] * q[2] + q[0] * q[3]), 1.0 - 2.0 * (q[2] * q[2] + q[3] * q[3]))


@njit(cache=True)
def about_up(angle):
    """Return the rotation about the vertical."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array(((c, -s, 0.0), (s, c, 0.0), (0.0, 0.0, 1.0)))
