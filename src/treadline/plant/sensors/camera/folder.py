"""Folder of rendered views with a table of ground truth, in the format read by ``treadline see FOLDER``."""

import csv
import io
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from treadline.core.angles import DEG
from treadline.core.errors import ImageError, SettingsError
from treadline.core.images import PinholeCamera
from treadline.core.models import write_whole
from treadline.plant.sensors.camera.recipe import ViewRecipe
from treadline.plant.sensors.camera.views import View, draw_view

DEPTH_UNIT_M = 0.001
"""Depth unit of the PNG files [m]."""
NO_RETURN = 0
"""Depth value without a return."""
TRUTH = (
    "name",
    "scene",
    "direction",
    "heading_deg",
    "slope_deg",
    "rise_m",
    "run_m",
    "edge_x",
    "edge_y",
    "edge_z",
    "gravity_x",
    "gravity_y",
    "gravity_z",
    "share",
    "next_nosing_x_m",
    "next_nosing_z_m",
    "end_in_view",
    "left_wall_m",
    "right_wall_m",
    "obstacle_m",
    "left_edge_m",
    "right_edge_m",
    "left_side",
    "right_side",
    "bow_m",
    "curvature_1_m",
)
"""Columns of truth.csv. Edge and gravity are unit vectors in the camera frame. The next nosing is the intersection of the first
visible nosing with the chair's middle plane, in the chair frame. The edges are the sides of the flight, each ``wall`` or ``open``.
Unavailable values are blank."""


class NamedView(NamedTuple):
    """View and the base name of its files."""

    name: str
    view: View


def write_views(recipe: ViewRecipe, folder: Path, *, count: int, seed: int | Sequence[int], watch: Callable[[str], None]) -> None:
    """Render views and write them one by one, then the tables; ``watch`` is called with each name.

    Files are written atomically. Each view has its own seed, so that a larger count leaves the first views unchanged.

    Raises:
        SettingsError: If the folder contains other frames, or if the camera pitch is a range: a folder has one calibration.
    """
    if recipe.pitch_deg is not None and recipe.pitch_deg[0] < recipe.pitch_deg[1]:
        low, high = recipe.pitch_deg
        raise SettingsError(f"pitch_deg runs from {low:g} to {high:g}; a folder has one camera.toml: give one value twice")
    seeds = [seed] if isinstance(seed, int) else list(seed)
    names = [f"{number:05d}" for number in range(count)]
    others = {path.name for path in folder.glob("*_depth.png")} - {f"{name}_depth.png" for name in names}
    if others:
        raise SettingsError(f"{folder}: holds frames of another run ({min(others)}); give an empty folder")
    folder.mkdir(parents=True, exist_ok=True)
    written: list[NamedView] = []
    try:
        for number, name in enumerate(names):
            named = NamedView(name=name, view=draw_view(np.random.default_rng([*seeds, number]), recipe))
            if not written:
                write_whole(folder / "camera.toml", _camera_toml(named.view.frame.camera))
            _write_images(named, folder)
            written.append(named)
            watch(name)
    finally:
        # After an interruption the tables list the finished views.
        if written:
            write_whole(folder / "gravity.csv", _gravity_table(written))
            write_whole(folder / "truth.csv", _truth_table(written))


def _write_images(named: NamedView, folder: Path) -> None:
    frame = named.view.frame
    counts = np.nan_to_num(frame.depth_m.astype(float), nan=0.0) / DEPTH_UNIT_M
    depth = np.where(counts < 65534.5, np.round(counts), NO_RETURN).astype(np.uint16)
    for ending, image in (("rgb", cv2.cvtColor(frame.rgb, cv2.COLOR_RGB2BGR)), ("depth", depth)):
        done, data = cv2.imencode(".png", image)
        if not done:
            raise ImageError(f"{named.name}_{ending}.png could not be written as PNG")
        write_whole(folder / f"{named.name}_{ending}.png", data.tobytes())


def _camera_toml(camera: PinholeCamera) -> str:
    """Return the calibration used by the detector."""
    values = {
        "width": camera.width_px,
        "height": camera.height_px,
        "fx_px": camera.fx_px,
        "fy_px": camera.fy_px,
        "cx_px": camera.cx_px,
        "cy_px": camera.cy_px,
        "depth_unit_m": DEPTH_UNIT_M,
        "mount_pitch_deg": round(camera.mount_pitch_rad / DEG, 9),
        "mount_roll_deg": round(camera.mount_roll_rad / DEG, 9),
        "mount_yaw_deg": round(camera.mount_yaw_rad / DEG, 9),
        "mount_m": list(camera.mount_m),
    }
    sensor = "" if camera.sensor == "auto" else f'sensor = "{camera.sensor}"\n'
    return "".join(f"{key} = {value}\n" for key, value in values.items()) + sensor


def _gravity_table(written: list[NamedView]) -> str:
    return _table(("name", "x", "y", "z"), [[name, *_rounded(view.gravity_C.tolist())] for name, view in written])


def _truth_table(written: list[NamedView]) -> str:
    return _table(TRUTH, [_truth_row(named) for named in written])


def _truth_row(named: NamedView) -> list[object]:
    name, view = named
    gravity = _rounded(view.true_gravity_C.tolist())
    stair = view.stair
    if stair is None:
        return [name, view.scene, *[""] * 8, *gravity, *[""] * (len(TRUTH) - 13)]
    seen = stair.nosings_B[stair.nosing_in_view]
    following = seen[0, ::2].tolist() if len(seen) else [None, None]
    metres = [*following, stair.left_wall_m, stair.right_wall_m, stair.obstacle_m]
    next_x, next_z, left, right, obstacle = ["" if value is None else round(value, 5) + 0.0 for value in metres]
    return [
        name,
        view.scene,
        stair.direction,
        *_rounded([stair.heading_rad / DEG, stair.slope_rad / DEG, stair.rise_m, stair.run_m]),
        *_rounded(stair.edge_C.tolist()),
        *gravity,
        round(stair.share, 4),
        next_x,
        next_z,
        int(stair.end_in_view),
        left,
        right,
        obstacle,
        *_rounded([stair.left_edge_m, stair.right_edge_m]),
        stair.left_side,
        stair.right_side,
        *_rounded([stair.bow_m, stair.curvature_1_m]),
    ]


def _rounded(values: list[float]) -> list[float]:
    return [round(value, 7) + 0.0 for value in values]


def _table(header: tuple[str, ...], rows: list[list[object]]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(header)
    writer.writerows(rows)
    return text.getvalue()
