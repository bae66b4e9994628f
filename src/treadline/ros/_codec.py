"""Signals as ROS messages and back, channel by channel: the same fields for ROS 1 and ROS 2."""

import struct
from collections.abc import Callable
from typing import Any

import numpy as np

from treadline.core.camera_images import PinholeCamera
from treadline.core.errors import ImageError, LogFormatError
from treadline.core.rotations import quaternion_of
from treadline.core.signals import Event, HeadingFault, HeadingHealth
from treadline.io.cdr import CdrWriter, Ros1Writer, nanoseconds_of
from treadline.io.decode import (
    BETWEEN,
    HEADINGS,
    OURS,
    CdrReader,
    DiagnosticStatus,
    Ros1Reader,
    calibration,
    one_of,
    picture,
    status,
)
from treadline.io.messages import Message, Writer, joints, messages_of
from treadline.io.messages import status as status_message
from treadline.io.scene_messages import BASE, FramePose, frames_message, odometry_message
from treadline.io.topics import Frames, Topics, with_mount
from treadline.mission.odometry import Odometry
from treadline.ros import channels as on
from treadline.ros._node_signals import Beat, Clock, GuardState, JointAngles, Mounts, VelocityCommand

NODE = "node"
"""Hardware id of a heartbeat in a diagnostic message."""
LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
"""Quaternion of a frame parallel to its parent."""
AHEAD = 8
"""Largest number of images buffered until their depth or colour image arrives on its own connection."""
MILLIMETRE = 0.001
"""Depth per count of a 16-bit depth image [m], the convention of ROS drivers."""

BROKEN = (ImageError, ValueError, LookupError, ArithmeticError, struct.error)
"""Errors of a reader that the bytes of a message cause: text that is no UTF-8, missing names, numbers out of range."""


