"""ROS messages of signals, for run logs and for communication between nodes: topic, type and bytes.

The types are standard ROS types, so that Foxglove, PlotJuggler and ``ros2 bag`` can open a log. Belts, seat and ground truth are
``JointState`` messages: names with numbers. Values without a place in a pose (rate, σ, source) are sent on a companion topic
``…/detail``. The bytes are CDR (ROS 2), or ROS 1 with ``Ros1Writer``; the fields are identical.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import fields
from functools import cache, lru_cache
from operator import attrgetter
from typing import Any

import numpy as np

from treadline.core.camera_images import RgbdFrame
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
    PlantState,
    SeatCommand,
    SeatReading,
    StairMap,
    TrackCommand,
    TrackReading,
)
from treadline.io.cdr import CdrWriter, MessageForm

Message = tuple[str, str, bytes]
"""Topic, type, bytes."""

_TIME = "builtin_interfaces/Time"
_HEADER = f"MSG: std_msgs/Header\n{_TIME} stamp\nstring frame_id"
_STAMP = f"MSG: {_TIME}\nint32 sec\nuint32 nanosec"
_VECTOR = "MSG: geometry_msgs/Vector3\nfloat64 x\nfloat64 y\nfloat64 z"
_QUATERNION = "MSG: geometry_msgs/Quaternion\nfloat64 x\nfloat64 y\nfloat64 z\nfloat64 w"
_COMPRESSED = "string format\nuint8[] data"
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
    "geometry_msgs/msg/PoseArray": _definition(
        "std_msgs/Header header\ngeometry_msgs/Pose[] poses",
        "MSG: geometry_msgs/Pose\ngeometry_msgs/Point position\ngeometry_msgs/Quaternion orientation",
        "MSG: geometry_msgs/Point\nfloat64 x\nfloat64 y\nfloat64 z",
        _QUATERNION,
    ),
    "nav_msgs/msg/Odometry": _definition(
        "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/PoseWithCovariance pose\n"
        "geometry_msgs/TwistWithCovariance twist",
        "MSG: geometry_msgs/PoseWithCovariance\ngeometry_msgs/Pose pose\nfloat64[36] covariance",
        "MSG: geometry_msgs/TwistWithCovariance\ngeometry_msgs/Twist twist\nfloat64[36] covariance",
        "MSG: geometry_msgs/Pose\ngeometry_msgs/Point position\ngeometry_msgs/Quaternion orientation",
        "MSG: geometry_msgs/Twist\ngeometry_msgs/Vector3 linear\ngeometry_msgs/Vector3 angular",
        "MSG: geometry_msgs/Point\nfloat64 x\nfloat64 y\nfloat64 z",
        _VECTOR,
        _QUATERNION,
    ),
    "tf2_msgs/msg/TFMessage": _definition(
        "geometry_msgs/TransformStamped[] transforms",
        "MSG: geometry_msgs/TransformStamped\nstd_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform",
        "MSG: geometry_msgs/Transform\ngeometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation",
        _VECTOR,
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
    "std_msgs/msg/String": "string data",
    "sensor_msgs/msg/CompressedImage": _definition(f"std_msgs/Header header\n{_COMPRESSED}"),
    "visualization_msgs/msg/MarkerArray": _definition(
        "visualization_msgs/Marker[] markers",
        "MSG: visualization_msgs/Marker\nstd_msgs/Header header\nstring ns\nint32 id\nint32 type\nint32 action\n"
        "geometry_msgs/Pose pose\ngeometry_msgs/Vector3 scale\nstd_msgs/ColorRGBA color\n"
        "builtin_interfaces/Duration lifetime\nbool frame_locked\ngeometry_msgs/Point[] points\nstd_msgs/ColorRGBA[] colors\n"
        "string texture_resource\nsensor_msgs/CompressedImage texture\nvisualization_msgs/UVCoordinate[] uv_coordinates\n"
        "string text\nstring mesh_resource\nvisualization_msgs/MeshFile mesh_file\nbool mesh_use_embedded_materials",
        "MSG: geometry_msgs/Pose\ngeometry_msgs/Point position\ngeometry_msgs/Quaternion orientation",
        "MSG: geometry_msgs/Point\nfloat64 x\nfloat64 y\nfloat64 z",
        "MSG: std_msgs/ColorRGBA\nfloat32 r\nfloat32 g\nfloat32 b\nfloat32 a",
        "MSG: builtin_interfaces/Duration\nint32 sec\nuint32 nanosec",
        f"MSG: sensor_msgs/CompressedImage\nstd_msgs/Header header\n{_COMPRESSED}",
        "MSG: visualization_msgs/UVCoordinate\nfloat32 u\nfloat32 v",
        "MSG: visualization_msgs/MeshFile\nstring filename\nuint8[] data",
        _VECTOR,
        _QUATERNION,
    ),
    "diagnostic_msgs/msg/DiagnosticArray": _definition(
        "std_msgs/Header header\ndiagnostic_msgs/DiagnosticStatus[] status",
        "MSG: diagnostic_msgs/DiagnosticStatus\nbyte level\nstring name\nstring message\nstring hardware_id\n"
        "diagnostic_msgs/KeyValue[] values",
        "MSG: diagnostic_msgs/KeyValue\nstring key\nstring value",
    ),
}
"""Message definitions by type, in ROS 2 notation."""

TRUTH_NAMES = tuple(item.name for item in fields(Truth) if item.name != "t_s")
"""Names of the ground-truth quantities in a log."""

Writer = Callable[[], CdrWriter]
"""Class of a writer: selects ROS 1 or ROS 2 serialisation."""


def messages_of(signal: Any, topic: str | None = None, writer: Writer = CdrWriter) -> list[Message]:
    """Return the messages of a signal, on the default topic of its type unless ``topic`` is given."""
    own, write = _known(signal)
    return write(signal, topic or own, writer)


def topic_of(signal: Any) -> str:
    """Return the default topic of a signal's type."""
    return _known(signal)[0]


