"""The stair that a goal names, its comparison with the stair in view, and what the odometry says of a traversal.

``StairGoal, StairMap, Odometry -> reason of a refusal, Traversed``.
"""

import math
from dataclasses import dataclass

import numpy as np

from treadline.core.errors import SettingsError
from treadline.core.rotations import Vector3, rotation_of
from treadline.core.signals import Direction, HeadingEstimate, StairMap, Vector
from treadline.mission.odometry import Odometry
from treadline.vehicle.traction import NORMAL_SLIP

RISE_TOLERANCE_M = 0.019
"""Largest difference between the expected and the measured rise of a step [m]: twice what codes allow within one flight (IBC
1011.5.4, 9.5 mm), the second for the camera."""
FOOT_TOLERANCE_M = 1.0
"""Largest horizontal distance between the foot of a goal and the nearest nosing in view [m]: stairs side by side are further apart,
and the foot of a flight lies up to a run before its first nosing."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StairGoal:
    """One traversal as a client asks for it; zeros and None: not asked for."""

    direction: Direction | None = None
    stair_id: str = ""
    foot: tuple[str, Vector] | None = None
    """Frame and place where the flight begins for the chair."""
    steps: int = 0
    step_rise_m: float = 0.0
    speed_m_s: float = 0.0
    """Belt speed on the flight [m/s]; 0: that of the configuration."""
    limit_s: float = 0.0
    """Time after which the traversal is given up [s]; 0: none."""
    lease_s: float = 0.0
    """Time without a sign of the client after which the chair is held [s]; 0: none."""


def foot_in_odom(goal: StairGoal, odometry: Odometry | None) -> Vector3 | None:
    """Return the foot of a goal in the frame of the odometry; None if it names none.

    Raises:
        SettingsError: If its frame is another, or there is no odometry yet.
    """
    if goal.foot is None:
        return None
    frame, place = goal.foot[0], np.array(goal.foot[1])
    if frame not in ("odom", "base_link"):
        raise SettingsError(f"the foot of stair '{goal.stair_id}' is in frame '{frame}'; give it in odom or base_link")
    if odometry is None:
        raise SettingsError("no odometry yet; the foot of the stair cannot be compared: start the heading node")
    return place if frame == "odom" else odometry.p_OB + rotation_of(odometry.orientation) @ place


def mismatch(goal: StairGoal, foot_O: Vector3 | None, stair: StairMap, odometry: Odometry | None) -> str | None:
    """Return how the stair in view differs from that of the goal; None if it does not, as far as both are known."""
    named = f"stair '{goal.stair_id}'"
    if goal.step_rise_m and abs(stair.rise_m - goal.step_rise_m) > RISE_TOLERANCE_M:
        return f"another stair: steps of {named} rise {goal.step_rise_m:.3f} m, those in view {stair.rise_m:.3f} m"
    if foot_O is not None and odometry is not None and stair.nosings_B:
        first_O = odometry.p_OB + rotation_of(odometry.orientation) @ np.array(stair.nosings_B[0])
        away_m = math.hypot(*(first_O - foot_O)[:2].tolist())
        if away_m > FOOT_TOLERANCE_M:
            return f"another stair: the foot of {named} is {away_m:.2f} m from the one in view"
    return None


@dataclass(frozen=True, slots=True, kw_only=True)
class Traversed:
    """What the odometry measured from the begin of a goal to its end."""

    rise_m: float = math.nan
    steps: int = 0
    """Number of steps passed; 0 where no rise was measured."""
    sigma_m: float = math.nan
    """Standard deviation of the place at the end: ``NORMAL_SLIP`` of the distance between begin and end [m]."""
    heading_sigma_rad: float = math.nan
    """Standard deviation of the heading at the end [rad]."""


def traversed(
    begin: Odometry | None, end: Odometry | None, step_rise_m: float | None, estimate: HeadingEstimate | None
) -> Traversed:
    """Return what lies between two odometries, with the rise and the heading that were estimated meanwhile."""
    sigma_rad = math.nan if estimate is None else estimate.sigma_rad
    if begin is None or end is None:
        return Traversed(heading_sigma_rad=sigma_rad)
    moved = end.p_OB - begin.p_OB
    steps = round(abs(float(moved[2])) / step_rise_m) if step_rise_m else 0
    sigma_m = NORMAL_SLIP * float(np.linalg.norm(moved))
    return Traversed(rise_m=float(moved[2]), steps=steps, sigma_m=sigma_m, heading_sigma_rad=sigma_rad)
