"""Heading and gyro errors from 100 Hz gyro and 10 Hz vision: Kalman filters with gating and sensor fault detection.

``ImuSample | HeadingMeasurement | TrackReading -> HeadingEstimate``. The heading is the rotation about the normal of the
nosing plane, the chair's z axis while the flat belt run lies on the nosings. The gyro's z rate is therefore the heading
rate, independent of gravity. (The IMU's yaw is about gravity: 33.2° at a heading of 30° on a 28° stair.) Over the crest the
chair tips about the last nosing, which both belts touch; this rotation has no component along z_B, so the same integral
gives the heading on the landing.
"""

import math
from dataclasses import dataclass, field

import numpy as np

from treadline.core.angles import DEG, wrap
from treadline.core.signals import (
    MEMORY_S,
    HeadingEstimate,
    HeadingFault,
    HeadingHealth,
    HeadingMeasurement,
    ImuSample,
    Recent,
    TrackReading,
)
from treadline.estimation._fault_detection import (
    ActiveFaults,
    Drift,
    DriftRule,
    GlrDriftDetector,
    IndependentShare,
    ReacquisitionRule,
    RejectedTrack,
    StuckGyroDetector,
    StuckRule,
)
from treadline.estimation._multiple_model import GyroModel, MultipleModelKalmanFilter
from treadline.estimation.offset import COAST_S

FULL_SCALE_RAD_S = 250.0 * DEG
"""Gyro full-scale range [rad/s] (MPU-6050): belts at ±1 m/s turn the chair at 176 °/s; larger readings are invalid."""

OWN_LEAST = 0.01
"""Smallest independent share of a frame's variance; at zero the update would be singular."""
OWN_FOR_DRIFT = 0.35
"""Smallest independent share of a frame's variance for drift detection, because shared errors also wander.

With 0.25, two of twenty minutes on as-built flights gave a false drift. With 0.35 none did, and drifts of 0.5, 1 and 2 °/s were
found after 1.5, 0.6 and 0.3 s in the median, at most 0.15 s later.
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class FilterConfig:
    """Noise model, gates and fault detection of the heading filter."""

    gyro: GyroModel = field(default_factory=GyroModel)
    vibration_sigma_rad: float = 0.005 * DEG
    """Standard deviation of the vibration angle [rad]: 0.3 °/s at 8 Hz; measurement noise, because it does not accumulate."""
    gate: float = 9.0
    """Gate on χ² of one measurement: three sigma."""
    reacquisition: ReacquisitionRule = field(default_factory=ReacquisitionRule)
    drift: DriftRule = field(default_factory=DriftRule)
    turn_per_belt_rad_m: float = 0.38
    """Yaw rate per belt speed difference on a flight without an identified model [rad/m]: a quarter of the kinematic value for
    0.65 m between the belts (measured on the plant)."""
    stuck: StuckRule = field(default_factory=StuckRule)
    disagreeing_count: int = 3
    """Consecutive rejected measurements that constitute a disagreement."""
    report_s: float = 2.0
    """Duration for which a corrected fault is reported [s]."""
    coast_s: float = COAST_S
    """Time without vision after which the source is reported as the gyro [s]."""
    vision_floor_rad: float = 0.1 * DEG
    """Smallest standard deviation of a vision heading [rad]; the camera mount limits the accuracy."""
    systematic_sigma_rad: float = 0.1 * DEG
    """Standard deviation of the constant error of a drive [rad] (mount, depth distortion), not reduced by averaging."""
    memory_s: float = 1.0
    """Longest prediction without a gyro [s]."""
    gap_s: float = 0.05
    """Gap between gyro samples beyond which the motion counts as unobserved [s]."""
    unobserved_rate_sigma_rad_s: float = 10.0 * DEG
    """Standard deviation of the turn rate during a gap [rad/s]; a turn back to square reaches twice this rate."""
    belts_gauge_m: float = 0.5
    """Smallest distance between the belts [m]: the belt speed difference over this distance bounds the yaw rate."""
    belts_spare_rad_s: float = 40.0 * DEG
    """Margin on that bound for jolts [rad/s]; at most 4 °/s in whole traversals. A gyro rate beyond the bound is rejected."""
    belts_fresh_s: float = 0.1
    in_view_rad: float = 42.0 * DEG
    """Heading beyond which no flight is in view [rad]: the detector's limit of 45° less three degrees of drift in a turn."""
    frozen_rad: float = 0.1 * DEG
    """Turn by the gyro [rad] after which a vision heading repeated bit by bit counts as frozen."""


