"""Flight in a frame: the staircase with the most evidence from treads, risers and their ends.

One hypothesis, azimuth of the edges, rise, run and place of the first nosing, explains all parts in view; each adds log-evidence
against a scene whose surfaces lie anywhere. How much of it makes a stair is decided in ``acceptance``.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from treadline.core.angles import DEG
from treadline.core.arrays import cross
from treadline.core.camera_images import PinholeCamera, RgbdFrame
from treadline.core.rotations import Vector3
from treadline.perception import _plane_segmentation_kernels as surface_kernels
from treadline.perception._lattice_kernels import ANY_RISE_M, ANY_RUN_M, SEARCHED_RISE_M, USUAL_RISE_M, USUAL_RUN_M, best_lattice
from treadline.perception._step_parts import (
    LEAST_LEVER,
    Axes,
    Direction,
    Flight,
    NosingObservation,
    Riser,
    Tread,
    level_axes,
    riser_of,
    riser_rows,
    seed_points,
    tread_of,
    tread_rows,
)
from treadline.perception.plane_segmentation import TURN_LIMIT, Line, PlanarBlocks, Surface, surfaces_along

UPRIGHT = 18.0 * DEG
"""Largest angle of a block's normal from vertical (tread) or horizontal (riser) [rad]."""
RISER_SPREAD = 14.0 * DEG
"""Largest azimuth difference between a riser block and the vote [rad]."""
TURN_SIGMAS = 2.0
"""Error of an uncertain normal within which its block can belong to a riser, in standard deviations."""
RISER_GAP_M, TREAD_GAP_M = 0.06, 0.045
"""Separation of different surfaces along their normal [m]: less than half of the smallest run, and than the smallest rise but for
the noise of two heights."""
LEAST_BLOCKS = 8
"""Least number of blocks of a surface."""
TALLEST_M = SEARCHED_RISE_M[1]
"""Largest height of a riser [m]."""
USUAL_SIZE, ANY_SIZE = (USUAL_RISE_M, USUAL_RUN_M), (ANY_RISE_M, ANY_RUN_M)
"""Priors of rise and run: mean and standard deviation of each [m]."""
TURNED = 1.0 * DEG
"""Angle between vote and matched parts above which the parts are measured again in their own axes [rad]."""
VOTE_LIMIT = 50.0 * DEG
"""Azimuth beyond which a vertical surface is a side wall [rad]."""
VOTE_BIN = 2.0 * DEG
"""Width of a bin of the vote [rad]."""
VOTES = 3
"""Number of peaks tried: a wall at the landing can outvote the last risers."""
PEAKS_APART = 14.0 * DEG
"""Least angle between two peaks [rad]."""
LEAST_VOTES = 16
"""Least number of votes of a peak."""
PLACE_STEP, PLACE_BIN_M = 3.0 * DEG, 0.04
"""Steps of azimuth [rad] and of distance [m] in the search of azimuths at which blocks lie at few distances: half a step turns a
riser 1 m wide over 26 mm of distance."""
WIDTH_PX = 320
"""Image width at which a line's columns have the same weight as blocks [px]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Scene:
    """Surfaces of a frame, sorted by gravity."""

    frame: RgbdFrame
    blocks: PlanarBlocks
    level: Axes
    treads: list[Tread]
    upright: Int[np.ndarray, " v"]
    """Indices of the vertical blocks."""
    azimuth: Float[np.ndarray, " v"]
    """Azimuth of each of them [rad]."""
    slack: Float[np.ndarray, " v"]
    """Largest error of each azimuth [rad]; zero for blocks with a certain normal."""
    is_uncertain: bool
    """Whether blocks with an uncertain normal are included."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Match:
    """Parts of a scene as numbers in the axes of the edges, the staircase that explains most of them, and the step of each."""

    axes: Axes
    direction: Direction
    evidence: float
    """Log-evidence against a scene without a stair [nats]."""
    rise_m: float
    run_m: float
    z0_m: float
    """Height of nosing 0 of the lattice, which need not be in view [m]."""
    first: int
    last: int
    """First and last step in view."""
    levels: int
    """Number of steps with a measured height."""
    is_unusual: bool
    """Whether rise and run are not those of usual stairs."""
    risers: list[Riser]
    tread_rows: Float[np.ndarray, "t 10"]
    riser_rows: Float[np.ndarray, "r 10"]
    of_tread: Int[np.ndarray, " t"]
    of_riser: Int[np.ndarray, " r"]
    front_on: Bool[np.ndarray, " t"]
    """Whether the front of a tread is a nosing."""

    def treads_of(self, step: int) -> list[int]:
        """Return the indices of a step's treads."""
        return [t for t, own in enumerate(self.of_tread.tolist()) if own == step]

    def fronts_of(self, step: int) -> list[int]:
        """Return the indices of the treads whose fronts are the step's nosing."""
        return [t for t in self.treads_of(step) if self.front_on[t]]

    def risers_of(self, step: int) -> list[int]:
        """Return the indices of a step's risers."""
        return [r for r, own in enumerate(self.of_riser.tolist()) if own == step]


