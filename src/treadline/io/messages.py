"""Signals as messages of ROS 2 and back: topic, type and values, for run logs and between nodes.

What is ours travels in ``treadline_msgs``, whose fields have the names of the signals' own; images, IMU, poses and diagnostics are
standard types. ``standard_messages`` has the standard types that ROS 1, and logs of release 0.3 and before, hold for the rest.

A missing value is NaN in a message, or an empty text, and None in a signal.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import fields
from functools import cache
from operator import attrgetter
from typing import Any, Literal, NamedTuple, get_args, get_origin, get_type_hints

import numpy as np

from treadline.core import signals
from treadline.core.camera_images import PinholeCamera, RgbdFrame
from treadline.core.errors import LogFormatError
from treadline.core.ports import Truth
from treadline.io.message_types import PACKAGE, RosMessage, stamp, store

Write = Callable[[Any, str], list[RosMessage]]


IMAGE, CAMERA_INFO, IMU = "sensor_msgs/msg/Image", "sensor_msgs/msg/CameraInfo", "sensor_msgs/msg/Imu"
JOINTS, STATUS = "sensor_msgs/msg/JointState", "diagnostic_msgs/msg/DiagnosticArray"
COMPRESSED = "sensor_msgs/msg/CompressedImage"
TRUTH_NAMES = tuple(item.name for item in fields(Truth) if item.name != "t_s")
"""Names of the ground-truth quantities in a log."""


class _Own(NamedTuple):
    """How a signal travels in ``treadline_msgs``: its default topic, the name of its message type, the frame in the header."""

    topic: str
    message: str
    frame: str = "base_link"
    end: str = ""
    """What the topic of a message adds to the default topic, on which ROS 1 and logs of release 0.3 have a pose for viewers."""

    @property
    def kind(self) -> str:
        """Message type as ROS 2 writes it."""
        return f"{PACKAGE}/msg/{self.message}"

    @property
    def read(self) -> str:
        """Topic of the message, which a reader of logs needs."""
        return self.topic + self.end


DETAIL = "/detail"
OWN: dict[type, _Own] = {
    signals.TrackCommand: _Own("/tracks/cmd", "BeltCommand"),
    signals.TrackReading: _Own("/tracks/state", "BeltState"),
    signals.SeatCommand: _Own("/seat/cmd", "SeatCommand"),
    signals.SeatReading: _Own("/seat/state", "SeatState"),
    signals.FlipperCommand: _Own("/flipper/cmd", "FlipperCommand"),
    signals.FlipperReading: _Own("/flipper/state", "FlipperState"),
    signals.OperatorInput: _Own("/operator", "OperatorInput"),
    signals.PlantState: _Own("/plant/state", "PlantState"),
    signals.FrameQuality: _Own("/camera/quality", "FrameQuality"),
    signals.FreeGround: _Own("/ground", "FreeGround"),
    signals.HeadingMeasurement: _Own("/stair/heading_measured", "StairHeadingMeasurement", "stair", DETAIL),
    signals.HeadingEstimate: _Own("/stair/heading", "StairHeading", "stair", DETAIL),
    signals.HeadingHealth: _Own("/stair/heading/health", "HeadingHealth"),
    signals.StairMap: _Own("/stair/map", "StairMap", end=DETAIL),
    signals.MotionPlan: _Own("/plan", "MotionPlan"),
    Truth: _Own("/truth", "Truth", "world"),
}
SIGNALS = {own.kind: signal for signal, own in OWN.items()}
"""Signal of each message type of ``treadline_msgs``."""


@cache
class Form:
    """Encoder and decoder of a signal whose message has its fields by name, after the header.

    Args:
        signal: Type of the signal, a key of ``OWN``.
    """

    def __init__(self, signal: type) -> None:
        self._signal = signal
        self._frame, self.kind = OWN[signal].frame, OWN[signal].kind
        constants, described = store().fielddefs[self.kind]
        self._fields = tuple(name for name, _ in described[1:])
        self._names = tuple(_RENAMED.get(name, name) for name in self._fields)
        self._values: Callable[[Any], Any] = attrgetter(*self._names)
        hints = get_type_hints(signal)
        known = {name: _converters(name, hints[name], constants) for name in self._names}
        self._converted = [(at, *both) for at, name in enumerate(self._names) if (both := known[name]) is not None]
        self._list = next((at for at, name in enumerate(self._names) if name in _POINTS), None)

    def message(self, signal: Any, topic: str) -> RosMessage:
        """Return the message of a signal."""
        found = self._values(signal)
        values = list(found) if len(self._names) > 1 else [found]
        for at, write, _ in self._converted:
            values[at] = write(values[at])
        if self._list is None:
            return RosMessage(topic, self.kind, (*stamp(signal.t_s), self._frame, *values))
        count = len(values[self._list]) // 3
        values[self._list : self._list + 1] = [count, *values[self._list]]
        return RosMessage(topic, self.kind, (*stamp(signal.t_s), self._frame, *values), (count,))

    def decode(self, message: Any, t_s: float) -> Any:
        """Return the signal of a message."""
        values = [getattr(message, name) for name in self._fields]
        for at, _, read in self._converted:
            values[at] = read(values[at])
        found = dict(zip(self._names, values, strict=True))
        if isinstance(found.get("flipper"), float):
            found["flipper"] = signals.FlipperCommand(t_s=t_s, rate_rad_s=found["flipper"])
        return self._signal(t_s=t_s, **found)


_RENAMED = {"nosings": "nosings_B", "sides": "sides_B", "flipper_rad_s": "flipper"}
"""Fields of messages whose signals have another name for them."""
_POINTS = ("nosings_B", "sides_B")
"""Fields of signals that are lists of points."""
_Converters = tuple[Callable[[Any], Any], Callable[[Any], Any]]


def _converters(name: str, hint: Any, constants: Sequence[tuple[str, str, int]]) -> _Converters | None:
    """Return how a value enters a message and leaves it; None if as it is."""
    if name in _POINTS:
        return (lambda places: [float(x) for place in places for x in place]), lambda points: tuple((p.x, p.y, p.z) for p in points)
    if name == "flipper":
        return (lambda flipper: math.nan if flipper is None else flipper.rate_rad_s), _known
    kinds = get_args(hint) if type(None) in get_args(hint) else (hint,)
    if any(get_origin(kind) is Literal for kind in kinds):
        prefix = name.rpartition("_")[2].upper() + "_"
        numbers: dict[str | None, int] = {
            word.removeprefix(prefix).lower(): number for word, _, number in constants if word.startswith(prefix)
        }
        if type(None) in kinds:
            numbers = {word: number for word, number in numbers.items() if number} | {None: 0}
        words = {number: word for word, number in numbers.items()}
        return numbers.__getitem__, lambda number: _word(words, number)
    if type(None) not in kinds:
        return None
    if str in kinds:
        return (lambda text: text or ""), lambda text: text or None
    return (lambda value: math.nan if value is None else value), _known


def _known(value: float) -> float | None:
    return None if math.isnan(value) else value


def _word(words: dict[int, str | None], number: int) -> str | None:
    if number not in words:
        known = ", ".join(f"{number} {word}" for number, word in words.items())
        raise LogFormatError(f"unknown value {number}; known: {known}; is it of another version?")
    return words[number]


def messages_of(signal: Any, topic: str | None = None) -> list[RosMessage]:
    """Return the messages of a signal, on the default topic of its type unless ``topic`` is given."""
    own, write = _known_type(signal)
    return write(signal, topic or own)


def topic_of(signal: Any) -> str:
    """Return the default topic of a signal's type."""
    return _known_type(signal)[0]


