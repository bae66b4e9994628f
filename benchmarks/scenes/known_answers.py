"""Benchmark of rendered frames with known answers: fixed recipes, one folder per condition, one table of ground truth.

The frames are rendered on the user's machine. The same seed and count give byte-identical files with the same versions
of the libraries.
"""

import csv
import zlib
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from scenes.recipe import ViewRecipe
from scenes.views import View, draw_view
from treadline.core.angles import DEG
from treadline.core.files import write_whole
from treadline.plant.sensors.camera import TrueFrame, write_frames
from treadline.plant.sensors.camera.frame_folder import table_text

FRAMES_PER_CONDITION = 4
"""Default number of frames of each condition; 16 conditions give 64 frames."""
STAIR_COLUMNS = (
    "direction", "heading_deg", "slope_deg", "rise_m", "run_m", "edge_x", "edge_y", "edge_z", "share", "next_nosing_x_m",
    "next_nosing_z_m", "end_in_view", "left_wall_m", "right_wall_m", "obstacle_m", "left_edge_m", "right_edge_m", "left_side",
    "right_side", "bow_m",
)  # fmt: skip
"""Columns of truth.csv that are blank without a stair."""
AS_BUILT: dict[str, Any] = {
    "tread_tilt_deg": 0.3,
    "nosing_yaw_jitter_deg": 0.15,
    "rise_jitter_m": 0.003,
    "run_jitter_m": 0.003,
    "rock_deg": 0.5,
}
"""Irregularities of real stairs, and a rocking chair: the values of the evaluation in docs/evidence/perception.md."""
KINECT1: dict[str, Any] = {"sensor": "kinect1", "height_px": 480, "edge_holes": True, "grain_px": 1.2, "warp_px": 0.03}
"""Kinect 1 with holes at depth jumps, correlated noise and residual distortion, as in recorded frames."""
D435: dict[str, Any] = {"sensor": "d435"}
TOF: dict[str, Any] = {"sensor": "tof"}
ROOMS: tuple[str, ...] = ("floor", "wall", "corridor", "shelf", "boxes", "ramp", "ladder", "stripes")
"""Plain rooms, ramps and furniture."""
REPEATED: tuple[str, ...] = ("blinds", "radiator", "cable_ladder", "corrugated", "relief", "chairs", "fence", "crates")
"""Scenes with repeated parallel edges that are not steps."""


def _stair(sensor: dict[str, Any], scene: str, **more: Any) -> ViewRecipe:
    return ViewRecipe(**(AS_BUILT | sensor | {"scenes": (scene,)} | more))


CONDITIONS: MappingProxyType[str, ViewRecipe] = MappingProxyType(
    {
        "kinect1_up": _stair(KINECT1, "up"),
        "kinect1_foot": _stair(KINECT1, "foot"),
        "kinect1_top": _stair(KINECT1, "top"),
        "kinect1_down": _stair(KINECT1, "down"),
        "kinect1_open_risers": _stair(KINECT1, "up", open_risers=True),
        "kinect1_bowed": _stair(KINECT1, "up", bow_m=(0.05, 0.05)),
        "kinect1_narrow": _stair(KINECT1, "up", width_m=(0.45, 0.6), walls=("none",), lateral_m=(-0.05, 0.05)),
        "d435_up": _stair(D435, "up"),
        "d435_foot": _stair(D435, "foot"),
        "d435_down": _stair(D435, "down"),
        "tof_up": _stair(TOF, "up"),
        "tof_down": _stair(TOF, "down"),
        "kinect1_rooms": ViewRecipe(**KINECT1, scenes=ROOMS),
        "kinect1_repeated": ViewRecipe(**KINECT1, scenes=REPEATED),
        "d435_stairless": ViewRecipe(**D435, scenes=ROOMS + REPEATED),
        "tof_stairless": ViewRecipe(**TOF, scenes=ROOMS + REPEATED),
    }
)
"""Recipe of each condition, by the name of its folder. All views face within ±35° of square."""


def write_benchmark(
    out: Path, *, seed: int, frames: int = FRAMES_PER_CONDITION, watch: Callable[[str], None] = lambda _: None
) -> int:
    """Write a folder of frames per condition, and truth.csv of all frames; return the number of frames.

    Each folder has its own camera.toml, gravity.csv and truth.csv. In the common truth.csv the name of a frame is
    ``CONDITION/NAME``. Each condition has its own random numbers, so that a new condition leaves the others unchanged.
    """
    header: Sequence[str] = ()
    rows: list[list[str]] = []
    for condition, recipe in CONDITIONS.items():
        folder = out / condition
        write_frames(folder, recipe_frames(recipe, count=frames, seed=[seed, zlib.crc32(condition.encode())]), watch)
        with (folder / "truth.csv").open(encoding="utf-8", newline="") as file:
            header, *table = csv.reader(file)
        rows += [[f"{condition}/{name}", *cells] for name, *cells in table]
    write_whole(out / "truth.csv", table_text(header, rows))
    return frames * len(CONDITIONS)


def recipe_frames(recipe: ViewRecipe, *, count: int, seed: Sequence[int]) -> Iterator[TrueFrame]:
    """Yield views of a recipe; each has its own seed, so that a larger count leaves the first views unchanged."""
    for number in range(count):
        view = draw_view(np.random.default_rng([*seed, number]), recipe)
        yield TrueFrame(f"{number:05d}", view.frame, view.gravity_C, truth_of(view))


def truth_of(view: View) -> dict[str, object]:
    """Return the ground truth of a view by column; None without a stair.

    Edge and gravity are unit vectors in the camera frame. The next nosing is the intersection of the first visible nosing with the
    chair's middle plane, in the chair frame. The edges are the sides of the flight, each ``wall`` or ``open``.
    """
    stair = view.stair
    gravity = dict(zip(("gravity_x", "gravity_y", "gravity_z"), view.true_gravity_C.tolist(), strict=True))
    if stair is None:
        return {"scene": view.scene} | dict.fromkeys(STAIR_COLUMNS) | gravity
    seen = stair.nosings_B[stair.nosing_in_view]
    following = seen[0, ::2].tolist() if len(seen) else [None, None]
    direction = [stair.direction, stair.heading_rad / DEG, stair.slope_rad / DEG, stair.rise_m, stair.run_m, *stair.edge_C.tolist()]
    around = [stair.share, *following, int(stair.end_in_view), stair.left_wall_m, stair.right_wall_m, stair.obstacle_m]
    sides = [stair.left_edge_m, stair.right_edge_m, stair.left_side, stair.right_side, stair.bow_m]
    return {"scene": view.scene} | dict(zip(STAIR_COLUMNS, [*direction, *around, *sides], strict=True)) | gravity
