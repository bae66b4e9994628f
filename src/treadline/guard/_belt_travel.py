"""Distance driven by the belts: ``TrackReading -> travel``, also at the exposure of a frame that arrives later."""

import math

from treadline.core.signals import ROUNDING_S, Recent, TrackReading
from treadline.core.slip import slower_belt_m_s


class BeltTravel:
    """Integral of the belt speeds since the start, backwards negative.

    Args:
        gap_s: Longest interval between two readings over which a speed is integrated [s].
    """

    def __init__(self, gap_s: float) -> None:
        self._gap_s = gap_s
        self._t_s = -math.inf
        self._past: Recent[tuple[float, float]] = Recent()
        self.travel_m = 0.0
        """Integral of the mean belt speed [m]."""
        self.slow_travel_m = 0.0
        """Integral of the slower belt's speed [m]; slip is measured against it."""

    def update(self, reading: TrackReading) -> None:
        """Integrate one reading; the belts' way over a gap is not known, and left out."""
        dt_s = reading.t_s - self._t_s
        self._t_s = reading.t_s
        if dt_s > self._gap_s + ROUNDING_S:
            return
        self.travel_m += dt_s * 0.5 * (reading.left_m_s + reading.right_m_s)
        self.slow_travel_m += dt_s * slower_belt_m_s(reading.left_m_s, reading.right_m_s)
        self._past.add(reading.t_s, (self.travel_m, self.slow_travel_m))

    def at(self, t_s: float) -> tuple[float, float]:
        """Return ``travel_m`` and ``slow_travel_m`` at ``t_s``, the exposure of a frame that arrived later."""
        return self._past.at(t_s) or (self.travel_m, self.slow_travel_m)
