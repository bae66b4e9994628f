"""Belts, lugs, pulleys and flipper: ``chair, lug profile, belt travel -> meshes and lug poses``.

The closed path of a belt's outline around its pulleys follows the plant's lug model: arc length σ = 0 is mid-track on the flat run,
and σ grows in the direction in which the belt moves while the chair drives forward, rearward on the flat run. The outline runs
through the lugs' tips. On a chair with a flipper the belt runs along the flipper and back: it wraps the front pulley on the convex
side, and bends around a small idler on the concave side, drawn as a corner.
"""

import math
from dataclasses import replace
from itertools import pairwise
from typing import Any, Literal

import numpy as np
from jaxtyping import Float

from treadline.core.rotations import rotation_y
from treadline.scenario.chair import ChairDescription, Tracks
from treadline.scenario.scenario import LUGS_MM, Belts
from treadline.vehicle.appearance._mesh import (
    BodyName,
    Mesh,
    MeshPart,
    Outline,
    band,
    box,
    capsule,
    cylinder,
    extrusion,
    lathe,
    part,
)
from treadline.vehicle.bodies import sides
from treadline.vehicle.tracks import Section, pulley_centres, road_wheels, sections

BELT_SHARE = 0.1
"""Thickness of the belt below the lugs over the pulleys' radius (drawn only)."""
ARC_POINTS = 13
"""Points of each half circle of a belt."""
LUG_SIDE_M = 0.004
"""Distance of a lug's end from the edge of the belt [m] (drawn only)."""


class BeltPath:
    """Straight lines and arcs of a belt's outline in the plane (x, z) of B.

    Args:
        chair: Chair with its pulleys.
        flipper_rad: Angle of the flipper; None, or a chair without flipper: the approach angle.
    """

    def __init__(self, chair: ChairDescription, flipper_rad: float | None = None) -> None:
        tracks = chair.tracks
        rest = math.radians(tracks.approach_angle_deg)
        angle = rest if flipper_rad is None or chair.flipper is None else flipper_rad
        run, out, r = tracks.flat_run_m, tracks.approach_m, tracks.pulley_radius_m
        # Each piece: length, curvature (negative to the right), and turn in place before the piece.
        pieces = (_around_three if chair.flipper is None else _along_flipper)(run, out, r, angle)
        starts: list[tuple[float, float, float, float, float]] = []
        sigma, x, z, heading = 0.0, 0.0, 0.0, math.pi
        for length, curvature, corner in pieces:
            heading += corner
            starts.append((sigma, x, z, heading, curvature))
            x, z, heading = map(float, _advanced(x, z, heading, curvature, length))
            sigma += length
        self._starts = np.array(starts)
        self.length_m = sigma
        """Length of the outline [m]."""

    def at(self, sigma_m: Float[np.ndarray, " n"]) -> tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, " n"]]:
        """Return points (x, z) and directions of motion at arc lengths.

        Returns:
            Points in B [m], and the angle of the belt's direction of motion from x towards z [rad].
        """
        wrapped = np.mod(sigma_m, self.length_m)
        s0, x0, z0, heading, curvature = self._starts[np.searchsorted(self._starts[:, 0], wrapped, side="right") - 1].T
        x, z, turned = _advanced(x0, z0, heading, curvature, wrapped - s0)
        return np.column_stack([x, z]), turned


def _around_three(run: float, out: float, r: float, angle: float) -> list[tuple[float, float, float]]:
    """Return the pieces of a belt over rear, front and nose pulley."""
    across, up = run + out * math.cos(angle), out * math.sin(angle)
    upper = math.atan2(up, across)
    return [
        (0.5 * run, 0.0, 0.0),
        (r * (math.pi - upper), -1.0 / r, 0.0),
        (math.hypot(across, up), 0.0, 0.0),
        (r * (math.pi + upper - angle), -1.0 / r, 0.0),
        (out, 0.0, 0.0),
        (r * angle, -1.0 / r, 0.0),
        (0.5 * run, 0.0, 0.0),
    ]


