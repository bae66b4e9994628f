"""Chair and stair as rigid bodies: the common description for MJCF, URDF and SDF.

``ChairDescription, Chair -> Vehicle``; ``Staircase -> Solid``. The vehicle is a tree: the chassis, whose frame is B, with the seat
and, if driven, the flipper. All joints are at zero: the seat parallel to the chassis, the flipper in line with the flat run.
"""

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from jaxtyping import Float

from treadline.core.angles import rotation_y, rotation_z
from treadline.scenario.chair import ChairDescription, Flipper, Point, Seat, Tracks
from treadline.scenario.scenario import Chair, Start
from treadline.vehicle.linkage import SeatLinkage
from treadline.vehicle.staircase import Box, Staircase, Step
from treadline.vehicle.static_stability import payload_com, payload_origin, seat_mass_kg

FLAT_THICKNESS_M = 0.025
"""Half thickness of a belt's box [m], less than the pulleys' diameter."""
HULL_FRICTION = 0.4
"""Friction coefficient of hull and passenger against stair, walls and obstacles: 0.3 to 0.4 for steel on concrete (EN 12812:2004,
annex A)."""
CLEARANCE_M = 0.001
"""Initial gap between a chair and its support [m]."""
FLOOR_START_M, LANDING_START_M, LANDING_SPARE_M = 1.0, 0.6, 0.1
"""Initial distance of the nearer pulley from the first nosing (floor) and from the edge (landing), and free length of a short
landing behind the chair [m]."""
LANDING_LEAST_M = 0.2
"""Least initial distance of the pulley from the edge of a short landing [m]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Shape:
    """Box, or cylinder about y, in the frame of its body."""

    name: str
    kind: Literal["box", "cylinder"]
    centre_m: Point
    half_m: Point
    """Half extents along the shape's own axes [m]."""
    nose_up_rad: float = 0.0
    belt: Literal["left", "right"] | None = None
    """Belt that moves this surface; None for hull and payload, whose surfaces are at rest."""


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
    shapes: tuple[Shape, ...] = ()


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
        inertia=box_inertia(masses.chassis_kg, masses.chassis_size_m),
        shapes=(*(shape for side, y_m in sides(chair.tracks) for shape in _belt(chair, side, y_m)), hull),
    )


