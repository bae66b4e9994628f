"""Which blocks run at which tick: 100 Hz base, 4 Hz control (Table I)."""

from treadline import paper

TICK_S = 1.0 / paper.IMU_RATE_HZ
"""Base period of the mission: the IMU's."""


class Rate:
    """Says at which ticks a slower block is due; counts ticks, so that no rounding of time can skip one."""

    def __init__(self, period_s: float) -> None:
        self._every = round(period_s / TICK_S)
        if self._every < 1 or abs(self._every * TICK_S - period_s) > 1e-9:
            raise ValueError(f"a period of {period_s} s is no multiple of the tick, {TICK_S} s")

    def due(self, tick: int) -> bool:
        """Say whether the block runs at this tick."""
        return tick % self._every == 0