def joints(
    topic: str,
    t_s: float,
    names: tuple[str, ...],
    position: tuple[float, ...],
    velocity: tuple[float, ...],
    frame: str,
    writer: Writer = CdrWriter,
) -> Message:
    """Return a JointState message."""
    form = _joints_form(names, len(position), len(velocity), frame, writer)
    return topic, "sensor_msgs/msg/JointState", form.pack(t_s, position, velocity)


@lru_cache(maxsize=512)  # a log has some twenty; the maps of nosings have one for each set of measured quantities
def _joints_form(names: tuple[str, ...], positions: int, velocities: int, frame: str, writer: Writer) -> MessageForm:
    w = writer()
    w.open_time()
    w.string(frame)
    w.uint32(len(names))
    for name in names:
        w.string(name)
    for count in (positions, velocities):
        w.uint32(count)
        w.open_doubles(count)
    w.uint32(0)
    return w.form()


def status(
    topic: str,
    t_s: float,
    header: tuple[int, str, str, str],
    values: Mapping[str, str],
    frame: str,
    writer: Writer = CdrWriter,
) -> Message:
    """Return a DiagnosticArray with one status: level, name, message and hardware, and values by key."""
    level, *texts = header
    w = writer()
    w.stamp(t_s, frame)
    w.uint32(1)
    w.uint8(level)
    for text in texts:
        w.string(text)
    w.uint32(len(values))
    for key, value in values.items():
        w.string(key)
        w.string(value)
    return topic, "diagnostic_msgs/msg/DiagnosticArray", w.message()


@cache
def _imu_form(writer: Writer) -> MessageForm:
    unknown = [0.0] * 9
    w = writer()
    w.open_time()
    w.string("imu")
    w.open_doubles(4)
    w.doubles(*unknown)
    w.open_doubles(3)
    w.doubles(*unknown)
    w.open_doubles(3)
    w.doubles(*unknown)
    return w.form()


def _imu(sample: ImuSample, topic: str, writer: Writer) -> list[Message]:
    qw, *q = sample.orientation
    rate, force = sample.angular_velocity_rad_s, sample.linear_acceleration_m_s2
    return [(topic, "sensor_msgs/msg/Imu", _imu_form(writer).pack(sample.t_s, (*q, qw), rate, force))]


@cache
def _heading_form(writer: Writer) -> MessageForm:
    w = writer()
    w.open_time()
    w.string("stair")
    w.doubles(*[0.0] * 5)
    w.open_doubles(2)
    w.doubles(*[0.0] * 35)
    w.open_doubles(1)
    return w.form()


def _heading(topic: str, t_s: float, heading_rad: float, sigma_rad: float, writer: Writer) -> Message:
    half = 0.5 * heading_rad
    data = _heading_form(writer).pack(t_s, (math.sin(half), math.cos(half)), (sigma_rad * sigma_rad,))
    return topic, "geometry_msgs/msg/PoseWithCovarianceStamped", data


