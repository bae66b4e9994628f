"""What the paper calls "an aberration in θ": a jump that no chair can make.

The paper gives no rule; this one compares how far the vision says the chair turned with how far the IMU says it did.
"""

from dataclasses import dataclass

from treadline.angles import DEG, wrap


@dataclass(frozen=True, slots=True, kw_only=True)
class AberrationRule:
    """A measurement further than this from where the gyro put the heading is an aberration."""

    jump_rad: float = 5.0 * DEG

    def breaks(self, seen_rad: float, expected_rad: float) -> bool:
        """Say whether a heading seen is an aberration."""
        return abs(wrap(seen_rad - expected_rad)) > self.jump_rad
