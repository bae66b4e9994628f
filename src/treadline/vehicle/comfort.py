"""Measures that the scores of a run share with its report: comfort, and the bounds of the steady part.

Comfort is judged by means over 50 ms of pitch rate and passenger acceleration. ISO 2631-1 weights vertical motion below 10 Hz.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from treadline.core.angles import DEG
from treadline.core.signals import TICK_S

COMFORT_TICKS = 5
"""Length of the averaging window [ticks]: 50 ms at 100 Hz."""
STEADY_FROM_S = 20.0
"""Start of the steady interval [s]: any turn from ±30° has ended before (Fig. 10)."""
SETTLED_RAD = 2.0 * DEG
"""Largest deviation from the final heading of a settled run [rad]."""


def lasting(values: Float[np.ndarray, " T"]) -> Float[np.ndarray, " t"]:
    """Return the running mean over 50 ms."""
    if len(values) < COMFORT_TICKS:
        return values
    return np.convolve(values, np.full(COMFORT_TICKS, 1.0 / COMFORT_TICKS), "valid")


def lasting_change(
    values: Float[np.ndarray, "... T"], dt_s: float | Float[np.ndarray, " t"] = TICK_S
) -> Float[np.ndarray, "... t"]:
    """Return the rate of change over 50 ms [1/s]: for velocities, the mean acceleration.

    Args:
        dt_s: Sampling interval; if variable, its mean over each window.
    """
    return np.asarray((values[..., COMFORT_TICKS:] - values[..., :-COMFORT_TICKS]) / (COMFORT_TICKS * dt_s))


@dataclass(frozen=True, slots=True, kw_only=True)
class Comfort:
    """Largest accelerations of a passenger, as means over 50 ms; horizontal axes rotate with the chair."""

    total_m_s2: float
    vertical_m_s2: float
    longitudinal_m_s2: float
    """Largest acceleration along the chair's forward axis [m/s²]."""
    lateral_m_s2: float
    """Largest acceleration across the chair's forward axis [m/s²]."""
    jerk_m_s3: float
    """Jerk, 99th percentile of means over 50 ms [m/s³], which excludes noise of single samples."""


def passenger_acceleration(
    place_W: Float[np.ndarray, "3 T"], yaw_rad: Float[np.ndarray, " T"], dt_s: Float[np.ndarray, " d"] | None = None
) -> Float[np.ndarray, "3 a"]:
    """Return a passenger's acceleration [m/s²], longitudinal, lateral and vertical, as means over 50 ms.

    Args:
        place_W: Passenger in W [m].
        yaw_rad: Yaw of the chair about the vertical.
        dt_s: Time between consecutive positions; 10 ms by default.
    """
    steps_s = np.full(len(yaw_rad) - 1, TICK_S) if dt_s is None else dt_s
    velocity = np.diff(place_W, axis=1) / steps_s
    # Between the middles of two steps lie half of each.
    times_s = np.cumsum(steps_s) - 0.5 * steps_s
    window_s = times_s[COMFORT_TICKS:] - times_s[:-COMFORT_TICKS]
    x, y, z = lasting_change(velocity, window_s / COMFORT_TICKS)
    # A window of six steps spans seven places; the yaw is that of the middle one.
    middle = yaw_rad[(COMFORT_TICKS + 1) // 2 :][: len(x)]
    c, s = np.cos(middle), np.sin(middle)
    return np.stack([c * x + s * y, c * y - s * x, z])


def comfort(place_W: Float[np.ndarray, "3 T"], yaw_rad: Float[np.ndarray, " T"]) -> Comfort:
    """Return a passenger's largest accelerations; zero for a run too short for a mean of the jerk."""
    if len(yaw_rad) < 2 * COMFORT_TICKS + 3:
        return Comfort(total_m_s2=0.0, vertical_m_s2=0.0, longitudinal_m_s2=0.0, lateral_m_s2=0.0, jerk_m_s3=0.0)
    acceleration = passenger_acceleration(place_W, yaw_rad)
    longitudinal, lateral, vertical = np.abs(acceleration).max(axis=1)
    jerk = np.linalg.norm(lasting_change(acceleration), axis=0)
    return Comfort(
        total_m_s2=float(np.linalg.norm(acceleration, axis=0).max()),
        vertical_m_s2=float(vertical),
        longitudinal_m_s2=float(longitudinal),
        lateral_m_s2=float(lateral),
        jerk_m_s3=float(np.percentile(jerk, 99.0)),
    )
