"""Frames whose stair is known, and the same frames seen otherwise: another image plane, another gravity, another size.

Each variation is one random draw that changes what a detector is given and what is true of it alike: a smaller image, a part of
it, a turned or mirrored camera, and a scene of another size. A wrong gravity changes only what is given, and so does a faulty
calibration.
"""

from dataclasses import dataclass, replace
from typing import Literal

import cv2
import numpy as np
from perception_cases import Case, sensor_cases
from real_frames import real_frames
from scenes import RecordedDrive, View, ViewRecipe, draw_view

from treadline.core.angles import DEG
from treadline.core.camera_images import PinholeCamera, RgbdFrame, black
from treadline.core.rotations import Vector3
from treadline.perception.calibration_gate import Cause

Kind = Literal["plain", "smaller", "cropped", "turned", "turned a little", "mirrored", "gravity wrong", "scaled"]
KINDS: tuple[Kind, ...] = ("plain", "smaller", "cropped", "turned", "turned a little", "mirrored", "gravity wrong", "scaled")
"""Kinds of variation; each draws an image phase of up to one pixel as well."""
SCENES = ("up", "up", "foot", "top", "down", "edge", "bottom")
"""Places of the chair in the drawn frames, of which those on a flight that ascends are drawn twice as often."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class KnownFrame:
    """Frame with the ground truth of its stair."""

    name: str
    frame: RgbdFrame
    gravity_C: Vector3 | None
    edge_C: Vector3
    """True direction of the nosings."""
    edge_sigma_rad: float = 0.0
    """Standard deviation of ``edge_C``, of recorded frames [rad]."""
    rise_m: float | None = None
    """True rise [m]; None if it was not measured."""
    run_m: float | None = None


WIDER = 848.0 / 640.0, 424.0 / 387.0
"""Ratios of image width and focal length of the two resolutions of a D435 with 480 rows: 848 and 640 columns."""
FAULTS: dict[str, Cause] = {
    **{f"turned by {angle}°": "turned" for angle in (90, 180, 270)},
    **{f"turned with gravity by {angle}°": "turned" for angle in (90, 180, 270)},
    "mirrored": "mirrored",
    **{f"focal length x{factor}": "focal length" for factor in (0.75, 0.92, 1.08, 1.2, 1.33)},
    "calibration of 848×480": "image size",
    "mount pitched by 3°": "mount",
    "mount rolled by 3°": "mount",
}
"""Faults of a calibration and their cause; images that are turned with gravity contradict the mount alone."""


def recorded_frames() -> list[KnownFrame]:
    """Return the recorded frames with a reference; none where their folder is missing."""
    return [
        KnownFrame(
            name=real.name,
            frame=real.frame,
            gravity_C=real.gravity_C,
            edge_C=real.edge_C,
            edge_sigma_rad=real.uncertainty_deg * DEG,
        )
        for real in real_frames()
    ]


def drawn_frame(seed: int) -> KnownFrame:
    """Return a lifelike frame of a random sensor and place."""
    case, recipe = _drawn_case(seed, len(SCENES))
    view = draw_view(np.random.default_rng(seed), recipe)
    return _known(f"{seed} {case.label}, {view.scene}", view)


def drawn_folder(seed: int, scene: str, frames: int) -> list[KnownFrame]:
    """Return frames of a chair that drives on and turns by 25°, of a random sensor: from 1.5 to 2.1 m before a flight, or on it."""
    case, recipe = _drawn_case(seed, len(SCENES))
    place_m = (1.5, 2.1) if scene == "foot" else (1.0, 1.5)
    drive = RecordedDrive(np.random.default_rng(seed), replace(recipe, scenes=(scene,), place_m=place_m, rock_deg=1.0))
    turns = np.linspace(-5.0, 20.0, frames) * DEG
    poses = [drive.pose(0.1 * number, float(turn)) for number, turn in enumerate(turns)]
    return [_known(f"{seed} {case.label}, {scene} {number}", drive.view(float(number), pose)) for number, pose in enumerate(poses)]


def _drawn_case(seed: int, stream: int) -> tuple[Case, ViewRecipe]:
    rng = np.random.default_rng([seed, stream])
    cases = [case for case in sensor_cases() if "place_m" not in case.recipe]
    case = cases[int(rng.integers(len(cases)))]
    recipe = {"scenes": (SCENES[int(rng.integers(len(SCENES)))],)} | case.recipe
    return case, replace(case, recipe=recipe, is_lifelike=True).recipe_of(seed)


def _known(name: str, view: View) -> KnownFrame:
    assert view.stair is not None  # noqa: S101 - for the type checker
    return KnownFrame(
        name=name,
        frame=_of_depth(view.frame.depth_m, view.frame.camera),
        gravity_C=view.gravity_C,
        edge_C=view.stair.edge_C,
        rise_m=view.stair.rise_m,
        run_m=view.stair.run_m,
    )


def seen_otherwise(known: KnownFrame, kind: Kind, rng: np.random.Generator) -> KnownFrame:
    """Return a frame as another camera, another IMU or another scene would have given it."""
    if kind == "gravity wrong":
        down = known.gravity_C if known.gravity_C is not None else np.array([0.0, 1.0, 0.0])
        side = np.cross(down, rng.standard_normal(3))
        angle = rng.uniform(0.0, 60.0) * DEG
        return replace(known, gravity_C=np.cos(angle) * down + np.sin(angle) * side / np.linalg.norm(side))
    if kind == "scaled":
        return _scaled(known, float(np.exp(rng.uniform(np.log(0.5), np.log(3.0)))))
    camera, phase = known.frame.camera, rng.uniform(0.0, 1.0, 2)
    size, M = np.array([camera.width_px, camera.height_px]), np.eye(2)
    factor, corner, part = 1.0, np.zeros(2), np.ones(2)
    match kind:
        case "smaller":
            factor = float(rng.uniform(0.4, 1.0))
        case "cropped":
            part = rng.uniform(0.5, 1.0, 2)
            corner = rng.uniform(0.0, 1.0, 2) * (1.0 - part) * size
        case "turned":
            M = _turn(rng.choice([90.0, 180.0, 270.0]))
        case "turned a little":
            M = _turn(rng.uniform(-12.0, 12.0))
        case "mirrored":
            M = np.diag([-1.0, 1.0])
    return _through(known, M, factor, corner + phase, part, is_smooth=bool(rng.random() < 0.5))


def with_fault(known: KnownFrame, fault: str) -> KnownFrame:
    """Return a frame as a wrong calibration describes it."""
    camera, size = known.frame.camera, fault.rsplit(maxsplit=1)[-1].strip("x°")
    match FAULTS[fault]:
        case "turned":
            turned = _through(known, _turn(-float(size)), 1.0, np.zeros(2), np.ones(2), is_smooth=False)
            return turned if "gravity" in fault else replace(turned, gravity_C=known.gravity_C)
        case "mirrored":
            return replace(known, frame=_of_depth(np.ascontiguousarray(known.frame.depth_m[:, ::-1]), camera))
        case "mount":
            name = "mount_pitch_rad" if "pitched" in fault else "mount_roll_rad"
            wrong = replace(camera, **{name: getattr(camera, name) + float(size) * DEG})
            down = None if known.gravity_C is None else wrong.R_BC.T @ camera.R_BC @ known.gravity_C
            return replace(known, frame=replace(known.frame, camera=wrong), gravity_C=down)
        case "image size":
            wrong = replace(camera, cx_px=WIDER[0] * (camera.cx_px + 0.5) - 0.5)
            factor = WIDER[1]
        case _:
            wrong, factor = camera, float(size)
    wrong = replace(wrong, fx_px=factor * camera.fx_px, fy_px=factor * camera.fy_px)
    return replace(known, frame=replace(known.frame, camera=wrong))


def _turn(angle_deg: float) -> np.ndarray:
    cos, sin = np.cos(angle_deg * DEG), np.sin(angle_deg * DEG)
    return np.array([[cos, -sin], [sin, cos]])


def _scaled(known: KnownFrame, factor: float) -> KnownFrame:
    """Return the frame of a scene of another size, all of it at the same angles."""
    smaller = _of_depth(factor * known.frame.depth_m, known.frame.camera)
    size = {name: None if (value := getattr(known, name)) is None else factor * value for name in ("rise_m", "run_m")}
    return replace(known, name=f"{known.name} x{factor:.2f}", frame=smaller, **size)


def _through(
    known: KnownFrame, M: np.ndarray, factor: float, corner_px: np.ndarray, part: np.ndarray, *, is_smooth: bool
) -> KnownFrame:
    """Return the frame of a camera at the same place with another image plane.

    Args:
        M: Orthogonal matrix from the new image's axes to the old ones.
        corner_px: Shift of the image, in old pixels from the corner of the part that is kept.
        part: Fractions of width and height that are kept.
        is_smooth: Whether depths are interpolated between pixels, not taken from the nearest one.
    """
    camera, depth_m = known.frame.camera, known.frame.depth_m
    kept = np.array([camera.width_px, camera.height_px]) * part
    width, height = np.maximum(np.rint(np.abs(M.T @ kept) * factor), 16).astype(int)
    middle_old = corner_px + 0.5 * kept - 0.5
    middle_new = 0.5 * np.array([width - 1, height - 1])
    v, u = np.indices((height, width))
    old = middle_old + (np.stack([u, v], axis=-1) - middle_new) / factor @ M.T
    map_u, map_v = (old[..., axis].astype(np.float32) for axis in (0, 1))
    if not is_smooth:
        map_u, map_v = np.rint(map_u), np.rint(map_v)
    nan = float("nan")
    seen = cv2.remap(depth_m, map_u, map_v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=nan)
    centre = middle_new + factor * M.T @ (np.array([camera.cx_px, camera.cy_px]) - middle_old)
    focal_x, focal_y = (
        factor * np.abs(M.T @ np.array([camera.fx_px, camera.fy_px])) if _is_square(M) else [factor * camera.fx_px] * 2
    )
    plane = replace(
        camera,
        width_px=int(width),
        height_px=int(height),
        fx_px=float(focal_x),
        fy_px=float(focal_y),
        cx_px=float(centre[0]),
        cy_px=float(centre[1]),
    )
    R = np.eye(3)
    R[:2, :2] = M.T
    return replace(
        known,
        frame=_of_depth(np.ascontiguousarray(seen), plane),
        gravity_C=None if known.gravity_C is None else R @ known.gravity_C,
        edge_C=R @ known.edge_C,
    )


def _is_square(M: np.ndarray) -> bool:
    """Return whether axes are exchanged or reversed, not turned by another angle."""
    return bool(np.abs(np.abs(M).max(axis=0) - 1.0).max() < 1e-9)


def _of_depth(depth_m: np.ndarray, camera: PinholeCamera) -> RgbdFrame:
    """Return a frame without colour, whose painter would hold the scene."""
    return RgbdFrame(t_s=0.0, rgb=black(camera.height_px, camera.width_px), depth_m=depth_m, camera=camera)