def scene_of(frame: RgbdFrame, blocks: PlanarBlocks, down: Vector3, *, is_uncertain: bool = False) -> Scene | None:
    """Return the surfaces of a frame; None if the camera looks straight up or down.

    Args:
        down: Unit vector in C.
        is_uncertain: Whether ``blocks`` include those with an uncertain normal.
    """
    level = level_axes(down, frame.camera.R_BC)
    if level is None:
        return None
    rise = blocks.unit @ down
    slack = TURN_SIGMAS * blocks.turns * is_uncertain
    upright = np.flatnonzero(np.abs(rise) < np.sin(np.minimum(UPRIGHT + slack, 0.5 * np.pi)))
    level_blocks = (np.abs(rise) > np.cos(UPRIGHT)) & (blocks.turns <= TURN_LIMIT)
    flat = np.flatnonzero(level_blocks)
    surfaces = surfaces_along(blocks, flat, level.up, frame.camera, gap_m=TREAD_GAP_M, least=LEAST_BLOCKS)
    # A horizontal surface above the camera is the underside of an object.
    kept = [s for s in surfaces if _turned_from(s, level.up) < UPRIGHT and float(s.centre @ level.up) < 0.0]
    units = blocks.unit[upright]
    return Scene(
        frame=frame,
        blocks=blocks,
        level=level,
        treads=[tread_of(surface, frame.camera) for surface in kept],
        upright=upright,
        azimuth=np.arctan2(units @ level.right, units @ level.ahead),
        slack=slack[upright],
        is_uncertain=is_uncertain,
    )


def flight_in(scene: Scene, directions: Sequence[Direction]) -> Flight | str:
    """Return the flight with the most evidence, or the reason of its absence."""
    level, camera = scene.level, scene.frame.camera
    if scene.is_uncertain:
        peaks = list(_place_votes(scene.blocks.centres[scene.upright], level))
    else:
        lines = [line for tread in scene.treads for line in (tread.lower, tread.upper) if line is not None]
        peaks = list(_votes(scene.azimuth, *_line_votes(lines, camera.width_px, level)))
    if not peaks:
        return "no riser and no nosing faces the camera"
    risers = [list(_risers_at(scene, peak)) for peak in peaks]
    found = [match for peak, own in zip(peaks, risers, strict=True) for match in _matches_at(scene, peak, own, directions)]
    best = _best_of(scene, found)
    if best is None:
        most = max(len(own) for own in risers)
        return f"{len(scene.treads)} level surface(s) and {most} riser(s) in view, none of which repeat as steps do"
    # In axes along its edges the flight's parts are measured once more.
    azimuth = math.atan2(float(best.facing @ level.right), float(best.facing @ level.ahead))
    turn = _turn_of(best, _turned_axes(level, azimuth))
    if abs(turn) >= TURNED:
        azimuth += turn
        best = _best_of(scene, _matches_at(scene, azimuth, list(_risers_at(scene, azimuth)), directions)) or best
    return best


