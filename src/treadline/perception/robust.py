"""Default stair detector: edge direction from all treads, risers and nosings in view.

Gravity sorts surfaces into treads and risers; risers and lines vote for the azimuth; surfaces are joined across the image (their
baseline is the stair's width); the edge direction is perpendicular to all normals; the heading follows in the chair frame. A frame
is rejected, with the reason, unless two nosings follow each other as on a stair, unlike on walls, shelves and tables. Without an
IMU, gravity is estimated from the treads, and more of a stair must be visible.
"""

from dataclasses import dataclass, replace
from functools import cache, partial

import numpy as np
from jaxtyping import Float, Float32

from treadline.angles import DEG
from treadline.perception.detection import Parts, StairDetection, StairShape, refused
from treadline.perception.edge_fit import EdgeFit, fit_edges, off_gravity
from treadline.perception.form import Bow, Side, bow_of, sides_of, turn_by
from treadline.perception.geometry import axes_of, directions_of, viewing_direction
from treadline.perception.gravity_from_treads import down_of_treads, levelled
from treadline.perception.lattice import EVIDENCE, LEAST_BLOCKS, UNCONFIRMED, UPRIGHT, Flight, Scene, flight_in, scene_of
from treadline.perception.stair_map import map_of
from treadline.perception.stair_shape import shape_of
from treadline.perception.steps import Axes, Direction
from treadline.perception.stopwatch import Stopwatch
from treadline.perception.surfaces import PlanarBlocks, Surface, surface_blocks, uncertain_blocks
from treadline.perception.vectors import cross
from treadline.signals import RgbdFrame, StairMap

