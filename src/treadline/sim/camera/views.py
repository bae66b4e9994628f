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

import numpy as np
from jaxtyping import Float

from treadline.angles import DEG, rotation_z
from treadline.errors import SettingsError
from treadline.mechanics.chair import ChairDescription, read_chair
from treadline.mechanics.staircase import FLOOR_LENGTH_M
from treadline.signals import PinholeCamera, RgbdFrame
from treadline.sim.camera.camera import VIEW_M, Camera, ExactView
from treadline.sim.camera.clutter import cast_shadows, clutter_of, spilt, worn_step
from treadline.sim.camera.flight import DIRECTIONS, LEVEL, Flight, Pose, draw_flight, draw_pose, rocked
from treadline.sim.camera.recipe import STAIR_SCENES, Range, Recipe, Scene, drawn
from treadline.sim.camera.rooms import askew_wall, plain, room
from treadline.sim.camera.solids import Puddle, Shadow, Solid, upright
from treadline.sim.camera.truth import StairTruth, stair_truth

DOWN_W = np.array([0.0, 0.0, -1.0])
DOWN_W.setflags(write=False)
ROOM_YAW_DEG: Range = (-12.0, 12.0)
"""Of the chair in a place without a stair; the things there are askew themselves."""


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


@dataclass(frozen=True, slots=True, kw_only=True)
class _Setting:
    """What is to be seen."""

    solids: list[Solid]
    shadows: list[Shadow] = field(default_factory=list)
    puddles: list[Puddle] = field(default_factory=list)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Stage:
    """All that stays while a chair moves."""

    scene: Scene
    chair: ChairDescription
    told: PinholeCamera
    true: PinholeCamera
    flight: Flight | None
    solids: list[Solid]
    camera: Camera

    def view(self, t_s: float, pose: Pose) -> View:
        """Return what is seen from a pose, gravity told without error."""
        R_WC = pose.R_WB @ self.true.R_BC
        p_WC = pose.p_WB + pose.R_WB @ np.array(self.true.mount_m)
        exact = self.camera.exact(R_WC, p_WC)
        stair = None
        if self.flight is not None:
            stair = stair_truth(DIRECTIONS[self.scene], self.flight, pose, self.true, self.solids, exact, self.chair)
        return View(
            scene=self.scene,
            frame=self.camera.frame(t_s, R_WC, p_WC),
            gravity_C=self.told.R_BC.T @ pose.R_WB.T @ DOWN_W,
            true_gravity_C=R_WC.T @ DOWN_W,
            true_camera=self.true,
            exact=exact,
            kinds=tuple(solid.kind for solid in self.solids),
            stair=stair,
        )


def draw_view(rng: np.random.Generator, recipe: Recipe) -> View:
    """Return one view; all that the recipe leaves open is drawn from ``rng``."""
    stage, pose = _stage(rng, recipe)
    view = stage.view(0.0, pose)
    felt_B = _tilted(pose.R_WB.T @ DOWN_W, recipe.gravity_error_deg * DEG, rng)
    return replace(view, gravity_C=stage.told.R_BC.T @ felt_B)


class RecordedDrive:
    """A chair on one flight, seen again and again: the same stair, light, camera and errors of mount, depth and gravity.

        drive = RecordedDrive(rng, Recipe(scenes=("up",), warp_px=0.03))
        view = drive.view(t_s, drive.pose(along_m=0.2 * t_s, heading_rad=0.1))

    An IMU that goes with it is the caller's: ``pose`` tells its rotation.
    """

    def __init__(self, rng: np.random.Generator, recipe: Recipe) -> None:
        self._stage, self._start = _stage(rng, recipe)
        if self._stage.flight is None or self._stage.scene in LEVEL:
            raise SettingsError(f"a drive needs a chair on a flight, not '{self._stage.scene}'; give up, top, down or bottom")
        self._staircase = self._stage.flight.staircase
        self._yaw_rad = 0.0 if DIRECTIONS[self._stage.scene] == "up" else math.pi
        level = np.array([0.0, 0.0, 1.0])
        tilted = _tilted(level, recipe.gravity_error_deg * DEG, rng)
        self._felt = np.eye(3) + np.outer(tilted - level, level) - np.outer(level, tilted - level)

    def pose(self, along_m: float, heading_rad: float) -> Pose:
        """Return where the chair stands after some way along the flight, aside as at the start."""
        forward = self._staircase.R_WS[:, 0] * (1.0 if self._yaw_rad == 0.0 else -1.0)
        R_WB = self._staircase.R_WS @ rotation_z(self._yaw_rad + heading_rad)
        return Pose(R_WB=R_WB, p_WB=self._start.p_WB + along_m * forward)

    def view(self, t_s: float, pose: Pose) -> View:
        """Return what is seen from a pose."""
        seen = self._stage.view(t_s, pose)
        felt_B = self._felt @ pose.R_WB.T @ DOWN_W
        return replace(seen, gravity_C=self._stage.told.R_BC.T @ felt_B / np.linalg.norm(felt_B))


