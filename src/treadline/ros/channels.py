"""Channels of the graph: their topics and standard message types on a wire, their quality of service, and signals of nodes alone.

``Senders`` finds two nodes that publish one topic.

Paper: Fig. 7. Clock, heartbeat, state of the guard, joint angles and mounts are no signals of the mission.
"""

import math
from dataclasses import dataclass
from typing import Literal

from treadline.core.camera_images import PinholeCamera
from treadline.core.signals import CommandSource
from treadline.io.message_types import PACKAGE
from treadline.io.messages import CAMERA_INFO, IMAGE, JOINTS, OWN, STATUS
from treadline.io.messages import IMU as IMU_TYPE
from treadline.io.scene_messages import FRAMES, MARKERS, ODOMETRY, Marker
from treadline.io.standard_messages import POSE, POSES

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
STAIR_MARKERS = "/stair/markers"

CLOCK_TYPE = "rosgraph_msgs/msg/Clock"
TWIST_TYPE, TWIST_STAMPED = "geometry_msgs/msg/Twist", "geometry_msgs/msg/TwistStamped"
GUARD_TYPE = f"{PACKAGE}/msg/GuardState"


@dataclass(frozen=True, slots=True, kw_only=True)
class Topic:
    """One topic of a channel."""

    name: str
    kind: str
    """The message type as ROS 2 writes it."""
    ros1: str = ""
    """The message type in ROS 1, a standard one; empty where it is the same."""
    read: bool = True
    """Whether our nodes read it; others are for people and their tools."""
    only: Literal["", "ros1", "ros2"] = ""
    """The ROS that has the topic; empty for both."""

    def kind_of(self, *, ros1: bool) -> str:
        """Return the message type in ROS 1 or 2."""
        return (ros1 and self.ros1) or self.kind


@dataclass(frozen=True, slots=True, kw_only=True)
class Channel:
    """Topics and quality of service of a channel."""

    topics: tuple[Topic, ...]
    depth: int
    """Queue length: only the newest image or command is of use, the inputs of a filter must be complete."""
    kept: bool = False
    """Whether later subscribers get the last message: ROS 1's latch, ROS 2's transient local."""

    def topics_of(self, *, ros1: bool) -> tuple[Topic, ...]:
        """Return the topics in ROS 1 or 2."""
        return tuple(topic for topic in self.topics if topic.only != ("ros2" if ros1 else "ros1"))


def _one(name: str, kind: str, depth: int) -> Channel:
    return Channel(topics=(Topic(name=name, kind=kind),), depth=depth)


LIKE = {
    CAMERA_QUALITY: QUALITY,
    CAMERA_HEADING: MEASURED,
    CAMERA_MAP: MAP,
    TRACKS_PROPOSED: TRACKS_CMD,
    SEAT_PROPOSED: SEAT_CMD,
}
"""Channels with the messages of another."""
_KNOWN = {own.topic: own for own in OWN.values()}


def _own(name: str, depth: int, ros1: str = JOINTS, pose: str = "") -> Channel:
    own = _KNOWN[LIKE.get(name, name)]
    viewed = (Topic(name=name, kind=pose, read=False, only="ros1"),) if pose else ()
    return Channel(topics=(*viewed, Topic(name=name + own.end, kind=own.kind, ros1=ros1)), depth=depth)


SECOND = 100
"""Messages of a sensor at 100 Hz."""

