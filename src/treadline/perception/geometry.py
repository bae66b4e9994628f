"""The stair's measures and the map of what lies ahead, from the nosings of one frame."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from treadline.angles import DEG
from treadline.perception import kernels
from treadline.perception.direction import gravity_variance
from treadline.perception.irregular import pooled
from treadline.perception.nosings import STEP_RISE_M, STEP_RUN_M, Axes, Direction, Nosing
from treadline.perception.planes import Blocks, Surface
from treadline.perception.sight import StairShape
from treadline.perception.vectors import cross
from treadline.signals import PinholeCamera, RgbdFrame, StairAxes, StairMap

SAME_LEVEL_M = 0.03
"""Heights closer than this are one level."""
SHAPE_SIGMA_M = 0.004
"""Of a nosing's place: noise of the sensor and the stair's own irregularity."""
SIDE_WALL = 15.0 * DEG
"""How far a side wall's normal may lie from the edges' direction."""
WALL_BLOCKS = 16
SWEPT_HALF_M, SWEPT_HEIGHT_M = 0.40, 1.5
"""Half the tracks' width with an inch to spare, and a seated person's height above the nosing plane."""
CLEAR_M = 0.06
"""Above the nosing plane: what is lower passes under the belts or is the stair's own irregularity."""
LEAST_POINTS = 12
"""Of the quarter-resolution image that stand together for something to be there."""
STRIDE_AT_240 = 2
BIN_M = 0.05
RAIL_BIN_M, RAIL_M = 0.1, 0.5
"""Along the flight: what stands over this length at one place across it is a rail or a wall, not a thing on a step."""
RAIL_ASIDE_M = 0.25
"""From the chair's middle: what lies closer is in the way, however long."""
CELLS = 10_000
"""More than there are bins along any flight, none of which starts behind the camera."""
END_MARGIN_M = 0.12
"""How far behind the next step's place the depth must lie for the step to be absent: less than half a run."""
END_POINTS, END_SHARE = 40, 0.7


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Levelled:
    """The stair's axes with what level is taken from."""

    axes: Axes
    down_sigma_rad: float


def axes_of(
    edge: Float[np.ndarray, " 3"], down: Float[np.ndarray, " 3"], down_sigma_rad: float, treads: Sequence[Surface]
) -> Levelled:
    """Return the axes of the stair: level as treads and gravity, weighed, have it.

    Args:
        edge: Unit vector along the edges, pointing right.
        down: Down as the IMU or, without one, the bundle of treads tells it.
        treads: Surfaces that are taken for level.
    """
    d = down - float(down @ edge) * edge
    d /= np.linalg.norm(d)
    ahead = cross(edge, d)
    tilts, variances = [0.0], [down_sigma_rad**2]
    for tread in treads:
        n = tread.unit if float(tread.unit @ d) > 0.0 else -tread.unit
        tilts.append(float(np.arctan2(n @ ahead, n @ d)))
        variances.append(float(ahead @ tread.covariance @ ahead) / float(tread.normal @ tread.normal))
    variances[0] = gravity_variance(np.array(tilts[1:]), down_sigma_rad)
    regular = np.zeros(len(tilts), dtype=bool)
    regular[0] = True
    tilt = pooled(np.array(tilts), np.array(variances), regular)
    d = np.cos(tilt.mean) * d + np.sin(tilt.mean) * ahead
    return Levelled(axes=Axes(ahead=cross(edge, d), up=-d, right=edge), down_sigma_rad=tilt.sigma)


def shape_of(flight: Sequence[Nosing], treads: Sequence[Surface], axes: Axes, direction: Direction) -> StairShape | None:
    """Return rise, run and slope, or None where no rise is seen."""
    places = _plain(flight) if len(_plain(flight)) >= 2 else flight
    ahead = np.array([float(nosing.point @ axes.ahead) for nosing in places])
    heights = [float(nosing.point @ axes.up) for nosing in flight if nosing.up_m is not None]
    heights += [float(tread.centre @ axes.up) for tread in treads]
    run = _spacing(ahead, STEP_RUN_M)
    rise = _spacing(_levels(heights), STEP_RISE_M)
    if run is None or rise is None:
        return None
    return StairShape(
        rise_m=rise,
        run_m=run,
        slope_rad=float(np.arctan2(rise, run)),
        distance_m=float(ahead.min()) - run * round((float(ahead.min()) - flight[0].ahead_m) / run),
        direction=direction,
    )


def _plain(flight: Sequence[Nosing]) -> list[Nosing]:
    """Return the nosings whose place is known: a corner's is off by how far its tread is followed around it."""
    return [nosing for nosing in flight if nosing.is_plain]


def levels_of(treads: Sequence[Surface], axes: Axes) -> int:
    """Return how many levels of treads are evenly apart."""
    row = _row(_levels([float(tread.centre @ axes.up) for tread in treads]), STEP_RISE_M)
    return 0 if row is None else len(row[0])


def _levels(heights: Sequence[float]) -> Float[np.ndarray, " k"]:
    """Return the means of heights that are one level."""
    values = np.sort(np.array(heights))
    cuts = np.flatnonzero(np.diff(values) > SAME_LEVEL_M) + 1
    return np.array([part.mean() for part in np.split(values, cuts)]) if values.size else values