def _own(signal: Any, topic: str) -> list[RosMessage]:
    kind: type = type(signal)
    return [Form(kind).message(signal, topic + OWN[kind].end)]


def joints(
    topic: str, t_s: float, names: Sequence[str], position: Sequence[float], velocity: Sequence[float], frame: str
) -> RosMessage:
    """Return a JointState message."""
    counts = len(names), len(position), len(velocity), 0
    values = (*stamp(t_s), frame, counts[0], *names, counts[1], *position, counts[2], *velocity, 0)
    return RosMessage(topic, JOINTS, values, counts)


def status(topic: str, t_s: float, header: tuple[int, str, str, str], values: dict[str, str], frame: str) -> RosMessage:
    """Return a DiagnosticArray with one status: level, name, message and hardware, and values by key."""
    pairs = [text for pair in values.items() for text in pair]
    return RosMessage(topic, STATUS, (*stamp(t_s), frame, 1, *header, len(values), *pairs), (1, len(values)))


_UNKNOWN = (0.0,) * 9
"""Covariance that is not known."""


def _imu(sample: signals.ImuSample, topic: str) -> list[RosMessage]:
    qw, *q = sample.orientation
    rate, force = sample.angular_velocity_rad_s, sample.linear_acceleration_m_s2
    return [RosMessage(topic, IMU, (*stamp(sample.t_s), "imu", *q, qw, *_UNKNOWN, *rate, *_UNKNOWN, *force, *_UNKNOWN))]


