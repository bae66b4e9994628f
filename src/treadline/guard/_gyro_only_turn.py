"""Monitor of turns by the belts while only the gyro measures the heading (row 7): undetected gyro drift makes the controller turn.

``ImuSample, TrackReading, MotionPlan -> cause``.
"""

import math
from collections import deque
from typing import Any

from treadline.core.angles import DEG, tilt_of
from treadline.core.signals import HeadingMeasurement, ImuSample, MotionPlan, TrackReading
from treadline.guard._guard_config import FLIGHT, OVER, GuardConfig
from treadline.guard._half_cosine_stop import Stop
from treadline.guard._known import Known, Monitor

OVER_SHARE = 0.26
"""Share of the turn of belts that do not skid, over one nosing: measured with a drifting gyro on 0.62/0.5 at 22°; 0.03 to 0.47 at
22 to 28° and with 0.9/0.5."""
SWINGS_RAD_S = 4.5 * DEG
"""Filtered pitch rate above which the chair swings over a nosing [rad/s]. The swing itself turns it by a degree or two, which the
belts rightly correct."""
SMOOTHING_S = 0.2
"""Time constant of the pitch rate filter [s]."""


class GyroOnlyTurn(Monitor):
    """The belts turn the chair by more than 3° in 6 s with no stair in view.

    Time: at 3°.
    Not covered: drift below 1.5 °/s while the belts run alike.
    """

    rows, stop, needs = "7", Stop.RAMP, ("needs_heading",)
    hears = (HeadingMeasurement, ImuSample, TrackReading)

    def __init__(self, config: GuardConfig) -> None:
        super().__init__(config)
        self._t_s = 0.0
        """Time of the last belt reading [s]."""
        self._pitch_rad = self._swing_rad_s = 0.0
        self._imu_s: float | None = None
        self._turned_rad = 0.0
        self._window: deque[tuple[float, float]] = deque()

    def hear(self, message: Any, known: Known) -> None:
        """Update with a belt reading or an IMU sample; a measured heading resets the turn up to the exposure of its frame."""
        match message:
            case HeadingMeasurement():
                while self._window and self._window[0][0] <= message.t_s:
                    self._window.popleft()
            case ImuSample():
                self._pitch_rad, _ = tilt_of(message.orientation)
                dt_s, self._imu_s = 0.0 if self._imu_s is None else message.t_s - self._imu_s, message.t_s
                pitch_rate_rad_s = -message.angular_velocity_rad_s[1]
                self._swing_rad_s += (pitch_rate_rad_s - self._swing_rad_s) * (1.0 - math.exp(-dt_s / SMOOTHING_S))
            case _:
                self._turn(message.t_s, message.right_m_s - message.left_m_s, known.followed)

    def _turn(self, t_s: float, apart_m_s: float, plan: MotionPlan | None) -> None:
        """Update with the difference of the belt speeds; the turn is judged where the plan needs no stair in view."""
        dt_s, self._t_s = t_s - self._t_s, t_s
        if plan is None or plan.phase not in FLIGHT + OVER:
            self._window.clear()
            return
        if dt_s > self._config.silence_s:
            self._window.clear()
        if not self._window:
            dt_s = 0.0
        # A turn faster than the largest undetected drift would show in the gyro.
        most = self._config.gyro_drift_rad_s
        rate_rad_s = self._share(plan.phase) * apart_m_s / self._config.gauge_m
        self._turned_rad += min(max(rate_rad_s, -most), most) * dt_s
        self._window.append((t_s, self._turned_rad))
        while t_s - self._window[0][0] > self._config.blind_turn_s:
            self._window.popleft()
        turned = self._turned_rad - self._window[0][1]
        if abs(turned) > self._config.blind_turn_rad and not plan.needs_stair:
            since_s = t_s - self._window[0][0]
            self._cause = (
                f"the belts turned the chair by {turned / DEG:+.1f}° in {since_s:.1f} s with the heading from the gyro alone"
            )

    def restart(self, known: Known) -> None:
        """Start again: reset the turn."""
        super().restart(known)
        self._window.clear()

    def _share(self, phase: str) -> float:
        """Return the turn as a share of that of belts that do not skid.

        On a flight this is the whole: quasi-static Coulomb friction gives 0 (28°, friction 0.62/0.5: dead zone) to 0.94 (20°,
        0.9/0.5), and nobody knows more of the friction than that it suffices. The planner does not steer in the dead zone of that
        friction without a stair in view, so that no turn is commanded there.
        """
        if phase in FLIGHT:
            return 1.0
        if abs(self._swing_rad_s) > SWINGS_RAD_S:
            return 0.0
        return OVER_SHARE if abs(self._pitch_rad) > self._config.level_rad else self._config.level_turn_share


class TurnedOver(Monitor):
    """Heading beyond 5° over crest, edge and the ends of a flight, where the chair arrives square.

    Time: 1 tick.
    """

    rows, stop, needs = "7, 18", Stop.RAMP, ("needs_heading",)

    def cause(self, known: Known) -> str | None:
        """Return the heading error, if it is too large for the phase."""
        plan = known.followed
        if plan is None or plan.phase not in OVER or not self._config.square_rad < abs(known.heading_rad) < math.inf:
            return None
        return f"heading {known.heading_rad / DEG:+.1f}° in {plan.phase}: the chair has turned, or the gyro errs"
