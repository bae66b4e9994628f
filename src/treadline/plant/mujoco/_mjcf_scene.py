"""Scene description for MuJoCo (MJCF): stair and chair of ``mechanics.bodies`` as XML.

Belts are boxes and cylinders with native surface motion (``surfacevel``; Pecka et al., IROS 2017, gave Gazebo the same):
``v + ω × (x - p)`` in the geom's frame, projected on each contact's tangent plane. Box ends hide in the pulleys, whose
faces move. A step is a box and a capsule for its rounded nosing, which stands its radius in front of the riser. Each half of a step
has its own friction; floor, walls and obstacles are uniform.

Floor and landings are ground for the road wheels. Flat runs and pulleys touch everything else: nosings, treads, risers and walls. A
landing is therefore two boxes: ground to a depth that no standing belt reaches, and a step below, whose riser stops the pulleys and
whose edges carry the flat runs of a chair that tips over them.
"""

import math
from collections.abc import Iterator
from dataclasses import replace
from functools import cache

import mujoco
import numpy as np
from jaxtyping import Float, Shaped
from jinja2 import Environment, PackageLoader, Template

from treadline.core.rotations import quaternion_of
from treadline.plant._actuators import FLIPPER_FRICTION_N_M_S_RAD, FLIPPER_LAG_S, FLIPPER_STIFFNESS_N_M_RAD
from treadline.plant.mujoco.contact._coulomb_kernels import FRICTION
from treadline.plant.mujoco.contact._parameters import DMAX, DMIN, NOMINAL, WIDTH_M, Physics
from treadline.scenario.chair import ChairDescription
from treadline.scenario.scenario import Chair
from treadline.vehicle.bodies import HULL_FRICTION, Body, inertia_of, vehicle
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


def model_xml(
    staircase: Staircase | None,
    chair: ChairDescription,
    loading: Chair,
    physics: Physics = NOMINAL,
    *,
    friction: tuple[float, float],
    start: Standing | None = None,
    paired: bool = True,
) -> str:
    """Return a scene as MJCF.

    MuJoCo has two coefficients for a pair of geoms alone, across and along its contact frame, whose first tangent is the world's y.

    Args:
        staircase: None leaves the chair alone.
        friction: Coefficients along and across the belts.
        start: Where the chair stands; None: at the world's origin.
        paired: Whether each pair of geoms states both coefficients, as an export does; the plant sets them at each contact.
    """
    stair = () if staircase is None else stair_solids(staircase)
    parts = vehicle(chair, loading)
    boxes = [placed for number, solid in enumerate(stair) for placed in _boxes(number, solid)]
    nosings = [(f"nosing_{number}", solid.nosing) for number, solid in enumerate(stair) if solid.nosing is not None]
    touched = [(name, kind) for name, kind, _ in boxes] + [(name, "stair") for name, _ in nosings]
    belts = [shape for body in parts.bodies for shape in body.shapes + body.wheels if shape.belt is not None]
    return _template().render(
        boxes=boxes,
        nosings=nosings,
        pairs=[(name, belt) for name, kind in touched for belt in belts if belt.meets in (kind, "both")] if paired else (),
        friction=friction,
        chair=parts,
        physics=physics,
        start=start,
        seat_servo=None if parts.seat.hinge is None else seat_stiffness(parts.seat),
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
    return engine.get_template(
        "scene.mjcf.j2",
        globals={"row": _row, "principal": _principal, "quaternion_of": quaternion_of, "solimp": _solimp, **constants},
    )


def _row(*values: float | tuple[float, ...] | Float[np.ndarray, " n"]) -> str:
    """Return numbers separated by blanks, with all digits."""
    return " ".join(repr(float(value)) for value in np.hstack(values))


def _principal(body: Body) -> tuple[Float[np.ndarray, " 3"], Float[np.ndarray, " 4"]]:
    """Return the principal moments of a body, and their axes as a quaternion.

    MuJoCo refuses a moment that rounding makes larger than the two others together, as it does of a thin rod.
    """
    moments, axes = np.linalg.eigh(inertia_of(body))
    moments[2] = min(moments[2], moments[0] + moments[1])
    axes[:, 2] = np.cross(axes[:, 0], axes[:, 1])
    return moments, quaternion_of(axes)


def _solimp(stiffness: float = 1.0) -> str:
    """Return MuJoCo's impedances of a contact with a relative stiffness: regularisation R is proportional to (1 - d)/d."""
    return _row(*(stiffness * d / (1.0 - d + stiffness * d) for d in (DMIN, DMAX)), WIDTH_M)


def _boxes(number: int, solid: Solid) -> Iterator[tuple[str, str, Box]]:
    """Yield name and contact class of the boxes of a staircase's solid."""
    box = solid.box
    if box.kind not in ("landing", "sill"):
        kind = "ground" if box.kind == "floor" else "stair"
        yield f"{kind}_{number}", kind, box
        return
    (x, y, z), thin_m = box.half_m, 0.5 * WIDTH_M
    for kind, half_m, shift_m in (("ground", thin_m, z - thin_m), ("stair", z - thin_m, -thin_m)):
        cx, cy, cz = (np.array(box.centre_W) + shift_m * box.R_WK[:, 2]).tolist()
        yield f"{kind}_{number}", kind, replace(box, centre_W=(cx, cy, cz), half_m=(x, y, half_m))


def friction_table(model: mujoco.MjModel, staircase: Staircase) -> Shaped[np.ndarray, " g"]:
    """Return the belt friction of each geom; geoms outside the stair have its design friction."""
    table = np.zeros(model.ngeom, FRICTION)
    table["left"] = table["right"] = staircase.friction
    for number, solid in enumerate(stair_solids(staircase)):
        names = [name for name, _, _ in _boxes(number, solid)] + [f"nosing_{number}"] * (solid.nosing is not None)
        box = solid.box
        if box.index >= 0:
            left, right = staircase.steps[box.index].friction
        else:
            left = right = staircase.floor_friction if box.kind in ("floor", "sill") else staircase.friction
        leftward = (-math.sin(box.yaw_rad), math.cos(box.yaw_rad))
        for name in names:
            table[model.geom(name).id] = (left, right, box.centre_W[:2], leftward)
    return table


def roughened(table: Shaped[np.ndarray, " g"], friction: float) -> Shaped[np.ndarray, " g"]:
    """Return the table with one uniform friction coefficient."""
    rough = table.copy()
    rough["left"] = rough["right"] = friction
    return rough
