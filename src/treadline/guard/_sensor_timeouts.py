"""Timeouts of camera and IMU, and faults reported by the heading filter (rows 1 and 6 to 9)."""

import math
from typing import Any

from treadline.core.signals import FrameQuality, HeadingHealth, HeadingMeasurement, ImuSample, MotionPlan, StairMap
from treadline.guard._guard_config import TIPPING, GuardConfig
from treadline.guard._half_cosine_stop import Stop
from treadline.guard._known import Known, Lasting, Monitor
from treadline.guard._silence import last


class Senses(Monitor):
    """Camera lost, frozen, dark or without depth; IMU lost, not a number, or stuck; no stair in view where the plan needs one.

    Time: camera: at most 0.10 m/s after 0.3 s, hold after 3 s or 0.5 m; IMU: at most 0.10 m/s after 50 ms, hold after 1 s, at once
    over crest and edge; no stair: 12 s, also where a person drives without a planner.
    Not covered: an image of the last 3 s is frozen, but not a loop of recorded images longer than 3 s.

    A camera that sends images is judged by them, one that measures by itself by its measurements. A bench has no camera.
    """

    rows, stop = "1–4, 6, 8", Stop.RAMP
    hears = (ImuSample, FrameQuality, HeadingMeasurement, StairMap, MotionPlan, HeadingHealth)
    needs = ("needs_heading",)

    def __init__(self, config: GuardConfig) -> None:
        super().__init__(config)
        self._imu_s = self._frame_s = self._seen_s = math.inf  # until the first tick, from which on each is awaited
        self._frame_m = 0.0
        self._stuck_s = math.inf
        """Time since which the gyro is stuck."""
        self._refused = self._imu_fault = ""
        """Reasons for rejecting the last frame and the last IMU sample; empty if it was accepted."""

    def hear(self, message: Any, known: Known) -> None:
        """Update with what a sensor says, what was measured from it, or a plan that may need no stair in view."""
        match message:
            case ImuSample():
                self._imu_s, self._imu_fault = max(self._imu_s, message.t_s), ""
            case FrameQuality():
                self._refused = known.frames.refused
                needs_stair = known.plan is None or known.plan.needs_stair
                if not known.frames.refused or (known.frames.is_alive and not needs_stair):
                    self._frame(message.t_s, known)
            case HeadingMeasurement() | StairMap():
                if isinstance(message, HeadingMeasurement):
                    self._seen_s = max(self._seen_s, message.t_s)
                if known.is_reading:
                    self._refused = known.frames.refused
                    self._frame(message.t_s, known)
            case MotionPlan() if not message.needs_stair:
                self._seen_s = max(self._seen_s, message.t_s)
            case HeadingHealth():
                # A fault begins when the filter says, but never after the message itself.
                since_s = min(message.t_s if message.since_s is None else message.since_s, message.t_s)
                self._stuck_s = min(since_s, self._stuck_s) if message.fault == "stuck" else math.inf

    def reject(self, message: Any, known: Known, fault: str) -> None:
        """Note why a sample, or a measurement of a camera, was rejected."""
        if isinstance(message, ImuSample):
            self._imu_fault = fault
        elif isinstance(message, HeadingMeasurement | StairMap):
            self._refused = fault or known.frames.refused

    def restart(self, known: Known) -> None:
        """Start all timeouts again."""
        self._imu_s = self._frame_s = self._seen_s = known.t_s
        self._frame_m = known.travel.travel_m

    def _frame(self, t_s: float, known: Known) -> None:
        """Record a usable frame, and the belt travel at its exposure."""
        self._frame_s = max(self._frame_s, t_s)
        self._frame_m, _ = known.travel.at(t_s)

    def cause(self, known: Known) -> str | None:
        """Return what has been missing for too long, or None."""
        limits, t_s = self._config, known.t_s
        self._clamp(t_s)
        frame_s, driven_m, no_imu = t_s - self._frame_s, abs(known.travel.travel_m - self._frame_m), self._no_imu(t_s)
        is_tipping = known.followed is not None and known.followed.phase in TIPPING
        if no_imu is not None and (t_s - min(self._imu_s, self._stuck_s) > limits.vision_only_s or is_tipping):
            return no_imu
        if frame_s > limits.blind_timeout_s:
            return self._no_frame(frame_s)
        if frame_s > limits.silence_s and driven_m > limits.blind_travel_m:
            return f"{self._no_frame(frame_s)}, {driven_m:.2f} m driven since"
        if t_s - self._seen_s > limits.lost_timeout_s:
            return f"no stair in view for {t_s - self._seen_s:.1f} s"
        return None

    def restriction(self, known: Known) -> tuple[str, str] | None:
        """Return which sense is missing."""
        self._clamp(known.t_s)
        no_imu = self._no_imu(known.t_s)
        if no_imu is not None:
            return "imu", no_imu
        frame_s = known.t_s - self._frame_s
        return ("camera", self._no_frame(frame_s, 2)) if frame_s > self._config.silence_s else None

    def _clamp(self, t_s: float) -> None:
        """Count a stamp in the future, from a clock that is ahead, as now; without a camera nothing is awaited from it."""
        if not self._config.has_camera:
            self._frame_s = self._seen_s = t_s
        self._imu_s, self._frame_s, self._seen_s = min(self._imu_s, t_s), min(self._frame_s, t_s), min(self._seen_s, t_s)

    def _no_frame(self, silent_s: float, digits: int = 1) -> str:
        return f"no frame for {silent_s:.{digits}f} s{last(self._refused)}"

    def _no_imu(self, t_s: float) -> str | None:
        if t_s - self._imu_s > self._config.imu_timeout_s:
            return f"no IMU sample for {t_s - self._imu_s:.2f} s{last(self._imu_fault)}"
        if self._stuck_s < math.inf:
            return f"gyro stuck for {t_s - self._stuck_s:.2f} s"
        return None


