"""Steps in a frame: each edge with its height, its direction and the tread behind it.

A straight flight is a chain of steps with one direction. Where the chain goes on in another one, the flight turns: past a landing,
or on wedge-shaped treads, winders. A vertical surface is a step if it stands on a level in view, or on the step before, and ends a
rise higher, whichever way it faces.
"""

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float

from treadline.core.angles import DEG, to_side, wrap
from treadline.core.arrays import cross
from treadline.core.rotations import Vector3
from treadline.core.step_sizes import RISE_M
from treadline.perception._edge_fit import WARPS_PX, EdgeFit
from treadline.perception._lattice import LEAST_BLOCKS, RISER_GAP_M, RISER_SPREAD, Scene, low_parts, turned_axes
from treadline.perception._lattice_kernels import RISE_IRREGULAR_M, SIGMAS
from treadline.perception._nuisance import SIZES as WARPS
from treadline.perception._nuisance import turns_of_surfaces
from treadline.perception._plane_segmentation import Surface, planes_of, surfaces_along
from treadline.perception._step_parts import EDGE_SIGMA_M, TREAD_SIGMA_M, Axes, Flight, riser_of, riser_rows, viewing_direction
from treadline.perception.free_ground import LEVEL_SIZE_M

StepKind = Literal["step", "winder", "landing", "kerb", "drop"]
"""Kind of a step by its tread: that of a straight flight; a wedge between edges of two directions (winder); one to stand on
(landing); or a single step, up (kerb) or down (drop)."""

TRIALS = np.arange(-90.0, 91.0, 5.0) * DEG
"""Azimuths at which vertical blocks are counted [rad]: within a third of ``RISER_SPREAD`` of any."""
PASSES = 8
"""Largest number of directions of vertical surfaces in a frame: four winders, two walls, a flight, and one more."""
TURNED = 5.0 * DEG
"""Least angle between surfaces of two directions [rad]: winders of a quarter turn differ by 15° at least; winding flights turn by
less per step, all of them."""
MEETING = 0.3
"""Least cosine between the directions of the edges of a wedge-shaped tread: 72°; a quarter turn on one tread is a landing."""
OWN_RAD = 0.3 * DEG
"""Standard deviation of the direction of a step that no other is parallel to [rad]: 5 mm over its width of 1 m, the difference that
building codes allow between steps. The largest warp adds to it: nothing else in view shows its size there."""
AHEAD_M = 0.10
"""Largest distance by which a turned step may begin before the last straight nosing [m]: that of a nosing's overhang and of the
error of its place."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SeenStep:
    """Edge of a step with its tread, in the horizontal plane of the chair: x ahead, y to the left of the chair's origin."""

    kind: StepKind
    height_m: float
    """Height of the edge above the chair's origin [m]; above the camera without a mount."""
    rise_m: float
    """Height above the level before [m]; negative for a drop."""
    edge_m: tuple[tuple[float, float], tuple[float, float]]
    """Left and right end of the visible part of the edge, as seen from before the step [m]."""
    direction_rad: float
    """Rotation of the edge about the vertical [rad]: zero square to the chair, positive anticlockwise seen from above."""
    sigma_rad: float
    """Standard deviation of the direction [rad]."""
    ends_C: tuple[tuple[float, ...], tuple[float, ...]]
    """The same ends in the camera frame [m]."""
    depth_m: tuple[float, float, float] | None = None
    """Distance from the left end, the middle and the right end of the edge to the next one, square to this one [m]; None if no next
    edge, and no end of the tread, is in view."""

    def __str__(self) -> str:
        far_m = 0.5 * (self.edge_m[0][0] + self.edge_m[1][0])
        turned = to_side(self.direction_rad, self.sigma_rad)
        deep = f", {self.depth_m[1]:.2f} m deep" if self.depth_m is not None else ""
        way = "down" if self.rise_m < 0.0 else "up"
        return f"{self.kind} {way} {abs(self.rise_m):.3f} m at {abs(far_m):.2f} m, turned by {turned}{deep}"


