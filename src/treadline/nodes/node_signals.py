"""Messages between nodes that are no signals of the mission: clock, heartbeat, state of the guard, odometry, sensor mounts."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from treadline.signals import PinholeCamera


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
    """Cause of the guard's HOLD, None without one."""

    t_s: float
    holding: str | None


@dataclass(frozen=True, slots=True, kw_only=True)
class VelocityCommand:
    """Speed and turn rate of a joystick or another planner (``/cmd_vel``); it has no stamp."""

    speed_m_s: float
    turn_rad_s: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Odometry:
    """Pose of the chair by its belts and IMU, in a level frame O with its origin at the start; belts slip, so it drifts."""

    t_s: float
    p_OB: Float[np.ndarray, " 3"]
    orientation: Float[np.ndarray, " 4"]
    """The IMU's quaternion (w, x, y, z) of B in O: its yaw drifts."""
    speed_m_s: float
    angular_velocity_rad_s: Float[np.ndarray, " 3"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Mounts:
    """Mounts of the sensors on the chair."""

    t_s: float
    camera: PinholeCamera
