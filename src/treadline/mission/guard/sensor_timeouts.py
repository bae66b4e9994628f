"""Senses that are missing: camera, IMU, both, and what the filter knows of them (rows 1, 6, 7, 8 and 9)."""

import math

from treadline.estimation.health import HeadingHealth
from treadline.mission.guard.config import GuardConfig
from treadline.mission.guard.phases import TIPPING
from treadline.signals import Event, HeadingEstimate


class SensorTimeouts:
    """When each sense last told something, and how far the chair has come since."""

    def __init__(self, config: GuardConfig) -> None:
        self._config = config
        self._imu_s = self._frame_s = self._seen_s = -math.inf
        self._frame_m = 0.0
        self._stuck_s: float | None = None
        self._differ_s: float | None = None
        self._mended_s: float | None = None
        self._health_s = -math.inf
        self.refused = ""
        """What was wrong with the last frame; empty if nothing."""

    def begin(self, t_s: float) -> None:
        """Wait from now on for each sense that has told nothing yet."""
        heard = (self._imu_s, self._frame_s, self._seen_s)
        self._imu_s, self._frame_s, self._seen_s = (t_s if last_s == -math.inf else last_s for last_s in heard)

    def restart(self, t_s: float, travel_m: float) -> None:
        """Wait for each sense anew."""
        self._imu_s = self._frame_s = self._seen_s = t_s
        self._health_s = -math.inf
        self._frame_m = travel_m

    def imu(self, t_s: float) -> None:
        """Note an IMU sample that is a number."""
        self._imu_s = max(self._imu_s, t_s)

    def frame(self, t_s: float, travel_m: float) -> None:
        """Note a frame that something can be seen in."""
        self._frame_s = max(self._frame_s, t_s)
        self._frame_m = travel_m

    def seen(self, t_s: float) -> None:
        """Note a heading measured from a frame, or that none is expected."""
        self._seen_s = max(self._seen_s, t_s)

    def health(self, health: HeadingHealth) -> Event | None:
        """Take what the heading filter knows, unless it was overtaken; return an event if it has mended a fault."""
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
        """Return why the chair must stop, or None."""
        limits = self._config
        # What a clock that is ahead tells of the future was told now.
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
        """Say whether neither camera nor IMU reports."""
        return self._no_imu(t_s) is not None and t_s - self._frame_s > self._config.frame_timeout_s

    def speed_restriction(self, t_s: float) -> tuple[str, str] | None:
        """Return why the chair must go slowly, as a word and a sentence; None if it need not."""
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
    """Return what is wrong with an estimate, or None."""
    if estimate is None:
        return None
    if not (math.isfinite(estimate.heading_rad) and math.isfinite(estimate.heading_rate_rad_s)):
        return "heading estimate is not finite"
    if not abs(t_s - estimate.t_s) <= timeout_s:
        return f"heading estimate is {t_s - estimate.t_s:+.2f} s old"
    return None
