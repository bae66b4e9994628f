"""Ground along the middle of a straight drive, as a polyline in the vertical plane: ``Staircase -> GroundProfile``."""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from treadline.vehicle.stair_solids import FLOOR_LENGTH_M
from treadline.vehicle.staircase import Staircase


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
    """Return the ground at mid-width, with upright risers, and missing steps left out.

    The floor before the stair and the uppermost landing are as long as the simulated floor, whatever the landing's depth. The
    ground of a stair that turns ends on its first landing or winder.
    """
    steps = staircase.straight_parts[0] if staircase.turn_rad else staircase.steps
    there = [step for step in steps if not step.missing]
    ends_m = [*(step.x_m for step in there[1:]), there[-1].x_m + FLOOR_LENGTH_M]
    vertices = [(-FLOOR_LENGTH_M, 0.0, 0.0), (there[0].x_m, 0.0, 0.0)]
    for step, end_m in zip(there, ends_m, strict=True):
        back_m = step.z_m + (end_m - step.x_m) * math.tan(step.tread_slope_rad)
        vertices += [(step.x_m, step.z_m, step.nosing_radius_m), (end_m, back_m, 0.0)]
    x_m, z_m, radius_m = np.ascontiguousarray(np.array(vertices).T)
    return GroundProfile(x_m=x_m, z_m=z_m, radius_m=radius_m)
