"""The map of what lies ahead: nosings, the flight's end, walls and rails, and what stands in the way.

Ahead is where the camera looks, which may be back over the chair: it then drives that way.
"""

from collections.abc import Sequence
from statistics import median

import numpy as np
from jaxtyping import Float

from treadline.angles import DEG
from treadline.perception import kernels
from treadline.perception.geometry import first_crowd, normal_of, points_of, way_of
from treadline.perception.nosings import Axes, Nosing
from treadline.perception.planes import Blocks
from treadline.perception.sight import StairShape
from treadline.signals import RgbdFrame, StairMap

SIDE_WALL = 15.0 * DEG
"""How far a side wall's normal may lie from the edges' direction."""
WALL_BLOCKS = 16
SWEPT_HEIGHT_M = 1.5
"""A seated person's, above the nosing plane."""
CLEAR_M = 0.06
"""Above the nosing plane: what is lower passes under the belts or is the stair's own irregularity."""
BLUR_RAD = 0.035
"""Above an edge, by which its depth may spread: ten pixels of 320, more than a Kinect's matching window."""
LEAST_POINTS = 12
"""Of the quarter-resolution image that stand together for something to be there."""
STRIDE_AT_240 = 2
BIN_M = 0.05
RAIL_BIN_M, RAIL_M = 0.1, 0.5
"""Along the flight: what stands over this length at one place across it is a rail or a wall, not a thing on a step."""
RAIL_THICK_M = 1.5 * BIN_M
"""In front of a wall or rail that still is part of it."""
RAIL_ASIDE_M = 0.25
"""From the chair's middle: what lies closer is in the way, however long."""
CELLS = 10_000
"""More than there are bins along any flight, none of which starts behind the camera."""
END_MARGIN_M = 0.12
"""How far behind the next step's place the depth must lie for the step to be absent: less than half a run."""
END_POINTS, END_SHARE = 40, 0.7
ASIDES_M, RISER_SHARES, TREAD_SHARES = np.linspace(-0.25, 0.25, 15), np.linspace(0.82, 0.97, 7), np.linspace(1.25, 1.9, 9)
"""Where a next step is looked for: across the flight, by height of its riser and, ahead, by runs to its tread."""


def map_of(
    frame: RgbdFrame, blocks: Blocks, flight: Sequence[Nosing], axes: Axes, shape: StairShape, swept_half_m: float
) -> StairMap:
    """Return what lies ahead, in the chair's frame.

    Args:
        swept_half_m: What the chair sweeps to either side.
    """
    R_BC, p_BC = frame.camera.R_BC, np.array(frame.camera.mount_m)
    points = points_of(flight, axes, shape)
    way = way_of(R_BC)
    nosings = np.array([_crossing(point, R_BC, p_BC, axes.right) for point in points])
    middle = float(-(R_BC.T @ p_BC) @ axes.right)
    ends = _ends(frame, points, axes, shape)
    standing = _standing(frame, points, axes, shape, ends=ends)
    rails = _along_the_flight(standing, axes)
    rails = rails[np.abs(rails - middle) > RAIL_ASIDE_M]
    walls = _side_walls(blocks, axes, middle)
    aside = rails - middle
    free = (_nearest(walls[0], -aside[aside < 0.0]), _nearest(walls[1], aside[aside > 0.0]))
    left, right = free if way > 0.0 else free[::-1]
    return StairMap(
        t_s=frame.t_s,
        direction=shape.direction,
        nosings_B=nosings[np.argsort(way * nosings[:, 0])],
        rise_m=shape.rise_m,
        run_m=shape.run_m,
        slope_rad=shape.slope_rad,
        ends=ends,
        left_wall_m=left,
        right_wall_m=right,
        obstacle_m=_obstacle(standing, free, axes, R_BC, p_BC, swept_half_m),
    )


def _crossing(
    point: Float[np.ndarray, " 3"], R_BC: Float[np.ndarray, "3 3"], p_BC: Float[np.ndarray, " 3"], edge: Float[np.ndarray, " 3"]
) -> Float[np.ndarray, " 3"]:
    """Return where an edge meets the chair's middle plane, in B."""
    p_B, e_B = R_BC @ point + p_BC, R_BC @ edge
    return np.asarray(p_B - p_B[1] / e_B[1] * e_B)


def _side_walls(blocks: Blocks, axes: Axes, middle: float) -> tuple[float | None, float | None]:
    """Return the distances of the nearest walls along the flight, left and right of the chair's middle as the camera sees it."""
    along = np.abs(blocks.unit @ axes.right) > np.cos(SIDE_WALL)
    places = blocks.centres[along] @ axes.right - middle
    return _group_nearest(-places), _group_nearest(places)


def _group_nearest(places: Float[np.ndarray, " k"]) -> float | None:
    group = first_crowd(places[places > 0.1], BIN_M, WALL_BLOCKS)
    return median(group) if group else None


