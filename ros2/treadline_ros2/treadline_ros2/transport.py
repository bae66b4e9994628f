"""
Channels as topics of ROS 2, with the names and the quality of service that its tools expect.

Messages travel serialised: one codec writes and reads them for every transport.
"""

from collections.abc import Callable
import importlib
from typing import Any

from geometry_msgs.msg import Twist
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    qos_policy_name_from_kind,
    QoSProfile,
    ReliabilityPolicy,
)
from treadline.core.camera_images import PinholeCamera
from treadline.ros import channels as on
from treadline.ros._codec import velocity_of
from treadline.ros.channels import Channel
from treadline.ros.wire import WireTransport

GLOBAL = ('/clock', '/tf', '/tf_static')
"""Topics whose names ROS 2 fixes; all others are relative to the node's namespace."""
SENSORS = tuple(
    topic.name
    for channel in (
        on.CLOCK,
        on.IMU,
        on.TRACKS,
        on.SEAT,
        on.FLIPPER,
        on.CAMERA,
        on.CAMERA_HEADING,
        on.CAMERA_MAP,
        on.CAMERA_QUALITY,
    )
    for topic in on.CHANNELS[channel].topics
)
"""Topics that drivers publish: read with best effort, which hears reliable publishers, too."""


class RclpyTransport(WireTransport):
    """
    The topics of one node; messages are delivered by the node's executor.

    ``attempt`` calls a function with its arguments while the node is active.
    """

    def __init__(
        self,
        node: Any,
        attempt: Callable[..., None],
        mount: PinholeCamera | None = None,
        *,
        stamped: bool = True,
    ) -> None:
        super().__init__(mount)
        self._node = node
        self._attempt = attempt
        self._stamped = stamped
        self._publishers: dict[str, Any] = {}
        self._subscriptions: list[Any] = []
        self._clock: bytes | None = None

    def close(self) -> None:
        """Take the topics back."""
        for publisher in self._publishers.values():
            self._node.destroy_publisher(publisher)
        for subscription in self._subscriptions:
            self._node.destroy_subscription(subscription)
        self._publishers.clear()
        self._subscriptions.clear()

    def publish(self, channel: str, signal: Any) -> None:
        """
        Send a signal.

        ROS takes a stamp of zero for none: what a simulator measured at its start is left out.
        """
        if getattr(signal, 't_s', 1.0) > 0.0:
            super().publish(channel, signal)

    def subscribe(self, channel: str, take: Callable[[Any], object]) -> None:
        """Subscribe to a channel; ``cmd_vel`` is a Twist where the node asks for it."""
        if channel != on.TWIST or self._stamped:
            super().subscribe(channel, take)
            return

        def receive(twist: Twist) -> None:
            self._attempt(take, velocity_of(twist))

        self._subscribe(Twist, channel, receive, 1, raw=False)

    def _advertise(self, topic: str, kind: str, channel: Channel) -> None:
        durability = (
            DurabilityPolicy.TRANSIENT_LOCAL if channel.kept else DurabilityPolicy.VOLATILE
        )
        quality = _quality(channel.depth, ReliabilityPolicy.RELIABLE, durability)
        self._publishers[topic] = self._node.create_publisher(
            _message(kind), named(topic), quality
        )

    def _send(self, topic: str, data: bytes) -> None:
        self._publishers[topic].publish(data)

    def _receive(self, topic: str, kind: str, depth: int) -> None:
        def receive(data: bytes) -> None:
            self._attempt(self._take, topic, data)

        def tick(data: bytes) -> None:
            self.inbox.newest[topic] = self._clock = data
            self._node.executor.create_task(self._deliver_clock)

        receive = tick if topic == on.CLOCK else receive
        self._subscribe(_message(kind), topic, receive, depth, raw=True)

    def _deliver_clock(self) -> None:
        """
        Deliver the newest clock after all that waited when it came.

        Of the clock only the newest message is kept, of readings all: delivered as it comes, it
        would overtake the readings of its own tick, and the guard would miss them.
        """
        data, self._clock = self._clock, None
        if data is not None:
            self._attempt(self._take, on.CLOCK, data)

    def _subscribe(
        self, kind: Any, topic: str, receive: Callable[[Any], None], depth: int, *, raw: bool
    ) -> None:
        name = self._node.resolve_topic_name(named(topic))
        error = self._node.get_logger().error
        read = f'{kind.__module__.split(".")[0]}/msg/{kind.__name__}'
        reliability = (
            ReliabilityPolicy.BEST_EFFORT if topic in SENSORS else ReliabilityPolicy.RELIABLE
        )
        misfits = SubscriptionEventCallbacks(
            incompatible_qos=lambda event: error(
                f'{name}: a publisher whose {qos_policy_name_from_kind(event.last_policy_kind)} '
                'does not fit is not heard; publish with reliability RELIABLE'
            ),
            incompatible_type=lambda _: error(
                f'{name} is published as another type; {read} is read: remap one of the two'
            ),
            use_default_callbacks=False,
        )
        quality = _quality(depth, reliability, DurabilityPolicy.VOLATILE)
        self._subscriptions.append(
            self._node.create_subscription(
                kind, named(topic), receive, quality, raw=raw, event_callbacks=misfits
            )
        )

    def _kinds(self, topic: str) -> list[str]:
        return [
            info.topic_type
            for info in self._node.get_publishers_info_by_topic(
                self._node.resolve_topic_name(named(topic))
            )
        ]


def named(topic: str) -> str:
    """Return a topic's name before remapping."""
    return topic if topic in GLOBAL else topic.lstrip('/')


def _quality(
    depth: int, reliability: ReliabilityPolicy, durability: DurabilityPolicy
) -> QoSProfile:
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=depth,
        reliability=reliability,
        durability=durability,
    )


def _message(kind: str) -> Any:
    package, _, name = kind.split('/')
    return getattr(importlib.import_module(f'{package}.msg'), name)
