"""Benchmark of rendered frames with known answers: fixed recipes, one folder per condition, one table of ground truth.

The frames are rendered on the user's machine. The same seed and count give byte-identical files with the same versions
of the libraries.
"""

import csv
import io
import zlib
from collections.abc import Callable
from pathlib import Path
from types import MappingProxyType
from typing import Any

from treadline.core.models import write_whole
from treadline.plant.sensors.camera.folder import TRUTH, write_views
from treadline.plant.sensors.camera.recipe import Scene, ViewRecipe

FRAMES_PER_CONDITION = 4
"""Default number of frames of each condition; 16 conditions give 64 frames."""
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
ROOMS: tuple[Scene, ...] = ("floor", "wall", "corridor", "shelf", "boxes", "ramp", "ladder", "stripes")
"""Plain rooms, ramps and furniture."""
REPEATED: tuple[Scene, ...] = ("blinds", "radiator", "cable_ladder", "corrugated", "relief", "chairs", "fence", "crates")
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
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(TRUTH)
    for condition, recipe in CONDITIONS.items():
        folder = out / condition
        own_seed = [seed, zlib.crc32(condition.encode())]
        write_views(recipe, folder, count=frames, seed=own_seed, watch=_prefixed(condition, watch))
        with (folder / "truth.csv").open(encoding="utf-8", newline="") as file:
            rows = csv.reader(file)
            next(rows)
            table.writerows([f"{condition}/{name}", *cells] for name, *cells in rows)
    write_whole(out / "truth.csv", text.getvalue())
    return frames * len(CONDITIONS)


def _prefixed(condition: str, watch: Callable[[str], None]) -> Callable[[str], None]:
    return lambda name: watch(f"{condition}/{name}")
