"""Recordings from files: run folders, MCAP logs of treadline, and ROS bags with its topics."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from treadline.core.camera_images import RgbdFrame
from treadline.core.errors import LogFormatError, SettingsError
from treadline.core.files import json_of, read_json
from treadline.core.models import DEFAULT_VEHICLE
from treadline.core.ports import Truth
from treadline.core.signals import FlipperReading, HeadingEstimate, ImuSample, SeatReading, StairMap, TrackCommand, TrackReading
from treadline.io.columns import read_contents
from treadline.io.mcap_read import BROKEN, has_arrivals, read_log, run_metadata
from treadline.io.message_files import READERS, parts_of
from treadline.io.messages import OWN
from treadline.io.runs import LOG, MANIFEST
from treadline.io.standard_messages import EVENTS, signal_reader
from treadline.io.topics import kind_of, packets, received
from treadline.playback._builder import COLUMNS, RecordingBuilder, Signals
from treadline.playback._recording import Limits, Recording
from treadline.scenario.chair import read_chair
from treadline.scenario.scenario import Scenario, chair_of_run, scenario_of

MAPS, COLOUR, TRUTH, IMU = OWN[StairMap].read, "/camera/color/image_raw", OWN[Truth].read, "/imu"
QUALITY = "/camera/quality"
"""Topic with one message per camera frame that the mission received."""
NUMERIC: dict[str, type] = {
    **{OWN[kind].read: kind for kind in (Truth, HeadingEstimate, TrackCommand, TrackReading, SeatReading, FlipperReading)},
    IMU: ImuSample,
}
"""Topics of numbers, with the signal that each holds."""
OF_IMU = ("orientation.w", "orientation.x", "orientation.y", "orientation.z", "angular_velocity.y")
"""Numbers of an IMU that a recording needs."""


def read_recording(target: str | Path) -> Recording:
    """Return the recording of a run folder, of a treadline log, or of a ROS bag.

    Without ground truth the poses are those of dead reckoning; ``Recording.missing`` says so.

    Raises:
        LogFormatError: If there is no log, or the log is damaged, empty, or holds nothing to play.
        SettingsError: If the run folder's manifest is of another version.
    """
    path = Path(target)
    if not path.exists():
        raise LogFormatError(f"{path}: no such file or folder; give a run folder, an MCAP log or a ROS bag")
    folder = run_folder_of(path)
    log = path if folder is None else folder / LOG
    if folder is not None and not log.is_file():
        raise LogFormatError(f"{folder}: no {LOG}; make the run again with treadline climb, which keeps a log")
    if folder is None and path.is_dir() and not any(part.suffix in READERS for part in parts_of(path)):
        raise LogFormatError(f"{path}: no {MANIFEST} and no bag; give a run folder, an MCAP log or a ROS bag")
    manifest = manifest_of(path)
    builder = (
        RecordingBuilder(read_chair(DEFAULT_VEHICLE), source=str(path))
        if manifest is None
        else _begun(manifest, path if folder is None else folder / MANIFEST, folder or path)
    )
    if folder is not None or has_arrivals(path):
        _take_log(log, builder)
    else:
        for signal, taken_s in _bag_signals(path):
            builder(signal, taken_s)
    result = read_json(folder / "result.json") if folder is not None and (folder / "result.json").is_file() else {}
    verdict, cause = (value if isinstance(value, str) else None for value in (result.get("verdict"), result.get("cause")))
    recording = builder.build(verdict=verdict, cause=cause)
    if not len(recording.t_s):
        raise LogFormatError(
            f"{recording.source}: no signals to play: a log needs ground truth, belts, IMU or a heading estimate; "
            "treadline climb and treadline record write such logs"
        )
    return recording


def run_folder_of(target: Path) -> Path | None:
    """Return the run folder of a folder or of the log in it; None for a log on its own and for a bag."""
    folder = target if target.is_dir() else target.parent
    return folder if (folder / MANIFEST).is_file() and (target.is_dir() or target.name == LOG) else None


def manifest_of(target: Path) -> dict[str, Any] | None:
    """Return the manifest of a run folder, or the one that a log on its own keeps in its metadata; None without one.

    Raises:
        LogFormatError: If the log is damaged.
        SettingsError: If the manifest is damaged.
    """
    folder = run_folder_of(target)
    if folder is not None:
        return read_json(folder / MANIFEST)
    text = run_metadata(target).get("manifest") if has_arrivals(target) else None
    return None if text is None else json_of(text, f"{target}, metadata")


def _begun(manifest: dict[str, Any], path: Path, source: Path) -> RecordingBuilder:
    """Return a builder for the run of a manifest.

    Args:
        path: File that holds the manifest, for messages and as the place of a chair file.
    """
    settings = manifest.get("settings")
    if not isinstance(settings, dict):
        raise SettingsError(f"{path}: no settings; make the run again")
    scenario = _scenario(path, settings)
    chair = chair_of_run(settings, f"{path}: settings") if scenario is None else scenario.read_chair()
    guard, seed = manifest.get("guard"), manifest.get("seed", 0)
    return RecordingBuilder(
        chair,
        scenario,
        seed=seed if isinstance(seed, int) else 0,
        source=str(source),
        limits=Limits.of_guard(guard if isinstance(guard, dict) else {}),
    )


def _scenario(path: Path, settings: dict[str, Any]) -> Scenario | None:
    """Return the scenario of a manifest; None for a replayed log and for a real chair, whose settings are not a scenario."""
    if {"replay", "robot"} & set(settings):
        return None
    try:
        return scenario_of(settings, path, where="settings")
    except SettingsError as error:
        raise SettingsError(f"{error}; was the run made by another version? Make it again") from None


def _take_log(path: Path, builder: RecordingBuilder) -> None:
    """Read the needed topics of a treadline log."""
    numeric = {topic: OF_IMU if kind is ImuSample else COLUMNS[kind][1:] for topic, kind in NUMERIC.items()}
    stamped = [COLOUR, QUALITY]
    contents = read_contents(path, {topic: names for topic, names in numeric.items() if topic != IMU}, [EVENTS, MAPS], stamped)
    if TRUTH not in contents.columns:
        contents = read_contents(path, numeric, [EVENTS, MAPS], stamped)
    for topic, columns in contents.columns.items():
        builder.add(Signals(rows={NUMERIC[topic]: columns}))
    for topic in (EVENTS, MAPS):
        for taken_s, signal in contents.signals.get(topic, []):
            builder(signal, taken_s)
    builder.add(Signals(frames_t_s=contents.stamps_s.get(COLOUR, np.zeros(0)).tolist()))
    builder.exposures_s = np.unique(contents.stamps_s[QUALITY]) if QUALITY in contents.stamps_s else None


BAG_TOPICS = frozenset({*NUMERIC, EVENTS, MAPS})
"""Topics of a bag that a recording needs."""


def bag_origin_ns(path: Path) -> int:
    """Return the stamp of a bag's first message that a recording holds [ns]: the origin of the recording's time.

    Raises:
        LogFormatError: If the bag is damaged.
    """
    for topic, logged_ns, data in packets(path, BAG_TOPICS.__contains__, sealed=False):
        if signal_reader(topic.name, kind_of(topic)) is not None:
            return round(received(topic, data, logged_ns).t_s * 1e9)
    return 0


def _bag_signals(path: Path) -> Iterator[tuple[Any, float]]:
    """Yield the signals of a bag on a clock that starts with its first message, and the time at which each was logged."""
    origin_ns = bag_origin_ns(path)
    for topic, logged_ns, data in packets(path, BAG_TOPICS.__contains__, sealed=False):
        read = signal_reader(topic.name, kind_of(topic))
        if read is None:  # a topic with another type means something else
            continue
        try:
            yield read(*received(topic, data, logged_ns, origin_ns)), 1e-9 * (logged_ns - origin_ns)
        except LogFormatError as error:
            if topic.name != EVENTS:  # other nodes publish diagnostics too
                raise LogFormatError(f"{path}: {topic.name}: {error}") from None
        except BROKEN as error:
            raise LogFormatError(f"{path}: {topic.name}: a message that cannot be read: {error}") from None


def read_frames(recording: Recording, times_s: list[float]) -> list[RgbdFrame]:
    """Return the logged camera frame nearest to each time; empty if the log holds no images.

    Raises:
        LogFormatError: If the log is damaged.
    """
    if not len(recording.frames_t_s) or not times_s:
        return []
    path = Path(recording.source)
    path = path / LOG if path.is_dir() else path
    nearest = [float(recording.frames_t_s[np.argmin(np.abs(recording.frames_t_s - t_s))]) for t_s in times_s]
    found: dict[float, RgbdFrame] = {}
    for frame in read_log(path, lambda topic: topic.startswith(("/camera/color", "/camera/depth"))):
        if isinstance(frame, RgbdFrame) and frame.t_s in nearest:
            found[frame.t_s] = frame
    return [found[t_s] for t_s in nearest if t_s in found]
