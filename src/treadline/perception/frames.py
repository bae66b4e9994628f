"""What ``treadline see`` does: one frame or a folder of frames in, JSON values out."""

import csv
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from jaxtyping import Float

from treadline.angles import DEG
from treadline.errors import ImageError
from treadline.perception.camera_file import read_camera
from treadline.perception.detector import DetectorConfig, StairDetector
from treadline.perception.images import read_frame
from treadline.perception.pictures import write_stages
from treadline.perception.sight import Sight
from treadline.signals import RgbdFrame

COLOUR_ENDINGS = ("_rgb.png", "_color_registered.png")
DEPTH_ENDING = "_depth.png"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NamedFrame:
    """A frame, its name and the direction of gravity if known."""

    name: str
    frame: RgbdFrame
    gravity_C: Float[np.ndarray, " 3"] | None


def single_frame(rgb: Path, depth: Path, camera: Path, gravity: str | None) -> NamedFrame:
    """Return the frame of one pair of images."""
    direction = None if gravity is None else _direction("--gravity", gravity.split(","))
    return NamedFrame(name=rgb.name, frame=read_frame(rgb, depth, read_camera(camera)), gravity_C=direction)


def frames_of_folder(folder: Path) -> Iterator[NamedFrame]:
    """Yield the frames of a folder in the order of their names.

    Raises:
        ImageError: If it holds no pair, or a pair is broken.
    """
    calibration = read_camera(folder / "camera.toml")
    gravity = _gravity_table(folder / "gravity.csv")
    pairs = _pairs(folder)
    if not pairs:
        raise ImageError(f"{folder}: no pair of NAME_rgb.png and NAME_depth.png")
    for name, rgb, depth in pairs:
        yield NamedFrame(name=name, frame=read_frame(rgb, depth, calibration), gravity_C=gravity.get(name))


def see_frame(named: NamedFrame, *, method: Literal["paper", "robust"], out: Path | None) -> dict[str, Any]:
    """Return what a frame shows, under the contract's keys; with ``out``, write the six stages of Fig. 5."""
    detector = StairDetector(DetectorConfig(method=method))
    detector.look(named.frame, named.gravity_C)  # loads what is compiled, so that the time told is that of a frame
    started = time.perf_counter()
    sight = detector.look(named.frame, named.gravity_C)
    spent_ms = (time.perf_counter() - started) * 1e3
    if out is not None:
        shown = StairDetector(DetectorConfig(method="paper")).look(named.frame, named.gravity_C, stages=True)
        if shown.stages is not None:
            write_stages(shown.stages, out, prefix=Path(named.name).stem)
    return _answer(named.name, sight, spent_ms)


def _answer(name: str, sight: Sight, spent_ms: float) -> dict[str, Any]:
    shape = sight.shape
    return {
        "name": name,
        "accepted": sight.accepted,
        "reason": sight.reason,
        "heading_deg": None if sight.heading_rad is None else sight.heading_rad / DEG,
        "sigma_deg": None if sight.sigma_rad is None else sight.sigma_rad / DEG,
        "edge_direction": None if sight.edge_direction_C is None else sight.edge_direction_C.tolist(),
        "edges": sight.edge_count,
        "box_px": sight.box_px,
        "stair": None
        if shape is None
        else {
            "rise_m": shape.rise_m,
            "run_m": shape.run_m,
            "slope_deg": shape.slope_rad / DEG,
            "distance_m": shape.distance_m,
        },
        "ms": spent_ms,
    }


def _pairs(folder: Path) -> list[tuple[str, Path, Path]]:
    found = []
    for depth in sorted(folder.glob("*" + DEPTH_ENDING)):
        name = depth.name.removesuffix(DEPTH_ENDING)
        for ending in COLOUR_ENDINGS:
            if (folder / (name + ending)).exists():
                found.append((name, folder / (name + ending), depth))
                break
        else:
            raise ImageError(f"{depth}: no colour image {name}{COLOUR_ENDINGS[0]} beside it")
    return found


def _gravity_table(path: Path) -> dict[str, Float[np.ndarray, " 3"]]:
    if not path.exists():
        return {}
    with path.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    table = {}
    for number, row in enumerate(rows, start=2):
        cells = [row.get(axis) for axis in ("x", "y", "z")]
        if row.get("name") is None or None in cells:
            raise ImageError(f"{path}:{number}: needs the columns name,x,y,z")
        table[str(row["name"])] = _direction(f"{path}:{number}", [str(cell) for cell in cells])
    return table


def _direction(where: str, parts: list[str]) -> Float[np.ndarray, " 3"]:
    try:
        vector = np.array([float(part) for part in parts])
    except ValueError:
        raise ImageError(f"{where}: gravity must be three numbers x,y,z") from None
    length = float(np.linalg.norm(vector))
    if vector.shape != (3,) or not np.isfinite(vector).all() or length < 1e-6:
        raise ImageError(f"{where}: gravity must be three finite numbers x,y,z that are not all zero")
    return vector / length
