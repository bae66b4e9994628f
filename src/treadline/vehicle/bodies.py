"""Chair as rigid bodies, the common description for MJCF, URDF and SDF; centre of mass of chair and payload.

``ChairDescription, Chair -> Vehicle``. The vehicle is a tree: the chassis, whose frame is B, with the seat
and, if driven, the flipper. All joints are at zero: the seat parallel to the chassis, the flipper in line with the flat run.
"""

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from jaxtyping import Float

from treadline.scenario.chair import ChairDescription, Flipper, Point, Seat, Tracks
from treadline.scenario.scenario import Belts, Chair
from treadline.vehicle.linkage import SeatLinkage
from treadline.vehicle.tracks import Section, road_wheels, sections

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
    """Rigid body; inertia along the axes of its frame."""

    name: str
    parent: str | None
    origin_m: Point
    """Origin in the parent's frame [m]."""
    mass_kg: float
    com_m: Point
    inertia: Point
    """Moments of inertia about the centre of mass [kg·m²]: xx, yy, zz."""
    products: Point = (0.0, 0.0, 0.0)
    """Products of inertia [kg·m²]: xy, xz, yz."""
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
    flippers: tuple[Body, ...]
    """Sections of the belts with a joint; the section that ``flipper`` commands is called ``flipper``, and is the first."""

    @property
    def turning(self) -> tuple[tuple[Body, Hinge], ...]:
        """Hinged bodies with their hinges: seat and flippers, as far as present."""
        return tuple((body, body.hinge) for body in self.bodies if body.hinge is not None)

    @property
    def bodies(self) -> tuple[Body, ...]:
        """All bodies, the chassis first."""
        return (self.chassis, self.seat, *self.flippers)


def vehicle(chair: ChairDescription, loading: Chair) -> Vehicle:
    """Return a chair with its payload as bodies."""
    flippers = [_flipper(section, section.motor) for section in sections(chair) if section.motor is not None]
    return Vehicle(name=chair.name, chassis=_chassis(chair), seat=_seat(chair, loading), flippers=tuple(flippers))


def inertia_of(body: Body) -> Float[np.ndarray, "3 3"]:
    """Return the inertia of a body about its centre of mass [kg·m²]."""
    (xx, yy, zz), (xy, xz, yz) = body.inertia, body.products
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def flipper_turns(chair: ChairDescription, flipper_rad: float | None = None) -> dict[str, float]:
    """Return the angle about B's y axis by which each section with a joint is turned, by the name of its body [rad].

    Args:
        chair: Chair.
        flipper_rad: Angle of the commanded flipper; None: its rest angle.
    """
    angle = math.radians(chair.tracks.approach_angle_deg) if flipper_rad is None else flipper_rad
    turning = (section for section in sections(chair) if section.motor is not None)
    return {_body_name(section): section.zero_rad - section.direction_rad(angle) for section in turning}


def _body_name(section: Section) -> str:
    """Return the name of the body of a section with a joint."""
    return "flipper" if section.name == "approach" else section.name


