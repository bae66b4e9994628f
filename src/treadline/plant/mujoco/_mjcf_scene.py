"""Scene description for MuJoCo (MJCF): stair and chair of ``mechanics.bodies`` as XML.

Belts are boxes and cylinders with native surface motion (``surfacevel``; Pecka et al., IROS 2017, gave Gazebo the same):
``v + ω × (x - p)`` in the geom's frame, projected on each contact's tangent plane. Box ends hide in the pulleys, whose
faces move. A step is a box and a capsule for its rounded nosing, which stands its radius in front of the riser. Each half of a step
has its own friction; floor, walls and obstacles are uniform.
"""

import math
from collections.abc import Sequence

import mujoco
import numpy as np
from jaxtyping import Float

from treadline.core.rotations import quaternion_of
from treadline.plant._actuators import FLIPPER_FRICTION_N_M_S_RAD, FLIPPER_LAG_S, FLIPPER_STIFFNESS_N_M_RAD
from treadline.plant.mujoco.contact import _coulomb_kernels as coulomb
from treadline.plant.mujoco.contact._parameters import NOMINAL, Physics
from treadline.scenario.chair import ChairDescription, Flipper, Point
from treadline.scenario.scenario import Chair
from treadline.vehicle.bodies import HULL_FRICTION, Body, Hinge, Shape, Vehicle, vehicle
from treadline.vehicle.stair_solids import Box, Solid, stair_solids
from treadline.vehicle.staircase import Staircase
from treadline.vehicle.start_pose import Standing

SEAT_STIFFNESS_RAD_S = 60.0
"""Natural frequency of the seat on its actuator: stiff against the 2 Hz at which a person moves."""

FLIPPER_ROTOR_KG_M2 = 0.3
"""Inertia of the flipper's motor at the flipper's axis."""

HEADER = """\
<mujoco model="treadline">
  <compiler angle="radian" autolimits="true"/>
  <option timestep="{timestep}" integrator="implicitfast" solver="Newton" cone="elliptic" jacobian="dense" impratio="10"
          iterations="50" tolerance="1e-6">
    <flag multiccd="disable" island="disable"/>
  </option>
  <default>
    <geom solref="{time_constant} 1" solimp="0.95 0.99 0.001" condim="3"/>
    <default class="stair"><geom contype="0" conaffinity="1" friction="1 0 0"/></default>
    <default class="belt"><geom contype="1" conaffinity="0" priority="1" friction="{friction} 0 0" mass="0"/></default>
    <default class="body"><geom contype="1" conaffinity="0" priority="1" friction="{hull} 0 0" mass="0" group="1"
                           rgba="0.4 0.5 0.6 0.4"/></default>
  </default>
"""
# jacobian="dense": MuJoCo 4.0.0's sparse Cholesky is wrong (mended in 4.0.1), and the problem is small.


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
    header = HEADER.format(
        timestep=physics.timestep_s, time_constant=physics.contact_time_constant_s, friction=friction, hull=HULL_FRICTION
    )
    world = "\n".join([*(line for number, solid in enumerate(stair) for line in _solid(solid, number)), _tree(chair, start)])
    return (
        header
        + f"  <worldbody>\n{world}\n  </worldbody>\n"
        + "  <actuator>\n"
        + ("" if chair.seat.hinge is None else _seat_servo(chair.seat))
        + ("" if flipper is None else _flipper_servo(flipper))
        + "  </actuator>\n</mujoco>\n"
    )


def stair_names(number: int) -> tuple[str, str]:
    """Return the names of the two geoms of a staircase's solid: its box, and the bar of its rounded nosing."""
    return f"stair_{number}", f"nosing_{number}"


