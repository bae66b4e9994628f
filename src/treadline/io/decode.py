"""Messages as readings, for replay and scoring: images, calibrations and IMUs of any publisher, and treadline's own topics.

A frame is complete after its calibration message. A ``CameraInfo`` message does not include the camera mount, so decoded mounts are
zero.
"""

from typing import Any, NamedTuple

import numpy as np

from treadline.core.camera_images import PinholeCamera, RgbdFrame
from treadline.core.errors import LogFormatError
from treadline.core.signals import ImuSample
from treadline.io.message_types import message_of, stamped_s
from treadline.io.messages import CAMERA_INFO, IMAGE, IMU, SIGNALS, form_of
from treadline.io.standard_messages import STANDARD, Read

HEADINGS, EVENTS = "/stair/heading_measured/detail", "/diagnostics"
"""Topics of recorded heading measurements and of events."""
LOOKED = frozenset({"/camera/quality", "/ground", "/stair/map/detail"})
"""Topics of frame results besides the heading, for logs without images and for cameras with their own detector."""
OURS = frozenset({
    "/imu", "/tracks/cmd", "/tracks/state", "/seat/cmd", "/seat/state", "/flipper/cmd", "/flipper/state", "/arm/cmd", "/arm/state",
    "/operator", "/plant/state", "/stair/heading/detail", HEADINGS, EVENTS, "/truth",
})  # fmt: skip
"""Other topics of a run log except images; ``/arm`` is from logs of release 0.1."""


def signal_reader(topic: str, kind: str) -> Read | None:
    """Return the decoder of a topic's messages to signals, from message and stamp [s]; None if the type means something else."""
    if kind in SIGNALS:
        return form_of(SIGNALS[kind]).decode
    return imu if kind == IMU else STANDARD.get((topic, kind))


class LogDecoder:
    """Decoder of a run's own messages; holds the two images of a frame until the calibration message arrives."""

    def __init__(self) -> None:
        self._images: dict[str, Picture] = {}

    def signal(self, topic: str, kind: str, data: bytes) -> Any | None:
        """Return the signal completed by a message, or None."""
        read = signal_reader(topic, kind) if topic in OURS or topic in LOOKED else None
        if read is None and topic not in (*IMAGES, INFO):
            return None
        message = message_of(kind, data)
        t_s = stamped_s(message.header.stamp)
        if read is not None:
            return read(message, t_s)
        if kind != (CAMERA_INFO if topic == INFO else IMAGE):
            raise LogFormatError(f"{topic} holds {kind}")
        if topic == INFO:
            return self._frame(t_s, calibration(message))
        self._images[topic] = picture(message, t_s)
        return None

    def _frame(self, t_s: float, camera: PinholeCamera) -> RgbdFrame:
        size = camera.height_px, camera.width_px
        for topic, encoding in IMAGES.items():
            image = self._images.get(topic)
            if image is None or (image.t_s, image.encoding, image.pixels.shape[:2]) != (t_s, encoding, size):
                raise LogFormatError(f"the calibration at {t_s} s has no '{encoding}' image of its time and size on {topic}")
        rgb, depth = (self._images[topic].pixels for topic in IMAGES)
        return RgbdFrame(t_s=t_s, rgb=rgb, depth_m=depth, camera=camera)


IMAGES, INFO = {"/camera/color/image_raw": "rgb8", "/camera/depth/image_rect": "32FC1"}, "/camera/color/camera_info"
"""Image topics of a run log with their encodings, and the topic of their calibration."""


class Picture(NamedTuple):
    """Image of one message."""

    t_s: float
    encoding: str
    pixels: np.ndarray


ENCODINGS: dict[str, tuple[str, int]] = {
    **dict.fromkeys(("rgb8", "bgr8", "8UC3"), ("u1", 3)),
    **dict.fromkeys(("rgba8", "bgra8"), ("u1", 4)),
    **dict.fromkeys(("mono8", "8UC1"), ("u1", 1)),
    **dict.fromkeys(("mono16", "16UC1"), ("u2", 1)),
    "32FC1": ("f4", 1),
}
"""Number type and number of channels of the supported encodings."""


def picture(message: Any, t_s: float) -> Picture:
    """Return the image in a sensor_msgs/Image."""
    height, width, encoding, step = message.height, message.width, message.encoding, message.step
    if encoding not in ENCODINGS:
        raise LogFormatError(f"unsupported image encoding '{encoding[:40]}'; supported: {', '.join(ENCODINGS)}")
    number, channels = ENCODINGS[encoding]
    kind = np.dtype((">" if message.is_bigendian else "<") + number)
    row = width * channels * kind.itemsize
    if not 0 < row <= step or height == 0 or len(message.data) != height * step:
        raise LogFormatError(f"an image of {width}×{height} '{encoding}' holds {len(message.data)} bytes in rows of {step}")
    rows = message.data.reshape(height, step)
    values = np.ascontiguousarray(rows[:, :row]).view(kind)
    return Picture(t_s, encoding, values.reshape((height, width, channels) if channels > 1 else (height, width)))


def calibration(message: Any) -> PinholeCamera:
    """Return the camera of a sensor_msgs/CameraInfo."""
    matrix = message.K if hasattr(message, "K") else message.k  # ROS 1 and 2
    fx, _, cx, _, fy, cy = matrix[:6].tolist()
    return PinholeCamera(width_px=message.width, height_px=message.height, fx_px=fx, fy_px=fy, cx_px=cx, cy_px=cy)


def imu(message: Any, t_s: float) -> ImuSample:
    """Return the sample in a sensor_msgs/Imu; an orientation marked as not measured is a zero quaternion."""
    q, rate, force = message.orientation, message.angular_velocity, message.linear_acceleration
    return ImuSample(
        t_s=t_s,
        orientation=(0.0, 0.0, 0.0, 0.0) if message.orientation_covariance[0] == -1.0 else (q.w, q.x, q.y, q.z),
        angular_velocity_rad_s=(rate.x, rate.y, rate.z),
        linear_acceleration_m_s2=(force.x, force.y, force.z),
    )