def _estimate(estimate: HeadingEstimate, topic: str, writer: Writer) -> list[Message]:
    values = (estimate.heading_rad, estimate.heading_rate_rad_s, estimate.sigma_rad)
    names = ("heading_rad", "heading_rate_rad_s", "sigma_rad")
    return [
        _heading(topic, estimate.t_s, estimate.heading_rad, estimate.sigma_rad, writer),
        joints(topic + "/detail", estimate.t_s, names, values, (), estimate.source, writer),
    ]


def _measurement(seen: HeadingMeasurement, topic: str, writer: Writer) -> list[Message]:
    values = (seen.heading_rad, seen.sigma_rad, float(seen.edge_count), seen.correction_rad)
    names = ("heading_rad", "sigma_rad", "edge_count", "correction_rad")
    return [
        _heading(topic, seen.t_s, seen.heading_rad, seen.sigma_rad, writer),
        joints(topic + "/detail", seen.t_s, names, values, (), "camera", writer),
    ]


MAYBE_OF_MAP = ("left_wall_m", "right_wall_m", "obstacle_m", "left_edge_m", "right_edge_m", "left_seen_m", "right_seen_m")
"""Numbers of a stair map that a frame may not show."""


def _sides(stair: StairMap) -> tuple[tuple[str, str | None], ...]:
    return (("left", stair.left_side), ("right", stair.right_side))


def _stair_map(stair: StairMap, topic: str, writer: Writer) -> list[Message]:
    w = writer()
    w.stamp(stair.t_s, "chair")
    w.uint32(len(stair.nosings_B))
    for place in stair.nosings_B:
        w.doubles(*place, 0.0, 0.0, 0.0, 1.0)
    # Quantities without a measurement are left out, so that no number encodes "unknown".
    maybe = {name: getattr(stair, name) for name in MAYBE_OF_MAP}
    maybe |= {f"{name}_open": None if side is None else float(side == "open") for name, side in _sides(stair)}
    known = {"rise_m": stair.rise_m, "run_m": stair.run_m, "slope_rad": stair.slope_rad, "ends": float(stair.ends)}
    known |= {name: value for name, value in maybe.items() if value is not None} | {"nosings": float(len(stair.nosings_B))}
    for i, place in enumerate(stair.nosings_B):
        known |= {f"nosing{i}_{axis}_m": value for axis, value in zip("xyz", place, strict=True)}
    detail = joints(topic + "/detail", stair.t_s, tuple(known), tuple(known.values()), (), stair.direction, writer)
    return [(topic, "geometry_msgs/msg/PoseArray", w.message()), detail]


def _quality(quality: FrameQuality, topic: str, writer: Writer) -> list[Message]:
    values = {name: float(getattr(quality, name)) for name in ("fingerprint", "brightness", "contrast", "valid_share")}
    values |= {} if quality.obstacle_m is None else {"obstacle_m": quality.obstacle_m}
    return [joints(topic, quality.t_s, tuple(values), tuple(values.values()), (), "camera", writer)]


MAYBE_OF_GROUND = ("end_m", "end_sigma_m", "direction_rad", "direction_sigma_rad")
"""Numbers of the ground ahead that a frame may not show."""


def _ground(ground: FreeGround, topic: str, writer: Writer) -> list[Message]:
    maybe = {name: getattr(ground, name) for name in MAYBE_OF_GROUND}
    known = {"blind_m": ground.blind_m, "seen_m": ground.seen_m} | {
        name: value for name, value in maybe.items() if value is not None
    }
    return [joints(topic, ground.t_s, tuple(known), tuple(known.values()), (), ground.view, writer)]


def _plan(plan: MotionPlan, topic: str, writer: Writer) -> list[Message]:
    numbers = {"speed_m_s": plan.speed_m_s, "turn_m_s": plan.turn_m_s, "heading_rad": plan.heading_rad}
    numbers |= {"min_inner_speed_ratio": plan.min_inner_speed_ratio, "pitch_feedforward_m_s": plan.pitch_feedforward_m_s}
    numbers |= {} if plan.flipper is None else {"flipper_t_s": plan.flipper.t_s, "flipper_rad_s": plan.flipper.rate_rad_s}
    values = {name: repr(float(value)) for name, value in numbers.items() if value is not None}
    values |= {"needs_stair": str(plan.needs_stair)} | ({} if plan.hold is None else {"hold": plan.hold})
    return [status(topic, plan.t_s, (int(plan.hold is not None), plan.phase, plan.cause, "plan"), values, "chair", writer)]


def _track_command(command: TrackCommand, topic: str, writer: Writer) -> list[Message]:
    belts = (command.left_m_s, command.right_m_s)
    return [_tracks(topic, command.t_s, belts, command.sender, writer, brake=command.brake)]


