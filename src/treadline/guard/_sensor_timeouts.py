"""Timeouts of camera, IMU, drives, processes and link, and faults reported by the heading filter (rows 1 and 6 to 9)."""

import math
from collections.abc import Iterable

from treadline.core.signals import ROUNDING_S, Event, HeadingHealth
from treadline.guard._guard_config import TIPPING, GuardConfig
from treadline.guard._lasting import Lasting


class SilenceMonitor:
    """Time since each of several sources last reported.

    Args:
        timeout_s: Longest silence [s].
        what: Words before the name of a source.
        awaited: Sources that are awaited from the first tick; others are awaited once they have reported.
    """

    def __init__(self, timeout_s: float, what: str = "", awaited: Iterable[str] = ()) -> None:
        self._timeout_s, self._what = timeout_s, what
        self._heard_s: dict[str, float] = dict.fromkeys(awaited, math.inf)
        self._faults: dict[str, str] = {}

    def expect(self, source: str) -> None:
        """Await a source from now on."""
        self._heard_s.setdefault(source, math.inf)

    def heard(self, source: str, t_s: float) -> None:
        """Record a report."""
        self._heard_s[source] = max(t_s, self._heard_s.get(source, t_s))
        self._faults.pop(source, None)

    def rejected(self, source: str, fault: str) -> None:
        """Record why the report of a source was rejected; a rejected report ends no silence."""
        self._faults[source] = fault

    def cause(self, t_s: float) -> str | None:
        """Return which source has been silent for too long, or None.

        A source that has not reported yet counts as heard at the first call, and a report from the future as made now.
        """
        for source, heard_s in self._heard_s.items():
            self._heard_s[source] = min(heard_s, t_s)
            if t_s - heard_s > self._timeout_s:
                return f"{self._what}{source} silent for {t_s - heard_s:.2f} s{_last(self._faults.get(source, ''))}"
        return None

    def restart(self, t_s: float) -> None:
        """Wait for each source anew."""
        self._heard_s = dict.fromkeys(self._heard_s, t_s)

    def excuse(self, passed_s: float) -> None:
        """Leave out of each silence what a guard that did not run for ``passed_s`` could not hear, beyond the timeout."""
        for source in self._heard_s:
            self._heard_s[source] += max(passed_s - self._timeout_s, 0.0) + ROUNDING_S


class MapMonitor:
    """Time for which headings have come without a stair map.

    Args:
        timeout_s: Longest such time [s].
    """

    def __init__(self, timeout_s: float) -> None:
        self._timeout_s = timeout_s
        self._since_s: float | None = None
        self.cause: str | None = None

    def seen(self, t_s: float) -> None:
        """Record a measured heading."""
        self._since_s = t_s if self._since_s is None else self._since_s
        if t_s - self._since_s > self._timeout_s:
            self.cause = f"headings without a stair map for {t_s - self._since_s:.1f} s"

    def forget(self) -> None:
        """Record a map, or start again."""
        self._since_s = self.cause = None


def _last(fault: str) -> str:
    return f": the last {fault}" if fault else ""


class SensorTimeouts:
    """Time of the last data of each sensor, and belt travel since the last frame."""

    def __init__(self, config: GuardConfig) -> None:
        self._config = config
        self._imu_s = self._frame_s = self._seen_s = math.inf  # until the first tick, from which on each is awaited
        self._frame_m = 0.0
        self._fault: str | None = None
        self._since_s = math.inf
        self._differ = Lasting(config.lasting_s, config.silence_s)
        self._mended_s: float | None = None
        self.refused = ""
        """Reason for rejecting the last frame; empty if it was accepted."""
        self.imu_fault = ""
        """Reason for rejecting the last IMU sample; empty if it was accepted."""

    def restart(self, t_s: float, travel_m: float) -> None:
        """Start all timeouts again."""
        self._imu_s = self._frame_s = self._seen_s = t_s
        self._frame_m = travel_m

    def imu(self, t_s: float) -> None:
        """Record an IMU sample."""
        self._imu_s, self.imu_fault = max(self._imu_s, t_s), ""

    def frame(self, t_s: float, travel_m: float) -> None:
        """Record a usable frame, and the belt travel at its exposure."""
        self._frame_s = max(self._frame_s, t_s)
        self._frame_m = travel_m

    def seen(self, t_s: float) -> None:
        """Record a heading measured from a frame, or a plan that needs no stair in view."""
        self._seen_s = max(self._seen_s, t_s)

    def health(self, health: HeadingHealth) -> Event | None:
        """Update with the heading filter's faults; return an event if the filter corrected one.

        A fault begins when the filter says, but never after the message itself.
        """
        since_s = min(health.t_s if health.since_s is None else health.since_s, health.t_s)
        self._since_s = min(since_s, self._since_s) if health.fault == self._fault else since_s
        self._fault = health.fault
        if health.fault not in ("drift", "jump") or since_s == self._mended_s:
            return None
        self._mended_s = since_s
        return Event(t_s=health.t_s, name="re-referenced", cause=health.cause or health.fault)

    def alarm(self, t_s: float, travel_m: float, phase: str | None) -> str | None:
        """Return the reason to hold, or None."""
        limits = self._config
        differ = self._differ.update(t_s, beyond=self._fault == "disagreement")
        # A stamp in the future, from a clock that is ahead, counts as now.
        self._imu_s, self._frame_s, self._seen_s = min(self._imu_s, t_s), min(self._frame_s, t_s), min(self._seen_s, t_s)
        frame_s, no_imu = t_s - self._frame_s, self._no_imu(t_s)
        if no_imu is not None:
            if frame_s > limits.silence_s:
                return f"{no_imu}, and {self._no_frame(f'{frame_s:.1f}')}"
            if self._without_imu(t_s) > limits.vision_only_s or phase in TIPPING:
                return no_imu
        if frame_s > limits.blind_timeout_s:
            return self._no_frame(f"{frame_s:.1f}")
        if frame_s > limits.silence_s and abs(travel_m - self._frame_m) > limits.blind_travel_m:
            return f"{self._no_frame(f'{frame_s:.1f}')}, {abs(travel_m - self._frame_m):.2f} m driven since"
        if t_s - self._seen_s > limits.lost_timeout_s:
            return f"no stair in view for {t_s - self._seen_s:.1f} s"
        if differ:
            return f"camera and gyro disagree for more than {limits.lasting_s:.1f} s"
        return None

    def both_lost(self, t_s: float) -> bool:
        """Return whether both camera and IMU are missing."""
        return self._no_imu(t_s) is not None and t_s - self._frame_s > self._config.silence_s

    def speed_restriction(self, t_s: float) -> tuple[str, str] | None:
        """Return the speed restriction, as a word and a reason; None if there is none."""
        no_imu = self._no_imu(t_s)
        if no_imu is not None:
            return "imu", no_imu
        if t_s - self._frame_s > self._config.silence_s:
            return "camera", self._no_frame(f"{t_s - self._frame_s:.2f}")
        return None

    def _no_frame(self, seconds: str) -> str:
        return f"no frame for {seconds} s{_last(self.refused)}"

    def _without_imu(self, t_s: float) -> float:
        return t_s - min(self._imu_s, self._since_s if self._fault == "stuck" else math.inf)

    def _no_imu(self, t_s: float) -> str | None:
        if t_s - self._imu_s > self._config.imu_timeout_s:
            return f"no IMU sample for {t_s - self._imu_s:.2f} s{_last(self.imu_fault)}"
        if self._fault == "stuck":
            return f"gyro stuck for {t_s - self._since_s:.2f} s"
        return None
