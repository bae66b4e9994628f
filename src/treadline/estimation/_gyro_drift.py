"""Gyro drift detection: generalised likelihood ratio (GLR) test over the possible onset times.

A step of the gyro bias has a signature in the filter's innovations: a ramp, reduced by the filter's own adaptation. For
every recent frame the signature of a step at that frame is propagated (Willsky and Jones, 1976), and the innovations are
regressed on the signature. A wrong vision heading (a wall, a false edge) is a step in the innovations, not a ramp; the
hypothesis with the larger likelihood ratio is accepted.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from treadline.core.angles import DEG

ONSET, HEADING, BIAS, SCALE, SHARED, EXPLAINED, INFORMATION, SUM, WEIGHT, GYRO_ANGLE, ODOMETRY_ANGLE, COUNT = range(12)


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
    turn_per_belt_rad_m: float = 0.38
    """Yaw rate per belt speed difference on a flight [rad/m]: a quarter of the kinematic value for 0.65 m between the belts
    (measured on the plant)."""
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
    """Propagates the drift signatures and tests them on each frame."""

    def __init__(self, rule: DriftRule) -> None:
        self._rule = rule
        self._gyro_angle = 0.0
        self._odometry_angle: float | None = None
        self._belts_s: float | None = None
        self.clear()

    def clear(self) -> None:
        """Discard all onset hypotheses."""
        self._steps = np.empty((0, 12))

    def propagate(self, F: Float[np.ndarray, "4 4"], dt: float, rate_rad_s: float) -> None:
        """Propagate the signatures over ``dt`` with the bias-corrected gyro rate ``rate_rad_s``."""
        self._gyro_angle += dt * rate_rad_s
        if self._steps.size:
            self._steps[:, HEADING : SHARED + 1] = self._steps[:, HEADING : SHARED + 1] @ F.T

    def belts(self, t_s: float, difference_m_s: float) -> None:
        """Take the belt speed difference, right minus left [m/s]."""
        dt = 0.0 if self._belts_s is None else t_s - self._belts_s
        if dt > 0.1 or self._odometry_angle is None:  # after a pause the integrated prediction is no longer valid
            self._odometry_angle, dt = 0.0, 0.0
            self._steps[:, ODOMETRY_ANGLE] = np.nan
        self._odometry_angle += max(dt, 0.0) * self._rule.turn_per_belt_rad_m * difference_m_s
        self._belts_s = t_s

    def frame(self, t_s: float, innovation: float, variance: float, gain: Float[np.ndarray, " 4"]) -> Drift | None:
        """Take a frame's innovation, its variance and the Kalman gain (zero for a rejected frame); return a detected drift."""
        if self._steps.size and t_s - self._steps[-1, ONSET] > self._rule.pause_s:
            self.clear()
        steps = self._steps[t_s - self._steps[:, ONSET] <= self._rule.window_s]
        # A positive state error appears as a negative innovation.
        shown = -(steps[:, HEADING] + steps[:, SHARED])
        steps[:, EXPLAINED] += shown * innovation / variance
        steps[:, INFORMATION] += shown * shown / variance
        steps[:, SUM] += innovation / variance
        steps[:, WEIGHT] += 1.0 / variance
        steps[:, COUNT] += 1.0
        drift = self._best(t_s, steps)
        steps[:, HEADING : SHARED + 1] -= np.outer(-shown, gain)
        odometry = np.nan if self._odometry_angle is None else self._odometry_angle
        begun = np.array([[t_s, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, self._gyro_angle, odometry, 0.0]])
        self._steps = np.concatenate([steps, begun])
        return drift

    def _best(self, t_s: float, steps: Float[np.ndarray, "n 12"]) -> Drift | None:
        if not (steps[:, COUNT] >= self._rule.least_count).any():
            return None
        jump = float((np.square(steps[:, SUM]) / steps[:, WEIGHT]).max())
        steps = steps[(steps[:, COUNT] >= self._rule.least_count) & (steps[:, INFORMATION] > 0.0)]
        explained, information = steps[:, EXPLAINED].copy(), steps[:, INFORMATION].copy()
        ramp = np.square(explained) / information
        self._add_belt_evidence(t_s, steps, ramp, explained, information)
        score = np.square(explained) / information
        if score.max(initial=0.0) <= jump + self._rule.over_jump:
            return None
        best = int(score.argmax())
        rate = float(explained[best] / information[best])
        if score[best] < self._rule.threshold or not self._rule.least_rad_s <= abs(rate) <= self._rule.most_rad_s:
            return None
        signature = steps[best, HEADING : SHARED + 1]
        # The step may not have been ideal, so 20 % of the rate is kept as uncertainty.
        variance = 1.0 / float(information[best]) + (0.2 * rate) ** 2
        return Drift(
            began_s=float(steps[best, ONSET]),
            rate_rad_s=rate,
            error=rate * signature,
            covariance=variance * np.outer(signature, signature),
        )

    def _add_belt_evidence(
        self,
        t_s: float,
        steps: Float[np.ndarray, "n 12"],
        ramp: Float[np.ndarray, " n"],
        explained: Float[np.ndarray, " n"],
        information: Float[np.ndarray, " n"],
    ) -> None:
        """Add the evidence of the belts: the mean gyro rate since onset minus the rate predicted from the belt speeds."""
        rule = self._rule
        if self._odometry_angle is None or self._belts_s is None or t_s - self._belts_s > 0.1:
            return
        since = np.maximum(t_s - steps[:, ONSET], 1e-3)
        odometry = (self._odometry_angle - steps[:, ODOMETRY_ANGLE]) / since
        difference = (self._gyro_angle - steps[:, GYRO_ANGLE]) / since - odometry
        sigma = np.hypot(rule.straight_sigma_rad_s * np.sqrt(rule.belts_after_s / since), rule.turn_sigma * odometry)
        usable = (since >= rule.belts_after_s - 1e-6) & (ramp >= rule.agreeing) & np.isfinite(odometry)
        explained[usable] += (difference / sigma**2)[usable]
        information[usable] += (1.0 / sigma**2)[usable]