@dataclass(frozen=True, slots=True, kw_only=True)
class SeenTurn:
    """Where the steps of a flight go on in another direction."""

    after: int
    """Number of parallel steps before the turn."""
    turn_rad: float
    """Direction of the next step relative to them, positive to the left [rad]."""
    sigma_rad: float
    """Standard deviation of the turn [rad]."""
    on_landing: bool
    """Whether a landing lies between; else winders follow."""

    def __str__(self) -> str:
        turn = to_side(self.turn_rad, self.sigma_rad)
        return f"turns by {turn} after {self.after} step(s) in view, {'on a landing' if self.on_landing else 'on winders'}"


def turn_of(steps: Sequence[SeenStep]) -> SeenTurn | None:
    """Return the first turn of a flight; None if all steps in view are parallel."""
    for after, (one, other) in enumerate(itertools.pairwise(steps), start=1):
        turn_rad, sigma_rad = wrap(other.direction_rad - one.direction_rad), math.hypot(one.sigma_rad, other.sigma_rad)
        if abs(turn_rad) > TURNED:
            return SeenTurn(after=after, turn_rad=turn_rad, sigma_rad=sigma_rad, on_landing=one.kind == "landing")
    return None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Edge:
    """Edge in C before it is a step: its ends, heights and direction."""

    ends: Float[np.ndarray, "2 3"]
    top_m: float
    rise_m: float
    ahead: Vector3
    """Horizontal unit vector in C, square to the edge, up the step."""
    sigma_rad: float
    tread_m: float = 0.0
    """Depth of the tread in view behind the edge [m]."""


def steps_of(scene: Scene, flight: Flight, fit: EdgeFit) -> tuple[SeenStep, ...]:
    """Return the steps of a flight and those that follow in other directions, the lowest of a rising flight first."""
    axes = Axes(ahead=fit.ahead, up=-fit.down, right=fit.edge)
    edges = _straight(scene, flight, fit, axes)
    if flight.direction == "up" and not flight.is_single:
        turned = _turned(scene, flight, fit, axes)
        edges = [edge for edge in edges if not turned or edge.top_m < turned[0].top_m - 0.5 * turned[0].rise_m] + turned
    return _named(scene, edges, flight)


def steps_without_flight(scene: Scene) -> tuple[SeenStep, ...]:
    """Return the steps of a frame without a straight flight, the lowest first: two at least, one on top of the other.

    A single box on the floor is as high as a step.
    """
    edges = _chain(scene, list(_uprights(scene, np.ones(scene.upright.size, dtype=np.bool_))), scene.level.up, [])
    ends_m = [(edge.top_m - edge.rise_m, edge.top_m) for edge in edges]
    limit_m = SIGMAS * EDGE_SIGMA_M
    stacked = [
        any(min(abs(foot_m - above_m), abs(top_m - below_m)) < limit_m for below_m, above_m in ends_m) for foot_m, top_m in ends_m
    ]
    return _named(scene, list(itertools.compress(edges, stacked)), None)


def _named(scene: Scene, edges: list[_Edge], flight: Flight | None) -> tuple[SeenStep, ...]:
    followed = [(edge, after, _depth(edge, after)) for edge, after in zip(edges, [*edges[1:], None], strict=False)]
    return tuple(_step(scene, edge, depth, _kind(flight, edge, after, depth)) for edge, after, depth in followed)


def _straight(scene: Scene, flight: Flight, fit: EdgeFit, axes: Axes) -> list[_Edge]:
    """Return the edges of the flight itself, which are parallel."""
    sign = 1.0 if flight.direction == "up" else -1.0
    tops = [float(nosing.point @ axes.up) for nosing in flight.nosings]
    before = [tops[0] - sign * flight.rise_m, *tops]
    sides = cross(-axes.up, flight.facing)
    far_m = {step: tread.surface.span_m(scene.blocks, axes.ahead)[1] for step, _, tread in flight.matched_treads}
    return [
        _Edge(
            ends=nosing.ends_m(axes.right, sides),
            top_m=top_m,
            rise_m=top_m - low_m,
            ahead=axes.ahead,
            sigma_rad=math.sqrt(float(fit.covariance[0, 0])),
            tread_m=far_m.get(nosing.step, nosing.ahead_m) - nosing.ahead_m,
        )
        for nosing, top_m, low_m in zip(flight.nosings, tops, before, strict=False)
    ]


