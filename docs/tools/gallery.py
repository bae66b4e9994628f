"""Pages that play runs, for the gallery: ``python docs/tools/gallery.py docs/gallery``.

Each run is simulated here and now, so the gallery shows the code as it stands. They need no camera images: the statistical
camera draws detections, which takes seconds for a whole traversal.
"""

import sys
import tempfile
from pathlib import Path

import treadline as tl
from treadline.playback import read_recording
from treadline.report.player_page import write_player

KERB = {"stair.steps": 1, "stair.rise_m": 0.15, "stair.slope_deg": None, "start.heading_deg": 5}
RUNS: dict[str, tuple[str, dict[str, object]]] = {
    "up": ("up-28", {}),
    "down": ("down-28", {}),
    "turn": ("flight-20", {"start.heading_deg": 30, "drive.duration_s": 20}),
    "kerb": ("up-28", KERB),
    "landing": ("quarter-up", {}),
}
"""Name of the page, and the scenario with values in place of its own."""


def write_gallery(folder: Path) -> None:
    """Write one page for each run into a folder.

    Raises:
        SettingsError: If a scenario is refused.
    """
    folder.mkdir(exist_ok=True)
    for name, (scenario, values) in RUNS.items():
        with tempfile.TemporaryDirectory() as place:
            run = Path(place) / name
            tl.climb(scenario, set={"sensors.model": "statistical"} | values, out=run)
            write_player(read_recording(run), folder / f"{name}.html")


if __name__ == "__main__":
    write_gallery(Path(sys.argv[1]))
