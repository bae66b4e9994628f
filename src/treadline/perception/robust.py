"""The estimator that drives: one edge direction from all treads, risers and nosings in view.

Gravity sorts surfaces into treads and risers; risers and lines vote for the azimuth; surfaces are joined across the image
(their baseline is the stair's width); the edges' direction is the one at right angles to all normals; the heading follows
from it in the chair's frame. A frame is refused, with the reason, unless two nosings follow each other as on a stair: walls,
shelves and tables do not. Without gravity the treads tell down, and more of a stair must be seen.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from treadline.angles import DEG
from treadline.perception.direction import EdgeFit, fit_edges
from treadline.perception.down import down_of_treads, levelled
from treadline.perception.geometry import axes_of, directions_of, levels_of, map_of, shape_of
from treadline.perception.nosings import STEP_RISE_M, Axes, Direction, Nosing, direction_of, flight_of, nosings_of
from treadline.perception.planes import Blocks, Surface, joined, surface_blocks
from treadline.perception.sight import Parts, Sight, StairShape, refused
from treadline.perception.votes import line_votes, votes_of
from treadline.signals import RgbdFrame

UPRIGHT = 18.0 * DEG
"""How far a block's normal may lie from vertical (tread) or horizontal (riser)."""
RISER_SPREAD = 14.0 * DEG
"""How far a riser block's azimuth may lie from the vote."""
RISER_GAP_M, TREAD_GAP_M = 0.06, 0.045
"""Levels further apart are different surfaces: less than half of the smallest run and rise."""
LEAST_BLOCKS = 8
HEADING_LIMIT = 45.0 * DEG
SLOPE_LIMIT = 45.0 * DEG
SIGMA_LIMIT = 1.5 * DEG
LOOKING_AHEAD, LOOKING_DOWN = (5.0 * DEG, 70.0 * DEG), (60.0 * DEG, 100.0 * DEG)
"""How far down the camera may look where treads must tell: closer to level, treads vanish; closer to straight down, a wall
seen from the front and a floor seen from above are alike."""
GRAVITY_SIGMA, TREADS_SIGMA = 0.5 * DEG, 3.0 * DEG
"""Trust in the IMU's idea of down, and in one taken from the treads."""
DISAGREEMENT, DISAGREEMENT_SIGMAS = 2.0 * DEG, 4.0
"""Between risers and nosings, from which on one of them is something else."""
LEVEL_LEAST = 0.2
"""Of the chair's forward axis that must be level to tell where ahead is."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Seen:
    """A flight, under one idea of where it faces."""

    direction: Direction
    risers: list[Surface]
    treads: list[Surface]
    flight: list[Nosing]
    facing: Float[np.ndarray, " 3"]


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


def look_robust(frame: RgbdFrame, gravity_C: Float[np.ndarray, " 3"] | None) -> Sight:
    """Return what a frame says of the stair."""
    blocks = surface_blocks(frame.depth_m, frame.camera)
    if len(blocks.sums) < 3 * LEAST_BLOCKS:
        return refused(f"only {len(blocks.sums)} blocks with a plane in the depth image")
    unit = blocks.unit
    if gravity_C is not None:
        told = _unit(gravity_C)
        if told is None:
            return refused("gravity is not a direction")
        down = _Down(direction=levelled(told, unit, UPRIGHT), reference=told, sigma_rad=GRAVITY_SIGMA)
        return _look_under(down, frame, blocks, unit)
    sight = refused("no gravity, and no treads to tell it from")
    guess = down_of_treads(unit, LOOKING_AHEAD)
    if guess is not None:
        sight = _look_under(_Down(direction=guess, reference=guess, sigma_rad=TREADS_SIGMA), frame, blocks, unit)
        if sight.accepted:
            return sight
    guess = down_of_treads(unit, LOOKING_DOWN)
    if guess is not None:
        # Seen from the front, furniture steps back from the camera further up: a flight that falls, were it level.
        ladder = _Down(direction=guess, reference=guess, sigma_rad=TREADS_SIGMA, least_levels=3, directions=("up",))
        tried = _look_under(ladder, frame, blocks, unit)
        sight = tried if tried.accepted else sight
    return sight


def _look_under(down: _Down, frame: RgbdFrame, blocks: Blocks, unit: Float[np.ndarray, "b 3"]) -> Sight:
    """Return what a frame says if down is where one idea has it."""
    level = _level_axes(down.direction, frame.camera.R_BC)
    if level is None:
        return refused("the camera looks straight up or down")
    rise = unit @ down.direction
    treads = joined(
        frame.depth_m,
        frame.camera,
        blocks,
        np.abs(rise) > np.cos(UPRIGHT),
        level.up,
        gap_m=TREAD_GAP_M,
        least=LEAST_BLOCKS,
    )
    # A level surface above the eye is the underside of something.
    treads = [tread for tread in treads if _turned_from(tread, level.up) < UPRIGHT and float(tread.centre @ level.up) < 0.0]
    seen = _best_flight(frame, blocks, unit, np.abs(rise) < np.sin(UPRIGHT), treads, level, down.directions)
    if isinstance(seen, str):
        return refused(seen)
    fit = fit_edges(seen.flight, seen.treads, down.reference, down.sigma_rad, np.cross(down.direction, seen.facing))
    return _answer(frame, blocks, seen, fit, down)


def _answer(frame: RgbdFrame, blocks: Blocks, seen: _Seen, fit: EdgeFit, down: _Down) -> Sight:
    R_BC = frame.camera.R_BC
    edge = fit.edge if float((R_BC @ fit.edge)[1]) < 0.0 else -fit.edge
    heading = _heading(edge, R_BC)
    # How the heading turns with the edge, in C.
    forward, left = R_BC[0], R_BC[1]
    a, b = -float(edge @ forward), -float(edge @ left)
    change = (-b * forward + a * left) / (a * a + b * b)
    sigma = fit.sigma_of(change)
    tilted = axes_of(edge, down.reference, down.sigma_rad, seen.treads)
    axes = tilted.axes
    shape = shape_of(seen.flight, seen.treads, axes, seen.direction)
    doubt = _doubt(heading, sigma, fit, shape, seen, down, levels_of(seen.treads, axes))
    if doubt is not None:
        return refused(doubt, edge_count=len(seen.flight))
    apart = fit.planes_against_lines_rad
    return Sight(
        accepted=True,
        reason=None,
        heading_rad=heading,
        sigma_rad=sigma,
        edge_direction_C=edge,
        edge_count=len(seen.flight),
        box_px=_box(frame, blocks, [*seen.risers, *seen.treads]),
        shape=shape,
        stages=None,
        planes_against_lines_rad=None if apart is None else apart[0],
        axes=None if shape is None else directions_of(frame.t_s, seen.flight, tilted, shape, sigma),
        stair_map=None if shape is None else map_of(frame, blocks, seen.flight, axes, shape),
        parts=Parts(risers=tuple(seen.risers), treads=tuple(seen.treads), flight=tuple(seen.flight), blocks=blocks),
    )


def _doubt(
    heading_rad: float, sigma_rad: float, fit: EdgeFit, shape: StairShape | None, seen: _Seen, down: _Down, levels: int
) -> str | None:
    """Return why this is no stair to steer by, or None."""
    if shape is None and len(seen.flight) < 3:
        return "two risers a step apart, but no tread to tell how high the step is"
    if shape is not None and shape.slope_rad > SLOPE_LIMIT:
        return f"a slope of {shape.slope_rad / DEG:.0f}° is no stair to drive on"
    if levels < down.least_levels:
        return f"no gravity, and {levels} level(s) evenly apart to make up for it, {down.least_levels} needed"
    if abs(heading_rad) > HEADING_LIMIT:
        return f"heading {heading_rad / DEG:.0f}° is beyond ±{HEADING_LIMIT / DEG:.0f}°"
    if fit.scatter_rad > max(DISAGREEMENT, DISAGREEMENT_SIGMAS * fit.alpha_sigma_rad):
        return f"nosings turned by {fit.scatter_rad / DEG:.1f}° against each other"
    apart = fit.planes_against_lines_rad
    if apart is not None and abs(apart[0]) > max(DISAGREEMENT, DISAGREEMENT_SIGMAS * apart[1]):
        return f"risers and nosings disagree by {abs(apart[0]) / DEG:.1f}°"
    if sigma_rad > SIGMA_LIMIT:
        return f"the heading is known to ±{1.96 * sigma_rad / DEG:.1f}° only"
    return None


def _unit(gravity_C: Float[np.ndarray, " 3"]) -> Float[np.ndarray, " 3"] | None:
    length = float(np.linalg.norm(gravity_C))
    return gravity_C / length if np.isfinite(length) and length > 0.0 else None


def _level_axes(down: Float[np.ndarray, " 3"], R_BC: Float[np.ndarray, "3 3"]) -> Axes | None:
    """Return level axes with ahead where the chair's front points, or up the image where the camera looks straight down."""
    for towards in (R_BC[0], np.array([0.0, -1.0, 0.0])):
        ahead = towards - float(towards @ down) * down
        length = float(np.linalg.norm(ahead))
        if length > LEVEL_LEAST:
            ahead = ahead / length
            return Axes(ahead=ahead, up=-down, right=np.cross(down, ahead))
    return None


