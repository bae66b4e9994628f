"""Rest poses: where a tracked chair comes to rest on a ground profile, and how it falls when that pose vanishes.

``RestChair, ground, place, joint angles -> RestPose``. In the vertical plane through its middle a chair is a list of capsules (flat
run, fixed nose, flippers), the ground a polyline. A chair at rest touches the ground at two contacts, with its weight between them;
a place may have several such poses, so that the pose belongs to the state of a chair and is followed (``RestChair.moved``). The
seat is level within its range. What is lateral stays outside: ``tip_over_margin``, ``quasi_static``.
"""

import math
from dataclasses import dataclass
from functools import cache

import numpy as np
from jaxtyping import Float

from treadline.core.errors import MechanicsError
from treadline.scenario.chair import GRAVITY_M_S2, ChairDescription, Point, Seat
from treadline.vehicle.linkage import SeatLinkage
from treadline.vehicle.rest_pose_kernels import BLOCKED, JUMP_RAD, describe, follow, posture, settle
from treadline.vehicle.tracks import Section, sections

Ground = Float[np.ndarray, "v 3"]
"""Vertices of the ground: place along the drive [m], height [m], radius of a rounded nosing [m] (``GroundProfile.vertices``)."""
NOWHERE: Point = (0.0, 0.0, 0.0)
LONG_FLIGHT_M, PHASES = 3.0, 41
"""Half of a flight that is longer than any chair [m], and number of places over one of its steps."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RestPose:
    """Pose at rest of a chair at a place, with its joints at given angles."""

    x_m: float
    """Place of mid-track along the drive [m]."""
    angles_rad: tuple[float, ...]
    """Angle of each joint [rad]."""
    pitch_rad: float
    height_m: float
    """Height of mid-track, on the belts' lower line [m]."""
    com_m: tuple[float, float]
    """Centre of mass along the drive and its height [m]."""
    front_m: tuple[float, float]
    """Front contact along the drive and its height [m]."""
    rear_m: tuple[float, float]
    """Rear contact [m]."""
    front_share: float
    """Share of the weight at the front contact."""
    slopes: tuple[float, float]
    """Tangents of the ground's slope at the front and the rear contact, positive rising ahead."""
    front_margin_rad: float
    """Angle by which gravity may turn before the chair tips over its front; ground within 2° of turning counts as support [rad]."""
    rear_margin_rad: float
    """The same over its rear [rad]."""
    parts: tuple[int, int]
    """Parts of the chair at the front and the rear contact."""
    torques_n_m: tuple[float, ...]
    """Torque with which the ground turns the part of each motor away [N m]."""

    @property
    def pivot_m(self) -> tuple[float, float]:
        """Contact that bears the larger share of the weight [m]."""
        return self.front_m if self.front_share > 0.5 else self.rear_m

    @property
    def friction(self) -> float:
        """Friction needed to stand: slopes of the contacts, weighted by their shares of the weight."""
        return abs(self.front_share * self.slopes[0] + (1.0 - self.front_share) * self.slopes[1])