def _spacing(places: Float[np.ndarray, " k"], limits: tuple[float, float]) -> float | None:
    """Return the distance of places that are equally far apart, some of them missing; None where no two are neighbours."""
    row = _row(places, limits)
    return None if row is None else float(np.polyfit(row[1], row[0], 1)[0])


def _row(
    places: Float[np.ndarray, " k"], limits: tuple[float, float]
) -> tuple[Float[np.ndarray, " j"], Float[np.ndarray, " j"]] | None:
    """Return the longest row of places that are equally far apart, and the number of each."""
    places = np.sort(places)
    gaps = np.diff(places)
    near = gaps[(gaps >= limits[0]) & (gaps <= limits[1])]
    if not near.size:
        return None
    first = float(np.median(near))
    # Whole numbers of steps between neighbours; a gap that is none ends the row.
    counts = np.round(gaps / first)
    fits = (counts >= 1) & (np.abs(gaps / np.maximum(counts, 1.0) - first) < 0.25 * first)
    cuts = np.flatnonzero(~fits) + 1
    row = max(np.split(np.arange(len(places)), cuts), key=len)
    if len(row) < 2:
        return np.array([0.0, first]), np.array([0.0, 1.0])
    return places[row], np.concatenate([[0.0], np.cumsum(counts[row[:-1]])])


def directions_of(t_s: float, flight: Sequence[Nosing], levelled: Levelled, shape: StairShape, edge_sigma_rad: float) -> StairAxes:
    """Return the stair's directions in C, for whoever wants to know how the camera is mounted."""
    axes = levelled.axes
    span = max(len(flight) - 1, 1) * float(np.hypot(shape.rise_m, shape.run_m))
    return StairAxes(
        t_s=t_s,
        edge_C=axes.right,
        down_C=-axes.up,
        normal_C=_normal(axes, shape),
        edge_sigma_rad=edge_sigma_rad,
        down_sigma_rad=levelled.down_sigma_rad,
        normal_sigma_rad=float(np.sqrt(2.0) * SHAPE_SIGMA_M / span),
    )


def map_of(frame: RgbdFrame, blocks: Blocks, flight: Sequence[Nosing], axes: Axes, shape: StairShape) -> StairMap:
    """Return what lies ahead, in the chair's frame."""
    R_BC, p_BC = frame.camera.R_BC, np.array(frame.camera.mount_m)
    points = _points(flight, axes, shape)
    nosings = np.array([_crossing(point, R_BC, p_BC, axes.right) for point in points])
    middle = float(-(R_BC.T @ p_BC) @ axes.right)
    standing = _standing(frame, points, axes, shape)
    rails = _along_the_flight(standing, axes)
    rails = rails[np.abs(rails - middle) > RAIL_ASIDE_M]
    left, right = _side_walls(blocks, axes, middle)
    aside = rails - middle
    return StairMap(
        t_s=frame.t_s,
        direction=shape.direction,
        nosings_B=nosings[np.argsort(nosings[:, 0])],
        rise_m=shape.rise_m,
        run_m=shape.run_m,
        slope_rad=shape.slope_rad,
        ends=_ends(frame, points, axes, shape),
        left_wall_m=_nearest(left, -aside[aside < 0.0]),
        right_wall_m=_nearest(right, aside[aside > 0.0]),
        obstacle_m=_obstacle(standing, rails, axes, R_BC, p_BC),
    )


def _normal(axes: Axes, shape: StairShape) -> Float[np.ndarray, " 3"]:
    """Return the unit normal of the nosing plane, away from the stair."""
    tilt = shape.slope_rad if shape.direction == "up" else -shape.slope_rad
    return np.asarray(np.cos(tilt) * axes.up - np.sin(tilt) * axes.ahead)


def _points(flight: Sequence[Nosing], axes: Axes, shape: StairShape) -> list[Float[np.ndarray, " 3"]]:
    """Return a point on each nosing; heights that are not seen, and places of corners, follow from those that are known."""
    sign = 1.0 if shape.direction == "up" else -1.0
    high = [nosing for nosing in flight if nosing.up_m is not None]
    plain = _plain(flight)
    points = []
    for nosing in flight:
        point = nosing.point
        if nosing.up_m is None and high:
            nearest, steps = _neighbour(nosing, high, shape.run_m)
            up_m = float(nearest.point @ axes.up) + sign * steps * shape.rise_m
            point = point + (up_m - float(point @ axes.up)) * axes.up
        if not nosing.is_plain and plain:
            nearest, steps = _neighbour(nosing, plain, shape.run_m)
            ahead_m = float(nearest.point @ axes.ahead) + steps * shape.run_m
            point = point + (ahead_m - float(point @ axes.ahead)) * axes.ahead
        points.append(point)
    return points


def _neighbour(nosing: Nosing, others: Sequence[Nosing], run_m: float) -> tuple[Nosing, int]:
    """Return the nearest of some nosings and how many steps ahead of it a nosing is."""
    nearest = min(others, key=lambda other: abs(other.ahead_m - nosing.ahead_m))
    return nearest, round((nosing.ahead_m - nearest.ahead_m) / run_m)


