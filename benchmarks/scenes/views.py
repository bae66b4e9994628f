"""Random views of stairs and rooms with ground truth.

    recipe = ViewRecipe(scenes=("up",), heading_deg=(-35.0, 35.0), open_risers=True)
    view = draw_view(np.random.default_rng(1), recipe)
    sight = StairDetector().look(view.frame, view.gravity_C)
    error_rad = sight.heading_rad - view.stair.heading_rad

``view.stair`` is None without a stair (``ROOM_SCENES``). The frame's calibration and ``gravity_C`` are the inputs of the detector,
with the recipe's errors of mount, focal length and gravity; the ground truth has none. Heading: zero when square to the nosings,
facing up (``up``, ``top``, ``foot``) or down the flight (``down``, ``edge``, ``bottom``), positive anticlockwise seen from above.
The same generator state and recipe give byte-identical results.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from scenes.camera import SceneCamera, Sweep
from scenes.clutter import cast_shadows
from scenes.flight import DIRECTIONS, LEVEL, Pose, TiltedFlight, draw_flight, draw_pose, rocked
from scenes.ground_truth import StairTruth, stair_truth
from scenes.recipe import STAIR_SCENES, Range, ViewRecipe, drawn
from scenes.rooms import room
from scenes.setting import Setting, stair_setting
from treadline.core.angles import DEG
from treadline.core.camera_images import PinholeCamera, RgbdFrame
from treadline.core.errors import SettingsError
from treadline.core.rotations import Vector3, rotation_z
from treadline.plant.sensors.camera import ExactView
from treadline.plant.sensors.camera.depth_sensor import FILES
from treadline.plant.sensors.camera.solids import SceneBox
from treadline.scenario.chair import ChairDescription, read_chair

DOWN_W = np.array([0.0, 0.0, -1.0])
"""Unit vector of gravity in W."""
DOWN_W.setflags(write=False)
ROOM_YAW_DEG: Range = (-12.0, 12.0)
"""Range of the chair's yaw in a scene without a stair [deg]; the objects are rotated as well."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class View:
    """Frame with the inputs of a detector and the ground truth."""

    scene: str
    frame: RgbdFrame
    gravity_C: Vector3
    """Gravity direction from IMU and calibrated mount, with errors."""
    true_gravity_C: Vector3
    true_camera: PinholeCamera
    """Calibration without errors."""
    exact: ExactView
    kinds: tuple[str, ...]
    """Kind of each solid, indexed by ``exact.face // 6``: ``step``, ``wall``, ``rail``, ``leg`` and others."""
    stair: StairTruth | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Stage:
    """Constant part of a sequence of views."""

    scene: str
    chair: ChairDescription
    declared: PinholeCamera
    true: PinholeCamera
    flight: TiltedFlight | None
    solids: list[SceneBox]
    camera: SceneCamera
    filled: tuple[SceneCamera, list[SceneBox]] | None = None
    """Camera before the same scene with solid treads, and its solids, if the treads are gratings or glass: the ground truth counts
    treads and nosings that a depth sensor sees through."""
    motion: tuple[float, Vector3, Vector3] | None = None
    """Readout time of a rolling shutter [s], and velocity [m/s] and rate [rad/s] in B during the readout."""

    def view(self, t_s: float, pose: Pose) -> View:
        """Return the view from a pose, with gravity free of error."""
        R_WC = pose.R_WB @ self.true.R_BC
        p_WC = pose.p_WB + pose.R_WB @ np.array(self.true.mount_m)
        exact = self.camera.exact(R_WC, p_WC)
        stair = None
        if self.flight is not None:
            filled, solids = (exact, self.solids) if self.filled is None else (self.filled[0].exact(R_WC, p_WC), self.filled[1])
            stair = stair_truth(DIRECTIONS[self.scene], self.flight, pose, self.true, solids, filled, self.chair)
        return View(
            scene=self.scene,
            frame=self.camera.frame(t_s, R_WC, p_WC, self._sweep(pose)),
            gravity_C=self.declared.R_BC.T @ pose.R_WB.T @ DOWN_W,
            true_gravity_C=R_WC.T @ DOWN_W,
            true_camera=self.true,
            exact=exact,
            kinds=tuple(solid.kind for solid in self.solids),
            stair=stair,
        )

    def _sweep(self, pose: Pose) -> Sweep | None:
        """Return the motion of the camera in W during the readout."""
        if self.motion is None:
            return None
        readout_s, velocity_B, rate_B = self.motion
        lever_W = pose.R_WB @ np.array(self.true.mount_m)
        rate_W = pose.R_WB @ rate_B
        return Sweep(readout_s=readout_s, velocity_W=pose.R_WB @ velocity_B + np.cross(rate_W, lever_W), rate_W=rate_W)


