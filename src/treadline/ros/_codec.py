"""Signals as ROS messages and back, channel by channel: ``treadline_msgs`` for ROS 2, standard types for ROS 1."""

import math
import struct
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, get_args

import numpy as np

from treadline.core.camera_images import PinholeCamera, RgbdFrame
from treadline.core.errors import ImageError, LogFormatError, one_line
from treadline.core.rotations import quaternion_of
from treadline.core.signals import CommandSource, Event, VelocityCommand
from treadline.io.images import Pairing, with_mount
from treadline.io.message_types import RosMessage, message_of, stamp, stamped_s, store
from treadline.io.messages import CAMERA, DETAIL, STATUS, joints, messages_of, status
from treadline.io.scene_messages import (
    BASE,
    CLEAR,
    ODOMETRY,
    FramePose,
    camera_frames,
    frames_message,
    markers_message,
    odometry_message,
)
from treadline.io.standard_messages import signal_reader, standard_messages_of
from treadline.mission.odometry import Odometry
from treadline.ros import channels as on

NODE = "node"
"""Hardware id of a heartbeat in a diagnostic message."""
AHEAD = 8
"""Largest number of images buffered until their depth or colour image arrives on its own connection."""

SOURCES: dict[int, CommandSource] = dict(enumerate(get_args(CommandSource), 1))
"""Values of the field ``source`` of ``GuardState``."""

BROKEN = (ImageError, ValueError, LookupError, ArithmeticError, struct.error)
"""Errors of a reader that the bytes of a message cause: text that is no UTF-8, missing names, numbers out of range."""


def encoded(channel: str, signal: Any, *, ros1: bool) -> list[tuple[str, str, bytes]]:
    """Return topic, type and bytes of the messages that hold a signal."""
    return [(message.topic, message.kind, message.encoded(ros1=ros1)) for message in messages_on(channel, signal, ros1=ros1)]


def messages_on(channel: str, signal: Any, *, ros1: bool) -> list[RosMessage]:
    """Return the messages that hold a signal."""
    match signal:  # those that only nodes exchange
        case on.Clock():
            return [RosMessage(channel, on.CLOCK_TYPE, stamp(signal.t_s))]
        case VelocityCommand():
            twist = (signal.speed_m_s, 0.0, 0.0, 0.0, 0.0, signal.turn_rad_s)
            stamped = RosMessage(channel, on.TWIST_STAMPED, (*stamp(signal.t_s), BASE, *twist))
            return [RosMessage(channel, on.TWIST_TYPE, twist) if ros1 else stamped]
        case on.Beat():
            status_fields = (int(signal.state != "ready"), signal.node, signal.state, NODE)
            return [status(channel, signal.t_s, status_fields, {}, signal.node)]
        case Odometry():
            return _odometry_messages(channel, signal, ros1=ros1)
        case on.StairMarkers():
            return [] if ros1 else [markers_message(channel, signal.t_s, (CLEAR, *signal.markers))]
        case on.JointAngles():
            return [joints(channel, signal.t_s, signal.names, signal.angles_rad, (), "chair")]
        case on.Mounts():
            return [frames_message(channel, signal.t_s, _sensors(signal.camera, ros1=ros1))]
        case on.GuardState() if ros1:
            status_fields = (0 if signal.holding is None else 2, "guard", signal.holding or "", signal.sender)
            return [status(channel, signal.t_s, status_fields, {}, "guard")]
        case on.GuardState():
            source = next(number for number, word in SOURCES.items() if word == signal.source)
            return [RosMessage(channel, on.GUARD_TYPE, (*stamp(signal.t_s), BASE, signal.holding or "", source, signal.sender))]
    return standard_messages_of(signal, channel) if ros1 else messages_of(signal, channel)


class Decoder:
    """Decoder of one channel: messages to signals. Depth and colour image of a frame are paired here.

    Args:
        mount: Camera with the mount on the chair, which a ``CameraInfo`` does not hold.
        kinds: Message types of topics that differ from those of the channel.
    """

    def __init__(
        self, channel: str, *, ros1: bool, mount: PinholeCamera | None = None, kinds: Mapping[str, str] | None = None
    ) -> None:
        self._ros1 = ros1
        self._mount = mount
        topics = [topic for topic in on.CHANNELS[channel].topics_of(ros1=ros1) if topic.read]
        self._kinds = {topic.name: (kinds or {}).get(topic.name) or topic.kind_of(ros1=ros1) for topic in topics}
        for kind in self._kinds.values():
            store(ros1=ros1).get_msgdef(kind)  # compiled now: the guard holds for a node that stands still
        if channel != on.CAMERA:
            self._readers = {name: _reader(name, kind) for name, kind in self._kinds.items()}
        else:
            roles = zip(self._kinds, ("color", "depth", "info"), strict=True)
            pairing = Pairing(calibrate=self._mounted, ahead=AHEAD)
            self._readers = {topic: partial(_frame, pairing, role) for topic, role in roles}

    def signal(self, topic: str, data: bytes) -> Any | None:
        """Return the signal that a message completes, or None.

        Raises:
            LogFormatError: If the bytes are no message of this topic, or an image cannot be used. Errors of other kinds are errors
                of this program.
        """
        read, kind = self._readers[topic], self._kinds[topic]
        try:
            message = message_of(kind, data, ros1=self._ros1)
            header = getattr(message, "header", None)
            return read(message, 0.0 if header is None else stamped_s(header.stamp))
        except LogFormatError as error:
            raise LogFormatError(f"{topic}: {error}") from None
        except BROKEN as error:
            raise LogFormatError(f"{topic}: {one_line(error) or type(error).__name__}") from None

    def _mounted(self, camera: PinholeCamera | None) -> PinholeCamera | None:
        return camera if camera is None or self._mount is None else with_mount(camera, self._mount)


