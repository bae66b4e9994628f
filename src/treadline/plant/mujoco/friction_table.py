"""Friction coefficients of the belts on each geom of the scene, as a table for the compiled loop.

``MjModel, Staircase -> friction table``. A step has separate values for its left and right half; floor, walls and obstacles are
uniform.
"""

import math

import mujoco
import numpy as np
from jaxtyping import Float

from treadline.plant.mujoco import step_kernels as kernels
from treadline.plant.mujoco.mjcf_scene import stair_names
from treadline.vehicle.stair_solids import Box, stair_solids
from treadline.vehicle.staircase import Staircase


def friction_table(model: mujoco.MjModel, staircase: Staircase) -> Float[np.ndarray, "g 8"]:
    """Return the belt friction of each geom; geoms outside the stair have its design friction."""
    table = np.zeros((model.ngeom, kernels.MU_COLUMNS))
    table[:, kernels.MU_LEFT : kernels.MIDDLE] = (*staircase.friction, *staircase.friction)
    for number, solid in enumerate(stair_solids(staircase)):
        row = _row(solid.box, staircase)
        box_name, bar_name = stair_names(number)
        table[model.geom(box_name).id] = row
        if solid.nosing is not None:
            table[model.geom(bar_name).id] = row
    return table


def _row(box: Box, staircase: Staircase) -> tuple[float, ...]:
    x, y, _ = box.centre_W
    leftward = (-math.sin(box.yaw_rad), math.cos(box.yaw_rad))
    if box.index >= 0:
        left, right = staircase.steps[box.index].friction
    else:
        left = right = staircase.floor_friction if box.kind == "floor" else staircase.friction
    return (*left, *right, x, y, *leftward)


def roughened(table: Float[np.ndarray, "g 8"], friction: float) -> Float[np.ndarray, "g 8"]:
    """Return the table with one uniform friction coefficient."""
    rough = table.copy()
    rough[:, kernels.MU_LEFT : kernels.MIDDLE] = friction
    return rough
