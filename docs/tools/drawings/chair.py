"""The chair in line drawings: silhouettes of its meshes, the points of its linkage, payload and field of view.

The meshes are those of ``treadline.vehicle.appearance``, which viewer and URDF show as well.
"""

import math
from collections.abc import Mapping
from itertools import groupby

import numpy as np
from jaxtyping import Float

from drawings.pen import AMBER, WHITE, Pen, Point, pair, turned
from treadline.core.angles import DEG
from treadline.report.side_view import SIDE, Silhouette, silhouettes
from treadline.report.svg_figures import GREEN, ORANGE
from treadline.scenario.chair import ChairDescription
from treadline.scenario.scenario import Chair
from treadline.vehicle.appearance import BodyName, MeshPart, body_poses, chair_parts, resting_lugs
from treadline.vehicle.bodies import payload_com, payload_origin
from treadline.vehicle.linkage import SeatLinkage

EMPTY = Chair(payload_kg=0.0)
"""Loading of a drawn chair: without a person, whose legs would hide the linkage."""
CUT_AWAY = ("frame", "covers", "battery", "drive")
"""Parts of the chassis that are drawn transparent: the linkage is between the frame's side plates."""
CUT_AWAY_OPACITY = 0.45
"""Opacity of these parts: the linkage behind them and their own outline are both legible."""
LINKAGE = ("linkage_rails", "linkage_sliders", "linkage_bars")
TRACK = ("belt_", "track_", "axles", "lugs")
"""Beginnings of the names of belts, wheels and lugs of the flat run."""


def draw_chair(
    pen: Pen,
    machine: ChairDescription,
    seat_angle_rad: float = 0.0,
    turn_rad: float = 0.0,
    *,
    view: Float[np.ndarray, "3 3"] = SIDE,
    shift: Point = (0.0, 0.0),
    only: tuple[str, ...] = ("",),
) -> None:
    """Draw a chair without a person.

    Args:
        turn_rad: Rotation in the plane of the drawing, anticlockwise: from the side the pitch.
        view: Directions right, up and towards the viewer in B, as rows.
        shift: Place of B's origin.
        only: Beginnings of the names of the parts to draw.
    """
    parts = [part for part in (*chair_parts(machine, EMPTY), *resting_lugs(machine)) if part.name.startswith(only)]
    poses = body_poses(machine, EMPTY, seat_angle_rad)
    for some in ([part for part in parts if part.name not in LINKAGE], [part for part in parts if part.name in LINKAGE]):
        _draw_parts(pen, some, poses, view, turn_rad, shift)


def _draw_parts(
    pen: Pen,
    parts: list[MeshPart],
    poses: Mapping[BodyName, Float[np.ndarray, "4 4"]],
    view: Float[np.ndarray, "3 3"],
    turn_rad: float,
    shift: Point,
) -> None:
    """Draw the solids of parts, the farthest first; neighbours of one part are one shape, which keeps the file small."""
    for name, shapes in groupby(_visible(silhouettes(parts, view, poses)), key=lambda shape: shape.part):
        several = list(shapes)
        loops = [turned(loop, turn_rad) + shift for shape in several for loop in shape.loops]
        pen.shape(loops, (*several[0].colour, CUT_AWAY_OPACITY if name in CUT_AWAY else 1.0), width=0.5)


def _visible(shapes: list[Silhouette]) -> list[Silhouette]:
    """Return the silhouettes without those behind an identical one, as the left belt is behind the right one."""
    nearest = {(shape.part.removesuffix("_left").removesuffix("_right"), _rounded(shape)): shape for shape in shapes}
    kept = {id(shape) for shape in nearest.values()}
    return [shape for shape in shapes if id(shape) in kept]


def _rounded(shape: Silhouette) -> frozenset[tuple[float, float]]:
    return frozenset((round(x, 4), round(z, 4)) for loop in shape.loops for x, z in loop.tolist())


def linkage_points(machine: ChairDescription, seat_angle_rad: float) -> dict[str, Float[np.ndarray, " 2"]]:
    """Return hinge, pin and slider of the seat linkage in the plane (x, z) of B [m]."""
    seat = machine.levelled_seat
    hinge = np.array([seat.hinge_m[0], seat.hinge_m[2]])
    pin = hinge + seat.lever_arm_m * np.array([math.cos(seat_angle_rad), -math.sin(seat_angle_rad)])
    slider = hinge - np.array([SeatLinkage(seat).stroke(seat_angle_rad), seat.slider_drop_m])
    return {"hinge": hinge, "pin": pin, "slider": slider}


def mark_linkage(pen: Pen, machine: ChairDescription, seat_angle_rad: float, pitch_rad: float) -> None:
    """Mark hinge, pin and slider of the seat linkage."""
    for point in linkage_points(machine, seat_angle_rad).values():
        pen.disc(pair(turned(np.array([point]), pitch_rad)[0]), 0.014, WHITE)


def draw_payload(pen: Pen, machine: ChairDescription) -> None:
    """Draw the payload's box and its centre of mass, chair and seat level."""
    loading = Chair()
    x, _, z = np.array(payload_origin(machine, loading)) + np.array(payload_com(machine, loading))
    a, c = 0.5 * machine.payload_size_m[0], 0.5 * machine.payload_size_m[2]
    corners = [(x - a, z - c), (x + a, z - c), (x + a, z + c), (x - a, z + c), (x - a, z - c)]
    pen.line(corners, ORANGE, 1.2, "--")
    pen.disc((float(x), float(z)), 0.022, ORANGE, ORANGE)
    pen.text((float(x), float(z) + 0.16), f"payload\n{loading.payload_kg:g} kg", size=9.5, colour=AMBER)


def draw_view_of_camera(pen: Pen, machine: ChairDescription) -> None:
    """Draw the edges of what the front camera sees, chair level."""
    x, _, z = machine.camera.position_m
    camera = machine.camera_at()
    pitch = -machine.camera.pitch_deg * DEG
    for row in (-0.5, camera.height_px - 0.5):  # pixel centres are integers
        direction = pitch - math.atan2(row - camera.cy_px, camera.fy_px)
        pen.line([(x, z), (x + 0.62 * math.cos(direction), z + 0.62 * math.sin(direction))], GREEN, 0.8, "--")
    pen.text((x + 0.10, z + 0.12), f"RGB-D camera,\n{machine.camera.pitch_deg:g}° down", size=9.0, colour=GREEN, align="left")


def name_linkage(pen: Pen, machine: ChairDescription, slope_rad: float) -> None:
    """Label the parts of the seat linkage of a chair whose seat is horizontal on a slope."""
    points = linkage_points(machine, slope_rad)
    slider, pin = points["slider"], points["pin"]
    named = (
        (points["hinge"], (-0.40, 0.62), "hinge", "right"),
        (0.5 * (slider + pin), (0.52, -0.06), "bar", "left"),
        (slider, (0.24, -0.17), "slider", "left"),
        (slider - np.array([0.10, 0.0]), (-0.44, 0.30), "actuator", "right"),
        (pin, (0.66, 0.30), "pin", "left"),
    )
    for point, at, words, align in named:
        pen.pointer(at, pair(turned(np.array([point]), slope_rad)[0]), words, align)
