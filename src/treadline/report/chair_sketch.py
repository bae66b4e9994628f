"""The chair from its side, drawn from its geometry: belts, chassis, linkage, seat, payload and camera."""

import math

import numpy as np

from treadline.angles import DEG
from treadline.mechanics.chair import ChairDescription, Seat
from treadline.mechanics.linkage import SeatLinkage
from treadline.mechanics.tracks import outline, pulley_centres
from treadline.paper import PAYLOAD_KG
from treadline.report.figures import BLUE, GREEN, GREY, ORANGE, RED
from treadline.report.pen import AMBER, INK, STEEL, WHITE, Pen, Point, pair, turned


def draw_chair(pen: Pen, machine: ChairDescription, seat_angle_rad: float, pitch_rad: float) -> None:
    """Draw belts, chassis, linkage and seat, turned by the chair's pitch about B's origin."""
    tracks, masses = machine.tracks, machine.masses
    pen.area(turned(outline(tracks), pitch_rad), "#f1f1f1", INK, 2.6)
    for centre in pulley_centres(tracks).tolist():
        at = pair(turned([tuple(centre)], pitch_rad)[0])
        pen.disc(at, 0.93 * tracks.pulley_radius_m, STEEL)
        pen.disc(at, 0.015, INK)
    (x, _, z), (length, _, height) = masses.chassis_com_m, masses.chassis_size_m
    hull = _rectangle((x, z), length, height)
    pen.area(turned(hull, pitch_rad), "#c9d3dc99", INK, 1.0)
    if machine.seat is not None:
        _draw_seat(pen, machine.seat, seat_angle_rad, pitch_rad)


def _draw_seat(pen: Pen, parts: Seat, seat_angle_rad: float, pitch_rad: float) -> None:
    """Draw the seat and its linkage."""
    hinge = np.array([parts.hinge_m[0], parts.hinge_m[2]])
    pin = hinge + parts.lever_arm_m * np.array([math.cos(seat_angle_rad), -math.sin(seat_angle_rad)])
    slider = hinge - np.array([SeatLinkage(parts).stroke(seat_angle_rad), parts.slider_drop_m])
    margin = np.array([0.05, 0.0])
    rail = [hinge - np.array([stroke, parts.slider_drop_m]) for stroke in parts.stroke_m]
    pen.line(turned(np.array([rail[0] + margin, rail[1] - margin]), pitch_rad), GREY, 4.0)
    pen.line(turned(np.array([rail[1] - 6.0 * margin, slider]), pitch_rad), GREEN, 2.4)
    pen.line(turned(np.array([slider, pin]), pitch_rad), RED, 2.6)
    for point in (slider, pin, hinge):
        pen.disc(pair(turned(np.array([point]), pitch_rad)[0]), 0.017, WHITE)
    chair_seat = np.array([(-0.24, 0.62), (-0.19, 0.05), (0.34, 0.05)]) + hinge
    upright = turned(turned(chair_seat, -seat_angle_rad, pair(hinge)), pitch_rad)
    pen.line(upright, BLUE, 4.0)
    pen.line(turned(np.array([hinge, pin]), pitch_rad), BLUE, 2.4)


def draw_payload(pen: Pen, machine: ChairDescription) -> None:
    """Draw the payload's box and its centre, chair and seat level."""
    hinge, offset, size = machine.payload_origin_m, machine.payload_com_m, machine.payload_size_m
    x, z = hinge[0] + offset[0], hinge[2] + offset[2]
    corners = _rectangle((x, z), size[0], size[2])
    pen.line([*corners, corners[0]], ORANGE, 1.2, "--")
    pen.disc((x, z), 0.022, ORANGE, ORANGE)
    pen.text((x, z + 0.16), f"payload\n{PAYLOAD_KG:g} kg", size=9.5, colour=AMBER)


def draw_camera(pen: Pen, machine: ChairDescription) -> None:
    """Draw the camera on its mast and the edges of what it sees, chair level."""
    x, _, z = machine.camera.position_m
    pen.line([(x, 0.295), (x, z)], INK, 2.0)
    case = [(-0.05, -0.025), (0.05, -0.025), (0.05, 0.025), (-0.05, 0.025)]
    pitch = -machine.camera.pitch_deg * DEG
    pen.area(turned(case, pitch) + np.array([x, z]), INK)
    for edge in (-22.5, 22.5):
        direction = pitch + edge * DEG
        pen.line([(x, z), (x + 0.62 * math.cos(direction), z + 0.62 * math.sin(direction))], GREEN, 0.8, "--")
    pen.text((x + 0.10, z + 0.12), f"RGB-D camera,\n{machine.camera.pitch_deg:g}° down", size=9.0, colour=GREEN, align="left")


def name_linkage(pen: Pen, machine: ChairDescription, slope_rad: float) -> None:
    """Label the parts of the seat linkage of a chair whose seat is horizontal on a slope."""
    parts = machine.levelled_seat
    hinge = np.array([parts.hinge_m[0], parts.hinge_m[2]])
    slider = hinge - np.array([SeatLinkage(parts).stroke(slope_rad), parts.slider_drop_m])
    pin = hinge + parts.lever_arm_m * np.array([math.cos(slope_rad), -math.sin(slope_rad)])
    named = (
        (hinge, (-0.40, 0.52), "hinge", "right"),
        (0.5 * (slider + pin), (0.46, -0.03), "bar", "left"),
        (slider - np.array([0.01, 0.0]), (0.20, -0.15), "slider", "left"),
        (slider - np.array([0.16, 0.0]), (-0.40, 0.26), "actuator", "right"),
        (pin, (0.64, 0.40), "pin", "left"),
    )
    for point, at, words, align in named:
        pen.pointer(at, pair(turned(np.array([point]), slope_rad)[0]), words, align)


def _rectangle(centre: Point, width: float, height: float) -> list[Point]:
    (x, z), a, b = centre, 0.5 * width, 0.5 * height
    return [(x - a, z - b), (x + a, z - b), (x + a, z + b), (x - a, z + b)]
