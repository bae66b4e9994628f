"""The stair in one frame, whatever it is given as: a frame with a name, a frame, or a depth image with its calibration."""

from collections.abc import Mapping
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
from treadline.perception.detector import StairDetector
from treadline.perception.free_ground import GroundProfile, ground_ahead
from treadline.perception.overlay import overlay
from treadline.perception.steps import SeenStep
from treadline.scenario.camera_file import CameraFile, calibration_in

Calibration = PinholeCamera | CameraFile | str | Path | Mapping[str, object]
"""Calibration, its file (TOML), or the name of a shipped camera."""


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


def detect_stair(
    depth_m: NamedFrame | RgbdFrame | ArrayLike, camera: Calibration | None = None, gravity: ArrayLike | None = None
) -> StairDetection:
    """Return the heading and the geometry of the stair in one frame; refused where the frame shows a fault of its calibration.

    Args:
        depth_m: Frame of ``tl.read_frames``, or a depth image: distance along the optical axis [m], one row per image row; 0, NaN
            and infinity mean no return.
        camera: Calibration, its file (TOML), its tables as a dict, or the name of a shipped camera. A frame has its own.
        gravity: Vector that points down in the camera's frame (x right, y down, z forward); if left out, the frame's own or, where
            it has none, estimated from the treads.

    Returns:
        ``.accepted``, ``.reason`` (None if accepted), ``.heading_rad``, ``.sigma_rad``, ``.shape``, ``.stair_map``, ``.steps``,
        ``.turn``, and ``.plot()``, the picture of what was detected. A refusal is false: ``if tl.detect_stair(frame): …``.

    Raises:
        ImageError: If the image is not of the calibration's size, or not in metres.
        SettingsError: If the calibration is missing or none, or its file cannot be read.
        RecordError: If gravity is not three numbers.

    Examples:
        >>> import cv2, numpy as np
        >>> import treadline as tl
        >>> cv2.imwrite("wall.png", np.full((424, 512), 1500, dtype=np.uint16))  # a Kinect 2 before a wall
        True
        >>> for frame in tl.read_frames("wall.png"):
        ...     print(frame.name, tl.detect_stair(frame).accepted)
        wall.png False
    """
    frame, down = _one(depth_m, camera, gravity)
    sight = StairDetector().look(frame, down)
    sight = gated(sight, calibration_evidence(sight, frame.camera, down))
    return replace(sight, draw=partial(overlay, frame, sight))


def detect_ground(
    depth_m: NamedFrame | RgbdFrame | ArrayLike, camera: Calibration | None = None, gravity: ArrayLike | None = None
) -> GroundDetection:
    """Return the ground ahead of a level chair in one frame: kerbs, drops with their depth, and obstacles.

    Args:
        depth_m, camera, gravity: As for ``detect_stair``. The mount of the calibration gives the height of the ground.

    Returns:
        ``.profile``, with ``.free`` (``seen_m``, ``end_m``, ``drop_m``) and ``.obstacle_m``, and ``.steps``.

    Raises:
        ImageError, SettingsError, RecordError: As ``detect_stair``.

    Examples:
        >>> import numpy as np
        >>> import treadline as tl
        >>> tl.detect_ground(np.full((424, 512), 1.5), "kinect2").profile.free.end_m is None  # a wall: no drop is in view
        True
    """
    frame, down = _one(depth_m, camera, gravity)
    if down is None:
        down = np.asarray(frame.camera.R_BC.T @ np.array([0.0, 0.0, -1.0]))
    return ground_with(StairDetector().look(frame, down), frame, down)


def ground_with(sight: StairDetection, frame: RgbdFrame, gravity_C: Vector3) -> GroundDetection:
    """Return the ground ahead in a frame whose steps have been detected."""
    profile = ground_ahead(frame, gravity_C / max(float(np.linalg.norm(gravity_C)), 1e-9))
    return GroundDetection(profile=profile, steps=sight.steps)


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
