"""Decoding of ROS messages into signals, for replay and scoring: the inverse of ``messages``.

Standard messages (image, calibration, IMU) of any publisher are read, also in ROS 1 serialisation.

A pose and its ``…/detail`` contain the same values; only the exact detail is read. A frame is complete after its calibration
message. A ``CameraInfo`` message does not include the camera mount, so decoded mounts are zero.
"""

import struct
from collections.abc import Callable
from typing import Any, Literal, NamedTuple, get_args

import numpy as np

from treadline.core.camera_images import PinholeCamera, RgbdFrame
from treadline.core.errors import LogFormatError
from treadline.core.ports import Truth
from treadline.core.signals import (
    BUTTONS,
    Event,
    FlipperCommand,
    FlipperReading,
    FrameQuality,
    FreeGround,
    HeadingEstimate,
    HeadingMeasurement,
    ImuSample,
    MotionPlan,
    OperatorInput,
    Phase,
    PlantState,
    SeatCommand,
    SeatReading,
    Source,
    StairMap,
    TrackCommand,
    TrackReading,
    View,
)
from treadline.io.cdr import HEADER, seconds_of
from treadline.io.messages import MAYBE_OF_GROUND, MAYBE_OF_MAP, TRUTH_NAMES


class CdrReader:
    """Sequential reader of the fields of one message; never reads beyond its end."""

    def __init__(self, data: bytes, *, origin_ns: int = 0, logged_ns: int = 0) -> None:
        """Start reading a message whose time ``origin_ns`` is zero on the mission clock."""
        if data[:4] != HEADER:
            raise LogFormatError("a message is not little-endian CDR")
        self._data = data[4:]
        self._at = 0
        self._origin_ns = origin_ns
        self._logged_ns = logged_ns

    def take(self, size: int) -> bytes:
        """Return the next ``size`` bytes."""
        if size > len(self._data) - self._at:
            raise LogFormatError("a message ends before its last field")
        self._at += size
        return self._data[self._at - size : self._at]

    @property
    def offset(self) -> int:
        """Number of bytes read so far, the encapsulation header included."""
        return self._at + len(HEADER)

    def uint8(self) -> int:
        """Return the next byte."""
        return self.take(1)[0]

    def uint32(self) -> int:
        """Return the next unsigned 32-bit integer."""
        self._align(4)
        value: int = struct.unpack("<I", self.take(4))[0]
        return value

    def doubles(self, count: int) -> tuple[float, ...]:
        """Return the next 64-bit floats."""
        self._align(8)
        return struct.unpack(f"<{count}d", self.take(8 * count))

    def sequence(self) -> tuple[float, ...]:
        """Return the next sequence of 64-bit floats; an empty sequence has no alignment padding."""
        count = self.uint32()
        return self.doubles(count) if count else ()

    def string(self) -> str:
        """Return the next string."""
        return self.take(self.uint32())[:-1].decode()

    def time(self) -> float:
        """Return the next time; a zero stamp is replaced by the log time."""
        self._align(4)
        seconds, nanoseconds = struct.unpack("<iI", self.take(8))
        time_ns = seconds * 1_000_000_000 + nanoseconds or self._logged_ns
        return seconds_of(time_ns - self._origin_ns)

    def stamp(self) -> tuple[float, str]:
        """Return time and frame name of the next std_msgs/Header."""
        return self.time(), self.string()

    def _align(self, size: int) -> None:
        self._at += -self._at % size


class Ros1Reader(CdrReader):
    """Sequential reader of one ROS 1 message: no alignment, strings without terminating zero, headers with a sequence number."""

    def __init__(self, data: bytes, *, origin_ns: int = 0, logged_ns: int = 0) -> None:
        super().__init__(HEADER + data, origin_ns=origin_ns, logged_ns=logged_ns)

    def string(self) -> str:
        """Return the next string."""
        return self.take(self.uint32()).decode()

    def stamp(self) -> tuple[float, str]:
        """Return time and frame name of the next std_msgs/Header."""
        self.uint32()
        return super().stamp()

    def _align(self, size: int) -> None:
        pass


