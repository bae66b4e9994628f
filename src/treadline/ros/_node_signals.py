"""Messages between nodes that are no signals of the mission: clock, heartbeat, state of the guard, joint angles, sensor mounts."""

from dataclasses import dataclass

from treadline.core.camera_images import PinholeCamera
from treadline.core.signals import CommandSource


@dataclass(frozen=True, slots=True, kw_only=True)
class Clock:
    """The mission clock."""

    t_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Beat:
    """Heartbeat of a node; after the first the guard awaits the next."""

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
