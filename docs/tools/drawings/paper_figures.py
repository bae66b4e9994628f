"""Drawings of ours for Figs. 1 to 4, 6 and 7 of the paper; ``make docs`` writes them.

Chair and track are silhouettes of the meshes that viewer and URDF show, and measures are those that the simulator runs: a drawing
cannot differ from either.
"""

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from drawings.chair import TRACK, draw_chair, draw_payload, draw_view_of_camera, mark_linkage, name_linkage
from drawings.diagrams import nodes, scheme
from drawings.pen import AMBER, INK, STONE, Pen, Point, pair, sheet, turned
from treadline.core.angles import DEG
from treadline.core.files import write_whole
from treadline.core.paper import FIG11_SLOPE_DEG
from treadline.report.svg_figures import BLUE, GREEN, GREY, ORANGE, RED, svg_of
from treadline.scenario.chair import read_chair
from treadline.vehicle.linkage import SeatLinkage
from treadline.vehicle.tracks import minimum_track_length, pulley_centres

ABOVE = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
"""View from above with the chair's forward direction up."""
RUN_M = 0.30
SLOPE_RAD = FIG11_SLOPE_DEG * DEG


def chair() -> Figure:
    """Return Fig. 1: the chair from its right side, level."""
    figure, (pen,) = sheet(8.0, 5.1)
    pen.frame((-0.95, 1.15), (-0.27, 1.07))
    machine = read_chair("wheelchair")
    tracks = machine.tracks
    pen.line([(-0.9, 0.0), (1.1, 0.0)], GREY)
    draw_chair(pen, machine)
    mark_linkage(pen, machine, 0.0, 0.0)
    draw_payload(pen, machine)
    draw_view_of_camera(pen, machine)
    rear, front, nose = (tuple(centre) for centre in pulley_centres(machine).tolist())
    pen.dimension((rear[0], 0.0), (front[0], 0.0), f"flat run {tracks.flat_run_m:g} m", -0.1)
    pen.line([front, (front[0] + 0.40, front[1])], BLUE, 0.8, ":")
    pen.angle(front, 0.30, 0.0, tracks.approach_angle_deg, f"{tracks.approach_angle_deg:g}°")
    pen.dimension(front, nose, f"{tracks.approach_m:g} m", -0.30)
    pen.text((-0.68, -0.20), f"gauge {tracks.gauge_m:g} m (Table I)", size=9.5, colour=BLUE)
    pen.pointer((-0.62, 0.40), (-0.36, 0.20), f"chassis {machine.masses.chassis_kg:g} kg", "right")
    hinge = machine.levelled_seat.hinge_m
    pen.pointer((-0.40, 0.58), (hinge[0] - 0.13, hinge[2] + 0.06), "seat: hinge, bar and slider\n(Fig. 4)", "right")
    pen.pointer((0.84, 0.45), (nose[0] + 0.01, nose[1] + 0.03), "nose pulley", "left")
    return figure


def stair() -> Figure:
    """Return Fig. 3: the stair, and the track over its nosings."""
    figure, (left, right) = sheet(8.0, 3.0, 2)
    rise = RUN_M * math.tan(SLOPE_RAD)
    _steps(left, 4, rise)
    left.frame((-0.50, 1.26), (-0.26, 0.86))
    left.dimension((RUN_M, rise), (RUN_M, 2 * rise), "h", -0.07)
    left.dimension((2 * RUN_M, 3 * rise), (3 * RUN_M, 3 * rise), "w", -0.07)
    left.line([(-RUN_M, 0.0), (3.4 * RUN_M, 4.4 * rise)], ORANGE, 1.2, "--")
    left.angle((-RUN_M, 0.0), 0.17, 0.0, FIG11_SLOPE_DEG, "β")
    left.text((0.22, 0.62), "nosing plane", size=9.5, colour=AMBER)
    left.text((0.38, -0.18), "(a) a stair of height h and width w")

    machine = read_chair("wheelchair")
    _steps(right, 5, rise)
    right.frame((-0.50, 1.72), (-0.33, 1.25))
    middle = np.array([2 * RUN_M, 3 * rise]) + 0.1 * np.array([math.cos(SLOPE_RAD), math.sin(SLOPE_RAD)])
    draw_chair(right, machine, turn_rad=SLOPE_RAD, shift=pair(middle), only=TRACK)
    half = 0.5 * machine.tracks.flat_run_m
    ends = [_place((x, 0.0), middle) for x in (-half, half)]
    right.dimension(ends[0], ends[1], f"L = {machine.tracks.flat_run_m:g} m", -0.22)
    touched = [k for k in range(5) if ends[0][0] <= k * RUN_M <= ends[1][0]]
    for k in touched:
        right.disc((k * RUN_M, (k + 1) * rise), 0.022, RED, RED)
    least = minimum_track_length(rise, RUN_M)
    right.text((0.20, 1.02), f"L > 2√(h² + w²) = {least:.2f} m at {FIG11_SLOPE_DEG:g}°", size=9.5, colour=BLUE)
    right.text((0.6, -0.23), f"(b) the track on {len(touched)} nosings")
    return figure


