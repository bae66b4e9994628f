"""Heading and gyro errors from 100 Hz of gyro and 10 Hz of vision: Kalman filters with a gate, and watches over both sensors.

``ImuSample | HeadingMeasurement | TrackReading -> HeadingEstimate``. Heading turns about the nosing plane's normal, which is the
chair's own z axis while its flat run lies on the nosings: the gyro's z is its rate, with no gravity in between. (The
IMU's yaw is about gravity and reads 33.2° where the heading is 30° on a 28° stair.) Over the crest the chair tips about
the last nosing, which both of its belts lie on: that rotation has no part along z_B, so the same integral arrives on the
landing with the heading it had on the stair.
"""

import math
from dataclasses import dataclass, field

import numpy as np

from treadline.angles import DEG, wrap
from treadline.estimation.bank import GyroModel, KalmanBank
from treadline.estimation.drift import Drift, DriftRule, DriftWatch
from treadline.estimation.health import FaultKind, Faults, HeadingHealth, Memory, Scatter, StuckRule, StuckWatch
from treadline.estimation.reacquire import ReacquisitionRule, Refused
from treadline.signals import HeadingEstimate, HeadingMeasurement, ImuSample, TrackReading

FULL_SCALE_RAD_S = 250.0 * DEG
"""Range of the gyro (MPU-6050) that a chair needs: belts at ±1 m/s turn it at 176 °/s. A rate beyond it was never measured."""

OWN_LEAST = 0.01
"""Least share of a frame's variance that its neighbours do not share: at none an update would be singular."""
OWN_FOR_DRIFT = 0.35
"""The same where a drift is looked for: errors that frames share wander too.

With a quarter, two of twenty minutes on as-built flights had a drift that was none; so none had, and drifts of 0.5, 1 and 2 °/s
were found after 1.5, 0.6 and 0.3 s in the median, 0.15 s later at most.
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class FilterConfig:
    """What the sensors are trusted with."""

    gyro: GyroModel = field(default_factory=GyroModel)
    shake_rad: float = 0.005 * DEG
    """Angle by which the chassis shakes about where it heads, 0.3 °/s at 8 Hz: it does not add up, so it is the measurements'."""
    gate: float = 9.0
    """χ² of one measurement beyond which it is not believed: three sigma."""
    reacquisition: ReacquisitionRule = field(default_factory=ReacquisitionRule)
    drift: DriftRule = field(default_factory=DriftRule)
    stuck: StuckRule = field(default_factory=StuckRule)
    disagreeing_count: int = 3
    """Measurements refused in a row that make a disagreement."""
    told_s: float = 2.0
    """How long a fault that was mended is told."""
    coast_s: float = 0.5
    """Without vision for longer, the source is the gyro."""
    vision_floor_rad: float = 0.1 * DEG
    """No heading seen is better than this, whatever it declares: the mount alone is not …"""
    lasting_rad: float = 0.1 * DEG
    """… and this much of it is the same in all frames of a drive: mount, warp of the depth; no averaging takes it away."""
    memory_s: float = 1.0
    """How far back a late frame may lie, and how long vision carries the heading without a gyro."""
    gap_s: float = 0.05
    """Without a gyro sample for longer, the chair has moved unseen."""
    unseen_rate_rad_s: float = 10.0 * DEG
    """One sigma of how fast it turns then; a turn back to square reaches twice that."""
    belts_gauge_m: float = 0.5
    """Between the belts, at least: what they run apart turns the chair by no more than their difference over this …"""
    belts_spare_rad_s: float = 40.0 * DEG
    """… and a jolt adds little: 4 °/s at most in whole traversals. What a gyro says beyond both is no motion."""
    belts_fresh_s: float = 0.1
    frozen_rad: float = 0.1 * DEG
    """A heading that is repeated to the last bit, though the gyro has turned by more since it was first said, shows the past."""