def _track_reading(reading: TrackReading, topic: str, writer: Writer) -> list[Message]:
    return [_tracks(topic, reading.t_s, (reading.left_m_s, reading.right_m_s), "chair", writer, brake=reading.brake_on)]


def _tracks(topic: str, t_s: float, belts: tuple[float, float], frame: str, writer: Writer, *, brake: bool) -> Message:
    return joints(topic, t_s, ("left", "right", "brake"), (0.0, 0.0, float(brake)), (*belts, 0.0), frame, writer)


def _plant_state(state: PlantState, topic: str, writer: Writer) -> list[Message]:
    header = (0 if state.fault is None else 2, "plant", state.fault or "", "plant")
    return [status(topic, state.t_s, header, {}, "chair", writer)]


def _event(event: Event, topic: str, writer: Writer) -> list[Message]:
    level = 2 if event.name == "hold" else 1
    return [status(topic, event.t_s, (level, event.name, event.cause, "treadline"), {}, "guard", writer)]


def _frame(frame: RgbdFrame, topic: str, writer: Writer) -> list[Message]:
    return [
        _image(topic + "/color/image_raw", frame.t_s, frame.rgb, "rgb8", writer),
        _image(topic + "/depth/image_rect", frame.t_s, frame.depth_m, "32FC1", writer),
        _camera_info(frame, topic + "/color/camera_info", writer),
    ]


def _image(topic: str, t_s: float, pixels: np.ndarray, encoding: str, writer: Writer) -> Message:
    w = writer()
    w.stamp(t_s, "camera")
    height, width = pixels.shape[:2]
    w.uint32(height)
    w.uint32(width)
    w.string(encoding)
    w.uint8(0)
    w.uint32(pixels.nbytes // height)
    w.raw(np.ascontiguousarray(pixels).tobytes())
    return topic, "sensor_msgs/msg/Image", w.message()


def _camera_info(frame: RgbdFrame, topic: str, writer: Writer) -> Message:
    camera = frame.camera
    w = writer()
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
    return topic, "sensor_msgs/msg/CameraInfo", w.message()


def _truth(truth: Truth, topic: str, writer: Writer) -> list[Message]:
    return [joints(topic, truth.t_s, TRUTH_NAMES, attrgetter(*TRUTH_NAMES)(truth), (), "simulator", writer)]


def _operator(operator: OperatorInput, topic: str, writer: Writer) -> list[Message]:
    names = ("dead_man", *BUTTONS)
    values = tuple(float(getattr(operator, name)) for name in names)
    return [joints(topic, operator.t_s, names, values, (), "operator", writer)]


def _known(signal: Any) -> tuple[str, "_Write"]:
    """Return topic and writer of a signal's type; a plant may have its own subclass of a frame."""
    known = _WRITERS.get(type(signal))
    return next(_WRITERS[kind] for kind in type(signal).__mro__ if kind in _WRITERS) if known is None else known


_Write = Callable[[Any, str, Writer], list[Message]]
_WRITERS: dict[type, tuple[str, _Write]] = {
    ImuSample: ("/imu", _imu),
    RgbdFrame: ("/camera", _frame),
    FrameQuality: ("/camera/quality", _quality),
    FreeGround: ("/ground", _ground),
    HeadingMeasurement: ("/stair/heading_measured", _measurement),
    HeadingEstimate: ("/stair/heading", _estimate),
    StairMap: ("/stair/map", _stair_map),
    MotionPlan: ("/plan", _plan),
    Event: ("/diagnostics", _event),
    Truth: ("/truth", _truth),
    TrackCommand: ("/tracks/cmd", _track_command),
    TrackReading: ("/tracks/state", _track_reading),
    PlantState: ("/plant/state", _plant_state),
    SeatCommand: ("/seat/cmd", lambda s, t, w: [joints(t, s.t_s, ("stroke",), (), (s.rate_m_s,), s.sender, w)]),
    SeatReading: (
        "/seat/state",
        lambda s, t, w: [joints(t, s.t_s, ("stroke", "pitch"), (s.stroke_m, s.pitch_rad), (), "chair", w)],
    ),
    FlipperCommand: ("/flipper/cmd", lambda s, t, w: [joints(t, s.t_s, ("flipper",), (), (s.rate_rad_s,), s.sender, w)]),
    FlipperReading: (
        "/flipper/state",
        lambda s, t, w: [joints(t, s.t_s, ("angle", "torque"), (s.angle_rad, s.torque_n_m), (), "chair", w)],
    ),
    OperatorInput: ("/operator", _operator),
}
