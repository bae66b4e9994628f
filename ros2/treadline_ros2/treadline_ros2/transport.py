"""
Channels as topics of ROS 2, with the names and the quality of service that its tools expect.

Messages travel serialised: one codec writes and reads them for every transport.
"""

from collections.abc import Callable
import importlib
import inspect
import math
from typing import Any

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.qos import (
    DurabilityPolicy,
    qos_policy_name_from_kind,
    QoSProfile,
    ReliabilityPolicy,
)
from treadline.core.camera_images import PinholeCamera
from treadline.core.signals import VelocityCommand
from treadline.ros import channels as on
from treadline.ros.channels import Channel
from treadline.ros.plant_node import OF_THE_CAMERA
from treadline.ros.wire import WireTransport

GLOBAL = ('/clock', '/tf', '/tf_static')
"""Topics whose names ROS 2 fixes; all others are relative to the node's namespace."""
SENSORS = tuple(
    topic.name
    for channel in (on.CLOCK, *on.SENSORS, *OF_THE_CAMERA.values())
    if channel != on.OPERATOR
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
        if not stamped:
            self.read_as[on.TWIST] = on.TWIST_TYPE
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
        """
        Subscribe to a channel.

        A TwistStamped without a stamp counts as of now, with a warning, as in ros2_control.
        """

        def take_velocity(command: VelocityCommand) -> None:
            if self._stamped and math.isnan(command.t_s):
                said = 'cmd_vel has a stamp of zero and counts as of now; stamp it (said once)'
                self._node.get_logger().warning(said, once=True)
            take(command)

        super().subscribe(channel, take_velocity if channel == on.TWIST else take)

    def _advertise(self, topic: str, kind: str, channel: Channel) -> None:
        durability = (
            DurabilityPolicy.TRANSIENT_LOCAL if channel.kept else DurabilityPolicy.VOLATILE
        )
        quality = _quality(channel.depth, ReliabilityPolicy.RELIABLE, durability)
        publisher = self._node.create_publisher(_message(kind), named(topic), quality)
        self._publishers[topic] = publisher

    def _send(self, topic: str, data: bytes) -> None:
        self._publishers[topic].publish(data)

    def _receive(self, topic: str, kind: str, depth: int) -> None:
        def receive(*come: Any) -> None:
            # The events executor of Kilted hands over data and information as one tuple.
            data, information = come if len(come) == 2 else come[0]
            self._attempt(self._take_from, topic, data, information)

        receive.__signature__ = inspect.signature(self._take)  # of two arguments

        def tick(data: bytes) -> None:
            self.inbox.newest[topic] = self._clock = data
            self._node.executor.create_task(self._deliver_clock)

        name = self._node.resolve_topic_name(named(topic))
        error = self._node.get_logger().error
        misfits = SubscriptionEventCallbacks(
            incompatible_qos=lambda event: error(
                f'{name}: a publisher whose {qos_policy_name_from_kind(event.last_policy_kind)} '
                'does not fit is not heard; publish with reliability RELIABLE'
            ),
            incompatible_type=lambda _: error(
                f'{name} is published as another type; {kind} is read: remap one of the two'
            ),
            use_default_callbacks=False,
        )
        reliability = (
            ReliabilityPolicy.BEST_EFFORT if topic in SENSORS else ReliabilityPolicy.RELIABLE
        )
        subscription = self._node.create_subscription(
            _message(kind),
            named(topic),
            tick if topic == on.CLOCK else receive,
            _quality(depth, reliability),
            raw=True,
            event_callbacks=misfits,
        )
        self._subscriptions.append(subscription)

    def _take_from(self, topic: str, data: bytes, information: Any) -> None:
        """Deliver a message, and record its publisher where rclpy names it (Kilted and later)."""
        publisher = information.get('publisher_gid')
        self.inbox.note(topic, '' if publisher is None else publisher['data'].hex())
        self._take(topic, data)

    def _node_name(self, topic: str, sender: str) -> str:
        name = self._node.resolve_topic_name(named(topic))
        found = self._node.get_publishers_info_by_topic(name)
        names = (
            f'{info.node_namespace.rstrip("/")}/{info.node_name}'
            for info in found
            if bytes(info.endpoint_gid).hex() == sender
        )
        return next(names, sender)

    def _deliver_clock(self) -> None:
        """
        Deliver the newest clock after all that waited when it came.

        Of the clock only the newest message is kept, of readings all: delivered as it comes, it
        would overtake the readings of its own tick, and the guard would miss them.
        """
        data, self._clock = self._clock, None
        if data is not None:
            self._attempt(self._take, on.CLOCK, data)

    def _kinds(self, topic: str) -> list[str]:
        name = self._node.resolve_topic_name(named(topic))
        return [info.topic_type for info in self._node.get_publishers_info_by_topic(name)]


def named(topic: str) -> str:
    """Return a topic's name before remapping."""
    return topic if topic in GLOBAL else topic.lstrip('/')


def _quality(
    depth: int,
    reliability: ReliabilityPolicy,
    durability: DurabilityPolicy = DurabilityPolicy.VOLATILE,
) -> QoSProfile:
    return QoSProfile(depth=depth, reliability=reliability, durability=durability)


def _message(kind: str) -> Any:
    package, _, name = kind.split('/')
    return getattr(importlib.import_module(f'{package}.msg'), name)