def _matches_at(scene: Scene, azimuth: float, risers: list[Riser], directions: Sequence[Direction]) -> list[Match]:
    """Return the staircase with the most evidence in each direction at an azimuth."""
    axes = _turned_axes(scene.level, azimuth)
    found = [_matched(scene, risers if direction == "up" else [], axes, direction) for direction in directions]
    return [match for match in found if match is not None]


def _best_of(scene: Scene, matches: Sequence[Match]) -> Flight | None:
    """Return the flight of the staircase with the most evidence whose nosings have a direction."""
    by_evidence = sorted(matches, key=lambda match: match.evidence, reverse=True)
    return next((flight for match in by_evidence if (flight := _flight_of(scene, match)) is not None), None)


def _turned_axes(level: Axes, azimuth: float) -> Axes:
    facing = math.cos(azimuth) * level.ahead + math.sin(azimuth) * level.right
    return Axes(ahead=facing, up=level.up, right=cross(-level.up, facing))


def _turn_of(flight: Flight, axes: Axes) -> float:
    """Return the median azimuth of a flight's parts relative to its axes [rad]."""
    normals = [nosing.riser.unit for nosing in flight.nosings if nosing.riser is not None]
    for nosing in flight.nosings:
        for line in nosing.lines:
            across = cross(cross(line.normal, axes.up), axes.up)
            normals.append(across if float(across @ axes.ahead) > 0.0 else -across)
    if not normals:
        return 0.0
    return float(np.median([math.atan2(float(n @ axes.right), float(n @ axes.ahead)) for n in normals]))


def _risers_at(scene: Scene, azimuth: float) -> Iterator[Riser]:
    """Yield the vertical surfaces that face an azimuth and are no higher than a step.

    A wall next to the flight can lie in the plane of a riser: surfaces taller than a step are separated by columns.
    """
    camera, blocks, axes = scene.frame.camera, scene.blocks, _turned_axes(scene.level, azimuth)
    members = scene.upright[np.abs(scene.azimuth - azimuth) < RISER_SPREAD + scene.slack]
    for surface in surfaces_along(blocks, members, axes.ahead, camera, gap_m=RISER_GAP_M, least=LEAST_BLOCKS):
        low = surface if _are_low(surface.blocks, blocks, axes) else _low_part(surface, blocks, camera, axes)
        if low is not None and _turned_from(low, axes.ahead) < RISER_SPREAD:
            yield riser_of(low, camera)


def _low_part(surface: Surface, blocks: PlanarBlocks, camera: PinholeCamera, axes: Axes) -> Surface | None:
    """Return the widest part of a surface that is no higher than a step; None if there is hardly any."""
    tall = surface.heights_m(camera, axes.up) >= TALLEST_M
    if tall.all():
        return None
    # Gaps between adjacent tall columns.
    runs = np.cumsum(tall)
    part = surface.within(~tall & (runs == np.argmax(np.bincount(runs[~tall]))), blocks)
    return part if part.blocks.size >= LEAST_BLOCKS and _are_low(part.blocks, blocks, axes) else None


