"""The estimator that drives: one edge direction from all treads, risers and nosings in view.

Gravity sorts surfaces into treads and risers; risers and lines vote for the azimuth; surfaces are joined across the image
(their baseline is the stair's width); the edges' direction is the one at right angles to all normals; the heading follows
from it in the chair's frame. A frame is refused, with the reason, unless two nosings follow each other as on a stair: walls,
shelves and tables do not. Without gravity the treads tell down, and more of a stair must be seen.
"""

from dataclasses import dataclass, replace
from functools import cache, partial

import numpy as np
from jaxtyping import Float, Float32

from treadline.angles import DEG
from treadline.perception.ahead import map_of
from treadline.perception.direction import EdgeFit, fit_edges, off_gravity
from treadline.perception.down import down_of_treads, levelled
from treadline.perception.flights import LEAST_BLOCKS, UPRIGHT, Flight, flight_under
from treadline.perception.geometry import axes_of, directions_of, levels_of, shape_of, way_of
from treadline.perception.nosings import SAME_RISE_M, Axes, Direction
from treadline.perception.planes import Blocks, Surface, surface_blocks
from treadline.perception.sight import Parts, Sight, StairShape, refused
from treadline.perception.stopwatch import Stopwatch
from treadline.perception.vectors import cross
from treadline.signals import RgbdFrame, StairMap

