"""Ground ahead from one depth frame: how far it was seen, where it ends, and what stands on it.

``RgbdFrame, gravity, swept width -> GroundProfile``. Each image column is followed from near to far over the ground. An end needs
evidence: rays that would have met the ground there go on below it. Where depth is missing, or something stands in front, ground was
not seen, and does not end either.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy.polynomial import Polynomial

from treadline.core.angles import DEG
from treadline.core.arrays import cross
from treadline.core.camera_images import PinholeCamera, RgbdFrame
from treadline.core.rotations import Vector3
from treadline.core.signals import FreeGround
from treadline.core.step_sizes import SINGLE_RISE_M
from treadline.perception import _ground_kernels as kernels
from treadline.perception._gravity_direction import GRAVITY_SIGMA
from treadline.perception._step_parts import viewing_direction

SWEPT_HALF_M = 0.40
"""Half width swept by the shipped wheelchair [m], for frames without a chair."""
SWEPT_HEIGHT_M = 1.5
"""Height of a seated person above the ground or the nosing plane [m]."""
CLEAR_M = 0.10
"""Height above ground below which an object may be noise, and length of a cluster of its points [m]."""
FAR_M, RANGE_M = 3.0, 2.0
"""Largest distance from mid-track of what is searched, and up to which ground counts as seen [m]: depth beyond 3 m is too noisy,
and the guard uses 1.9 m."""
FLAT_RAD = 7.0 * DEG
"""Largest slope of ground [rad]: ramps of 1:12 have 4.8°; mount and gravity may be off by 2°."""
DROP_M = SINGLE_RISE_M[0]
"""Least height of a drop, and height range of one level [m]: belts with a flat run of 0.95 m that tip over it about their middle
pitch by 5°, as on a ramp."""
BRIDGE_M = 0.24
"""Longest gap in the ground [m], a quarter of the flat run: the belts bear before and behind it."""
CELL_M, STRIPS = 0.05, 8
"""Length of a cell of ground [m], and number of strips over the swept width, each as wide as a belt."""
COLUMNS, COLUMNS_PX = 160, 3
"""Number of image columns that are followed, and least number in a strip that show its end, half of those at 2 m."""
HALF_WINDOW = 4.5 / 640.0
"""Half of the matching window of a depth sensor, in image widths: surfaces grow or shrink by it at an edge. A Kinect 1 has 9 px of
640."""
LEVEL, LEVEL_SIZE_M = math.cos(20.0 * DEG), (0.55, 1.0)
"""Cosine of the largest angle between a level patch's normal and up, as noise tilts it at 2 m by 10°; least length and width of a
level [m]: a tread is level too, and at most 0.52 m long, a suitcase's lid is narrower."""
SIDE_COLUMNS = 8
"""Least number of columns of a side of the ground, which is at least ``SWEPT_HALF_M`` long: 4 and 16 find the same sides
(docs/evidence/building-stairs.md)."""
POINTS = 40
"""Least number of patches of a level, and of points of an obstacle, of an image of 240 rows: a cube of ``CLEAR_M`` at 3 m."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GroundProfile:
    """Ground ahead in one frame."""

    free: FreeGround
    obstacle_m: float | None
    """Distance from mid-track to the nearest object on the ground within the swept width, or along the belts if smaller [m]; None
    without one."""


def ground_ahead(frame: RgbdFrame, gravity_C: Vector3, swept_half_m: float = SWEPT_HALF_M) -> GroundProfile:
    """Return the ground ahead in one frame.

    The ground of a level chair begins below the camera, in the plane of the belts: a chair whose front hangs over an edge keeps the
    level of its landing. On a flight the ground is the highest level in view for a front camera, as is the landing, and the lowest
    one for a rear camera, as is the floor.

    Args:
        gravity_C: Unit vector pointing down, in the camera frame.
        swept_half_m: Half width of the volume swept by the chair.
    """
    camera, up, R_BC = frame.camera, -gravity_C, frame.camera.R_BC
    way = viewing_direction(R_BC)
    ahead = way * R_BC[0] - float(way * R_BC[0] @ up) * up
    ahead /= max(float(np.linalg.norm(ahead)), 1e-9)
    axes = np.stack([ahead, cross(up, ahead), up])
    origin = axes @ R_BC.T @ np.array(camera.mount_m)
    lean_rad, start_m = math.atan2(float(R_BC[2] @ ahead), float(R_BC[2] @ up)), max(float(origin[0]), 0.0)
    is_level = abs(lean_rad) < FLAT_RAD
    level_m = 0.0 if is_level else _level_m(frame, axes, origin, swept_half_m, is_highest=way > 0.0)
    ground = FreeGround(t_s=frame.t_s, view="front" if way > 0.0 else "rear", blind_m=RANGE_M, seen_m=RANGE_M)
    if level_m is None:
        return GroundProfile(free=ground, obstacle_m=None)
    origin[2] -= level_m
    start = (start_m, -math.tan(lean_rad) * start_m) if is_level else (math.inf, 0.0)
    # Steps down to the floor are above the floor, but not above the belts; the top of an object leans towards the chair.
    belts = np.array([[*-R_BC[0], -camera.mount_m[0]], [*R_BC[2], camera.mount_m[2]]])[: 2 if way < 0.0 else 0]
    cells = math.ceil(FAR_M / CELL_M)
    seen, standing = np.zeros((cells, STRIPS), np.int64), np.column_stack([np.zeros(cells), np.full(cells, math.inf)])
    ends = kernels.scan(
        frame.depth_m,
        max(1, round(camera.width_px / COLUMNS)),
        camera.pinhole,
        (axes, origin, belts),
        start,
        swept_half_m,
        (CLEAR_M, SWEPT_HEIGHT_M),
        (math.tan(FLAT_RAD), DROP_M, BRIDGE_M, CELL_M),
        seen,
        standing,
    )
    blind_m = min(blind_distance_m(camera, axes, origin, swept_half_m), RANGE_M)
    sides = tuple((way * x, way * y, 0.0) for x, y in _sides(ends).tolist()) if is_level else ()
    free = replace(ground, blind_m=blind_m, seen_m=_reached(seen, blind_m), sides_B=sides)
    free = _ended(free, ends[ends[:, 1] >= 0.0], camera, origin, swept_half_m)
    return GroundProfile(free=free, obstacle_m=_obstacle_m(standing, camera.height_px))


def blind_distance_m(camera: PinholeCamera, axes: Float[np.ndarray, "3 3"], origin: Vector3, half_m: float) -> float:
    """Return the distance from which on a plane is in the image, over a width [m]; infinite if it never is.

    Args:
        axes: Rows: along the plane ahead, to the left and its normal, in C.
        origin: Coordinates of the camera along these, from the point from which distances count.
    """
    far_m = np.linspace(0.0, FAR_M, 301)
    points = np.array([np.column_stack([far_m, np.full(301, aside), np.zeros(301)]) for aside in (-half_m, half_m)]) - origin
    columns, _ = camera.point_to_pixel(points @ axes)
    seen = np.flatnonzero(np.isfinite(columns).all(axis=0))
    return float(far_m[seen[0]]) if seen.size else math.inf


def _level_m(frame: RgbdFrame, axes: Float[np.ndarray, "3 3"], origin: Vector3, half_m: float, *, is_highest: bool) -> float | None:
    """Return the height of the highest or lowest level that is large enough to drive on [m]; None without one.

    Its length counts over the swept width alone: a string or a rail next to the flight passes through all heights.
    """
    step = max(1, round(frame.camera.height_px / 60))
    pixels = step * np.indices(frame.depth_m[::step, ::step].shape)
    depth_m = np.where(frame.depth_m > 0.0, frame.depth_m, np.nan)[::step, ::step]
    points = frame.camera.pixel_to_point(pixels[1], pixels[0], depth_m) @ axes.T
    below, aside = points[1:, :-1] - points[:-1, :-1], points[:-1, 1:] - points[:-1, :-1]
    with np.errstate(invalid="ignore"):
        normals = np.cross(below, aside)
        is_level = (np.abs(normals[..., 2]) > LEVEL * np.linalg.norm(normals, axis=-1)) & (points[:-1, :-1, 0] < FAR_M - origin[0])
    patches = points[:-1, :-1][is_level] + origin
    bins = np.floor(patches[:, 2] / DROP_M)
    for place in sorted(set(bins.tolist()), reverse=is_highest):
        here = (bins == place) | (bins == place + (-1.0 if is_highest else 1.0))
        swept, width_m = patches[here & (np.abs(patches[:, 1]) < half_m), 0], np.ptp(patches[here, 1])
        if here.sum() >= POINTS and width_m > LEVEL_SIZE_M[1] and swept.size and np.ptp(swept) > LEVEL_SIZE_M[0]:
            return float(np.median(patches[here, 2]))
    return None


def _reached(seen: Int[np.ndarray, "n k"], blind_m: float) -> float:
    """Return the distance up to which each strip has ground without a gap [m]."""
    reached_m = np.full(STRIPS, blind_m)
    for row in range(int(blind_m / CELL_M), len(seen)):
        middle_m = (row + 0.5) * CELL_M
        reached_m[(seen[row] > 0) & (reached_m < middle_m) & (middle_m - reached_m < BRIDGE_M)] = middle_m
    return float(reached_m.min())


def _sides(ends: Float[np.ndarray, "n 6"]) -> Float[np.ndarray, "k 2"]:
    """Return the ends of the straight sides of the ground, edges and walls, two rows a side: distance ahead and to the left [m].

    The columns in their order are the outline of the ground. It is split where it leaps, and where it is furthest from its chord.
    """
    drops = ends[:, 2] >= 0.0
    outline = np.where(drops[:, None], ends[:, [2, 0]], ends[:, 4:])
    outline = outline[np.isfinite(outline).all(axis=1) & (np.hypot(*outline.T) < RANGE_M)]
    found, parts = [], np.split(outline, 1 + np.flatnonzero(np.hypot(*np.diff(outline, axis=0).T) > BRIDGE_M))
    while parts:
        part = parts.pop()
        if len(part) < SIDE_COLUMNS or math.dist(part[0], part[-1]) < SWEPT_HALF_M:
            continue
        along = (part[-1] - part[0]) / math.dist(part[0], part[-1])
        off_m = np.abs((part - part[0]) @ (-along[1], along[0]))
        furthest = int(np.argmax(off_m))
        if off_m[furthest] > CELL_M:
            parts += [part[:furthest], part[furthest:]]
            continue
        middle = part.mean(axis=0)
        normal = np.linalg.svd(part - middle, full_matrices=False)[2][1]
        found += [end - ((end - middle) @ normal) * normal for end in (part[0], part[-1])]
    return np.array(found).reshape(-1, 2)


def _ended(ground: FreeGround, ends: Float[np.ndarray, "n 6"], camera: PinholeCamera, origin: Vector3, half_m: float) -> FreeGround:
    """Return the ground, up to the range or its end.

    Strips in which most columns show an end give the line of the edge. Strips whose ground ends on this line belong to the edge as
    well: rays over a flight steeper than themselves meet nothing. Without a line, strips of the swept width count by themselves.
    """
    in_range = replace(ground, seen_m=min(ground.seen_m, RANGE_M))
    strips = np.floor((ends[:, 0] + 3.0 * half_m) / (2.0 * half_m) * STRIPS)
    ends, strips = ends[(strips >= 0.0) & (strips < 3 * STRIPS)], strips[(strips >= 0.0) & (strips < 3 * STRIPS)].astype(np.int64)
    places_m, shows = ends[:, 1], ends[:, 2] >= 0.0
    shown_m, shown = _medians(strips[shows], places_m[shows])
    reach = np.bincount(strips[places_m > shown_m[strips] - BRIDGE_M], minlength=3 * STRIPS)
    evident = (shown >= COLUMNS_PX) & (shown > 0.5 * reach)
    inside = np.arange(3 * STRIPS) // STRIPS == 1
    if not evident.any() or origin[2] <= 0.0:
        return in_range
    middles_m = ((np.arange(3 * STRIPS) + 0.5) / STRIPS * 2.0 - 3.0) * half_m
    line = _line(middles_m, shown_m, evident) or _line(middles_m, shown_m, evident & inside)
    if line is not None:
        all_m, count = _medians(strips, places_m)
        for _ in range(3):  # along the edge, as the line becomes better
            edge = (np.abs(all_m - line(middles_m)) < CELL_M) & (count >= COLUMNS_PX)
            line = _line(middles_m, all_m, edge) or line
        sides_m = np.concatenate([middles_m[edge & inside] - half_m / STRIPS, middles_m[edge & inside] + half_m / STRIPS])
        end_m = float(line(sides_m).min(initial=math.inf))
    else:
        here = [places_m[shows & (strips == strip)] for strip in np.flatnonzero(evident & inside)]
        end_m = min((float(np.quantile(of_strip, 0.1)) for of_strip in here), default=math.inf)
    if not ground.blind_m < end_m < in_range.seen_m + 2.0 * CELL_M:
        return in_range
    row_m = ((end_m - origin[0]) ** 2 + origin[2] ** 2) / (origin[2] * camera.fy_px)
    sigma_m = math.hypot(HALF_WINDOW * camera.width_px * row_m / math.sqrt(12.0), GRAVITY_SIGMA * float(origin[2]))
    turn_sigma_rad = math.hypot(math.sqrt(2.0) * sigma_m / (2.0 * half_m), GRAVITY_SIGMA * end_m / float(origin[2]))
    depths_m = ends[shows & (np.abs(places_m - shown_m[strips]) < BRIDGE_M) & np.isfinite(ends[:, 3]), 3]
    drop_m = float(np.median(depths_m)) if depths_m.size else None
    ended = replace(ground, seen_m=end_m, end_m=end_m, end_sigma_m=sigma_m, drop_m=drop_m)
    if line is None or not np.all(edge[inside]):
        return ended
    return replace(ended, direction_rad=-math.atan(line.coef[1]), direction_sigma_rad=turn_sigma_rad)


def _medians(
    strips: Int[np.ndarray, " n"], places_m: Float[np.ndarray, " n"]
) -> tuple[Float[np.ndarray, " k"], Int[np.ndarray, " k"]]:
    """Return the median place of each strip, infinite without any, and the number of its columns."""
    order = np.lexsort((places_m, strips))
    count = np.bincount(strips, minlength=3 * STRIPS)
    middle = np.minimum(np.cumsum(count) - (count + 1) // 2, max(len(order) - 1, 0))
    return np.where(count > 0, places_m[order][middle] if len(order) else math.inf, math.inf), count


def _line(x: Float[np.ndarray, " n"], y: Float[np.ndarray, " n"], chosen: Bool[np.ndarray, " n"]) -> Polynomial | None:
    """Return the line with the median of the slopes between two of the chosen points (Theil and Sen); None unless all lie on it."""
    x, y = x[chosen], y[chosen]
    if len(x) < 2:
        return None
    i, j = np.triu_indices(len(x), 1)
    slope = float(np.median((y[j] - y[i]) / (x[j] - x[i])))
    line = Polynomial([float(np.median(y - slope * x)), slope])
    return line if np.all(np.abs(y - line(x)) < CELL_M) else None


def _obstacle_m(standing: Float[np.ndarray, "n 2"], rows: int) -> float | None:
    """Return the distance to the nearest cluster of points [m]; None without one."""
    count = standing[:, 0] + np.append(standing[1:, 0], 0.0)
    first = np.flatnonzero((standing[:, 0] > 0.0) & (count >= POINTS * rows / 240))
    return float(standing[first[0], 1]) if first.size else None
