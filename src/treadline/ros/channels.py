"""Channels of the graph: their topics and standard message types on a wire, and their quality of service.

Paper: Fig. 7.
"""

from dataclasses import dataclass

CLOCK = "/clock"
IMU = "/imu"
TRACKS = "/tracks/state"
SEAT = "/seat/state"
FLIPPER = "/flipper/state"
OPERATOR = "/operator"
PLANT = "/plant/state"
CAMERA = "/camera"
CAMERA_HEADING, CAMERA_MAP, CAMERA_QUALITY = "/camera/stair/heading", "/camera/stair/map", "/camera/stair/quality"
"""Channels of a camera that measures by itself and delivers no images."""
QUALITY = "/camera/quality"
GROUND = "/ground"
MEASURED = "/stair/heading_measured"
MAP = "/stair/map"
ESTIMATE = "/stair/heading"
HEALTH = "/stair/heading/health"
PLAN = "/plan"
TRACKS_PROPOSED, SEAT_PROPOSED = "/tracks/proposed", "/seat/proposed"
TRACKS_CMD, SEAT_CMD, FLIPPER_CMD = "/tracks/cmd", "/seat/cmd", "/flipper/cmd"
GUARD = "/guard/state"
DIAGNOSTICS = "/diagnostics"
TRUTH = "/truth"
TWIST = "/cmd_vel"
ODOM, MOUNTS = "/odom", "/tf_static"
JOINT_STATES = "/joint_states"

JOINTS, POSE = "sensor_msgs/msg/JointState", "geometry_msgs/msg/PoseWithCovarianceStamped"
STATUS, IMAGE = "diagnostic_msgs/msg/DiagnosticArray", "sensor_msgs/msg/Image"
FRAMES = "tf2_msgs/msg/TFMessage"


@dataclass(frozen=True, slots=True, kw_only=True)
class Topic:
    """One topic of a channel."""

    name: str
    kind: str
    """The message type as ROS 2 writes it."""
    read: bool = True
    """Whether our nodes read it; others are for people and their tools."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Channel:
    """Topics and quality of service of a channel."""

    topics: tuple[Topic, ...]
    depth: int
    """Queue length: only the newest image or command is of use, the inputs of a filter must be complete."""
    kept: bool = False
    """Whether later subscribers get the last message: ROS 1's latch, ROS 2's transient local."""


def _one(name: str, kind: str, depth: int) -> Channel:
    return Channel(topics=(Topic(name=name, kind=kind),), depth=depth)


def _with_detail(name: str, kind: str, depth: int) -> Channel:
    topics = (Topic(name=name, kind=kind, read=False), Topic(name=f"{name}/detail", kind=JOINTS))
    return Channel(topics=topics, depth=depth)


SECOND = 100
"""Messages of a sensor at 100 Hz."""

CHANNELS: dict[str, Channel] = {
    CLOCK: _one(CLOCK, "rosgraph_msgs/msg/Clock", 1),
    IMU: _one(IMU, "sensor_msgs/msg/Imu", SECOND),
    TRACKS: _one(TRACKS, JOINTS, SECOND),
    SEAT: _one(SEAT, JOINTS, SECOND),
    FLIPPER: _one(FLIPPER, JOINTS, SECOND),
    OPERATOR: _one(OPERATOR, JOINTS, 10),
    PLANT: _one(PLANT, STATUS, 10),
    CAMERA: Channel(
        topics=(
            Topic(name="/camera/color/image_raw", kind=IMAGE),
            Topic(name="/camera/depth/image_rect", kind=IMAGE),
            Topic(name="/camera/color/camera_info", kind="sensor_msgs/msg/CameraInfo"),
        ),
        depth=2,
    ),
    CAMERA_HEADING: _with_detail(CAMERA_HEADING, POSE, 10),
    CAMERA_MAP: _with_detail(CAMERA_MAP, "geometry_msgs/msg/PoseArray", 10),
    CAMERA_QUALITY: _one(CAMERA_QUALITY, JOINTS, 10),
    QUALITY: _one(QUALITY, JOINTS, 10),
    GROUND: _one(GROUND, JOINTS, 10),
    MEASURED: _with_detail(MEASURED, POSE, 10),
    MAP: _with_detail(MAP, "geometry_msgs/msg/PoseArray", 10),
    ESTIMATE: _with_detail(ESTIMATE, POSE, 1),
    HEALTH: _one(HEALTH, STATUS, 10),
    PLAN: _one(PLAN, STATUS, 1),
    TRACKS_PROPOSED: _one(TRACKS_PROPOSED, JOINTS, 1),
    SEAT_PROPOSED: _one(SEAT_PROPOSED, JOINTS, 1),
    TRACKS_CMD: _one(TRACKS_CMD, JOINTS, 1),
    SEAT_CMD: _one(SEAT_CMD, JOINTS, 1),
    FLIPPER_CMD: _one(FLIPPER_CMD, JOINTS, 1),
    GUARD: _one(GUARD, STATUS, 10),
    DIAGNOSTICS: _one(DIAGNOSTICS, STATUS, SECOND),
    TRUTH: _one(TRUTH, JOINTS, 10),
    TWIST: _one(TWIST, "geometry_msgs/msg/Twist", 1),
    ODOM: Channel(
        topics=(Topic(name=ODOM, kind="nav_msgs/msg/Odometry"), Topic(name="/tf", kind=FRAMES, read=False)),
        depth=10,
    ),
    JOINT_STATES: Channel(topics=(Topic(name=JOINT_STATES, kind=JOINTS, read=False),), depth=10),
    MOUNTS: Channel(topics=(Topic(name=MOUNTS, kind=FRAMES, read=False),), depth=1, kept=True),
}
SENSORS = (IMU, TRACKS, SEAT, FLIPPER, OPERATOR, CAMERA)
"""Channels whose first stamp is compared with the clock."""
DETECTED, COMMANDS = (QUALITY, GROUND, MEASURED, MAP), (TRACKS_CMD, SEAT_CMD, FLIPPER_CMD)
"""Channels of the camera node, and of the guard's commands."""
LOGGED = (*SENSORS, *DETECTED, *COMMANDS, PLANT, ESTIMATE, DIAGNOSTICS, TRUTH, ODOM, MOUNTS)
"""Channels that the recorder keeps."""