def _crossing(
    point: Float[np.ndarray, " 3"], R_BC: Float[np.ndarray, "3 3"], p_BC: Float[np.ndarray, " 3"], edge: Float[np.ndarray, " 3"]
) -> Float[np.ndarray, " 3"]:
    """Return where an edge meets the chair's middle plane, in B."""
    p_B, e_B = R_BC @ point + p_BC, R_BC @ edge
    return np.asarray(p_B - p_B[1] / e_B[1] * e_B)


def _side_walls(blocks: Blocks, axes: Axes, middle: float) -> tuple[float | None, float | None]:
    """Return the distances of the nearest walls along the flight, left and right of the chair's middle."""
    along = np.abs(blocks.unit @ axes.right) > np.cos(SIDE_WALL)
    places = blocks.centres[along] @ axes.right - middle
    return _group_nearest(-places), _group_nearest(places)


def _group_nearest(places: Float[np.ndarray, " k"]) -> float | None:
    near = np.sort(places[places > 0.1])
    if near.size < WALL_BLOCKS:
        return None
    together = np.searchsorted(near, near + BIN_M) - np.arange(near.size)
    first = np.flatnonzero(together >= WALL_BLOCKS)
    if not first.size:
        return None
    start = int(first[0])
    return float(np.median(near[start : start + int(together[start])]))


def _standing(
    frame: RgbdFrame, points: Sequence[Float[np.ndarray, " 3"]], axes: Axes, shape: StairShape
) -> Float[np.ndarray, "k 3"]:
    """Return points of C that stand above the nosing plane along the flight."""
    camera = frame.camera
    normal = _normal(axes, shape)
    ahead = [float(point @ axes.ahead) for point in points]
    return kernels.points_above(
        frame.depth_m,
        max(1, round(STRIDE_AT_240 * camera.height_px / 240)),
        camera.fx_px,
        camera.fy_px,
        camera.cx_px,
        camera.cy_px,
        np.stack([axes.ahead, normal]),
        float(np.median([point @ normal for point in points])),
        CLEAR_M,
        SWEPT_HEIGHT_M,
        min(ahead) - shape.run_m,
        max(ahead) + 0.5 * shape.run_m,
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
    rails: Float[np.ndarray, " j"],
    axes: Axes,
    R_BC: Float[np.ndarray, "3 3"],
    p_BC: Float[np.ndarray, " 3"],
) -> float | None:
    """Return how far ahead of the chair something stands between its sides, rails and walls left out."""
    aside = standing @ axes.right
    free = np.ones(len(standing), dtype=bool)
    for place in rails:
        free &= np.abs(aside - place) > 1.5 * BIN_M
    x, y, _ = (standing[free] @ R_BC.T + p_BC).T
    return _first_crowd(np.sort(x[(np.abs(y) < SWEPT_HALF_M) & (x > 0.0)]))


def _first_crowd(places: Float[np.ndarray, " k"]) -> float | None:
    """Return the smallest place with enough others close behind it."""
    together = np.searchsorted(places, places + BIN_M) - np.arange(places.size)
    first = np.flatnonzero(together >= LEAST_POINTS)
    return float(places[first[0]]) if first.size else None


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
    middle = float(np.median([point @ axes.right for point in points]))
    asides = middle + np.linspace(-0.25, 0.25, 15)
    if shape.direction == "up":
        # Close below the next edge: a board without a riser is no thicker.
        heights = up + np.linspace(0.82, 0.97, 7) * shape.rise_m
        places = [(ahead + shape.run_m, aside, height) for height in heights for aside in asides]
    else:
        behind = ahead + shape.run_m * np.linspace(1.25, 1.9, 9)
        places = [(place, aside, up - shape.rise_m) for place in behind for aside in asides]
    there = np.array(places) @ np.stack([axes.ahead, axes.right, axes.up])
    seen, expected = _depth_at(frame.depth_m, frame.camera, there)
    if seen.size < END_POINTS:
        return False
    gone = seen > expected + END_MARGIN_M if shape.direction == "up" else np.abs(seen - expected) < 0.25 * shape.rise_m
    return bool(gone.mean() > END_SHARE)


def _depth_at(
    depth_m: Float[np.ndarray, "h w"], camera: PinholeCamera, points: Float[np.ndarray, "k 3"]
) -> tuple[Float[np.ndarray, " j"], Float[np.ndarray, " j"]]:
    """Return the depth seen at points of C and the depth they would have, where both exist."""
    points = points[points[:, 2] > 0.1]
    u = np.round(camera.fx_px * points[:, 0] / points[:, 2] + camera.cx_px)
    v = np.round(camera.fy_px * points[:, 1] / points[:, 2] + camera.cy_px)
    inside = (u >= 0) & (u < camera.width_px) & (v >= 0) & (v < camera.height_px)
    seen = depth_m[v[inside].astype(int), u[inside].astype(int)].astype(float)
    known = np.isfinite(seen) & (seen > 0.0)
    return seen[known], points[inside][known, 2]
