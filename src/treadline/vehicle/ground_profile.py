"""Ground along the middle of a straight drive, as a polyline in the vertical plane: ``Staircase -> GroundProfile``."""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from treadline.vehicle.stair_solids import FLOOR_LENGTH_M
from treadline.vehicle.staircase import Relief, Staircase


@dataclass(frozen=True, slots=True, kw_only=True)
class GroundProfile:
    """Polyline of the ground in W, from the floor before the first step to the uppermost landing.

    Distances never fall along the polyline; a riser is two vertices of the same distance.
    """

    x_m: Float[np.ndarray, " n"]
    """Distance of each vertex along the drive, 0 under the first nosing [m]."""
    z_m: Float[np.ndarray, " n"]
    """Height of each vertex above the floor [m]."""
    radius_m: Float[np.ndarray, " n"]
    """Radius with which the ground is rounded at a nosing [m]; 0 at other vertices."""

    @property
    def vertices(self) -> Float[np.ndarray, "n 3"]:
        """Place, height and radius of each vertex [m], for ``rest_poses``."""
        return np.stack([self.x_m, self.z_m, self.radius_m], axis=1)


def ground_profile(staircase: Staircase) -> GroundProfile:
    """Return the ground at mid-width, with upright risers, sills and ramps, and missing steps left out.

    Floor and uppermost landing reach as far behind their last sill as the simulated floor, whatever the landing's depth. The
    ground of a stair that turns ends on its first landing or winder.
    """
    steps = staircase.straight_parts[0] if staircase.turn_rad else staircase.steps
    there = [step for step in steps if not step.missing]
    ends_m = [*(step.x_m for step in there[1:]), math.inf]
    floor = _outline(staircase, None, math.inf)
    vertices = [(there[0].x_m - out_m, z_m, 0.0) for out_m, z_m in reversed(floor)]
    for step, end_m in zip(there, ends_m, strict=True):
        rising = math.tan(step.tread_slope_rad)
        outline = _outline(staircase, step.index, end_m - step.x_m)
        rounded = [step.nosing_radius_m, *(0.0 for _ in outline[1:])]
        places = [(step.x_m + out_m, step.z_m + z_m + out_m * rising) for out_m, z_m in outline]
        vertices += [(x_m, z_m, radius_m) for (x_m, z_m), radius_m in zip(places, rounded, strict=True)]
    x_m, z_m, radius_m = np.ascontiguousarray(np.array(vertices).T)
    return GroundProfile(x_m=x_m, z_m=z_m, radius_m=radius_m)


def _outline(staircase: Staircase, place: int | None, depth_m: float) -> Relief:
    """Return distances and heights of the vertices of floor (None) or a tread, the nearest to its flight or nosing first."""
    relief = staircase.reliefs.get(place, ((0.0, 0.0),))
    last_m, level_m = relief[-1]
    return (*relief, (min(depth_m, last_m + FLOOR_LENGTH_M), level_m))
