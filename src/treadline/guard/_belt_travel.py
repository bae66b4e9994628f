"""Distance driven by the belts: ``TrackReading -> travel``."""

import math

from treadline.core.signals import Recent, TrackReading

GAP_S = 0.1
"""Longest interval between two readings over which a belt speed is integrated."""


class BeltTravel:
    """Integral of the belt speeds since the start, backwards negative."""

    def __init__(self) -> None:
        self._t_s = -math.inf
        self._past: Recent[tuple[float, float]] = Recent()
        self.travel_m = 0.0
        """Integral of the mean belt speed [m]."""
        self.slow_travel_m = 0.0
        """Integral of the slower belt's speed [m]. On a stair the chair moves with the slower belt (Coulomb friction is rate
        independent), so slip is measured against it."""

    def update(self, reading: TrackReading) -> float | None:
        """Integrate one reading; return the time since the previous one [s], None after a gap."""
        dt_s = reading.t_s - self._t_s
        self._t_s = reading.t_s
        if dt_s > GAP_S:
            return None
        self.travel_m += dt_s * 0.5 * (reading.left_m_s + reading.right_m_s)
        self.slow_travel_m += dt_s * min(reading.left_m_s, reading.right_m_s, key=abs)
        self._past.add(reading.t_s, (self.travel_m, self.slow_travel_m))
        return dt_s

    def at(self, t_s: float) -> tuple[float, float]:
        """Return ``travel_m`` and ``slow_travel_m`` at ``t_s``, the exposure of a frame that arrived later."""
        return self._past.at(t_s) or (self.travel_m, self.slow_travel_m)

    def forget(self) -> None:
        """Start again from the next reading; the distances stay."""
        self._t_s = -math.inf