class HeadingFilter:
    """Estimator of heading, gyro bias and gyro scale with their uncertainty."""

    def __init__(self, config: FilterConfig | None = None) -> None:
        self._config = config or FilterConfig()
        self._filters = MultipleModelKalmanFilter(self._config.gyro)
        self._drifts = GlrDriftDetector(self._config.drift, self._config.turn_per_belt_rad_m)
        self._stuck = StuckGyroDetector(self._config.stuck)
        self._rejected = RejectedTrack(self._config.reacquisition)
        self._belts: TrackReading | None = None
        self._scatter = IndependentShare()
        self._memory: Recent[float] = Recent()
        self._now_s = -math.inf
        """Stamp of the newest signal, also of one that is not used."""
        self._t_s: float | None = None
        self._imu_s: float | None = None
        self._frame: HeadingMeasurement | None = None
        self._repeated_since = (0.0, 0.0)
        self._seen_s: float | None = None
        self._rate = 0.0
        self._turned = 0.0
        self._disagreement = 0.0
        self._faults = ActiveFaults()
        self._latest: HeadingEstimate | None = None
        self.rejected_count = 0

    def step(self, signal: ImuSample | HeadingMeasurement | TrackReading) -> HeadingEstimate | None:
        """Take one signal; return the current heading, or None before the first heading.

        Belt readings are optional. They distinguish a stuck gyro from a standing chair, and speed up drift detection.
        """
        self._now_s = max(self._now_s, signal.t_s)
        match signal:
            case ImuSample():
                self._predict(signal)
            case HeadingMeasurement():
                self._correct(signal)
            case TrackReading():
                self._update_belts(signal)
                return self._latest  # belts do not move the heading
        self._latest = self._estimate()
        return self._latest

    @property
    def health(self) -> HeadingHealth | None:
        """Current sensor faults and statistics, or None before the first heading."""
        if self._seen_s is None or self._t_s is None:
            return None
        found = self._faults.most_severe(self._t_s)
        return HeadingHealth(
            t_s=self._now_s,
            fault=None if found is None else found.kind,
            since_s=None if found is None else found.since_s,
            cause=None if found is None else found.cause,
            disagreement_rad=self._disagreement,
            unseen_s=max(self._t_s - self._seen_s, 0.0),
            bias_rad_s=self._filters.moments.bias,
            scale=self._filters.moments.scale,
            walk_rad_rts=self._filters.moments.angle_random_walk_rad_sqrt_s,
        )

    def _estimate(self) -> HeadingEstimate | None:
        if self._seen_s is None or self._t_s is None:
            return None
        moments, fresh = self._filters.moments, self._t_s - self._seen_s <= self._config.coast_s
        return HeadingEstimate(
            t_s=self._t_s,
            heading_rad=moments.heading,
            # Without a gyro no rate is available.
            heading_rate_rad_s=self._rate - moments.bias if self._t_s == self._imu_s else 0.0,
            sigma_rad=math.sqrt(moments.variance + self._config.vibration_sigma_rad**2 + self._config.systematic_sigma_rad**2),
            source="vision" if fresh else "gyro",
        )

    def _predict(self, sample: ImuSample) -> None:
        t_s, rate = sample.t_s, sample.angular_velocity_rad_s[2]
        if not (math.isfinite(t_s) and math.isfinite(rate)):
            return
        if self._imu_s is not None and not t_s > self._imu_s:
            return  # a repeated or earlier stamp carries no new motion
        if self._is_stuck(sample) or self._is_implausible(sample):
            return
        # Mean rate over the step by the trapezoid rule.
        mean = rate if self._imu_s is None else 0.5 * (rate + self._rate)
        gap = t_s - self._integrated_until(t_s)
        dt = min(gap, self._config.memory_s)
        self._t_s = self._imu_s = t_s
        self._rate = rate
        self._turned += dt * mean
        self._memory.add(t_s, self._turned)
        if self._seen_s is None:
            return
        self._drifts.propagate(self._filters.propagate(dt, mean), dt, mean - self._filters.moments.bias)
        self._move_unobserved(gap)

    def _is_stuck(self, sample: ImuSample) -> bool:
        """Whether the gyro has repeated its reading for too long to carry information."""
        same_s = self._stuck.stuck_s(sample)
        if same_s == 0.0:
            self._faults.clear("stuck")
            return False
        if not self._faults.is_active("stuck", sample.t_s):
            rate = sample.angular_velocity_rad_s[2] / DEG
            self._report_fault("stuck", sample.t_s, f"gyro reading constant at {rate:.3f} °/s for {same_s:.2f} s", math.inf)
            # The motion since the gyro stuck is unobserved.
            self._move_unobserved(same_s)
        return True

    def _is_implausible(self, sample: ImuSample) -> bool:
        """Whether a sample exceeds the gyro's range or the turn rate that the belts can cause; such a sample is rejected."""
        belts, limits = self._belts, self._config
        measured = sample.angular_velocity_rad_s[2]
        if abs(measured) > FULL_SCALE_RAD_S:
            self._report_fault(
                "jump", sample.t_s, f"gyro reads {measured / DEG:+.0f} °/s, beyond its range of {FULL_SCALE_RAD_S / DEG:.0f}"
            )
            return True
        if belts is None or abs(sample.t_s - belts.t_s) > limits.belts_fresh_s:
            return False
        rate = measured - self._filters.moments.bias
        most = abs(belts.right_m_s - belts.left_m_s) / limits.belts_gauge_m + limits.belts_spare_rad_s
        if abs(rate) <= most:
            return False
        self._report_fault(
            "jump", sample.t_s, f"gyro reads {rate / DEG:+.0f} °/s, the belts turn the chair by at most {most / DEG:.0f}"
        )
        return True

    def _integrated_until(self, t_s: float) -> float:
        """Return the time up to which the heading is integrated, for a gyro sample at ``t_s``."""
        if self._t_s is not None and self._t_s <= t_s:
            return self._t_s
        # A frame stamped ahead of the gyro's clock is not evidence of the future.
        self._frame = None
        return t_s if self._imu_s is None else self._imu_s

    def _move_unobserved(self, gap_s: float) -> None:
        """Add the uncertainty of the motion during a gap in the gyro samples."""
        if gap_s > self._config.gap_s:
            # The uncertainty is limited to half a turn.
            self._filters.widen(min(self._config.unobserved_rate_sigma_rad_s * gap_s, math.pi) ** 2)
            self._drifts.clear()

    def _update_belts(self, reading: TrackReading) -> None:
        if math.isfinite(reading.t_s) and math.isfinite(reading.left_m_s) and math.isfinite(reading.right_m_s):
            self._belts = reading
            self._stuck.belts(reading)
            self._drifts.belts(reading.t_s, reading.right_m_s - reading.left_m_s)

    def _correct(self, seen: HeadingMeasurement) -> None:
        if not self._usable(seen):
            return
        self._apply_correction(seen)
        since_s = 0.0 if self._seen_s is None else seen.t_s - self._seen_s
        self._carry_without_gyro(seen.t_s)
        age_s, later = self._since(seen.t_s)
        turned = self._turned - later
        frozen = self._frame is not None and (seen.heading_rad, seen.sigma_rad) == (self._frame.heading_rad, self._frame.sigma_rad)
        self._frame = seen
        if not frozen:
            self._repeated_since = (seen.t_s, turned)
        elif (
            abs(turned - self._repeated_since[1] - self._filters.moments.bias * (seen.t_s - self._repeated_since[0]))
            > self._config.frozen_rad
        ):
            return
        heading = wrap(seen.heading_rad + later - self._filters.moments.bias * age_s)
        variance = max(seen.sigma_rad, self._config.vision_floor_rad) ** 2
        own = self._scatter.own(seen.t_s, wrap(seen.heading_rad - turned), math.sqrt(variance))
        white, shared = max(own, OWN_LEAST) * variance + self._config.vibration_sigma_rad**2, (1.0 - own) * variance
        if self._seen_s is None:
            self._reinitialise(seen, heading, white, shared, turned)
            return
        self._filters.share(shared)
        innovation = wrap(heading - self._filters.moments.vision)
        vision_variance = self._filters.moments.vision_variance
        # The gate includes the whole declared variance, because the shared error may have changed.
        accepted = innovation * innovation <= self._config.gate * (vision_variance + variance)
        gain = self._filters.correct(heading, white, since_s) if accepted else np.zeros(4)
        drift = self._drifts.frame(seen.t_s, innovation, vision_variance + max(white, OWN_FOR_DRIFT * variance), gain)
        if accepted:
            self._rejected.accepted(seen.t_s, seen.heading_rad, turned)
            self._seen_s = seen.t_s
            self._clear_disagreement()
        if drift is not None:
            self._correct_drift(drift, seen.t_s)
        elif not accepted:
            self._reject(seen, innovation, heading, white, shared, turned)

    def _apply_correction(self, seen: HeadingMeasurement) -> None:
        """Move the heading by the error of all earlier measurements, which the gyro's bias has no part in.

        The measurement that carries a correction is the first without the error.
        """
        if seen.correction_rad == 0.0 or self._seen_s is None:
            return
        self._filters.shift(np.array([-seen.correction_rad, 0.0, 0.0, 0.0]), np.zeros((4, 4)))
        self._drifts.clear()
        self._rejected.clear()
        self._scatter.restart()

    def _reject(
        self, seen: HeadingMeasurement, innovation: float, heading: float, white: float, shared: float, turned: float
    ) -> None:
        self.rejected_count += 1
        self._disagreement = innovation
        if self._is_of_another_flight(seen.t_s):
            self._reinitialise(seen, heading, white, shared, turned)
        elif self._rejected.agree(seen.t_s, seen.heading_rad, turned):
            if self._rejected.smooth:
                self._report_fault("jump", seen.t_s, f"gyro jumped by {-innovation / DEG:.1f}° relative to vision")
            self._reinitialise(seen, heading, white, shared, turned)
        elif self._rejected.count >= self._config.disagreeing_count:
            count = self._rejected.count
            self._report_fault(
                "disagreement", seen.t_s, f"{count} consecutive headings rejected, the last {innovation / DEG:+.1f}° off", math.inf
            )

    def _is_of_another_flight(self, t_s: float) -> bool:
        """Whether the chair has turned away from its flight, out of every camera's view, before a flight came into view."""
        unseen_s = math.inf if self._seen_s is None else t_s - self._seen_s
        return unseen_s > self._config.coast_s and abs(self._filters.moments.heading) > self._config.in_view_rad

    def _correct_drift(self, drift: Drift, t_s: float) -> None:
        self._filters.shift(drift.error, drift.covariance)
        self._drifts.clear()
        self._rejected.clear()
        self._clear_disagreement()
        self._report_fault("drift", t_s, f"gyro drifts by {drift.rate_rad_s / DEG:+.1f} °/s since {drift.began_s:.2f} s")

    def _clear_disagreement(self) -> None:
        self._disagreement = 0.0
        self._faults.clear("disagreement")

    def _report_fault(self, kind: HeadingFault, t_s: float, cause: str, for_s: float | None = None) -> None:
        self._faults.report(kind, t_s, t_s + (self._config.report_s if for_s is None else for_s), cause)

    def _usable(self, seen: HeadingMeasurement) -> bool:
        """Whether a measurement is finite, newer than the previous, and close enough to the gyro's clock."""
        if not (math.isfinite(seen.t_s) and math.isfinite(seen.heading_rad) and 0.0 < seen.sigma_rad <= math.pi):
            return False
        if self._frame is not None and not seen.t_s > self._frame.t_s:
            return False
        return self._imu_s is None or abs(seen.t_s - self._imu_s) <= self._config.memory_s

    def _carry_without_gyro(self, t_s: float) -> None:
        """Extrapolate to a frame after the gyro has stopped."""
        if self._t_s is None:
            self._t_s = t_s
        elif t_s - self._t_s > self._config.gap_s:
            self._move_unobserved(t_s - self._t_s)
            self._t_s = t_s

    def _reinitialise(self, seen: HeadingMeasurement, heading: float, white: float, shared: float, turned: float) -> None:
        self._filters.start(heading, white, shared, known=self._seen_s is not None)
        self._drifts.clear()
        self._rejected.restart(seen.t_s, seen.heading_rad, turned)
        self._seen_s = seen.t_s
        self._clear_disagreement()

    def _since(self, t_s: float) -> tuple[float, float]:
        """Return the age of a frame, limited by the history of the gyro, and the turn by the gyro since it was taken."""
        then = self._memory.at(t_s)
        if self._t_s is None or t_s >= self._t_s or then is None:
            return 0.0, 0.0
        return min(self._t_s - t_s, MEMORY_S), self._turned - then
