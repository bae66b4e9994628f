"""The stair and the chair as MuJoCo reads them (MJCF): ``mechanics.bodies``, written down.

Belts are boxes and cylinders with native surface motion (``surfacevel``; Pecka et al., IROS 2017, gave Gazebo the same):
``v + ω × (x - p)`` in the geom's frame, projected on each contact's tangent plane. Box ends hide in the pulleys, whose
faces move. A step is a box and a capsule for its rounded nosing, which stands its radius in front of the riser.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from treadline.devices.drives import ARM_FRICTION_N_M_S_RAD, ARM_LAG_S, ARM_STIFFNESS_N_M_RAD
from treadline.mechanics.bodies import Body, Hinge, Shape, Solid, Standing, Vehicle, solids, vehicle
from treadline.mechanics.chair import Arm, ChairDescription, Point
from treadline.mechanics.staircase import Staircase
from treadline.scenario import Chair

TIMESTEP_S = 0.002
SEAT_STIFFNESS_RAD_S = 60.0
"""Natural frequency of the seat on its actuator: stiff against the 2 Hz at which a person moves."""

ARM_ROTOR_KG_M2 = 0.3
"""The motor's inertia seen through its gear."""

HEADER = """\
<mujoco model="treadline">
  <compiler angle="radian" autolimits="true"/>
  <option timestep="{timestep}" integrator="implicitfast" solver="Newton" cone="elliptic" jacobian="dense" impratio="10"
          iterations="50" tolerance="1e-6">
    <flag multiccd="disable" island="disable"/>
  </option>
  <default>
    <geom solref="0.01 1" solimp="0.95 0.99 0.001" condim="3"/>
    <default class="stair"><geom contype="0" conaffinity="1" friction="1 0 0"/></default>
    <default class="belt"><geom contype="1" conaffinity="0" priority="1" friction="{friction} 0 0" mass="0"/></default>
  </default>
"""
# jacobian="dense": MuJoCo 4.0.0's sparse Cholesky is wrong (mended in 4.0.1), and the problem is small.


DRAWN = '    <default class="drawn"><geom contype="0" conaffinity="0" mass="0" group="1" rgba="0.4 0.5 0.6 0.4"/></default>\n'


def seat_stiffness(seat: Body) -> tuple[float, float]:
    """Return stiffness [N·m/rad] and damping [N·m·s/rad] of the seat on its actuator, critically damped."""
    x, _, z = seat.com_m
    inertia = seat.inertia[1] + seat.mass_kg * (x * x + z * z)
    return inertia * SEAT_STIFFNESS_RAD_S**2, 2.0 * inertia * SEAT_STIFFNESS_RAD_S


def scene_xml(staircase: Staircase, chair: ChairDescription, loading: Chair) -> str:
    """Return the whole scene as MJCF, the chair at the world's origin."""
    return _scene(solids(staircase), staircase.friction[0], vehicle(chair, loading), chair.arm)


def model_xml(
    staircase: Staircase | None, chair: ChairDescription, loading: Chair, *, friction: float, start: Standing | None = None
) -> str:
    """Return a scene to hand over: hull and payload are drawn too, the chair stands where it starts.

    Args:
        staircase: None leaves the chair alone.
        friction: Along the belt.
    """
    return _scene(
        () if staircase is None else solids(staircase), friction, vehicle(chair, loading), chair.arm, start=start, drawn=True
    )


def _scene(
    stair: Sequence[Solid], friction: float, chair: Vehicle, arm: Arm | None, *, start: Standing | None = None, drawn: bool = False
) -> str:
    stiffness, damping = seat_stiffness(chair.seat)
    header = HEADER.format(timestep=TIMESTEP_S, friction=friction)
    world = "\n".join([*(line for solid in stair for line in _solid(solid)), _tree(chair, start, drawn=drawn)])
    return (
        (header.replace("  </default>\n", DRAWN + "  </default>\n") if drawn else header)
        + f"  <worldbody>\n{world}\n  </worldbody>\n"
        + "  <actuator>\n"
        + f'    <position name="seat" joint="seat" kp="{stiffness!r}" kv="{damping!r}"/>\n'
        + ("" if arm is None else _arm_servo(arm))
        + "  </actuator>\n</mujoco>\n"
    )