class LogDecoder:
    """Decoder of a run's own messages; holds the two images of a frame until the calibration message arrives."""

    def __init__(self) -> None:
        self._images: dict[str, Picture] = {}

    def signal(self, topic: str, data: bytes) -> Any | None:
        """Return the signal completed by a message, or None."""
        if topic in IMAGES:
            self._images[topic] = picture(CdrReader(data))
            if self._images[topic].encoding != IMAGES[topic]:
                raise LogFormatError(f"{topic} has the encoding '{self._images[topic].encoding}'; '{IMAGES[topic]}' is required")
            return None
        if topic == "/camera/color/camera_info":
            return self._frame(CdrReader(data))
        read = (OURS | LOOKED).get(topic)
        return None if read is None else read[1](CdrReader(data))

    def _frame(self, r: CdrReader) -> RgbdFrame:
        t_s, camera = calibration(r)
        rgb, depth = (self._images.get(topic) for topic in IMAGES)
        for image in (rgb, depth):
            if image is None or image.t_s != t_s or image.pixels.shape[:2] != (camera.height_px, camera.width_px):
                raise LogFormatError(f"the calibration at {t_s} s has no images of its time and size")
        assert rgb is not None  # noqa: S101 - for the type checker
        assert depth is not None  # noqa: S101 - the same
        return RgbdFrame(t_s=t_s, rgb=rgb.pixels, depth_m=depth.pixels, camera=camera)


IMAGES = {"/camera/color/image_raw": "rgb8", "/camera/depth/image_rect": "32FC1"}
"""Image topics of a run log with their encodings."""


class Picture(NamedTuple):
    """Image of one message."""

    t_s: float
    encoding: str
    pixels: np.ndarray


ENCODINGS: dict[str, tuple[str, int]] = {
    "rgb8": ("u1", 3),
    "bgr8": ("u1", 3),
    "8UC3": ("u1", 3),
    "rgba8": ("u1", 4),
    "bgra8": ("u1", 4),
    "mono8": ("u1", 1),
    "8UC1": ("u1", 1),
    "mono16": ("u2", 1),
    "16UC1": ("u2", 1),
    "32FC1": ("f4", 1),
}
"""Number type and number of channels of the supported encodings."""


def picture(r: CdrReader) -> Picture:
    """Return the image in a sensor_msgs/Image."""
    t_s, height, width, encoding = heading_of_image(r)
    if encoding not in ENCODINGS:
        raise LogFormatError(f"unsupported image encoding '{encoding[:40]}'; supported: {', '.join(ENCODINGS)}")
    number, channels = ENCODINGS[encoding]
    kind = np.dtype((">" if r.uint8() else "<") + number)
    step, pixels = r.uint32(), r.take(r.uint32())
    row = width * channels * kind.itemsize
    if not 0 < row <= step or height == 0 or len(pixels) != height * step:
        raise LogFormatError(f"an image of {width}×{height} '{encoding}' holds {len(pixels)} bytes in rows of {step}")
    rows = np.frombuffer(pixels, np.uint8).reshape(height, step)
    values = np.ascontiguousarray(rows[:, :row]).view(kind)
    return Picture(t_s, encoding, values.reshape((height, width, channels) if channels > 1 else (height, width)))


def compressed_picture(r: CdrReader) -> tuple[float, bytes]:
    """Return time and file content of the image in a sensor_msgs/CompressedImage."""
    t_s, _ = r.stamp()
    r.string()
    return t_s, r.take(r.uint32())


def heading_of_image(r: CdrReader) -> tuple[float, int, int, str]:
    """Return the fields before the pixels of an image: time, height, width, encoding."""
    t_s, _ = r.stamp()
    return t_s, r.uint32(), r.uint32(), r.string()


def calibration(r: CdrReader) -> tuple[float, PinholeCamera]:
    """Return time and camera of a sensor_msgs/CameraInfo."""
    t_s, _ = r.stamp()
    height, width = r.uint32(), r.uint32()
    r.string()
    r.sequence()
    fx, _, cx, _, fy, cy, *_ = r.doubles(9)
    return t_s, PinholeCamera(width_px=width, height_px=height, fx_px=fx, fy_px=fy, cx_px=cx, cy_px=cy)


def imu(r: CdrReader) -> ImuSample:
    """Return the sample in a sensor_msgs/Imu; an orientation marked as not measured is a zero quaternion."""
    t_s, _ = r.stamp()
    values = r.doubles(4 + 9 + 3 + 9 + 3)
    x, y, z, w, covariance = values[:5]
    return ImuSample(
        t_s=t_s,
        orientation=(0.0, 0.0, 0.0, 0.0) if covariance == -1.0 else (w, x, y, z),
        angular_velocity_rad_s=(values[13], values[14], values[15]),
        linear_acceleration_m_s2=(values[25], values[26], values[27]),
    )


def _joints(r: CdrReader) -> tuple[float, str, tuple[float, ...], tuple[float, ...]]:
    """Return time, frame, positions and velocities of a JointState."""
    t_s, frame = r.stamp()
    for _ in range(r.uint32()):
        r.string()
    return t_s, frame, r.sequence(), r.sequence()


def _named(r: CdrReader) -> tuple[float, str, dict[str, float]]:
    """Return time, frame and positions by name of a JointState."""
    t_s, frame = r.stamp()
    names = [r.string() for _ in range(r.uint32())]
    return t_s, frame, dict(zip(names, _counted(r.sequence(), len(names)), strict=True))