def _event(event: signals.Event, topic: str) -> list[RosMessage]:
    level = 2 if event.name == "hold" else 1
    return [status(topic, event.t_s, (level, event.name, event.cause, "treadline"), {}, "guard")]


CAMERA, REAR_CAMERA = "camera", "rear_camera"
"""Names of the cameras in the chair's URDF."""


def camera_name(camera: PinholeCamera) -> str:
    """Return the name in the URDF of the camera that has this mount: by the side to which it looks."""
    return CAMERA if camera.R_BC[0, 2] >= 0.0 else REAR_CAMERA


def optical_frame(camera: str) -> str:
    """Return the name of a camera's optical frame: x right, y down, z forward."""
    return f"{camera}_optical_frame"


def images_of(frame: RgbdFrame, topic: str, frame_id: str | None = None) -> list[RosMessage]:
    """Return colour and depth image of a frame and their calibration; without ``frame_id`` in the camera's optical frame."""
    frame_id = frame_id or optical_frame(camera_name(frame.camera))
    return [
        _image(topic + "/color/image_raw", frame.t_s, frame_id, frame.rgb, "rgb8"),
        _image(topic + "/depth/image_rect", frame.t_s, frame_id, frame.depth_m, "32FC1"),
        _camera_info(topic + "/color/camera_info", frame.t_s, frame_id, frame.camera),
    ]


def _image(topic: str, t_s: float, frame_id: str, pixels: np.ndarray, encoding: str) -> RosMessage:
    height, width = pixels.shape[:2]
    data = np.ascontiguousarray(pixels).tobytes()
    return RosMessage(topic, IMAGE, (*stamp(t_s), frame_id, height, width, encoding, 0, len(data) // height, data))


def _camera_info(topic: str, t_s: float, frame_id: str, camera: PinholeCamera) -> RosMessage:
    fx, fy, cx, cy = camera.pinhole
    k = (fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0)
    r = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
    p = (fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0)
    size = (camera.height_px, camera.width_px)
    values = (*size, "plumb_bob", 5, *(0.0,) * 5, *k, *r, *p, *(0,) * 6, False)
    return RosMessage(topic, CAMERA_INFO, (*stamp(t_s), frame_id, *values), (5,))


def _known_type(signal: Any) -> tuple[str, Write]:
    """Return topic and writer of a signal's type; a plant may have its own subclass of a frame."""
    known = _WRITERS.get(type(signal))
    return next(_WRITERS[kind] for kind in type(signal).__mro__ if kind in _WRITERS) if known is None else known


_WRITERS: dict[type, tuple[str, Write]] = {
    **{signal: (own.topic, _own) for signal, own in OWN.items()},
    signals.ImuSample: ("/imu", _imu),
    RgbdFrame: ("/camera", images_of),
    signals.Event: ("/diagnostics", _event),
}