def _matched(scene: Scene, risers: list[Riser], axes: Axes, direction: Direction) -> Match | None:
    """Return the staircase with the most evidence in one direction, or None."""
    camera, blocks = scene.frame.camera, scene.blocks
    treads = tread_rows(scene.treads, blocks, axes, camera, direction)
    upright = riser_rows(risers, blocks, axes, camera)
    of_tread, of_riser = np.empty(len(treads), dtype=np.int64), np.empty(len(upright), dtype=np.int64)
    front_on = np.empty(len(treads), dtype=np.bool_)
    sign = 1.0 if direction == "up" else -1.0
    found = best_lattice(
        seed_points(treads, upright),
        treads,
        upright,
        blocks.nearness,
        camera.pinhole,
        np.stack([sign * axes.ahead, axes.up, axes.right]),
        of_tread,
        front_on,
        of_riser,
    )
    if not math.isfinite(found[0]):
        return None
    evidence, rise, run, z0, first, last, levels, is_unusual = found.tolist()
    return Match(
        axes=axes,
        direction=direction,
        evidence=evidence,
        rise_m=rise,
        run_m=run,
        z0_m=z0,
        first=int(first),
        last=int(last),
        levels=int(levels),
        is_unusual=bool(is_unusual),
        risers=risers,
        tread_rows=treads,
        riser_rows=upright,
        of_tread=of_tread,
        of_riser=of_riser,
        front_on=front_on,
    )


def _flight_of(scene: Scene, match: Match) -> Flight | None:
    """Return the flight of a staircase with its nosings; None if none of them has a direction."""
    sign = 1.0 if match.direction == "up" else -1.0
    steps = range(match.first, match.last + 1)
    observed = (_nosing(scene, match, k, sign) for k in steps)
    nosings = [nosing for nosing in observed if nosing is not None]
    if not any(nosing.has_direction for nosing in nosings):
        return None
    inside = (match.of_tread >= match.first) & (match.of_tread <= match.last)
    standing = (match.of_riser >= match.first) & (match.of_riser <= match.last)
    return Flight(
        direction=match.direction,
        evidence=match.evidence,
        rise_m=match.rise_m,
        run_m=match.run_m,
        levels=match.levels,
        size_prior=ANY_SIZE if match.is_unusual else USUAL_SIZE,
        risers=[nosing.riser for nosing in nosings if nosing.riser is not None],
        treads=[tread.surface for tread in scene.treads],
        steps=[tread.surface for tread, own in zip(scene.treads, inside.tolist(), strict=True) if own],
        nosings=sorted(nosings, key=lambda nosing: nosing.ahead_m),
        facing=match.axes.ahead,
        matched_treads=[(int(match.of_tread[t]), bool(match.front_on[t]), scene.treads[t]) for t in np.flatnonzero(inside)],
        matched_risers=[(int(match.of_riser[r]), match.risers[r]) for r in np.flatnonzero(standing)],
    )


def _nosing(scene: Scene, match: Match, step: int, sign: float) -> NosingObservation | None:
    """Return the nosing of one step from its parts; None without a riser and a front."""
    axes, fronts, own = match.axes, match.fronts_of(step), match.risers_of(step)
    if not fronts and not own:
        return None
    lines: list[Line] = []
    for t in fronts:
        near, far = scene.treads[t].ends(axes)
        line = near if sign > 0.0 else far
        if line is not None:
            lines.append(line)
    # A tread is wider in view at its far end than at its nosing.
    asides = [*(float(aside) for line in lines for aside in line.ends_m @ axes.right), *match.riser_rows[own, 6:8].ravel().tolist()]
    riser = max((match.risers[r] for r in own), key=lambda r: r.surface.blocks.size, default=None)
    if riser is not None and riser.upper is not None:
        lines.append(riser.upper)
    ahead_m = float(match.riser_rows[own, 0].mean()) if own else sign * float(match.tread_rows[fronts, 2].mean())
    start = riser.surface.centre if riser is not None else lines[0].middle
    heights = [_height_at(scene.treads[t].surface, start, axes) for t in match.treads_of(step)]
    up_m = float(np.mean(heights)) if heights else match.z0_m + step * match.rise_m
    point = start + (up_m - float(start @ axes.up)) * axes.up + (ahead_m - float(start @ axes.ahead)) * axes.ahead
    return NosingObservation(
        step=step,
        ahead_m=ahead_m,
        point=point,
        sides_m=(min(asides), max(asides)),
        riser=None if riser is None else riser.surface,
        lines=tuple(line for line in lines if abs(float(line.normal @ axes.ahead)) > LEAST_LEVER),
    )


