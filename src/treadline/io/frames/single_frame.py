"""The stair in one frame, whatever it is given as: a frame with a name, a frame, or a depth image with its calibration."""

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from treadline.core.arrays import real, shaped
from treadline.core.camera_images import FrameSource, NamedFrame, PinholeCamera, RgbdFrame, black
from treadline.core.errors import ImageError, SettingsError
from treadline.core.printing import Printable
from treadline.core.rotations import Vector3
from treadline.perception.calibration_gate import calibration_evidence, gated
from treadline.perception.detection import StairDetection
from treadline.perception.detector import DetectorConfig, StairDetector
from treadline.perception.free_ground import SWEPT_HALF_M, GroundProfile, ground_ahead
from treadline.perception.overlay import overlay
from treadline.perception.steps import SeenStep
from treadline.scenario.camera_file import CameraFile, calibration_in

Calibration = PinholeCamera | CameraFile | str | Path


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class GroundDetection(Printable):
    """What a level chair meets on the ground ahead, in one frame."""

    profile: GroundProfile
    steps: tuple[SeenStep, ...]
    """Kerbs, drops and other steps in view, the lowest first."""

    def printed(self) -> tuple[str, list[tuple[str, str]]]:
        """Return how far the ground goes, and what follows."""
        free, obstacle_m = self.profile.free, self.profile.obstacle_m
        rows = [("step", str(step)) for step in self.steps]
        if free.end_m is not None:
            below = "nothing in view below" if free.drop_m is None else f"{free.drop_m:.2f} m deep"
            rows.append(("drop", f"at {free.end_m:.2f} ± {1.96 * (free.end_sigma_m or 0.0):.2f} m, {below}"))
        if obstacle_m is not None:
            rows.append(("obstacle", f"at {obstacle_m:.2f} m"))
        return f"ground seen from {free.blind_m:.2f} to {free.seen_m:.2f} m ahead of mid-track", rows


def look_once(
    given: NamedFrame | RgbdFrame | ArrayLike, camera: Calibration | None = None, gravity_C: ArrayLike | None = None
) -> StairDetection:
    """Return the heading and the geometry of the stair in one frame; refused where the frame shows a fault of its calibration.

    Args:
        given: Frame, or depth image [m].
        camera: Calibration, its file (TOML), or the name of a shipped camera, in place of the frame's; a depth image needs one.
        gravity_C: Vector that points down, in place of the frame's.

    Raises:
        ImageError: If there is no image, or none in metres.
        SettingsError: If a depth image comes without a calibration, or the calibration is none.
        RecordError: If gravity is not three numbers.
    """
    frame, down = _one(given, camera, gravity_C)
    sight = StairDetector().look(frame, down)
    sight = gated(sight, calibration_evidence(sight, frame.camera, down))
    return replace(sight, draw=partial(overlay, frame, sight))


def ground_once(
    given: NamedFrame | RgbdFrame | ArrayLike, camera: Calibration | None = None, gravity_C: ArrayLike | None = None
) -> GroundDetection:
    """Return the ground ahead of the shipped wheelchair in one frame: kerbs, drops and obstacles.

    Args:
        given, camera, gravity_C: As for ``look_once``; without gravity the chair is taken to be level.

    Raises:
        ImageError, SettingsError, RecordError: As ``look_once``.
    """
    frame, down = _one(given, camera, gravity_C)
    if down is None:
        down = np.asarray(frame.camera.R_BC.T @ np.array([0.0, 0.0, -1.0]))
    profile = ground_ahead(frame, down / max(float(np.linalg.norm(down)), 1e-9))
    return GroundDetection(profile=profile, steps=StairDetector(DetectorConfig(swept_half_m=SWEPT_HALF_M)).look(frame, down).steps)


def _one(
    given: NamedFrame | RgbdFrame | ArrayLike, camera: Calibration | None, gravity_C: ArrayLike | None
) -> tuple[RgbdFrame, Vector3 | None]:
    """Return frame and gravity of what is given."""
    used = camera if isinstance(camera, PinholeCamera | None) else calibration_in(camera).camera
    if isinstance(given, NamedFrame):
        if given.frame is None:
            raise ImageError(f"{given.name}: {given.reason}")
        return _one(given.frame, used, given.gravity_C if gravity_C is None else gravity_C)
    if not isinstance(given, RgbdFrame):
        frame = _depth_frame(given, used)
    else:
        frame = given if used is None else replace(given, camera=used)
    return frame, None if gravity_C is None else shaped("gravity", gravity_C, (3,), "three numbers x, y, z")


def _depth_frame(depth_m: ArrayLike, camera: PinholeCamera | None) -> RgbdFrame:
    """Return the frame of a depth image without colour."""
    if isinstance(depth_m, str | Path | FrameSource):
        path = repr(str(depth_m)) if isinstance(depth_m, str | Path) else "path"
        raise ImageError(f"give one frame at a time: for frame in tl.read_frames({path}): tl.detect_stair(frame)")
    depth = real("depth_m", depth_m, "a frame of tl.read_frames, or a depth image in metres")
    if depth.ndim != 2:
        raise ImageError(f"depth_m has {depth.ndim} dimensions; give one row per image row and one column per image column")
    if np.asarray(depth_m).dtype.kind in "iu":
        raise ImageError("depth_m holds whole numbers, counts instead of metres; multiply them by the unit of a count, often 0.001")
    if camera is None:
        raise SettingsError(
            "a depth image needs its calibration: tl.detect_stair(depth_m, camera), a PinholeCamera or a camera.toml"
        )
    # The robust method reads depth alone; the frame type asks for a colour image of the same size.
    known = np.where(np.isfinite(depth) & (depth > 0.0), depth, np.nan).astype(np.float32)
    return RgbdFrame(t_s=0.0, rgb=black(*depth.shape), depth_m=known, camera=camera)