def _chassis(chair: ChairDescription) -> Body:
    masses = chair.masses
    hull = Shape(name="hull", kind="box", centre_m=masses.hull_centre_m, half_m=_half(masses.chassis_size_m))
    xx, yy, zz, xy, xz, yz = masses.inertia_kg_m2 or (*_box_inertia(masses.chassis_kg, masses.chassis_size_m), 0.0, 0.0, 0.0)
    return Body(
        name="chair",
        parent=None,
        origin_m=(0.0, 0.0, 0.0),
        mass_kg=masses.chassis_kg,
        com_m=masses.chassis_com_m,
        inertia=(xx, yy, zz),
        products=(xy, xz, yz),
        shapes=(*(shape for side in SIDES for shape in _belt(chair, side)), hull),
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


def _flipper(section: Section, motor: Flipper) -> Body:
    """Return a section of both belts as one body hinged at its first axis; the axes of its frame are those of B at a zero joint."""
    low, high = (math.radians(angle) for angle in motor.range_deg)
    c, s = math.cos(section.zero_rad), math.sin(section.zero_rad)
    across = motor.mass_kg * section.gauge_m**2 / 4.0  # half the mass on either side
    rod = motor.mass_kg * section.length_m**2 / 12.0
    along, aside, upright = motor.inertia_kg_m2 or (across, rod, across + rod)
    out_m, (x_m, z_m) = section.com_m, section.start_m
    hinge = Hinge(
        axis=(0.0, -section.raises, 0.0),
        range_rad=(low, high),
        max_rate_rad_s=math.radians(motor.max_rate_deg_s),
        torque_n_m=motor.torque_n_m,
    )
    placed = replace(section, start_m=(0.0, 0.0), stays_rad=0.0, follows=False)
    return Body(
        name=_body_name(section),
        parent="chair",
        origin_m=(x_m, 0.0, z_m),
        mass_kg=motor.mass_kg,
        com_m=(out_m * c, 0.0, out_m * s),
        inertia=(along * c * c + upright * s * s, aside, along * s * s + upright * c * c),
        products=(0.0, (along - upright) * s * c, 0.0),
        hinge=hinge,
        shapes=tuple(shape for side in SIDES for shape in _section(placed, side)),
    )


Side = Literal["left", "right"]
SIDES: tuple[Side, Side] = ("left", "right")
"""Sides of a chair."""


def sides(tracks: Tracks) -> tuple[tuple[Side, float], tuple[Side, float]]:
    """Return name and lateral position of each belt's centre line [m]."""
    return ("left", 0.5 * tracks.gauge_m), ("right", -0.5 * tracks.gauge_m)


def _belt(chair: ChairDescription, side: Side) -> list[Shape]:
    """Return the parts of a belt fixed to the chassis: both pulleys and the flat run, and sections without a joint."""
    flat, *others = sections(chair)
    rear, front = (
        _pulley(flat, side, name, (x, flat.start_m[1]), 0) for name, x in (("rear", flat.start_m[0]), ("front", -flat.start_m[0]))
    )
    bearing = [replace(part, meets="stair") for part in (rear, front, _run(flat, side))]
    return [*bearing, *(shape for section in others if section.motor is None for shape in _section(section, side))]


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


def _section(section: Section, side: Side) -> list[Shape]:
    """Return the parts of a section beyond the flat run: its last pulley and its straight part, and of a further one its first."""
    if section.name == "approach":
        return [_pulley(section, side, "nose", section.end_m(0.0), 1), _run(section, side)]
    ends = (("axis", section.start_m), ("tip", section.end_m(0.0)))
    pulleys = (_pulley(section, side, f"{section.name}_{end}", axis_m, number) for number, (end, axis_m) in enumerate(ends))
    return [*pulleys, replace(_run(section, side), name=f"{side}_{section.name}_run")]


def _run(section: Section, side: Side) -> Shape:
    """Return the box of the straight part of a belt, whose lower face touches both pulleys."""
    (x, z), (end_x, end_z), direction, radii = section.start_m, section.end_m(0.0), section.direction_rad(0.0), section.radii_m
    # Along B's x: a section that points rearward begins at its end.
    ahead_rad, (behind, before) = (direction, radii) if section.raises > 0.0 else (direction - math.pi, radii[::-1])
    tilt = math.asin((behind - before) / section.length_m)
    nose_up_rad = ahead_rad + tilt
    down_m = 0.5 * (behind + before) - FLAT_THICKNESS_M
    centre = (0.5 * (x + end_x) + down_m * math.sin(nose_up_rad), 0.5 * (z + end_z) - down_m * math.cos(nose_up_rad))
    return Shape(
        name=f"{side}_{section.name}",
        kind="box",
        centre_m=(centre[0], _aside_m(section, side), centre[1]),
        half_m=(0.5 * section.length_m * math.cos(tilt), 0.5 * section.width_m, FLAT_THICKNESS_M),
        nose_up_rad=nose_up_rad,
        belt=side,
    )


def _pulley(section: Section, side: Side, name: str, axis_m: tuple[float, float], end: int) -> Shape:
    """Return a pulley at the first or last end of a section."""
    r, (x, z) = section.radii_m[end], axis_m
    half_m = (r, 0.5 * section.width_m, r)
    return Shape(name=f"{side}_{name}", kind="cylinder", centre_m=(x, _aside_m(section, side), z), half_m=half_m, belt=side)


def _aside_m(section: Section, side: Side) -> float:
    """Return the lateral position of a section's centre line [m]."""
    return 0.5 * section.gauge_m if side == "left" else -0.5 * section.gauge_m


def _box_inertia(mass_kg: float, size_m: tuple[float, float, float]) -> Point:
    """Return the principal moments of inertia of a uniform box [kg·m²]."""
    a, b, c = (edge * edge for edge in size_m)
    return mass_kg * (b + c) / 12.0, mass_kg * (a + c) / 12.0, mass_kg * (a + b) / 12.0


def _half(size_m: tuple[float, float, float]) -> Point:
    a, b, c = size_m
    return 0.5 * a, 0.5 * b, 0.5 * c


def oversized_lugs(belts: Belts, chair: ChairDescription) -> str | None:
    """Return why the chair's belts cannot have such lugs, or None."""
    # The belt solid of 0.05 m shrinks by the lug height.
    tracks, height, most = chair.tracks, belts.measures_m[0], min(0.5 * chair.tracks.pulley_radius_m, 0.04)
    if height > 0.0 and (chair.belt or tracks.nose_radius_m is not None):
        return f"belts.height_m is {height:.3f}: lugs run over flat run and approach alone, on pulleys of one radius; leave it out"
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
    seat_kg, payload = chair.empty_seat_kg + loading.payload_kg, payload_place(chair, loading, seat_angle_rad)
    chassis_kg, chassis = _with_flippers(chair, flipper_angle_rad)
    total = chassis_kg + seat_kg
    return (
        (chassis_kg * chassis[0] + seat_kg * payload[0]) / total,
        (chassis_kg * chassis[1] + seat_kg * payload[1]) / total,
        (chassis_kg * chassis[2] + seat_kg * payload[2]) / total,
    )


def _with_flippers(chair: ChairDescription, angle_rad: float | None) -> tuple[float, Point]:
    """Return mass and centre of mass of chassis and flippers together."""
    angle = math.radians(chair.tracks.approach_angle_deg) if angle_rad is None else angle_rad
    total = chair.masses.chassis_kg
    x, y, z = (total * place for place in chair.masses.chassis_com_m)
    for section in sections(chair):
        (start_x, start_z), (end_x, end_z), kg = section.start_m, section.end_m(angle), section.mass_kg
        share = section.com_m / section.length_m
        x, z = x + kg * ((1.0 - share) * start_x + share * end_x), z + kg * ((1.0 - share) * start_z + share * end_z)
        total += kg
    return total, (x / total, y / total, z / total)
