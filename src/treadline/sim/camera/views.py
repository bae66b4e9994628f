"""Views with their truth: what a chair's camera sees of a stair, or of a place that has none, drawn from a recipe.

    recipe = Recipe(scenes=("up",), heading_deg=(-35.0, 35.0), open_risers=True)
    view = draw_view(np.random.default_rng(1), recipe)
    sight = StairDetector().look(view.frame, view.gravity_C)
    error_rad = sight.heading_rad - view.stair.heading_rad

``view.stair`` is None where there is no stair (``ROOM_SCENES``). The frame's calibration and ``gravity_C`` are what the
estimator is told, with the recipe's errors of mount, focal length and gravity; the truth has none. Heading is the contract's:
zero when square to the nosings, facing up (``up``, ``top``, ``foot``) or down the flight (``down``, ``edge``, ``bottom``),
positive anticlockwise seen from above. The same generator state and recipe give the same bytes.
"""

import math
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float

from treadline.angles import DEG, rotation_x, rotation_y, rotation_z
from treadline.mechanics.chair import ChairDescription, read_chair
from treadline.mechanics.staircase import FLOOR_LENGTH_M, Staircase, Step, build_staircase
from treadline.scenario import Stair
from treadline.signals import PinholeCamera, RgbdFrame
from treadline.sim.camera.camera import VIEW_M, Camera, ExactView
from treadline.sim.camera.clutter import OBSTACLES, RAIL_INSET_M, RAIL_M, cast_shadows, clutter_of, spilt, worn_step
from treadline.sim.camera.recipe import PLACES_M, STAIR_SCENES, Range, Recipe, Scene
from treadline.sim.camera.rooms import askew_wall, plain, room
from treadline.sim.camera.solids import Puddle, Shadow, Solid, solids_of, upright

