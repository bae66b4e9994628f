"""Signals out of the ROS 2 messages that ``messages`` writes: the way back, for replay and for scoring.

A pose and its ``…/detail`` say one thing twice; the detail is exact, so only it is read. A frame is whole when its
calibration has come. The camera's mount is not in a ``CameraInfo``: it comes back as zero.
"""

import struct
from collections.abc import Callable
from typing import Any

import numpy as np

from treadline.errors import LogFormatError
from treadline.io.cdr import HEADER
from treadline.io.messages import TRUTH_NAMES
from treadline.ports import Truth
from treadline.signals import (
    Event,
    HeadingEstimate,
    HeadingMeasurement,
    ImuSample,
    OperatorInput,
    PinholeCamera,
    RgbdFrame,
    SeatCommand,
    SeatReading,
    TrackCommand,
    TrackReading,
)


class CdrReader:
    """Takes values off a message one after the other; never beyond its end."""

    def __init__(self, data: bytes) -> None:
        if data[:4] != HEADER:
            raise LogFormatError("a message is not little-endian CDR")
        self._data = data[4:]
        self._at = 0

    def take(self, size: int) -> bytes:
        """Return the next bytes."""
        if size > len(self._data) - self._at:
            raise LogFormatError("a message ends before its last field")
        self._at += size
        return self._data[self._at - size : self._at]

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
        """Return the next sequence of 64-bit floats; an empty one is not aligned."""
        count = self.uint32()
        return self.doubles(count) if count else ()

    def string(self) -> str:
        """Return the next string."""
        return self.take(self.uint32())[:-1].decode()

    def stamp(self) -> tuple[float, str]:
        """Return the time and the frame of the next std_msgs/Header."""
        self._align(4)
        seconds, nanoseconds = struct.unpack("<iI", self.take(8))
        return (seconds * 1_000_000_000 + nanoseconds) / 1e9, self.string()

    def _align(self, size: int) -> None:
        self._at += -self._at % size


class Decoder:
    """Turns messages into signals; holds the two images of a frame until its calibration comes."""

    def __init__(self) -> None:
        self._images: dict[str, tuple[float, np.ndarray]] = {}

    def signal(self, topic: str, data: bytes) -> Any | None:
        """Return the signal that a message completes, or None."""
        if topic in IMAGES:
            self._images[topic] = _image(data, *IMAGES[topic])
            return None
        if topic == "/camera/color/camera_info":
            return self._frame(data)
        read = _READERS.get(topic)
        return None if read is None else read(data)

    def _frame(self, data: bytes) -> RgbdFrame:
        t_s, camera = _camera(data)
        images = [self._images.get(topic) for topic in IMAGES]
        for image in images:
            if image is None or image[0] != t_s or image[1].shape[:2] != (camera.height_px, camera.width_px):
                raise LogFormatError(f"the calibration at {t_s} s has no images of its time and size")
        (_, rgb), (_, depth) = (image for image in images if image is not None)
        return RgbdFrame(t_s=t_s, rgb=rgb, depth_m=depth, camera=camera)


IMAGES: dict[str, tuple[str, np.dtype[Any], tuple[int, ...]]] = {
    "/camera/color/image_raw": ("rgb8", np.dtype(np.uint8), (3,)),
    "/camera/depth/image_rect": ("32FC1", np.dtype("<f4"), ()),
}
"""Encoding, number type and channels of each image topic."""


def _image(data: bytes, encoding: str, kind: np.dtype[Any], channels: tuple[int, ...]) -> tuple[float, np.ndarray]:
    r = CdrReader(data)
    t_s, _ = r.stamp()
    height, width, found = r.uint32(), r.uint32(), r.string()
    r.uint8()
    r.uint32()
    pixels = r.take(r.uint32())
    if found != encoding or len(pixels) != height * width * kind.itemsize * int(np.prod(channels, initial=1)):
        raise LogFormatError(f"an image of {width} x {height} '{found}' holds {len(pixels)} bytes; '{encoding}' is read")
    return t_s, np.frombuffer(pixels, kind).reshape(height, width, *channels)


