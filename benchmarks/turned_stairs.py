"""Depth frames of turned and straight stairs, kerbs, drops and rooms, with ground truth for each step.

    view = draw_frame(seed, "quarter landing", before=3, sensor="stereo")
    view.frame, view.gravity_C      # inputs of a detector
    view.steps                      # ground truth, from the camera in plan axes of the levelled chair

Solids are upright prisms over convex outlines; rays are clipped by their half-spaces. Neither the project's staircases nor its
renderer or sensors are used, so that a detector is judged by steps and noise that it was not developed on. The same arguments give
the same bytes.
"""

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numba
import numpy as np
from jaxtyping import Float
from sensor_noise import FOCAL_PX, NOISES, ExactImage

from treadline.core.angles import DEG
from treadline.core.camera_images import PinholeCamera, RgbdFrame, black
from treadline.core.rotations import Rotation, Vector3, rotation_y, rotation_z
from treadline.scenario.chair import read_chair

Array = np.ndarray
Kind = Literal["step", "winder", "landing", "kerb", "drop"]
WALL_M, DEEP_M, FAR_M, STRAIGHT_M = 0.1, 0.3, 12.0, 1e6
"""Thickness of walls, depth of solids below the floor, range of all sensors, and radius of a straight flight [m]."""
JITTER_M = 0.002
"""Standard deviation of a rise [m]: ten rises then differ by 6 mm, within the ±5 mm of DIN 18065."""
GRAVITY_DEG = 0.3
"""Standard deviation of gravity about each horizontal axis [deg]."""
STAIRS = ("straight", "quarter landing", "3 winders", "4 winders", "5 winders", "half landing")
"""Stairs with a straight flight before the turn; others are ``winding <radius in metres>``, ``kerb``, ``drop`` and ``room``."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Prism:
    """Upright prism over a convex outline, whose corners follow each other anticlockwise."""

    outline: Float[np.ndarray, "n 2"]
    low_m: float
    high_m: float
    grade: tuple[float, float] = (0.0, 0.0)
    """Slope of the top along x and y."""

    @property
    def half_spaces(self) -> Float[np.ndarray, "k 4"]:
        """Unit normals, pointing out, and distances of the faces from the origin."""
        along = np.roll(self.outline, -1, axis=0) - self.outline
        out = np.column_stack([along[:, 1], -along[:, 0]]) / np.linalg.norm(along, axis=1, keepdims=True)
        sides = np.column_stack([out, np.zeros(len(out)), np.sum(out * self.outline, axis=1)])
        top = np.array([-self.grade[0], -self.grade[1], 1.0, self.high_m])
        return np.vstack([sides, top / np.linalg.norm(top[:3]), [0.0, 0.0, -1.0, -self.low_m]])

    @property
    def corners(self) -> Float[np.ndarray, "m 3"]:
        """Corners of the bottom and the top."""
        tops = self.high_m + self.outline @ np.array(self.grade)
        return np.vstack([np.column_stack([self.outline, z]) for z in (np.full(len(tops), self.low_m), tops)])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Front:
    """Front edge of a level, seen from the level before it, in W."""

    ends: Float[np.ndarray, "2 2"]
    """Left and right end in plan."""
    level_m: float
    """Height of the upper of both levels."""
    rise_m: float
    """Height of the level behind the edge over the one before it; negative for a drop."""
    kind: Kind
    outline: Float[np.ndarray, "n 2"]
    """Outline of the level behind the edge."""


@dataclass(slots=True, kw_only=True)
class Solids:
    """Solids, and the edges between their levels."""

    solids: list[Prism] = field(default_factory=list)
    fronts: list[Front] = field(default_factory=list)

    def mirrored(self) -> "Solids":
        """Return the mirror image, left and right exchanged."""
        flip = np.array([1.0, -1.0])
        solids = [replace(one, outline=(one.outline * flip)[::-1], grade=(one.grade[0], -one.grade[1])) for one in self.solids]
        fronts = [replace(one, ends=(one.ends * flip)[::-1], outline=(one.outline * flip)[::-1]) for one in self.fronts]
        return Solids(solids=solids, fronts=fronts)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrueStep:
    """Ground truth of a step, from the camera in plan axes of the levelled chair: right, and ahead along the chair's own x axis."""

    height_m: float
    """Height of the edge above the ground under the chair's mid-track."""
    rise_m: float
    """Height of the level behind the edge over the one before it; negative for a drop."""
    edge: Float[np.ndarray, "2 2"]
    """Left and right end: right of and ahead of the camera [m]."""
    direction_rad: float
    """Direction of the way across the edge, positive to the left; the heading of the chair to it is the negative."""
    depth_m: tuple[float, float, float]
    """Depth of the level behind the edge along ``direction_rad`` from its left end, its middle and its right end."""
    kind: Kind
    visible: float
    """Share of the edge that is in the image and not hidden."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StepFrame:
    """Frame with gravity as measured, and ground truth."""

    frame: RgbdFrame
    gravity_C: Vector3
    true_gravity_C: Vector3
    steps: tuple[TrueStep, ...]
    camera_at: tuple[float, float, float]
    """Place of the camera right of, ahead of and above mid-track: ``edge + camera_at[:2]`` is in the chair's axes."""

    def heading_to(self, step: TrueStep) -> float:
        """Return the heading of the chair to a step in the chair's own axes, which are inclined on a flight [rad]."""
        right, ahead = step.edge[1] - step.edge[0]
        edge_B = plan_axes(self.frame.camera, self.true_gravity_C).T @ [ahead, -right]
        return math.atan2(-edge_B[0], -edge_B[1])


