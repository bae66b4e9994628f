"""Seat with cushions, armrests, slider-bar linkage and seated person, or the sensor head or payload box of a robot.

The origin of the seat's frame is the hinge; the pin of the linkage is ``lever_arm_m`` in front of the hinge (Section II.B, Fig. 4).
A person is drawn as capsules, scaled to the payload's box and mass; segment lengths are fractions of the stature after Drillis and
Contini (1966).
"""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from treadline.core.angles import DEG
from treadline.core.rotations import Rotation, Vector3, rotation_y, rotation_z
from treadline.scenario.chair import ChairDescription, Seat, Size
from treadline.scenario.scenario import Chair
from treadline.vehicle.appearance._mesh import (
    BodyName,
    Mesh,
    MeshPart,
    box,
    capsule,
    cylinder,
    extrusion,
    merged,
    part,
    rounded_box,
    tube,
)
from treadline.vehicle.bodies import payload_com, payload_origin
from treadline.vehicle.linkage import SeatLinkage

ROD_M = 0.012
"""Radius of the rods of seat and linkage [m] (drawn only)."""
RECLINE_RAD = 10.0 * DEG
"""Recline of backrest and trunk [rad] (drawn only)."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Posture:
    """Joints of a seated person in the seat's frame, in the plane y = ``hip[1]`` [m]."""

    stature_m: float
    girth: float
    """Factor on all widths."""
    hip: Vector3
    shoulder: Vector3
    knee: Vector3
    ankle: Vector3
    thigh_radius_m: float

    @property
    def sole_z(self) -> float:
        """Height of the soles [m]."""
        return float(self.ankle[2]) - 0.039 * self.stature_m

    @property
    def elbow_z(self) -> float:
        """Height of the elbows [m]."""
        return float(self.shoulder[2]) - 0.95 * 0.186 * self.stature_m


def carries_person(chair: ChairDescription) -> bool:
    """Return whether the payload is drawn as a person: on a seat, at least as tall as a seated child of 1.2 m."""
    return chair.seat is not None and chair.payload_size_m[2] >= 0.5


def linkage_y_m(chair: ChairDescription) -> float:
    """Return the lateral distance of both linkages from the middle [m]: next to the payload, inside the frame."""
    return min(0.5 * chair.payload_size_m[1] + 0.032, 0.5 * chair.masses.chassis_size_m[1] - 0.035)


def seat_parts(chair: ChairDescription, loading: Chair) -> tuple[MeshPart, ...]:
    """Return the seat with its linkage and the payload."""
    if chair.seat is None:
        return _payload_box(chair, loading)
    linkage = _linkage_parts(chair, chair.seat, loading)
    if not carries_person(chair):
        return (*_sensor_head(chair, chair.seat, loading), *linkage)
    # In the occupant's frame, which is that of the seat, or turned by 180° about the plumb line through the hinge.
    (dx, dy, _), nominal = loading.payload_offset_m, np.array(chair.in_chair(chair.payload_com_m))
    seated = _posture(chair.payload_size_m, loading.payload_kg, nominal)
    parts = [*_wheelchair_seat(chair, chair.seat, seated), *linkage]
    if loading.payload_kg > 0.0:
        moved = _posture(chair.payload_size_m, loading.payload_kg, nominal + np.array([dx, dy, 0.0]))
        parts += _person_parts(moved, rotation_z(_turned_rad(chair)))
    return tuple(parts)


def _turned_rad(chair: ChairDescription) -> float:
    """Return the angle from the seat's frame to the occupant's about the vertical [rad]."""
    return 0.0 if chair.faces == "up" else math.pi


def linkage_poses(chair: ChairDescription, loading: Chair, seat_rad: float) -> dict[BodyName, Float[np.ndarray, "4 4"]]:
    """Return the poses of slider and bar of the seat linkage in B at a seat angle.

    Raises:
        MechanicsError: If the angle is outside the range of the linkage.
    """
    seat = chair.levelled_seat
    linkage = SeatLinkage(seat)
    low, high = linkage.angle_range
    angle = min(max(seat_rad, low), high)  # a seat on its springs exceeds the range by a fraction of a degree
    hinge = np.array(payload_origin(chair, loading))
    pin = hinge + seat.lever_arm_m * np.array([math.cos(angle), 0.0, -math.sin(angle)])
    slider = hinge - np.array([linkage.stroke(angle), 0.0, seat.slider_drop_m])
    X_slider, X_bar = np.eye(4), np.eye(4)
    X_slider[:3, 3] = X_bar[:3, 3] = slider
    along = pin - slider
    X_bar[:3, :3] = rotation_y(-math.atan2(float(along[2]), float(along[0])))
    return {"slider": X_slider, "bar": X_bar}


