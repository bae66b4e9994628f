"""Map of the stair in the camera's viewing direction: nosings, end of the flight, walls, rails and obstacles.

For a rear camera the viewing direction, and the direction of travel, is backwards.
"""

import math
from collections.abc import Sequence
from statistics import median

import numpy as np
from jaxtyping import Float

from treadline.core.camera_images import RgbdFrame
from treadline.core.rotations import Rotation, Vector3
from treadline.core.signals import StairMap
from treadline.perception._form import Side
from treadline.perception._lattice import LEAST_BLOCKS, RISER_SPREAD
from treadline.perception._plane_segmentation import PlanarBlocks
from treadline.perception._stair_shape import StairShape
from treadline.perception._step_parts import Axes, NosingObservation, viewing_direction
from treadline.perception.free_ground import CELL_M, POINTS, SWEPT_HEIGHT_M

CLEAR_M = 0.06
"""Height above the nosing plane below which points are ignored [m]: lower objects pass under the belts or are irregularities of the
stair."""
BLUR_RAD = 0.035
"""Angle above an edge over which its depth can be smeared [rad]: ten pixels of 320, more than the matching window of a Kinect."""
LEAST_POINTS = 12
"""Least number of neighbouring points of an obstacle, in the quarter-resolution image."""
RAIL_M = 0.5
"""Least length of a rail or wall [m]: longer objects at one lateral position are rails or walls, not objects on a step."""
RAIL_ASIDE_M = 0.25
"""Lateral distance from the chair's middle within which any object is an obstacle, however long [m]."""
END_SHARE = 0.7
"""Least fraction of the places of a next step that shows its absence."""


def map_of(
    frame: RgbdFrame,
    blocks: PlanarBlocks,
    flight: Sequence[NosingObservation],
    axes: Axes,
    shape: StairShape,
    sides: tuple[Side | None, Side | None],
    swept_half_m: float,
    *,
    is_single: bool = False,
) -> StairMap:
    """Return the map of the stair in the chair frame.

    Args:
        sides: Left and right side of the flight in the camera's view.
        swept_half_m: Half width of the volume swept by the chair.
        is_single: Whether this is a single step, behind which no other was found.
    """
    R_BC, p_BC = frame.camera.R_BC, np.array(frame.camera.mount_m)
    points = [nosing.point for nosing in flight]
    way = viewing_direction(R_BC)
    nosings = np.array([_crossing(point, R_BC, p_BC, axes.right) for point in points])
    middle = float(-(R_BC.T @ p_BC) @ axes.right)
    ends = is_single or _ends(frame, points, axes, shape)
    standing = standing_points(frame, points, axes, shape, ends=ends)
    free = _free_sides(blocks, standing, axes, middle)
    turn = int(way)
    (left, right), (left_side, right_side), (left_seen, right_seen) = (
        free[::turn],
        sides[::turn],
        _visible_sides(flight, middle)[::turn],
    )
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


def _free_sides(
    blocks: PlanarBlocks, standing: Float[np.ndarray, "k 3"], axes: Axes, middle: float
) -> tuple[float | None, float | None]:
    """Return the distances of the nearest walls and rails, left and right of the chair's middle in the camera's view."""
    along = np.abs(blocks.unit @ axes.right) > np.cos(RISER_SPREAD)
    walls, rails = blocks.centres[along] @ axes.right - middle, _along_the_flight(standing, axes) - middle
    return _nearest(-walls, -rails), _nearest(walls, rails)


def _nearest(walls: Float[np.ndarray, " k"], rails: Float[np.ndarray, " j"]) -> float | None:
    """Return the nearer of a wall's plane and of rails at more than a cell from it."""
    group = first_crowd(walls[walls > 0.1], CELL_M, 2 * LEAST_BLOCKS)
    wall, rail = median(group) if group else math.inf, float(rails[rails > RAIL_ASIDE_M].min(initial=math.inf))
    nearest = rail if rail < wall - 1.2 * CELL_M else wall
    return nearest if math.isfinite(nearest) else None


def first_crowd(places: Float[np.ndarray, " k"], within: float, least: int) -> list[float]:
    """Return the nearest cluster of at least ``least`` places, in order, and its start; an empty list without one."""
    places = np.sort(places)
    together = np.searchsorted(places, places + within) - np.arange(places.size)
    first = np.flatnonzero(together >= least)
    return places[first[0] : first[0] + together[first[0]]].tolist() if first.size else []