@dataclass(frozen=True, slots=True, kw_only=True)
class Fall:
    """Fall of a chair whose rest pose vanished, to the next one."""

    angle_rad: float
    drop_m: float
    """Height by which the centre of mass sinks [m]."""
    rate_rad_s: float
    """Pitch rate at its end by the energy of a point mass that turns about the contact [rad/s]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RestChair:
    """Chair in the vertical plane: capsules, masses, and the motors of its joints."""

    parts: Float[np.ndarray, "k 9"]
    """Capsules, by ``rest_pose_kernels.PART``."""
    masses: Float[np.ndarray, "m 7"]
    """Masses, by ``rest_pose_kernels.MASS``."""
    torques_n_m: Float[np.ndarray, " j"]
    """Torque of each motor [N m], that of the flipper first; several may turn with one joint."""

    @property
    def weight_n(self) -> float:
        """Weight of chair and load [N]."""
        return GRAVITY_M_S2 * float(self.masses[:, 0].sum())

    def at(self, ground: Ground, x_m: float, angles_rad: tuple[float, ...], pitch_rad: float) -> RestPose:
        """Return the rest pose to which a chair turns from a pitch.

        Raises:
            MechanicsError: If the chair cannot stand there: it turns over.
        """
        out = np.empty(15 + self.torques_n_m.size)
        if not describe(pitch_rad, x_m, np.array(angles_rad), self.parts, self.masses, ground, self.torques_n_m, out):
            raise MechanicsError(f"the chair cannot stand with its middle at {x_m:.2f} m: it would turn over")
        pitch, height, *places, share, rising, falling, ahead, behind, front, rear = out[:15].tolist()
        com_x, com_z, front_x, front_z, rear_x, rear_z = places
        return RestPose(
            x_m=x_m,
            angles_rad=angles_rad,
            pitch_rad=pitch,
            height_m=height,
            com_m=(com_x, com_z),
            front_m=(front_x, front_z),
            rear_m=(rear_x, rear_z),
            front_share=share,
            slopes=(rising, falling),
            front_margin_rad=ahead,
            rear_margin_rad=behind,
            parts=(int(front), int(rear)),
            torques_n_m=tuple(out[15:].tolist()),
        )

    def moved(self, ground: Ground, pose: RestPose, x_m: float, angles_rad: tuple[float, ...]) -> tuple[RestPose, Fall | None]:
        """Return the pose after a move along which the present one is followed, and the largest fall on the way.

        A wall ends the move before.

        Raises:
            MechanicsError: If the chair turns over.
        """
        before, after = np.array(pose.angles_rad), np.array(angles_rad)
        pitch, part, angle, drop_m, ends = follow(pose.pitch_rad, pose.x_m, before, x_m, after, self.parts, self.masses, ground)
        if ends == BLOCKED:
            x_m, angles_rad = pose.x_m + part * (x_m - pose.x_m), tuple((before + part * (after - before)).tolist())
        rests = self.at(ground, x_m, angles_rad, pitch)
        if abs(rests.pitch_rad - pitch) > JUMP_RAD:  # the pose vanished at the very end of the move
            angle = max(angle, abs(rests.pitch_rad - pitch))
            drop_m = max(drop_m, settle(pitch, x_m, *posture(np.array(angles_rad), self.parts, self.masses), ground)[2])
        if angle == 0.0:
            return rests, None
        return rests, fall_to(rests, angle, drop_m)

    def least_margins(self, rise_m: float, run_m: float, angles_rad: tuple[float, ...]) -> tuple[float, float]:
        """Return the least margins to the front and to the rear on a long flight, over one step of it [rad]; 0 if it does not rest.

        Args:
            rise_m: Rise of the steps; 0 is a level floor.
            run_m: Run of the steps.
            angles_rad: Angles of the joints.
        """
        count = math.ceil(LONG_FLIGHT_M / run_m)
        steps = np.arange(-count, count + 1.0).repeat(2)
        heights = (steps + np.tile([-1.0, 0.0], 2 * count + 1)) * rise_m
        ground = np.stack([steps * run_m, heights, np.zeros_like(steps)], axis=1)
        try:
            pose = self.at(ground, 0.0, angles_rad, math.atan2(rise_m, run_m))
            poses = [pose := self.moved(ground, pose, x_m, angles_rad)[0] for x_m in np.linspace(0.0, run_m, PHASES).tolist()]
        except MechanicsError:
            return 0.0, 0.0
        return min(one.front_margin_rad for one in poses), min(one.rear_margin_rad for one in poses)


def nosings_of(ground: Ground) -> Float[np.ndarray, "nosings 3"]:
    """Return the vertices of a ground that are nosings: those that are rounded."""
    return ground[ground[:, 2] > 0.0]


def fall_to(rests: RestPose, angle_rad: float, drop_m: float) -> Fall:
    """Return a fall that ends in a pose: a point mass that has sunk turns about the contact that bears it."""
    rate_rad_s = math.sqrt(2.0 * GRAVITY_M_S2 * drop_m) / math.dist(rests.com_m, rests.pivot_m)
    return Fall(angle_rad=angle_rad, drop_m=drop_m, rate_rad_s=rate_rad_s)


def rest_chair(
    chair: ChairDescription,
    payload_kg: float,
    *,
    offset_m: Point = NOWHERE,
    seat_shift_m: float = 0.0,
) -> RestChair:
    """Return a chair with its load as it rests on the ground.

    Args:
        payload_kg: Mass of the payload.
        offset_m: Payload's centre of mass off its nominal place, in B.
        seat_shift_m: Shift of the seat along the chair.
    """
    seat, known = chair.seat, sorted(sections(chair), key=lambda section: section.follows)
    torques: list[float] = []
    parts = []
    for section in known:
        parts.append((*section.start_m, section.length_m, *section.radii_m, *_turning(section, len(torques))))
        torques += [section.motor.torque_n_m] if section.follows and section.motor is not None else []
    chassis_x, _, chassis_z = chair.masses.chassis_com_m
    masses = [(chair.masses.chassis_kg, chassis_x, chassis_z, -1.0, 0.0, 0.0, 0.0)]
    masses += [
        (section.motor.mass_kg, section.com_m, 0.0, float(number), 0.0, 0.0, 0.0)
        for number, section in enumerate(known)
        if section.motor is not None
    ]
    (hinge_x, _, hinge_z), (out_x, _, out_z) = chair.payload_origin_m, chair.payload_com_m
    low_rad, high_rad = (0.0, 0.0) if seat is None else _range_of(seat)
    shift_m = 0.0 if seat is None else seat_shift_m
    place = (hinge_x + shift_m, hinge_z, out_x + offset_m[0], out_z + offset_m[2])
    masses.append((chair.empty_seat_kg + payload_kg, *place, low_rad, high_rad))
    return RestChair(parts=np.array(parts), masses=np.array(masses), torques_n_m=np.array(torques or [0.0]))


def _turning(section: Section, motor: int) -> tuple[float, float, float, float]:
    """Return direction, sign, joint and motor of a section, the last columns of its part."""
    if section.follows:
        return section.zero_rad, section.raises, 0.0, float(motor)
    return section.direction_rad(0.0), 0.0, -1.0, -1.0


@cache
def _range_of(seat: Seat) -> tuple[float, float]:
    """Return the range of a seat's angle [rad]."""
    return SeatLinkage(seat).angle_range
