"""Chair as rigid bodies, the common description for MJCF, URDF and SDF; centre of mass of chair and payload.

``ChairDescription, Chair -> Vehicle``. The vehicle is a tree: the chassis, whose frame is B, with the seat
and, if driven, the flipper. All joints are at zero: the seat parallel to the chassis, the flipper in line with the flat run.
"""

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from treadline.scenario.chair import ChairDescription, Flipper, Point, Seat, Tracks
from treadline.scenario.scenario import Belts, Chair
from treadline.vehicle.linkage import SeatLinkage
from treadline.vehicle.tracks import pulley_centres, road_wheels

FLAT_THICKNESS_M = 0.025
"""Half thickness of a belt's box [m], less than the pulleys' diameter."""
HULL_FRICTION = 0.4
"""Friction coefficient of hull and passenger against stair, walls and obstacles: 0.3 to 0.4 for steel on concrete (EN 12812:2004,
annex A)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Shape:
    """Box, or cylinder or capsule about y, in the frame of its body."""

    name: str
    kind: Literal["box", "cylinder", "capsule"]
    centre_m: Point
    half_m: Point
    """Half extents along the shape's own axes [m]."""
    nose_up_rad: float = 0.0
    belt: Literal["left", "right"] | None = None
    """Belt that moves this surface; None for hull and payload, whose surfaces are at rest."""
    meets: Literal["stair", "ground", "both"] = "both"
    """Surfaces that this shape touches: nosings, treads, risers and walls; level ground; or both."""
    stiffness: float = 1.0
    """Contact stiffness relative to that of other shapes."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Hinge:
    """Revolute joint between a body and its parent, about an axis through the body's origin."""

    axis: Point
    range_rad: tuple[float, float]
    max_rate_rad_s: float
    torque_n_m: float | None
    """Largest torque [N m]; None: unlimited."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Body:
    """Rigid body; the principal axes are those of its frame."""

    name: str
    parent: str | None
    origin_m: Point
    """Origin in the parent's frame [m]."""
    mass_kg: float
    com_m: Point
    inertia: Point
    """Principal moments of inertia about the centre of mass [kg·m²]."""
    hinge: Hinge | None = None
    shapes: tuple[Shape, ...]
    wheels: tuple[Shape, ...] = ()
    """Contact helpers: the wheels on which the belts stand on level ground. They lie within the belts and are not drawn."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Vehicle:
    """Chair with its payload: the chassis and the bodies hinged to it."""

    name: str
    chassis: Body
    seat: Body
    """Seat with the payload, hinged to the chassis; or the payload alone, fixed to it."""
    flipper: Body | None

    @property
    def turning(self) -> tuple[tuple[Body, Hinge], ...]:
        """Hinged bodies with their hinges: seat and flipper, as far as present."""
        return tuple((body, body.hinge) for body in self.bodies if body.hinge is not None)

    @property
    def bodies(self) -> tuple[Body, ...]:
        """All bodies, the chassis first."""
        return (self.chassis, self.seat) if self.flipper is None else (self.chassis, self.seat, self.flipper)


def vehicle(chair: ChairDescription, loading: Chair) -> Vehicle:
    """Return a chair with its payload as bodies."""
    flipper = None if chair.flipper is None else _flipper(chair.tracks, chair.flipper)
    return Vehicle(name=chair.name, chassis=_chassis(chair), seat=_seat(chair, loading), flipper=flipper)


def _chassis(chair: ChairDescription) -> Body:
    masses = chair.masses
    hull = Shape(name="hull", kind="box", centre_m=masses.chassis_com_m, half_m=_half(masses.chassis_size_m))
    return Body(
        name="chair",
        parent=None,
        origin_m=(0.0, 0.0, 0.0),
        mass_kg=masses.chassis_kg,
        com_m=masses.chassis_com_m,
        inertia=_box_inertia(masses.chassis_kg, masses.chassis_size_m),
        shapes=(*(shape for side, y_m in sides(chair.tracks) for shape in _belt(chair, side, y_m)), hull),
        wheels=tuple(wheel for side, y_m in sides(chair.tracks) for wheel in _wheels(chair.tracks, side, y_m)),
    )


def _seat(chair: ChairDescription, loading: Chair) -> Body:
    """Return the seat with its payload, or the payload alone: a uniform box at the scenario's offset."""
    mass, com = chair.empty_seat_kg + loading.payload_kg, payload_com(chair, loading)
    box = Shape(name="payload", kind="box", centre_m=com, half_m=_half(chair.payload_size_m))
    return Body(
        name="seat" if chair.seat is not None else "load",
        parent="chair",
        origin_m=payload_origin(chair, loading),
        mass_kg=mass,
        com_m=com,
        inertia=_box_inertia(mass, chair.payload_size_m),
        hinge=None if chair.seat is None else _seat_hinge(chair.seat),
        shapes=() if chair.seat is None and chair.payload is None else (box,),  # inside the hull, the payload has no surface
    )