CHANNELS: dict[str, Channel] = {
    CLOCK: _one(CLOCK, CLOCK_TYPE, 1),
    IMU: _one(IMU, IMU_TYPE, SECOND),
    **{name: _own(name, SECOND) for name in (TRACKS, SEAT, FLIPPER)},
    **{name: _own(name, 10) for name in (OPERATOR, CAMERA_QUALITY, QUALITY, GROUND, TRUTH)},
    **{name: _own(name, 1) for name in (TRACKS_PROPOSED, SEAT_PROPOSED, TRACKS_CMD, SEAT_CMD, FLIPPER_CMD)},
    PLANT: _own(PLANT, 10, STATUS),
    CAMERA: Channel(
        topics=(
            Topic(name="/camera/color/image_raw", kind=IMAGE),
            Topic(name="/camera/depth/image_rect", kind=IMAGE),
            Topic(name="/camera/color/camera_info", kind=CAMERA_INFO),
        ),
        depth=2,
    ),
    CAMERA_HEADING: _own(CAMERA_HEADING, 10, pose=POSE),
    CAMERA_MAP: _own(CAMERA_MAP, 10, pose=POSES),
    MEASURED: _own(MEASURED, 10, pose=POSE),
    MAP: _own(MAP, 10, pose=POSES),
    ESTIMATE: _own(ESTIMATE, 1, pose=POSE),
    HEALTH: _own(HEALTH, 10, STATUS),
    PLAN: _own(PLAN, 1, STATUS),
    GUARD: Channel(topics=(Topic(name=GUARD, kind=GUARD_TYPE, ros1=STATUS),), depth=10),
    DIAGNOSTICS: _one(DIAGNOSTICS, STATUS, SECOND),
    TWIST: Channel(topics=(Topic(name=TWIST, kind=TWIST_STAMPED, ros1=TWIST_TYPE),), depth=1),
    ODOM: Channel(topics=(Topic(name=ODOM, kind=ODOMETRY), Topic(name="/tf", kind=FRAMES, read=False)), depth=10),
    JOINT_STATES: Channel(topics=(Topic(name=JOINT_STATES, kind=JOINTS, read=False),), depth=10),
    STAIR_MARKERS: Channel(topics=(Topic(name=STAIR_MARKERS, kind=MARKERS, read=False, only="ros2"),), depth=1),
    MOUNTS: Channel(topics=(Topic(name=MOUNTS, kind=FRAMES, read=False),), depth=1, kept=True),
}
SENSORS = (IMU, TRACKS, SEAT, FLIPPER, OPERATOR, CAMERA)
"""Channels whose first stamp is compared with the clock."""
DETECTED, COMMANDS = (QUALITY, GROUND, MEASURED, MAP), (TRACKS_CMD, SEAT_CMD, FLIPPER_CMD)
"""Channels of the camera node, and of the guard's commands."""
LOGGED = (*SENSORS, *DETECTED, *COMMANDS, PLANT, ESTIMATE, DIAGNOSTICS, TRUTH, ODOM, MOUNTS)
"""Channels that the recorder keeps."""

TWO_SOURCES = "two_sources"
"""Event of any node that hears two publishers of one topic; the guard holds for it."""
TOGETHER_S = 1.0
"""Longest time between two messages of one publisher, with one of another in between, by which both are there [s]."""


class Senders:
    """The senders of each topic; two that send by turns are two sources.

    A node in the place of one that ended is no second source: the first does not send again. Diagnostics come from all nodes.
    """

    def __init__(self) -> None:
        self._sent_s: dict[str, dict[str, float]] = {}
        """Time of the last message of each sender, by topic; the last sender comes last."""
        self._declared_s: dict[str, float] = {}

    def other(self, topic: str, sender: str, now_s: float) -> str | None:
        """Record a message; return the second source of its topic where there is one, once per ``TOGETHER_S``.

        Args:
            topic: The message's topic.
            sender: Id of its publisher; empty where it is not known.
            now_s: Time of its arrival [s].
        """
        if not sender or topic == DIAGNOSTICS:
            return None
        sent_s = self._sent_s.setdefault(topic, {})
        last = next(reversed(sent_s), sender)
        before_s, sent_s[sender] = sent_s.pop(sender, -math.inf), now_s
        declared_s = self._declared_s.get(topic, -math.inf)
        if last == sender or now_s - before_s > TOGETHER_S or now_s - declared_s < TOGETHER_S:
            return None
        self._declared_s[topic] = now_s
        return last


def two_sources(topic: str, *nodes: str) -> str:
    """Return the cause of a hold for two publishers of one topic."""
    return f"two sources of {topic}, {' and '.join(sorted(nodes))}; stop one of them"


@dataclass(frozen=True, slots=True, kw_only=True)
class Clock:
    """The mission clock."""

    t_s: float


BEAT_S = 0.2
"""Interval of the heartbeat [s]: about a quarter of the guard's timeout."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Beat:
    """Heartbeat of a node; after the first the guard awaits the next of each node of its graph."""

    t_s: float
    node: str
    state: str = "ready"
    """``ready``, or what it waits for."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GuardState:
    """State of the guard."""

    t_s: float
    holding: str | None
    """Cause of its HOLD, None without one."""
    source: CommandSource = "driver"
    """Whose commands move the belts; ROS 1's message does not hold it."""
    sender: str = "chair"
    """Id of the guard."""


@dataclass(frozen=True, slots=True, kw_only=True)
class JointAngles:
    """Angles of the moving joints of the chair's URDF."""

    t_s: float
    names: tuple[str, ...]
    """Names of the joints in the URDF."""
    angles_rad: tuple[float, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Mounts:
    """Mounts of the sensors on the chair."""

    t_s: float
    camera: PinholeCamera


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StairMarkers:
    """Drawing of the stair, the way over it and the hold, for viewers."""

    t_s: float
    markers: tuple[Marker, ...]