HALF = 0.5
"""Share of the image: with less depth a refusal blames missing depth, not missing planes."""
HEADING_LIMIT = 45.0 * DEG
SLOPE_LIMIT = 45.0 * DEG
AGREEING = 0.7
"""Of the nosings that must agree: winders do not."""
SIGMA_LIMIT = 1.0 * DEG
LOOKING_AHEAD, LOOKING_DOWN = (5.0 * DEG, 70.0 * DEG), (60.0 * DEG, 100.0 * DEG)
"""How far down the camera may look where treads must tell: closer to level, treads vanish; closer to straight down, a wall
seen from the front and a floor seen from above are alike."""
GRAVITY_SIGMA, TREADS_SIGMA = 0.5 * DEG, 3.0 * DEG
"""Trust in the IMU's idea of down, and in one taken from the treads."""
TREADS_LEAST = 2
"""That gravity must leave level for nobody to look for others that are not."""
DISAGREEMENT, DISAGREEMENT_SIGMAS = 2.0 * DEG, 4.0
"""Between risers and nosings, from which on one of them is something else."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Down:
    """One idea of which way is down."""

    direction: Float[np.ndarray, " 3"]
    """In which surfaces are sorted."""
    reference: Float[np.ndarray, " 3"]
    """From which the edges' and treads' tilt is counted, with its standard deviation."""
    sigma_rad: float
    least_levels: int = 0
    """Treads, evenly spaced, that must be seen: more where down is but a guess."""
    directions: tuple[Direction, ...] = ("up", "down")
    """Which way the flight may go."""


def look_robust(frame: RgbdFrame, gravity_C: Float[np.ndarray, " 3"] | None, watch: Stopwatch | None = None) -> Sight:
    """Return what a frame says of the stair."""
    watch = watch or Stopwatch()
    # One layout: compiled loops are compiled anew for each.
    frame = replace(frame, depth_m=np.require(frame.depth_m, np.float32, ["C", "W"])) if _is_odd(frame.depth_m) else frame
    blocks = surface_blocks(frame.depth_m, frame.camera)
    if len(blocks.sums) < 3 * LEAST_BLOCKS:
        share = float(np.mean(frame.depth_m > 0.0))
        return refused(
            f"only {len(blocks.sums)} blocks with a plane in the depth image, {share:.0%} of which has a depth: "
            + ("nothing flat in range" if share > HALF else "too little of it")
            + ", or noise beyond a Kinect's"
        )
    unit = blocks.unit
    watch.lap("blocks")
    if gravity_C is not None:
        told = _unit(gravity_C)
        if told is None:
            return refused(f"gravity is not a direction but ({', '.join(f'{part:g}' for part in gravity_C)})")
        down = _Down(direction=levelled(told, unit, UPRIGHT), reference=told, sigma_rad=GRAVITY_SIGMA)
        sight = _look_under(down, frame, blocks, unit, watch)
        return _unless_treads_differ(sight, told, frame, blocks, unit, watch)
    sight = refused("no gravity, and no treads to tell it from")
    guess = down_of_treads(unit, LOOKING_AHEAD)
    if guess is not None:
        sight = _look_under(_Down(direction=guess, reference=guess, sigma_rad=TREADS_SIGMA), frame, blocks, unit, watch)
        if sight.accepted:
            return sight
    guess = down_of_treads(unit, LOOKING_DOWN)
    if guess is not None:
        # Seen from the front, furniture steps back from the camera further up: a flight that falls, were it level.
        ladder = _Down(direction=guess, reference=guess, sigma_rad=TREADS_SIGMA, least_levels=3, directions=("up",))
        tried = _look_under(ladder, frame, blocks, unit, watch)
        sight = tried if tried.accepted else sight
    return sight


def _unless_treads_differ(
    sight: Sight, told: Float[np.ndarray, " 3"], frame: RgbdFrame, blocks: Blocks, unit: Float[np.ndarray, "b 3"], watch: Stopwatch
) -> Sight:
    """Return what was seen, or a refusal where it shows hardly a tread because gravity is told so wrong that none looks level.

    Risers alone tell nothing of how the edges tilt: gravity does, and its error becomes the heading's.
    """
    if sight.parts is None or len(sight.parts.treads) >= TREADS_LEAST:
        return sight
    guess = down_of_treads(unit, LOOKING_AHEAD)
    if guess is None or float(guess @ told) > np.cos(UPRIGHT):
        return sight
    other = _look_under(_Down(direction=guess, reference=guess, sigma_rad=TREADS_SIGMA), frame, blocks, unit, watch)
    treads = () if other.parts is None else other.parts.treads
    normals = np.array([np.copysign(1.0, tread.unit @ guess) * tread.unit for tread in treads]).reshape(-1, 3)
    off = off_gravity(normals, told)
    if off is None:
        return sight
    return refused(f"{len(treads)} treads agree on a level {off / DEG:.0f}° off the gravity told", edge_count=sight.edge_count)


def _is_odd(depth_m: Float32[np.ndarray, "h w"]) -> bool:
    return depth_m.dtype != np.float32 or not (depth_m.flags.c_contiguous and depth_m.flags.writeable)


def _look_under(down: _Down, frame: RgbdFrame, blocks: Blocks, unit: Float[np.ndarray, "b 3"], watch: Stopwatch) -> Sight:
    """Return what a frame says if down is where one idea has it."""
    seen = flight_under(frame, blocks, unit, down.direction, down.directions, watch)
    if isinstance(seen, str):
        return refused(seen)
    fit = fit_edges(seen.nosings, seen.treads, down.reference, down.sigma_rad, cross(down.direction, seen.facing), frame.camera)
    watch.lap("direction")
    sight = _answer(frame, blocks, seen, fit, down, watch)
    watch.lap("geometry")
    return sight


def _answer(frame: RgbdFrame, blocks: Blocks, seen: Flight, fit: EdgeFit, down: _Down, watch: Stopwatch) -> Sight:
    R_BC = frame.camera.R_BC
    # To the chair's right, which is the image's left where the camera looks back.
    edge = fit.edge if float((R_BC @ fit.edge)[1]) < 0.0 else -fit.edge
    heading = _heading(edge, R_BC)
    # How the heading turns with the edge, in C.
    forward, left = R_BC[0], R_BC[1]
    a, b = -float(edge @ forward), -float(edge @ left)
    change = (-b * forward + a * left) / (a * a + b * b)
    sigma = fit.sigma_of(change)
    tilted = axes_of(way_of(R_BC) * edge, down.reference, down.sigma_rad, seen.treads)
    axes = tilted.axes
    shape = shape_of(seen.nosings, axes, seen.direction)
    if shape is None:
        return refused("edges a step apart, but no telling how high the step is", edge_count=len(seen.nosings))
    doubt = _doubt(heading, sigma, fit, shape, seen, down, levels_of(seen.treads, axes))
    if doubt is not None:
        return refused(doubt, edge_count=len(seen.nosings))
    apart = fit.planes_against_lines_rad
    return Sight(
        accepted=True,
        reason=None,
        heading_rad=heading,
        sigma_rad=sigma,
        edge_direction_C=edge,
        edge_count=len(seen.nosings),
        box_px=_box(frame, blocks, [*seen.risers, *_steps(seen, axes)]),
        shape=shape,
        stages=None,
        planes_against_lines_rad=None if apart is None else apart[0],
        axes=directions_of(frame.t_s, seen.nosings, tilted, shape, edge, sigma),
        parts=Parts(
            risers=tuple(seen.risers),
            treads=tuple(seen.treads),
            flight=tuple(seen.nosings),
            aside=cross(down.direction, seen.facing),
            blocks=blocks,
        ),
        draw_map=cache(partial(_drawn_map, frame, blocks, seen, axes, shape, watch)),
    )


def _drawn_map(
    frame: RgbdFrame, blocks: Blocks, seen: Flight, axes: Axes, shape: StairShape, watch: Stopwatch, swept_half_m: float
) -> StairMap:
    watch.resume()
    stair_map = map_of(frame, blocks, seen.nosings, axes, shape, swept_half_m)
    watch.lap("map")
    return stair_map


def _doubt(
    heading_rad: float, sigma_rad: float, fit: EdgeFit, shape: StairShape, seen: Flight, down: _Down, levels: int
) -> str | None:
    """Return why this is no stair to steer by, or None."""
    if shape.slope_rad > SLOPE_LIMIT:
        return f"a slope of {shape.slope_rad / DEG:.0f}° is no stair to drive on"
    if levels < down.least_levels:
        return f"no gravity, and {levels} level(s) evenly apart to make up for it, {down.least_levels} needed"
    if abs(heading_rad) > HEADING_LIMIT:
        return f"heading {heading_rad / DEG:.0f}° is beyond ±{HEADING_LIMIT / DEG:.0f}°"
    if fit.agreeing < AGREEING or fit.agreeing * len(seen.nosings) < 1.5:
        return f"nosings turned by up to {fit.widest_rad / DEG:.1f}° against each other: no straight flight"
    apart = fit.planes_against_lines_rad
    if apart is not None and abs(apart[0]) > max(DISAGREEMENT, DISAGREEMENT_SIGMAS * apart[1]):
        return f"risers and nosings disagree by {abs(apart[0]) / DEG:.1f}°"
    if not sigma_rad <= SIGMA_LIMIT:
        return f"the heading is known to ±{1.96 * sigma_rad / DEG:.1f}° only"
    return None


def _unit(gravity_C: Float[np.ndarray, " 3"]) -> Float[np.ndarray, " 3"] | None:
    length = float(np.linalg.norm(gravity_C))
    return gravity_C / length if np.isfinite(length) and length > 0.0 else None


def _heading(edge: Float[np.ndarray, " 3"], R_BC: Float[np.ndarray, "3 3"]) -> float:
    """Return ψ = atan2(-e·forward, e·right) of an edge that points right."""
    e_B = R_BC @ edge
    return float(np.arctan2(-e_B[0], -e_B[1]))


def _steps(seen: Flight, axes: Axes) -> list[Surface]:
    """Return the treads that start at a nosing seen: floors and landings are no part of the stair."""
    heights = [float(nosing.point @ axes.up) for nosing in seen.nosings]
    levels = [float(tread.centre @ axes.up) for tread in seen.treads]
    nearest = [min(abs(level - height) for height in heights) for level in levels]
    return [tread for tread, off_m in zip(seen.treads, nearest, strict=True) if off_m < SAME_RISE_M]


def _box(frame: RgbdFrame, blocks: Blocks, surfaces: list[Surface]) -> tuple[int, int, int, int] | None:
    if not surfaces:
        return None
    camera = frame.camera
    points = blocks.centres[np.concatenate([surface.blocks for surface in surfaces])]
    u = camera.fx_px * points[:, 0] / points[:, 2] + camera.cx_px
    v = camera.fy_px * points[:, 1] / points[:, 2] + camera.cy_px
    return int(u.min()), int(v.min()), int(u.max()), int(v.max())