def _turned(scene: Scene, flight: Flight, fit: EdgeFit, axes: Axes) -> list[_Edge]:
    """Return the steps that follow the flight in another direction, the lowest first; empty if none is in view.

    They lie beyond the last nosing that is parallel to the flight.
    """
    straight = list(itertools.compress(flight.nosings, fit.agrees))
    last, far_m = straight[-1], float(np.mean([nosing.point[2] for nosing in flight.nosings]))
    centres, facing_rad = scene.blocks.centres[scene.upright], _azimuth(scene, axes.ahead)
    is_beyond = centres @ axes.ahead > last.ahead_m - AHEAD_M
    is_above = (centres - last.point) @ axes.up > 0.0
    is_turned = np.abs(scene.azimuth - facing_rad) > TURNED
    tops_m = [float(nosing.point @ axes.up) for nosing in straight]
    lows = list(_uprights(scene, is_beyond & is_above & is_turned))
    return _chain(scene, lows, axes.up, tops_m, flight.rise_m, fit.rotation_rad / far_m**2)


def _chain(
    scene: Scene, lows: list[Surface], up: Vector3, steps_m: list[float], usual_m: float | None = None, turn_rad_m2: float = 0.0
) -> list[_Edge]:
    """Return the steps among some vertical surfaces no higher than a step, the lowest first.

    A step stands on a level in view or on the step before. If that hides its foot, its top is the rise of the flight higher.

    Args:
        steps_m: Heights of the steps before.
        usual_m: Rise of the flight before; None without one.
        turn_rad_m2: Standard deviation of the rotation of its steps, by noise, over the square of their distance.
    """
    rows = riser_rows([riser_of(low, scene.frame.camera) for low in lows], scene.blocks, scene.level, scene.frame.camera)
    steps_m, levels_m = list(steps_m), [float(tread.surface.centre @ up) for tread in scene.treads]
    found: dict[int, tuple[int, _Edge]] = {}
    for k in np.argsort(rows[:, 2]).tolist():
        top_m, top_var, foot_m, foot_var = rows[k, 2:6].tolist()
        rise_m, beneath_m = top_m - foot_m, [*steps_m, *levels_m]
        if not math.isfinite(foot_var) and usual_m is not None:
            foot_m, foot_var, rise_m, beneath_m = top_m - usual_m, top_var, usual_m, steps_m
        limit_m = SIGMAS * math.sqrt(TREAD_SIGMA_M**2 + foot_var + RISE_IRREGULAR_M**2)
        stands = any(abs(foot_m - z_m) < limit_m and z_m - limit_m < float(lows[k].centre @ up) < top_m for z_m in beneath_m)
        if not (stands and math.isfinite(top_var + foot_var) and RISE_M[0] < rise_m < RISE_M[1]):
            continue
        number = next((n for n, (_, edge) in found.items() if abs(edge.top_m - top_m) < 0.5 * RISE_M[0]), len(found))
        if lows[k].blocks.size > found.get(number, (0, None))[0]:
            own_rad = max(OWN_RAD, float(lows[k].centre[2]) ** 2 * turn_rad_m2)
            found[number] = lows[k].blocks.size, _edge_of(scene, lows[k], own_rad, up, top_m, rise_m)
        steps_m.append(top_m)
    return sorted((edge for _, edge in found.values()), key=lambda edge: edge.top_m)


def _uprights(scene: Scene, free: Bool[np.ndarray, " v"]) -> Iterator[Surface]:
    """Yield the vertical surfaces among some blocks that are no higher than a step, whichever way they face.

    The largest surface near the azimuth of most blocks gives the axes in which all that are parallel to it are separated; then the
    next.
    """
    upright, azimuths = scene.upright[free], scene.azimuth[free]
    for _ in range(PASSES):
        near = np.abs(azimuths - TRIALS[:, None]) < RISER_SPREAD
        most = near[int(np.argmax(near.sum(axis=1)))]
        if np.count_nonzero(most) < LEAST_BLOCKS:
            return
        azimuth, near_it = float(np.median(azimuths[most])), most
        planes, counts = planes_of(scene.blocks, upright[most], turned_axes(scene.level, azimuth).ahead, RISER_GAP_M, LEAST_BLOCKS)
        if counts.size:
            azimuth = _azimuth(scene, planes[counts.argmax()])
            near_it = np.abs(azimuths - azimuth) < RISER_SPREAD
        axes = turned_axes(scene.level, azimuth)
        found = surfaces_along(
            scene.blocks, upright[near_it], axes.ahead, scene.frame.camera, gap_m=RISER_GAP_M, least=LEAST_BLOCKS
        )
        if found:
            azimuth = _azimuth(scene, max(found, key=lambda surface: surface.blocks.size).unit)
        parallel = [surface for surface in found if abs(_azimuth(scene, surface.unit) - azimuth) < TURNED]
        for surface in parallel:
            yield from low_parts(surface, scene.blocks, scene.frame.camera, turned_axes(scene.level, _azimuth(scene, surface.unit)))
        claimed = np.isin(upright, np.concatenate([surface.blocks for surface in parallel])) if parallel else most
        upright, azimuths = upright[~claimed], azimuths[~claimed]


