"""A wire on which a test speaks, and a log as another decoder reads it."""

from pathlib import Path
from typing import Any

from rosbags.highlevel import AnyReader

from treadline.core.camera_images import PinholeCamera
from treadline.ros import channels as on
from treadline.ros._codec import encoded
from treadline.ros.wire import WireTransport


class Air(WireTransport):
    """Transport without a network.

    Args:
        kinds: Types of the topics that somebody publishes.
        nodes: Transports that hear each other; this one joins them.
    """

    def __init__(
        self,
        kinds: dict[str, str] | None = None,
        *,
        nodes: "list[Air] | None" = None,
        mount: PinholeCamera | None = None,
        ros1: bool = False,
    ) -> None:
        super().__init__(mount)
        self.ros1, self.kinds, self._nodes = ros1, kinds or {}, [] if nodes is None else nodes
        self._name = f"node-{len(self._nodes)}"
        if nodes is not None:
            nodes.append(self)
        self.sent: list[tuple[str, Any]] = []
        """What was published: channel and signal."""
        self.topics: set[str] = set()
        """Topics with a subscriber."""

    def publish(self, channel: str, signal: Any) -> None:
        """Publish, and keep the signal."""
        super().publish(channel, signal)
        self.sent.append((channel, signal))

    def close(self) -> None:
        """Hear nothing any more."""
        self._nodes.remove(self)

    def say(self, channel: str, signal: Any) -> None:
        """Put a signal into the inbox, as another node would."""
        for topic, _, data in encoded(channel, signal, ros1=False):
            self.inbox.put(topic, data)

    def _advertise(self, topic: str, kind: str, channel: on.Channel) -> None:
        pass

    def _send(self, topic: str, data: bytes) -> None:
        for node in self._nodes:
            if topic in node.topics:
                node.inbox.put(topic, data, self._name)

    def _receive(self, topic: str, kind: str, depth: int) -> None:  # noqa: ARG002 - the signature of the transport
        self.topics.add(topic)

    def _kinds(self, topic: str) -> list[str]:
        return [self.kinds[topic]] if topic in self.kinds else []


def decoded(log: Path) -> dict[str, list[Any]]:
    """Return the messages of a log by topic, read by rosbags with the definitions that the log holds."""
    found: dict[str, list[Any]] = {}
    with AnyReader([log]) as reader:
        for connection, _, data in reader.messages():
            found.setdefault(connection.topic, []).append(reader.deserialize(data, connection.msgtype))
    return found