Direction = Literal["up", "down"]
DIRECTIONS: dict[str, Direction] = {
    "up": "up",
    "top": "up",
    "foot": "up",
    "down": "down",
    "edge": "down",
    "bottom": "down",
}
ROOM_YAW_DEG: Range = (-12.0, 12.0)
"""Of the chair in a place without a stair; the things there are askew themselves."""
LEVEL = ("foot", "edge")
"""Scenes in which the chair stands level."""
CLEAR_M = 0.12
"""Between the camera and a wall or rail, at least."""
SWEPT_HEIGHT_M = (0.06, 1.4)
"""Above the belts' lower line: lower things the belts climb, and the chair's rider is no taller."""
GRAIN_M = 0.01
"""Distance between the points of a thing that are asked whether they stand in the way."""
LEAST_WALL = 0.01
"""Share of the image that a wall or a rail must fill to count as seen."""
HIDDEN_M = 0.03
"""A nosing this far behind what the image shows in its place is hidden."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StairTruth:
    """The stair as it is, in the terms of ``StairMap``."""

    direction: Direction
    heading_rad: float
    edge_C: Float[np.ndarray, " 3"]
    """Unit vector along the nosings, pointing to the chair's right."""
    normal_C: Float[np.ndarray, " 3"]
    """Unit vector square to the plane through the nosings, pointing away from the stair."""
    slope_rad: float
    rise_m: float
    run_m: float
    """As designed; jitter of single steps comes on top."""
    share: float
    """Of the image that shows steps."""
    nosings_B: Float[np.ndarray, "n 3"]
    """Where each nosing ahead meets the chair's middle plane, the nearest first; those out of sight too, and those that
    would meet it beside the stair. A worn nosing counts as if it were sharp."""
    nosing_in_view: Bool[np.ndarray, " n"]
    """Whether that point is on the stair, in the image and not hidden."""
    end_in_view: bool
    """Whether the flight's last nosing is in view, where it meets the middle plane or elsewhere."""
    left_wall_m: float | None
    """From the chair's middle to the wall or rail at its left, square to that; None if none is in view."""
    right_wall_m: float | None
    obstacle_m: float | None
    """Along x to the nearest thing in the volume that the chair's tracks will sweep."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class View:
    """A frame, what the estimator is told with it, and the truth."""

    scene: Scene
    frame: RgbdFrame
    gravity_C: Float[np.ndarray, " 3"]
    """As the IMU and the calibrated mount tell it."""
    true_gravity_C: Float[np.ndarray, " 3"]
    true_camera: PinholeCamera
    """The calibration without errors."""
    exact: ExactView
    kinds: tuple[str, ...]
    """What stands where ``exact.face // 6`` points to it: ``step``, ``wall``, ``rail``, ``leg`` …"""
    stair: StairTruth | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Pose:
    """Where the chair stands."""

    R_WB: Float[np.ndarray, "3 3"]
    p_WB: Float[np.ndarray, " 3"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Flight:
    """A staircase whose steps need not be level."""

    staircase: Staircase
    tilts_rad: Float[np.ndarray, "n 2"]
    """Of each step: down to the front, then up to the left."""

    def turn(self, index: int) -> Float[np.ndarray, "3 3"]:
        """Return how a step is tilted about its nosing's middle."""
        pitch, roll = self.tilts_rad[index]
        return rotation_y(-float(pitch)) @ rotation_x(float(roll))

    def along(self, step: Step) -> Float[np.ndarray, " 3"]:
        """Return the direction of a step's nosing, to the left."""
        return self.turn(step.index) @ np.array([-math.sin(step.yaw_rad), math.cos(step.yaw_rad), 0.0])

    def solids(self) -> tuple[Solid, ...]:
        """Return the staircase's solids, tilted."""
        return tuple(self._tilted(solid) for solid in solids_of(self.staircase.boxes()))

    def _tilted(self, solid: Solid) -> Solid:
        if solid.kind != "step":
            return solid
        step, turn = self.staircase.steps[solid.index], self.turn(solid.index)
        nosing = np.array([step.x_m, 0.0, step.z_m])
        return replace(solid, centre_W=nosing + turn @ (solid.centre_W - nosing), R_WK=turn @ solid.R_WK)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Setting:
    """What is to be seen."""

    solids: list[Solid]
    shadows: list[Shadow] = field(default_factory=list)
    puddles: list[Puddle] = field(default_factory=list)


def draw_view(rng: np.random.Generator, recipe: Recipe) -> View:
    """Return one view; all that the recipe leaves open is drawn from ``rng``."""
    chair = read_chair("wheelchair")
    scene = recipe.scenes[int(rng.integers(len(recipe.scenes)))]
    told, true = _cameras(chair, recipe, rng)
    heading = _drawn(recipe.heading_deg, rng) * DEG
    if scene in STAIR_SCENES:
        staircase = _staircase(recipe, rng)
        flight = _Flight(
            staircase=staircase, tilts_rad=recipe.tread_tilt_deg * DEG * rng.standard_normal((len(staircase.steps), 2))
        )
        pose = _pose(scene, staircase, heading, recipe, rng)
        pose = _clear_of_walls(pose, staircase, np.array(true.mount_m), _is_railed(recipe))
        setting = _setting(flight, scene, pose, recipe, rng)
    else:
        flight = None
        yaw = rotation_z(_drawn(ROOM_YAW_DEG, rng) * DEG)
        pose = _Pose(R_WB=yaw @ _rocked(recipe, rng), p_WB=np.array([0.0, _drawn(recipe.lateral_m, rng), 0.0]))
        setting = _Setting(solids=room(scene, rng), shadows=cast_shadows(rng) if "shadow" in recipe.clutter else [])
    R_WC = pose.R_WB @ true.R_BC
    p_WC = pose.p_WB + pose.R_WB @ np.array(true.mount_m)
    length, way = _drawn(recipe.blur_px, rng), rng.uniform(0.0, math.pi)
    camera = Camera(
        setting.solids,
        true,
        told=told,
        kind=recipe.sensor,
        texture=str(rng.choice(recipe.textures)),
        light=_drawn(recipe.light, rng),
        grain_px=recipe.grain_px,
        warp_px=recipe.warp_px,
        holes=recipe.holes,
        blur_px=(length * math.cos(way), length * math.sin(way)),
        shadows=setting.shadows,
        puddles=setting.puddles,
        rng=rng,
    )
    exact = camera.exact(R_WC, p_WC)
    down_W = np.array([0.0, 0.0, -1.0])
    return View(
        scene=scene,
        frame=camera.frame(0.0, R_WC, p_WC),
        gravity_C=told.R_BC.T @ _tilted(pose.R_WB.T @ down_W, recipe.gravity_error_deg * DEG, rng),
        true_gravity_C=R_WC.T @ down_W,
        true_camera=true,
        exact=exact,
        kinds=tuple(solid.kind for solid in setting.solids),
        stair=None if flight is None else _truth(DIRECTIONS[scene], flight, pose, true, setting.solids, exact, chair),
    )


def calibration_of(recipe: Recipe, chair: ChairDescription) -> PinholeCamera:
    """Return the nominal camera of a recipe's sensor on a chair."""
    if recipe.sensor != "kinect2":
        camera = chair.camera_at(recipe.height_px or 240)
    else:
        rows = recipe.height_px or 424
        scale = rows / 424.0
        # The depth camera of a Kinect 2: 512×424, about 365 px.
        camera = replace(
            chair.camera_at(240),
            width_px=round(512 * scale),
            height_px=rows,
            fx_px=365.3 * scale,
            fy_px=365.3 * scale,
            cx_px=(round(512 * scale) - 1) / 2,
            cy_px=(rows - 1) / 2,
        )
    return camera if recipe.focal_px is None else replace(camera, fx_px=recipe.focal_px, fy_px=recipe.focal_px)


def _cameras(chair: ChairDescription, recipe: Recipe, rng: np.random.Generator) -> tuple[PinholeCamera, PinholeCamera]:
    """Return the camera as the estimator is told, and as it is."""
    told = calibration_of(recipe, chair)
    if recipe.pitch_deg is not None:
        told = replace(told, mount_pitch_rad=_drawn(recipe.pitch_deg, rng) * DEG)
    scale = 1.0 + recipe.focal_error * float(rng.standard_normal())
    true = replace(
        told,
        fx_px=told.fx_px * scale,
        fy_px=told.fy_px * scale,
        mount_pitch_rad=told.mount_pitch_rad + _drawn(recipe.mount_pitch_error_deg, rng) * DEG,
        mount_roll_rad=told.mount_roll_rad + _drawn(recipe.mount_roll_error_deg, rng) * DEG,
    )
    return told, true


def _staircase(recipe: Recipe, rng: np.random.Generator) -> Staircase:
    rise, slope = _drawn(recipe.rise_m, rng), _drawn(recipe.slope_deg, rng) * DEG
    run = rise / math.tan(slope) if recipe.run_m is None else _drawn(recipe.run_m, rng)
    stair = Stair(
        rise_m=rise,
        run_m=run,
        steps=int(rng.integers(recipe.steps[0], recipe.steps[1], endpoint=True)),
        width_m=_drawn(recipe.width_m, rng),
        landing_m=_drawn(recipe.landing_m, rng),
        open_risers=recipe.open_risers,
        rise_jitter_m=recipe.rise_jitter_m,
        nosing_yaw_jitter_deg=recipe.nosing_yaw_jitter_deg,
        walls=recipe.walls[int(rng.integers(len(recipe.walls)))],
    )
    staircase = build_staircase(stair, rng)
    x = run * np.arange(stair.steps) + recipe.run_jitter_m * rng.standard_normal(stair.steps)
    depth = np.append(np.diff(x), run)
    steps = tuple(
        replace(step, x_m=float(front), depth_m=float(deep)) for step, front, deep in zip(staircase.steps, x, depth, strict=True)
    )
    return replace(staircase, steps=steps)


def _pose(scene: str, staircase: Staircase, heading_rad: float, recipe: Recipe, rng: np.random.Generator) -> _Pose:
    """Return where the chair stands: on the nosings, on the floor or on the landing."""
    first, last = staircase.steps[0], staircase.steps[-1]
    length = math.hypot(last.x_m - first.x_m, last.z_m - first.z_m)
    place = _drawn(recipe.place_m or PLACES_M[scene], rng)
    lateral = _drawn(recipe.lateral_m, rng)
    yaw = rotation_z(heading_rad + (0.0 if DIRECTIONS[scene] == "up" else math.pi))
    rock = _rocked(recipe, rng)
    if scene in LEVEL:
        x, z = (first.x_m - place, 0.0) if scene == "foot" else (last.x_m + place, last.z_m)
        return _Pose(R_WB=yaw @ rock, p_WB=np.array([x, lateral, z]))
    along = {"up": place, "top": length - place, "down": length - place, "bottom": place}[scene]
    p_WB = staircase.p_WS + staircase.R_WS @ np.array([along, lateral, 0.0])
    return _Pose(R_WB=staircase.R_WS @ yaw @ rock, p_WB=p_WB)


def _rocked(recipe: Recipe, rng: np.random.Generator) -> Float[np.ndarray, "3 3"]:
    pitch, roll = recipe.rock_deg * DEG * rng.standard_normal(2)
    return rotation_y(float(pitch)) @ rotation_x(float(roll))


def _is_railed(recipe: Recipe) -> bool:
    return "rail_left" in recipe.clutter or "rail_right" in recipe.clutter


def _clear_of_walls(pose: _Pose, staircase: Staircase, p_BC: Float[np.ndarray, " 3"], railed: bool) -> _Pose:
    """Return the pose moved aside as far as the camera needs to be within the stair's width."""
    limit = 0.5 * staircase.width_m - CLEAR_M - (RAIL_INSET_M + RAIL_M if railed else 0.0)
    y = float((pose.p_WB + pose.R_WB @ p_BC)[1])
    return replace(pose, p_WB=pose.p_WB + np.array([0.0, min(max(y, -limit), limit) - y, 0.0]))


def _setting(flight: _Flight, scene: str, pose: _Pose, recipe: Recipe, rng: np.random.Generator) -> _Setting:
    """Return the stair and what stands about, one to five steps ahead of the chair's nose."""
    staircase = flight.staircase
    clutter, shadows, puddles = [], [], []
    x = np.array([step.x_m for step in staircase.steps])
    ahead = (pose.p_WB + pose.R_WB @ np.array([1.2, 0.0, 0.0]))[0]
    nearest = int(np.argmin(np.abs(x - ahead)))
    way = 1 if DIRECTIONS[scene] == "up" else -1
    for name in recipe.clutter:
        there = rng.random() < recipe.clutter_chance
        step = min(max(nearest + way * int(rng.integers(4)), 0), len(x) - 3)
        if there and name == "shadow":
            shadows = cast_shadows(rng)
        elif there and name == "wet":
            puddles = spilt(staircase, range(max(nearest - 6, 0), min(nearest + 7, len(x) - 1)), rng)
        elif there:
            clutter += clutter_of(name, staircase, step, rng)
    return _Setting(solids=_stair_solids(flight, clutter, recipe, rng), shadows=shadows, puddles=puddles)


def _stair_solids(flight: _Flight, clutter: list[Solid], recipe: Recipe, rng: np.random.Generator) -> list[Solid]:
    """Return floor, steps, walls and clutter, with a wall behind the landing and one before the floor's end."""
    staircase, last = flight.staircase, flight.staircase.steps[-1]
    end_x = last.x_m + max(staircase.landing_m, last.depth_m)
    floor = upright("floor", (-FLOOR_LENGTH_M, -VIEW_M, -0.2), (end_x + VIEW_M, VIEW_M, 0.0), texture="concrete")
    askew = _drawn(recipe.back_wall_deg, rng) * DEG
    # However askew, it meets both side walls.
    behind = askew_wall(end_x - 0.5 * staircase.width_m * math.tan(abs(askew)), askew, low_m=last.z_m)
    before = askew_wall(-float(rng.uniform(2.5, 5.5)), math.pi + float(rng.uniform(-20.0, 20.0)) * DEG)
    solids = [floor, behind, before]
    for solid in flight.solids():
        if solid.kind == "step" and recipe.worn_m > 0.0:
            solids += worn_step(solid, staircase.open_risers, recipe.worn_m, rng)
        elif solid.kind != "floor":
            solids.append(solid)
    return [plain(solid) for solid in solids + clutter]


def _tilted(direction: Float[np.ndarray, " 3"], angle_rad: float, rng: np.random.Generator) -> Float[np.ndarray, " 3"]:
    """Return a direction turned by an angle towards a random side."""
    side = np.cross(direction, rng.standard_normal(3))
    return math.cos(angle_rad) * direction + math.sin(angle_rad) * side / np.linalg.norm(side)


def _drawn(limits: Range, rng: np.random.Generator) -> float:
    return float(rng.uniform(*limits))


def _truth(
    direction: Direction,
    flight: _Flight,
    pose: _Pose,
    camera: PinholeCamera,
    solids: list[Solid],
    exact: ExactView,
    chair: ChairDescription,
) -> StairTruth:
    right_W = np.array([0.0, -1.0 if direction == "up" else 1.0, 0.0])
    edge_B = pose.R_WB.T @ right_W
    is_step = np.array([*(solid.kind == "step" for solid in solids), False])
    staircase = flight.staircase
    nosings = _nosings(flight, pose, direction)
    on_stair = np.abs((pose.p_WB + nosings @ pose.R_WB.T)[:, 1]) <= 0.5 * staircase.width_m
    steps = staircase.steps
    left, right = _walls(staircase, solids, pose, direction, exact)
    return StairTruth(
        direction=direction,
        heading_rad=math.atan2(-edge_B[0], -edge_B[1]),
        edge_C=camera.R_BC.T @ edge_B,
        normal_C=camera.R_BC.T @ pose.R_WB.T @ staircase.R_WS[:, 2],
        slope_rad=staircase.slope_rad,
        rise_m=staircase.pitch_m * math.sin(staircase.slope_rad),
        run_m=staircase.pitch_m * math.cos(staircase.slope_rad),
        share=float(is_step[np.where(exact.face >= 0, exact.face // 6, len(solids))].mean()),
        nosings_B=nosings,
        nosing_in_view=_in_view(nosings, camera, exact) & on_stair,
        end_in_view=_end_in_view(flight, steps[-1] if direction == "up" else steps[0], pose, camera, exact),
        left_wall_m=left,
        right_wall_m=right,
        obstacle_m=_obstacle(solids, pose, chair),
    )


def _nosings(flight: _Flight, pose: _Pose, direction: Direction) -> Float[np.ndarray, "n 3"]:
    """Return where the nosings ahead of the chair's middle, extended beyond the stair's width, meet its middle plane."""
    x_B, y_B, z_B = pose.R_WB.T
    points = []
    for step in flight.staircase.steps if direction == "up" else reversed(flight.staircase.steps):
        if step.missing:
            continue
        nosing = np.array([step.x_m, 0.0, step.z_m]) - pose.p_WB
        along = flight.along(step)
        aside = -float(y_B @ nosing) / float(y_B @ along)
        point = nosing + aside * along
        if x_B @ point > 0.0:
            points.append([float(x_B @ point), 0.0, float(z_B @ point)])
    return np.array(points).reshape(-1, 3)


def _in_view(points_B: Float[np.ndarray, "n 3"], camera: PinholeCamera, exact: ExactView) -> Bool[np.ndarray, " n"]:
    """Return which points are in the image and not behind something."""
    points = (points_B - np.array(camera.mount_m)) @ camera.R_BC
    z = np.maximum(points[:, 2], 1e-6)
    u = np.round(camera.fx_px * points[:, 0] / z + camera.cx_px)
    v = np.round(camera.fy_px * points[:, 1] / z + camera.cy_px)
    inside = (points[:, 2] > 0.1) & (u >= 0) & (u < camera.width_px) & (v >= 0) & (v < camera.height_px)
    seen = np.zeros(len(points), dtype=np.bool_)
    shown = exact.depth_m[v[inside].astype(int), u[inside].astype(int)]
    seen[inside] = points[inside, 2] < np.nan_to_num(shown, nan=np.inf) + HIDDEN_M
    return seen


def _end_in_view(flight: _Flight, step: Step, pose: _Pose, camera: PinholeCamera, exact: ExactView) -> bool:
    aside = np.linspace(-0.5, 0.5, 21)[:, None] * flight.staircase.width_m
    points_W = np.array([step.x_m, 0.0, step.z_m]) + aside * flight.along(step)
    return bool(_in_view((points_W - pose.p_WB) @ pose.R_WB, camera, exact).any())


def _walls(
    staircase: Staircase, solids: list[Solid], pose: _Pose, direction: Direction, exact: ExactView
) -> tuple[float | None, float | None]:
    """Return the free widths at the chair's left and right, to the nearest of wall and rail that is in view."""
    half = 0.5 * staircase.width_m
    shown = np.bincount(exact.face[exact.face >= 0] // 6, minlength=len(solids)) / exact.face.size
    free: list[float | None] = []
    for side in (1.0, -1.0):
        widths = []
        for kind, inner in (("wall", half), ("rail", half - RAIL_INSET_M - 0.5 * RAIL_M)):
            there = [i for i, solid in enumerate(solids) if solid.kind == kind and side * solid.centre_W[1] > 0.5 * half]
            widths += [inner - side * float(pose.p_WB[1])] if shown[there].sum() > LEAST_WALL else []
        free.append(min(widths, default=None))
    return (free[0], free[1]) if direction == "up" else (free[1], free[0])


def _obstacle(solids: list[Solid], pose: _Pose, chair: ChairDescription) -> float | None:
    """Return how far ahead something stands between the tracks' outer sides, to a centimetre."""
    half = 0.5 * (chair.tracks.gauge_m + chair.tracks.belt_width_m)
    found = []
    for solid in solids:
        if solid.kind in OBSTACLES:
            axes = [np.linspace(-h, h, max(2, round(2.0 * h / GRAIN_M) + 1)) for h in solid.half_m]
            points_K = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
            x, y, z = ((solid.centre_W + points_K @ solid.R_WK.T - pose.p_WB) @ pose.R_WB).T
            hit = (np.abs(y) <= half) & (z >= SWEPT_HEIGHT_M[0]) & (z <= SWEPT_HEIGHT_M[1]) & (x > 0.0)
            found += [float(x[hit].min())] if hit.any() else []
    return min(found, default=None)
