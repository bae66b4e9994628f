"""Slide down the flight by ground truth: retreat that the belts did not drive."""

import math

from treadline.core.angles import DEG
from treadline.core.ports import Truth
from treadline.core.signals import TICK_S

LEVEL_RAD = 4.0 * DEG
"""Pitch up to which the chair counts as level, on the floor or a landing."""


class SlideWatch:
    """Slide since the furthest point reached on the flight, against the direction of travel.

    A chair that backs away under power does not slide: only the retreat beyond the belts' own reverse travel counts.
    """

    def __init__(self, *, upward: bool) -> None:
        self._sign = 1.0 if upward else -1.0
        self._x_m: float | None = None
        self.roll_back_m = 0.0

    def update(self, truth: Truth) -> float:
        """Take the truth of one tick; return the slide so far."""
        before_m, self._x_m = self._x_m, truth.x_m
        if before_m is None or abs(truth.pitch_rad) <= LEVEL_RAD:
            self.roll_back_m = 0.0
            return self.roll_back_m
        driven_m = self._sign * 0.5 * (truth.left_m_s + truth.right_m_s) * math.cos(truth.heading_rad) * TICK_S
        advance_m = self._sign * (truth.x_m - before_m) - min(driven_m, 0.0)
        self.roll_back_m = max(self.roll_back_m - advance_m, 0.0)
        return self.roll_back_m