def plan_axes(camera: PinholeCamera, gravity_C: Vector3) -> Float[np.ndarray, "2 3"]:
    """Return the horizontal unit vectors ahead and to the left of the chair in B."""
    up = -camera.R_BC @ gravity_C
    ahead = np.array([1.0, 0.0, 0.0]) - up[0] * up
    ahead /= np.linalg.norm(ahead)
    return np.array([ahead, np.cross(up, ahead)])


@numba.njit
def clip(normals: Array, gaps: Array, starts: Array, boxes: Array, rays: Array, depth: Array, face: Array) -> None:
    """Write the nearest depth and its face into images, from rays clipped by the half-spaces of each solid in its image box."""
    for solid in range(len(boxes)):
        first, last = starts[solid], starts[solid + 1]
        for v in range(boxes[solid, 1], boxes[solid, 3]):
            for u in range(boxes[solid, 0], boxes[solid, 2]):
                enter, leave, entered = 0.05, depth[v, u], -1
                for k in range(first, last):
                    gap = gaps[k]
                    rate = normals[k, 0] * rays[v, u, 0] + normals[k, 1] * rays[v, u, 1] + normals[k, 2] * rays[v, u, 2]
                    if rate < 0.0 and gap / rate > enter:
                        enter, entered = gap / rate, k
                    elif rate > 0.0:
                        leave = min(leave, gap / rate)
                    elif rate == 0.0 and gap < 0.0:
                        leave = 0.0
                    if enter >= leave:
                        break
                if entered >= 0 and enter < leave:
                    depth[v, u], face[v, u] = enter, entered