def seat() -> Figure:
    """Return Fig. 4: the linkage on a stair, the seat horizontal and the seat parallel to the chassis."""
    figure, panels = sheet(8.0, 4.1, 2)
    machine = read_chair("wheelchair")
    linkage = SeatLinkage(machine.levelled_seat)
    cases = ((SLOPE_RAD, "(a) seat horizontal"), (0.0, "(b) seat inclined with the chassis"))
    for pen, (angle, words) in zip(panels, cases, strict=True):
        pen.frame((-0.88, 0.84), (-0.50, 1.0))
        draw_chair(pen, machine, angle, SLOPE_RAD)
        mark_linkage(pen, machine, angle, SLOPE_RAD)
        stroke = linkage.stroke(angle)
        pen.text((0.12, -0.36), f"{words}\nstroke {round(100 * stroke, 1) + 0.0} cm", size=10.0)
        hinge = turned([(machine.levelled_seat.hinge_m[0], machine.levelled_seat.hinge_m[2])], SLOPE_RAD)[0]
        start = (float(hinge[0]), float(hinge[1]))
        pen.line([start, (start[0] + 0.62, start[1])], BLUE, 0.8, ":")
        if angle == 0.0:
            pen.angle(start, 0.33, 0.0, FIG11_SLOPE_DEG, f"{FIG11_SLOPE_DEG:g}°")
        else:
            name_linkage(pen, machine, SLOPE_RAD)
    return figure


def heading() -> Figure:
    """Return Fig. 6: the chair from above, and what two ends of one nosing say about its heading."""
    figure, (pen,) = sheet(8.0, 5.5)
    pen.frame((-1.9, 2.15), (-1.53, 1.26))
    theta = 25.0 * DEG
    for k in range(4):
        pen.line([(-1.35, 0.25 + 0.3 * k), (1.35, 0.25 + 0.3 * k)], GREY, 1.4)
    pen.text((-1.40, 1.15), "nosings", size=9.5, colour=GREY, align="right")
    machine = read_chair("wheelchair")
    camera = (0.0, -0.35)
    x_camera = machine.camera.position_m[0]
    behind = np.array(camera) - x_camera * np.array([-math.sin(theta), math.cos(theta)])
    draw_chair(pen, machine, turn_rad=theta, view=ABOVE, shift=pair(behind))
    across, ahead = np.array([math.cos(theta), math.sin(theta)]), np.array([-math.sin(theta), math.cos(theta)])
    p1, p2 = np.array([-0.75, 0.55]), np.array([0.55, 0.55])
    corner = p1 + across * float((p2 - p1) @ across)
    for point in (p1, p2):
        foot = point - ahead * float((point - camera) @ ahead)
        pen.line(np.array([foot, point]), GREEN, 1.0, "--")
    pen.line(np.array([-across, across]) * 0.95 + camera, GREEN, 0.8, ":")
    pen.text(pair(p1 - ahead * 0.42), "D₁", colour=GREEN)
    pen.text(pair(p2 - ahead * 0.36), "D₂", colour=GREEN)
    pen.dimension(pair(p1), pair(corner), "ΔX")
    pen.arrow(pair(corner), pair(p2), RED, "<|-|>")
    pen.text(pair(0.5 * (corner + p2) + across * 0.14), "ΔD", colour=RED)
    for point, name, shift in ((p1, "P₁", (-0.09, 0.08)), (p2, "P₂", (0.10, -0.09))):
        pen.disc(pair(point), 0.025, INK)
        pen.text((float(point[0]) + shift[0], float(point[1]) + shift[1]), name)
    pen.angle(pair(p1), 0.42, 0.0, 25.0, "θ", AMBER)
    pen.disc(camera, 0.05, INK)
    pen.arrow(camera, pair(np.array(camera) + ahead * 0.5), INK)
    pen.line([camera, (0.0, 0.2)], ORANGE, 1.0, ":")
    pen.angle(camera, 0.36, 90.0, 115.0, "θ", AMBER)
    pen.pointer((0.62, -0.42), (0.04, -0.36), "camera", "left")
    pen.arrow((-1.4, -1.15), (-1.4, -0.8), GREY)
    pen.text((-1.4, -0.73), "x, up the flight", size=9.0, colour=GREY)
    pen.arrow((-1.4, -1.15), (-1.75, -1.15), GREY)
    pen.text((-1.81, -1.15), "y", size=9.0, colour=GREY)
    said = "θ = atan2(-ΔD, ΔX)\npositive anticlockwise\nas printed, Eq. (2): cos⁻¹(ΔD/ΔX),\n90° for a chair that stands square"
    pen.text((0.90, -1.0), said, size=9.5, align="left")
    return figure


def _steps(pen: Pen, count: int, rise: float) -> None:
    points: list[Point] = [(-0.45, 0.0), (0.0, 0.0)]
    for k in range(count):
        points += [(k * RUN_M, (k + 1) * rise), ((k + 1) * RUN_M, (k + 1) * rise)]
    low = -0.06
    pen.area([*points, (count * RUN_M, low), (-0.45, low)], STONE)


def _place(point: Point | Float[np.ndarray, " 2"], origin: Float[np.ndarray, " 2"]) -> Point:
    return pair(turned([(float(point[0]), float(point[1]))], SLOPE_RAD)[0] + origin)


DRAWINGS: dict[str, Callable[[], Figure]] = {
    "fig01-chair": chair,
    "fig02-scheme": scheme,
    "fig03-stair": stair,
    "fig04-seat": seat,
    "fig06-heading": heading,
    "fig07-nodes": nodes,
}


def write_drawings(folder: Path) -> list[Path]:
    """Write every drawing as SVG and return the paths."""
    paths = []
    for name, draw in DRAWINGS.items():
        path = folder / f"{name}.svg"
        write_whole(path, '<?xml version="1.0" encoding="utf-8"?>\n' + svg_of(draw()))
        paths.append(path)
    return paths