def _frame(pairing: Pairing, role: str, message: Any, t_s: float) -> RgbdFrame | None:
    return next((frame for frame, _ in pairing.take(role, message, t_s)), None)


def _odometry_messages(channel: str, odometry: Odometry, *, ros1: bool) -> list[RosMessage]:
    """Return the pose of an odometry, and the transforms of the chair and, in ROS 2, of the stair."""
    pose = FramePose(parent="odom", child=BASE, place_m=tuple(odometry.p_OB.tolist()), quaternion=odometry.orientation)
    moved = odometry_message(channel, odometry.t_s, pose, odometry.speed_m_s, odometry.angular_velocity_rad_s)
    poses = [pose]
    if not ros1 and odometry.X_OS is not None:
        R, p = odometry.X_OS
        poses.append(FramePose(parent="odom", child="stair", place_m=tuple(p.tolist()), quaternion=quaternion_of(R)))
    return [moved, frames_message("/tf", odometry.t_s, poses)]


def _sensors(camera: PinholeCamera, *, ros1: bool) -> list[FramePose]:
    """Return where on the chair the frames are that messages name; an IMU is read in the chair's axes."""
    level = [FramePose(parent=BASE, child=name, place_m=(0.0, 0.0, 0.0)) for name in ("chair", "imu")]
    if ros1:
        return [*level, FramePose(parent=BASE, child=CAMERA, place_m=camera.mount_m, quaternion=quaternion_of(camera.R_BC))]
    return [*level, *camera_frames(camera)]


def _odometry(message: Any, t_s: float) -> Odometry:
    place, q, turned = message.pose.pose.position, message.pose.pose.orientation, message.twist.twist.angular
    return Odometry(
        t_s=t_s,
        p_OB=np.array([place.x, place.y, place.z]),
        orientation=(q.w, q.x, q.y, q.z),
        speed_m_s=message.twist.twist.linear.x,
        angular_velocity_rad_s=(turned.x, turned.y, turned.z),
    )


def _diagnosis(message: Any, t_s: float) -> on.Beat | Event:
    (found,) = message.status
    if found.hardware_id == NODE:
        return on.Beat(t_s=t_s, node=found.name, state=found.message)
    return Event(t_s=t_s, name=found.name, cause=found.message)


def _guard_status(message: Any, t_s: float) -> on.GuardState:
    (found,) = message.status
    return on.GuardState(t_s=t_s, holding=found.message if found.level else None, sender=found.hardware_id)


def _guard_state(message: Any, t_s: float) -> on.GuardState:
    return on.GuardState(t_s=t_s, holding=message.holding or None, source=SOURCES[message.source], sender=message.sender)


def velocity_of(twist: Any, t_s: float = 0.0) -> VelocityCommand:
    """Return the command in a geometry_msgs/Twist; without a stamp, which ROS writes as zero, its time is NaN."""
    return VelocityCommand(t_s=t_s or math.nan, speed_m_s=twist.linear.x, turn_rad_s=twist.angular.z)


_READERS: dict[tuple[str, str], Callable[[Any, float], Any]] = {
    (on.CLOCK, on.CLOCK_TYPE): lambda message, _: on.Clock(t_s=stamped_s(message.clock)),
    (on.TWIST, on.TWIST_TYPE): lambda message, _: velocity_of(message),
    (on.TWIST, on.TWIST_STAMPED): lambda message, t_s: velocity_of(message.twist, t_s),
    (on.ODOM, ODOMETRY): _odometry,
    (on.DIAGNOSTICS, STATUS): _diagnosis,
    (on.GUARD, STATUS): _guard_status,
    (on.GUARD, on.GUARD_TYPE): _guard_state,
}
"""Decoder of a topic that only nodes exchange, by name and type."""


def _reader(topic: str, kind: str) -> Callable[[Any, float], Any]:
    """Return the decoder of a topic: that of a log's topic of this name, or of messages that only nodes exchange."""
    name = topic.removesuffix(DETAIL)
    known = _READERS.get((topic, kind)) or signal_reader(on.LIKE.get(name, name) + topic[len(name) :], kind)
    assert known is not None, f"{topic} of {kind} has no decoder"  # noqa: S101 - the tests construct each channel's
    return known
