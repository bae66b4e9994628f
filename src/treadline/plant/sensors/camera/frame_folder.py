"""Rendered frames of a scenario's stair with ground truth, in a folder that ``treadline see FOLDER`` reads."""

import csv
import io
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from treadline.core.angles import DEG
from treadline.core.camera_images import RgbdFrame
from treadline.core.errors import ImageError
from treadline.core.files import write_whole
from treadline.core.rotations import Vector3, rotation_z
from treadline.io.images import MILLIMETRE
from treadline.plant.sensors.camera.ray_camera import Camera
from treadline.scenario.camera_file import CameraFile
from treadline.scenario.scenario import Scenario
from treadline.vehicle.stair_solids import stair_boxes
from treadline.vehicle.staircase import build_staircase

PLACE_M, LATERAL_M = (0.3, 3.0), (-0.25, 0.25)
"""Ranges of mid-track: distance beyond the first nosing that it has passed, and to the left of the middle of the flight [m]."""


class TrueFrame(NamedTuple):
    """Frame with the gravity that a detector receives, and its row of ground truth."""

    name: str
    frame: RgbdFrame
    gravity_C: Vector3
    truth: Mapping[str, object]
    """Columns of ``truth.csv`` after the name."""


def stair_frames(
    scenario: Scenario, *, sensor: str | None = None, count: int, seed: int, heading_rad: tuple[float, float]
) -> Iterator[TrueFrame]:
    """Yield frames of the camera that looks ahead, from random poses on the flight; each frame has its own random numbers.

    Args:
        sensor: Camera, a name of ``depth_sensor.SENSORS``, or ``ideal`` for no errors. None: that of the scenario, rendered.
        heading_rad: Smallest and largest heading.
    """
    if sensor is not None:
        scenario = scenario.changed(sensors={"model": sensor} if sensor == "ideal" else {"camera": sensor, "model": "rendered"})
    chair, descends = scenario.read_chair(), scenario.drive.direction == "down"
    calibration, device = chair.camera_at(scenario.sensors.rows_px, rear=descends), chair.mount_of(rear=descends).device
    kind = "ideal" if scenario.sensors.camera_model == "ideal" else device.kind
    look = partial(Camera, kind=kind, device=device, texture=scenario.stair.texture, light=scenario.stair.light)
    for number in range(count):
        rng = np.random.default_rng([seed, number])
        staircase = build_staircase(scenario.stair, rng, scenario.step, scenario.sill)
        place, lateral, heading = (float(rng.uniform(*limits)) for limits in (PLACE_M, LATERAL_M, heading_rad))
        length = staircase.pitch_m * (len(staircase.steps) - 1)
        R_WB = staircase.R_WS @ rotation_z(heading)
        p_WB = staircase.p_WS + staircase.R_WS @ np.array([length - place if descends else place, lateral, 0.0])
        R_WC, p_WC = R_WB @ calibration.R_BC, p_WB + R_WB @ np.array(calibration.mount_m)
        camera = look(staircase, calibration, rng=rng)
        gravity_C = R_WC.T @ np.array([0.0, 0.0, -1.0])
        shown = camera.exact(R_WC, p_WC).face // 6
        is_step = np.array([*(box.kind == "step" for box in stair_boxes(staircase)), False])
        truth = {
            "heading_deg": heading / DEG,
            "slope_deg": staircase.slope_rad / DEG,
            "rise_m": staircase.pitch_m * math.sin(staircase.slope_rad),
            "run_m": staircase.pitch_m * math.cos(staircase.slope_rad),
            **dict(zip(("edge_x", "edge_y", "edge_z"), (R_WC.T @ np.array([0.0, -1.0, 0.0])).tolist(), strict=True)),
            **dict(zip(("gravity_x", "gravity_y", "gravity_z"), gravity_C.tolist(), strict=True)),
            "share": float(is_step[np.where(shown >= 0, shown, -1)].mean()),
        }
        yield TrueFrame(f"{number:05d}", camera.frame(0.0, R_WC, p_WC), gravity_C, truth)


def write_frames(folder: Path, frames: Iterable[TrueFrame], watch: Callable[[str], None]) -> None:
    """Write images one by one and ``camera.toml`` with the first, then ``gravity.csv`` and ``truth.csv``.

    Files are written atomically; after an interruption the tables list the finished frames. ``watch`` is called with each name.
    """
    gravity: list[Sequence[object]] = []
    truth: list[Sequence[object]] = []
    columns: tuple[str, ...] = ()
    try:
        for name, frame, gravity_C, row in frames:
            if not gravity:
                columns = ("name", *row)
                write_whole(folder / "camera.toml", CameraFile.of(frame.camera, str(folder), MILLIMETRE).text)
            _write_images(folder, name, frame)
            gravity.append([name, *gravity_C.tolist()])
            truth.append([name, *row.values()])
            watch(name)
    finally:
        if gravity:
            write_whole(folder / "gravity.csv", table_text(("name", "x", "y", "z"), gravity))
            write_whole(folder / "truth.csv", table_text(columns, truth))


def table_text(header: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return a CSV table with numbers to seven decimals; None is blank."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(header)
    writer.writerows([round(cell, 7) + 0.0 if isinstance(cell, float) else cell for cell in row] for row in rows)
    return text.getvalue()


def _write_images(folder: Path, name: str, frame: RgbdFrame) -> None:
    counts = np.nan_to_num(frame.depth_m.astype(float), nan=0.0) / MILLIMETRE
    depth = np.where(counts < 65534.5, np.round(counts), 0.0).astype(np.uint16)
    for ending, image in (("rgb", cv2.cvtColor(frame.rgb, cv2.COLOR_RGB2BGR)), ("depth", depth)):
        done, data = cv2.imencode(".png", image)
        if not done:
            raise ImageError(f"{name}_{ending}.png could not be written as PNG")
        write_whole(folder / f"{name}_{ending}.png", data.tobytes())