def _linkage_parts(chair: ChairDescription, seat: Seat, loading: Chair) -> list[MeshPart]:
    """Return rail and actuator on the chassis, the sliders, and the bars."""
    hx, _, hz = payload_origin(chair, loading)
    y, z = linkage_y_m(chair), hz - seat.slider_drop_m
    rod = min(ROD_M, 0.07 * seat.bar_m)
    low, high = (hx - stroke for stroke in seat.stroke_m)
    rails = [
        mesh
        for s in (1.0, -1.0)
        for mesh in (
            box((0.5 * (low + high), s * y, z - 1.4 * rod), (low - high + 5.0 * rod, 2.0 * rod, rod)),
            capsule((high - 12.0 * rod, s * y, z), (high - 3.0 * rod, s * y, z), 1.3 * rod, sides=8),
        )
    ]
    sliders = [box((0.0, s * y, 0.0), (3.2 * rod, 2.2 * rod, 2.0 * rod)) for s in (1.0, -1.0)]
    bars = [capsule((0.0, s * y, 0.0), (seat.bar_m, s * y, 0.0), rod, sides=8) for s in (1.0, -1.0)]
    return [
        part("linkage_rails", "chair", rails, "rail"),
        part("linkage_sliders", "slider", sliders, "rail"),
        part("linkage_bars", "bar", bars, "linkage"),
    ]


def _wheelchair_seat(chair: ChairDescription, seat: Seat, seated: _Posture) -> list[MeshPart]:
    """Return seat frame, cushions and armrests below and behind a seated person."""
    y, half = linkage_y_m(chair), 0.5 * chair.payload_size_m[1]
    h, (hip_x, _, hip_z) = seated.stature_m, seated.hip
    top = hip_z - seated.thigh_radius_m
    rear, front, thick = hip_x - 0.075 * h, hip_x + 0.19 * h, 0.03 * h
    # The cushion and the shell below it.
    cushion = rounded_box((0.5 * (rear + front), 0.0, top - 0.5 * thick), (front - rear, 2.0 * half, thick), 0.4 * thick)
    base = np.array([rear + 0.01 * h, 0.0, top - thick])
    R = rotation_y(-RECLINE_RAD)
    tall = 0.30 * h
    back = rounded_box((-0.013 * h, 0.0, 0.5 * tall + 0.02 * h), (0.026 * h, 1.92 * half, tall), 0.012 * h, along=1)
    shell = rounded_box((-0.032 * h, 0.0, 0.5 * tall), (0.012 * h, 1.8 * half, 0.96 * tall), 0.005 * h)
    frame = [shell.moved(base, R), box((0.5 * (rear + front), 0.0, top - thick - 0.006), (front - rear - 0.02, 1.9 * half, 0.012))]
    foot_x, foot_z = seated.ankle[0], seated.sole_z
    plate_y = half - 0.01
    foot = (foot_x + 0.05 * h, foot_z - 0.012)
    frame += [
        tube([(0.75 * seat.lever_arm_m, s * plate_y, 0.0), (foot[0], s * plate_y, foot[1])], 0.7 * ROD_M) for s in (1.0, -1.0)
    ]
    frame.append(box((foot_x + 0.06 * h, 0.0, foot_z - 0.008), (0.13 * h, 2.0 * plate_y, 0.014)))
    frame.append(cylinder((0.0, -y - 0.012, 0.0), (0.0, y + 0.012, 0.0), ROD_M, sides=10))
    elbow = seated.elbow_z
    rests: list[Mesh] = []
    for s in (1.0, -1.0):
        rest_y = s * (half + 0.012)
        rests.append(rounded_box((hip_x + 0.075 * h, rest_y, elbow - 0.05), (0.16 * h, 0.045, 0.028), 0.01))
        frame.append(tube([(hip_x + 0.1 * h, rest_y, elbow - 0.06), (hip_x + 0.1 * h, rest_y, top - thick)], 0.7 * ROD_M))
    turned = rotation_z(_turned_rad(chair))
    # The pin of the linkage is ahead of the hinge in B, wherever the occupant looks.
    behind_x = rear if chair.faces == "up" else -front
    plate = np.array([(-0.03, -0.02), (seat.lever_arm_m + 0.01, -0.015), (seat.lever_arm_m, 0.015), (behind_x + 0.04, top - thick)])
    plates = [extrusion(plate, s * y - 0.005, s * y + 0.005) for s in (1.0, -1.0)]
    return [
        part("seat_frame", "seat", [*_each_turned(frame, turned), *plates], "seat_frame"),
        part("cushions", "seat", _each_turned([cushion, back.moved(base, R)], turned), "cushion"),
        part("armrests", "seat", _each_turned(rests, turned), "battery"),
    ]


def _each_turned(meshes: list[Mesh], R: Rotation) -> list[Mesh]:
    """Return meshes turned about the origin of their frame."""
    return [mesh.moved((0.0, 0.0, 0.0), R) for mesh in meshes]


