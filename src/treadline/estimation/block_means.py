"""Mean of pitch and roll over blocks of time, with a 95 % interval from the variance between blocks."""

import math
from dataclasses import dataclass
from statistics import median

from treadline.core.angles import DEG

NORMAL_95 = 1.96
"""Half width of a 95 % interval [sigma]."""
REPORTED_RAD = 1.0 * DEG
"""Mount error above which the error is reported and corrected [rad]: the largest that is accepted silently. A roll of 1° turns the
heading by sin(40°), 0.64°, with the shipped mount."""
LEAST_BLOCKS = 4
"""Least number of block means of an estimate: with fewer, the variance of Student's distribution is infinite."""


@dataclass(frozen=True, slots=True, kw_only=True)
class AngleEstimate:
    """Two angles with 95 % intervals."""

    pitch_rad: float
    roll_rad: float
    pitch_half_rad: float
    """Half width of the 95 % interval of the pitch [rad]."""
    roll_half_rad: float
    """Half width of the 95 % interval of the roll [rad]."""

    @property
    def exceeds(self) -> bool:
        """Whether an angle exceeds ``REPORTED_RAD`` at 95 %."""
        pitch, roll = abs(self.pitch_rad) - self.pitch_half_rad, abs(self.roll_rad) - self.roll_half_rad
        return max(pitch, roll) > REPORTED_RAD

    def replaces(self, declared: "AngleEstimate") -> bool:
        """Whether this estimate lies outside the declared interval, or halves that of the roll, which turns headings."""
        return (
            abs(self.pitch_rad - declared.pitch_rad) > declared.pitch_half_rad
            or abs(self.roll_rad - declared.roll_rad) > declared.roll_half_rad
            or self.roll_half_rad < 0.5 * declared.roll_half_rad
        )

    def __str__(self) -> str:
        """Return the angles in degrees."""
        return (
            f"rolled by {self.roll_rad / DEG:+.1f}° ± {self.roll_half_rad / DEG:.1f}° and pitched by "
            f"{self.pitch_rad / DEG:+.1f}° ± {self.pitch_half_rad / DEG:.1f}°"
        )


class BlockMeans:
    """Mean of two angles from the medians of time blocks, with the variance between blocks.

    Args:
        block_s: Block length [s]; errors of different blocks are independent.
    """

    def __init__(self, block_s: float) -> None:
        self._block_s = block_s
        self._block = -1
        self._open: list[tuple[float, float]] = []
        self._count = 0
        self._mean = [0.0, 0.0]
        self._squares = [0.0, 0.0]

    def add(self, t_s: float, pitch_rad: float, roll_rad: float) -> bool:
        """Add the angles of one frame; return whether a block is complete."""
        block = int(t_s // self._block_s)
        complete = bool(self._open) and block != self._block
        if complete:
            self._close()
        self._block = block
        self._open.append((pitch_rad, roll_rad))
        return complete

    def _close(self) -> None:
        self._count += 1
        for k in range(2):
            value = median([pair[k] for pair in self._open])
            before = value - self._mean[k]
            self._mean[k] += before / self._count
            self._squares[k] += before * (value - self._mean[k])
        self._open.clear()

    def estimate(self, pitch_sigma_rad: float, roll_sigma_rad: float) -> AngleEstimate | None:
        """Return the estimate with the sigmas of constant errors, which blocks do not average; None for too few blocks."""
        if self._count < LEAST_BLOCKS:
            return None
        freedom = self._count - 1
        # The variance of Student's distribution replaces its quantile: within 7 % for four blocks and more.
        factor = freedom / (freedom - 2.0) / freedom / self._count
        halves = [
            NORMAL_95 * math.hypot(sigma, math.sqrt(self._squares[k] * factor))
            for k, sigma in enumerate((pitch_sigma_rad, roll_sigma_rad))
        ]
        return AngleEstimate(pitch_rad=self._mean[0], roll_rad=self._mean[1], pitch_half_rad=halves[0], roll_half_rad=halves[1])


def more_accurate(one: AngleEstimate | None, other: AngleEstimate | None) -> AngleEstimate | None:
    """Return each angle from the estimate with the smaller interval."""
    if one is None or other is None:
        return one or other
    pitch = one if one.pitch_half_rad <= other.pitch_half_rad else other
    roll = one if one.roll_half_rad <= other.roll_half_rad else other
    return AngleEstimate(
        pitch_rad=pitch.pitch_rad, roll_rad=roll.roll_rad, pitch_half_rad=pitch.pitch_half_rad, roll_half_rad=roll.roll_half_rad
    )


def difference(one: AngleEstimate, other: AngleEstimate) -> AngleEstimate:
    """Return the difference of two independent estimates."""
    return AngleEstimate(
        pitch_rad=one.pitch_rad - other.pitch_rad,
        roll_rad=one.roll_rad - other.roll_rad,
        pitch_half_rad=math.hypot(one.pitch_half_rad, other.pitch_half_rad),
        roll_half_rad=math.hypot(one.roll_half_rad, other.roll_half_rad),
    )