def _along_flipper(run: float, out: float, r: float, angle: float) -> list[tuple[float, float, float]]:
    """Return the pieces of a belt over rear and front pulley and along a flipper."""
    cut = r * math.tan(0.5 * abs(angle))
    half, half_turn, wrap = (0.5 * run, 0.0, 0.0), (math.pi * r, -1.0 / r, 0.0), (r * abs(angle), -1.0 / r, 0.0)
    if angle >= 0.0:
        return [half, half_turn, (run - cut, 0.0, 0.0), (out - cut, 0.0, angle), half_turn, (out, 0.0, 0.0), wrap, half]
    beneath = [(out - cut, 0.0, 0.0), (0.5 * run - cut, 0.0, -angle)]
    return [half, half_turn, (run, 0.0, 0.0), wrap, (out, 0.0, 0.0), half_turn, *beneath]


def _advanced(x: Any, z: Any, heading: Any, curvature: Any, length: Any) -> tuple[Any, Any, Any]:
    """Return places and directions after a length of line or arc; numbers, or arrays of one length."""
    turned = heading + curvature * length
    # The chord of an arc has the mean direction, and its length by sin(x)/x.
    chord = length * np.sinc(0.5 * curvature * length / math.pi)
    middle = 0.5 * (heading + turned)
    return x + chord * np.cos(middle), z + chord * np.sin(middle), turned


def lug_profile(belts: Belts | None) -> tuple[float, float, float, float]:
    """Return height, pitch, tip width and flank length of the drawn lugs [m].

    A smooth belt is drawn with the pitch of its settings and the height of the lowest named profile: without lugs its motion is
    invisible.
    """
    height, pitch, tip, flank = (Belts() if belts is None else belts).measures_m
    return height or 1e-3 * LUGS_MM["8/60"][0], pitch, tip, flank


def lug_part(chair: ChairDescription, belts: Belts | None = None) -> MeshPart:
    """Return the mesh of one lug in its own frame: x along the belt's motion, z outwards, origin in the middle of the tip.

    ``lug_poses`` returns the poses of this frame in B.
    """
    height, _, tip, flank = lug_profile(belts)
    top, foot, depth = 0.5 * max(tip, 0.002), 0.5 * tip + flank, height + 0.001
    outline = np.array([(-foot, -depth), (foot, -depth), (top, 0.0), (-top, 0.0)])
    half_width = 0.5 * chair.tracks.belt_width_m - LUG_SIDE_M
    return part("lug", "chair", [extrusion(outline, -half_width, half_width)], "lug")


def lug_poses(
    chair: ChairDescription,
    side: Literal["left", "right"],
    travel_m: float,
    flipper_rad: float | None = None,
    belts: Belts | None = None,
) -> Float[np.ndarray, "n 4 4"]:
    """Return the poses of a belt's lugs in B after a distance of belt travel.

    The spacing is the belt's length divided by the nearest whole number of lug pitches, so that it differs from the pitch by at
    most one part in twice the number of lugs. The number does not depend on the flipper angle. Lug 0 is at mid-track for zero
    travel, as in the plant's lug model.

    Args:
        travel_m: Distance travelled by the belt's surface, positive while driving forward.
        flipper_rad: Angle of the flipper; None, or a chair without flipper: the approach angle.
        belts: Lug profile; None: a smooth belt, see ``lug_profile``.
    """
    count = round(BeltPath(chair).length_m / lug_profile(belts)[1])
    path = BeltPath(chair, flipper_rad)
    points, heading = path.at(travel_m + path.length_m / count * np.arange(count))
    c, s = np.cos(heading), np.sin(heading)
    poses = np.zeros((count, 4, 4))
    # The belt runs clockwise in (x, z): outwards is to the left of the motion.
    poses[:, 0, 0], poses[:, 2, 0] = c, s
    poses[:, 1, 1] = 1.0
    poses[:, 0, 2], poses[:, 2, 2] = -s, c
    poses[:, 0, 3], poses[:, 2, 3] = points.T
    poses[:, 1, 3] = dict(sides(chair.tracks))[side]
    poses[:, 3, 3] = 1.0
    return poses


