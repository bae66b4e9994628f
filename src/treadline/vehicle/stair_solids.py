"""Stair as solids: floor, treads, landings, walls and newel as boxes, nosings as round bars: ``Staircase -> Box, Solid``."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import get_args

import numpy as np
from jaxtyping import Float

from treadline.core.rotations import Rotation, Vector3, rotation_y, rotation_z
from treadline.scenario.chair import Point
from treadline.scenario.flight import Side
from treadline.vehicle.flight_plan import FlightPlan
from treadline.vehicle.staircase import Relief, Staircase, Step, Winders

TREAD_THICKNESS_M = 0.04
"""Thickness of an open-riser tread [m]."""
WALL_HEIGHT_M = 2.2
"""Height of the walls above the steps [m]."""
FLOOR_LENGTH_M = 6.0
"""Length of the floor before the first step [m]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Box:
    """Solid box, rotated about the vertical by ``yaw_rad``, its front lowered by ``pitch_rad``."""

    kind: str
    """Kind: ``floor``, ``step`` (a tread, with its riser unless it overhangs), ``riser`` (under an overhanging tread), ``landing``,
    ``sill`` (part of a floor with sills, or of a landing behind its first sill) or ``wall``."""
    index: int = -1
    """Index of the step; -1 for other boxes."""
    centre_W: Point
    half_m: Point
    """Half extents along the box's own axes."""
    yaw_rad: float = 0.0
    pitch_rad: float = 0.0

    @property
    def R_WK(self) -> Rotation:
        """Rotation of the box K in the world."""
        return rotation_z(self.yaw_rad) @ rotation_y(-self.pitch_rad) if self.pitch_rad else rotation_z(self.yaw_rad)


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


def stair_boxes(staircase: Staircase) -> tuple[Box, ...]:
    """Return the solids with sharp front edges: floor, steps, landings, walls.

    The plant rounds the nosings off; the camera draws them with these sharp edges.
    """
    frames = [staircase.flight_frame(k) for k in range(len(staircase.plans))]
    treads = [_placed(box, *frame) for k, frame in enumerate(frames) for box in _treads(staircase, k)]
    walls = [_placed(box, *frame) for k, frame in enumerate(frames) for box in _walls(staircase, k)]
    return (*_floor(staircase, treads), *treads, *walls, *landing_walls(staircase))


def landing_walls(staircase: Staircase) -> tuple[Box, ...]:
    """Return the walls at the sides of landings, open where the next flight leaves."""
    walls = []
    for k, (plan, steps) in enumerate(zip(staircase.plans, staircase.flights, strict=True)):
        is_last, whole = k + 1 == len(staircase.plans), [(plan.right_m, plan.left_m)]
        parts = [(side, part) for side in plan.walls for part in (whole if is_last else plan.closed(side, staircase.width_m))]
        walls += [_placed(_wall_of(plan, steps[-1], *part), *staircase.flight_frame(k)) for part in parts]
    return tuple(walls)


def landing_sides(staircase: Staircase) -> list[tuple[Float[np.ndarray, "2 3"], float]]:
    """Return the ends of the sides of the landings on which the stair turns, in W, and by how much each rises [m].

    Sides are edges and the nosing of the flight below, which do not rise, walls, and the riser at the next flight's foot.
    """
    sides = []
    for k, (plan, steps) in enumerate(zip(staircase.plans[:-1], staircase.flights, strict=False)):
        if not plan.turn_rad or staircase.winders is not None:
            continue
        R_WF, p_WF = staircase.flight_frame(k)
        aside_m = {"left": plan.left_m, "right": plan.right_m}
        found = [
            (np.array([[0.0, plan.right_m], [0.0, plan.left_m]]), 0.0),
            (plan.foot(staircase.width_m), staircase.flights[k + 1][0].rise_m),
        ]
        for side in get_args(Side):
            for part in plan.closed(side, staircase.width_m):
                pair = [(plan.depth_m, at) if side == "far" else (at, aside_m[side]) for at in part]
                found.append((np.array(pair), WALL_HEIGHT_M if side in plan.walls else 0.0))
        for along, height_m in found:
            ends_F = np.array([steps[-1].x_m, 0.0, steps[-1].z_m]) + np.column_stack([along, np.zeros(2)])
            sides.append((p_WF + ends_F @ R_WF.T, height_m))
    return sides