def _solid(solid: Solid, number: int) -> list[str]:
    box = solid.box
    box_name, bar_name = stair_names(number)
    turn = f'quat="{_row(quaternion_of(box.R_WK))}"' if box.pitch_rad else f'euler="0 0 {float(box.yaw_rad)!r}"'
    place = f'pos="{_row(box.centre_W)}" size="{_row(box.half_m)}" {turn}'
    lines = [f'    <geom class="stair" name="{box_name}" type="box" {place}/>']
    if solid.nosing is not None:
        ends = f"{_row(solid.nosing.left_W)} {_row(solid.nosing.right_W)}"
        lines.append(f'    <geom class="stair" name="{bar_name}" type="capsule" size="{solid.nosing.radius_m!r}" fromto="{ends}"/>')
    return lines


def _tree(chair: Vehicle, start: Standing | None) -> str:
    chassis = chair.chassis
    pose = "" if start is None else f' pos="{_row(start.p_WB)}" xyaxes="{_row(start.R_WB[:, 0])} {_row(start.R_WB[:, 1])}"'
    lines = [
        f'    <body name="{chassis.name}"{pose}>',
        "      <freejoint/>",
        *(f"      {line}" for line in _contents(chassis)),
    ]
    for body in chair.bodies[1:]:
        lines += [
            f'      <body name="{body.name}" pos="{_row(body.origin_m)}">',
            *([] if body.hinge is None else [f"        {_hinge(body.name, body.hinge)}"]),
            *(f"        {line}" for line in _contents(body)),
            "      </body>",
        ]
    return "\n".join([*lines, "    </body>"])


def _contents(body: Body) -> list[str]:
    inertial = f'<inertial pos="{_row(body.com_m)}" mass="{body.mass_kg!r}" diaginertia="{_row(body.inertia)}"/>'
    return [inertial, *(_geom(shape) for shape in body.shapes)]


def _hinge(name: str, hinge: Hinge) -> str:
    joint = f'<joint name="{name}" type="hinge" axis="{_row(hinge.axis)}"'
    if hinge.torque_n_m is None:
        return joint + "/>"  # the seat: its linkage limits it, in the plant
    low, high = hinge.range_rad
    limits = f'range="{low!r} {high!r}" limited="true"'
    return f'{joint} {limits} armature="{FLIPPER_ROTOR_KG_M2}" damping="{FLIPPER_FRICTION_N_M_S_RAD}"/>'


def _geom(shape: Shape) -> str:
    look = f'class="{"body" if shape.belt is None else "belt"}" name="{shape.name}" type="{shape.kind}"'
    if shape.kind == "cylinder":
        form, turn, moves = f'zaxis="0 1 0" size="{shape.half_m[0]!r} {shape.half_m[1]!r}"', "", "0 0 0 0 0 1e-9"
    else:
        turn = f' euler="0 {-shape.nose_up_rad!r} 0"' if shape.nose_up_rad else ""
        form, moves = f'size="{_row(shape.half_m)}"', "1e-9 0 0 0 0 0"
    # A surface that moves a little from the start: the model is compiled with moving surfaces.
    motion = "" if shape.belt is None else f' surfacevel="{moves}"'
    return f'<geom {look} {form} pos="{_row(shape.centre_m)}"{turn}{motion}/>'


def _seat_servo(seat: Body) -> str:
    stiffness, damping = seat_stiffness(seat)
    return f'    <position name="seat" joint="seat" kp="{stiffness!r}" kv="{damping!r}"/>\n'


def _flipper_servo(flipper: Flipper) -> str:
    k, d = FLIPPER_STIFFNESS_N_M_RAD, FLIPPER_STIFFNESS_N_M_RAD * FLIPPER_LAG_S
    return (
        f'    <general name="flipper" joint="flipper" biastype="affine" gainprm="{k!r}" biasprm="0 {-k!r} {-d!r}" '
        f'forcelimited="true" forcerange="{-flipper.torque_n_m!r} {flipper.torque_n_m!r}"/>\n'
    )


def _row(values: Point | Float[np.ndarray, " n"]) -> str:
    return " ".join(repr(float(value)) for value in values)


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