def render(
    solids: Sequence[Prism], camera: PinholeCamera, R_WC: Rotation, p_WC: Vector3
) -> tuple[Float[np.ndarray, "h w"], Float[np.ndarray, "h w 3"], Float[np.ndarray, "h w 3"]]:
    """Return depth (infinite without a hit), rays of unit depth and normals, both in W."""
    size = np.array([camera.width_px, camera.height_px])
    v, u = np.indices(size[::-1])
    rays = camera.pixel_to_point(u, v) @ R_WC.T
    spaces = [solid.half_spaces for solid in solids]
    boxes = np.empty((len(solids), 4), np.int64)
    (fx, fy, cx, cy), (width, height) = camera.pinhole, size
    sides = np.array([[fx, 0.0, cx + 1.0], [-fx, 0.0, width - cx], [0.0, fy, cy + 1.0], [0.0, -fy, height - cy], [0.0, 0.0, 1.0]])
    for box, solid in zip(boxes, solids, strict=True):
        points = (solid.corners - p_WC) @ R_WC
        near = points[:, 2].min() < 0.05
        pixels = np.array(camera.pinhole[:2]) * points[:, :2] / np.maximum(points[:, 2:], 0.05) + np.array(camera.pinhole[2:])
        if (points @ sides.T < 0.0).all(axis=0).any():
            box[:] = 0  # out of view
            continue
        box[:2] = 0 if near else np.clip(np.floor(pixels.min(axis=0)), 0, size)
        box[2:] = size if near else np.clip(np.ceil(pixels.max(axis=0)) + 1, 0, size)
    depth, face = np.full(rays.shape[:2], np.inf), np.zeros(rays.shape[:2], np.int64)
    starts = np.cumsum([0, *(len(part) for part in spaces)])
    normals, offsets = np.hsplit(np.vstack(spaces), [3])
    clip(np.ascontiguousarray(normals), offsets[:, 0] - normals @ p_WC, starts, boxes, rays, depth, face)
    return depth, rays, normals[face]


def box(middle: Sequence[float], size: Sequence[float], low_m: float, high_m: float, yaw_rad: float = 0.0) -> Prism:
    """Return a box of a size in plan about a middle, turned by a yaw."""
    signs = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])
    return Prism(outline=signs * size @ rotation_z(yaw_rad)[:2, :2].T + middle, low_m=low_m, high_m=high_m)


def wall(a: Float[np.ndarray, "2"], b: Float[np.ndarray, "2"], high_m: float) -> Prism:
    """Return a wall at the right of the way from a to b."""
    out = np.array([b[1] - a[1], a[0] - b[0]]) / max(float(np.linalg.norm(b - a)), 1e-9) * WALL_M
    return Prism(outline=np.array([a, a + out, b + out, b]), low_m=-DEEP_M, high_m=high_m)


Pose = tuple[Rotation, Vector3]
Level = tuple[Kind, list[tuple[float, float]], int]
"""Kind of a level, its outline (ahead, left), and how many of its points, the first ones, are on the right border. The outline
begins at the right end of the front edge and ends at its left end."""
Part = tuple[list[Level], tuple[float, float, float]]
"""Levels of a part of a staircase, and where the next one begins: ahead, left, and turned by."""


def flight(count: int, run_m: float, width_m: float, radius_m: float = STRAIGHT_M) -> Part:
    """Return steps whose middle line is an arc that turns left."""

    def at(radius: float, angle: float) -> tuple[float, float]:
        return radius * math.sin(angle), radius_m - radius * math.cos(angle)

    inner, outer, turn = radius_m - 0.5 * width_m, radius_m + 0.5 * width_m, run_m / radius_m
    kind: Kind = "step" if radius_m == STRAIGHT_M else "winder"
    levels = [(kind, [at(outer, a), at(outer, a + turn), at(inner, a + turn), at(inner, a)], 2) for a in turn * np.arange(count)]
    return levels, (*at(radius_m, turn * count), turn * count)  # type: ignore[return-value]


def quarter_turn(count: int, width_m: float) -> Part:
    """Return winders about the inner corner that fill a quarter turn; a single one is a landing."""
    half, levels = 0.5 * width_m, list[Level]()

    def at(angle: float) -> tuple[float, float]:
        reach = width_m / max(math.cos(angle), math.sin(angle))
        return reach * math.sin(angle), half - reach * math.cos(angle)

    for a, b in itertools.pairwise(0.5 * math.pi * np.arange(count + 1) / count):
        has_corner = a < 0.25 * math.pi - 1e-9 and b > 0.25 * math.pi + 1e-9
        border = [at(a), *([(width_m, -half)] if has_corner else []), at(b)]
        levels.append(("winder" if count > 1 else "landing", [*border, (0.0, half)], len(border)))
    return levels, (half, half, 0.5 * math.pi)


