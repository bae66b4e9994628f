"""Golden recordings: what cannot be replayed or seen is refused in one line by the frames of a log and by its sensor readings.

``recordings.toml`` holds their messages and the refusals.
"""

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from frame_files import add_cloud

from treadline.core import errors
from treadline.core.camera_images import PinholeCamera
from treadline.io.frames import read_frames
from treadline.io.sensor_log import SensorLog

TABLE = tomllib.loads(Path(__file__).with_name("recordings.toml").read_text(encoding="utf-8"))
READERS = {
    "frames": lambda path, **options: list(read_frames(path, **options)),
    "sensors": lambda path, **options: list(SensorLog(path, **options).arrivals(lambda _: None)),
}
DTYPES = {"16UC1": (np.uint16, ()), "32FC1": (np.float32, ()), "rgb8": (np.uint8, (3,))}


def add(log: Any, role: str, topic: str, width: int = 0, height: int = 0, what: str = "", t_s: float = 0.0) -> None:
    """Add a message of the table to a recording."""
    match role:
        case "imu":
            log.imu(topic, t_s, (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 9.81))
        case "info":
            lens = {"fx_px": float(what), "fy_px": float(what), "cx_px": 15.5, "cy_px": 11.5}
            log.calibration(topic, t_s, PinholeCamera(width_px=width, height_px=height, **lens))
        case "image":
            encoding, value = what.split()
            kind, more = DTYPES[encoding]
            log.image(topic, t_s, np.full((height, width, *more), float(value), kind), encoding)
        case "cloud":
            add_cloud(log, topic, t_s, np.ones((int(what), 3)), (width, height))


@pytest.mark.parametrize(
    ("name", "reader"), [(name, reader) for name, case in TABLE.items() for reader in READERS if reader in case]
)
def test_a_recording_that_does_not_fit_is_refused_in_one_line(recording, tmp_path: Path, name: str, reader: str) -> None:
    log, options = recording(), dict(TABLE[name][reader])
    for message in TABLE[name]["messages"]:
        add(log, *message)
    path = log.write(tmp_path / "log.mcap")
    with pytest.raises(getattr(errors, options.pop("error")), match=options.pop("says")) as caught:
        READERS[reader](path, **options)
    assert "\n" not in str(caught.value)
