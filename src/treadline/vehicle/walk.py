"""Walk: the rest poses of a chair on its way over a whole ground, one instant after the other."""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from treadline.core.angles import DEG
from treadline.core.printing import Plottable
from treadline.vehicle.rest_poses import Fall, Ground, RestChair, RestPose

QUIET_RAD_S = 15.0 * DEG
"""Pitch rate of a quiet drive [rad/s]: the planner turns a chair at 9°/s, and half as much again remains for nosings."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Stride:
    """One instant of a walk."""

    t_s: float
    phase: str
    pose: RestPose
    rate_rad_s: float
    """Pitch rate [rad/s], of a fall its end."""
    fall: Fall | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Walk(Plottable):
    """A chair's way over the whole ground, one instant after the other."""

    ground: Ground = field(repr=False)
    chair: RestChair = field(repr=False)
    strides: tuple[Stride, ...] = field(repr=False)
    end: str
    """How it ended: ``arrived``, ``end_of_flight``, ``held``, ``refused``, ``tipped``, ``time_up``, or ``unquiet``."""
    cause: str
    """Why it ended there."""

    @property
    def fastest(self) -> Stride:
        """Instant at which the chair turns fastest."""
        return max(self.strides, key=lambda stride: stride.rate_rad_s)

    @property
    def least_front(self) -> Stride:
        """Instant with the least margin to tipping over the front."""
        return min(self.strides, key=lambda stride: stride.pose.front_margin_rad)

    @property
    def least_rear(self) -> Stride:
        """Instant with the least margin to tipping over the rear."""
        return min(self.strides, key=lambda stride: stride.pose.rear_margin_rad)

    @property
    def hardest(self) -> Stride:
        """Instant at which the flipper's motor carries most."""
        return max(self.strides, key=lambda stride: max(stride.pose.torques_n_m))

    @property
    def columns(self) -> dict[str, Float[np.ndarray, " n"]]:
        """Place, height, pitch, pitch rate, margins, flipper angle and torque along the way, angles in degrees."""
        poses = [stride.pose for stride in self.strides]
        columns = {
            "t_s": [stride.t_s for stride in self.strides],
            "x_m": [pose.x_m for pose in poses],
            "z_m": [pose.height_m for pose in poses],
            "torque_n_m": [pose.torques_n_m[0] for pose in poses],
        }
        angles = {
            "pitch_deg": [pose.pitch_rad for pose in poses],
            "flipper_deg": [pose.angles_rad[0] for pose in poses],
            "rate_deg_s": [stride.rate_rad_s for stride in self.strides],
            "front_margin_deg": [pose.front_margin_rad for pose in poses],
            "rear_margin_deg": [pose.rear_margin_rad for pose in poses],
        }
        return {name: np.array(values) for name, values in columns.items()} | {
            name: np.degrees(values) for name, values in angles.items()
        }
