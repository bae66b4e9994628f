"""Scene description for MuJoCo (MJCF): stair and chair of ``mechanics.bodies`` as XML.

Belts are boxes and cylinders with native surface motion (``surfacevel``; Pecka et al., IROS 2017, gave Gazebo the same):
``v + ω × (x - p)`` in the geom's frame, projected on each contact's tangent plane. Box ends hide in the pulleys, whose
faces move. A step is a box and a capsule for its rounded nosing, which stands its radius in front of the riser. Each half of a step
has its own friction; floor, walls and obstacles are uniform.
"""

import math
from collections.abc import Sequence
from functools import cache

import mujoco
import numpy as np
from jaxtyping import Float
from jinja2 import Environment, PackageLoader, Template

from treadline.core.rotations import quaternion_of
from treadline.plant._actuators import FLIPPER_FRICTION_N_M_S_RAD, FLIPPER_LAG_S, FLIPPER_STIFFNESS_N_M_RAD
from treadline.plant.mujoco.contact import _coulomb_kernels as coulomb
from treadline.plant.mujoco.contact._parameters import NOMINAL, Physics
from treadline.scenario.chair import ChairDescription, Flipper
from treadline.scenario.scenario import Chair
from treadline.vehicle.bodies import HULL_FRICTION, Body, Vehicle, vehicle
from treadline.vehicle.stair_solids import Box, Solid, stair_solids
from treadline.vehicle.staircase import Staircase
from treadline.vehicle.start_pose import Standing

SEAT_STIFFNESS_RAD_S = 60.0
"""Natural frequency of the seat on its actuator: stiff against the 2 Hz at which a person moves."""

FLIPPER_ROTOR_KG_M2 = 0.3
"""Inertia of the flipper's motor at the flipper's axis."""


def seat_stiffness(seat: Body) -> tuple[float, float]:
    """Return stiffness [N·m/rad] and damping [N·m·s/rad] of the seat on its actuator, critically damped."""
    x, _, z = seat.com_m
    inertia = seat.inertia[1] + seat.mass_kg * (x * x + z * z)
    return inertia * SEAT_STIFFNESS_RAD_S**2, 2.0 * inertia * SEAT_STIFFNESS_RAD_S


def scene_xml(staircase: Staircase, chair: ChairDescription, loading: Chair, physics: Physics = NOMINAL) -> str:
    """Return the whole scene as MJCF, the chair at the world's origin."""
    return _scene(stair_solids(staircase), staircase.friction[0], vehicle(chair, loading), chair.flipper, physics)


def model_xml(
    staircase: Staircase | None, chair: ChairDescription, loading: Chair, *, friction: float, start: Standing | None = None
) -> str:
    """Return a scene for export: the chair stands where the scenario starts.

    Args:
        staircase: None leaves the chair alone.
        friction: Along the belt.
    """
    return _scene(
        () if staircase is None else stair_solids(staircase), friction, vehicle(chair, loading), chair.flipper, NOMINAL, start=start
    )


def _scene(
    stair: Sequence[Solid],
    friction: float,
    chair: Vehicle,
    flipper: Flipper | None,
    physics: Physics,
    *,
    start: Standing | None = None,
) -> str:
    return _template().render(
        stair=[(solid, *stair_names(number)) for number, solid in enumerate(stair)],
        friction=friction,
        chair=chair,
        flipper=flipper,
        physics=physics,
        start=start,
        seat_servo=None if chair.seat.hinge is None else seat_stiffness(chair.seat),
    )


@cache
def _template() -> Template:
    loader = PackageLoader("treadline", "plant/mujoco")
    engine = Environment(loader=loader, autoescape=True, trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True)
    constants = {
        "hull_friction": HULL_FRICTION,
        "rotor_kg_m2": FLIPPER_ROTOR_KG_M2,
        "friction_n_m_s_rad": FLIPPER_FRICTION_N_M_S_RAD,
        "stiffness": FLIPPER_STIFFNESS_N_M_RAD,
        "lag_s": FLIPPER_LAG_S,
    }
    return engine.get_template("scene.mjcf.j2", globals={"row": _row, "quaternion_of": quaternion_of, **constants})


def _row(*values: float | tuple[float, ...] | Float[np.ndarray, " n"]) -> str:
    """Return numbers separated by blanks, with all digits."""
    return " ".join(repr(float(value)) for value in np.hstack(values))


def stair_names(number: int) -> tuple[str, str]:
    """Return the names of the two geoms of a staircase's solid: its box, and the bar of its rounded nosing."""
    return f"stair_{number}", f"nosing_{number}"


def friction_table(model: mujoco.MjModel, staircase: Staircase) -> Float[np.ndarray, "g 8"]:
    """Return the belt friction of each geom; geoms outside the stair have its design friction."""
    table = np.zeros((model.ngeom, coulomb.MU_COLUMNS))
    table[:, coulomb.MU_LEFT : coulomb.MIDDLE] = (*staircase.friction, *staircase.friction)
    for number, solid in enumerate(stair_solids(staircase)):
        row = _friction_row(solid.box, staircase)
        box_name, bar_name = stair_names(number)
        table[model.geom(box_name).id] = row
        if solid.nosing is not None:
            table[model.geom(bar_name).id] = row
    return table


def _friction_row(box: Box, staircase: Staircase) -> tuple[float, ...]:
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
    rough[:, coulomb.MU_LEFT : coulomb.MIDDLE] = friction
    return rough