def _motion(recipe: ViewRecipe, rng: np.random.Generator) -> tuple[float, Vector3, Vector3] | None:
    """Return readout time, velocity and rate of a rolling shutter; None for a global shutter."""
    if recipe.readout_s == 0.0:
        return None
    velocity_B = np.array([drawn(recipe.speed_m_s, rng), 0.0, 0.0])
    return recipe.readout_s, velocity_B, recipe.turn_rate_deg_s * DEG * rng.standard_normal(3)


def draw_view(rng: np.random.Generator, recipe: ViewRecipe) -> View:
    """Return a random view; all open parameters are drawn from ``rng``."""
    stage, pose = draw_stage(rng, recipe)
    view = stage.view(0.0, pose)
    measured_B = tilted(pose.R_WB.T @ DOWN_W, recipe.gravity_error_deg * DEG, rng)
    return replace(view, gravity_C=stage.declared.R_BC.T @ measured_B)


class RecordedDrive:
    """Sequence of views on one flight, with constant stair, light, camera and errors of mount, depth and gravity.

        drive = RecordedDrive(rng, ViewRecipe(scenes=("up",), warp_px=0.03))
        view = drive.view(t_s, drive.pose(along_m=0.2 * t_s, heading_rad=0.1))

    The caller simulates the IMU from the rotation of ``pose``.
    """

    def __init__(self, rng: np.random.Generator, recipe: ViewRecipe) -> None:
        self._stage, self._start = draw_stage(rng, recipe)
        if self._stage.flight is None or self._stage.scene == "edge":
            scenes = "up, top, down, bottom or foot"
            raise SettingsError(f"a sequence needs a chair on a flight or at its foot, not '{self._stage.scene}'; give {scenes}")
        # On the floor before a flight the chair moves and is oriented in W.
        self._R_WS = np.eye(3) if self._stage.scene in LEVEL else self._stage.flight.staircase.R_WS
        self._yaw_rad = 0.0 if DIRECTIONS[self._stage.scene] == "up" else math.pi
        level = np.array([0.0, 0.0, 1.0])
        turned = tilted(level, recipe.gravity_error_deg * DEG, rng)
        self._measured_gravity = np.eye(3) + np.outer(turned - level, level) - np.outer(level, turned - level)

    def pose(self, along_m: float, heading_rad: float) -> Pose:
        """Return the pose of the chair after a distance along the flight, or on the floor, at the initial lateral position."""
        forward = self._R_WS[:, 0] * (1.0 if self._yaw_rad == 0.0 else -1.0)
        R_WB = self._R_WS @ rotation_z(self._yaw_rad + heading_rad)
        return Pose(R_WB=R_WB, p_WB=self._start.p_WB + along_m * forward)

    def view(self, t_s: float, pose: Pose) -> View:
        """Return the view from a pose."""
        seen = self._stage.view(t_s, pose)
        measured_B = self._measured_gravity @ pose.R_WB.T @ DOWN_W
        return replace(seen, gravity_C=self._stage.declared.R_BC.T @ measured_B / np.linalg.norm(measured_B))


