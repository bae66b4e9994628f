"""Timeouts of camera and IMU, and faults reported by the heading filter (rows 1, 6, 7, 8 and 9)."""

import math

from treadline.core.signals import Event, HeadingEstimate, HeadingHealth
from treadline.guard._guard_config import GuardConfig
from treadline.guard.phase_groups import TIPPING


class SensorTimeouts:
    """Time of the last data of each sensor, and belt travel since the last frame."""

    def __init__(self, config: GuardConfig) -> None:
        self._config = config
        self._imu_s = self._frame_s = self._seen_s = -math.inf
        self._frame_m = 0.0
        self._stuck_s: float | None = None
        self._differ_s: float | None = None
        self._mended_s: float | None = None
        self._health_s = -math.inf
        self.refused = ""
        """Reason for rejecting the last frame; empty if it was accepted."""

    def begin(self, t_s: float) -> None:
        """Start the timeout of each sensor that has delivered nothing yet."""
        heard = (self._imu_s, self._frame_s, self._seen_s)
        self._imu_s, self._frame_s, self._seen_s = (t_s if last_s == -math.inf else last_s for last_s in heard)

    def restart(self, t_s: float, travel_m: float) -> None:
        """Start all timeouts again."""
        self._imu_s = self._frame_s = self._seen_s = t_s
        self._health_s = -math.inf
        self._frame_m = travel_m

    def imu(self, t_s: float) -> None:
        """Record a finite IMU sample."""
        self._imu_s = max(self._imu_s, t_s)

    def frame(self, t_s: float, travel_m: float) -> None:
        """Record a usable frame, and the belt travel at its exposure."""
        self._frame_s = max(self._frame_s, t_s)
        self._frame_m = travel_m

    def seen(self, t_s: float) -> None:
        """Record a heading measured from a frame, or a plan that needs no stair in view."""
        self._seen_s = max(self._seen_s, t_s)

    def health(self, health: HeadingHealth) -> Event | None:
        """Update with the heading filter's faults, unless older than the last; return an event if the filter corrected one."""
        if health.t_s < self._health_s:
            return None
        self._health_s = health.t_s
        since_s = health.t_s if health.since_s is None else health.since_s
        self._stuck_s = since_s if health.fault == "stuck" else None
        self._differ_s = since_s if health.fault == "disagreement" else None
        if health.fault not in ("drift", "jump") or since_s == self._mended_s:
            return None
        self._mended_s = since_s
        return Event(t_s=health.t_s, name="re-referenced", cause=health.cause or health.fault)

    def alarm(self, t_s: float, travel_m: float, phase: str | None) -> str | None:
        """Return the reason to hold, or None."""
        limits = self._config
        # A stamp in the future, from a clock that is ahead, counts as now.
        self._imu_s, self._frame_s, self._seen_s = min(self._imu_s, t_s), min(self._frame_s, t_s), min(self._seen_s, t_s)
        frame_s, imu_s = t_s - self._frame_s, self._without_imu(t_s)
        no_imu, no_frame = self._no_imu(t_s), self._no_frame(f"{frame_s:.1f}")
        if no_imu is not None:
            if frame_s > limits.frame_timeout_s:
                return f"{no_imu}, and {no_frame}"
            if imu_s > limits.vision_only_s or phase in TIPPING:
                return no_imu
        if frame_s > limits.blind_timeout_s:
            return no_frame
        if frame_s > limits.frame_timeout_s and abs(travel_m - self._frame_m) > limits.blind_travel_m:
            return f"{no_frame}, {abs(travel_m - self._frame_m):.2f} m driven since"
        if t_s - self._seen_s > limits.lost_timeout_s:
            return f"no stair in view for {t_s - self._seen_s:.1f} s"
        if self._differ_s is not None and t_s - self._differ_s > limits.disagreement_s:
            return f"camera and gyro disagree for {t_s - self._differ_s:.1f} s"
        return None

    def both_lost(self, t_s: float) -> bool:
        """Return whether both camera and IMU are missing."""
        return self._no_imu(t_s) is not None and t_s - self._frame_s > self._config.frame_timeout_s

    def speed_restriction(self, t_s: float) -> tuple[str, str] | None:
        """Return the speed restriction, as a word and a reason; None if there is none."""
        no_imu = self._no_imu(t_s)
        if no_imu is not None:
            return "imu", no_imu
        if t_s - self._frame_s > self._config.frame_timeout_s:
            return "camera", self._no_frame(f"{t_s - self._frame_s:.2f}")
        return None

    def _no_frame(self, seconds: str) -> str:
        return f"no frame for {seconds} s" + (f": the last {self.refused}" if self.refused else "")

    def _without_imu(self, t_s: float) -> float:
        return t_s - min(self._imu_s, math.inf if self._stuck_s is None else self._stuck_s)

    def _no_imu(self, t_s: float) -> str | None:
        if t_s - self._imu_s > self._config.imu_timeout_s:
            return f"no IMU sample for {t_s - self._imu_s:.2f} s"
        if self._stuck_s is not None:
            return f"gyro stuck for {t_s - self._stuck_s:.2f} s"
        return None


def estimate_fault(estimate: HeadingEstimate | None, t_s: float, timeout_s: float) -> str | None:
    """Return the fault of a heading estimate, or None."""
    if estimate is None:
        return None
    if not (math.isfinite(estimate.heading_rad) and math.isfinite(estimate.heading_rate_rad_s)):
        return "heading estimate is not finite"
    if not abs(t_s - estimate.t_s) <= timeout_s:
        return f"heading estimate is {t_s - estimate.t_s:+.2f} s old"
    return None
