"""
A lab's own base: ``cmd_vel`` out, odometry in; the wire of the link ``base`` of a robot file.

The topics are ROS 2's; the rules (limits, watchdog, the measured time-out) are those of
``treadline.hardware``, in the guard process of ``treadline drive``.
"""

from collections import deque
import time
from typing import Any

from geometry_msgs.msg import Twist, TwistStamped
from nav_msgs.msg import Odometry
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import qos_profile_sensor_data
from rclpy.signals import SignalHandlerOptions
from treadline.core.errors import LinkError
from treadline.hardware._base_link import BaseOdometry
from treadline.hardware.device_threads import DeviceThreads

KINDS = {'twist_stamped': TwistStamped, 'twist': Twist}
LOOK_S = 1.0
"""Interval at which the publishers of the odometry are counted [s]."""


class RosWire:
    """
    Belt speeds as ``cmd_vel``, and odometry as belt speeds.

    Args:
    ----
    gauge_m: Distance between belts of this base that turn it as its odometry says [m].
    cmd_vel: Topic of the velocities.
    odom: Topic of the odometry.
    kind: Type of the velocities: twist_stamped or twist.

    """

    def __init__(
        self,
        *,
        gauge_m: float,
        cmd_vel: str = 'cmd_vel',
        odom: str = 'odom',
        kind: str = 'twist_stamped',
    ) -> None:
        if gauge_m <= 0.0 or kind not in KINDS:
            raise LinkError(
                f'gauge_m {gauge_m:g}, kind {kind}; give metres and {" or ".join(KINDS)}'
            )
        self._gauge_m, self._kind = gauge_m, KINDS[kind]
        self._context = rclpy.Context()
        rclpy.init(context=self._context, signal_handler_options=SignalHandlerOptions.NO)
        self._node = rclpy.create_node('base_link_of_treadline', context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._publisher = self._node.create_publisher(self._kind, cmd_vel, 1)
        self._arrived: deque[BaseOdometry] = deque()
        self._node.create_subscription(Odometry, odom, self._take, qos_profile_sensor_data)
        self._odom, self._looked_s = odom, 0.0
        self._threads: DeviceThreads[BaseOdometry, tuple[float, float]] = DeviceThreads(
            self._receive, self._publish, lambda error: f'ROS has gone ({error}); start again'
        )

    def read(self) -> list[tuple[float, BaseOdometry]]:
        """Return the odometry since the last call; two publishers are a LinkError."""
        return self._threads.read()

    def _receive(self, within_s: float) -> BaseOdometry | None:
        """Wait for the next odometry."""
        if time.monotonic() - self._looked_s > LOOK_S:
            self._looked_s = time.monotonic()
            self._look()
        self._executor.spin_once(timeout_sec=within_s)
        return self._arrived.popleft() if self._arrived else None

    def _look(self) -> None:
        """Raise a LinkError where two nodes publish the odometry."""
        name = self._node.resolve_topic_name(self._odom)
        infos = self._node.get_publishers_info_by_topic(name)
        found = sorted({f'{info.node_namespace.rstrip("/")}/{info.node_name}' for info in infos})
        if len(found) > 1:
            named = ' and '.join(found)
            raise LinkError(
                f'two bases publish odometry ({named}); stop one, or give it a namespace'
            )

    def write(self, left_m_s: float, right_m_s: float) -> None:
        """Send a velocity."""
        self._threads.write((left_m_s, right_m_s))

    def _publish(self, belts: tuple[float, float]) -> None:
        left_m_s, right_m_s = belts
        message = self._kind()
        twist = getattr(message, 'twist', message)
        if twist is not message:
            message.header.stamp = self._node.get_clock().now().to_msg()
            message.header.frame_id = 'base_link'
        twist.linear.x = 0.5 * (left_m_s + right_m_s)
        twist.angular.z = (right_m_s - left_m_s) / self._gauge_m
        self._publisher.publish(message)

    def close(self) -> None:
        """Leave the graph."""
        self._threads.close()
        self._executor.shutdown()
        self._node.destroy_node()
        self._context.try_shutdown()

    def _take(self, message: Any) -> None:
        place, twist = message.pose.pose.position, message.twist.twist
        turn_m_s = 0.5 * self._gauge_m * twist.angular.z
        speed_m_s = twist.linear.x
        belts = speed_m_s - turn_m_s, speed_m_s + turn_m_s
        found = BaseOdometry(message.child_frame_id, '', (place.x, place.y), *belts)
        self._arrived.append(found)
