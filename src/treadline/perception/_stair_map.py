"""Map of the stair in the camera's viewing direction: nosings, end of the flight, walls, rails and obstacles.

For a rear camera the viewing direction, and the direction of travel, is backwards.
"""

from collections.abc import Sequence
from statistics import median

import numpy as np
from jaxtyping import Float

from treadline.core.angles import DEG
from treadline.core.camera_images import RgbdFrame
from treadline.core.rotations import Rotation, Vector3
from treadline.core.signals import StairMap
from treadline.perception import _stair_map_kernels as point_kernels
from treadline.perception._form import Side
from treadline.perception._stair_shape import StairShape
from treadline.perception._step_parts import Axes, NosingObservation, viewing_direction
from treadline.perception.free_ground import SWEPT_HEIGHT_M
from treadline.perception.plane_segmentation import PlanarBlocks

SIDE_WALL = 15.0 * DEG
"""Largest angle between the normal of a side wall and the edge direction [rad]."""
WALL_BLOCKS = 16
"""Least number of blocks of a wall."""
CLEAR_M = 0.06
"""Height above the nosing plane below which points are ignored [m]: lower objects pass under the belts or are irregularities of the
stair."""
BLUR_RAD = 0.035
"""Angle above an edge over which its depth can be smeared [rad]: ten pixels of 320, more than the matching window of a Kinect."""
LEAST_POINTS = 12
"""Least number of neighbouring points of an obstacle, in the quarter-resolution image."""
STRIDE_AT_240 = 2
"""Subsampling of the image at 240 rows [px]."""
BIN_M = 0.05
"""Width of a histogram bin [m]."""
RAIL_BIN_M, RAIL_M = 0.1, 0.5
"""Bin along the flight and least length of a rail or wall [m]: longer objects at one lateral position are rails or walls, not
objects on a step."""
RAIL_THICK_M = 1.5 * BIN_M
"""Depth in front of a wall or rail assigned to it [m]."""
RAIL_ASIDE_M = 0.25
"""Lateral distance from the chair's middle within which any object is an obstacle, however long [m]."""
CELLS = 10_000
"""Upper limit of the number of bins along a flight, counted from the camera."""
END_MARGIN_M = 0.12
"""Depth behind the expected next step that shows its absence [m]: less than half a run."""
END_POINTS, END_SHARE = 40, 0.7
"""Least number of grid points and least fraction of them for the end of a flight."""
ASIDES_M, RISER_SHARES, TREAD_SHARES = np.linspace(-0.25, 0.25, 15), np.linspace(0.82, 0.97, 7), np.linspace(1.25, 1.9, 9)
"""Grid for the search of a next step: lateral positions [m], heights of its riser [rises], distances to its tread [runs]."""


def map_of(
    frame: RgbdFrame,
    blocks: PlanarBlocks,
    flight: Sequence[NosingObservation],
    axes: Axes,
    shape: StairShape,
    sides: tuple[Side | None, Side | None],
    swept_half_m: float,
) -> StairMap:
    """Return the map of the stair in the chair frame.

    Args:
        sides: Left and right side of the flight in the camera's view.
        swept_half_m: Half width of the volume swept by the chair.
    """
    R_BC, p_BC = frame.camera.R_BC, np.array(frame.camera.mount_m)
    points = [nosing.point for nosing in flight]
    way = viewing_direction(R_BC)
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
    left_side, right_side = sides if way > 0.0 else sides[::-1]
    seen = _visible_sides(flight, middle)
    left_seen, right_seen = seen if way > 0.0 else seen[::-1]
    return StairMap(
        t_s=frame.t_s,
        direction=shape.direction,
        nosings_B=tuple(map(tuple, nosings[np.argsort(way * nosings[:, 0])].tolist())),
        rise_m=shape.rise_m,
        run_m=shape.run_m,
        slope_rad=shape.slope_rad,
        ends=ends,
        left_wall_m=left,
        right_wall_m=right,
        obstacle_m=_obstacle(standing, free, axes, R_BC, p_BC, swept_half_m),
        left_edge_m=None if left_side is None else abs(left_side.aside_m - middle),
        right_edge_m=None if right_side is None else abs(right_side.aside_m - middle),
        left_side=None if left_side is None else left_side.kind,
        right_side=None if right_side is None else right_side.kind,
        left_seen_m=left_seen,
        right_seen_m=right_seen,
    )


def _visible_sides(flight: Sequence[NosingObservation], middle: float) -> tuple[float, float]:
    """Return the lateral distances from the chair's middle to which two nosings are visible, left and right in the camera's view.

    One nosing alone can continue on another surface of its height.
    """
    lefts = sorted(middle - nosing.sides_m[0] for nosing in flight)
    rights = sorted(nosing.sides_m[1] - middle for nosing in flight)
    return lefts[max(len(lefts) - 2, 0)], rights[max(len(rights) - 2, 0)]


def _crossing(point: Vector3, R_BC: Rotation, p_BC: Vector3, edge: Vector3) -> Vector3:
    """Return the intersection of an edge with the chair's middle plane, in B [m]."""
    p_B, e_B = R_BC @ point + p_BC, R_BC @ edge
    return np.asarray(p_B - p_B[1] / e_B[1] * e_B)