def draw_stage(rng: np.random.Generator, recipe: ViewRecipe) -> tuple[Stage, Pose]:
    """Return a random scene with its camera, and the pose of the chair."""
    chair = read_chair("wheelchair")
    scene = recipe.scenes[int(rng.integers(len(recipe.scenes)))]
    declared, true = _cameras(chair, recipe, rng)
    heading = drawn(recipe.heading_deg, rng) * DEG
    if scene in STAIR_SCENES:
        flight = draw_flight(recipe, rng)
        pose = draw_pose(scene, flight.staircase, np.array(true.mount_m), recipe, heading, rng)
        setting = stair_setting(flight, scene, pose, recipe, rng)
    else:
        flight = None
        yaw = rotation_z(drawn(ROOM_YAW_DEG, rng) * DEG)
        pose = Pose(R_WB=yaw @ rocked(recipe, rng), p_WB=np.array([0.0, drawn(recipe.lateral_m, rng), 0.0]))
        setting = Setting(solids=room(scene, rng), shadows=cast_shadows(rng) if "shadow" in recipe.clutter else [])
    length, angle = drawn(recipe.blur_px, rng), rng.uniform(0.0, math.pi)
    camera = SceneCamera(
        setting.solids,
        true,
        declared=declared,
        kind=recipe.sensor,
        texture=str(rng.choice(recipe.textures)),
        light=drawn(recipe.light, rng),
        sigma_px=recipe.sigma_px,
        edge_holes=recipe.edge_holes,
        grain_px=recipe.grain_px,
        warp_px=recipe.warp_px,
        holes=recipe.holes,
        missing=recipe.missing,
        hole_filling=recipe.hole_filling,
        flying=recipe.flying,
        blur_px=(length * math.cos(angle), length * math.sin(angle)),
        puddles=tuple(setting.puddles),
        rng=rng,
    ).facing((), setting.shadows)
    stage = Stage(
        scene=scene,
        chair=chair,
        declared=declared,
        true=true,
        flight=flight,
        solids=setting.solids,
        camera=camera,
        motion=_motion(recipe, rng),
        filled=(camera.showing(setting.filled), setting.filled) if setting.filled else None,
    )
    return stage, pose


def calibration_of(recipe: ViewRecipe, chair: ChairDescription) -> PinholeCamera:
    """Return the nominal camera of a recipe's sensor on a chair."""
    if recipe.sensor in ("kinect1", "ideal"):
        camera = chair.camera_at(recipe.height_px or 240)
    else:
        mounted = chair.changed(camera={"calibration": FILES[recipe.sensor], "file": None})
        camera = replace(mounted.camera_at(recipe.height_px), sensor="auto")
    return camera if recipe.focal_px is None else replace(camera, fx_px=recipe.focal_px, fy_px=recipe.focal_px)


def _cameras(chair: ChairDescription, recipe: ViewRecipe, rng: np.random.Generator) -> tuple[PinholeCamera, PinholeCamera]:
    """Return the calibrated and the true camera."""
    declared = calibration_of(recipe, chair)
    if recipe.pitch_deg is not None:
        declared = replace(declared, mount_pitch_rad=drawn(recipe.pitch_deg, rng) * DEG)
    if recipe.sensor_known and recipe.sensor != "ideal":
        declared = replace(declared, sensor=recipe.sensor)
    scale = 1.0 + recipe.focal_error * float(rng.standard_normal())
    true = replace(
        declared,
        fx_px=declared.fx_px * scale,
        fy_px=declared.fy_px * scale,
        mount_pitch_rad=declared.mount_pitch_rad + drawn(recipe.mount_pitch_error_deg, rng) * DEG,
        mount_roll_rad=declared.mount_roll_rad + drawn(recipe.mount_roll_error_deg, rng) * DEG,
    )
    return declared, true


def tilted(direction: Vector3, angle_rad: float, rng: np.random.Generator) -> Vector3:
    """Return a direction rotated by an angle towards a random side."""
    side = np.cross(direction, rng.standard_normal(3))
    return math.cos(angle_rad) * direction + math.sin(angle_rad) * side / np.linalg.norm(side)