def _solid(solid: Solid) -> list[str]:
    box = solid.box
    place = f'pos="{_row(box.centre_W)}" size="{_row(box.half_m)}" euler="0 0 {float(box.yaw_rad)!r}"'
    lines = [f'    <geom class="stair" type="box" {place}/>']
    if solid.nosing is not None:
        ends = f"{_row(solid.nosing.left_W)} {_row(solid.nosing.right_W)}"
        lines.append(f'    <geom class="stair" type="capsule" size="{solid.nosing.radius_m!r}" fromto="{ends}"/>')
    return lines


def _tree(chair: Vehicle, start: Standing | None, *, drawn: bool) -> str:
    chassis = chair.chassis
    pose = "" if start is None else f' pos="{_row(start.p_WB)}" xyaxes="{_row(start.R_WB[:, 0])} {_row(start.R_WB[:, 1])}"'
    lines = [
        f'    <body name="{chassis.name}"{pose}>',
        "      <freejoint/>",
        *(f"      {line}" for line in _contents(chassis, drawn=drawn)),
    ]
    for body, hinge in chair.turning:
        lines += [
            f'      <body name="{body.name}" pos="{_row(body.origin_m)}">',
            f"        {_hinge(body.name, hinge)}",
            *(f"        {line}" for line in _contents(body, drawn=drawn)),
            "      </body>",
        ]
    return "\n".join([*lines, "    </body>"])


def _contents(body: Body, *, drawn: bool) -> list[str]:
    inertial = f'<inertial pos="{_row(body.com_m)}" mass="{body.mass_kg!r}" diaginertia="{_row(body.inertia)}"/>'
    return [inertial, *(_geom(shape) for shape in body.shapes if drawn or shape.belt is not None)]


def _hinge(name: str, hinge: Hinge) -> str:
    joint = f'<joint name="{name}" type="hinge" axis="{_row(hinge.axis)}"'
    if hinge.torque_n_m is None:
        return joint + "/>"  # the seat: its linkage limits it, in the plant
    low, high = hinge.range_rad
    limits = f'range="{low!r} {high!r}" limited="true"'
    return f'{joint} {limits} armature="{ARM_ROTOR_KG_M2}" damping="{ARM_FRICTION_N_M_S_RAD}"/>'


def _geom(shape: Shape) -> str:
    look = f'class="{"drawn" if shape.belt is None else "belt"}" name="{shape.name}" type="{shape.kind}"'
    if shape.kind == "cylinder":
        form, turn, moves = f'zaxis="0 1 0" size="{shape.half_m[0]!r} {shape.half_m[1]!r}"', "", "0 0 0 0 0 1e-9"
    else:
        turn = f' euler="0 {-shape.nose_up_rad!r} 0"' if shape.nose_up_rad else ""
        form, moves = f'size="{_row(shape.half_m)}"', "1e-9 0 0 0 0 0"
    # A surface that moves a little from the start: the model is compiled with moving surfaces.
    motion = "" if shape.belt is None else f' surfacevel="{moves}"'
    return f'<geom {look} {form} pos="{_row(shape.centre_m)}"{turn}{motion}/>'


def _arm_servo(arm: Arm) -> str:
    k, d = ARM_STIFFNESS_N_M_RAD, ARM_STIFFNESS_N_M_RAD * ARM_LAG_S
    return (
        f'    <general name="arm" joint="arm" biastype="affine" gainprm="{k!r}" biasprm="0 {-k!r} {-d!r}" '
        f'forcelimited="true" forcerange="{-arm.torque_n_m!r} {arm.torque_n_m!r}"/>\n'
    )


def _row(values: Point | Float[np.ndarray, " 3"]) -> str:
    return " ".join(repr(float(value)) for value in values)
