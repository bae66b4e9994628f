"""Monitor of turns by the belts while only the gyro measures the heading (row 7): undetected gyro drift makes the controller turn.

``ImuSample, TrackReading, MotionPlan -> cause``.
"""

import math
from collections import deque
from collections.abc import Sequence

from treadline.core.angles import DEG, tilt_of
from treadline.core.signals import HeadingEstimate, MotionPlan
from treadline.guard._belt_monitor import GAP_S
from treadline.guard._guard_config import FLIGHT, OVER, GuardConfig

GAUGE_M = 0.65
"""Gauge of the wheelchair, for which the three ratios below hold [m]; they are inversely proportional to the gauge."""
FLIGHT_RAD_M = 1.0 / GAUGE_M
"""Largest turn on nosings per metre of belt travel difference [rad/m]: that of belts that do not skid. Quasi-static Coulomb
friction gives 0 (28°, friction 0.62/0.5: dead zone) to 0.94 of this (20°, 0.9/0.5); the guard does not know the friction."""
OVER_RAD_M = 0.4
"""Turn over one nosing per metre of belt travel difference [rad/m], measured with a drifting gyro on 0.62/0.5 at 22°; 0.05 to 0.72
at 22 to 28° and with 0.9/0.5."""
LEVEL_RAD_M = 0.755
"""Turn on flat ground per metre of belt travel difference [rad/m], by quasi-static friction of 0.62/0.5."""
LEVEL_RAD = 2.0 * DEG
"""Absolute pitch below which the chair is on flat ground [rad]."""
SWINGS_RAD_S = 4.5 * DEG
"""Filtered pitch rate above which the chair swings over a nosing [rad/s]. The swing itself turns it by a degree or two, which the
belts rightly correct."""
SMOOTHING_S = 0.2
"""Time constant of the pitch rate filter [s]."""


class GyroOnlyTurn:
    """Turn by the belts within ``blind_turn_s``, since the last heading measured by the camera."""

    def __init__(self, config: GuardConfig) -> None:
        self._config = config
        self._turns = GAUGE_M / config.gauge_m
        self.t_s = 0.0
        """Time of the last belt reading [s]."""
        self._pitch_rad = self._swing_rad_s = 0.0
        self._imu_s: float | None = None
        self._turned_rad = 0.0
        self._window: deque[tuple[float, float]] = deque()
        self.cause: str | None = None

    def seen(self) -> None:
        """Reset the turn: the camera has measured the heading."""
        self._window.clear()

    def update_motion(self, t_s: float, orientation: Sequence[float], pitch_rate_rad_s: float) -> None:
        """Update with one IMU sample: attitude quaternion (w, x, y, z) and pitch rate [rad/s]."""
        self._pitch_rad, _ = tilt_of(orientation)
        dt_s = 0.0 if self._imu_s is None else t_s - self._imu_s
        self._imu_s = t_s
        self._swing_rad_s += (pitch_rate_rad_s - self._swing_rad_s) * (1.0 - math.exp(-dt_s / SMOOTHING_S))

    def update_belts(self, t_s: float, apart_m_s: float, plan: MotionPlan | None) -> None:
        """Update with one belt reading; the turn is judged where the plan needs no stair in view.

        Args:
            t_s: Time of the reading.
            apart_m_s: Speed of the right belt minus that of the left one.
            plan: Latest plan, if any.
        """
        dt_s, self.t_s = t_s - self.t_s, t_s
        if plan is None or plan.phase not in FLIGHT + OVER:
            self._window.clear()
            return
        if dt_s > GAP_S:
            self._window.clear()
        if not self._window:
            dt_s = 0.0
        # A turn faster than the largest undetected drift would show in the gyro.
        most = self._config.gyro_drift_rad_s
        self._turned_rad += min(max(self._turns * self._per_metre(plan.phase) * apart_m_s, -most), most) * dt_s
        self._window.append((t_s, self._turned_rad))
        while t_s - self._window[0][0] > self._config.blind_turn_s:
            self._window.popleft()
        turned = self._turned_rad - self._window[0][1]
        if abs(turned) > self._config.blind_turn_rad and not plan.needs_stair:
            since_s = t_s - self._window[0][0]
            self.cause = (
                f"the belts turned the chair by {turned / DEG:+.1f}° in {since_s:.1f} s with the heading from the gyro alone"
            )

    def forget(self) -> None:
        """Reset the turn and its cause."""
        self._window.clear()
        self.cause = None

    def _per_metre(self, phase: str) -> float:
        if phase in FLIGHT:
            return FLIGHT_RAD_M
        if abs(self._swing_rad_s) > SWINGS_RAD_S:
            return 0.0
        return OVER_RAD_M if abs(self._pitch_rad) > LEVEL_RAD else LEVEL_RAD_M


def heading_fault(config: GuardConfig, estimate: HeadingEstimate | None, plan: MotionPlan | None) -> str | None:
    """Return the fault of a large heading error over crest or edge, where the chair arrives square; None if there is none."""
    if estimate is None or plan is None or plan.phase not in OVER or abs(estimate.heading_rad) <= config.max_heading_error_rad:
        return None
    return f"heading {estimate.heading_rad / DEG:+.1f}° in {plan.phase}: the chair has turned, or the gyro errs"
