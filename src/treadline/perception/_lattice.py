"""Flight in a frame: the staircase with the most evidence from treads, risers and their ends.

One hypothesis, azimuth of the edges, rise, run and place of the first nosing, explains all parts in view; each adds log-evidence
against a scene whose surfaces lie anywhere. ``EVIDENCE`` says how much of it makes a stair.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from treadline.core.angles import DEG
from treadline.core.arrays import cross
from treadline.core.camera_images import PinholeCamera, RgbdFrame
from treadline.core.rotations import Vector3
from treadline.core.signals import Direction
from treadline.perception import _plane_segmentation_kernels as surface_kernels
from treadline.perception._lattice_kernels import (
    ANY_RISE_M,
    ANY_RUN_M,
    SEARCHED_RISE_M,
    USUAL_RISE_M,
    USUAL_RUN_M,
    best_lattice,
    crowding,
)
from treadline.perception._plane_segmentation import TURN_LIMIT, PlanarBlocks, Surface, surfaces_along
from treadline.perception._step_parts import (
    LEAST_LEVER,
    Axes,
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

EVIDENCE, UNCONFIRMED = 5.0, 3.4
"""Least log-evidence of a stair, and of an unconfirmed one [nats]: two levels and two fronts reach at most 3.92, a third level that
fits 6.3. The 90 % quantile of its residual (χ² of one degree of freedom, 2.7) leaves 5.0."""
UPRIGHT = 18.0 * DEG
"""Largest angle of a block's normal from vertical (tread) or horizontal (riser) [rad]: a focal length 40 % off tilts treads and
risers by 9.5°."""
RISER_SPREAD = 14.0 * DEG
"""Largest azimuth difference between a riser block and the vote, and least one between two votes [rad]."""
TURN_SIGMAS = 2.0
"""Error of an uncertain normal within which its block can belong to a riser, in standard deviations."""
RISER_GAP_M, TREAD_GAP_M = 0.06, 0.045
"""Separation of different surfaces along their normal [m]: less than half of the smallest run, and than the smallest rise but for
the noise of two heights."""
LEAST_BLOCKS = 8
"""Least number of blocks of a surface."""
USUAL_SIZE, ANY_SIZE = (USUAL_RISE_M, USUAL_RUN_M), (ANY_RISE_M, ANY_RUN_M)
"""Priors of rise and run: mean and standard deviation of each [m]."""
TURNED = 1.0 * DEG
"""Angle between vote and matched parts above which the parts are measured again in their own axes [rad]."""
VOTE_LIMIT = 50.0 * DEG
"""Azimuth beyond which a vertical surface is a side wall [rad]."""
VOTES = 3
"""Number of azimuths tried: a wall at the landing can outvote the last risers."""
PLACE_STEP, PLACE_BIN_M = 3.0 * DEG, 0.04
"""Steps of azimuth [rad] and of distance [m] in the search of azimuths at which parts lie at few distances: half a step turns a
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
    units = blocks.unit[upright]
    return Scene(
        frame=frame,
        blocks=blocks,
        level=level,
        treads=levels_of(frame.camera, blocks, level, TREAD_GAP_M),
        upright=upright,
        azimuth=np.arctan2(units @ level.right, units @ level.ahead),
        slack=slack[upright],
    )


def levels_of(camera: PinholeCamera, blocks: PlanarBlocks, level: Axes, gap_m: float) -> list[Tread]:
    """Return the horizontal surfaces below the camera, separated by a difference of height: above are undersides of objects."""
    flat = np.flatnonzero((np.abs(blocks.unit @ level.up) > np.cos(UPRIGHT)) & (blocks.turns <= TURN_LIMIT))
    surfaces = surfaces_along(blocks, flat, level.up, camera, gap_m=gap_m, least=LEAST_BLOCKS)
    kept = (s for s in surfaces if _turned_from(s, level.up) < UPRIGHT and float(s.centre @ level.up) < 0.0)
    return [tread_of(surface, camera) for surface in kept]


def flight_in(scene: Scene) -> Flight | str:
    """Return the flight with the most evidence, or the reason of its absence."""
    level = scene.level
    azimuths = list(voted_azimuths(scene))
    if not azimuths:
        return "no riser and no nosing faces the camera"
    best = _best_at(scene, azimuths)
    if best is None:
        return f"nothing repeats as steps do: {len(scene.treads)} level surface(s) in view"
    # In axes along its edges the flight's parts are measured once more.
    azimuth = math.atan2(float(best.facing @ level.right), float(best.facing @ level.ahead))
    turn = _turn_of(best, turned_axes(level, azimuth))
    return (_best_at(scene, [azimuth + turn]) if abs(turn) >= TURNED else None) or best


def _best_at(scene: Scene, azimuths: Iterable[float]) -> Flight | None:
    """Return the flight with the most evidence that faces one of some azimuths; twice that of a stair ends the search."""
    best: Flight | None = None
    for azimuth in azimuths:
        axes = turned_axes(scene.level, azimuth)
        tried: tuple[tuple[Iterable[Riser], Direction], ...] = ((risers_at(scene, azimuth), "up"), ((), "down"))
        for risers, direction in tried:
            flight = _matched(scene, list(risers), axes, direction)
            if flight is not None and (best is None or flight.evidence > best.evidence):
                best = flight
            if best is not None and best.evidence > 2.0 * EVIDENCE:
                return best
    return best


def turned_axes(level: Axes, azimuth: float) -> Axes:
    """Return level axes turned by an azimuth to the right [rad]."""
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


