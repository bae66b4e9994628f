"""A run's log: MCAP with ROS 2 messages. Same signals, same bytes: nothing in it depends on the wall clock.

Each message keeps two times: ``publish_time`` is the signal's stamp, ``log_time`` is the mission time at which the signal was
taken. A late camera frame has a log time after its stamp, so that a replay delivers the frame as late as the run did.

It grows under a temporary name and takes its own when closed; an interrupted run is closed too, and stays readable.
"""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from mcap.writer import CompressionType, Writer

from treadline.core.camera_images import RgbdFrame
from treadline.core.errors import TreadlineError
from treadline.core.processes import deferred
from treadline.io.mcap_read import LIBRARY
from treadline.io.message_types import RosMessage, nanoseconds_of, store
from treadline.io.messages import messages_of

CHUNK_BYTES = 4 * 1024 * 1024
"""Size at which a chunk is complete [bytes]."""
KEPT = ("/tf_static", "/robot_description", "/chair", "/stair/true")
"""Topics with one message at the start of a run, which ``ros2 bag play`` keeps for subscribers that come later."""
_FOREVER = "{sec: 9223372036, nsec: 854775807}"
KEPT_QOS = (
    f"- {{history: 1, depth: 1, reliability: 1, durability: 1, deadline: {_FOREVER}, lifespan: {_FOREVER}, liveliness: 1, "
    f"liveliness_lease_duration: {_FOREVER}, avoid_ros_namespace_conventions: false}}"
)
"""Quality of service of ``KEPT`` as rosbag2 stores it: keep last, reliable, transient local."""


class RunLog:
    """Writer of signals and ground truth into one MCAP file.

    Args:
        path: File to write.
        image_every: Keep every n-th frame; 0 keeps none.
        messages: Function from a signal to its messages.
        metadata: Properties of the run for the file's metadata record ``treadline``; None writes no record.
    """

    def __init__(
        self,
        path: Path,
        *,
        image_every: int = 0,
        messages: Callable[[Any], list[RosMessage]] = messages_of,
        metadata: Mapping[str, str] | None = None,
    ) -> None:
        self._path = path
        self._messages_of = messages
        self._temporary = path.with_name(path.name + ".part")
        self._image_every = image_every
        self._frames = 0
        self.kept_frame_s: float | None = None
        """Stamp of the last frame that was kept [s]; None before the first."""
        path.parent.mkdir(parents=True, exist_ok=True)
        self._file = self._temporary.open("wb")
        self._writer = Writer(self._file, chunk_size=CHUNK_BYTES, compression=CompressionType.ZSTD, enable_data_crcs=True)
        self._writer.start(profile="ros2", library=LIBRARY)
        if metadata is not None:
            self._writer.add_metadata(LIBRARY, dict(metadata))
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}
        self._counts: Counter[int] = Counter()

    def __enter__(self) -> "RunLog":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __call__(self, signal: Any, taken_s: float | None = None) -> None:
        """Write one signal.

        Args:
            signal: Signal with a stamp ``t_s``.
            taken_s: Mission time at which the signal was taken [s]; the stamp where it is left out.
        """
        with deferred():
            self.add(self.messages(signal), signal.t_s, taken_s)

    def messages(self, signal: Any) -> list[RosMessage]:
        """Return the messages of a signal; none for a frame that is not kept."""
        if isinstance(signal, RgbdFrame):
            self._frames += 1
            if self._image_every == 0 or (self._frames - 1) % self._image_every:
                return []
            self.kept_frame_s = signal.t_s
        return self._messages_of(signal)

    def add(self, messages: Sequence[RosMessage], stamp_s: float, taken_s: float | None = None) -> None:
        """Write messages with one stamp; the caller defers interrupts to the end.

        Args:
            taken_s: Mission time at which the messages were made [s]; the stamp where it is left out.
        """
        stamp_ns = nanoseconds_of(stamp_s)
        taken_ns = stamp_ns if taken_s is None or taken_s == stamp_s else nanoseconds_of(taken_s)
        channels, counts, write = self._channels, self._counts, self._writer.add_message
        try:
            for message in messages:
                channel = channels.get(message.topic) or self._channel(message.topic, message.kind)
                write(channel, taken_ns, message.encoded(), stamp_ns, counts[channel])
                counts[channel] += 1
        except OSError as error:
            raise self._unwritable(error) from None

    def close(self) -> None:
        """Finish the file and rename it to its final name.

        Raises:
            TreadlineError: If writing fails, for example on a full disk; the temporary file is removed.
        """
        if self._file.closed:
            return
        try:
            with deferred():
                self._writer.finish()
                self._file.close()
                self._temporary.replace(self._path)
        except OSError as error:
            with suppress(OSError):
                self._file.close()
            self._temporary.unlink(missing_ok=True)
            raise self._unwritable(error) from None

    def _unwritable(self, error: OSError) -> TreadlineError:
        return TreadlineError(f"{self._path}: cannot be written: {error.strerror or error}")

    def _channel(self, topic: str, kind: str) -> int:
        """Declare a topic that is new in this log; return its number, which is 1 or greater."""
        if kind not in self._schemas:
            definition, _ = store().generate_msgdef(kind, ros_version=2)
            self._schemas[kind] = self._writer.register_schema(kind, "ros2msg", definition.encode())
        metadata = {"offered_qos_profiles": KEPT_QOS} if topic in KEPT else {}
        self._channels[topic] = self._writer.register_channel(topic, "cdr", self._schemas[kind], metadata)
        return self._channels[topic]