def _best_flight(
    frame: RgbdFrame,
    blocks: Blocks,
    unit: Float[np.ndarray, "b 3"],
    vertical: Bool[np.ndarray, " b"],
    treads: list[Surface],
    level: Axes,
    directions: tuple[Direction, ...],
) -> _Seen | str:
    """Return the flight that most speaks for, or why there is none."""
    azimuth = np.arctan2(unit @ level.right, unit @ level.ahead)
    most_risers, best, best_weight, voted = 0, None, 0.0, False
    for peak in votes_of(azimuth[vertical], *line_votes(treads, frame.camera, level)):
        voted = True
        facing = np.cos(peak) * level.ahead + np.sin(peak) * level.right
        axes = Axes(ahead=facing, up=level.up, right=np.cross(-level.up, facing))
        members = vertical & (np.abs(azimuth - peak) < RISER_SPREAD)
        risers = joined(frame.depth_m, frame.camera, blocks, members, facing, gap_m=RISER_GAP_M, least=LEAST_BLOCKS)
        risers = [surface for surface in risers if _is_riser(surface, blocks, axes)]
        most_risers = max(most_risers, len(risers))
        direction = "up" if len(risers) >= 2 else direction_of(treads, axes)
        if direction is None or direction not in directions:
            continue
        nosings = nosings_of(risers if direction == "up" else [], treads, blocks, frame.camera, axes, direction)
        flight = flight_of(nosings, axes, direction)
        weight = sum(nosing.weight for nosing in flight)
        if weight > best_weight:
            best_weight = weight
            best = _Seen(
                direction=direction,
                risers=[n.riser for n in flight if n.riser is not None],
                treads=treads,
                flight=flight,
                facing=facing,
            )
    if best is not None:
        return best
    if not voted:
        return "no riser and no nosing faces the camera"
    return f"{most_risers} riser(s) in view, and no two nosings a step apart whose heights are seen"


