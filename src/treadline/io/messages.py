"""ROS 2 messages of what a run's log holds: topic, type and bytes for each signal.

The types are the standard ones, so that Foxglove, PlotJuggler and ``ros2 bag`` open the log. Belts, seat and truth are
``JointState``: names beside numbers. What a pose cannot hold (rate, σ, source) goes to a companion ``…/detail``.
"""

import math
from collections.abc import Callable
from dataclasses import fields
from typing import Any

import numpy as np

from treadline.io.cdr import CdrWriter
from treadline.ports import Truth
from treadline.signals import (
    ArmCommand,
    ArmReading,
    Event,
    HeadingEstimate,
    HeadingMeasurement,
    ImuSample,
    OperatorInput,
    RgbdFrame,
    SeatCommand,
    SeatReading,
    TrackCommand,
    TrackReading,
)

Message = tuple[str, str, bytes]
"""Topic, type, bytes."""

_TIME = "builtin_interfaces/Time"
_HEADER = f"MSG: std_msgs/Header\n{_TIME} stamp\nstring frame_id"
_STAMP = f"MSG: {_TIME}\nint32 sec\nuint32 nanosec"
_VECTOR = "MSG: geometry_msgs/Vector3\nfloat64 x\nfloat64 y\nfloat64 z"
_QUATERNION = "MSG: geometry_msgs/Quaternion\nfloat64 x\nfloat64 y\nfloat64 z\nfloat64 w"
_RULE = "\n" + "=" * 80 + "\n"


def _definition(body: str, *parts: str) -> str:
    return _RULE.join((body, *parts, _HEADER, _STAMP))


DEFINITIONS = {
    "sensor_msgs/msg/JointState": _definition(
        "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort"
    ),
    "sensor_msgs/msg/Imu": _definition(
        "std_msgs/Header header\ngeometry_msgs/Quaternion orientation\nfloat64[9] orientation_covariance\n"
        "geometry_msgs/Vector3 angular_velocity\nfloat64[9] angular_velocity_covariance\n"
        "geometry_msgs/Vector3 linear_acceleration\nfloat64[9] linear_acceleration_covariance",
        _QUATERNION,
        _VECTOR,
    ),
    "geometry_msgs/msg/PoseWithCovarianceStamped": _definition(
        "std_msgs/Header header\ngeometry_msgs/PoseWithCovariance pose",
        "MSG: geometry_msgs/PoseWithCovariance\ngeometry_msgs/Pose pose\nfloat64[36] covariance",
        "MSG: geometry_msgs/Pose\ngeometry_msgs/Point position\ngeometry_msgs/Quaternion orientation",
        "MSG: geometry_msgs/Point\nfloat64 x\nfloat64 y\nfloat64 z",
        _QUATERNION,
    ),
    "sensor_msgs/msg/Image": _definition(
        "std_msgs/Header header\nuint32 height\nuint32 width\nstring encoding\nuint8 is_bigendian\nuint32 step\nuint8[] data"
    ),
    "sensor_msgs/msg/CameraInfo": _definition(
        "std_msgs/Header header\nuint32 height\nuint32 width\nstring distortion_model\nfloat64[] d\nfloat64[9] k\n"
        "float64[9] r\nfloat64[12] p\nuint32 binning_x\nuint32 binning_y\nsensor_msgs/RegionOfInterest roi",
        "MSG: sensor_msgs/RegionOfInterest\nuint32 x_offset\nuint32 y_offset\nuint32 height\nuint32 width\nbool do_rectify",
    ),
    "diagnostic_msgs/msg/DiagnosticArray": _definition(
        "std_msgs/Header header\ndiagnostic_msgs/DiagnosticStatus[] status",
        "MSG: diagnostic_msgs/DiagnosticStatus\nbyte level\nstring name\nstring message\nstring hardware_id\n"
        "diagnostic_msgs/KeyValue[] values",
        "MSG: diagnostic_msgs/KeyValue\nstring key\nstring value",
    ),
}
"""Field lists by type, as ROS 2 defines them."""

TRUTH_NAMES = tuple(item.name for item in fields(Truth) if item.name != "t_s")


def messages_of(signal: Any) -> list[Message]:
    """Return the messages that hold a signal."""
    kind = next(kind for kind in type(signal).__mro__ if kind in _WRITERS)
    return _WRITERS[kind](signal)


def joints(
    topic: str, t_s: float, names: tuple[str, ...], position: tuple[float, ...], velocity: tuple[float, ...], frame: str
) -> Message:
    """Return a JointState."""
    w = CdrWriter()
    w.stamp(t_s, frame)
    w.uint32(len(names))
    for name in names:
        w.string(name)
    for values in (position, velocity, ()):
        w.uint32(len(values))
        if values:
            w.doubles(*values)
    return topic, "sensor_msgs/msg/JointState", w.message()


def _imu(sample: ImuSample) -> list[Message]:
    w = CdrWriter()
    w.stamp(sample.t_s, "imu")
    qw, qx, qy, qz = sample.orientation.tolist()
    zeros = [0.0] * 9
    w.doubles(qx, qy, qz, qw, *zeros, *sample.angular_velocity_rad_s.tolist(), *zeros)
    w.doubles(*sample.linear_acceleration_m_s2.tolist(), *zeros)
    return [("/imu", "sensor_msgs/msg/Imu", w.message())]