def half_turn(width_m: float, deep_m: float, beyond_m: float) -> Part:
    """Return a landing whose next flight goes back next to the first, its middle further left by ``beyond_m``."""
    half = 0.5 * width_m
    border = [(0.0, -half), (deep_m, -half), (deep_m, half + beyond_m), (0.0, half + beyond_m)]
    return [("landing", [*border, (0.0, half)], 4)], (0.0, beyond_m, math.pi)


def staircase(parts: Sequence[Part], rise_m: float, rng: np.random.Generator) -> Solids:
    """Return a staircase of parts up from the floor, with walls, balustrades or neither at each side, in a room."""
    scene, place, yaw_rad, level_m = Solids(), np.zeros(2), 0.0, 0.0
    right_m, left_m = (float(rng.choice([0.0, 0.9, 6.0])) for _ in range(2))
    is_open = rng.random() < 0.15
    for levels, (ahead, left, turn) in parts:
        R = rotation_z(yaw_rad)[:2, :2]
        for kind, points, count in levels:
            outline = np.array(points) @ R.T + place
            step_m = rise_m + JITTER_M * float(np.clip(rng.standard_normal(), -2.0, 2.0))
            level_m += step_m
            low_m = level_m - 0.05 if is_open and kind != "landing" else -DEEP_M
            scene.solids.append(Prism(outline=outline, low_m=low_m, high_m=level_m))
            scene.fronts.append(Front(ends=outline[[-1, 0]], level_m=level_m, rise_m=step_m, kind=kind, outline=outline))
            for border, high_m in ((outline[:count], right_m), (outline[count:], left_m)):
                scene.solids += [wall(a, b, level_m + high_m) for a, b in itertools.pairwise(border) if high_m]
        place, yaw_rad = R @ np.array([ahead, left]) + place, yaw_rad + turn
    corners = np.vstack([front.outline for front in scene.fronts])
    scene.solids += enclosure(corners.min(axis=0) - [4.0, 1.5], corners.max(axis=0) + 1.5, rng)
    return scene


def enclosure(low: np.ndarray, high: np.ndarray, rng: np.random.Generator) -> list[Prism]:
    """Return a floor and four walls about an area, up to 2 m further out."""
    low, high = low - rng.uniform(0.2, 2.0, 2), high + rng.uniform(0.2, 2.0, 2)
    corners = [np.array(corner) for corner in ((low[0], low[1]), (low[0], high[1]), (high[0], high[1]), (high[0], low[1]))]
    walls = [wall(b, a, 8.0) for a, b in zip(corners, [*corners[1:], corners[0]], strict=True)]
    return [box(0.5 * (low + high), high - low, -DEEP_M, 0.0), *walls]


def edge_scene(kind: Kind, size_m: float, distance_m: float, direction_rad: float, rng: np.random.Generator) -> Solids:
    """Return a floor with a kerb or a drop of a size at a distance ahead of the origin, across a direction."""
    ahead, left = rotation_z(direction_rad)[:2, :2].T
    near, level_m = np.array([distance_m, 0.0]), size_m if kind == "kerb" else -size_m
    own, far = (box(near + 3.0 * way * ahead, (6.0, 12.0), -2.0, z, direction_rad) for way, z in ((-1.0, 0.0), (1.0, level_m)))
    ends = np.array([near + 6.0 * left, near - 6.0 * left])
    front = Front(ends=ends, level_m=max(level_m, 0.0), rise_m=level_m, kind=kind, outline=far.outline)
    back = box(near + rng.uniform(2.0, 5.5) * ahead, (0.1, 12.0), -2.0, 3.0, direction_rad)
    return Solids(solids=[far, own, *([back] if rng.random() < 0.5 else [])], fronts=[front])


