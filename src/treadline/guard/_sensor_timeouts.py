"""Times of messages: timeouts of camera and IMU, faults reported by the heading filter, time stamps (rows 1 and 6 to 10).

For stamps there is one rule for what is ahead of the clock, and one clock per kind of reading.
"""

import math
from collections import Counter

from treadline.core.signals import ROUNDING_S, Event, HeadingEstimate, HeadingHealth
from treadline.guard._guard_config import TIPPING, GuardConfig


class Timestamps:
    """Checks stamps against the guard's clock, and readings against the previous stamp of their kind.

    Args:
        ahead_s: A message whose stamp is further ahead of the clock is rejected and counted [s].
        leap_s: A reading whose stamp is further ahead, or further behind the previous one, is a fault of its clock [s].
    """

    def __init__(self, ahead_s: float, leap_s: float) -> None:
        self._ahead_s, self._leap_s = ahead_s, leap_s
        self._now_s: float | None = None
        self._last_s: dict[str, float] = {}
        self._is_rejected: set[str] = set()
        self.rejected: Counter[str] = Counter()
        """Number of messages rejected because their stamp is ahead of the clock, by kind."""
        self.rejection: str | None = None
        """Reason of the last rejection, if the message before it of the same kind was accepted."""
        self.leap: str | None = None
        """How far the stamp of the last reading leapt, if it did."""

    def advance(self, now_s: float) -> None:
        """Set the clock."""
        self._now_s = now_s

    def accept(self, kind: str, t_s: float) -> bool:
        """Return whether a stamp is not ahead of the clock; before the first tick every stamp is accepted."""
        self.rejection = None
        ahead_s = 0.0 if self._now_s is None else t_s - self._now_s
        if not ahead_s > self._ahead_s + ROUNDING_S:
            self._is_rejected.discard(kind)
            return True
        self.rejected[kind] += 1
        if kind not in self._is_rejected:
            self._is_rejected.add(kind)
            self.rejection = f"{kind} stamped {ahead_s:.2f} s ahead of the clock"
        return False

    def accept_reading(self, kind: str, t_s: float) -> bool:
        """Return whether a reading's stamp is not ahead of the clock, and newer than the previous one of its kind."""
        self.leap = None
        if not self.accept(kind, t_s):
            ahead_s = t_s - (self._now_s or 0.0)
            if ahead_s > self._leap_s:
                self.leap = f"clock of {kind} leapt {ahead_s:.2f} s ahead"
            return False
        last_s = self._last_s.get(kind, -math.inf)
        if last_s - t_s > self._leap_s:
            # Later readings are compared with the new time, so that a person can re-arm.
            self._last_s[kind] = t_s
            self.leap = f"clock of {kind} leapt {last_s - t_s:.2f} s back"
            return False
        if not (math.isfinite(t_s) and t_s > last_s):
            return False
        self._last_s[kind] = t_s
        return True


class SilenceMonitor:
    """Time since each of several sources last reported; a source that has never reported is not awaited."""

    def __init__(self, timeout_s: float, what: str) -> None:
        self._timeout_s = timeout_s
        self._what = what
        self._heard_s: dict[str, float] = {}

    def heard(self, source: str, t_s: float) -> None:
        """Record a report."""
        self._heard_s[source] = max(t_s, self._heard_s.get(source, t_s))

    def cause(self, t_s: float) -> str | None:
        """Return which source has been silent for too long, or None; a report from the future counts as made now."""
        for source, heard_s in self._heard_s.items():
            self._heard_s[source] = min(heard_s, t_s)
            if t_s - heard_s > self._timeout_s:
                return f"{self._what}{source} silent for {t_s - heard_s:.2f} s"
        return None

    def restart(self, t_s: float) -> None:
        """Wait for each source anew."""
        self._heard_s = dict.fromkeys(self._heard_s, t_s)


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
        frame_s, no_imu = t_s - self._frame_s, self._no_imu(t_s)
        if no_imu is not None:
            if frame_s > limits.frame_timeout_s:
                return f"{no_imu}, and {self._no_frame(f'{frame_s:.1f}')}"
            if self._without_imu(t_s) > limits.vision_only_s or phase in TIPPING:
                return no_imu
        if frame_s > limits.blind_timeout_s:
            return self._no_frame(f"{frame_s:.1f}")
        if frame_s > limits.frame_timeout_s and abs(travel_m - self._frame_m) > limits.blind_travel_m:
            return f"{self._no_frame(f'{frame_s:.1f}')}, {abs(travel_m - self._frame_m):.2f} m driven since"
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
