"""Angles: the only conversion between degrees and radians, and the tilt of an attitude. Plain numbers, no arrays."""

import math
from collections.abc import Sequence
from typing import Final

DEG: Final = math.pi / 180.0
"""Radians per degree: ``30 * DEG`` is 30° in radians, ``x / DEG`` is x in degrees."""


def degrees_or_none(angle_rad: float | None) -> float | None:
    """Return an angle in degrees, or None for an unknown one."""
    return None if angle_rad is None else angle_rad / DEG


def wrap(angle_rad: float) -> float:
    """Return the angle wrapped to [-π, π); rounding can give π."""
    return (angle_rad + math.pi) % (2.0 * math.pi) - math.pi


def to_side(angle_rad: float, sigma_rad: float | None = None, *, unit: str = "°") -> str:
    """Return an angle with the side it turns to: ``12° to the left``, or ``12.3 ± 0.5° to the left`` with its 95 % interval."""
    size_deg = abs(angle_rad) / DEG
    size = f"{size_deg:.0f}" if sigma_rad is None else f"{size_deg:.1f} ± {1.96 * sigma_rad / DEG:.1f}"
    return f"{size}{unit} to the {'left' if angle_rad > 0.0 else 'right'}"


def tilt_of(quaternion: Sequence[float]) -> tuple[float, float]:
    """Return pitch, front up positive, and roll, left side up positive, of a unit quaternion (w, x, y, z)."""
    w, x, y, z = quaternion
    pitch, roll = 2.0 * (x * z - w * y), 2.0 * (y * z + w * x)
    return math.asin(min(max(pitch, -1.0), 1.0)), math.asin(min(max(roll, -1.0), 1.0))


def radians_hint(name: str, angle_deg: float) -> str | None:
    """Return a question where an angle given in degrees may be one in radians: neither zero nor above a right angle in radians.

    Such an angle is below 1.6°, less than what a start heading or a mount pitch is given for.
    """
    if not 0.0 < abs(angle_deg) <= 0.5 * math.pi:
        return None
    return f"{name} is {angle_deg:g}°; did you mean {angle_deg / DEG:.1f}, for {angle_deg:g} rad?"