LEGS = [(x, y, 0.05, 0.05, 0.0, 0.95) for x in (-0.45, 0.45) for y in (-0.45, 0.45)]
BOARDS = [(0.0, 0.0, 1.0, 1.0, z, z + 0.015) for z in (0.03, 0.22, 0.41, 0.6, 0.79, 0.98)]
FURNITURE: dict[str, tuple[tuple[float, float, float], list[tuple[float, ...]]]] = {
    "table": ((0.7, 1.4, 0.73), [(0.0, 0.0, 1.0, 1.0, 0.95, 1.0), *LEGS]),
    "stool": ((0.4, 0.4, 0.46), [(0.0, 0.0, 1.0, 1.0, 0.9, 1.0), *LEGS]),
    "chair": ((0.45, 0.45, 0.46), [(0.0, 0.0, 1.0, 1.0, 0.9, 1.0), (0.48, 0.0, 0.05, 1.0, 1.0, 2.0), *LEGS]),
    "sofa": ((0.9, 1.8, 0.85), [(0.0, 0.0, 1.0, 1.0, 0.05, 0.5), (0.4, 0.0, 0.2, 1.0, 0.0, 1.0)]
        + [(0.0, y, 1.0, 0.1, 0.0, 0.75) for y in (-0.5, 0.5)]),
    "shelf": ((0.35, 1.0, 1.9), [(0.5, 0.0, 0.05, 1.0, 0.0, 1.0), *BOARDS]),
    "bed": ((1.4, 2.0, 0.5), [(0.0, 0.0, 1.0, 1.0, 0.2, 1.0)]),
    "box": ((0.5, 0.4, 0.35), [(0.0, 0.0, 1.0, 1.0, 0.0, 1.0)]),
}  # fmt: skip
"""Sizes of furniture [m], and their parts relative to them: middle and size in plan, lower and upper end."""


def room(rng: np.random.Generator) -> Solids:
    """Return a room with up to six pieces of furniture, and a ramp of up to 10 % in a third of the rooms."""
    solids = enclosure(np.array([-1.0, -1.2]), np.array([rng.uniform(1.2, 4.0), 1.2]), rng)
    for name in rng.choice(list(FURNITURE), rng.integers(0, 7)):
        size, parts = FURNITURE[str(name)]
        long, wide, high = rng.uniform(0.75, 1.3, 3) * size
        place, yaw_rad = rng.uniform((0.9, -1.2), (3.0, 1.2)), float(rng.choice([0.0, 0.5, -0.5, rng.uniform(-1.0, 1.0)])) * math.pi
        R = rotation_z(yaw_rad)[:2, :2]
        for x, y, dx, dy, low, top in parts:
            middle = place + R @ np.array([x * long, y * wide])
            solids.append(box(middle, (dx * long, dy * wide), low * high, top * high, yaw_rad))
    if rng.random() < 1.0 / 3.0:
        grade, start_m = rng.uniform(0.03, 0.10), rng.uniform(0.6, 1.8)
        ramp = box((start_m + 2.0, 0.0), (4.0, rng.uniform(1.0, 3.0)), -DEEP_M, -grade * start_m)
        solids.append(replace(ramp, grade=(grade, 0.0)))
    return Solids(solids=solids)


def camera_of(sensor: str, width_px: int, height_px: int) -> PinholeCamera:
    """Return the camera of a sensor on the chair's mount; 320×240 is every second pixel of 640×480."""
    native = max(width_px, 640)
    scale, mount = width_px / native, read_chair("wheelchair").camera_at(240)
    f, cx, cy = FOCAL_PX[sensor][native] * scale, 0.5 * (width_px - scale), 0.5 * (height_px - scale)
    return replace(mount, width_px=width_px, height_px=height_px, fx_px=f, fy_px=f, cx_px=cx, cy_px=cy)


