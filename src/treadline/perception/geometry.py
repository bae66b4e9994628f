"""Axes of the stair from the edge direction, gravity and treads of one frame."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from treadline.perception.detection import StairShape
from treadline.perception.edge_fit import gravity_variance
from treadline.perception.random_effects import pooled_mean
from treadline.perception.steps import Axes
from treadline.perception.surfaces import Surface
from treadline.perception.vectors import cross
from treadline.signals import StairAxes


def first_crowd(places: Float[np.ndarray, " k"], within: float, least: int) -> list[float]:
    """Return the nearest cluster of at least ``least`` places, in order, and its start; an empty list without one."""
    places = np.sort(places)
    together = np.searchsorted(places, places + within) - np.arange(places.size)
    first = np.flatnonzero(together >= least)
    return places[first[0] : first[0] + together[first[0]]].tolist() if first.size else []


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Levelled:
    """Axes of the stair and the uncertainty of the vertical."""

    axes: Axes
    down_sigma_rad: float
    """Standard deviation of the vertical [rad]."""


def viewing_direction(R_BC: Float[np.ndarray, "3 3"]) -> float:
    """Return 1 for a front camera, and -1 for a camera looking back over the chair.

    For a camera looking straight down, the upper edge of its image gives the direction.
    """
    look, image_up = R_BC[0, 2], -R_BC[0, 1]
    return 1.0 if look + image_up > 0.0 else -1.0


def axes_of(
    edge: Float[np.ndarray, " 3"],
    down: Float[np.ndarray, " 3"],
    down_sigma_rad: float,
    treads: Sequence[Surface],
    adjoining_rad: Sequence[float],
) -> Levelled:
    """Return the axes of the stair, with the vertical as weighted mean of treads and gravity.

    Args:
        edge: Unit vector along the edges, pointing right in the camera's view.
        down: Gravity direction from the IMU or from the treads.
        treads: Surfaces assumed to be horizontal.
        adjoining_rad: Standard deviation of the tilt of each by pixels of adjacent risers.
    """
    d = down - float(down @ edge) * edge
    d /= np.linalg.norm(d)
    ahead = cross(edge, d)
    tilts, variances = [0.0], [down_sigma_rad**2]
    for tread, by_risers_rad in zip(treads, adjoining_rad, strict=True):
        n = tread.unit if float(tread.unit @ d) > 0.0 else -tread.unit
        tilts.append(float(np.arctan2(n @ ahead, n @ d)))
        variances.append(float(ahead @ tread.unit_covariance @ ahead) + by_risers_rad**2)
    variances[0] = gravity_variance(np.array(tilts[1:]), down_sigma_rad)
    regular = np.zeros(len(tilts), dtype=bool)
    regular[0] = True
    tilt = pooled_mean(np.array(tilts), np.array(variances), regular)
    d = np.cos(tilt.mean) * d + np.sin(tilt.mean) * ahead
    return Levelled(axes=Axes(ahead=cross(edge, d), up=-d, right=edge), down_sigma_rad=tilt.sigma)


def directions_of(
    t_s: float,
    levelled: Levelled,
    shape: StairShape,
    edge: Float[np.ndarray, " 3"],
    edge_sigma_rad: float,
) -> StairAxes:
    """Return the stair's directions in C, for the calibration of the camera mount.

    Args:
        edge: Unit vector along the edges, to the chair's right.
    """
    axes = levelled.axes
    return StairAxes(
        t_s=t_s,
        edge_C=edge,
        down_C=-axes.up,
        normal_C=normal_of(axes, shape),
        edge_sigma_rad=edge_sigma_rad,
        down_sigma_rad=levelled.down_sigma_rad,
        normal_sigma_rad=shape.plane_sigma_rad,
    )


def normal_of(axes: Axes, shape: StairShape) -> Float[np.ndarray, " 3"]:
    """Return the unit normal of the nosing plane, pointing away from the stair."""
    tilt = shape.slope_rad if shape.direction == "up" else -shape.slope_rad
    return np.asarray(np.cos(tilt) * axes.up - np.sin(tilt) * axes.ahead)