def _stage(rng: np.random.Generator, recipe: Recipe) -> tuple[_Stage, Pose]:
    """Return what there is to be seen, by which camera, and where the chair stands."""
    chair = read_chair("wheelchair")
    scene = recipe.scenes[int(rng.integers(len(recipe.scenes)))]
    told, true = _cameras(chair, recipe, rng)
    heading = drawn(recipe.heading_deg, rng) * DEG
    if scene in STAIR_SCENES:
        flight = draw_flight(recipe, rng)
        pose = draw_pose(scene, flight.staircase, np.array(true.mount_m), recipe, heading, rng)
        setting = _setting(flight, scene, pose, recipe, rng)
    else:
        flight = None
        yaw = rotation_z(drawn(ROOM_YAW_DEG, rng) * DEG)
        pose = Pose(R_WB=yaw @ rocked(recipe, rng), p_WB=np.array([0.0, drawn(recipe.lateral_m, rng), 0.0]))
        setting = _Setting(solids=room(scene, rng), shadows=cast_shadows(rng) if "shadow" in recipe.clutter else [])
    length, way = drawn(recipe.blur_px, rng), rng.uniform(0.0, math.pi)
    camera = Camera(
        setting.solids,
        true,
        told=told,
        kind=recipe.sensor,
        texture=str(rng.choice(recipe.textures)),
        light=drawn(recipe.light, rng),
        grain_px=recipe.grain_px,
        warp_px=recipe.warp_px,
        holes=recipe.holes,
        blur_px=(length * math.cos(way), length * math.sin(way)),
        shadows=setting.shadows,
        puddles=setting.puddles,
        rng=rng,
    )
    stage = _Stage(scene=scene, chair=chair, told=told, true=true, flight=flight, solids=setting.solids, camera=camera)
    return stage, pose


def calibration_of(recipe: Recipe, chair: ChairDescription) -> PinholeCamera:
    """Return the nominal camera of a recipe's sensor on a chair."""
    if recipe.sensor != "kinect2":
        camera = chair.camera_at(recipe.height_px or 240)
    else:
        rows = recipe.height_px or 424
        scale = rows / 424.0
        # The depth camera of a Kinect 2: 512×424, about 365 px.
        camera = replace(
            chair.camera_at(),
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
        told = replace(told, mount_pitch_rad=drawn(recipe.pitch_deg, rng) * DEG)
    scale = 1.0 + recipe.focal_error * float(rng.standard_normal())
    true = replace(
        told,
        fx_px=told.fx_px * scale,
        fy_px=told.fy_px * scale,
        mount_pitch_rad=told.mount_pitch_rad + drawn(recipe.mount_pitch_error_deg, rng) * DEG,
        mount_roll_rad=told.mount_roll_rad + drawn(recipe.mount_roll_error_deg, rng) * DEG,
    )
    return told, true


def _setting(flight: Flight, scene: str, pose: Pose, recipe: Recipe, rng: np.random.Generator) -> _Setting:
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


def _stair_solids(flight: Flight, clutter: list[Solid], recipe: Recipe, rng: np.random.Generator) -> list[Solid]:
    """Return floor, steps, walls and clutter, with a wall behind the landing and one before the floor's end."""
    staircase, last = flight.staircase, flight.staircase.steps[-1]
    end_x = last.x_m + max(staircase.landing_m, last.depth_m)
    floor = upright("floor", (-FLOOR_LENGTH_M, -VIEW_M, -0.2), (end_x + VIEW_M, VIEW_M, 0.0), texture="concrete")
    askew = drawn(recipe.back_wall_deg, rng) * DEG
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
