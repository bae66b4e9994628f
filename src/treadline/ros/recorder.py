"""The recorder of Fig. 7: belt commands and heading response for the identification, and a log of all signals.

``TrackCommand, HeadingEstimate -> record.csv``, everything ``-> log.mcap`` or a ROS bag, by the name's ending. Bags are written
with no ROS installed: MCAP, ROS 1's .bag and ROS 2's SQLite. They are read back by ``io``.
"""

import shutil
from pathlib import Path
from typing import Any

import numpy as np

from treadline.core.errors import SettingsError
from treadline.core.models import BAG_SUFFIXES, InputOutputRecord
from treadline.core.ports import Transport
from treadline.core.signals import TICK_S, HeadingEstimate, TrackCommand
from treadline.io.mcap_log import RunLog
from treadline.io.message_types import RosMessage, nanoseconds_of, store
from treadline.io.messages import topic_of
from treadline.io.records import write_record
from treadline.io.runs import INPUTS, LOG, OUTPUTS, RECORD, clear_run
from treadline.mission.odometry import Odometry
from treadline.ros import channels as on
from treadline.ros._codec import messages_on


def open_bag(path: Path) -> "RunLog | _RosBag":
    """Return the bag that a name's ending asks for.

    Raises:
        SettingsError: If the ending is unknown, or the file is there already.
    """
    if path.suffix == ".mcap":
        return RunLog(path, image_every=1, messages=_messages)
    if path.suffix not in {".bag", ".db3"}:
        raise SettingsError(f"{path}: '{path.suffix}' is no bag that is written: .mcap, .bag (ROS 1), .db3 (ROS 2)")
    if path.exists():
        raise SettingsError(f"{path}: is there already; give another name")
    path.parent.mkdir(parents=True, exist_ok=True)
    return _RosBag(path)


class _RosBag:
    """A bag under a temporary name until it is whole."""

    def __init__(self, path: Path) -> None:
        from rosbags import rosbag1, rosbag2

        self._path, self._temporary = path, path.with_name(path.name + ".part")
        self._ros1 = path.suffix == ".bag"
        if self._ros1:
            self._temporary.unlink(missing_ok=True)
            self._writer: Any = rosbag1.Writer(self._temporary)
            self._writer.set_compression(rosbag1.Writer.CompressionFormat.LZ4)
        else:
            shutil.rmtree(self._temporary, ignore_errors=True)
            self._writer = rosbag2.Writer(self._temporary, version=9, storage_plugin=rosbag2.StoragePlugin.SQLITE3)
        self._writer.open()
        self._connections: dict[str, Any] = {}
        self._closed = False

    def __call__(self, signal: Any, taken_s: float | None = None) -> None:
        time_ns = nanoseconds_of(signal.t_s if taken_s is None else taken_s)
        for message in _messages(signal, ros1=self._ros1):
            connection = self._connections.get(message.topic)
            if connection is None:
                connection = self._writer.add_connection(message.topic, message.kind, typestore=store(ros1=self._ros1))
                self._connections[message.topic] = connection
            self._writer.write(connection, time_ns, message.encoded(ros1=self._ros1))

    def close(self) -> None:
        if self._closed:
            return
        self._closed = True
        self._writer.close()
        if self._temporary.is_dir():
            # ROS 2 keeps a bag in a folder; the file alone is what a name with .db3 asks for.
            next(self._temporary.glob("*.db3")).replace(self._path)
            shutil.rmtree(self._temporary)
        else:
            self._temporary.replace(self._path)


def _messages(signal: Any, *, ros1: bool = False) -> list[RosMessage]:
    """Return the messages of a signal: those of a run's log, and those that only nodes publish."""
    channel = {Odometry: on.ODOM, on.Mounts: on.MOUNTS}.get(type(signal))
    return messages_on(topic_of(signal) if channel is None else channel, signal, ros1=ros1)


Row = tuple[float, float, float, float, float]
"""Time, left and right belt, heading, yaw rate."""


class RecorderNode:
    """Writes a run folder, or one bag.

    Args:
        out: A folder for record.csv and log.mcap, or a file: .mcap, .bag, or .db3 for a folder of ROS 2's.
        period_s: Of the record's rows.
        frames: Whether images are kept.
    """

    name = "recorder"
    publishes: tuple[str, ...] = ()
    needs: tuple[tuple[str, ...], ...] = ()

    def __init__(self, out: Path | None, period_s: float, *, frames: bool = True) -> None:
        if out is None:
            raise SettingsError("the recorder needs --out: a run folder, or a file that ends in .mcap, .bag or .db3")
        self._folder = out if out.suffix not in BAG_SUFFIXES else None
        if self._folder is not None:
            clear_run(self._folder)
            self._folder.mkdir(parents=True, exist_ok=True)
        self._bag = open_bag(out if self._folder is None else self._folder / LOG)
        self._channels = tuple(channel for channel in on.LOGGED if frames or channel != on.CAMERA)
        self._period_s = period_s
        self._every = round(period_s / TICK_S)
        self._slot = -1
        self._t_s = 0.0
        self._command: TrackCommand | None = None
        self._estimate: HeadingEstimate | None = None
        self._before: tuple[float, HeadingEstimate] | None = None
        self._rows: list[Row] = []
        self._longest: list[Row] = []
        self._missed = 0
        self.count = 0
        """Signals written."""

    def listen(self, transport: Transport) -> None:
        """Subscribe to the channels that are logged."""
        for channel in self._channels:
            transport.subscribe(channel, self._keep)

    def advance(self, t_s: float) -> None:
        """Set the clock, by which arrivals are logged."""
        self._t_s = t_s

    def tick(self, t_s: float) -> None:
        """Complete a row: its outputs were read at its begin, its inputs have acted until now."""
        self.advance(t_s)
        slot = round(t_s / TICK_S) // self._every
        if slot == self._slot:
            return
        whole, self._slot = slot == self._slot + 1, slot
        if self._before is not None and self._command is not None and whole:
            then_s, estimate = self._before
            belts = self._command.left_m_s, self._command.right_m_s
            self._rows.append((then_s, *belts, estimate.heading_rad, estimate.heading_rate_rad_s))
        elif not whole:
            self._end_stretch()
        self._before = None if self._estimate is None else (t_s, self._estimate)

    def close(self) -> None:
        """Finish the files."""
        self._bag.close()
        self._end_stretch()
        if self._folder is None or not self._longest:
            return
        rows = np.array(self._longest)
        record = InputOutputRecord(u=rows[:, 1:3], y=rows[:, 3:5], dt_s=self._period_s, input_names=INPUTS, output_names=OUTPUTS)
        write_record(self._folder / RECORD, record, self._longest[0][0])

    @property
    def left_out(self) -> str | None:
        """Description of the rows missing from record.csv; None if it is complete."""
        if self._folder is None or not self._missed:
            return None
        kept = f"{RECORD} holds the longest stretch, {len(self._longest)} rows"
        return f"{kept}: {self._missed} more lie beyond rows that were missed"

    def _end_stretch(self) -> None:
        """End a stretch of rows: a record has no gaps, so of the stretches between missed rows the longest is kept."""
        self._missed += min(len(self._rows), len(self._longest))
        self._longest = max(self._longest, self._rows, key=len)
        self._rows = []

    def _keep(self, signal: Any) -> None:
        if isinstance(signal, on.Beat):
            return
        if isinstance(signal, TrackCommand):
            self._command = signal
        elif isinstance(signal, HeadingEstimate):
            self._estimate = signal
        self._bag(signal, max(self._t_s, signal.t_s))
        self.count += 1