def drawn_stair(name: str, rng: np.random.Generator) -> tuple[Solids, int, float, float]:
    """Return a staircase by name, its number of straight steps before the turn, its rise and its run."""
    rise_m, run_m, width_m = rng.uniform(0.155, 0.19), rng.uniform(0.25, 0.31), rng.uniform(0.9, 1.2)
    before, after = int(rng.integers(7, 10)), int(rng.integers(3, 7))
    first, last, end = flight(before, run_m, width_m), flight(after, run_m, width_m), quarter_turn(1, width_m)
    half = half_turn(width_m, width_m + rng.uniform(0.0, 0.3), width_m + rng.uniform(0.12, 0.3))
    if name == "straight":
        parts = [first, end]
    elif name.startswith("winding"):
        before, parts = 0, [flight(before + after, run_m, width_m, float(name.split()[1])), end]
    else:
        turn = half if name == "half landing" else quarter_turn(1 if name == "quarter landing" else int(name[0]), width_m)
        parts = [first, turn, last, end]
    return staircase(parts, rise_m, rng), before, rise_m, run_m


def stair_pose(
    before: int, total: int, rise_m: float, run_m: float, heading_rad: float, camera: PinholeCamera, rng: np.random.Generator
) -> Pose:
    """Return the pose of a chair on a straight flight with a number of straight nosings in view before the turn.

    Nosings count from where the view of the middle column begins on the nosing plane.
    """
    slope = math.atan2(rise_m, run_m)
    lowest = camera.mount_pitch_rad + math.atan((camera.height_px - camera.cy_px) / camera.fy_px)
    view_m = camera.mount_m[0] + camera.mount_m[2] / math.tan(lowest)
    x = (total - before - rng.uniform(0.1, 0.9)) * run_m - view_m * math.cos(slope)
    R_WB = rotation_y(-slope) @ rotation_z(heading_rad)
    return R_WB, np.array([x, rng.uniform(-0.08, 0.08), rise_m + x * math.tan(slope)])


def truth_of(front: Front, R_WL: Rotation, p_WB: Vector3, p_WC: Vector3, seen: Callable[[np.ndarray], np.ndarray]) -> TrueStep:
    """Return the ground truth of one edge.

    Args:
        R_WL: Axes ahead, left and up of the levelled chair in W.
        seen: Function that returns which points in W are visible.
    """
    along = front.ends[1] - front.ends[0]
    normal = np.array([-along[1], along[0]]) / np.linalg.norm(along)
    places = front.ends[0] + np.array([[0.0], [0.5], [1.0]]) * along
    local = (front.ends - p_WC[:2]) @ R_WL[:2, :2]
    ahead = normal @ R_WL[:2, :2]
    line = front.ends[0] + np.linspace(0.01, 0.99, 33)[:, None] * along
    points = np.column_stack([line, np.full(33, front.level_m)])
    return TrueStep(
        height_m=front.level_m - float(p_WB[2]),
        rise_m=front.rise_m,
        edge=np.column_stack([-local[:, 1], local[:, 0]]),
        direction_rad=math.atan2(ahead[1], ahead[0]),
        depth_m=tuple(depth_of(front.outline, place, normal) for place in places),  # type: ignore[arg-type]
        kind=front.kind,
        visible=float(np.mean(seen(points))),
    )


def depth_of(outline: np.ndarray, place: np.ndarray, way: np.ndarray) -> float:
    """Return the distance from a place on the border of an outline to where the way leaves it."""
    spaces = Prism(outline=outline, low_m=0.0, high_m=1.0).half_spaces[: len(outline)]
    rate, gap = spaces[:, :2] @ way, spaces[:, 3] - spaces[:, :2] @ place
    return max(float((gap[rate > 1e-9] / rate[rate > 1e-9]).min()), 0.0)