def encoded(channel: str, signal: Any, *, ros1: bool) -> list[Message]:
    """Return the messages that hold a signal."""
    writer: Writer = Ros1Writer if ros1 else CdrWriter
    match signal:
        case Clock():
            w = writer()
            nanoseconds = nanoseconds_of(signal.t_s)
            w.int32(nanoseconds // 1_000_000_000)
            w.uint32(nanoseconds % 1_000_000_000)
            return [(channel, on.CHANNELS[on.CLOCK].topics[0].kind, w.message())]
        case VelocityCommand():
            w = writer()
            w.doubles(signal.speed_m_s, 0.0, 0.0, 0.0, 0.0, signal.turn_rad_s)
            return [(channel, on.CHANNELS[on.TWIST].topics[0].kind, w.message())]
        case Beat():
            status_fields = (int(signal.state != "ready"), signal.node, signal.state, NODE)
            return [status_message(channel, signal.t_s, status_fields, {}, signal.node, writer)]
        case GuardState():
            status_fields = (0 if signal.holding is None else 2, "guard", signal.holding or "", signal.sender)
            return [status_message(channel, signal.t_s, status_fields, {}, "guard", writer)]
        case Odometry():
            return _odometry_messages(channel, signal, writer)
        case JointAngles():
            return [joints(channel, signal.t_s, signal.names, signal.angles_rad, (), "chair", writer)]
        case Mounts():
            return [frames_message(channel, signal.t_s, _sensors(signal.camera), writer)]
        case HeadingHealth():
            return [_health_message(channel, signal, writer)]
        case _:
            return messages_of(signal, channel, writer)


class Decoder:
    """Decoder of one channel: messages to signals. Depth and colour image of a frame are paired here.

    Args:
        mount: Camera with the mount on the chair, which a ``CameraInfo`` does not hold.
    """

    def __init__(self, channel: str, *, ros1: bool, mount: PinholeCamera | None = None) -> None:
        self._channel = channel
        self._reader: type[CdrReader] = Ros1Reader if ros1 else CdrReader
        self._mount = mount
        self._readers: dict[str, Callable[[CdrReader], Any]] = _READERS.get(channel, {})
        if channel == on.CAMERA:
            color, depth, info = (topic.name for topic in on.CHANNELS[channel].topics)
            frames = Frames(Topics(depth=depth, color=color, info=info), (0, 0), MILLIMETRE, self._mounted, ahead=AHEAD)
            self._readers = {
                color: lambda r: frames.color(picture(r)),
                depth: lambda r: frames.depth(picture(r)),
                info: lambda r: frames.calibrate(calibration(r)[1]),
            }

    def signal(self, topic: str, data: bytes) -> Any | None:
        """Return the signal that a message completes, or None.

        Raises:
            LogFormatError: If the bytes are no message of this topic, or an image cannot be used. Errors of other kinds are errors
                of this program.
        """
        read, reader = self._readers[topic], self._reader
        try:
            return read(reader(data))
        except LogFormatError as error:
            raise LogFormatError(f"{topic}: {error}") from None
        except BROKEN as error:
            raise LogFormatError(f"{topic}: {' '.join(str(error).split())[:200] or type(error).__name__}") from None

    def _mounted(self, camera: PinholeCamera | None, size: tuple[int, int]) -> PinholeCamera | None:
        del size
        return camera if camera is None or self._mount is None else with_mount(camera, self._mount)


def _odometry_messages(channel: str, odometry: Odometry, writer: Writer) -> list[Message]:
    """Return the pose and the transform of an odometry."""
    pose = FramePose(parent="odom", child=BASE, place_m=tuple(odometry.p_OB.tolist()), quaternion=odometry.orientation)
    moved = odometry_message(channel, odometry.t_s, pose, odometry.speed_m_s, odometry.angular_velocity_rad_s, writer)
    return [moved, frames_message("/tf", odometry.t_s, [pose], writer)]


def _sensors(camera: PinholeCamera) -> list[FramePose]:
    """Return where on the chair the frames are that messages name; an IMU is read in the chair's axes."""
    optical = FramePose(parent=BASE, child="camera", place_m=camera.mount_m, quaternion=quaternion_of(camera.R_BC))
    return [*(FramePose(parent=BASE, child=name, place_m=(0.0, 0.0, 0.0), quaternion=LEVEL) for name in ("chair", "imu")), optical]


def _odometry(r: CdrReader) -> Odometry:
    t_s, _ = r.stamp()
    r.string()
    values = r.doubles(7 + 36 + 6 + 36)
    x, y, z, w = values[3:7]
    return Odometry(
        t_s=t_s,
        p_OB=np.array(values[:3]),
        orientation=(w, x, y, z),
        speed_m_s=values[43],
        angular_velocity_rad_s=(values[46], values[47], values[48]),
    )


OF_HEALTH = ("disagreement_rad", "unseen_s", "bias_rad_s", "scale", "walk_rad_rts")
"""Numbers of a filter's health that are always known."""


def _health_message(channel: str, health: HeadingHealth, writer: Writer) -> Message:
    numbers = {name: getattr(health, name) for name in ("since_s", *OF_HEALTH)}
    values = {name: repr(float(value)) for name, value in numbers.items() if value is not None}
    status_fields = (int(health.fault is not None), health.fault or "", health.cause or "", "heading filter")
    return status_message(channel, health.t_s, status_fields, values, "stair", writer)


def _health(r: CdrReader) -> HeadingHealth:
    received = status(r)
    numbers = {name: float(value) for name, value in received.values.items()}
    return HeadingHealth(
        t_s=received.t_s,
        fault=one_of(HeadingFault, received.name) if received.name else None,
        since_s=numbers.get("since_s"),
        cause=received.message or None,
        **{name: numbers[name] for name in OF_HEALTH},
    )


def _diagnosis(r: CdrReader) -> Beat | Event:
    received: DiagnosticStatus = status(r)
    if received.hardware == NODE:
        return Beat(t_s=received.t_s, node=received.name, state=received.message)
    return Event(t_s=received.t_s, name=received.name, cause=received.message)


def _guard_state(r: CdrReader) -> GuardState:
    received = status(r)
    return GuardState(t_s=received.t_s, holding=received.message if received.level else None, sender=received.hardware)


def _drive(r: CdrReader) -> VelocityCommand:
    speed, _, _, _, _, turn = r.doubles(6)
    return VelocityCommand(speed_m_s=speed, turn_rad_s=turn)


_KNOWN = {name: read for name, (_, read) in (OURS | BETWEEN).items()}
_READERS: dict[str, dict[str, Callable[[CdrReader], Any]]] = {
    **{
        channel: {topic.name: _KNOWN[topic.name] for topic in form.topics if topic.read and topic.name in _KNOWN}
        for channel, form in on.CHANNELS.items()
    },
    on.CLOCK: {on.CLOCK: lambda r: Clock(t_s=r.time())},
    on.TWIST: {on.TWIST: _drive},
    on.ODOM: {on.ODOM: _odometry},
    on.DIAGNOSTICS: {on.DIAGNOSTICS: _diagnosis},
    on.GUARD: {on.GUARD: _guard_state},
    on.HEALTH: {on.HEALTH: _health},
    on.CAMERA_QUALITY: {on.CAMERA_QUALITY: _KNOWN[on.QUALITY]},
    on.CAMERA_HEADING: {f"{on.CAMERA_HEADING}/detail": _KNOWN[HEADINGS]},
    on.CAMERA_MAP: {f"{on.CAMERA_MAP}/detail": _KNOWN[f"{on.MAP}/detail"]},
    on.TRACKS_PROPOSED: {on.TRACKS_PROPOSED: _KNOWN[on.TRACKS_CMD]},
    on.SEAT_PROPOSED: {on.SEAT_PROPOSED: _KNOWN[on.SEAT_CMD]},
}
"""Reader of each topic of a channel: that of a log's topic of this name, or one for messages that only nodes exchange."""