def _standing(
    frame: RgbdFrame, points: Sequence[Float[np.ndarray, " 3"]], axes: Axes, shape: StairShape, *, ends: bool
) -> Float[np.ndarray, "k 3"]:
    """Return points of C that stand above the flight, from the camera to beyond what is seen of it.

    Something on the nearest steps hides their nosings: before the first one seen that leads up, the tread below it is taken to go
    on. A flight that falls starts at the nosing plane: what the chair stands on is higher.
    """
    camera = frame.camera
    normal = normal_of(axes, shape)
    ahead = [float(point @ axes.ahead) for point in points]
    first = min(ahead) - shape.run_m
    return kernels.points_above(
        frame.depth_m,
        max(1, round(STRIDE_AT_240 * camera.height_px / 240)),
        camera.fx_px,
        camera.fy_px,
        camera.cx_px,
        camera.cy_px,
        np.stack([axes.ahead, normal, axes.up]),
        median(float(point @ normal) for point in points),
        float(min(points, key=lambda point: float(point @ axes.ahead)) @ axes.up) - shape.rise_m,
        CLEAR_M,
        BLUR_RAD,
        SWEPT_HEIGHT_M,
        0.0 if shape.direction == "up" else first,
        first,
        max(ahead) + (0.5 if ends else 2.0) * shape.run_m,
    )


def _along_the_flight(standing: Float[np.ndarray, "k 3"], axes: Axes) -> Float[np.ndarray, " j"]:
    """Return the places across the flight, to the right, at which something goes on along it: rails and walls."""
    if not len(standing):
        return np.empty(0)
    ahead, aside = np.round(standing @ np.stack([axes.ahead / RAIL_BIN_M, axes.right / BIN_M], axis=1)).astype(np.int64).T
    # A rail may lie across two bins.
    cells = np.unique(np.concatenate([aside, aside + 1]) * CELLS + np.tile(ahead, 2))
    places, counts = np.unique(np.floor_divide(cells, CELLS), return_counts=True)
    return np.asarray((places[counts >= RAIL_M / RAIL_BIN_M] - 0.5) * BIN_M)


def _obstacle(
    standing: Float[np.ndarray, "k 3"],
    free_m: tuple[float | None, float | None],
    axes: Axes,
    R_BC: Float[np.ndarray, "3 3"],
    p_BC: Float[np.ndarray, " 3"],
    swept_half_m: float,
) -> float | None:
    """Return how far ahead of the chair something stands between its sides; walls and rails and what is behind them left out.

    Args:
        free_m: Distance to what goes along the flight at the left and at the right, as the camera sees it.
    """
    left_m, right_m = free_m
    aside = standing @ axes.right + float((R_BC.T @ p_BC) @ axes.right)
    within = np.ones(len(standing), dtype=bool)
    if left_m is not None:
        within &= aside > RAIL_THICK_M - left_m
    if right_m is not None:
        within &= aside < right_m - RAIL_THICK_M
    x, y, _ = (standing[within] @ R_BC.T + p_BC).T
    far = way_of(R_BC) * x
    return next(iter(first_crowd(far[(np.abs(y) < swept_half_m) & (far > 0.0)], BIN_M, LEAST_POINTS)), None)


def _nearest(wall: float | None, rails: Float[np.ndarray, " j"]) -> float | None:
    """Return the nearer of a wall's plane and of rails that stand out from it by more than a bin."""
    rail = float(rails.min()) if rails.size else None
    if wall is None or rail is None:
        return rail if wall is None else wall
    return rail if rail < wall - 1.2 * BIN_M else wall


def _ends(frame: RgbdFrame, points: Sequence[Float[np.ndarray, " 3"]], axes: Axes, shape: StairShape) -> bool:
    """Return whether it is seen that no step follows the last nosing.

    Where the next step would stand, depth is compared with it: something further away, where a riser should be, or a level
    that goes on, where a tread should have ended, shows a landing or a floor.
    """
    last = max(points, key=lambda point: float(point @ axes.ahead))
    ahead, up = float(last @ axes.ahead), float(last @ axes.up)
    middle = median(float(point @ axes.right) for point in points)
    if shape.direction == "up":
        # Close below the next edge: a board without a riser is no thicker.
        places, heights = np.array([ahead + shape.run_m]), up + RISER_SHARES * shape.rise_m
    else:
        places, heights = ahead + shape.run_m * TREAD_SHARES, np.array([up - shape.rise_m])
    camera = frame.camera
    seen, expected = kernels.depths_at(
        frame.depth_m,
        places,
        middle + ASIDES_M,
        heights,
        np.stack([axes.ahead, axes.right, axes.up]),
        camera.fx_px,
        camera.fy_px,
        camera.cx_px,
        camera.cy_px,
    )
    if seen.size < END_POINTS:
        return False
    gone = seen > expected + END_MARGIN_M if shape.direction == "up" else np.abs(seen - expected) < 0.25 * shape.rise_m
    return bool(gone.mean() > END_SHARE)
