"""Sensor faults detected by the heading filter: gyro drift, jumps of one sensor, and the detectors' building blocks.

Gyro drift: generalised likelihood ratio (GLR) test over the possible onset times. A step of the gyro bias has a signature in the
filter's innovations: a ramp, reduced by the filter's own adaptation. For every recent frame the signature of a step at that frame
is propagated (Willsky and Jones, 1976), and the innovations are regressed on the signature. A wrong vision heading (a wall, a
false edge) is a step in the innovations, not a ramp; the hypothesis with the larger likelihood ratio is accepted.

Reacquisition: acceptance of rejected measurements after a gyro jump or an external displacement of the chair. A burst of wrong
measurements is also self-consistent (a wall mistaken for a stair). Two criteria distinguish the cases: the sensor that jumped, and
the length of the previous track. A continuous vision track during a gyro jump is accepted. A vision track that jumped must last as
long as the track it contradicts.
"""

from dataclasses import dataclass
from typing import get_args

import numpy as np
from jaxtyping import Float

from treadline.core.angles import DEG, wrap
from treadline.core.signals import HeadingFault, ImuSample, TrackReading

PRIOR_FRAMES, SCATTER_FRAMES = 10, 300
"""Prior weight of fully correlated frame errors, and largest weight of the measured scatter, in frames (30 s)."""
NEIGHBOURS_S = 0.35
SCATTER_GATE = 9.0
SCATTER_ALL = 0.8
"""Measured share from which the variance counts as fully independent; 300 frames determine the share to 10 %."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DetectedFault:
    """Active fault."""

    kind: HeadingFault
    since_s: float
    until_s: float
    """Time after which the fault is no longer reported [s]; infinite for a fault that must be cleared."""
    cause: str


class ActiveFaults:
    """All active faults; simultaneous faults are kept separately."""

    def __init__(self) -> None:
        self._found: dict[HeadingFault, DetectedFault] = {}

    def report(self, kind: HeadingFault, t_s: float, until_s: float, cause: str) -> None:
        """Report a fault; a continuing fault keeps its time of detection."""
        before = self._found.get(kind)
        since_s = before.since_s if before is not None and t_s <= before.until_s else t_s
        self._found[kind] = DetectedFault(kind=kind, since_s=since_s, until_s=until_s, cause=cause)

    def clear(self, kind: HeadingFault) -> None:
        """Clear a fault."""
        self._found.pop(kind, None)

    def is_active(self, kind: HeadingFault, t_s: float) -> bool:
        """Whether a fault of this kind is active."""
        return kind in self._found and t_s <= self._found[kind].until_s

    def most_severe(self, t_s: float) -> DetectedFault | None:
        """Return the most severe active fault."""
        if not self._found:
            return None
        return next((self._found[kind] for kind in get_args(HeadingFault) if self.is_active(kind, t_s)), None)


@dataclass(frozen=True, slots=True, kw_only=True)
class StuckRule:
    """Thresholds of the stuck-gyro detector."""

    for_s: float = 0.2
    same_rad_s: float = 1e-9
    """Largest change of the rates that counts as a repetition [rad/s]; noise exceeds it on all three axes."""
    moving_m_s: float = 0.02
    belts_s: float = 0.3
    """Largest age of a belt reading as evidence of motion [s]."""
    late_s: float = 0.05
    """Time after a belt reading for which the chair is assumed to move [s]."""


class StuckGyroDetector:
    """Distinguishes a stuck gyro from a standing chair."""

    def __init__(self, rule: StuckRule) -> None:
        self._rule = rule
        self._rates: tuple[float, ...] = ()
        self._since_s = 0.0
        self._moved_s: float | None = None
        self._moves_since_s = 0.0
        self._stuck_since_s: float | None = None

    def belts(self, reading: TrackReading) -> None:
        """Take a belt reading and note whether the belts move."""
        if max(abs(reading.left_m_s), abs(reading.right_m_s)) > self._rule.moving_m_s:
            if self._moved_s is None or reading.t_s - self._moved_s > self._rule.belts_s:
                self._moves_since_s = reading.t_s
            self._moved_s = reading.t_s

    def stuck_s(self, sample: ImuSample) -> float:
        """Return how long the gyro has repeated its reading while the chair moves [s]; zero for a plausible reading.

        A detected fault persists after the chair stops, until the gyro reading changes.
        """
        rates = sample.angular_velocity_rad_s
        if not self._rates or max(abs(a - b) for a, b in zip(rates, self._rates, strict=True)) > self._rule.same_rad_s:
            self._rates, self._since_s, self._stuck_since_s = rates, sample.t_s, None
        moved_s = self._moved_s
        if self._stuck_since_s is None and moved_s is not None and abs(sample.t_s - moved_s) <= self._rule.belts_s:
            # Repetitions before the belts started or after they stopped are not evidence.
            since_s = max(self._since_s, self._moves_since_s)
            if min(sample.t_s, moved_s + self._rule.late_s) - since_s >= self._rule.for_s - 1e-6:
                self._stuck_since_s = since_s
        return 0.0 if self._stuck_since_s is None else sample.t_s - self._stuck_since_s


class IndependentShare:
    """Independent share of vision's declared variance, estimated from the difference of neighbouring frames minus the gyro turn.

    The remaining share is common to neighbouring frames (skewed nosings, calibration, gravity) and not reduced by averaging.
    """

    def __init__(self) -> None:
        self._count = PRIOR_FRAMES
        self._own = 0.0
        self._last: tuple[float, float] | None = None

    def own(self, t_s: float, still_rad: float, sigma_rad: float) -> float:
        """Take a heading with the turn removed; return the independent share of its variance, from 0 to 1."""
        if self._last is not None and t_s - self._last[0] <= NEIGHBOURS_S:
            squared = 0.5 * (wrap(still_rad - self._last[1]) / sigma_rad) ** 2
            if squared <= SCATTER_GATE:
                self._count = min(self._count + 1, SCATTER_FRAMES)
                self._own += (squared - self._own) / self._count
        self._last = (t_s, still_rad)
        return min(self._own / SCATTER_ALL, 1.0)

    def restart(self) -> None:
        """Compare the next heading with none before, whose reference differs."""
        self._last = None


_NUMBERS = ("explained", "information", "sum", "weight", "count", "gyro_angle", "odometry_angle")
HYPOTHESIS = np.dtype([("onset_s", float), ("error", float, 4), *((number, float) for number in _NUMBERS)])
"""Onset of a drift: the error of the filter state (heading, bias, scale, shared) that 1 rad/s of it has caused, sums, and both
angles at the onset [rad]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DriftRule:
    """Thresholds of the drift detector."""

    threshold: float = 20.0
    """Detection threshold on χ² of the best signature: 4.5 sigma, for tests at ten frames a second over a whole day."""
    least_rad_s: float = 0.4 * DEG
    """Smallest drift detected [rad/s]; the filter tracks smaller drifts by itself."""
    most_rad_s: float = 60.0 * DEG
    """Largest drift [rad/s]; a larger change is a jump."""
    pause_s: float = 0.35
    """Longest gap between frames [s]; after a longer gap the onset cannot be attributed to either sensor."""
    over_jump: float = 1.0
    """Margin in χ² by which the ramp must exceed a step in vision."""
    least_count: int = 3
    """Smallest number of frames of a ramp."""
    window_s: float = 2.0
    """Longest time since onset [s]."""
    straight_sigma_rad_s: float = 0.35 * DEG
    """Sigma of the yaw rate predicted from equal belt speeds over 0.3 s [rad/s]: nosings turn the chair by as much."""
    turn_sigma: float = 1.0
    """Relative sigma of the yaw rate predicted from a belt speed difference."""
    belts_after_s: float = 0.3
    agreeing: float = 3.0
    """χ² required from vision before belt speeds are used as evidence; belt speeds alone are not sufficient."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Drift:
    """Detected step of the gyro bias."""

    began_s: float
    rate_rad_s: float
    error: Float[np.ndarray, " 4"]
    """Resulting error of the filter state: heading, bias, scale and shared frame error."""
    covariance: Float[np.ndarray, "4 4"]
    """Covariance of that error."""


class GlrDriftDetector:
    """Propagates the drift signatures and tests them on each frame.

    Args:
        rule: Thresholds.
        turn_per_belt_rad_m: Yaw rate per belt speed difference [rad/m].
    """

    def __init__(self, rule: DriftRule, turn_per_belt_rad_m: float) -> None:
        self._rule = rule
        self._turn_per_belt_rad_m = turn_per_belt_rad_m
        self._gyro_angle = 0.0
        self._odometry_angle: float | None = None
        self._belts_s: float | None = None
        self.clear()

    def clear(self) -> None:
        """Discard all onset hypotheses."""
        self._steps = np.empty(0, HYPOTHESIS)

    def propagate(self, F: Float[np.ndarray, "4 4"], dt: float, rate_rad_s: float) -> None:
        """Propagate the signatures over ``dt`` with the bias-corrected gyro rate ``rate_rad_s``."""
        self._gyro_angle += dt * rate_rad_s
        if self._steps.size:
            self._steps["error"] = self._steps["error"] @ F.T

    def belts(self, t_s: float, difference_m_s: float) -> None:
        """Take the belt speed difference, right minus left [m/s]."""
        dt = 0.0 if self._belts_s is None else t_s - self._belts_s
        if dt > 0.1 or self._odometry_angle is None:  # after a pause the integrated prediction is no longer valid
            self._odometry_angle, dt = 0.0, 0.0
            self._steps["odometry_angle"] = np.nan
        self._odometry_angle += max(dt, 0.0) * self._turn_per_belt_rad_m * difference_m_s
        self._belts_s = t_s

    def frame(self, t_s: float, innovation: float, variance: float, gain: Float[np.ndarray, " 4"]) -> Drift | None:
        """Take a frame's innovation, its variance and the Kalman gain (zero for a rejected frame); return a detected drift."""
        if self._steps.size and t_s - self._steps["onset_s"][-1] > self._rule.pause_s:
            self.clear()
        steps = self._steps[t_s - self._steps["onset_s"] <= self._rule.window_s]
        # A positive state error appears as a negative innovation.
        heading, _, _, shared = steps["error"].T
        shown = -(heading + shared)
        steps["explained"] += shown * innovation / variance
        steps["information"] += shown * shown / variance
        steps["sum"] += innovation / variance
        steps["weight"] += 1.0 / variance
        steps["count"] += 1.0
        drift = self._best(t_s, steps)
        steps["error"] -= np.outer(-shown, gain)
        odometry = np.nan if self._odometry_angle is None else self._odometry_angle
        begun = (t_s, (0.0, -1.0, 0.0, 0.0), 0.0, 0.0, 0.0, 0.0, 0.0, self._gyro_angle, odometry)
        self._steps = np.append(steps, np.array([begun], HYPOTHESIS))
        return drift

    def _best(self, t_s: float, steps: np.ndarray) -> Drift | None:
        if not (steps["count"] >= self._rule.least_count).any():
            return None
        jump = float((np.square(steps["sum"]) / steps["weight"]).max())
        steps = steps[(steps["count"] >= self._rule.least_count) & (steps["information"] > 0.0)]
        explained, information = steps["explained"].copy(), steps["information"].copy()
        ramp = np.square(explained) / information
        self._add_belt_evidence(t_s, steps, ramp, explained, information)
        score = np.square(explained) / information
        if score.max(initial=0.0) <= jump + self._rule.over_jump:
            return None
        best = int(score.argmax())
        rate = float(explained[best] / information[best])
        if score[best] < self._rule.threshold or not self._rule.least_rad_s <= abs(rate) <= self._rule.most_rad_s:
            return None
        signature = steps["error"][best]
        # The step may not have been ideal, so 20 % of the rate is kept as uncertainty.
        variance = 1.0 / float(information[best]) + (0.2 * rate) ** 2
        return Drift(
            began_s=float(steps["onset_s"][best]),
            rate_rad_s=rate,
            error=rate * signature,
            covariance=variance * np.outer(signature, signature),
        )

    def _add_belt_evidence(
        self,
        t_s: float,
        steps: np.ndarray,
        ramp: Float[np.ndarray, " n"],
        explained: Float[np.ndarray, " n"],
        information: Float[np.ndarray, " n"],
    ) -> None:
        """Add the evidence of the belts: the mean gyro rate since onset minus the rate predicted from the belt speeds."""
        rule = self._rule
        if self._odometry_angle is None or self._belts_s is None or t_s - self._belts_s > 0.1:
            return
        since = np.maximum(t_s - steps["onset_s"], 1e-3)
        odometry = (self._odometry_angle - steps["odometry_angle"]) / since
        difference = (self._gyro_angle - steps["gyro_angle"]) / since - odometry
        sigma = np.hypot(rule.straight_sigma_rad_s * np.sqrt(rule.belts_after_s / since), rule.turn_sigma * odometry)
        usable = (since >= rule.belts_after_s - 1e-6) & (ramp >= rule.agreeing) & np.isfinite(odometry)
        explained[usable] += (difference / sigma**2)[usable]
        information[usable] += (1.0 / sigma**2)[usable]