def _counted(values: tuple[float, ...], count: int) -> tuple[float, ...]:
    if len(values) != count:
        raise LogFormatError(f"a JointState holds {len(values)} numbers; {count} are required")
    return values


def one_of(words: Any, word: str) -> Any:
    """Return a word after checking for membership in a ``Literal``."""
    known = get_args(words)
    if word not in known:
        raise LogFormatError(f"unknown value '{word[:40]}'; known: {', '.join(known)}; is it of another version?")
    return word


class DiagnosticStatus(NamedTuple):
    """Single status of a DiagnosticArray written by ``messages``."""

    t_s: float
    level: int
    name: str
    message: str
    hardware: str
    values: dict[str, str]


def status(r: CdrReader) -> DiagnosticStatus:
    """Return the status in a diagnostic_msgs/DiagnosticArray."""
    t_s, _ = r.stamp()
    if r.uint32() != 1:
        raise LogFormatError("a DiagnosticArray of treadline holds one status")
    level, name, message, hardware = r.uint8(), r.string(), r.string(), r.string()
    return DiagnosticStatus(t_s, level, name, message, hardware, {r.string(): r.string() for _ in range(r.uint32())})


def _event(r: CdrReader) -> Event:
    found = status(r)
    return Event(t_s=found.t_s, name=found.name, cause=found.message)


def _plant_state(r: CdrReader) -> PlantState:
    found = status(r)
    return PlantState(t_s=found.t_s, fault=found.message if found.level else None)


def _belts(r: CdrReader) -> tuple[float, str, float, float, bool]:
    t_s, frame, places, speeds = _joints(r)
    left, right, _ = _counted(speeds, 3)
    return t_s, frame, left, right, bool(_counted(places, 3)[2])


def _track_command(r: CdrReader) -> TrackCommand:
    t_s, sender, left, right, brake = _belts(r)
    return TrackCommand(t_s=t_s, left_m_s=left, right_m_s=right, brake=brake, sender=sender)


def _track_reading(r: CdrReader) -> TrackReading:
    t_s, _, left, right, brake = _belts(r)
    return TrackReading(t_s=t_s, left_m_s=left, right_m_s=right, brake_on=brake)


def _flipper_command(r: CdrReader) -> FlipperCommand:
    t_s, sender, _, rates = _joints(r)
    return FlipperCommand(t_s=t_s, rate_rad_s=_counted(rates, 1)[0], sender=sender)


def _flipper_reading(r: CdrReader) -> FlipperReading:
    t_s, _, places, _ = _joints(r)
    angle, torque = _counted(places, 2)
    return FlipperReading(t_s=t_s, angle_rad=angle, torque_n_m=torque)


def _seat_command(r: CdrReader) -> SeatCommand:
    t_s, sender, _, speeds = _joints(r)
    return SeatCommand(t_s=t_s, rate_m_s=_counted(speeds, 1)[0], sender=sender)


def _seat_reading(r: CdrReader) -> SeatReading:
    t_s, _, places, _ = _joints(r)
    stroke, pitch = _counted(places, 2)
    return SeatReading(t_s=t_s, pitch_rad=pitch, stroke_m=stroke)


def _operator(r: CdrReader) -> OperatorInput:
    t_s, _, places, _ = _joints(r)
    # A handset, or a log, of version 0.3 reports the switch, stop and re-arm alone.
    pressed = places if len(places) == 3 else _counted(places, 1 + len(BUTTONS))
    names = ("dead_man", *BUTTONS)
    return OperatorInput(t_s=t_s, **{name: bool(place) for name, place in zip(names, pressed, strict=False)})


def _estimate(r: CdrReader) -> HeadingEstimate:
    t_s, source, places, _ = _joints(r)
    heading, rate, sigma = _counted(places, 3)
    return HeadingEstimate(t_s=t_s, heading_rad=heading, heading_rate_rad_s=rate, sigma_rad=sigma, source=one_of(Source, source))


def _measurement(r: CdrReader) -> HeadingMeasurement:
    t_s, _, places, _ = _joints(r)
    # Logs of release 0.2 and before hold no correction.
    heading, sigma, count, correction = _counted((*places, 0.0) if len(places) == 3 else places, 4)
    return HeadingMeasurement(t_s=t_s, heading_rad=heading, sigma_rad=sigma, edge_count=int(count), correction_rad=correction)


ADDED_TRUTH = ("hull_contacts", "chassis_x_m", "chassis_y_m", "chassis_z_m")
"""Ground-truth quantities that older logs lack; they are read as the defaults of ``Truth``."""