def shot(scene: Solids, pose: Pose, camera: PinholeCamera, sensor: str, rng: np.random.Generator) -> StepFrame:
    """Return the frame of a scene from a pose of the chair."""
    R_WB, p_WB = pose
    R_WC, p_WC = R_WB @ camera.R_BC, p_WB + R_WB @ np.array(camera.mount_m)
    step = 1 if camera.width_px >= 640 else 2
    native = camera_of(sensor, camera.width_px * step, camera.height_px * step)
    depth, rays, normals = render(scene.solids, native, R_WC, p_WC)
    image = ExactImage(depth_m=np.minimum(depth, 50.0), rays=rays, normals=normals, focal_px=native.fx_px)
    measured = np.where(depth < FAR_M, NOISES[sensor](image, rng), np.nan)[::step, ::step].astype(np.float32)

    def seen(points: np.ndarray) -> np.ndarray:
        local = (points - p_WC) @ R_WC
        u, v = native.point_to_pixel(local)
        column, row = (np.nan_to_num(np.round(place)).astype(int) for place in (u, v))
        return np.isfinite(u) & (depth[row, column] > 0.97 * local[:, 2] - 0.02)

    R_WL = rotation_z(math.atan2(R_WB[1, 0], R_WB[0, 0]))
    steps = tuple(truth_of(front, R_WL, p_WB, p_WC, seen) for front in scene.fronts)
    down_C = R_WC.T @ np.array([0.0, 0.0, -1.0])
    noisy = down_C + np.cross(GRAVITY_DEG * DEG * rng.standard_normal(3), down_C)
    place = R_WL.T @ (p_WC - p_WB)
    return StepFrame(
        frame=RgbdFrame(t_s=0.0, rgb=black(*measured.shape), depth_m=np.ascontiguousarray(measured), camera=camera),
        gravity_C=noisy / np.linalg.norm(noisy),
        true_gravity_C=down_C,
        steps=steps,
        camera_at=(-float(place[1]), float(place[0]), float(place[2])),
    )


def draw_frame(
    seed: int,
    name: str,
    *,
    before: int | None = None,
    heading_deg: float | None = None,
    size_m: float = 0.15,
    sensor: str = "stereo",
    image: tuple[int, int] = (640, 480),
) -> StepFrame:
    """Return a frame by the name of a scene (``STAIRS``, ``winding <radius>``, ``kerb``, ``drop``, ``room``).

    Args:
        before: Straight nosings in view before the turn. 0: the turn's first edge is the nearest; a chair on a landing has turned
            by a part of the turn. None: the chair is on the floor before the stair.
        heading_deg: Angle of the chair to the way, positive to the left; None: up to 12° drawn, 30° at a kerb or a drop.
        size_m: Height of a kerb, depth of a drop.
    """
    rng = np.random.default_rng(seed)
    camera = camera_of(sensor, *image)
    heading = (rng.uniform(-12.0, 12.0) if heading_deg is None else heading_deg) * DEG
    place = np.array([0.0, rng.uniform(-0.08, 0.08), 0.0])
    if name in ("kerb", "drop"):
        across = (2.5 if heading_deg is None else -1.0) * heading
        scene = edge_scene("kerb" if name == "kerb" else "drop", size_m, rng.uniform(1.0, 1.9), across, rng)
        return shot(scene, (np.eye(3), place), camera, sensor, rng)
    if name == "room":
        return shot(room(rng), (rotation_z(heading), place), camera, sensor, rng)
    scene, count, rise_m, run_m = drawn_stair(name, rng)
    pose = (rotation_z(heading), np.array([-camera.mount_m[0] - rng.uniform(0.4, 1.3), place[1], 0.0]))
    if before == 0 and "landing" in name:
        top, following = (front.ends.mean(axis=0) for front in scene.fronts[count : count + 2])
        share = rng.uniform(0.0, 1.0)
        turned = share * (math.pi if "half" in name else 0.5 * math.pi) if heading_deg is None else heading
        aside = share * (following[1] - top[1]) if "half" in name else 0.0
        pose = (rotation_z(turned), np.array([top[0] + 0.5, top[1] + aside, scene.fronts[count].level_m]))
    elif before is not None:
        pose = stair_pose(before, count, rise_m, run_m, heading, camera, rng)
    if rng.random() < 0.5:
        flip = np.diag([1.0, -1.0, 1.0])
        scene, pose = scene.mirrored(), (flip @ pose[0] @ flip, flip @ pose[1])
    return shot(scene, pose, camera, sensor, rng)