def resting_lugs(chair: ChairDescription, belts: Belts | None = None) -> tuple[MeshPart, ...]:
    """Return all lugs at zero travel and rest angle as parts of chassis and flipper, for files without moving belts."""
    lug = lug_part(chair, belts)
    mesh = Mesh(vertices=lug.vertices_m.astype(float), faces=lug.faces)
    axis = np.array([0.5 * chair.tracks.flat_run_m, 0.0, chair.tracks.pulley_radius_m])
    R_flipper = rotation_y(-math.radians(chair.tracks.approach_angle_deg))
    fixed: list[Mesh] = []
    turning: list[Mesh] = []
    for side in ("left", "right"):
        for X in lug_poses(chair, side, 0.0, belts=belts):
            p_flipper = R_flipper.T @ (X[:3, 3] - axis)
            if chair.flipper is None or p_flipper[0] <= 0.0:
                fixed.append(mesh.moved(X[:3, 3], X[:3, :3]))
            else:
                turning.append(mesh.moved(p_flipper, R_flipper.T @ X[:3, :3]))
    parts = (part("lugs", "chair", fixed, "lug"),)
    return (*parts, part("flipper_lugs", "flipper", turning, "lug")) if turning else parts


def track_parts(chair: ChairDescription, belts: Belts | None = None) -> tuple[MeshPart, ...]:
    """Return belts, pulleys and track frames of both sides, and the flipper."""
    tracks, height = chair.tracks, lug_profile(belts)[0]
    r, out = tracks.pulley_radius_m, tracks.approach_m
    surface = r - height
    wheel = surface - BELT_SHARE * r
    fixed = chair.flipper is None
    further = [mesh for section in sections(chair)[2:] for mesh in _section_parts(section, height)]
    pulleys = [(x, z) for x, z in pulley_centres(chair).tolist()][: 3 if fixed else 2]
    loops = _around(pulleys, [surface] * len(pulleys)), _around(pulleys, [wheel] * len(pulleys))
    strips = _tip(out, surface), _tip(out, wheel)
    parts = [part(f"belt_{side}", "chair", [band(*loops, *_across(tracks, y), closed=True)], "belt") for side, y in sides(tracks)]
    parts += _running_gear(tracks, "chair", pulleys, wheel)
    half = 0.5 * (tracks.gauge_m - 0.4 * tracks.belt_width_m)
    axles = [cylinder((x, -half, z), (x, half, z), 0.17 * wheel, sides=10) for x, z in pulleys]
    parts.append(part("axles", "chair", axles, "drive"))
    if fixed:
        return (*parts, *further)
    for side, y in sides(tracks):
        parts.append(part(f"flipper_belt_{side}", "flipper", [band(*strips, *_across(tracks, y), closed=False)], "belt"))
    parts += _running_gear(tracks, "flipper", [(0.0, 0.0), (out, 0.0)], wheel, levers=True)
    return (*parts, *further)


def _section_parts(section: Section, height: float) -> list[MeshPart]:
    """Return belts, pulleys and frame of a further section of the belts, on its own body or on the chassis."""
    shown = section if section.motor is None else replace(section, start_m=(0.0, 0.0), stays_rad=0.0, follows=False)
    body = "chair" if section.motor is None else section.name
    axes, surfaces = [shown.start_m, shown.end_m(0.0)], [radius - height for radius in section.radii_m]
    wheels = [surface - BELT_SHARE * radius for surface, radius in zip(surfaces, section.radii_m, strict=True)]
    half = 0.5 * section.width_m
    belts: list[Mesh] = []
    pulleys: list[Mesh] = []
    bars: list[Mesh] = []
    for y in (0.5 * section.gauge_m, -0.5 * section.gauge_m):
        belts.append(band(_around(axes, surfaces), _around(axes, wheels), y - half, y + half, closed=True))
        pulleys += [_pulley((x, y, z), wheel, half) for (x, z), wheel in zip(axes, wheels, strict=True)]
        (x0, z0), (x1, z1) = axes
        bars += [capsule((x0, y + off, z0), (x1, y + off, z1), 0.22 * min(wheels), sides=6) for off in (-0.62 * half, 0.62 * half)]
    drawn = (("belt", belts, "belt"), ("pulleys", pulleys, "wheel"), ("frame", bars, "flipper" if section.motor else "frame"))
    return [part(f"{section.name}_{name}", body, meshes, painted) for name, meshes, painted in drawn]