def _truth(r: CdrReader) -> Truth:
    t_s, _, values = _named(r)
    missing = [name for name in TRUTH_NAMES if name not in ADDED_TRUTH and name not in values]
    if missing:
        raise LogFormatError(f"the ground truth lacks {missing[0]}; is it of another version?")
    return Truth(t_s=t_s, **{name: values[name] for name in TRUTH_NAMES if name in values})


def _quality(r: CdrReader) -> FrameQuality:
    t_s, _, values = _named(r)
    return FrameQuality(
        t_s=t_s,
        fingerprint=int(values["fingerprint"]),
        brightness=values["brightness"],
        contrast=values["contrast"],
        valid_share=values["valid_share"],
        obstacle_m=values.get("obstacle_m"),
    )


def _ground(r: CdrReader) -> FreeGround:
    t_s, view, values = _named(r)
    maybe = {name: values.get(name) for name in MAYBE_OF_GROUND}
    return FreeGround(t_s=t_s, view=one_of(View, view), blind_m=values["blind_m"], seen_m=values["seen_m"], **maybe)


def _plan(r: CdrReader) -> MotionPlan:
    found = status(r)
    values = found.values
    flipper = (
        FlipperCommand(t_s=float(values["flipper_t_s"]), rate_rad_s=float(values["flipper_rad_s"]))
        if "flipper_t_s" in values
        else None
    )
    return MotionPlan(
        t_s=found.t_s,
        phase=one_of(Phase, found.name),
        speed_m_s=float(values["speed_m_s"]),
        turn_m_s=float(values["turn_m_s"]) if "turn_m_s" in values else None,
        heading_rad=float(values["heading_rad"]),
        min_inner_speed_ratio=float(values["min_inner_speed_ratio"]) if "min_inner_speed_ratio" in values else None,
        pitch_feedforward_m_s=float(values.get("pitch_feedforward_m_s", 0.0)),
        flipper=flipper,
        needs_stair=values["needs_stair"] == "True",
        cause=found.message,
        hold=values.get("hold"),
    )


def _stair_map(r: CdrReader) -> StairMap:
    t_s, direction, values = _named(r)
    names = (f"nosing{i}" for i in range(int(values.pop("nosings"))))
    nosings = [(values.pop(f"{name}_x_m"), values.pop(f"{name}_y_m"), values.pop(f"{name}_z_m")) for name in names]
    seen = {name: values.pop(name, None) for name in MAYBE_OF_MAP}
    return StairMap(
        t_s=t_s,
        direction=one_of(Literal["up", "down"], direction),
        nosings_B=tuple(nosings),
        rise_m=values["rise_m"],
        run_m=values["run_m"],
        slope_rad=values["slope_rad"],
        ends=bool(values["ends"]),
        left_side=_side_of(values.pop("left_open", None)),
        right_side=_side_of(values.pop("right_open", None)),
        **seen,
    )


def _side_of(is_open: float | None) -> Literal["wall", "open"] | None:
    if is_open is None:
        return None
    return "open" if is_open else "wall"


IMU = "sensor_msgs/msg/Imu"
JOINTS = "sensor_msgs/msg/JointState"
HEADINGS = "/stair/heading_measured/detail"
"""Topic of recorded heading measurements."""
EVENTS = "/diagnostics"
OURS: dict[str, tuple[str, Callable[[CdrReader], Any]]] = {
    "/imu": (IMU, imu),
    "/tracks/cmd": (JOINTS, _track_command),
    "/tracks/state": (JOINTS, _track_reading),
    "/seat/cmd": (JOINTS, _seat_command),
    "/seat/state": (JOINTS, _seat_reading),
    "/flipper/cmd": (JOINTS, _flipper_command),
    "/flipper/state": (JOINTS, _flipper_reading),
    "/arm/cmd": (JOINTS, _flipper_command),  # logs of release 0.1
    "/arm/state": (JOINTS, _flipper_reading),
    "/operator": (JOINTS, _operator),
    "/plant/state": ("diagnostic_msgs/msg/DiagnosticArray", _plant_state),
    "/stair/heading/detail": (JOINTS, _estimate),
    HEADINGS: (JOINTS, _measurement),
    EVENTS: ("diagnostic_msgs/msg/DiagnosticArray", _event),
    "/truth": (JOINTS, _truth),
}
"""Topics of a run log except images: message type and reader."""
LOOKED: dict[str, tuple[str, Callable[[CdrReader], Any]]] = {
    "/camera/quality": (JOINTS, _quality),
    "/ground": (JOINTS, _ground),
    "/stair/map/detail": (JOINTS, _stair_map),
}
"""Topics of frame results besides the heading, for logs without images and for cameras with their own detector."""
BETWEEN: dict[str, tuple[str, Callable[[CdrReader], Any]]] = LOOKED | {"/plan": ("diagnostic_msgs/msg/DiagnosticArray", _plan)}
"""Topics of ``LOOKED`` and topics used only between nodes."""
