"""The stair and the chair as MuJoCo reads them (MJCF).

Belts are boxes and cylinders with native surface motion (``surfacevel``; Pecka et al., IROS 2017, gave Gazebo the same):
``v + ω × (x - p)`` in the geom's frame, projected on each contact's tangent plane. Box ends hide in the pulleys, whose
faces move. A step is a box and a capsule for its rounded nosing, which stands its radius in front of the riser.
"""

import math
from dataclasses import dataclass

import numpy as np

from treadline.mechanics.chair import Arm, ChairDescription
from treadline.mechanics.stability import payload_com, seat_mass_kg
from treadline.mechanics.staircase import Box, Staircase
from treadline.scenario import Chair

TIMESTEP_S = 0.002
FLAT_THICKNESS_M = 0.025
"""Half thickness of a belt's box: inside the pulleys' diameter."""
SEAT_STIFFNESS_RAD_S = 60.0
"""Natural frequency of the seat on its actuator: stiff against the 2 Hz at which a person moves."""

ARM_STIFFNESS_N_M_RAD = 6000.0
"""Of the arm's gear and servo: 200 N·m turn it by 2°."""
ARM_LAG_S = 0.1
"""Damping over stiffness of that servo: a chair that leans on its arm does not swing."""
ARM_ROTOR_KG_M2 = 0.3
"""The motor's inertia seen through its gear."""
ARM_FRICTION_N_M_S_RAD = 1.0

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


@dataclass(frozen=True, slots=True, kw_only=True)
class Payload:
    """What sits on the seat, as the simulator knows it."""

    mass_kg: float
    com_m: tuple[float, float, float]
    """Relative to the hinge."""
    inertia: tuple[float, float, float]


def payload_of(chair: ChairDescription, loading: Chair) -> Payload:
    """Return the mass on the seat: a uniform box for a person, moved by the scenario's offset."""
    mass = seat_mass_kg(loading)
    return Payload(mass_kg=mass, com_m=payload_com(chair, loading), inertia=_box_inertia(mass, chair.seat.payload_size_m))


def seat_stiffness(payload: Payload) -> tuple[float, float]:
    """Return stiffness [N·m/rad] and damping [N·m·s/rad] of the seat on its actuator, critically damped."""
    x, _, z = payload.com_m
    inertia = payload.inertia[1] + payload.mass_kg * (x * x + z * z)
    return inertia * SEAT_STIFFNESS_RAD_S**2, 2.0 * inertia * SEAT_STIFFNESS_RAD_S


def scene_xml(staircase: Staircase, chair: ChairDescription, loading: Chair) -> str:
    """Return the whole scene as MJCF."""
    payload = payload_of(chair, loading)
    stiffness, damping = seat_stiffness(payload)
    world = "\n".join(line for box in staircase.boxes() for line in _solid(box, staircase.nosing_radius_m))
    return (
        HEADER.format(timestep=TIMESTEP_S, friction=staircase.friction[0])
        + f"  <worldbody>\n{world}\n{_chair(chair, payload, loading.seat_shift_m)}\n  </worldbody>\n"
        + "  <actuator>\n"
        + f'    <position name="seat" joint="seat" kp="{stiffness!r}" kv="{damping!r}"/>\n'
        + ("" if chair.arm is None else _arm_servo(chair.arm))
        + "  </actuator>\n</mujoco>\n"
    )


def _solid(box: Box, radius: float) -> list[str]:
    if box.kind not in ("step", "landing"):
        return [_box(box.centre_W, box.half_m, box.yaw_rad)]
    (cx, cy, cz), (hx, hy, hz), yaw = box.centre_W, box.half_m, box.yaw_rad
    c, s = math.cos(yaw), math.sin(yaw)

    def at(forward: float, up: float) -> tuple[float, float, float]:
        return cx + c * forward, cy + s * forward, cz + up

    r = radius
    start, end = at(-hx + r, hz - r), (s * hy, -c * hy)
    left = (start[0] - end[0], start[1] - end[1], start[2])
    right = (start[0] + end[0], start[1] + end[1], start[2])
    fromto = " ".join(repr(value) for value in (*left, *right))
    return [
        _box(at(0.5 * r, 0.0), (hx - 0.5 * r, hy, hz), yaw),
        f'    <geom class="stair" type="capsule" size="{r!r}" fromto="{fromto}"/>',
    ]


def _box(centre: tuple[float, float, float], half: tuple[float, float, float], yaw_rad: float) -> str:
    return f'    <geom class="stair" type="box" pos="{_row(centre)}" size="{_row(half)}" euler="0 0 {float(yaw_rad)!r}"/>'


def _chair(chair: ChairDescription, payload: Payload, seat_shift_m: float) -> str:
    masses, seat = chair.masses, chair.seat
    inertia = _box_inertia(masses.chassis_kg, masses.chassis_size_m)
    hinge = (seat.hinge_m[0] + seat_shift_m, seat.hinge_m[1], seat.hinge_m[2])
    lines = [
        '    <body name="chair">',
        "      <freejoint/>",
        f'      <inertial pos="{_row(masses.chassis_com_m)}" mass="{masses.chassis_kg}" diaginertia="{_row(inertia)}"/>',
        *(line for side, y_m in _sides(chair) for line in _belt(chair, side, y_m)),
        f'      <body name="seat" pos="{_row(hinge)}">',
        '        <joint name="seat" type="hinge" axis="0 1 0"/>',
        f'        <inertial pos="{_row(payload.com_m)}" mass="{payload.mass_kg!r}" diaginertia="{_row(payload.inertia)}"/>',
        "      </body>",
        *([] if chair.arm is None else _arm(chair, chair.arm)),
        "    </body>",
    ]
    return "\n".join(lines)


