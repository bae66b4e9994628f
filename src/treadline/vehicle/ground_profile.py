"""Ground along the middle of a straight drive, as a polyline in the vertical plane: ``Staircase -> Ground``."""

import math

import numpy as np

from treadline.vehicle.rest_poses import Ground
from treadline.vehicle.stair_solids import FLOOR_LENGTH_M
from treadline.vehicle.staircase import Relief, Staircase


def ground_profile(staircase: Staircase) -> Ground:
    """Return place, height and radius of the vertices of the ground at mid-width.

    Risers are upright, missing steps left out, sills and ramps included.

    Floor and uppermost landing reach as far behind their last sill as the simulated floor, whatever the landing's depth. The
    ground of a stair that turns ends on the landing or winder on which it turns first.
    """
    steps = staircase.alone(0).steps if staircase.winders is None else staircase.straight_parts[0]
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
    return np.array(vertices)


def _outline(staircase: Staircase, place: int | None, depth_m: float) -> Relief:
    """Return distances and heights of the vertices of floor (None) or a tread, the nearest to its flight or nosing first."""
    relief = staircase.reliefs.get(place, ((0.0, 0.0),))
    last_m, level_m = relief[-1]
    return (*relief, (min(depth_m, last_m + FLOOR_LENGTH_M), level_m))