def risers_at(scene: Scene, azimuth: float) -> Iterator[Riser]:
    """Yield the vertical surfaces that face an azimuth and are no higher than a step.

    A wall next to the flight can lie in the plane of a riser: surfaces taller than a step are separated by columns.
    """
    camera, blocks, axes = scene.frame.camera, scene.blocks, turned_axes(scene.level, azimuth)
    members = scene.upright[np.abs(scene.azimuth - azimuth) < RISER_SPREAD + scene.slack]
    for surface in surfaces_along(blocks, members, axes.ahead, camera, gap_m=RISER_GAP_M, least=LEAST_BLOCKS):
        low = max(low_parts(surface, blocks, camera, axes), key=lambda part: part.blocks.size, default=None)
        if low is not None and _turned_from(low, axes.ahead) < RISER_SPREAD:
            yield riser_of(low, camera)


def low_parts(surface: Surface, blocks: PlanarBlocks, camera: PinholeCamera, axes: Axes) -> list[Surface]:
    """Return the parts of a vertical surface that are no higher than a step, separated by columns that are."""
    if _are_low(surface.blocks, blocks, axes):
        return [surface]
    tall = surface.heights_m(camera, axes.up) >= SEARCHED_RISE_M[1]
    runs = np.cumsum(tall)
    parts = [surface.within(~tall & (runs == run), blocks) for run in np.unique(runs[~tall])]
    return [part for part in parts if part.blocks.size >= LEAST_BLOCKS and _are_low(part.blocks, blocks, axes)]


def _matched(scene: Scene, risers: list[Riser], axes: Axes, direction: Direction) -> Flight | None:
    """Return the flight with the most evidence in one direction; None without a nosing that has a direction."""
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
    evidence, rise_m, run_m, z0_m, first, last, levels, is_unusual = found.tolist()
    steps = range(int(first), int(last) + 1)
    on = zip(of_tread.tolist(), front_on.tolist(), scene.treads, strict=True)
    own_treads = [part for part in on if part[0] in steps]
    own_risers = [(step, riser) for step, riser in zip(of_riser.tolist(), risers, strict=True) if step in steps]
    nosings = []
    for step in steps:
        its_treads = [tread for own, _, tread in own_treads if own == step]
        fronts = [tread for own, is_front, tread in own_treads if own == step and is_front]
        its_risers = [riser for own, riser in own_risers if own == step]
        if its_risers or fronts:
            nosings.append(nosing_of(step, z0_m + step * rise_m, its_treads, fronts, its_risers, blocks, axes, direction))
    if not any(nosing.has_direction for nosing in nosings):
        return None
    return Flight(
        direction=direction,
        evidence=evidence,
        rise_m=rise_m,
        run_m=run_m,
        levels=int(levels),
        size_prior=ANY_SIZE if is_unusual else USUAL_SIZE,
        treads=[tread.surface for tread in scene.treads],
        nosings=sorted(nosings, key=lambda nosing: nosing.ahead_m),
        facing=axes.ahead,
        matched_treads=own_treads,
        matched_risers=own_risers,
    )


def nosing_of(
    step: int,
    height_m: float,
    treads: Sequence[Tread],
    fronts: Sequence[Tread],
    risers: Sequence[Riser],
    blocks: PlanarBlocks,
    axes: Axes,
    direction: Direction,
) -> NosingObservation:
    """Return the nosing of one step from its parts.

    Args:
        height_m: Height of the lattice's nosing, for a step without a tread.
        treads: Treads of the step, with ``fronts``, those that end at its nosing.
    """
    lines = [line for tread in fronts if (line := tread.front(axes, direction)) is not None]
    # A tread is wider in view at its far end than at its nosing.
    asides = [float(aside) for line in lines for aside in line.ends_m @ axes.right]
    asides += [aside for riser in risers for aside in riser.surface.span_m(blocks, axes.right)]
    places = [riser.surface.centre for riser in risers] or [line.middle for line in lines]
    ahead_m = float(np.mean([place @ axes.ahead for place in places]))
    riser = max(risers, key=lambda riser: riser.surface.blocks.size, default=None)
    if riser is not None and riser.upper is not None:
        lines.append(riser.upper)
    start = lines[0].middle if riser is None else riser.surface.centre
    heights = [_height_at(tread.surface, start, axes) for tread in treads]
    up_m = float(np.mean(heights)) if heights else height_m
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
    return bool(top_m - bottom_m < SEARCHED_RISE_M[1])


def _turned_from(surface: Surface, direction: Vector3) -> float:
    return float(np.arccos(min(1.0, abs(float(surface.unit @ direction)))))


def voted_azimuths(scene: Scene) -> Iterator[float]:
    """Yield the azimuths at which blocks and lines lie at the fewest distances, as risers and nosings do, the best first.

    A block votes for azimuths within the error of its own; distances need no normal, which noise turns far away.
    """
    blocks, level = scene.blocks, scene.level
    lines = [line for tread in scene.treads for line in (tread.lower, tread.upper) if line is not None]
    points = np.concatenate([blocks.centres[scene.upright], *([*line.ends_m, line.middle] for line in lines)])
    of_line = [count for line in lines for count in 3 * [line.count * WIDTH_PX / scene.frame.camera.width_px / 3.0]]
    azimuths = np.arange(-VOTE_LIMIT, VOTE_LIMIT + PLACE_STEP, PLACE_STEP)
    plan = points @ np.stack([level.ahead, level.right], axis=1) / PLACE_BIN_M
    scores = crowding(plan, scene.azimuth, RISER_SPREAD + scene.slack, np.array(of_line), azimuths, 2.0 * LEAST_BLOCKS)
    for _ in range(VOTES):
        best = int(np.argmax(scores))
        if not scores[best] > 0.0:
            return
        yield float(azimuths[best])
        scores[np.abs(azimuths - azimuths[best]) < RISER_SPREAD] = 0.0
