"""Outlier rule for what the paper calls "an aberration in θ": a jump larger than the chair can make.

The paper gives no rule; this rule compares the turn between frames by vision with the turn by the IMU.
"""

from dataclasses import dataclass

from treadline.core.angles import DEG, wrap


@dataclass(frozen=True, slots=True, kw_only=True)
class AberrationRule:
    """Threshold on the difference between a measured heading and the gyro's prediction."""

    jump_rad: float = 5.0 * DEG

    def is_aberration(self, seen_rad: float, expected_rad: float) -> bool:
        """Whether a measured heading deviates from the expected heading by more than the threshold."""
        return abs(wrap(seen_rad - expected_rad)) > self.jump_rad