def _side_walls(blocks: PlanarBlocks, axes: Axes, middle: float) -> tuple[float | None, float | None]:
    """Return the distances of the nearest walls along the flight, left and right of the chair's middle in the camera's view."""
    along = np.abs(blocks.unit @ axes.right) > np.cos(SIDE_WALL)
    places = blocks.centres[along] @ axes.right - middle
    return _group_nearest(-places), _group_nearest(places)


def first_crowd(places: Float[np.ndarray, " k"], within: float, least: int) -> list[float]:
    """Return the nearest cluster of at least ``least`` places, in order, and its start; an empty list without one."""
    places = np.sort(places)
    together = np.searchsorted(places, places + within) - np.arange(places.size)
    first = np.flatnonzero(together >= least)
    return places[first[0] : first[0] + together[first[0]]].tolist() if first.size else []


def _group_nearest(places: Float[np.ndarray, " k"]) -> float | None:
    group = first_crowd(places[places > 0.1], BIN_M, WALL_BLOCKS)
    return median(group) if group else None


def _standing(
    frame: RgbdFrame, points: Sequence[Vector3], axes: Axes, shape: StairShape, *, ends: bool
) -> Float[np.ndarray, "k 3"]:
    """Return points in C above the flight, from the camera to beyond the visible part of the flight.

    An object on the nearest steps hides their nosings, so for an ascending flight the tread below the first visible nosing is
    extended towards the camera. A descending flight starts at the nosing plane, because the chair's support is higher.
    """
    camera = frame.camera
    normal = shape.normal(axes)
    ahead = [float(point @ axes.ahead) for point in points]
    first = min(ahead) - shape.run_m
    return point_kernels.points_above(
        frame.depth_m,
        max(1, round(STRIDE_AT_240 * camera.height_px / 240)),
        camera.pinhole,
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
    """Return the lateral positions, to the right, of objects extending along the flight: rails and walls."""
    if not len(standing):
        return np.empty(0)
    ahead, aside = np.round(standing @ np.stack([axes.ahead / RAIL_BIN_M, axes.right / BIN_M], axis=1)).astype(np.int64).T
    # A rail can extend over two bins.
    cells = np.unique(np.concatenate([aside, aside + 1]) * CELLS + np.tile(ahead, 2))
    places, counts = np.unique(np.floor_divide(cells, CELLS), return_counts=True)
    return np.asarray((places[counts >= RAIL_M / RAIL_BIN_M] - 0.5) * BIN_M)


def _obstacle(
    standing: Float[np.ndarray, "k 3"],
    free_m: tuple[float | None, float | None],
    axes: Axes,
    R_BC: Rotation,
    p_BC: Vector3,
    swept_half_m: float,
) -> float | None:
    """Return the distance to the nearest obstacle between the chair's sides [m], excluding walls, rails and objects behind.

    Args:
        free_m: Distance to rails and walls on the left and right, in the camera's view.
    """
    left_m, right_m = free_m
    aside = standing @ axes.right + float((R_BC.T @ p_BC) @ axes.right)
    within = np.ones(len(standing), dtype=bool)
    if left_m is not None:
        within &= aside > RAIL_THICK_M - left_m
    if right_m is not None:
        within &= aside < right_m - RAIL_THICK_M
    x, y, _ = (standing[within] @ R_BC.T + p_BC).T
    far = viewing_direction(R_BC) * x
    return next(iter(first_crowd(far[(np.abs(y) < swept_half_m) & (far > 0.0)], BIN_M, LEAST_POINTS)), None)


def _nearest(wall: float | None, rails: Float[np.ndarray, " j"]) -> float | None:
    """Return the nearer of a wall's plane and of rails at more than a bin from it."""
    rail = float(rails.min()) if rails.size else None
    if wall is None or rail is None:
        return rail if wall is None else wall
    return rail if rail < wall - 1.2 * BIN_M else wall


def _ends(frame: RgbdFrame, points: Sequence[Vector3], axes: Axes, shape: StairShape) -> bool:
    """Return whether the absence of a further step after the last nosing is visible.

    Depth is compared with the expected depth of the next step: a larger depth in place of a riser, or a horizontal surface beyond
    the end of a tread, shows a landing or a floor.
    """
    last = max(points, key=lambda point: float(point @ axes.ahead))
    ahead, up = float(last @ axes.ahead), float(last @ axes.up)
    middle = median(float(point @ axes.right) for point in points)
    if shape.direction == "up":
        # Slightly below the next edge: the thickness of a board without riser.
        places, heights = np.array([ahead + shape.run_m]), up + RISER_SHARES * shape.rise_m
    else:
        places, heights = ahead + shape.run_m * TREAD_SHARES, np.array([up - shape.rise_m])
    camera = frame.camera
    seen, expected = point_kernels.depths_at(
        frame.depth_m,
        places,
        middle + ASIDES_M,
        heights,
        np.stack([axes.ahead, axes.right, axes.up]),
        camera.pinhole,
    )
    if seen.size < END_POINTS:
        return False
    gone = seen > expected + END_MARGIN_M if shape.direction == "up" else np.abs(seen - expected) < 0.25 * shape.rise_m
    return bool(gone.mean() > END_SHARE)
