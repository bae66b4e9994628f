"""The estimator that drives: one edge direction from all treads and risers in view.

Every tread and every riser contains the direction of the stair's edges: it is the one direction at right angles to all
their normals. Gravity sorts surfaces into treads and risers, a vote finds the risers' azimuth, surfaces are joined
across the image (their baseline is the stair's width), and the direction is the weighted null direction of all normals.
The heading follows from it in the chair's frame. A frame is refused, with the reason, unless two parallel risers a
step apart are seen, neither taller than a step: walls are no stair. Without gravity the treads tell down, and more of a
stair must be seen.
"""

import itertools
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from treadline.angles import DEG
from treadline.perception.direction import fit_edges
from treadline.perception.down import down_of_treads
from treadline.perception.planes import Blocks, Surface, joined, surface_blocks
from treadline.perception.sight import Sight, StairShape, refused
from treadline.signals import RgbdFrame

UPRIGHT = 18.0 * DEG
"""How far a block's normal may lie from vertical (tread) or horizontal (riser)."""
VOTE_LIMIT = 50.0 * DEG
"""Azimuth beyond which a vertical surface is a side wall."""
VOTE_BIN = 2.0 * DEG
RISER_SPREAD = 14.0 * DEG
"""How far a riser block's azimuth may lie from the vote."""
RISER_GAP_M, TREAD_GAP_M = 0.06, 0.045
"""Levels further apart are different surfaces: less than half of the smallest run and rise."""
LEAST_BLOCKS = 4
STEP_RUN_M, STEP_RISE_M = (0.15, 0.45), (0.08, 0.25)
HEADING_LIMIT = 45.0 * DEG
GRAVITY_SIGMA, TREADS_SIGMA = 0.5 * DEG, 3.0 * DEG
"""Trust in the IMU's idea of down, and in one taken from the treads."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Axes:
    """Directions in C that gravity and the camera give."""

    down: Float[np.ndarray, " 3"]
    ahead: Float[np.ndarray, " 3"]
    """Horizontal, as far as possible where the camera looks."""
    right: Float[np.ndarray, " 3"]


def look_robust(frame: RgbdFrame, gravity_C: Float[np.ndarray, " 3"] | None) -> Sight:
    """Return what a frame says of the stair."""
    blocks = surface_blocks(frame.depth_m, frame.camera)
    if len(blocks.sums) < 3 * LEAST_BLOCKS:
        return refused(f"only {len(blocks.sums)} blocks with a plane in the depth image")
    unit = blocks.normals / np.linalg.norm(blocks.normals, axis=1, keepdims=True)
    down = down_of_treads(unit) if gravity_C is None else _unit(gravity_C)
    if down is None:
        return refused("no gravity, and no treads to tell it from" if gravity_C is None else "gravity is not a direction")
    axes = _axes(down)
    if axes is None:
        return refused("the camera looks straight up or down")
    rise = unit @ axes.down
    vertical = np.abs(rise) < np.sin(UPRIGHT)
    level = np.abs(rise) > np.cos(UPRIGHT)
    azimuth = np.arctan2(unit @ axes.right, unit @ axes.ahead)
    voted = _vote(azimuth, vertical)
    if voted is None:
        return refused("no riser faces the camera")
    facing = np.cos(voted) * axes.ahead + np.sin(voted) * axes.right
    risers = joined(blocks, vertical & (np.abs(_wrapped(azimuth - voted)) < RISER_SPREAD), facing, RISER_GAP_M, LEAST_BLOCKS)
    risers = [surface for surface in risers if _is_riser(surface, blocks, facing, axes.down)]
    risers = _flight(risers)
    pairs = _steps([surface.level for surface in risers], STEP_RUN_M)
    if not pairs:
        return refused(f"{len(risers)} riser(s) in view, none a step from another")
    treads = joined(blocks, level, -axes.down, TREAD_GAP_M, LEAST_BLOCKS)
    treads = [surface for surface in treads if _turned_from(surface, axes.down) < UPRIGHT]
    R_BC = frame.camera.R_BC
    down_sigma = TREADS_SIGMA if gravity_C is None else GRAVITY_SIGMA
    fit = fit_edges(risers, treads, axes.down, down_sigma, np.cross(axes.down, facing))
    shape = _shape(risers, treads)
    if gravity_C is None and shape is None and len(pairs) < 2:
        return refused("no gravity, and neither two treads nor three risers a step apart to make up for it")
    edge = fit.edge if float((R_BC @ fit.edge)[1]) < 0.0 else -fit.edge
    heading = _heading(edge, R_BC)
    if abs(heading) > HEADING_LIMIT:
        return refused(f"heading {heading / DEG:.0f}° is beyond ±{HEADING_LIMIT / DEG:.0f}°")
    return Sight(
        accepted=True,
        reason=None,
        heading_rad=heading,
        sigma_rad=fit.sigma_about(R_BC.T[:, 2]),
        edge_direction_C=edge,
        edge_count=len(risers),
        box_px=_box(frame, blocks, risers + treads),
        shape=shape,
        stages=None,
    )


def _unit(gravity_C: Float[np.ndarray, " 3"]) -> Float[np.ndarray, " 3"] | None:
    length = float(np.linalg.norm(gravity_C))
    return gravity_C / length if np.isfinite(length) and length > 0.0 else None


def _axes(down: Float[np.ndarray, " 3"]) -> _Axes | None:
    ahead = np.array([0.0, 0.0, 1.0]) - down[2] * down
    length = float(np.linalg.norm(ahead))
    if length < 0.2:
        return None
    ahead = ahead / length
    return _Axes(down=down, ahead=ahead, right=np.cross(down, ahead))


def _vote(azimuth: Float[np.ndarray, " b"], vertical: Bool[np.ndarray, " b"]) -> float | None:
    """Return the azimuth most vertical blocks agree on."""
    seen = azimuth[vertical & (np.abs(azimuth) < VOTE_LIMIT)]
    if seen.size < 2 * LEAST_BLOCKS:
        return None
    edges = np.arange(-VOTE_LIMIT, VOTE_LIMIT + VOTE_BIN, VOTE_BIN)
    counts = np.histogram(seen, edges)[0].astype(float)
    smooth = np.convolve(counts, [0.5, 1.0, 1.0, 1.0, 0.5], mode="same")
    peak = float(edges[int(np.argmax(smooth))] + 0.5 * VOTE_BIN)
    for width in (10.0 * DEG, 6.0 * DEG):
        near = seen[np.abs(seen - peak) < width]
        peak = float(np.median(near)) if near.size else peak
    return peak


def _steps(levels: list[float], limits: tuple[float, float]) -> list[float]:
    gaps = np.diff(np.sort(np.array(levels)))
    return [float(gap) for gap in gaps if limits[0] <= gap <= limits[1]]


def _flight(risers: list[Surface]) -> list[Surface]:
    """Return the risers that follow each other no more than a step apart, of several such rows the one most seen."""
    risers = sorted(risers, key=lambda surface: surface.level)
    levels = np.array([surface.level for surface in risers])
    ends = [0, *(np.flatnonzero(np.diff(levels) > STEP_RUN_M[1]) + 1), len(risers)]
    rows = [risers[first:last] for first, last in itertools.pairwise(ends)]
    return max(rows, key=lambda row: sum(surface.blocks.size for surface in row))


def _is_riser(surface: Surface, blocks: Blocks, facing: Float[np.ndarray, " 3"], down: Float[np.ndarray, " 3"]) -> bool:
    """Return whether a surface faces the way the vote says and is no taller than a step: walls are."""
    tall = float(np.ptp(blocks.centres[surface.blocks] @ down))
    return _turned_from(surface, facing) < RISER_SPREAD and tall < STEP_RISE_M[1]


def _turned_from(surface: Surface, direction: Float[np.ndarray, " 3"]) -> float:
    unit = surface.normal / np.linalg.norm(surface.normal)
    return float(np.arccos(min(1.0, abs(float(unit @ direction)))))


def _heading(edge: Float[np.ndarray, " 3"], R_BC: Float[np.ndarray, "3 3"]) -> float:
    """Return ψ = atan2(-e·forward, e·right) of an edge that points right."""
    e_B = R_BC @ edge
    return float(np.arctan2(-e_B[0], -e_B[1]))


def _shape(risers: list[Surface], treads: list[Surface]) -> StairShape | None:
    runs = _steps([surface.level for surface in risers], STEP_RUN_M)
    rises = _steps([surface.level for surface in treads], STEP_RISE_M)
    if not runs or not rises:
        return None
    run, rise = float(np.median(runs)), float(np.median(rises))
    return StairShape(
        rise_m=rise,
        run_m=run,
        slope_rad=float(np.arctan2(rise, run)),
        distance_m=min(surface.level for surface in risers),
    )


def _box(frame: RgbdFrame, blocks: Blocks, surfaces: list[Surface]) -> tuple[int, int, int, int]:
    camera = frame.camera
    points = blocks.centres[np.concatenate([surface.blocks for surface in surfaces])]
    u = camera.fx_px * points[:, 0] / points[:, 2] + camera.cx_px
    v = camera.fy_px * points[:, 1] / points[:, 2] + camera.cy_px
    return int(u.min()), int(v.min()), int(u.max()), int(v.max())


def _wrapped(angle: Float[np.ndarray, " b"]) -> Float[np.ndarray, " b"]:
    return (angle + np.pi) % (2.0 * np.pi) - np.pi