def _seat_hinge(seat: Seat) -> Hinge:
    linkage = SeatLinkage(seat)
    fastest = max(linkage.rate_ratio(float(stroke)) for stroke in np.linspace(*linkage.stroke_range, 21))
    return Hinge(
        axis=(0.0, 1.0, 0.0),
        range_rad=linkage.angle_range,
        max_rate_rad_s=seat.max_rate_m_s * fastest,
        torque_n_m=None,
    )


def _flipper(tracks: Tracks, flipper: Flipper) -> Body:
    """Return the approach sections of both belts as one body hinged at the front pulleys' axis."""
    low, high = (math.radians(angle) for angle in flipper.range_deg)
    across = flipper.mass_kg * tracks.gauge_m**2 / 4.0  # half the mass on either side
    along = flipper.mass_kg * tracks.approach_m**2 / 12.0
    rate_rad_s = math.radians(flipper.max_rate_deg_s)
    return Body(
        name="flipper",
        parent="chair",
        origin_m=(0.5 * tracks.flat_run_m, 0.0, tracks.pulley_radius_m),
        mass_kg=flipper.mass_kg,
        com_m=(0.5 * tracks.approach_m, 0.0, 0.0),
        inertia=(across, along, across + along),
        hinge=Hinge(axis=(0.0, -1.0, 0.0), range_rad=(low, high), max_rate_rad_s=rate_rad_s, torque_n_m=flipper.torque_n_m),
        shapes=tuple(shape for side, y_m in sides(tracks) for shape in _section(tracks, side, y_m)),
    )


Side = Literal["left", "right"]


def sides(tracks: Tracks) -> tuple[tuple[Side, float], tuple[Side, float]]:
    """Return name and lateral position of each belt's centre line [m]."""
    return ("left", 0.5 * tracks.gauge_m), ("right", -0.5 * tracks.gauge_m)


def _belt(chair: ChairDescription, side: Side, y_m: float) -> list[Shape]:
    """Return the parts of a belt fixed to the chassis."""
    tracks = chair.tracks
    half_run = 0.5 * tracks.flat_run_m
    nose_x, _, nose_z = chair.nose_m
    angle = math.radians(tracks.approach_angle_deg)
    # The lower face of the approach lies one radius below the line between the pulley centres.
    down = np.array([math.sin(angle), -math.cos(angle)]) * (tracks.pulley_radius_m - FLAT_THICKNESS_M)
    middle = np.array([0.5 * (half_run + nose_x), 0.5 * (tracks.pulley_radius_m + nose_z)]) + down
    rear, front, nose = (
        _pulley(tracks, side, name, (x, y_m, z))
        for name, (x, z) in zip(("rear", "front", "nose"), pulley_centres(chair).tolist(), strict=True)
    )
    flat = _run(tracks, f"{side}_flat", side, (0.0, y_m, FLAT_THICKNESS_M), tracks.flat_run_m)
    centre = (float(middle[0]), y_m, float(middle[1]))
    approach = _run(tracks, f"{side}_approach", side, centre, tracks.approach_m, angle)
    bearing = [replace(part, meets="stair") for part in (rear, front, flat)]
    return [*bearing[:2], nose, bearing[2], approach] if chair.flipper is None else bearing


def _wheels(tracks: Tracks, side: Side, y_m: float) -> list[Shape]:
    """Return the road wheels of a belt, the rear one first."""
    half_m = (tracks.pulley_radius_m, 0.5 * tracks.belt_width_m, tracks.pulley_radius_m)
    return [
        Shape(
            name=f"{side}_wheel_{number}",
            kind="capsule",
            centre_m=(x_m, y_m, tracks.pulley_radius_m),
            half_m=half_m,
            belt=side,
            meets="ground",
            stiffness=stiffness,
        )
        for number, (x_m, stiffness) in enumerate(np.column_stack(road_wheels(tracks)).tolist())
    ]


def _section(tracks: Tracks, side: Side, y_m: float) -> list[Shape]:
    """Return the parts of a belt on the flipper."""
    length = tracks.approach_m
    centre = (0.5 * length, y_m, FLAT_THICKNESS_M - tracks.pulley_radius_m)
    return [_pulley(tracks, side, "nose", (length, y_m, 0.0)), _run(tracks, f"{side}_approach", side, centre, length)]


