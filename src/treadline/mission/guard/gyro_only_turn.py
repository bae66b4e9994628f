"""A heading that the gyro alone tells (row 7): a gyro that drifts unseen lets the belts turn the chair, and turn it."""

import math
from collections import deque
from collections.abc import Sequence

from treadline.angles import DEG, tilt_of
from treadline.mission.guard.belt_travel import GAP_S
from treadline.mission.guard.config import GuardConfig
from treadline.mission.guard.phases import FLIGHT, OVER
from treadline.signals import HeadingEstimate, MotionPlan

GAUGE_M = 0.65
"""Gauge of the wheelchair, to which the three turns below belong; a chair of another gauge turns by more in the inverse ratio."""
FLIGHT_RAD_M = 1.0 / GAUGE_M
"""Largest turn on nosings per metre of belt difference: that of belts that do not skid. Quasi-static Coulomb friction gives from 0
(28°, friction 0.62/0.5: dead zone) to 0.94 of it (20°, 0.9/0.5), and the guard does not know the friction."""
OVER_RAD_M = 0.4
"""Turn over one nosing per metre of belt difference, measured with a drifting gyro on 0.62/0.5 at 22°; 0.05 to 0.72 at 22 to 28°
and with 0.9/0.5."""
LEVEL_RAD_M = 0.755
"""Turn on a level floor per metre of belt difference, by quasi-static friction of 0.62/0.5."""
LEVEL_RAD = 2.0 * DEG
SWINGS_RAD_S = 4.5 * DEG
"""Pitch rate above which a chair swings over a nosing, which turns it by a degree or two: belts that answer are right."""
SMOOTHING_S = 0.2


class GyroOnlyTurn:
    """How far the belts have turned the chair since a stair was last seen, lately."""

    def __init__(self, config: GuardConfig) -> None:
        self._config = config
        self._turns = GAUGE_M / config.gauge_m
        self.t_s = 0.0
        """Of the last reading of the belts."""
        self._pitch_rad = self._swing_rad_s = 0.0
        self._imu_s: float | None = None
        self._turned_rad = 0.0
        self._window: deque[tuple[float, float]] = deque()
        self.cause: str | None = None

    def seen(self) -> None:
        """Note a heading measured by the camera: what the gyro says is known to be true."""
        self._window.clear()

    def update_motion(self, t_s: float, orientation: Sequence[float], pitch_rate_rad_s: float) -> None:
        """Take one IMU sample: the attitude's quaternion (w, x, y, z) and the pitch rate."""
        self._pitch_rad, _ = tilt_of(orientation)
        dt_s = 0.0 if self._imu_s is None else t_s - self._imu_s
        self._imu_s = t_s
        self._swing_rad_s += (pitch_rate_rad_s - self._swing_rad_s) * (1.0 - math.exp(-dt_s / SMOOTHING_S))

    def update_belts(self, t_s: float, apart_m_s: float, plan: MotionPlan | None) -> None:
        """Take how much faster the right belt runs than the left one; judge it where no stair should be in view."""
        dt_s, self.t_s = t_s - self.t_s, t_s
        if plan is None or plan.phase not in FLIGHT + OVER:
            self._window.clear()
            return
        if dt_s > GAP_S:
            self._window.clear()
        if not self._window:
            dt_s = 0.0
        # A faster turn would show in the gyro, whose drift alone is in doubt.
        most = self._config.gyro_drift_rad_s
        self._turned_rad += min(max(self._turns * self._per_metre(plan.phase) * apart_m_s, -most), most) * dt_s
        self._window.append((t_s, self._turned_rad))
        while t_s - self._window[0][0] > self._config.blind_turn_s:
            self._window.popleft()
        turned = self._turned_rad - self._window[0][1]
        if abs(turned) > self._config.blind_turn_rad and not plan.needs_stair:
            since_s = t_s - self._window[0][0]
            self.cause = f"the belts turned the chair by {turned / DEG:+.1f}° in {since_s:.1f} s on the word of the gyro alone"

    def forget(self) -> None:
        """Start anew."""
        self._window.clear()
        self.cause = None

    def _per_metre(self, phase: str) -> float:
        if phase in FLIGHT:
            return FLIGHT_RAD_M
        if abs(self._swing_rad_s) > SWINGS_RAD_S:
            return 0.0
        return OVER_RAD_M if abs(self._pitch_rad) > LEVEL_RAD else LEVEL_RAD_M


def heading_fault(config: GuardConfig, estimate: HeadingEstimate | None, plan: MotionPlan | None) -> str | None:
    """Return that a chair that pitches over a nosing, which it began square, is said to be askew; None if not."""
    if estimate is None or plan is None or plan.phase not in OVER or abs(estimate.heading_rad) <= config.max_heading_error_rad:
        return None
    return f"heading {estimate.heading_rad / DEG:+.1f}° in {plan.phase}: the chair has turned, or the gyro errs"
