"""Moving side view of one recorded traversal: ``run folder -> GIF``.

``python -m treadline.report.climb_picture RUN docs/media/climb.gif`` draws the chair of a ``treadline climb`` from the ground
truth, seat and flipper in its log. The stair is the designed one; the chair is drawn in side view, without its heading.
"""

import io
import math
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from PIL import Image

from treadline.angles import DEG
from treadline.errors import SettingsError
from treadline.io.mcap_read import read_log
from treadline.io.runs import LOG
from treadline.mechanics.chair import ChairDescription, read_chair
from treadline.ports import Truth
from treadline.report.chair_sketch import draw_chair
from treadline.report.pen import INK, STONE, Point, sheet
from treadline.report.results import Manifest, RunResult, read_part
from treadline.signals import FlipperReading

WIDTH_IN, HEIGHT_IN, DPI = 6.4, 3.6, 100
SPEED_UP = 4.0
"""Playback speed over simulated time."""
FRAMES_PER_S = 8.0
COLOURS = 32
"""Size of the palette: the drawing has fewer than ten colours, the rest smooths edges."""
BEFORE_M, BEYOND_M = 2.3, 2.2
"""Floor before the first nosing and landing beyond the last one that the view includes."""


def write_climb_picture(run: Path, path: Path) -> Path:
    """Write the moving picture of a run folder.

    Raises:
        SettingsError: If the run kept no log, or its log has no ground truth.
    """
    manifest, result = read_part(run / "manifest.json", Manifest), read_part(run / "result.json", RunResult)
    if not (run / LOG).is_file():
        raise SettingsError(f"{run}: no {LOG}; make the run again with treadline climb, which keeps a log")
    samples = list(read_log(run / LOG))
    truth = [sample for sample in samples if isinstance(sample, Truth)]
    flipper = [sample for sample in samples if isinstance(sample, FlipperReading)]
    if not truth:
        raise SettingsError(f"{run / LOG}: no ground truth; only runs of the simulator can be drawn")
    if math.isnan(truth[0].chassis_x_m):
        raise SettingsError(f"{run / LOG}: written before logs kept the chair's pose; make the run again with treadline climb")
    chair = read_chair(manifest.settings["chair"]["model"])
    stair = manifest.settings["stair"]
    rise_m = stair["rise_m"] or stair["run_m"] * math.tan(stair["slope_deg"] * DEG)
    angles_rad = np.interp([s.t_s for s in truth], [s.t_s for s in flipper], [s.angle_rad for s in flipper]) if flipper else None
    rest_rad = chair.tracks.approach_angle_deg * DEG
    every = round(100.0 * SPEED_UP / FRAMES_PER_S)
    frames = []
    for k in range(0, len(truth), every):
        angle_rad = rest_rad if angles_rad is None else float(angles_rad[k])
        phase = [name for t_s, name in result.course if t_s <= truth[k].t_s]
        caption = f"{truth[k].t_s:4.0f} s   {phase[-1] if phase else ''}"
        frames.append(_frame(chair, truth[k], angle_rad, (rise_m, stair["run_m"], stair["steps"]), caption))
    path.parent.mkdir(parents=True, exist_ok=True)
    palette = frames[len(frames) // 2].quantize(COLOURS)
    flat = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    durations = [round(1000.0 / FRAMES_PER_S)] * (len(flat) - 1) + [2000]
    flat[0].save(path, save_all=True, append_images=flat[1:], duration=durations, loop=0, optimize=True)
    return path


def seat_angle_rad(chair: ChairDescription, truth: Truth) -> float:
    """Return the forward lean of the seat relative to the chassis [rad]; zero without a seat linkage."""
    return 0.0 if chair.seat is None else truth.pitch_rad - truth.seat_pitch_rad


def _frame(chair: ChairDescription, truth: Truth, flipper_rad: float, stair: tuple[float, float, int], caption: str) -> Image.Image:
    rise_m, run_m, steps = stair
    figure, (pen,) = sheet(WIDTH_IN, HEIGHT_IN)
    length_m = (steps - 1) * run_m
    height_m = (length_m + BEFORE_M + BEYOND_M) * HEIGHT_IN / WIDTH_IN
    pen.frame((-BEFORE_M, length_m + BEYOND_M), (-0.5, height_m - 0.5))
    corners: list[Point] = [(-BEFORE_M, 0.0)]
    for k in range(steps):
        corners += [(k * run_m, k * rise_m), (k * run_m, (k + 1) * rise_m)]
    corners += [(length_m + BEYOND_M, steps * rise_m), (length_m + BEYOND_M, -0.5), (-BEFORE_M, -0.5)]
    pen.area(corners, STONE, INK, 1.0)
    moved = chair.model_copy(update={"tracks": chair.tracks.model_copy(update={"approach_angle_deg": flipper_rad / DEG})})
    draw_chair(replace(pen, origin=(truth.chassis_x_m, truth.chassis_z_m)), moved, seat_angle_rad(chair, truth), truth.pitch_rad)
    pen.text((-BEFORE_M + 0.15, height_m - 0.8), caption, size=11.0, align="left")
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=DPI)
    return Image.open(buffer).convert("RGB")


if __name__ == "__main__":
    write_climb_picture(Path(sys.argv[1]), Path(sys.argv[2]))
