"""Evaluation of one frame or a folder of frames for ``treadline see``: frames in, JSON values out."""

import csv
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from jaxtyping import Float

from treadline.angles import DEG
from treadline.camera_file import read_camera
from treadline.errors import ImageError
from treadline.perception.detection import StairDetection, StairShape, refused
from treadline.perception.detector import DetectorConfig, StairDetector
from treadline.perception.edges import ThresholdRule
from treadline.perception.heading import heading_about
from treadline.perception.images import read_frame
from treadline.perception.overlay import overlay
from treadline.perception.paper import PaperConfig
from treadline.perception.pictures import write_picture, write_stages
from treadline.signals import RgbdFrame, StairMap

COLOUR_ENDINGS = ("_rgb.png", "_color_registered.png")
"""File name endings of colour images."""
DEPTH_ENDING = "_depth.png"
"""File name ending of depth images."""
NO_MOUNT = (
    "the calibration names no mount, so the camera is taken to look level and straight ahead: heading_deg is about the camera's "
    "own axis; the chair's heading is heading_on_flight_deg where it stands on the flight, heading_on_level_deg on floor or "
    "landing, if the camera is not turned sideways; learn the mount with treadline mount, or give mount_pitch_deg (0 if it does "
    "look level)"
)
"""Message for a missing mount calibration. Gravity cannot replace the mount: on a flight, z of the chair is not vertical."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NamedFrame:
    """Frame, its name and the direction of gravity if known."""

    name: str
    frame: RgbdFrame | None
    """Frame; None if the images cannot be read."""
    mount_known: bool
    """Whether the calibration includes the orientation of the mount."""
    gravity_C: Float[np.ndarray, " 3"] | None
    reason: str | None = None
    """Reason for an unreadable frame."""


def single_frame(rgb: Path, depth: Path, camera: Path, gravity: str | None) -> NamedFrame:
    """Return the frame of one pair of images."""
    calibration = read_camera(camera)
    return NamedFrame(
        name=rgb.name,
        frame=read_frame(rgb, depth, calibration),
        gravity_C=_given(gravity),
        mount_known=calibration.mount_known,
    )


class FolderOfFrames:
    """Image pairs of a folder in the order of their names, read lazily; unreadable pairs are reported.

    Raises:
        ImageError: If the folder has no pair, no readable one, or an invalid gravity.csv.
    """

    def __init__(self, folder: Path, camera: Path | None = None, gravity: str | None = None) -> None:
        """List the frames of a folder.

        Args:
            camera: Calibration, if not the folder's own camera.toml.
            gravity: Gravity direction, as x,y,z, for frames missing in gravity.csv.
        """
        self._calibration = read_camera(camera or folder / "camera.toml")
        self._down = _given(gravity)
        self._gravity = _gravity_table(folder / "gravity.csv")
        self._pairs = _pairs(folder)
        if not self._pairs:
            raise ImageError(f"{folder}: no pair of NAME{COLOUR_ENDINGS[0]} and NAME{DEPTH_ENDING}")

    def __len__(self) -> int:
        return len(self._pairs)

    def __iter__(self) -> Iterator[NamedFrame]:
        unread: list[ImageError] = []
        for name, rgb, depth in self._pairs:
            frame, reason = None, None
            try:
                frame = read_frame(rgb, depth, self._calibration)
            except ImageError as error:
                unread.append(error)
                reason = str(error)
            yield NamedFrame(
                name=name,
                frame=frame,
                gravity_C=self._gravity.get(name, self._down),
                mount_known=self._calibration.mount_known,
                reason=reason,
            )
        if len(unread) == len(self):
            raise unread[0]


def see_frames(
    frames: Iterable[NamedFrame],
    *,
    method: Literal["paper", "robust"],
    out: Path | None,
    threshold: ThresholdRule = "median",
) -> Iterator[dict[str, Any]]:
    """Yield the result of each frame, with the keys of the JSON output.

    Args:
        threshold: Rule for Canny's thresholds in Algorithm 1.
        out: Folder for the images of each frame: the six stages of Fig. 5 (``NAME-1.png … -6.png``) and the detections of the
            robust method (``NAME-seen.png``).
    """
    paper = PaperConfig(threshold=threshold)
    detector = StairDetector(DetectorConfig(method=method, paper=paper))
    loaded = False
    for named in frames:
        if named.frame is None:
            yield _answer(named, refused(named.reason or "no image"), 0.0)
            continue
        if not loaded:
            # A first run loads the compiled kernels, so that the reported time is the processing time of a frame.
            loaded = detector.look(named.frame, named.gravity_C).accepted
        started = time.perf_counter()
        sight = detector.look(named.frame, named.gravity_C)
        spent_ms = (time.perf_counter() - started) * 1e3
        if out is not None:
            printed = StairDetector(DetectorConfig(method="paper", paper=paper))
            shown = printed.look(named.frame, named.gravity_C, stages=True)
            if shown.stages is not None:
                write_stages(shown.stages, out, prefix=Path(named.name).stem)
            if method == "robust":
                write_picture(overlay(named.frame, sight), out / f"{Path(named.name).stem}-seen.png")
        yield _answer(named, sight, spent_ms)


def _answer(named: NamedFrame, sight: StairDetection, spent_ms: float) -> dict[str, Any]:
    shape = sight.shape
    return {
        "name": named.name,
        "accepted": sight.accepted,
        "reason": sight.reason,
        "heading_deg": None if sight.heading_rad is None else sight.heading_rad / DEG,
        "sigma_deg": None if sight.sigma_rad is None else sight.sigma_rad / DEG,
        "edge_direction": None if sight.edge_direction_C is None else sight.edge_direction_C.tolist(),
        "edges": sight.edge_count,
        "box_px": sight.box_px,
        "planes_against_lines_deg": None if sight.planes_against_lines_rad is None else sight.planes_against_lines_rad / DEG,
        "stair": None if shape is None else _stair(shape, sight.stair_map),
        "ms": spent_ms,
        "mount_known": named.mount_known,
        "warning": None if named.mount_known else NO_MOUNT,
        **({} if named.mount_known else _without_mount(sight)),
    }


def _without_mount(sight: StairDetection) -> dict[str, float | None]:
    """Return the heading at camera yaw 0, for a chair on the flight and for one on horizontal ground."""
    if sight.axes is None:
        return {"heading_on_flight_deg": None, "heading_on_level_deg": None}
    on_flight = heading_about(sight.axes.normal_C, sight.axes.edge_C)
    on_level = heading_about(-sight.axes.down_C, sight.axes.edge_C)
    return {
        "heading_on_flight_deg": None if on_flight is None else on_flight / DEG,
        "heading_on_level_deg": None if on_level is None else on_level / DEG,
    }


def _stair(shape: StairShape, seen: StairMap | None) -> dict[str, Any]:
    """Return the dimensions of the stair and, in the chair frame, the map."""
    measures: dict[str, Any] = {
        "direction": shape.direction,
        "rise_m": shape.rise_m,
        "run_m": shape.run_m,
        "slope_deg": shape.slope_rad / DEG,
        "distance_m": shape.distance_m,
    }
    if seen is not None:
        measures |= {
            "nosings_m": seen.nosings_B.tolist(),
            "ends": seen.ends,
            "left_wall_m": seen.left_wall_m,
            "right_wall_m": seen.right_wall_m,
            "obstacle_m": seen.obstacle_m,
        }
    return measures


def _pairs(folder: Path) -> list[tuple[str, Path, Path]]:
    found = []
    for depth in sorted(folder.glob("*" + DEPTH_ENDING)):
        name = depth.name.removesuffix(DEPTH_ENDING)
        for ending in COLOUR_ENDINGS:
            if (folder / (name + ending)).exists():
                found.append((name, folder / (name + ending), depth))
                break
        else:
            raise ImageError(f"{depth}: no colour image {name}{COLOUR_ENDINGS[0]} next to it")
    return found


def _gravity_table(path: Path) -> dict[str, Float[np.ndarray, " 3"]]:
    if not path.exists():
        return {}
    try:
        lines = path.read_bytes().decode("utf-8-sig").splitlines()
    except UnicodeDecodeError as error:
        raise ImageError(f"{path}: not UTF-8 (byte {error.start}); save it as UTF-8 text") from None
    reader = csv.DictReader(lines)
    table: dict[str, Float[np.ndarray, " 3"]] = {}
    for row in reader:
        where = f"{path}:{reader.line_num}"
        name, *cells = (row.get(column) for column in ("name", "x", "y", "z"))
        if name is None or None in cells:
            raise ImageError(f"{where}: needs the columns name,x,y,z")
        if name in table:
            raise ImageError(f"{where}: '{name}' occurs twice; remove one")
        table[name] = _direction(where, [str(cell) for cell in cells])
    return table


def _given(gravity: str | None) -> Float[np.ndarray, " 3"] | None:
    return None if gravity is None else _direction("--gravity", gravity.split(","))


def _direction(where: str, parts: list[str]) -> Float[np.ndarray, " 3"]:
    try:
        vector = np.array([float(part) for part in parts])
    except ValueError:
        raise ImageError(f"{where}: gravity must be three numbers x,y,z") from None
    length = float(np.linalg.norm(vector))
    if vector.shape != (3,) or not np.isfinite(vector).all() or length < 1e-6:
        raise ImageError(f"{where}: gravity must be three finite numbers x,y,z that are not all zero")
    return vector / length