def _sensor_head(chair: ChairDescription, seat: Seat, loading: Chair) -> list[MeshPart]:
    """Return a robot's levelled payload: a box on a cradle."""
    x, y, z = payload_com(chair, loading)
    a, b, c = chair.payload_size_m
    at = linkage_y_m(chair)
    cradle: list[Mesh] = [
        box((x, y, z - 0.5 * c - 0.006), (a, b, 0.012)),
        cylinder((0.0, -at, 0.0), (0.0, at, 0.0), 0.05 * a, sides=10),
    ]
    plate = np.array([(-0.02, -0.012), (seat.lever_arm_m + 0.01, -0.01), (seat.lever_arm_m, 0.01), (-0.02, 0.03)])
    cradle += [extrusion(plate, s * at - 0.004, s * at + 0.004) for s in (1.0, -1.0)]
    window = rounded_box((x + 0.5 * a, y, z + 0.15 * c), (0.01, 0.7 * b, 0.3 * c), 0.05 * b, along=0)
    return [
        part("seat_frame", "seat", cradle, "seat_frame"),
        part("payload", "seat", [rounded_box((x, y, z), (a, b, c), 0.15 * c)], "payload"),
        part("payload_window", "seat", [window], "camera"),
    ]


def _payload_box(chair: ChairDescription, loading: Chair) -> tuple[MeshPart, ...]:
    """Return the payload of a chair without a seat; inside the hull it is not visible."""
    if chair.payload is None:
        return ()
    centre = np.array(payload_origin(chair, loading)) + np.array(payload_com(chair, loading))
    a, b, c = chair.payload_size_m
    straps = merged([box(centre + np.array([s * 0.25 * a, 0.0, 0.0]), (0.08 * a, 1.01 * b, 1.01 * c)) for s in (1.0, -1.0)])
    return (
        part("payload", "chair", [rounded_box(centre, (a, b, c), 0.08 * c)], "payload"),
        part("payload_straps", "chair", [straps], "battery"),
    )


def _posture(size_m: Size, mass_kg: float, com: Vector3) -> _Posture:
    """Return the joints of a person whose box and centre of mass in the seat's frame are given.

    Angles and the limits of the girth are chosen for the look: the feet stay inside the frame on a slope of 30°.
    """
    h = 2.4 * size_m[2]  # 1.68 m for the box of 0.70 m of the shipped wheelchairs
    # Widths grow with the root of the mass; 22 kg/m² is the middle of the WHO's normal range of the body mass index.
    girth = min(max(math.sqrt(max(mass_kg, 1.0) / (22.0 * h * h)), 0.75), 1.45)
    hip = com + h * np.array([-0.077, 0.0, -0.116])  # a seated person's centre of mass is in front of the abdomen
    thigh_rad, shank_rad = 15.0 * DEG, 24.0 * DEG
    shoulder = hip + 0.288 * h * np.array([-math.sin(RECLINE_RAD), 0.0, math.cos(RECLINE_RAD)])
    knee = hip + 0.245 * h * np.array([math.cos(thigh_rad), 0.0, math.sin(thigh_rad)])
    ankle = knee + 0.246 * h * np.array([-math.sin(shank_rad), 0.0, -math.cos(shank_rad)])
    return _Posture(
        stature_m=h, girth=girth, hip=hip, shoulder=shoulder, knee=knee, ankle=ankle, thigh_radius_m=0.042 * h * math.sqrt(girth)
    )


def _person_parts(seated: _Posture, turned: Rotation) -> list[MeshPart]:
    """Return head, trunk, limbs and shoes of a seated person as capsules, turned from the occupant's frame to the seat's."""
    h, g, hip, shoulder, knee, ankle = seated.stature_m, seated.girth, seated.hip, seated.shoulder, seated.knee, seated.ankle
    x, y, z = np.eye(3)
    neck, joint, sole = shoulder + 0.06 * h * z, 0.033 * h * math.sqrt(g), 0.5 * (float(ankle[2]) - seated.sole_z)
    skin = [capsule(shoulder, neck, 0.03 * h), capsule(neck + 0.055 * h * z, neck + 0.1 * h * z, 0.048 * h)]
    shirt, trousers, shoes = [], [], []
    for side in (y, -y):
        upper = shoulder + 0.1 * g * h * side
        elbow = np.array([upper[0] + 0.06 * h, upper[1] + 0.012 * h * side[1], seated.elbow_z])
        hand = elbow + 0.146 * h * (x - 0.12 * side)
        shirt.append(capsule(hip + 0.038 * g * h * side, shoulder - 0.02 * h * z + 0.04 * g * h * side, 0.062 * g * h))
        shirt += [capsule(upper, elbow, 0.03 * g * h, 0.024 * g * h), capsule(elbow, hand, 0.024 * g * h, 0.018 * g * h)]
        skin.append(capsule(hand, hand + 0.03 * h * x, 0.019 * h, sides=8))
        trousers.append(capsule(hip + 0.052 * g * h * side, knee + 0.056 * h * side, 1.05 * seated.thigh_radius_m, joint))
        trousers.append(capsule(knee + 0.056 * h * side, ankle + 0.056 * h * side, joint, 0.7 * joint))
        heel = ankle + 0.056 * h * side - sole * z
        shoes.append(capsule(heel - 0.01 * h * x, heel + 0.1 * h * x, sole))
    painted = (("skin", skin), ("shirt", shirt), ("trousers", trousers), ("shoes", shoes))
    return [part(f"person_{name}", "seat", _each_turned(meshes, turned), name) for name, meshes in painted]