def _camera(data: bytes) -> tuple[float, PinholeCamera]:
    r = CdrReader(data)
    t_s, _ = r.stamp()
    height, width = r.uint32(), r.uint32()
    r.string()
    r.sequence()
    fx, _, cx, _, fy, cy, *_ = r.doubles(9)
    return t_s, PinholeCamera(width_px=width, height_px=height, fx_px=fx, fy_px=fy, cx_px=cx, cy_px=cy)


def _joints(data: bytes, count: int, *, velocity: bool) -> tuple[float, str, tuple[float, ...]]:
    """Return time, frame and the ``count`` numbers that matter of a JointState."""
    r = CdrReader(data)
    t_s, frame = r.stamp()
    for _ in range(r.uint32()):
        r.string()
    position, rate = r.sequence(), r.sequence()
    values = rate if velocity else position
    if len(values) != count:
        raise LogFormatError(f"a JointState holds {len(values)} numbers where {count} belong")
    return t_s, frame, values


def _imu(data: bytes) -> ImuSample:
    r = CdrReader(data)
    t_s, _ = r.stamp()
    values = np.array(r.doubles(4 + 9 + 3 + 9 + 3))
    return ImuSample(
        t_s=t_s,
        orientation=values[[3, 0, 1, 2]],
        angular_velocity_rad_s=values[13:16],
        linear_acceleration_m_s2=values[25:28],
    )


def _event(data: bytes) -> Event:
    r = CdrReader(data)
    t_s, _ = r.stamp()
    if r.uint32() != 1:
        raise LogFormatError("a DiagnosticArray of treadline holds one status")
    r.uint8()
    return Event(t_s=t_s, name=r.string(), cause=r.string())


def _belts(data: bytes) -> tuple[float, float, float, bool]:
    t_s, _, speeds = _joints(data, 3, velocity=True)
    _, _, places = _joints(data, 3, velocity=False)
    return t_s, speeds[0], speeds[1], bool(places[2])


def _track_command(data: bytes) -> TrackCommand:
    t_s, left, right, brake = _belts(data)
    return TrackCommand(t_s=t_s, left_m_s=left, right_m_s=right, brake=brake)


def _track_reading(data: bytes) -> TrackReading:
    t_s, left, right, brake = _belts(data)
    return TrackReading(t_s=t_s, left_m_s=left, right_m_s=right, brake_on=brake)


def _seat_command(data: bytes) -> SeatCommand:
    t_s, _, (rate,) = _joints(data, 1, velocity=True)
    return SeatCommand(t_s=t_s, rate_m_s=rate)


def _seat_reading(data: bytes) -> SeatReading:
    t_s, _, (stroke, pitch) = _joints(data, 2, velocity=False)
    return SeatReading(t_s=t_s, pitch_rad=pitch, stroke_m=stroke)


def _operator(data: bytes) -> OperatorInput:
    t_s, _, (dead_man, stop, rearm) = _joints(data, 3, velocity=False)
    return OperatorInput(t_s=t_s, dead_man=bool(dead_man), stop=bool(stop), rearm=bool(rearm))


def _estimate(data: bytes) -> HeadingEstimate:
    t_s, source, (heading, rate, sigma) = _joints(data, 3, velocity=False)
    return HeadingEstimate(t_s=t_s, heading_rad=heading, heading_rate_rad_s=rate, sigma_rad=sigma, source=source)


def _measurement(data: bytes) -> HeadingMeasurement:
    t_s, _, (heading, sigma, count) = _joints(data, 3, velocity=False)
    return HeadingMeasurement(t_s=t_s, heading_rad=heading, sigma_rad=sigma, edge_count=int(count))


def _truth(data: bytes) -> Truth:
    t_s, _, values = _joints(data, len(TRUTH_NAMES), velocity=False)
    return Truth(t_s=t_s, **dict(zip(TRUTH_NAMES, values, strict=True)))


_READERS: dict[str, Callable[[bytes], Any]] = {
    "/imu": _imu,
    "/tracks/cmd": _track_command,
    "/tracks/state": _track_reading,
    "/seat/cmd": _seat_command,
    "/seat/state": _seat_reading,
    "/operator": _operator,
    "/stair/heading/detail": _estimate,
    "/stair/heading_measured/detail": _measurement,
    "/diagnostics": _event,
    "/truth": _truth,
}