def _run(tracks: Tracks, name: str, side: Side, centre_m: Point, length_m: float, nose_up_rad: float = 0.0) -> Shape:
    """Return the box of a straight part of a belt."""
    half_m = (0.5 * length_m, 0.5 * tracks.belt_width_m, FLAT_THICKNESS_M)
    return Shape(name=name, kind="box", centre_m=centre_m, half_m=half_m, nose_up_rad=nose_up_rad, belt=side)


def _pulley(tracks: Tracks, side: Side, name: str, centre_m: Point) -> Shape:
    r = tracks.pulley_radius_m
    return Shape(name=f"{side}_{name}", kind="cylinder", centre_m=centre_m, half_m=(r, 0.5 * tracks.belt_width_m, r), belt=side)


def _box_inertia(mass_kg: float, size_m: tuple[float, float, float]) -> Point:
    """Return the principal moments of inertia of a uniform box [kg·m²]."""
    a, b, c = (edge * edge for edge in size_m)
    return mass_kg * (b + c) / 12.0, mass_kg * (a + c) / 12.0, mass_kg * (a + b) / 12.0


def _half(size_m: tuple[float, float, float]) -> Point:
    a, b, c = size_m
    return 0.5 * a, 0.5 * b, 0.5 * c


def oversized_lugs(belts: Belts, tracks: Tracks) -> str | None:
    """Return why the lugs are too large for the chair's pulleys, or None."""
    # The belt solid of 0.05 m shrinks by the lug height.
    height, most = belts.measures_m[0], min(0.5 * tracks.pulley_radius_m, 0.04)
    if height <= most:
        return None
    return (
        f"belts.height_m is {height:.3f}, the pulleys' radius {tracks.pulley_radius_m:.3f} m; lugs up to {most:.3f} m fit, "
        "half that radius and 0.04 m at most: a belt bends at the lugs' feet"
    )


def payload_com(chair: ChairDescription, loading: Chair) -> Point:
    """Return the payload's centre of mass in the payload's frame, which turns with the seat [m]."""
    (x, y, z), (dx, dy, dz) = chair.payload_com_m, chair.in_chair(loading.payload_offset_m)
    return (x + dx, y + dy, z + dz)


def payload_place(chair: ChairDescription, loading: Chair, seat_angle_rad: float) -> Point:
    """Return the payload's centre of mass in B [m] at a forward seat angle; a payload without a seat does not turn."""
    angle_rad = 0.0 if chair.seat is None else seat_angle_rad
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    x, y, z = payload_com(chair, loading)
    hx, hy, hz = payload_origin(chair, loading)
    return (hx + c * x + s * z, hy + y, hz - s * x + c * z)


def payload_origin(chair: ChairDescription, loading: Chair) -> Point:
    """Return the origin of the payload's frame in B [m], with the seat shift."""
    x, y, z = chair.payload_origin_m
    return (x if chair.seat is None else x + loading.seat_shift_m, y, z)


def centre_of_mass(chair: ChairDescription, loading: Chair, seat_angle_rad: float, flipper_angle_rad: float | None = None) -> Point:
    """Return the centre of mass of chair and payload in B [m] at a forward seat angle.

    Args:
        flipper_angle_rad: Angle of the flipper; None: its rest angle.
    """
    seat_kg, chassis_kg = chair.empty_seat_kg + loading.payload_kg, chair.masses.chassis_kg
    payload = payload_place(chair, loading, seat_angle_rad)
    chassis = chair.masses.chassis_com_m
    if chair.flipper is not None:
        chassis_kg, chassis = _with_flipper(chair, chair.flipper, flipper_angle_rad)
    total = chassis_kg + seat_kg
    return (
        (chassis_kg * chassis[0] + seat_kg * payload[0]) / total,
        (chassis_kg * chassis[1] + seat_kg * payload[1]) / total,
        (chassis_kg * chassis[2] + seat_kg * payload[2]) / total,
    )


def _with_flipper(chair: ChairDescription, flipper: Flipper, angle_rad: float | None) -> tuple[float, Point]:
    """Return mass and centre of mass of chassis and flipper together."""
    tracks, (x, y, z), chassis_kg = chair.tracks, chair.masses.chassis_com_m, chair.masses.chassis_kg
    angle = math.radians(tracks.approach_angle_deg) if angle_rad is None else angle_rad
    out = 0.5 * tracks.approach_m
    flipper_x = 0.5 * tracks.flat_run_m + out * math.cos(angle)
    flipper_z = tracks.pulley_radius_m + out * math.sin(angle)
    total = chassis_kg + flipper.mass_kg
    return total, (
        (chassis_kg * x + flipper.mass_kg * flipper_x) / total,
        chassis_kg * y / total,
        (chassis_kg * z + flipper.mass_kg * flipper_z) / total,
    )
