"""Signals into bags, with no ROS installed: MCAP, ROS 1's .bag and ROS 2's SQLite. They are read back by ``io``."""

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

from treadline.core.errors import SettingsError, TreadlineError
from treadline.io.cdr import CdrWriter, Ros1Writer, nanoseconds_of
from treadline.io.mcap_log import RunLog
from treadline.io.messages import Message, messages_of
from treadline.mission.odometry import Odometry
from treadline.ros import channels as on
from treadline.ros._codec import encoded
from treadline.ros._node_signals import Mounts


@runtime_checkable
class Bag(Protocol):
    """Takes signals until it is closed."""

    def __call__(self, signal: Any, taken_s: float | None = None) -> None:
        """Write one signal, taken at ``taken_s`` on the mission clock; at its stamp where that is left out."""

    def close(self) -> None:
        """Finish the file."""


def open_bag(path: Path) -> Bag:
    """Return the bag that a name's ending asks for.

    Raises:
        SettingsError: If the ending is unknown, or the file is there already.
        TreadlineError: If rosbags is missing.
    """
    if path.suffix == ".mcap":
        return RunLog(path, image_every=1, messages=_messages)
    if path.suffix not in _OPENERS:
        raise SettingsError(f"{path}: '{path.suffix}' is no bag that is written: .mcap, .bag (ROS 1), .db3 (ROS 2)")
    if path.exists():
        raise SettingsError(f"{path}: is there already; give another name")
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        return _RosBag(path, *_OPENERS[path.suffix](path))
    except ImportError:
        raise TreadlineError(f"{path}: '{path.suffix}' needs rosbags: pip install '.[ros]' in treadline's folder") from None


class _RosBag:
    """A bag under a temporary name until it is whole."""

    def __init__(self, path: Path, temporary: Path, writer: Any, connect: Callable[[str, str], Any], kind: type[CdrWriter]) -> None:
        self._path = path
        self._temporary = temporary
        self._writer = writer
        self._connect = connect
        self._kind = kind
        self._connections: dict[str, Any] = {}
        self._closed = False

    def __call__(self, signal: Any, taken_s: float | None = None) -> None:
        time_ns = nanoseconds_of(signal.t_s if taken_s is None else taken_s)
        for topic, kind, data in _messages(signal, self._kind):
            if topic not in self._connections:
                self._connections[topic] = self._connect(topic, kind)
            self._writer.write(self._connections[topic], time_ns, data)

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


def _messages(signal: Any, writer: type[CdrWriter] = CdrWriter) -> list[Message]:
    """Return the messages of a signal: those of a run's log, and those that only nodes publish."""
    channel = {Odometry: on.ODOM, Mounts: on.MOUNTS}.get(type(signal))
    return messages_of(signal, writer=writer) if channel is None else encoded(channel, signal, ros1=writer is Ros1Writer)


def _ros1(path: Path) -> tuple[Path, Any, Callable[[str, str], Any], type[CdrWriter]]:
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    if on.FRAMES not in store.types:
        store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", on.FRAMES))
    temporary = path.with_name(path.name + ".part")
    temporary.unlink(missing_ok=True)
    writer = Writer(temporary)
    writer.set_compression(Writer.CompressionFormat.LZ4)
    writer.open()
    return temporary, writer, lambda topic, kind: writer.add_connection(topic, kind, typestore=store), Ros1Writer


def _ros2(path: Path) -> tuple[Path, Any, Callable[[str, str], Any], type[CdrWriter]]:
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    temporary = path.with_name(path.name + ".part")
    shutil.rmtree(temporary, ignore_errors=True)
    writer = Writer(temporary, version=9, storage_plugin=StoragePlugin.SQLITE3)
    writer.open()
    return temporary, writer, lambda topic, kind: writer.add_connection(topic, kind, typestore=store), CdrWriter


_OPENERS: dict[str, Callable[[Path], tuple[Path, Any, Callable[[str, str], Any], type[CdrWriter]]]] = {".bag": _ros1, ".db3": _ros2}