class BothSenses(Senses):
    """Camera and IMU lost together: of one lost sense the other carries the heading.

    Time: 0.3 s.
    """

    rows, stop = "9", Stop.BRAKE

    def cause(self, known: Known) -> str | None:
        """Return what is missing if both are."""
        self._clamp(known.t_s)
        frame_s, no_imu = known.t_s - self._frame_s, self._no_imu(known.t_s)
        return f"{no_imu}, and {self._no_frame(frame_s)}" if no_imu is not None and frame_s > self._config.silence_s else None

    def restriction(self, known: Known) -> tuple[str, str] | None:
        """Return None: the monitor of each sense slows the chair."""
        return None


class FilterHealth(Monitor):
    """Camera and gyro disagree for most of the time, whatever time the message claims.

    Time: 0.5 s.
    Not covered: both wrong alike.

    Errors of the gyro that the heading filter has corrected are reported.
    """

    rows, stop, hears, needs = "7", Stop.RAMP, (HeadingHealth,), ("needs_heading",)

    def __init__(self, config: GuardConfig) -> None:
        super().__init__(config)
        self._differ = Lasting(config.lasting_s, config.silence_s)
        self._differs = False
        self._mended_s: float | None = math.inf

    def hear(self, message: Any, known: Known) -> None:
        """Update with the filter's health; a correction is reported once."""
        self._differs = message.fault == "disagreement"
        if message.fault in ("drift", "jump") and message.since_s != self._mended_s:
            self._mended_s = message.since_s
            known.report("re-referenced", message.cause or message.fault)

    def cause(self, known: Known) -> str | None:
        """Return a disagreement that lasts, or None."""
        lasts = self._differ.update(known.t_s, beyond=self._differs)
        return f"camera and gyro disagree for more than {self._config.lasting_s:.1f} s" if lasts else None