class HeadingFilter:
    """Heading, gyro bias and gyro scale, and how far they can be trusted."""

    def __init__(self, config: FilterConfig | None = None) -> None:
        self._config = config or FilterConfig()
        self._bank = KalmanBank(self._config.gyro)
        self._drifts = DriftWatch(self._config.drift)
        self._stuck = StuckWatch(self._config.stuck)
        self._refused = Refused(self._config.reacquisition)
        self._belts: TrackReading | None = None
        self._scatter = Scatter()
        self._memory = Memory(self._config.memory_s)
        self._t_s: float | None = None
        self._imu_s: float | None = None
        self._frame: HeadingMeasurement | None = None
        self._said = (0.0, 0.0)
        self._seen_s: float | None = None
        self._rate = 0.0
        self._turned = 0.0
        self._disagreement = 0.0
        self._faults = Faults()
        self.rejected_count = 0

    def step(self, signal: ImuSample | HeadingMeasurement | TrackReading) -> HeadingEstimate | None:
        """Take one signal; return the heading now, or None before the first heading.

        Belts are not needed. They tell a gyro that is stuck from a chair that stands, and a gyro that drifts sooner.
        """
        match signal:
            case ImuSample():
                self._predict(signal)
            case HeadingMeasurement():
                self._correct(signal)
            case TrackReading():
                self._note_belts(signal)
        return self._estimate()

    @property
    def health(self) -> HeadingHealth | None:
        """What is known to be wrong, or None before the first heading."""
        if self._seen_s is None or self._t_s is None:
            return None
        found = self._faults.gravest(self._t_s)
        return HeadingHealth(
            t_s=self._t_s,
            fault=None if found is None else found.kind,
            since_s=None if found is None else found.since_s,
            cause=None if found is None else found.cause,
            disagreement_rad=self._disagreement,
            unseen_s=max(self._t_s - self._seen_s, 0.0),
            bias_rad_s=self._bank.belief.bias,
            scale=self._bank.belief.scale,
            walk_rad_rts=self._bank.belief.walk_rad_rts,
        )

    def _estimate(self) -> HeadingEstimate | None:
        if self._seen_s is None or self._t_s is None:
            return None
        fresh = self._t_s - self._seen_s <= self._config.coast_s
        return HeadingEstimate(
            t_s=self._t_s,
            heading_rad=self._bank.belief.heading,
            # Without a gyro the rate is nobody's to tell.
            heading_rate_rad_s=self._rate - self._bank.belief.bias if self._t_s == self._imu_s else 0.0,
            sigma_rad=math.sqrt(self._bank.belief.variance + self._config.shake_rad**2 + self._config.lasting_rad**2),
            source="vision" if fresh else "gyro",
        )

    def _predict(self, sample: ImuSample) -> None:
        t_s, rate = sample.t_s, float(sample.angular_velocity_rad_s[2])
        if not (math.isfinite(t_s) and math.isfinite(rate)):
            return
        if self._imu_s is not None and not t_s > self._imu_s:
            return  # a repeated or earlier stamp carries no new motion
        if self._is_stuck(sample) or self._is_impossible(sample):
            return
        # The mean rate over the step, by the trapezoid rule.
        mean = rate if self._imu_s is None else 0.5 * (rate + self._rate)
        gap = t_s - self._last_known(t_s)
        dt = min(gap, self._config.memory_s)
        self._t_s = self._imu_s = t_s
        self._rate = rate
        self._turned += dt * mean
        self._memory.remember(t_s, self._turned)
        if self._seen_s is None:
            return
        self._drifts.propagate(self._bank.propagate(dt, mean), dt, mean - self._bank.belief.bias)
        self._move_unseen(gap)

    def _is_stuck(self, sample: ImuSample) -> bool:
        """Say whether a sample only repeats what the gyro said long ago: no motion is known from it."""
        same_s = self._stuck.stuck_s(sample)
        if same_s == 0.0:
            self._faults.forgive("stuck")
            return False
        if not self._faults.knows("stuck", sample.t_s):
            rate = float(sample.angular_velocity_rad_s[2]) / DEG
            self._tell("stuck", sample.t_s, f"gyro has said {rate:.3f} °/s for {same_s:.2f} s", math.inf)
            # All since it stuck was unseen.
            self._move_unseen(same_s)
        return True

    def _is_impossible(self, sample: ImuSample) -> bool:
        """Say whether a sample tells of a turn that no gyro measures or no belts have made: it is left out as if it never came."""
        belts, limits = self._belts, self._config
        said = float(sample.angular_velocity_rad_s[2])
        if abs(said) > FULL_SCALE_RAD_S:
            self._tell("jump", sample.t_s, f"gyro says {said / DEG:+.0f} °/s, beyond its range of {FULL_SCALE_RAD_S / DEG:.0f}")
            return True
        if belts is None or abs(sample.t_s - belts.t_s) > limits.belts_fresh_s:
            return False
        rate = said - self._bank.belief.bias
        most = abs(belts.right_m_s - belts.left_m_s) / limits.belts_gauge_m + limits.belts_spare_rad_s
        if abs(rate) <= most:
            return False
        self._tell("jump", sample.t_s, f"gyro says {rate / DEG:+.0f} °/s, the belts turn the chair by {most / DEG:.0f} at most")
        return True

    def _last_known(self, t_s: float) -> float:
        """Return the time up to which the heading is known, for a gyro sample at ``t_s``."""
        if self._t_s is not None and self._t_s <= t_s:
            return self._t_s
        # A frame stamped ahead of the gyro's clock did not show the future.
        self._frame = None
        return t_s if self._imu_s is None else self._imu_s

    def _move_unseen(self, gap_s: float) -> None:
        """Add what the chair may have turned while no gyro sample came."""
        if gap_s > self._config.gap_s:
            # Beyond half a turn there is nothing more to forget.
            self._bank.widen(min(self._config.unseen_rate_rad_s * gap_s, math.pi) ** 2)
            self._drifts.clear()

    def _note_belts(self, reading: TrackReading) -> None:
        if math.isfinite(reading.t_s) and math.isfinite(reading.left_m_s) and math.isfinite(reading.right_m_s):
            self._belts = reading
            self._stuck.belts(reading)
            self._drifts.belts(reading.t_s, reading.right_m_s - reading.left_m_s)

    def _correct(self, seen: HeadingMeasurement) -> None:
        if not self._usable(seen):
            return
        since_s = 0.0 if self._seen_s is None else seen.t_s - self._seen_s
        self._carry_without_gyro(seen.t_s)
        later = self._turned_since(seen.t_s)
        turned = self._turned - later
        frozen = self._frame is not None and (seen.heading_rad, seen.sigma_rad) == (self._frame.heading_rad, self._frame.sigma_rad)
        self._frame = seen
        if not frozen:
            self._said = (seen.t_s, turned)
        elif abs(turned - self._said[1] - self._bank.belief.bias * (seen.t_s - self._said[0])) > self._config.frozen_rad:
            return
        heading = wrap(seen.heading_rad + later - self._bank.belief.bias * self._age(seen.t_s))
        variance = max(seen.sigma_rad, self._config.vision_floor_rad) ** 2
        own = self._scatter.own(seen.t_s, wrap(seen.heading_rad - turned), math.sqrt(variance))
        white, shared = max(own, OWN_LEAST) * variance + self._config.shake_rad**2, (1.0 - own) * variance
        if self._seen_s is None:
            self._take(seen, heading, white, shared, turned)
            return
        self._bank.share(shared)
        innovation = wrap(heading - self._bank.belief.seen)
        spread = self._bank.belief.seen_variance
        # The gate leaves room for all that the frame declares: what it shares with its neighbours may have begun to change.
        accepted = innovation * innovation <= self._config.gate * (spread + variance)
        gain = self._bank.correct(heading, white, since_s) if accepted else np.zeros(4)
        drift = self._drifts.frame(seen.t_s, innovation, spread + max(white, OWN_FOR_DRIFT * variance), gain)
        if accepted:
            self._refused.accepted(seen.t_s, seen.heading_rad, turned)
            self._seen_s = seen.t_s
            self._disagreement = 0.0
            self._faults.forgive("disagreement")
        if drift is not None:
            self._mend(drift, seen.t_s)
        elif not accepted:
            self._refuse(seen, innovation, heading, white, shared, turned)

    def _refuse(
        self, seen: HeadingMeasurement, innovation: float, heading: float, white: float, shared: float, turned: float
    ) -> None:
        self.rejected_count += 1
        self._disagreement = innovation
        if self._refused.agree(seen.t_s, seen.heading_rad, turned):
            if self._refused.smooth:
                self._tell("jump", seen.t_s, f"gyro has jumped by {-innovation / DEG:.1f}° against vision")
            self._take(seen, heading, white, shared, turned)
        elif self._refused.count >= self._config.disagreeing_count:
            count = self._refused.count
            self._tell(
                "disagreement", seen.t_s, f"{count} headings in a row refused, the last {innovation / DEG:+.1f}° off", math.inf
            )

    def _mend(self, drift: Drift, t_s: float) -> None:
        self._bank.shift(drift.error, drift.spread)
        self._drifts.clear()
        self._refused.clear()
        self._disagreement = 0.0
        self._faults.forgive("disagreement")
        self._tell("drift", t_s, f"gyro drifts by {drift.rate_rad_s / DEG:+.1f} °/s since {drift.began_s:.2f} s")

    def _tell(self, kind: FaultKind, t_s: float, cause: str, for_s: float | None = None) -> None:
        self._faults.tell(kind, t_s, t_s + (self._config.told_s if for_s is None else for_s), cause)

    def _usable(self, seen: HeadingMeasurement) -> bool:
        """Say whether a measurement is a number, newer than the one before, and near enough to the gyro's clock."""
        if not (math.isfinite(seen.t_s) and math.isfinite(seen.heading_rad) and 0.0 < seen.sigma_rad <= math.pi):
            return False
        if self._frame is not None and not seen.t_s > self._frame.t_s:
            return False
        return self._imu_s is None or abs(seen.t_s - self._imu_s) <= self._config.memory_s

    def _carry_without_gyro(self, t_s: float) -> None:
        """Go on to a frame that comes after the gyro has fallen silent."""
        if self._t_s is None:
            self._t_s = t_s
        elif t_s - self._t_s > self._config.gap_s:
            self._move_unseen(t_s - self._t_s)
            self._t_s = t_s

    def _take(self, seen: HeadingMeasurement, heading: float, white: float, shared: float, turned: float) -> None:
        known = self._seen_s is not None
        self._bank.start(heading, white, shared, known=known)
        self._drifts.clear()
        self._refused.restart(seen.t_s, seen.heading_rad, turned)
        self._seen_s = seen.t_s
        self._disagreement = 0.0
        self._faults.forgive("disagreement")

    def _age(self, t_s: float) -> float:
        """Return how long before now a frame was taken, as far as the gyro remembers."""
        then = self._memory.at(t_s)
        return 0.0 if self._t_s is None or t_s >= self._t_s or then is None else self._t_s - max(t_s, then[0])

    def _turned_since(self, t_s: float) -> float:
        """Return how far the gyro says the chair has turned since a frame was taken."""
        then = self._memory.at(t_s)
        return 0.0 if self._t_s is None or t_s >= self._t_s or then is None else self._turned - then[1]