def _heading(topic: str, t_s: float, heading_rad: float, sigma_rad: float) -> Message:
    w = CdrWriter()
    w.stamp(t_s, "stair")
    covariance = [0.0] * 36
    covariance[35] = sigma_rad * sigma_rad
    w.doubles(0.0, 0.0, 0.0, 0.0, 0.0, math.sin(0.5 * heading_rad), math.cos(0.5 * heading_rad), *covariance)
    return topic, "geometry_msgs/msg/PoseWithCovarianceStamped", w.message()


def _estimate(estimate: HeadingEstimate) -> list[Message]:
    topic = "/stair/heading"
    values = (estimate.heading_rad, estimate.heading_rate_rad_s, estimate.sigma_rad)
    names = ("heading_rad", "heading_rate_rad_s", "sigma_rad")
    return [
        _heading(topic, estimate.t_s, estimate.heading_rad, estimate.sigma_rad),
        joints(topic + "/detail", estimate.t_s, names, values, (), estimate.source),
    ]


def _measurement(seen: HeadingMeasurement) -> list[Message]:
    topic = "/stair/heading_measured"
    values = (seen.heading_rad, seen.sigma_rad, float(seen.edge_count))
    return [
        _heading(topic, seen.t_s, seen.heading_rad, seen.sigma_rad),
        joints(topic + "/detail", seen.t_s, ("heading_rad", "sigma_rad", "edge_count"), values, (), "camera"),
    ]


def _tracks(topic: str, t_s: float, left_m_s: float, right_m_s: float, *, brake: bool) -> list[Message]:
    velocity = (left_m_s, right_m_s, 0.0)
    return [joints(topic, t_s, ("left", "right", "brake"), (0.0, 0.0, float(brake)), velocity, "chair")]


def _event(event: Event) -> list[Message]:
    w = CdrWriter()
    w.stamp(event.t_s, "guard")
    w.uint32(1)
    w.uint8(2 if event.name == "hold" else 1)
    w.string(event.name)
    w.string(event.cause)
    w.string("treadline")
    w.uint32(0)
    return [("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray", w.message())]


def _frame(frame: RgbdFrame) -> list[Message]:
    return [
        _image("/camera/color/image_raw", frame.t_s, frame.rgb, "rgb8", 3),
        _image("/camera/depth/image_rect", frame.t_s, frame.depth_m, "32FC1", 4),
        _camera_info(frame),
    ]


def _image(topic: str, t_s: float, pixels: np.ndarray, encoding: str, bytes_per_pixel: int) -> Message:
    w = CdrWriter()
    w.stamp(t_s, "camera")
    height, width = pixels.shape[:2]
    w.uint32(height)
    w.uint32(width)
    w.string(encoding)
    w.uint8(0)
    w.uint32(width * bytes_per_pixel)
    w.raw(np.ascontiguousarray(pixels).tobytes())
    return topic, "sensor_msgs/msg/Image", w.message()


def _camera_info(frame: RgbdFrame) -> Message:
    camera = frame.camera
    w = CdrWriter()
    w.stamp(frame.t_s, "camera")
    w.uint32(camera.height_px)
    w.uint32(camera.width_px)
    w.string("plumb_bob")
    w.uint32(5)
    w.doubles(*[0.0] * 5)
    fx, fy, cx, cy = camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px
    w.doubles(fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0)
    w.doubles(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
    w.doubles(fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0)
    for _ in range(6):
        w.uint32(0)
    w.uint8(0)
    return "/camera/color/camera_info", "sensor_msgs/msg/CameraInfo", w.message()


def _truth(truth: Truth) -> list[Message]:
    values = tuple(float(getattr(truth, name)) for name in TRUTH_NAMES)
    return [joints("/truth", truth.t_s, TRUTH_NAMES, values, (), "simulator")]


_WRITERS: dict[type, Callable[[Any], list[Message]]] = {
    ImuSample: _imu,
    RgbdFrame: _frame,
    HeadingMeasurement: _measurement,
    HeadingEstimate: _estimate,
    Event: _event,
    Truth: _truth,
    TrackCommand: lambda s: _tracks("/tracks/cmd", s.t_s, s.left_m_s, s.right_m_s, brake=s.brake),
    TrackReading: lambda s: _tracks("/tracks/state", s.t_s, s.left_m_s, s.right_m_s, brake=s.brake_on),
    SeatCommand: lambda s: [joints("/seat/cmd", s.t_s, ("stroke",), (), (s.rate_m_s,), "chair")],
    SeatReading: lambda s: [joints("/seat/state", s.t_s, ("stroke", "pitch"), (s.stroke_m, s.pitch_rad), (), "chair")],
    ArmCommand: lambda s: [joints("/arm/cmd", s.t_s, ("arm",), (), (s.rate_rad_s,), "chair")],
    ArmReading: lambda s: [joints("/arm/state", s.t_s, ("angle", "torque"), (s.angle_rad, s.torque_n_m), (), "chair")],
    OperatorInput: lambda s: [
        joints(
            "/operator",
            s.t_s,
            ("dead_man", "stop", "rearm"),
            (float(s.dead_man), float(s.stop), float(s.rearm)),
            (),
            "operator",
        )
    ],
}