def standing_points(
    frame: RgbdFrame, points: Sequence[Vector3], axes: Axes, shape: StairShape, *, ends: bool
) -> Float[np.ndarray, "k 3"]:
    """Return points in C above the flight, from the camera to beyond the visible part of the flight.

    An object on the nearest steps hides their nosings, so for an ascending flight the tread below the first visible nosing is
    extended towards the camera. A descending flight starts at the nosing plane, because the chair's support is higher.
    """
    normal, ahead = shape.normal(axes), [float(point @ axes.ahead) for point in points]
    first, end = min(ahead) - shape.run_m, max(ahead) + (0.5 if ends else 2.0) * shape.run_m
    foot = float(min(points, key=lambda point: float(point @ axes.ahead)) @ axes.up) - shape.rise_m
    camera, step = frame.camera, max(1, round(frame.camera.height_px / 120))
    depth_m = frame.depth_m[::step, ::step]
    y, x = (
        (step * np.arange(depth_m.shape[0]) - camera.cy_px) / camera.fy_px,
        (step * np.arange(depth_m.shape[1]) - camera.cx_px) / camera.fx_px,
    )
    far, over_plane, over_foot = (depth_m * (a * x + (b * y + c)[:, None]) for a, b, c in (axes.ahead, normal, axes.up))
    above = np.where(far < first, over_foot - foot, over_plane - median(float(point @ normal) for point in points))
    begin = 0.0 if shape.direction == "up" else first
    found = (far > begin) & (far < end) & (above > np.maximum(CLEAR_M, BLUR_RAD * depth_m)) & (above < SWEPT_HEIGHT_M)
    v, u = np.nonzero(found & (depth_m > 0.0))
    return camera.pixel_to_point(u * step, v * step, depth_m[v, u])


def _along_the_flight(standing: Float[np.ndarray, "k 3"], axes: Axes) -> Float[np.ndarray, " j"]:
    """Return the lateral positions, to the right, of objects extending along the flight: rails and walls."""
    if not len(standing):
        return np.empty(0)
    # Cells are twice as long as wide; a rail can extend over two.
    ahead, aside = np.round(standing @ np.stack([0.5 * axes.ahead, axes.right], axis=1) / CELL_M).T
    cells = np.unique(np.concatenate([aside, aside + 1.0]) + 1j * np.tile(ahead, 2))
    places, counts = np.unique(cells.real, return_counts=True)
    return np.asarray((places[counts >= RAIL_M / (2.0 * CELL_M)] - 0.5) * CELL_M)


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
    left_m, right_m = (math.inf if side_m is None else side_m - 1.5 * CELL_M for side_m in free_m)
    aside = standing @ axes.right + float((R_BC.T @ p_BC) @ axes.right)
    x, y, _ = (standing[(aside > -left_m) & (aside < right_m)] @ R_BC.T + p_BC).T
    far = viewing_direction(R_BC) * x
    return next(iter(first_crowd(far[(np.abs(y) < swept_half_m) & (far > 0.0)], CELL_M, LEAST_POINTS)), None)


def _ends(frame: RgbdFrame, points: Sequence[Vector3], axes: Axes, shape: StairShape) -> bool:
    """Return whether the absence of a further step after the last nosing is visible.

    Depth is compared with that of the next step on a grid: a larger depth in place of the upper fifth of its riser, which may be a
    board, or a surface behind the end of its tread that is nearer to the height of a floor than to that of a second tread, shows a
    landing or a floor. First risers differ by up to half of a rise.
    """
    last = max(points, key=lambda point: float(point @ axes.ahead))
    ahead, up = float(last @ axes.ahead), float(last @ axes.up)
    middle = median(float(point @ axes.right) for point in points)
    if shape.direction == "up":
        aheads, heights = np.array([ahead + shape.run_m]), up + shape.rise_m * np.linspace(0.82, 0.97, 7)
    else:
        aheads, heights = ahead + shape.run_m * np.linspace(1.25, 1.9, 9), np.array([up - shape.rise_m])
    grid = np.stack(np.meshgrid(aheads, middle + np.linspace(-RAIL_ASIDE_M, RAIL_ASIDE_M, 15), heights), axis=-1).reshape(-1, 3)
    expected = grid @ np.stack([axes.ahead, axes.right, axes.up])
    u, v = frame.camera.point_to_pixel(expected)
    inside = np.isfinite(u)
    seen_m = frame.depth_m[np.rint(v[inside]).astype(np.int64), np.rint(u[inside]).astype(np.int64)]
    expected, seen_m = expected[inside][seen_m > 0.0], seen_m[seen_m > 0.0]
    if seen_m.size < POINTS:
        return False
    beyond_m = seen_m - expected[:, 2]
    if shape.direction == "up":  # less than half of a run behind the riser
        gone = beyond_m > 0.4 * shape.run_m
    else:  # nearer to the floor, whose riser may differ, than to the next tread
        gone = np.abs(beyond_m / expected[:, 2] * (expected @ axes.up)) < 0.5 * shape.rise_m
    return bool(gone.mean() > END_SHARE)