def _around(axes: list[tuple[float, float]], radii: list[float]) -> Outline:
    """Return the outline of a belt around two or three pulleys, anticlockwise."""
    straights = list(zip(axes, [*axes[1:], axes[0]], radii, [*radii[1:], radii[0]], strict=True))
    # Normals of the straight parts, outwards, each from an axis to the next.
    normals = [
        math.atan2(z1 - z0, x1 - x0) - math.acos(max(-1.0, min(1.0, (r0 - r1) / math.dist((x0, z0), (x1, z1)))))
        for (x0, z0), (x1, z1), r0, r1 in straights
    ]
    outline = []
    for (x, z), r, start, end in zip(axes, radii, [normals[-1], *normals], normals, strict=False):
        arc = start + (end - start) % (2.0 * math.pi) * np.linspace(0.0, 1.0, ARC_POINTS)
        outline.append(np.column_stack([x + r * np.cos(arc), z + r * np.sin(arc)]))
    return np.concatenate(outline)


def _across(tracks: Tracks, y: float) -> tuple[float, float]:
    """Return the lateral extent of a belt."""
    return y - 0.5 * tracks.belt_width_m, y + 0.5 * tracks.belt_width_m


def _tip(out: float, radius: float) -> Outline:
    """Return the line of the flipper's belt around the nose pulley, from below the axis of the front pulley to above it."""
    arc = np.linspace(-0.5 * math.pi, 0.5 * math.pi, ARC_POINTS)
    around = np.column_stack([out + radius * np.cos(arc), radius * np.sin(arc)])
    return np.concatenate([[(0.0, -radius)], around, [(0.0, radius)]])


def _running_gear(
    tracks: Tracks, body: BodyName, pulleys: list[tuple[float, float]], wheel: float, *, levers: bool = False
) -> list[MeshPart]:
    """Return pulleys, road wheels and frame bars of one body, both sides."""
    first, last = pulleys[0], pulleys[-1]
    wheels: list[Mesh] = []
    bars: list[Mesh] = []
    width = 0.5 * tracks.belt_width_m
    for _, y in sides(tracks):
        shown = pulleys[1:] if levers else pulleys
        wheels += [_pulley((x, y, z), wheel, width) for x, z in shown]
        bars += [
            capsule((a[0], y + sign * 0.62 * width, a[1]), (b[0], y + sign * 0.62 * width, b[1]), 0.22 * wheel, sides=6)
            for a, b in pairwise(pulleys)
            for sign in (-1.0, 1.0)
        ]
        if not levers:
            small = 0.42 * wheel
            low = first[1] - wheel + small
            wheels += [
                cylinder((x, y - 0.8 * width, low), (x, y + 0.8 * width, low), small, sides=10)
                for x in road_wheels(tracks)[0][1:-1]
            ]
    if levers:
        bars.append(box((0.62 * last[0], 0.0, last[1]), (0.05, tracks.gauge_m - tracks.belt_width_m, 0.02)))
    prefix = "flipper" if levers else "track"
    return [
        part(f"{prefix}_pulleys", body, wheels, "wheel"),
        part(f"{prefix}_frame", body, bars, "flipper" if levers else "frame"),
    ]


def _pulley(centre: tuple[float, float, float], radius: float, half_width: float) -> Mesh:
    """Return a pulley with a recessed web and a hub."""
    x, y, z = centre
    w = 0.94 * half_width
    profile = [(-0.55 * w, 0.28), (-0.55 * w, 0.78), (-w, 0.84), (-w, 1.0), (w, 1.0), (w, 0.84), (0.55 * w, 0.78), (0.55 * w, 0.28)]
    hub = [(-0.9 * w, 0.22), (-0.9 * w, 0.28), *profile, (0.9 * w, 0.28), (0.9 * w, 0.22)]
    return lathe((x, y, z), (x, y + 1.0, z), [(along, share * radius) for along, share in hub], sides=18)
