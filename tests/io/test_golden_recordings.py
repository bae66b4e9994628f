"""Golden recordings: what their sensor readings are, or how frames and sensor readings are refused in one line.

``recordings.toml`` holds their messages and the answers.
"""

import re
import tomllib
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from frame_files import add_cloud

from treadline.core import errors
from treadline.core.camera_images import PinholeCamera, RgbdFrame
from treadline.core.signals import ImuSample
from treadline.io.frames import read_frames
from treadline.io.frames._recorded_frames import FramesOfLog
from treadline.io.frames.point_cloud import FrameOptions
from treadline.io.sensor_log import SensorLog

READ, REFUSED = tomllib.loads(Path(__file__).with_name("recordings.toml").read_text(encoding="utf-8")).values()
READERS = {
    "frames": lambda path, **options: list(read_frames(path, **options)),
    "sensors": lambda path, **options: list(SensorLog(path, **options).arrivals(lambda _: None)),
}
DTYPES = {"16UC1": (np.uint16, ()), "mono16": (np.uint16, ()), "32FC1": (np.float32, ()), "rgb8": (np.uint8, (3,))}


def add(log: Any, role: str, topic: str, width: int = 0, height: int = 0, what: str = "1 0", *times: float) -> None:
    """Add a message of the table to a recording."""
    t_s, *logged = times or (0.0,)
    options = {"logged_s": logged[0]} if logged else {}
    match role:
        case "imu":
            w, rate = map(float, what.split())
            log.imu(topic, t_s, (w, 0.0, 0.0, 0.0), (0.0, rate, 0.0), (0.0, 0.0, 9.81), **options)
        case "info":
            lens = {"fx_px": float(what), "fy_px": float(what), "cx_px": 15.5, "cy_px": 11.5}
            log.calibration(topic, t_s, PinholeCamera(width_px=width, height_px=height, **lens), **options)
        case "image":
            encoding, value = what.split()
            kind, more = DTYPES[encoding]
            log.image(topic, t_s, np.full((height, width, *more), float(value), kind), encoding, **options)
        case "cloud":
            add_cloud(log, topic, t_s, np.ones((int(what), 3)), (width, height))


@pytest.fixture
def written(recording, tmp_path: Path) -> Callable[[dict[str, Any]], Path]:
    """Write the recording of a case."""

    def write(case: dict[str, Any]) -> Path:
        log, messages = recording(), case["messages"]
        for message in messages + messages[-1:] * (case.get("repeat", 1) - 1):
            add(log, *message)
        return log.write(tmp_path / "log.mcap")

    return write


@pytest.mark.parametrize("name", [name for name, case in READ.items() if "frames" in case])
def test_frames_of_a_recording_are_chosen_and_what_is_left_out_is_counted(written, name: str) -> None:
    expected = dict(READ[name]["frames"])
    source = FramesOfLog(written(READ[name]), FrameOptions(topic=expected.pop("named", None)))
    frames = list(source) if expected.keys() - {"topic"} else []
    colours = sum(named.has_colour for named in frames)
    found = {"count": len(frames), "colours": colours, "topic": source.topic, "warnings": source.warnings}
    assert {key: found[key] for key in expected} == expected


@pytest.mark.parametrize("name", [name for name, case in READ.items() if "gives" in case])
def test_sensor_readings_of_a_recording_are_chosen_checked_and_counted(written, name: str) -> None:
    case, events = READ[name], []
    log = SensorLog(written(case), **case.get("options", {}))
    signals = [signal for _, signal in log.arrivals(events.append)]
    found = {
        "topics": {role: topic for role, topic in asdict(log.topics).items() if topic is not None},
        "imu_s": [signal.t_s for signal in signals if isinstance(signal, ImuSample)],
        "frame_s": [signal.t_s for signal in signals if isinstance(signal, RgbdFrame)],
        "dropped": dict(log.dropped),
        "events": [" ".join([event.name, *re.findall(r"\([^)]*\)$", event.cause)]) for event in events],
        "ended": log.ended or "",
    }
    assert {key: found[key] for key in case["gives"]} == case["gives"]
    times = [signal.t_s for signal in signals]
    assert times == sorted(times)


@pytest.mark.parametrize(
    ("name", "reader"), [(name, reader) for name, case in REFUSED.items() for reader in case if reader in READERS]
)
def test_a_recording_that_does_not_fit_is_refused_in_one_line(written, name: str, reader: str) -> None:
    path, options = written(REFUSED[name]), dict(REFUSED[name][reader])
    with pytest.raises(getattr(errors, options.pop("error")), match=options.pop("says")) as caught:
        READERS[reader](path, **options)
    assert "\n" not in str(caught.value)