def _azimuth(scene: Scene, direction: Vector3) -> float:
    return math.atan2(float(direction @ scene.level.right), float(direction @ scene.level.ahead))


def _edge_of(scene: Scene, surface: Surface, own_rad: float, up: Vector3, top_m: float, rise_m: float) -> _Edge:
    """Return the edge of a single riser: its direction is that of its plane."""
    ahead = surface.unit - float(surface.unit @ up) * up
    ahead /= float(np.linalg.norm(ahead))
    right = cross(-up, ahead)
    warps = turns_of_surfaces([surface], scene.frame.camera)[0, :, : WARPS.size].T @ right
    variance = float(right @ surface.unit_covariance @ right) + own_rad**2 + float(warps @ warps) * WARPS_PX[-1] ** 2
    low_m, high_m = surface.span_m(scene.blocks, right)
    foot = surface.centre + (top_m - float(surface.centre @ up)) * up
    ends = foot + (np.array([low_m, high_m]) - float(foot @ right))[:, None] * right
    return _Edge(ends=ends, top_m=top_m, rise_m=rise_m, ahead=ahead, sigma_rad=math.sqrt(variance))


def _depth(edge: _Edge, after: _Edge | None) -> tuple[float, float, float] | None:
    """Return the distances from the left end, the middle and the right end of an edge to the next one, square to it [m]."""
    if after is None or float(edge.ahead @ after.ahead) < MEETING:
        return None
    places = np.array([edge.ends[0], edge.ends.mean(axis=0), edge.ends[1]])
    left, middle, right = ((after.ends[0] - places) @ after.ahead / float(edge.ahead @ after.ahead)).tolist()
    return left, middle, right


def _kind(flight: Flight | None, edge: _Edge, after: _Edge | None, depth: tuple[float, float, float] | None) -> StepKind:
    """Return the kind of a step by its tread."""
    if flight is not None and flight.is_single:
        return "kerb" if flight.direction == "up" else "drop"
    if max(edge.tread_m, 0.0 if depth is None else depth[1]) > LEVEL_SIZE_M[0]:
        return "landing"
    if after is None or float(edge.ahead @ after.ahead) > math.cos(TURNED):
        return "step"
    return "winder" if float(edge.ahead @ after.ahead) > MEETING else "landing"


def _step(scene: Scene, edge: _Edge, depth: tuple[float, float, float] | None, kind: StepKind) -> SeenStep:
    """Return an edge in the horizontal plane of the chair."""
    camera, level = scene.frame.camera, scene.level
    way, left = viewing_direction(camera.R_BC), cross(level.up, level.ahead)
    p_C = camera.R_BC.T @ np.array(camera.mount_m)
    plan = way * (edge.ends + p_C) @ np.stack([level.ahead, left], axis=1)
    (x0, y0), (x1, y1) = plan.tolist()
    return SeenStep(
        kind=kind,
        height_m=edge.top_m + float(p_C @ level.up),
        rise_m=edge.rise_m,
        edge_m=((x0, y0), (x1, y1)),
        ends_C=(tuple(edge.ends[0].tolist()), tuple(edge.ends[1].tolist())),
        direction_rad=math.atan2(float(edge.ahead @ left), float(edge.ahead @ level.ahead)),
        sigma_rad=edge.sigma_rad,
        depth_m=depth,
    )