def _wall_of(plan: FlightPlan, landing: Step, side: str, part_m: tuple[float, float]) -> Box:
    """Return the wall at a part of a landing's side, in F."""
    middle_m, half_m, half_height = 0.5 * sum(part_m), 0.5 * (part_m[1] - part_m[0]), 0.5 * WALL_HEIGHT_M
    aside_m = {"left": plan.left_m + 0.05, "right": plan.right_m - 0.05}
    place = (plan.depth_m + 0.05, middle_m) if side == "far" else (middle_m, aside_m[side])
    size = (0.05, half_m, half_height) if side == "far" else (half_m, 0.05, half_height)
    return Box(kind="wall", centre_W=(landing.x_m + place[0], place[1], landing.z_m + half_height), half_m=size)


def _floor(staircase: Staircase, treads: Sequence[Box]) -> list[Box]:
    """Return the floor before the stair; below an open flight, through which a camera sees it, it goes on."""
    ends_m = (box.centre_W[0] + math.hypot(*box.half_m[:2]) for box in treads)
    under_m = max(ends_m) if staircase.open_risers else 0.5
    whole = Box(
        kind="floor",
        centre_W=(0.5 * (under_m - 0.5 - FLOOR_LENGTH_M), 0.0, -0.1),
        half_m=(0.5 * (FLOOR_LENGTH_M + 0.5 + under_m), 0.5 * staircase.width_m + 2.0, 0.1),
    )
    relief = staircase.reliefs.get(None)
    if relief is None:
        return [whole]
    slabs = _slabs(whole, ((-under_m, 0.0), *relief[1:]), relief[-1][0] + FLOOR_LENGTH_M)
    return [_placed(slab, rotation_z(math.pi), np.zeros(3)) for slab in slabs]


def _slabs(ground: Box, relief: Relief, end_m: float) -> list[Box]:
    """Return a slab under each piece of an outline up to ``end_m``, x away from the flight, as wide and thick as ``ground``."""
    _, half_width, half_m = ground.half_m
    slabs = []
    for (x_m, z_m), (next_m, next_z_m) in itertools.pairwise((*relief, (end_m, relief[-1][1]))):
        rising = math.atan2(next_z_m - z_m, next_m - x_m)
        along_m, up_m = 0.5 * (x_m + next_m) + half_m * math.sin(rising), 0.5 * (z_m + next_z_m) - half_m * math.cos(rising)
        size_m = (0.5 * math.hypot(next_m - x_m, next_z_m - z_m), half_width, half_m)
        slab = Box(kind="sill", index=ground.index, centre_W=(along_m, 0.0, up_m), half_m=size_m, pitch_rad=rising)
        slabs += [slab] * (next_m > x_m)
    return slabs


def stair_solids(staircase: Staircase) -> tuple[Solid, ...]:
    """Return the staircase as solids with rounded nosings, floor and walls included."""
    return tuple(
        _rounded(box, staircase.steps[box.index].nosing_radius_m) if box.kind in ("step", "landing") else Solid(box=box)
        for box in stair_boxes(staircase)
    )


def stair_surfaces(staircase: Staircase) -> Float[np.ndarray, "N 8"]:
    """Return the tops of floor, treads and landings.

    Columns: centre x, y, cosine and sine of the yaw, half length and width in the plan, height of the centre, rise per metre.
    """
    boxes = [box for box in stair_boxes(staircase) if box.kind not in ("wall", "riser")]
    return np.array([_top(box, np.array(box.centre_W) + box.half_m[2] * box.R_WK[:, 2]) for box in boxes])


def bearing_edges(staircase: Staircase) -> Float[np.ndarray, "N 4"]:
    """Return what belts can stand on at mid-width: the axes of the rounded nosings, and the upper edges of sills.

    Columns: place in W, radius of the rounding [m].
    """
    solids = stair_solids(staircase)
    bars, sills = [one.nosing for one in solids if one.nosing is not None], [one.box for one in solids if one.box.kind == "sill"]
    edges = [box.centre_W + box.R_WK @ (end * box.half_m[0], 0.0, box.half_m[2]) for box in sills for end in (-1.0, 1.0)]
    middles = [0.5 * (np.array(bar.left_W) + np.array(bar.right_W)) for bar in bars]
    radii = [bar.radius_m for bar in bars] + [0.0] * len(edges)
    return np.column_stack([np.array(middles + edges).reshape(-1, 3), radii])


def _top(box: Box, centre_W: Vector3) -> tuple[float, ...]:
    (half_length, half_width, _), level = box.half_m, math.cos(box.pitch_rad)
    x, y, z = centre_W.tolist()
    return x, y, math.cos(box.yaw_rad), math.sin(box.yaw_rad), half_length * level, half_width, z, math.tan(box.pitch_rad)


