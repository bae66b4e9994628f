"""ROS 1 (Noetic): topics of a roscore, by rospy. The bytes are our own; rospy finds partners, compares types and carries them."""

import importlib
import sys
from importlib.util import find_spec
from io import BytesIO
from pathlib import Path
from typing import Any

from treadline.core.camera_images import PinholeCamera
from treadline.core.errors import TreadlineError
from treadline.io.messages import IMAGE
from treadline.ros.channels import Channel
from treadline.ros.wire import WireTransport

DEBIAN = Path("/usr/lib/python3/dist-packages")
"""Debian's packages; appended, never before a venv's own: its numpy is older."""
INSTALL = (
    "apt-get install ros-core python3-rospy python3-sensor-msgs python3-nav-msgs python3-tf2-msgs "
    "python3-geometry-msgs python3-diagnostic-msgs, "
    "or source /opt/ros/noetic/setup.bash"
)


class Ros1Transport(WireTransport):
    """One node on a roscore.

    Args:
        node: Name of the node in the ROS graph.
        arguments: ROS remappings, such as ``/camera/color/image_raw:=/camera``.
    """

    ros1 = True

    def __init__(self, node: str, *, arguments: tuple[str, ...] = (), mount: PinholeCamera | None = None) -> None:
        super().__init__(mount)
        self._rospy, rosgraph = _modules()
        master = rosgraph.get_master_uri()
        if not rosgraph.is_master_online():
            raise TreadlineError(f"no roscore answers at {master}: start one (roscore), or set ROS_MASTER_URI")
        self._master = rosgraph.Master(f"/treadline_{node}")
        self._rospy.init_node(f"treadline_{node}", argv=["treadline", *arguments], disable_signals=True)
        self._publishers: dict[str, tuple[Any, Any]] = {}

    def close(self) -> None:
        """Leave."""
        self._rospy.signal_shutdown("done")

    def _advertise(self, topic: str, kind: str, channel: Channel) -> None:
        message = _raw(kind)
        room = max(channel.depth, QUEUE)
        publisher = self._rospy.Publisher(topic, message, queue_size=room, latch=channel.kept, tcp_nodelay=True)
        self._publishers[topic] = publisher, message

    def _send(self, topic: str, data: bytes) -> None:
        publisher, message = self._publishers[topic]
        publisher.publish(message(data))

    def _receive(self, topic: str, kind: str, depth: int) -> None:
        inbox = self.inbox
        self._rospy.Subscriber(
            topic,
            _raw(kind),
            lambda message: inbox.put(topic, _bytes_of(message), getattr(message, "_connection_header", {}).get("callerid", "")),
            queue_size=max(depth, 10),
            buff_size=IMAGE_BUFFER if kind == IMAGE else BUFFER,
            tcp_nodelay=True,
        )

    def _kinds(self, topic: str) -> list[str]:
        resolved = self._rospy.resolve_name(topic)
        kinds = [kind for name, kind in self._master.getPublishedTopics("") if name == resolved]
        return ["/msg/".join(kind.split("/")) for kind in kinds]


QUEUE = 30
"""Shortest queue of a publisher for slow subscribers [messages]: three seconds of images."""
IMAGE_BUFFER = 1 << 22
"""Receive buffer for images [bytes]: two VGA frames with depth. A smaller buffer splits an image into several late reads."""
BUFFER = 1 << 16
"""Receive buffer for other messages [bytes]: each read allocates a whole buffer, the largest cost of a small message."""


def _raw(kind: str) -> Any:
    """Return a message class of this type that holds the serialised bytes."""
    package, _, name = kind.split("/")
    try:
        real = getattr(importlib.import_module(f"{package}.msg"), name)
    except ImportError:
        raise TreadlineError(f"ROS 1 has no {package} here: apt-get install python3-{package.replace('_', '-')}") from None

    return type(name, (real,), {"__slots__": ("data",), "_has_header": False, **_RAW})


def _keep(message: Any, data: bytes = b"") -> None:
    message.data = data


def _write(message: Any, buffer: BytesIO) -> None:
    buffer.write(message.data)


def _read(message: Any, data: bytes) -> Any:
    message.data = data
    return message


_RAW = {"__init__": _keep, "serialize": _write, "deserialize": _read}
"""Methods of message classes that hold bytes; the header is hidden, because rospy would overwrite stamp and sequence number."""


def _bytes_of(message: Any) -> bytes:
    """Return the serialised bytes; under ``use_sim_time`` rospy subscribes to the clock first, with its own message class."""
    if hasattr(message, "data"):
        data: bytes = message.data
        return data
    buffer = BytesIO()
    message.serialize(buffer)
    return buffer.getvalue()


def _modules() -> tuple[Any, Any]:
    if find_spec("rospy") is None and DEBIAN.is_dir():
        sys.path.append(str(DEBIAN))
        importlib.invalidate_caches()
    try:
        import rosgraph
        import rospy
    except ImportError:
        raise TreadlineError(f"--transport ros1 needs rospy, which is not installed: {INSTALL}") from None
    return rospy, rosgraph
