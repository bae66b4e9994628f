"""Moving picture of one recorded traversal: ``run folder -> animated WebP``.

``python docs/tools/climb_picture.py RUN docs/media/climb.webp`` renders the player page's scene in headless Chromium with a
camera that follows the chair, one image per frame.
"""

import argparse
import base64
import io
import re
import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from PIL import Image

from treadline.core.errors import SettingsError, TreadlineError
from treadline.playback import Recording, read_recording
from treadline.report.film import write_film
from treadline.report.player_page import TEMPLATES, json_in_page, scene_of
from treadline.vehicle.film_camera import AZIMUTH_RAD, BACKGROUND, DISTANCE_M, ELEVATION_RAD, FRAME_S, SIZE_PX, TARGET_M

SMOOTH_S = 3.0
"""Time over which the camera's target is averaged [s of the run], so that the view does not rock with the chair."""
BROWSERS = ("chromium", "chromium-browser", "google-chrome")
HEADLESS = (
    "--headless=new",
    "--no-sandbox",
    "--enable-unsafe-swiftshader",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--no-first-run",
)
"""Flags of a browser on a machine without display and graphics card, which requests nothing by itself. WebGL is drawn in software;
``--use-angle`` would have the page itself drawn by WebGL as well, and leave a fifth of the frames."""
FLAGS = (*HEADLESS, "--force-device-scale-factor=1", "--dump-dom")
TIMEOUT_S = 600.0
"""Longest time for rendering [s]: two seconds per frame on a busy machine without a graphics card."""


def write_climb_picture(run: Path, path: Path) -> Path:
    """Write the moving picture of a run folder.

    Raises:
        SettingsError: If the run's log holds no poses, or no Chromium is installed.
        LogFormatError: If the run kept no log.
    """
    recording = read_recording(run)
    if not recording.has_poses:
        raise SettingsError(f"{run}: {' '.join(recording.missing)}")
    times_s = np.arange(0.0, recording.duration_s, FRAME_S)
    return write_film(zip(times_s.tolist(), render(recording, times_s), strict=True), recording, path)


def render(recording: Recording, times_s: Float[np.ndarray, " n"]) -> list[Image.Image]:
    """Return the scene of a recording at each time, drawn by headless Chromium.

    Raises:
        SettingsError: If no Chromium is installed, or it draws nothing.
    """
    browser = browser_here()
    with tempfile.TemporaryDirectory() as folder:
        page = Path(folder) / "film.html"
        page.write_text(_page(recording, times_s), encoding="utf-8")
        command = [browser, *FLAGS, f"--user-data-dir={folder}/profile", page.as_uri()]
        done = subprocess.run(command, capture_output=True, text=True, timeout=TIMEOUT_S, check=False)  # noqa: S603 - fixed program
    drawn = re.findall(r"data:image/jpeg;base64,([A-Za-z0-9+/=]+)", done.stdout)
    if len(drawn) != len(times_s):
        raise SettingsError(f"{browser} drew {len(drawn)} of {len(times_s)} frames; does it have WebGL 2 (SwiftShader)?")
    return [Image.open(io.BytesIO(base64.b64decode(data))).convert("RGB") for data in drawn]


def browser_here() -> str:
    """Return the path of a Chromium.

    Raises:
        SettingsError: If none is installed.
    """
    browser = next((found for name in BROWSERS if (found := shutil.which(name))), None)
    if browser is None:
        raise SettingsError(f"no {' or '.join(BROWSERS)} on this machine; the pictures are drawn by it: apt-get install chromium")
    return browser


def _page(recording: Recording, times_s: Float[np.ndarray, " n"]) -> str:
    files = (TEMPLATES / "packed.js", TEMPLATES / "scene.js", Path(__file__).parent / "film.js")
    scripts = "\n".join(file.read_text(encoding="utf-8") for file in files)
    data = {"scene": scene_of(recording), "background": BACKGROUND, "shots": [_shot(recording, float(t_s)) for t_s in times_s]}
    width, height = SIZE_PX
    return (
        f'<!doctype html><meta charset="utf-8"><body style="margin:0"><canvas id="scene" style="width:{width}px;height:{height}px">'
        f'</canvas><script type="application/json" id="data">{json_in_page(data)}</script><script>{scripts}</script>'
    )


def _shot(recording: Recording, t_s: float) -> dict[str, Any]:
    """Return the chair's state and the camera's view at a time: the camera turns slowly while the chair climbs."""
    k = recording.index_at(t_s)
    near = np.abs(recording.t_s - t_s) <= 0.5 * SMOOTH_S
    share = t_s / recording.duration_s
    return {
        "state": {
            "p": recording.p_WB[k].tolist(),
            "q": recording.quat_WB[k].tolist(),
            "seat": float(recording.seat_rad[k]),
            "flipper": float(recording.flipper_rad[k]),
            "travel": recording.belt_travel_m[k].tolist(),
        },
        "view": {
            "azimuth": AZIMUTH_RAD + 0.75 * share,
            "elevation": ELEVATION_RAD,
            "distance": DISTANCE_M,
            "target": (recording.p_WB[near].mean(axis=0) + np.array(TARGET_M)).tolist(),
        },
    }


def main() -> None:
    """Write the picture named on the command line."""
    parser = argparse.ArgumentParser(description="Write an animated WebP of a recorded run; needs Chromium.")
    parser.add_argument("run", type=Path, help="run folder with a log, written by treadline climb")
    parser.add_argument("picture", type=Path, help="file to write, such as climb.webp")
    order = parser.parse_args()
    try:
        write_climb_picture(order.run, order.picture)
    except TreadlineError as error:
        parser.error(str(error))


if __name__ == "__main__":
    main()