def ground_m(surfaces: Float[np.ndarray, "N 8"], points_W: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
    """Return the height of the highest floor, tread or landing not above each point [m]; -inf where there is none.

    Args:
        surfaces: Tops as ``stair_surfaces`` returns them.
    """
    x, y, c, s, half_length, half_width, middle_m, rising = surfaces.T
    dx, dy = points_W[:, :1] - x, points_W[:, 1:2] - y
    along = dx * c + dy * s
    height = middle_m + rising * along
    below = (np.abs(along) <= half_length) & (np.abs(dy * c - dx * s) <= half_width) & (height <= points_W[:, 2:])
    return np.asarray(np.where(below, height, -np.inf).max(axis=1))


def _treads(staircase: Staircase, flight: int) -> list[Box]:
    """Return the steps of a flight, winders included, and its landing, in F."""
    steps, winders = staircase.flights[flight], staircase.winders
    plan, half_width = staircase.plans[flight], 0.5 * staircase.width_m
    goes_on = flight + 1 < len(staircase.plans) and not plan.turn_rad
    above: tuple[Step | None, ...] = (*steps[1:], staircase.flights[flight + 1][0] if goes_on else None)
    boxes: list[Box] = []
    for step, after in zip(steps, above, strict=True):
        if step.missing:
            continue
        if winders is not None and winders.holds(step.index):
            boxes += _winder(staircase, winders, step)
        elif after is None:
            boxes += _landing(staircase, plan, step, plan.depth_m)
        elif step is steps[-1]:
            boxes += _landing(staircase, plan, step, step.depth_m + _under(staircase, step, after))
        else:
            boxes += _tread(staircase, step, step.depth_m + _under(staircase, step, after), "step", half_width)
    return boxes


def _landing(staircase: Staircase, plan: FlightPlan, step: Step, depth_m: float) -> list[Box]:
    """Return the boxes of a landing up to its first sill, and the slabs behind, in F."""
    half_width, relief = 0.5 * (plan.left_m - plan.right_m), staircase.reliefs.get(step.index)
    step = _aside(step, 0.5 * (plan.left_m + plan.right_m))
    if relief is None:
        return _tread(staircase, step, depth_m, "landing", half_width)
    before = _tread(staircase, step, relief[1][0], "landing", half_width)
    tilted = rotation_z(step.yaw_rad) @ rotation_y(-step.tread_slope_rad)
    slabs = [_placed(slab, tilted, step.nosing_F) for slab in _slabs(before[0], relief[1:], depth_m)]
    return [*before, *(replace(slab, pitch_rad=slab.pitch_rad + step.tread_slope_rad) for slab in slabs)]


def _under(staircase: Staircase, step: Step, after: Step) -> float:
    """Return the length of a tread under the next step [m], so that a rotated nosing leaves no gap."""
    if staircase.open_risers:
        return 0.03
    turned_m = 0.5 * staircase.width_m * abs(math.tan(after.yaw_rad) - math.tan(step.yaw_rad))
    return max(0.10, turned_m + 0.01) + after.overhang_m


def _winder(staircase: Staircase, winders: Winders, step: Step) -> list[Box]:
    """Return the boxes that cover a winder's wedge; what they cover beyond it lies under the next steps or in the newel."""
    into_newel_m = winders.newel_m * (1.0 - math.cos(winders.step_rad))
    inward = _aside(step, 0.5 * into_newel_m * winders.side)
    # Jitter turns two nosings apart: the winder reaches under the next step beyond its wedge.
    after = staircase.steps[step.index + 1]
    design_rad = winders.step_rad if winders.holds(after.index) else -winders.nosing(winders.count - 1)[2]
    turned_m = 0.5 * staircase.width_m * abs(math.tan(after.yaw_rad - step.yaw_rad - design_rad))
    depth_m = winders.depth_m + (max(0.10, turned_m + 0.01) + after.overhang_m)
    return _tread(staircase, inward, depth_m, "step", 0.5 * (staircase.width_m + into_newel_m))


def _aside(step: Step, aside_m: float) -> Step:
    """Return a step with its middle moved along its nosing, positive to the left."""
    return replace(step, x_m=step.x_m - aside_m * math.sin(step.yaw_rad), y_m=step.y_m + aside_m * math.cos(step.yaw_rad))


def _tread(staircase: Staircase, step: Step, depth_m: float, kind: str, half_width: float) -> list[Box]:
    """Return the box of a step, or a slab and the riser below an overhanging tread."""
    whole_m = step.rise_m + 0.10
    if staircase.open_risers:
        return [_behind_nosing(step, kind, half_width, depth_m, 0.0, (0.0, TREAD_THICKNESS_M))]
    if step.overhang_m == 0.0:
        return [_behind_nosing(step, kind, half_width, depth_m, 0.0, (0.0, whole_m))]
    slab_m = max(TREAD_THICKNESS_M, 2.0 * step.nosing_radius_m)
    slab = _behind_nosing(step, kind, half_width, depth_m, 0.0, (0.0, slab_m))
    lower = (slab_m, max(whole_m, slab_m + 0.01))
    return [slab, _behind_nosing(step, "riser", half_width, depth_m, step.overhang_m, lower)]


def _behind_nosing(step: Step, kind: str, half_width: float, depth_m: float, front_m: float, depths_m: tuple[float, float]) -> Box:
    """Return a box between two depths below a tread, from ``front_m`` to ``depth_m`` behind the nosing, in F."""
    c, s = math.cos(step.tread_slope_rad), math.sin(step.tread_slope_rad)
    upper_m, lower_m = depths_m
    half_depth, half_height = 0.5 * (depth_m - front_m), 0.5 * (lower_m - upper_m)
    along, below = front_m + half_depth, upper_m + half_height
    forward = along * c + below * s
    x_m, y_m = step.x_m + forward * math.cos(step.yaw_rad), step.y_m + forward * math.sin(step.yaw_rad)
    return Box(
        kind=kind,
        index=step.index,
        centre_W=(x_m, y_m, step.z_m + along * s - below * c),
        half_m=(half_depth, half_width, half_height),
        yaw_rad=step.yaw_rad,
        pitch_rad=step.tread_slope_rad,
    )


def _walls(staircase: Staircase, flight: int) -> list[Box]:
    """Return the walls next to a flight; floor and landings are open, so that a chair can turn."""
    steps, winders = staircase.flights[flight], staircase.winders if flight == 0 else None
    first, last = steps[0], steps[-1] if winders is None else steps[winders.first]
    height_m, half_length = 0.5 * last.z_m + 0.5, 0.5 * (last.x_m - first.x_m)
    straight = [
        Box(
            kind="wall",
            centre_W=(0.5 * (first.x_m + last.x_m), sign * (0.5 * staircase.width_m + 0.05), height_m),
            half_m=(half_length, 0.05, height_m + WALL_HEIGHT_M),
        )
        for sign in _walled_sides(staircase)
        if last.x_m > first.x_m
    ]
    return straight if winders is None else straight + _around(staircase, winders, last.x_m)


def _walled_sides(staircase: Staircase) -> list[float]:
    """Return the sides with a wall: 1 on the left, -1 on the right."""
    return [sign for side, sign in (("left", 1.0), ("right", -1.0)) if staircase.walls in (side, "both")]


def _around(staircase: Staircase, winders: Winders, first_x_m: float) -> list[Box]:
    """Return the newel, a box inscribed in its circle for each winder, and the wall at the outer side of each, in F."""
    top_m, half = staircase.steps[winders.after - 1].z_m, 0.5 * abs(winders.step_rad)
    newel_half_m = 0.5 * (top_m + 1.0)  # the post ends about at the height of a handrail above the last winder
    wall_half_m = 0.5 * (top_m + WALL_HEIGHT_M)
    newel = Box(
        kind="wall",
        centre_W=(0.0, winders.side * winders.walking_radius_m, newel_half_m),
        half_m=(winders.newel_m * math.sin(half), winders.newel_m * math.cos(half), newel_half_m),
        yaw_rad=winders.side * half,
    )
    outside = Box(
        kind="wall",
        centre_W=(0.5 * winders.depth_m, -winders.side * (0.5 * staircase.width_m + 0.05), wall_half_m),
        half_m=(0.5 * winders.depth_m, 0.05, wall_half_m),
    )
    walled = -winders.side in _walled_sides(staircase)
    nosings = [winders.nosing(k) for k in range(winders.count)]
    frames = [(rotation_z(yaw), np.array([first_x_m + x, y, 0.0])) for x, y, yaw in nosings]
    return [_placed(box, *frame) for frame in frames for box in ((newel, outside) if walled else (newel,))]


def _placed(box: Box, R_WF: Rotation, p_WF: Vector3) -> Box:
    """Return a box of one flight in the world."""
    x, y, z = p_WF + R_WF @ np.array(box.centre_W)
    yaw_rad = box.yaw_rad + math.atan2(R_WF[1, 0], R_WF[0, 0])
    return replace(box, centre_W=(float(x), float(y), float(z)), yaw_rad=yaw_rad)


def _rounded(box: Box, radius: float) -> Solid:
    """Return a step with its nosing's bar; the box begins behind the axis of the bar."""
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