@dataclass(frozen=True, slots=True, kw_only=True)
class ReacquisitionRule:
    """Criteria for the acceptance of rejected measurements."""

    for_s: float = 4.0
    """Smallest duration from the first to the last measurement [s]."""
    most_s: float = 30.0
    """Largest duration required after a long contradicted track [s]: the wall of a landing is in view for 7 to 14 s, and the guard
    holds after 12 s."""
    smooth_for_s: float = 1.0
    """Smallest duration after a gyro jump [s]."""
    rate_hz: float = 5.0
    """Smallest rate of measurements [Hz]: half the rate of a 10 Hz camera."""
    gap_s: float = 1.0
    """Longest gap between neighbouring measurements [s]; motion in a longer gap is unknown."""
    spread_rad: float = 1.5 * DEG
    """Largest difference between neighbouring measurements [rad]: five sigma of a frame."""
    smooth_share: float = 0.5
    """Largest vision turn relative to the gyro turn for a continuous vision track."""
    smooth_gap_s: float = 0.35
    """Longest time between two frames to attribute a jump to a sensor [s]."""


class RejectedTrack:
    """Sequence of consistent rejected measurements."""

    def __init__(self, rule: ReacquisitionRule) -> None:
        self._rule = rule
        self.count = 0
        """Number of consecutive rejected measurements, consistent or not."""
        self.smooth = False
        """Whether vision was continuous, so that the gyro jumped."""
        self._accepted_at: tuple[float, float, float] | None = None
        self._track_s = 0.0
        self._last_s = 0.0
        self._vision_jumped = False
        self.clear()

    def clear(self) -> None:
        """Reset the sequence."""
        self.count = self._agreeing = 0
        self.smooth = self._vision_jumped = False
        self._first_s = self._last_s
        self._last_rad = 0.0

    def accepted(self, t_s: float, seen_rad: float, turned_rad: float) -> None:
        """Take an accepted measurement and the total turn by the gyro."""
        if self._accepted_at is not None:
            self._track_s = min(self._track_s + max(t_s - self._accepted_at[0], 0.0), self._rule.most_s)
        self._accepted_at = (t_s, seen_rad, turned_rad)
        self.clear()

    def restart(self, t_s: float, seen_rad: float, turned_rad: float) -> None:
        """Begin a new track with this measurement."""
        self._track_s = 0.0
        self._accepted_at = (t_s, seen_rad, turned_rad)
        self.clear()

    def agree(self, t_s: float, seen_rad: float, turned_rad: float) -> bool:
        """Add one rejected measurement; return whether the sequence is now accepted."""
        rule = self._rule
        # The gyro turn is removed, so that measurements of a turning chair can be consistent.
        still = wrap(seen_rad - turned_rad)
        apart = abs(wrap(still - self._last_rad)) > rule.spread_rad or t_s - self._last_s > rule.gap_s
        if self._agreeing == 0 or apart:
            self._agreeing, self._first_s = 0, t_s
            self._attribute_jump(t_s, seen_rad, turned_rad)
        self.count += 1
        self._agreeing += 1
        self._last_s, self._last_rad = t_s, still
        needed_s = rule.smooth_for_s if self.smooth else max(rule.for_s, self._track_s if self._vision_jumped else 0.0)
        # The tolerance covers rounding of stamps, which are sums of periods.
        return self._agreeing >= rule.rate_hz * needed_s and t_s - self._first_s >= needed_s - 1e-6

    def _attribute_jump(self, t_s: float, seen_rad: float, turned_rad: float) -> None:
        """Attribute the jump: to the gyro for a continuous vision track, else to vision for a large difference."""
        if self._accepted_at is None:
            return
        moved, turned = wrap(seen_rad - self._accepted_at[1]), turned_rad - self._accepted_at[2]
        recent = 0.0 < t_s - self._accepted_at[0] <= self._rule.smooth_gap_s
        self.smooth = self.smooth or (recent and abs(moved) < self._rule.smooth_share * abs(turned))
        self._vision_jumped = not self.smooth and abs(wrap(moved - turned)) > self._rule.spread_rad