def _sides(chair: ChairDescription) -> tuple[tuple[str, float], ...]:
    return ("left", 0.5 * chair.tracks.gauge_m), ("right", -0.5 * chair.tracks.gauge_m)


def _arm(chair: ChairDescription, arm: Arm) -> list[str]:
    """Return the approach section of both belts as one body that turns about the front pulleys' axis."""
    tracks = chair.tracks
    low, high = (math.radians(angle) for angle in arm.range_deg)
    across = arm.mass_kg * tracks.gauge_m**2 / 4.0  # half the mass on either side
    along = arm.mass_kg * tracks.approach_m**2 / 12.0
    return [
        f'      <body name="arm" pos="{0.5 * tracks.flat_run_m!r} 0 {tracks.pulley_radius_m}">',
        f'        <joint name="arm" type="hinge" axis="0 -1 0" range="{low!r} {high!r}" limited="true" '
        f'armature="{ARM_ROTOR_KG_M2}" damping="{ARM_FRICTION_N_M_S_RAD}"/>',
        f'        <inertial pos="{0.5 * tracks.approach_m!r} 0 0" mass="{arm.mass_kg!r}" '
        f'diaginertia="{across!r} {along!r} {across + along!r}"/>',
        *(line for side, y_m in _sides(chair) for line in _section(chair, side, y_m)),
        "      </body>",
    ]


def _section(chair: ChairDescription, side: str, y_m: float) -> list[str]:
    tracks = chair.tracks
    r, half_width, length = tracks.pulley_radius_m, 0.5 * tracks.belt_width_m, tracks.approach_m
    return [
        f'        <geom class="belt" name="{side}_nose" type="cylinder" zaxis="0 1 0" size="{r} {half_width}" '
        f'pos="{length!r} {y_m!r} 0" surfacevel="0 0 0 0 0 1e-9"/>',
        f'        <geom class="belt" name="{side}_approach" type="box" size="{0.5 * length!r} {half_width} {FLAT_THICKNESS_M}" '
        f'pos="{0.5 * length!r} {y_m!r} {FLAT_THICKNESS_M - r!r}" surfacevel="1e-9 0 0 0 0 0"/>',
    ]


def _arm_servo(arm: Arm) -> str:
    k, d = ARM_STIFFNESS_N_M_RAD, ARM_STIFFNESS_N_M_RAD * ARM_LAG_S
    return (
        f'    <general name="arm" joint="arm" biastype="affine" gainprm="{k!r}" biasprm="0 {-k!r} {-d!r}" '
        f'forcelimited="true" forcerange="{-arm.torque_n_m!r} {arm.torque_n_m!r}"/>\n'
    )


def _belt(chair: ChairDescription, side: str, y_m: float) -> list[str]:
    tracks = chair.tracks
    r, half_width = tracks.pulley_radius_m, 0.5 * tracks.belt_width_m
    half_run = 0.5 * tracks.flat_run_m
    nose_x, _, nose_z = chair.nose_m
    angle = math.radians(tracks.approach_angle_deg)
    # The lower face of the approach lies one radius below the line between the pulley centres.
    down = np.array([math.sin(angle), -math.cos(angle)]) * (r - FLAT_THICKNESS_M)
    middle = np.array([0.5 * (half_run + nose_x), 0.5 * (r + nose_z)]) + down
    is_fixed = chair.arm is None
    pulleys = [
        f'      <geom class="belt" name="{side}_{name}" type="cylinder" zaxis="0 1 0" size="{r} {half_width}" '
        f'pos="{x!r} {y_m!r} {z!r}" surfacevel="0 0 0 0 0 1e-9"/>'
        for name, x, z in (("rear", -half_run, r), ("front", half_run, r), ("nose", nose_x, nose_z))[: 3 if is_fixed else 2]
    ]
    lines = [
        *pulleys,
        f'      <geom class="belt" name="{side}_flat" type="box" size="{half_run!r} {half_width} {FLAT_THICKNESS_M}" '
        f'pos="0 {y_m!r} {FLAT_THICKNESS_M}" surfacevel="1e-9 0 0 0 0 0"/>',
        f'      <geom class="belt" name="{side}_approach" type="box" '
        f'size="{0.5 * tracks.approach_m!r} {half_width} {FLAT_THICKNESS_M}" '
        f'pos="{float(middle[0])!r} {y_m!r} {float(middle[1])!r}" euler="0 {-angle!r} 0" surfacevel="1e-9 0 0 0 0 0"/>',
    ]
    return lines if is_fixed else lines[:-1]


def _box_inertia(mass_kg: float, size_m: tuple[float, float, float]) -> tuple[float, float, float]:
    a, b, c = (edge * edge for edge in size_m)
    return mass_kg * (b + c) / 12.0, mass_kg * (a + c) / 12.0, mass_kg * (a + b) / 12.0


def _row(values: tuple[float, float, float]) -> str:
    return " ".join(repr(float(value)) for value in values)
