"""Picture of a page that plays a run, as a browser shows it: ``python docs/tools/page_picture.py PAGE SECONDS PICTURE``.

``PAGE`` is a file that ``treadline view RUN --export`` or ``docs/tools/gallery.py`` wrote; it is shown at a time of the run.
"""

import argparse
import io
import subprocess
import tempfile
from pathlib import Path

from climb_picture import HEADLESS, TIMEOUT_S, browser_here
from PIL import Image, ImageOps

SIZE_PX = (1440, 900)
COLOURS = 128
"""Colours of the palette: the page is flat areas and lines, and a third of the bytes shows them."""


def write_page_picture(page: Path, at_s: float, path: Path) -> None:
    """Draw a page at a time [s] of its run in headless Chromium, and write it at two thirds of its size.

    Raises:
        SettingsError: If no Chromium is installed.
        subprocess.CalledProcessError: If it fails.
    """
    width, height = SIZE_PX
    with tempfile.TemporaryDirectory() as folder:
        shot = Path(folder) / "shot.png"
        look = (
            f"--window-size={width},{height}",
            "--virtual-time-budget=6000",
            f"--screenshot={shot}",
            f"--user-data-dir={folder}/p",
        )
        command = [browser_here(), *HEADLESS, *look, f"{page.resolve().as_uri()}#t={at_s}"]
        subprocess.run(command, capture_output=True, timeout=TIMEOUT_S, check=True)  # noqa: S603 - fixed program
        image = Image.open(io.BytesIO(shot.read_bytes())).convert("RGB")
    image = image.crop(ImageOps.invert(image).getbbox())  # the browser leaves blank what lies above a page that it scrolled
    smaller = image.resize((2 * image.width // 3, 2 * image.height // 3), Image.Resampling.LANCZOS)
    smaller.quantize(COLOURS).save(path, optimize=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Write a picture of a page that plays a run; needs Chromium.")
    parser.add_argument("page", type=Path)
    parser.add_argument("at_s", type=float, help="time of the run to show [s]")
    parser.add_argument("picture", type=Path)
    order = parser.parse_args()
    write_page_picture(order.page, order.at_s, order.picture)
