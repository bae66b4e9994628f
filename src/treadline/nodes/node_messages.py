"""What only nodes tell each other and others: the clock, that one is alive, why the guard holds, and where things are."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from treadline.signals import PinholeCamera


@dataclass(frozen=True, slots=True, kw_only=True)
class Clock:
    """The mission clock as its owner has it."""

    t_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Beat:
    """A node is alive; it has spoken once and must go on."""

    t_s: float
    node: str
    state: str = "ready"
    """``ready``, or what it waits for."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GuardState:
    """Why the guard holds the chair, or that it does not."""

    t_s: float
    holding: str | None


@dataclass(frozen=True, slots=True, kw_only=True)
class VelocityCommand:
    """Speed and turn asked by a person's stick or another planner (``/cmd_vel``); it has no stamp."""

    speed_m_s: float
    turn_rad_s: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Odometry:
    """Where the chair has come by its belts, in a level frame O that begins where it started; belts slip."""

    t_s: float
    p_OB: Float[np.ndarray, " 3"]
    orientation: Float[np.ndarray, " 4"]
    """The IMU's quaternion (w, x, y, z) of B in O: its yaw drifts."""
    speed_m_s: float
    angular_velocity_rad_s: Float[np.ndarray, " 3"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Mounts:
    """Where the sensors sit on the chair."""

    t_s: float
    camera: PinholeCamera
