"""Rates of the blocks: 100 Hz base, 4 Hz control (Table I), and how long a rate commanded to the seat is valid."""

from treadline.core.signals import ROUNDING_S, TICK_S, SeatCommand, on_the_tick

SEAT_S = 0.1
"""Validity of a seat command: it answers one reading, and readings come a hundred times a second."""


class Rate:
    """Period of a slower block, in whole ticks.

    Args:
        period_s: The period [s].

    Raises:
        ValueError: If the period is not a multiple of the tick.
    """

    def __init__(self, period_s: float) -> None:
        if not on_the_tick(period_s):
            raise ValueError(f"a period of {period_s} s is no multiple of the tick, {TICK_S} s")
        self._every = round(period_s / TICK_S)
        self._slot = -1

    def due(self, t_s: float) -> bool:
        """Return whether a period has begun since the last call; a lost tick delays the block, and loses no period."""
        slot = round(t_s / TICK_S) // self._every
        begun, self._slot = slot != self._slot, slot
        return begun


def seat_now(command: SeatCommand, t_s: float) -> SeatCommand:
    """Return the seat command in force: a rate that answers an old reading would carry the seat past level."""
    return command if t_s - command.t_s <= SEAT_S + ROUNDING_S else SeatCommand(t_s=t_s, rate_m_s=0.0)
