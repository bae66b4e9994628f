"""Recorded depth frames with a reference of the edge direction, and variants: pixel phases, crops and mirrored images.

A detector that works on a recorded frame by chance fails on the same frame shifted by a few pixels. Each variant has its own
calibration and reference. The frames are not part of the project.
"""

import json
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from treadline.core.camera_images import PinholeCamera, RgbdFrame
from treadline.core.rotations import Vector3
from treadline.io.frames import read_frame
from treadline.io.frames.sources import COLOUR_ENDINGS, DEPTH_ENDING
from treadline.scenario.camera_file import CameraFile, read_camera

RECORDED = Path(__file__).parents[2] / "shared" / "data" / "vision"
PHASES = [(du, dv) for dv in range(4) for du in range(6)]
"""Columns and rows cut off at the left and the top: 24 phases of pixels and of the cells of a segmentation."""
CROPS = [(0.1, 0.0, 0.0, 0.0), (0.0, 0.1, 0.0, 0.0), (0.0, 0.0, 0.1, 0.0), (0.0, 0.0, 0.0, 0.1), (0.1, 0.1, 0.1, 0.1)]
"""Fractions of the image cut off at the left, the right, the top and the bottom."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RealFrame:
    """Recorded frame with its reference."""

    name: str
    depth_m: np.ndarray
    camera: PinholeCamera
    edge_C: Vector3
    """Unit vector along the edges."""
    gravity_C: Vector3 | None
    uncertainty_deg: float
    """Standard deviation of the reference."""

    @property
    def frame(self) -> RgbdFrame:
        """Frame for a detector, without colours."""
        rgb = np.zeros((*self.depth_m.shape, 3), dtype=np.uint8)
        return RgbdFrame(t_s=0.0, rgb=rgb, depth_m=np.ascontiguousarray(self.depth_m, dtype=np.float32), camera=self.camera)

    def error_deg(self, edge_C: Vector3) -> float:
        """Return the angle of an edge from the reference: about gravity where it is known, else in space."""
        if self.gravity_C is None:
            return float(np.degrees(np.arctan2(np.linalg.norm(np.cross(edge_C, self.edge_C)), abs(edge_C @ self.edge_C))))
        a, b = (edge - (edge @ self.gravity_C) * self.gravity_C for edge in (edge_C, self.edge_C))
        return float(np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b)), abs(a @ b))))


def real_frames() -> Iterator[RealFrame]:
    """Yield all frames that have a reference; none where there is no folder."""
    for reference in sorted(RECORDED.glob("*/reference.json")):
        for name, true in references(json.loads(reference.read_text())):
            depth = reference.with_name(name + DEPTH_ENDING)
            rgb = next((path for ending in COLOUR_ENDINGS if (path := reference.with_name(name + ending)).exists()), None)
            if rgb is None or not depth.exists():
                continue
            files = [path for path in reference.parent.glob("*_camera.toml") if name.startswith(path.stem.removesuffix("_camera"))]
            frame = read_frame(rgb, depth, read_camera(files[0]) if files else calibration_of(depth, true))
            yield RealFrame(
                name=f"{reference.parent.name} {name}",
                depth_m=frame.depth_m,
                camera=frame.camera,
                edge_C=np.array(true["edge_direction_camera"] if "edge_direction_camera" in true else true["edge_direction"]),
                gravity_C=None if true.get("gravity") is None else np.array(true["gravity"]),
                uncertainty_deg=float(true.get("uncertainty_deg", true.get("pair_spread_deg", 0.0))),
            )


def references(table: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield the name and the reference of each frame of a table, which may be grouped by sensor."""
    for name, entry in table.items():
        if isinstance(entry, dict):
            if any(name.startswith("edge_direction") for name in entry):
                yield name, entry
            else:
                yield from references(entry)


def calibration_of(depth: Path, true: dict[str, float]) -> CameraFile:
    """Return the calibration stored with a reference, for images as large as the depth image."""
    header = depth.read_bytes()[:24]  # PNG: width and height are the first of its first chunk
    return CameraFile(
        width=int.from_bytes(header[16:20]),
        height=int.from_bytes(header[20:24]),
        fx_px=true["fx"],
        fy_px=true["fy"],
        cx_px=true["cx"],
        cy_px=true["cy"],
        depth_unit_m=true["depth_unit_m"],
    )


def phases_of(real: RealFrame, step: int) -> Iterator[RealFrame]:
    """Yield a frame in all pixel phases, each with every ``step``-th pixel of a row and a column."""
    for left, top in PHASES:
        yield sampled(cropped(real, left, top), step)


def cropped(real: RealFrame, left: int, top: int, right: int = 0, bottom: int = 0) -> RealFrame:
    """Return a frame without some columns and rows at its borders."""
    height, width = real.depth_m.shape
    depth_m, camera = real.depth_m[top : height - bottom, left : width - right], real.camera
    return _with(real, depth_m, replace(camera, cx_px=camera.cx_px - left, cy_px=camera.cy_px - top))


def crops_of(real: RealFrame) -> Iterator[RealFrame]:
    """Yield a frame cut at each border and at all of them."""
    height, width = real.depth_m.shape
    for left, right, top, bottom in CROPS:
        yield cropped(real, round(left * width), round(top * height), round(right * width), round(bottom * height))


def sampled(real: RealFrame, step: int) -> RealFrame:
    """Return a frame with every ``step``-th pixel of a row and a column."""
    optics = {name: getattr(real.camera, name) / step for name in ("fx_px", "fy_px", "cx_px", "cy_px")}
    return _with(real, real.depth_m[::step, ::step], replace(real.camera, **optics))


def mirrored(real: RealFrame) -> RealFrame:
    """Return the mirror image of a frame, left and right exchanged."""
    flip = np.array([-1.0, 1.0, 1.0])
    camera = replace(real.camera, cx_px=real.camera.width_px - 1.0 - real.camera.cx_px)
    gravity_C = None if real.gravity_C is None else flip * real.gravity_C
    return replace(_with(real, real.depth_m[:, ::-1], camera), edge_C=flip * real.edge_C, gravity_C=gravity_C)


def _with(real: RealFrame, depth_m: np.ndarray, camera: PinholeCamera) -> RealFrame:
    sized = replace(camera, height_px=depth_m.shape[0], width_px=depth_m.shape[1])
    return replace(real, depth_m=depth_m, camera=sized)