def _height_at(tread: Surface, point: Vector3, axes: Axes) -> float:
    """Return the height of a tread's plane above or below a point."""
    foot = point - float(point @ axes.up) * axes.up
    return float((1.0 - tread.normal @ foot) / (tread.normal @ axes.up))


def _are_low(members: Int[np.ndarray, " k"], blocks: PlanarBlocks, axes: Axes) -> bool:
    bottom_m, top_m = surface_kernels.span(blocks.centres, members, axes.up)
    return bool(top_m - bottom_m < TALLEST_M)


def _turned_from(surface: Surface, direction: Vector3) -> float:
    return float(np.arccos(min(1.0, abs(float(surface.unit @ direction)))))


def _line_votes(lines: Sequence[Line], width_px: int, level: Axes) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, " k"]]:
    """Return the azimuths of lines, and their weights."""
    azimuths, weights = [], []
    for line in lines:
        across = cross(cross(line.normal, level.up), level.up)
        across = across if across @ level.ahead > 0.0 else -across
        azimuths.append(math.atan2(float(across @ level.right), float(across @ level.ahead)))
        weights.append(line.count * WIDTH_PX / width_px)
    return np.array(azimuths), np.array(weights)


def _votes(
    blocks: Float[np.ndarray, " b"], lines: Float[np.ndarray, " k"], line_weights: Float[np.ndarray, " k"]
) -> Iterator[float]:
    """Yield the azimuths with most vertical blocks and lines, the strongest first."""
    seen = np.concatenate([blocks, lines])
    weights = np.concatenate([np.ones(len(blocks)), line_weights])
    inside = np.abs(seen) < VOTE_LIMIT
    seen, weights = seen[inside], weights[inside]
    edges = np.arange(-VOTE_LIMIT, VOTE_LIMIT + VOTE_BIN, VOTE_BIN)
    counts = np.bincount(np.searchsorted(edges, seen, side="right") - 1, weights, minlength=edges.size - 1)[: edges.size - 1]
    smooth = np.convolve(counts, [0.5, 1.0, 1.0, 1.0, 0.5], mode="same")
    for _ in range(VOTES):
        top = int(np.argmax(smooth))
        if smooth[top] < LEAST_VOTES:
            return
        peak = float(edges[top] + 0.5 * VOTE_BIN)
        for width in (10.0 * DEG, 6.0 * DEG):
            near = np.abs(seen - peak) < width
            if near.any():
                peak = _weighted_median(seen[near], weights[near])
        yield peak
        middle = edges[:-1] + 0.5 * VOTE_BIN
        smooth[np.abs(middle - edges[top]) < PEAKS_APART] = 0.0


def _place_votes(points: Float[np.ndarray, "b 3"], level: Axes) -> Iterator[float]:
    """Yield the azimuths at which points lie at the fewest distances, as those on risers do, the best first."""
    azimuths = np.arange(-VOTE_LIMIT, VOTE_LIMIT + PLACE_STEP, PLACE_STEP)
    scores = np.empty(azimuths.size)
    for k, azimuth in enumerate(azimuths):
        places = points @ (math.cos(azimuth) * level.ahead + math.sin(azimuth) * level.right) / PLACE_BIN_M
        counts = np.bincount(np.maximum(places, 0.0).astype(np.int64), minlength=2)
        both = counts[:-1] + counts[1:]
        scores[k] = float(both @ both)
    for _ in range(VOTES):
        best = int(np.argmax(scores))
        if not scores[best] > 0.0:
            return
        yield float(azimuths[best])
        scores[np.abs(azimuths - azimuths[best]) < PEAKS_APART] = 0.0


def _weighted_median(values: Float[np.ndarray, " k"], weights: Float[np.ndarray, " k"]) -> float:
    order = np.argsort(values)
    total = np.cumsum(weights[order])
    return float(values[order[int(np.searchsorted(total, 0.5 * total[-1]))]])