def _is_riser(surface: Surface, blocks: Blocks, axes: Axes) -> bool:
    """Return whether a surface faces the way the vote says and is no taller than a step: walls are."""
    tall = float(np.ptp(blocks.centres[surface.blocks] @ axes.up))
    return _turned_from(surface, axes.ahead) < RISER_SPREAD and tall < STEP_RISE_M[1]


def _turned_from(surface: Surface, direction: Float[np.ndarray, " 3"]) -> float:
    return float(np.arccos(min(1.0, abs(float(surface.unit @ direction)))))


def _heading(edge: Float[np.ndarray, " 3"], R_BC: Float[np.ndarray, "3 3"]) -> float:
    """Return ψ = atan2(-e·forward, e·right) of an edge that points right."""
    e_B = R_BC @ edge
    return float(np.arctan2(-e_B[0], -e_B[1]))


def _box(frame: RgbdFrame, blocks: Blocks, surfaces: list[Surface]) -> tuple[int, int, int, int]:
    camera = frame.camera
    points = blocks.centres[np.concatenate([surface.blocks for surface in surfaces])]
    u = camera.fx_px * points[:, 0] / points[:, 2] + camera.cx_px
    v = camera.fy_px * points[:, 1] / points[:, 2] + camera.cy_px
    return int(u.min()), int(v.min()), int(u.max()), int(v.max())
