"""Channels as topics of ROS 2, by rclpy: serialised messages in and out, so that the bytes are those of every other transport."""

import importlib
from typing import Any

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

from treadline.core.camera_images import PinholeCamera
from treadline.ros.channels import Channel
from treadline.ros.wire import WireTransport


class RclpyTransport(WireTransport):
    """The topics of one lifecycle node."""

    def __init__(self, node: Any, mount: PinholeCamera | None = None) -> None:
        super().__init__(mount)
        self._node = node
        self._publishers: dict[str, Any] = {}
        self._subscriptions: list[Any] = []

    def close(self) -> None:
        """Take the topics back."""
        for publisher in self._publishers.values():
            self._node.destroy_publisher(publisher)
        for subscription in self._subscriptions:
            self._node.destroy_subscription(subscription)
        self._publishers.clear()
        self._subscriptions.clear()

    def _advertise(self, topic: str, kind: str, channel: Channel) -> None:
        quality = _quality(channel.depth, kept=channel.kept)
        self._publishers[topic] = self._node.create_publisher(_message(kind), topic, quality)

    def _send(self, topic: str, data: bytes) -> None:
        self._publishers[topic].publish(data)

    def _receive(self, topic: str, kind: str, depth: int) -> None:
        inbox = self.inbox
        self._subscriptions.append(
            self._node.create_subscription(
                _message(kind), topic, lambda data: inbox.put(topic, bytes(data)), _quality(depth), raw=True
            )
        )

    def _kinds(self, topic: str) -> list[str]:
        return [info.topic_type for info in self._node.get_publishers_info_by_topic(topic)]


def _quality(depth: int, *, kept: bool = False) -> QoSProfile:
    return QoSProfile(
        depth=max(depth, 10),
        history=HistoryPolicy.KEEP_LAST,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if kept else DurabilityPolicy.VOLATILE,
    )


def _message(kind: str) -> Any:
    package, _, name = kind.split("/")
    return getattr(importlib.import_module(f"{package}.msg"), name)
