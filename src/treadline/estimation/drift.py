"""Whether the gyro has begun to drift: a likelihood ratio over the times at which it may have.

A step of the gyro's bias has a signature in the filter's innovations: a ramp, bent by what the filter has learned of it
meanwhile. For every recent frame the signature of a step at that frame is carried along (Willsky and Jones, 1976), and the
innovations are regressed on it. A wrong heading seen (a wall, a false edge) is a step in the innovations, not a ramp: whichever
explains more, wins.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from treadline.angles import DEG

ONSET, HEADING, BIAS, SCALE, SHARED, EXPLAINED, INFORMATION, SUM, WEIGHT, FELT, TOLD, COUNT = range(12)


@dataclass(frozen=True, slots=True, kw_only=True)
class DriftRule:
    """When a drift is believed."""

    threshold: float = 20.0
    """χ² of the best signature: 4.5 sigma, for ten frames a second are asked all day."""
    least_rad_s: float = 0.4 * DEG
    """A smaller one the filter follows by itself."""
    most_rad_s: float = 60.0 * DEG
    """A larger one is a jump."""
    pause_s: float = 0.35
    """Between frames: what began in a longer pause may have been either sensor's."""
    over_jump: float = 1.0
    """How much more of χ² than a step in what vision says the ramp must explain."""
    least_count: int = 3
    """Of frames that make a ramp."""
    window_s: float = 2.0
    """How long ago it may have begun."""
    turn_per_belt_rad_m: float = 0.38
    """Yaw rate per metre a second of difference between the belts, on a flight: a quarter of what wheels 0.65 m apart would
    turn (measured on the plant)."""
    straight_sigma_rad_s: float = 0.35 * DEG
    """Of the yaw rate that the belts foretell over 0.3 s when they run alike: nosings turn the chair by as much."""
    turn_sigma: float = 1.0
    """Further σ of the yaw rate that the belts foretell, as a share of that rate."""
    belts_after_s: float = 0.3
    agreeing: float = 3.0
    """χ² that vision must bring by itself before the belts are asked: they alone prove nothing."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Drift:
    """A step of the gyro's bias that has been found."""

    began_s: float
    rate_rad_s: float
    error: Float[np.ndarray, " 4"]
    """What it has made of the filter's state: heading, bias, scale, and what frames share."""
    spread: Float[np.ndarray, "4 4"]
    """Covariance of that."""


class DriftWatch:
    """Carries the signatures."""

    def __init__(self, rule: DriftRule) -> None:
        self._rule = rule
        self._felt = 0.0
        self._told: float | None = None
        self._belts_s: float | None = None
        self.clear()

    def clear(self) -> None:
        """Forget all that might have begun."""
        self._steps = np.empty((0, 12))

    def propagate(self, F: Float[np.ndarray, "4 4"], dt: float, rate_rad_s: float) -> None:
        """Carry the signatures over ``dt``, in which the gyro said ``rate_rad_s``, its bias taken off."""
        self._felt += dt * rate_rad_s
        if self._steps.size:
            self._steps[:, HEADING : SHARED + 1] = self._steps[:, HEADING : SHARED + 1] @ F.T

    def belts(self, t_s: float, difference_m_s: float) -> None:
        """Note how much faster the right belt runs."""
        dt = 0.0 if self._belts_s is None else t_s - self._belts_s
        if dt > 0.1 or self._told is None:  # a pause: what was foretold before it belongs to nothing after it
            self._told, dt = 0.0, 0.0
            self._steps[:, TOLD] = np.nan
        self._told += max(dt, 0.0) * self._rule.turn_per_belt_rad_m * difference_m_s
        self._belts_s = t_s

    def frame(self, t_s: float, innovation: float, variance: float, gain: Float[np.ndarray, " 4"]) -> Drift | None:
        """Take a frame's innovation, its variance, and the gain it was used with (zero if refused); return a drift if found."""
        if self._steps.size and t_s - self._steps[-1, ONSET] > self._rule.pause_s:
            self.clear()
        steps = self._steps[t_s - self._steps[:, ONSET] <= self._rule.window_s]
        # An error of the estimate shows in the innovation with the other sign.
        shown = -(steps[:, HEADING] + steps[:, SHARED])
        steps[:, EXPLAINED] += shown * innovation / variance
        steps[:, INFORMATION] += shown * shown / variance
        steps[:, SUM] += innovation / variance
        steps[:, WEIGHT] += 1.0 / variance
        steps[:, COUNT] += 1.0
        drift = self._best(t_s, steps)
        steps[:, HEADING : SHARED + 1] -= np.outer(-shown, gain)
        told = np.nan if self._told is None else self._told
        begun = np.array([[t_s, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, self._felt, told, 0.0]])
        self._steps = np.concatenate([steps, begun])
        return drift

    def _best(self, t_s: float, steps: Float[np.ndarray, "n 12"]) -> Drift | None:
        if not (steps[:, COUNT] >= self._rule.least_count).any():
            return None
        jump = float((np.square(steps[:, SUM]) / steps[:, WEIGHT]).max())
        steps = steps[(steps[:, COUNT] >= self._rule.least_count) & (steps[:, INFORMATION] > 0.0)]
        explained, information = steps[:, EXPLAINED].copy(), steps[:, INFORMATION].copy()
        ramp = np.square(explained) / information
        self._ask_belts(t_s, steps, ramp, explained, information)
        score = np.square(explained) / information
        if score.max(initial=0.0) <= jump + self._rule.over_jump:
            return None
        best = int(score.argmax())
        rate = float(explained[best] / information[best])
        if score[best] < self._rule.threshold or not self._rule.least_rad_s <= abs(rate) <= self._rule.most_rad_s:
            return None
        signature = steps[best, HEADING : SHARED + 1]
        # A fifth of it is left open: it may not have been a clean step.
        variance = 1.0 / float(information[best]) + (0.2 * rate) ** 2
        return Drift(
            began_s=float(steps[best, ONSET]),
            rate_rad_s=rate,
            error=rate * signature,
            spread=variance * np.outer(signature, signature),
        )

    def _ask_belts(
        self,
        t_s: float,
        steps: Float[np.ndarray, "n 12"],
        ramp: Float[np.ndarray, " n"],
        explained: Float[np.ndarray, " n"],
        information: Float[np.ndarray, " n"],
    ) -> None:
        """Add what the belts say of each step: the gyro's mean rate since, less the one they foretell."""
        rule = self._rule
        if self._told is None or self._belts_s is None or t_s - self._belts_s > 0.1:
            return
        since = np.maximum(t_s - steps[:, ONSET], 1e-3)
        told = (self._told - steps[:, TOLD]) / since
        odd = (self._felt - steps[:, FELT]) / since - told
        sigma = np.hypot(rule.straight_sigma_rad_s * np.sqrt(rule.belts_after_s / since), rule.turn_sigma * told)
        asked = (since >= rule.belts_after_s - 1e-6) & (ramp >= rule.agreeing) & np.isfinite(told)
        explained[asked] += (odd / sigma**2)[asked]
        information[asked] += (1.0 / sigma**2)[asked]