def _seat(chair: ChairDescription, loading: Chair) -> Body:
    """Return the seat with its payload, or the payload alone: a uniform box at the scenario's offset."""
    mass, com = seat_mass_kg(chair, loading), payload_com(chair, loading)
    box = Shape(name="payload", kind="box", centre_m=com, half_m=_half(chair.payload_size_m))
    return Body(
        name="seat" if chair.seat is not None else "load",
        parent="chair",
        origin_m=payload_origin(chair, loading),
        mass_kg=mass,
        com_m=com,
        inertia=box_inertia(mass, chair.payload_size_m),
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
    half_run, half_width = 0.5 * tracks.flat_run_m, 0.5 * tracks.belt_width_m
    nose_x, _, nose_z = chair.nose_m
    angle = math.radians(tracks.approach_angle_deg)
    # The lower face of the approach lies one radius below the line between the pulley centres.
    down = np.array([math.sin(angle), -math.cos(angle)]) * (tracks.pulley_radius_m - FLAT_THICKNESS_M)
    middle = np.array([0.5 * (half_run + nose_x), 0.5 * (tracks.pulley_radius_m + nose_z)]) + down
    rear, front, nose = (
        _pulley(tracks, side, name, (x, y_m, z))
        for name, x, z in (
            ("rear", -half_run, tracks.pulley_radius_m),
            ("front", half_run, tracks.pulley_radius_m),
            ("nose", nose_x, nose_z),
        )
    )
    flat = Shape(
        name=f"{side}_flat",
        kind="box",
        centre_m=(0.0, y_m, FLAT_THICKNESS_M),
        half_m=(half_run, half_width, FLAT_THICKNESS_M),
        belt=side,
    )
    approach = Shape(
        name=f"{side}_approach",
        kind="box",
        centre_m=(float(middle[0]), y_m, float(middle[1])),
        half_m=(0.5 * tracks.approach_m, half_width, FLAT_THICKNESS_M),
        nose_up_rad=angle,
        belt=side,
    )
    return [rear, front, nose, flat, approach] if chair.flipper is None else [rear, front, flat]


def _section(tracks: Tracks, side: Side, y_m: float) -> list[Shape]:
    """Return the parts of a belt on the flipper."""
    length, half_width = tracks.approach_m, 0.5 * tracks.belt_width_m
    approach = Shape(
        name=f"{side}_approach",
        kind="box",
        centre_m=(0.5 * length, y_m, FLAT_THICKNESS_M - tracks.pulley_radius_m),
        half_m=(0.5 * length, half_width, FLAT_THICKNESS_M),
        belt=side,
    )
    return [_pulley(tracks, side, "nose", (length, y_m, 0.0)), approach]


def _pulley(tracks: Tracks, side: Side, name: str, centre_m: Point) -> Shape:
    r = tracks.pulley_radius_m
    return Shape(name=f"{side}_{name}", kind="cylinder", centre_m=centre_m, half_m=(r, 0.5 * tracks.belt_width_m, r), belt=side)


def box_inertia(mass_kg: float, size_m: tuple[float, float, float]) -> Point:
    """Return the principal moments of inertia of a uniform box [kg·m²]."""
    a, b, c = (edge * edge for edge in size_m)
    return mass_kg * (b + c) / 12.0, mass_kg * (a + c) / 12.0, mass_kg * (a + b) / 12.0


def _half(size_m: tuple[float, float, float]) -> Point:
    a, b, c = size_m
    return 0.5 * a, 0.5 * b, 0.5 * c


@dataclass(frozen=True, slots=True, kw_only=True)
class NosingGeometry:
    """Rounded front edge of a step: a round bar between two ends."""

    index: int
    left_W: Point
    right_W: Point
    radius_m: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Solid:
    """Box of the stair, with the round bar of its nosing; floors and walls have no bar."""

    box: Box
    nosing: NosingGeometry | None = None


def solids(staircase: Staircase) -> tuple[Solid, ...]:
    """Return the staircase as solids, floor and walls included."""
    return tuple(
        _solid(box, staircase.steps[box.index].nosing_radius_m) if box.kind in ("step", "landing") else Solid(box=box)
        for box in staircase.boxes()
    )


def _solid(box: Box, radius: float) -> Solid:
    (cx, cy, cz), (hx, hy, hz), yaw = box.centre_W, box.half_m, box.yaw_rad
    c, s = math.cos(yaw), math.sin(yaw)
    level, rising = math.cos(box.pitch_rad), math.sin(box.pitch_rad)

    def at(along: float, above: float) -> Point:
        forward, up = along * level - above * rising, along * rising + above * level
        return cx + c * forward, cy + s * forward, cz + up

    r = radius
    start, across = at(-hx + r, hz - r), (s * hy, -c * hy)
    left = (start[0] - across[0], start[1] - across[1], start[2])
    right = (start[0] + across[0], start[1] + across[1], start[2])
    behind = replace(box, centre_W=at(0.5 * r, 0.0), half_m=(hx - 0.5 * r, hy, hz))
    return Solid(box=behind, nosing=NosingGeometry(index=box.index, left_W=left, right_W=right, radius_m=r))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Standing:
    """Start pose of a chair."""

    p_WB: Float[np.ndarray, " 3"]
    R_WB: Float[np.ndarray, "3 3"]
    seat_rad: float
    """Angle of the seat relative to the chassis [rad]: level, or parallel."""


def from_edge_m(landing_m: float, tracks: Tracks) -> float:
    """Return the distance of the rear pulley behind the edge for a start on a landing [m]."""
    return min(max(landing_m - tracks.flat_run_m - LANDING_SPARE_M, LANDING_LEAST_M), LANDING_START_M)


def standing(staircase: Staircase, tracks: Tracks, start: Start) -> Standing:
    """Return the start pose of a scenario, slightly above the support.

    On the landing, heading and lateral position are relative to the last flight.
    """
    heading, top = math.radians(start.heading_deg), staircase.steps[-1]
    slope = {"floor": 0.0, "landing": top.tread_slope_rad, "flight": staircase.slope_rad}[start.place]
    along, flight = 0.5 * tracks.flat_run_m * math.cos(heading), 0
    R_WB = rotation_y(-slope) @ rotation_z(heading)
    if start.place == "floor":
        p_WB = np.array([-along - FLOOR_START_M, start.lateral_m, CLEARANCE_M])
    elif start.place == "landing":
        behind_m = along + from_edge_m(staircase.landing_m, tracks)
        p_WB = np.array([top.x_m + behind_m, start.lateral_m, top.z_m + CLEARANCE_M + behind_m * math.tan(slope)])
        flight = staircase.flight_count - 1
    else:
        step = staircase.steps[start.step]
        flight = next(k for k, steps in enumerate(staircase.flights) if step in steps) if staircase.turn_rad else 0
        lifted_m = CLEARANCE_M - rounded_off_m(step.nosing_radius_m, slope) + _above_plane_m(staircase, step, tracks.flat_run_m)
        from_nosing = staircase.R_WS @ np.array([-along, start.lateral_m, lifted_m])
        p_WB = step.nosing_F + from_nosing
    if flight:
        R_WF, p_WF = staircase.flight_frame(flight)
        p_WB, R_WB = p_WF + R_WF @ p_WB, R_WF @ R_WB
    return Standing(p_WB=p_WB, R_WB=R_WB, seat_rad=slope if start.seat == "level" else 0.0)


def rounded_off_m(nosing_radius_m: float, slope_rad: float) -> float:
    """Return the distance from the plane of the sharp edges down to the plane tangent to the rounded nosings [m]."""
    return nosing_radius_m * (math.sin(slope_rad) + math.cos(slope_rad) - 1.0)


def _above_plane_m(staircase: Staircase, front: Step, flat_run_m: float) -> float:
    """Return the height of the highest nosing under the belts above the plane through the front nosing [m]."""
    c, s = math.cos(staircase.slope_rad), math.sin(staircase.slope_rad)
    offsets = [
        (step.z_m - front.z_m) * c - (step.x_m - front.x_m) * s
        for step in next(steps for steps in staircase.flights if front in steps)
        if step.index <= front.index and not step.missing and (front.x_m - step.x_m) * c <= flat_run_m
    ]
    highest_m = max(offsets, default=0.0)
    return highest_m if highest_m > CLEARANCE_M else 0.0