HALF = 0.5
"""Valid depth fraction below which a rejection names missing depth as the reason, instead of missing planes."""
HEADING_LIMIT = 45.0 * DEG
"""Largest accepted heading [rad]."""
SLOPE_LIMIT = 45.0 * DEG
"""Largest accepted slope [rad]."""
AGREEING = 0.7
"""Least fraction of consistent nosings: winders are not parallel."""
STRAIGHT_LEAST = 2
"""Least number of nosings with a direction, which are parallel on a straight flight."""
SIGMA_LIMIT = 1.0 * DEG
"""Largest accepted standard deviation of the heading [rad]."""
LOOKING_AHEAD, LOOKING_DOWN = (5.0 * DEG, 70.0 * DEG), (60.0 * DEG, 100.0 * DEG)
"""Ranges of camera pitch for gravity from treads [rad]: nearer to horizontal, treads vanish; nearer to straight down, a wall seen
from the front and a floor seen from above are indistinguishable."""
GRAVITY_SIGMA, TREADS_SIGMA = 0.5 * DEG, 3.0 * DEG
"""Standard deviation of gravity from the IMU, and from treads [rad]."""
TREADS_LEAST = 2
"""Least number of treads horizontal by gravity, above which no tilted ones are considered."""
CURVED = 0.5
"""Probability above which a flight is called curved."""
DISAGREEMENT, DISAGREEMENT_SIGMAS = 2.0 * DEG, 4.0
"""Angle between risers and nosings [rad], and number of standard deviations, above which one of them does not belong to the
stair."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Down:
    """Hypothesis for the direction of gravity."""

    direction: Float[np.ndarray, " 3"]
    """Direction used to sort surfaces."""
    reference: Float[np.ndarray, " 3"]
    """Reference for the tilt of edges and treads, with its standard deviation."""
    sigma_rad: float
    least_levels: int = 0
    """Least number of evenly spaced tread levels: higher for an uncertain direction."""
    directions: tuple[Direction, ...] = ("up", "down")
    """Possible directions of the flight."""
    may_be_unconfirmed: bool = True
    """Whether an unconfirmed detection has a heading."""


def detect_stair(
    frame: RgbdFrame, gravity_C: Float[np.ndarray, " 3"] | None, swept_half_m: float, watch: Stopwatch | None = None
) -> StairDetection:
    """Return the detection result of a frame.

    Args:
        swept_half_m: Half width of the volume swept by the chair; a narrower flight is rejected.
    """
    watch = watch or Stopwatch()
    # A contiguous copy: each memory layout would compile the kernels again.
    frame = replace(frame, depth_m=np.require(frame.depth_m, np.float32, ["C", "W"])) if _is_odd(frame.depth_m) else frame
    blocks = surface_blocks(frame.depth_m, frame.camera)
    if len(blocks.sums) < 3 * LEAST_BLOCKS:
        share = float(np.mean(frame.depth_m > 0.0))
        return refused(
            f"only {len(blocks.sums)} blocks with a plane in the depth image, {share:.0%} of which has a depth: "
            + ("nothing flat in range" if share > HALF else "too little of it")
            + ", or noise beyond three times that of a Kinect 1"
        )
    unit = blocks.unit
    watch.lap("blocks")
    if gravity_C is not None:
        imu_down = _unit(gravity_C)
        if imu_down is None:
            return refused(f"gravity is not a direction but ({', '.join(f'{part:g}' for part in gravity_C)})")
        down = _Down(direction=levelled(imu_down, unit, UPRIGHT), reference=imu_down, sigma_rad=GRAVITY_SIGMA)
        sight = _look_under(down, frame, blocks, swept_half_m, watch)
        return _unless_treads_differ(sight, imu_down, frame, blocks, swept_half_m, watch)
    sight = refused("no gravity, and no treads to estimate it from")
    guess = down_of_treads(unit, LOOKING_AHEAD)
    if guess is not None:
        sight = _look_under(_Down(direction=guess, reference=guess, sigma_rad=TREADS_SIGMA), frame, blocks, swept_half_m, watch)
        if sight.accepted:
            return sight
    guess = down_of_treads(unit, LOOKING_DOWN)
    if guess is not None:
        # Seen from the front, higher parts of furniture are farther away, as on an ascending flight; a descending one is excluded.
        ladder = _Down(
            direction=guess, reference=guess, sigma_rad=TREADS_SIGMA, least_levels=3, directions=("up",), may_be_unconfirmed=False
        )
        tried = _look_under(ladder, frame, blocks, swept_half_m, watch)
        sight = tried if tried.accepted else sight
    return sight


def _unless_treads_differ(
    sight: StairDetection,
    imu_down: Float[np.ndarray, " 3"],
    frame: RgbdFrame,
    blocks: PlanarBlocks,
    swept_half_m: float,
    watch: Stopwatch,
) -> StairDetection:
    """Return the result, or a rejection if it has hardly a tread because the gravity error makes all treads appear tilted.

    Risers alone do not determine the tilt of the edges: gravity does, and its error enters the heading.
    """
    if sight.parts is None or len(sight.parts.treads) >= TREADS_LEAST:
        return sight
    guess = down_of_treads(blocks.unit, LOOKING_AHEAD)
    if guess is None or float(guess @ imu_down) > np.cos(UPRIGHT):
        return sight
    other = _look_under(_Down(direction=guess, reference=guess, sigma_rad=TREADS_SIGMA), frame, blocks, swept_half_m, watch)
    treads = () if other.parts is None else other.parts.treads
    normals = np.array([np.copysign(1.0, tread.unit @ guess) * tread.unit for tread in treads]).reshape(-1, 3)
    off = off_gravity(normals, imu_down)
    if off is None:
        return sight
    return refused(f"{len(treads)} treads agree on a level {off / DEG:.0f}° off the IMU's gravity", edge_count=sight.edge_count)


def _is_odd(depth_m: Float32[np.ndarray, "h w"]) -> bool:
    return depth_m.dtype != np.float32 or not (depth_m.flags.c_contiguous and depth_m.flags.writeable)


def _look_under(down: _Down, frame: RgbdFrame, blocks: PlanarBlocks, swept_half_m: float, watch: Stopwatch) -> StairDetection:
    """Return the detection result of a frame under one hypothesis of gravity."""
    scene = scene_of(frame, blocks, down.direction)
    if scene is None:
        return refused("the camera looks straight up or down")
    sight = _seen_in(scene, frame, blocks, down, swept_half_m, watch)
    if (sight.evidence or 0.0) >= EVIDENCE or down.sigma_rad > GRAVITY_SIGMA:
        return sight
    # Noise far away turns the normals of blocks, but not the planes of whole risers.
    blocks = uncertain_blocks(blocks, frame.camera)
    scene = scene_of(frame, blocks, down.direction, is_uncertain=True)
    if scene is None:
        return sight
    other = _seen_in(scene, frame, blocks, down, swept_half_m, watch)
    return other if other.accepted else sight


def _seen_in(
    scene: Scene, frame: RgbdFrame, blocks: PlanarBlocks, down: _Down, swept_half_m: float, watch: Stopwatch
) -> StairDetection:
    """Return the detection result of the surfaces of a frame."""
    seen = flight_in(scene, down.directions, watch)
    if isinstance(seen, str):
        return refused(seen)
    unconfirmed = UNCONFIRMED <= seen.evidence < EVIDENCE and down.may_be_unconfirmed
    if seen.evidence < EVIDENCE and not unconfirmed:
        return refused(_lacking(seen), edge_count=len(seen.nosings), evidence=seen.evidence)
    fit = fit_edges(
        seen.nosings,
        seen.treads,
        down.reference,
        down.sigma_rad,
        cross(down.direction, seen.facing),
        frame.camera,
        spread_px=blocks.spread_px,
        measures_range=blocks.measures_range,
    )
    watch.lap("direction")
    sight = _answer(frame, blocks, seen, fit, down, swept_half_m, watch)
    watch.lap("geometry")
    return sight


def _answer(
    frame: RgbdFrame, blocks: PlanarBlocks, seen: Flight, fit: EdgeFit, down: _Down, swept_half_m: float, watch: Stopwatch
) -> StairDetection:
    R_BC = frame.camera.R_BC
    in_view = Axes(ahead=fit.ahead, up=-fit.down, right=fit.edge)
    fronts = [(tread.surface, tread.nosing_end(in_view, seen.direction)) for _, on, tread in seen.matched_treads if on]
    sides = sides_of([*(tread for tread, _ in fronts), *seen.risers], blocks, frame.camera, in_view)
    bow = bow_of(fronts, seen.risers, blocks, frame.camera, in_view, fit.warp_px)
    turn, turn_sigma = turn_by(bow, sides)
    chord = fit.edge + turn * fit.ahead
    chord /= np.linalg.norm(chord)
    # The chair's right is the image's left for a rear camera.
    edge = chord if float((R_BC @ chord)[1]) < 0.0 else -chord
    heading = _heading(edge, R_BC)
    # Derivative of the heading with respect to the edge vector, in C.
    forward, left = R_BC[0], R_BC[1]
    a, b = -float(edge @ forward), -float(edge @ left)
    change = (-b * forward + a * left) / (a * a + b * b)
    sigma = float(np.hypot(fit.sigma_of(change), np.hypot(turn_sigma, bow.uneven_rad)))
    runs_m = {id(tread.surface): seen.run_m for _, on, tread in seen.matched_treads if on}
    adjoining_rad = [
        tread.adjoining_tilt_rad(frame.camera, fit.ahead, blocks.noise, runs_m.get(id(tread), np.inf)) for tread in seen.treads
    ]
    level = axes_of(viewing_direction(R_BC) * edge, down.reference, down.sigma_rad, seen.treads, adjoining_rad)
    axes = level.axes
    shape = shape_of(seen, blocks, frame.camera, level, fit.warp_px)
    rejection_reason = _rejection_reason(heading, sigma, fit, shape, seen, down, bow) or _too_narrow(sides, swept_half_m)
    if rejection_reason is not None:
        return refused(rejection_reason, edge_count=len(seen.nosings), evidence=seen.evidence)
    apart = fit.planes_against_lines_rad
    return StairDetection(
        accepted=seen.evidence >= EVIDENCE,
        reason=None if seen.evidence >= EVIDENCE else _lacking(seen),
        unconfirmed=seen.evidence < EVIDENCE,
        heading_rad=heading,
        sigma_rad=sigma,
        edge_direction_C=edge,
        edge_count=len(seen.nosings),
        box_px=_box(frame, blocks, [*seen.risers, *seen.steps]),
        shape=shape,
        stages=None,
        evidence=seen.evidence,
        planes_against_lines_rad=None if apart is None else apart[0],
        axes=directions_of(frame.t_s, level, shape, edge, sigma),
        parts=Parts(
            risers=tuple(seen.risers),
            treads=tuple(seen.treads),
            flight=tuple(seen.nosings),
            aside=cross(down.direction, seen.facing),
            blocks=blocks,
        ),
        draw_map=cache(partial(_drawn_map, frame, blocks, seen, axes, shape, sides, watch)),
    )


def _drawn_map(
    frame: RgbdFrame,
    blocks: PlanarBlocks,
    seen: Flight,
    axes: Axes,
    shape: StairShape,
    sides: tuple[Side | None, Side | None],
    watch: Stopwatch,
    swept_half_m: float,
) -> StairMap:
    watch.resume()
    stair_map = map_of(frame, blocks, seen.nosings, axes, shape, sides, swept_half_m)
    watch.lap("map")
    return stair_map


def _rejection_reason(
    heading_rad: float,
    sigma_rad: float,
    fit: EdgeFit,
    shape: StairShape,
    seen: Flight,
    down: _Down,
    bow: Bow,
) -> str | None:
    """Return the reason for rejection as a stair, or None."""
    if shape.slope_rad > SLOPE_LIMIT:
        return f"a slope of {shape.slope_rad / DEG:.0f}° is too steep to drive on"
    if seen.levels < down.least_levels:
        return f"no gravity, and {seen.levels} evenly spaced level(s) to replace it; {down.least_levels} needed"
    if abs(heading_rad) > HEADING_LIMIT:
        return f"heading {heading_rad / DEG:.0f}° is beyond ±{HEADING_LIMIT / DEG:.0f}°"
    if sum(nosing.has_direction for nosing in seen.nosings) < STRAIGHT_LEAST:
        return "one edge in view has a direction: a straight flight is not distinguished from winders"
    if fit.agreeing < AGREEING or fit.agreeing * len(seen.nosings) < 1.5:
        return f"nosings turned by up to {fit.widest_rad / DEG:.1f}° against each other: no straight flight"
    turned = fit.curvature_1_m * float(np.mean([nosing.ahead_m for nosing in seen.nosings]))
    if fit.curved > CURVED and abs(turned) > SIGMA_LIMIT:
        return f"edges turn by {fit.curvature_1_m * seen.run_m / DEG:+.1f}° at each step: no straight flight"
    apart = fit.planes_against_lines_rad
    if apart is not None and abs(apart[0]) > max(DISAGREEMENT, DISAGREEMENT_SIGMAS * apart[1]):
        return f"risers and nosings disagree by {abs(apart[0]) / DEG:.1f}°"
    if not sigma_rad <= SIGMA_LIMIT and bow.bowed > 0.5:
        return (
            f"edges bowed by {abs(bow.curvature_1_m):.2f} per metre: the heading is known to ±{1.96 * sigma_rad / DEG:.1f}° only, "
            f"{1.96 * SIGMA_LIMIT / DEG:.1f}° needed"
        )
    if not sigma_rad <= SIGMA_LIMIT:
        return f"the heading is known to ±{1.96 * sigma_rad / DEG:.1f}° only"
    return None


def _too_narrow(sides: tuple[Side | None, Side | None], swept_half_m: float) -> str | None:
    """Return the reason for rejection of a flight whose visible width is less than the chair sweeps, or None."""
    left, right = sides
    if left is None or right is None or right.aside_m - left.aside_m >= 2.0 * swept_half_m:
        return None
    return (
        f"the flight is {right.aside_m - left.aside_m:.2f} m wide between {left.kind} and {right.kind} side; the chair sweeps "
        f"{2.0 * swept_half_m:.2f} m"
    )


def _unit(gravity_C: Float[np.ndarray, " 3"]) -> Float[np.ndarray, " 3"] | None:
    length = float(np.linalg.norm(gravity_C))
    return gravity_C / length if np.isfinite(length) and length > 0.0 else None


def _heading(edge: Float[np.ndarray, " 3"], R_BC: Float[np.ndarray, "3 3"]) -> float:
    """Return ψ = atan2(-e·forward, e·right) of an edge pointing right."""
    e_B = R_BC @ edge
    return float(np.arctan2(-e_B[0], -e_B[1]))


def _lacking(seen: Flight) -> str:
    """Return which evidence is lacking for a stair."""
    return (
        f"steps of {1e3 * seen.rise_m:.0f} by {1e3 * seen.run_m:.0f} mm would explain what is seen, evidence "
        f"{seen.evidence:.1f} of {EVIDENCE:g} needed"
    )


def _box(frame: RgbdFrame, blocks: PlanarBlocks, surfaces: list[Surface]) -> tuple[int, int, int, int] | None:
    if not surfaces:
        return None
    camera = frame.camera
    points = blocks.centres[np.concatenate([surface.blocks for surface in surfaces])]
    u = camera.fx_px * points[:, 0] / points[:, 2] + camera.cx_px
    v = camera.fy_px * points[:, 1] / points[:, 2] + camera.cy_px
    return int(u.min()), int(v.min()), int(u.max()), int(v.max())
