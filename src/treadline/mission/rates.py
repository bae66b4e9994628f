"""Which blocks run at which tick: 100 Hz base, 4 Hz control (Table I); and for how long a rate asked of the seat counts."""

from treadline.signals import TICK_S, SeatCommand, on_the_tick

SEAT_S = 0.1
"""For which a seat's rate counts: it answers one reading, and readings come a hundred times a second."""
ROUNDING_S = 1e-6


class Rate:
    """Says at which ticks a slower block is due; counts ticks, so that no rounding of time can skip one."""

    def __init__(self, period_s: float) -> None:
        if not on_the_tick(period_s):
            raise ValueError(f"a period of {period_s} s is no multiple of the tick, {TICK_S} s")
        self._every = round(period_s / TICK_S)

    def due(self, tick: int) -> bool:
        """Say whether the block runs at this tick."""
        return tick % self._every == 0


def seat_now(command: SeatCommand, t_s: float) -> SeatCommand:
    """Return what the seat is asked for now: a rate that answers an old reading would carry it past its level."""
    return command if t_s - command.t_s <= SEAT_S + ROUNDING_S else SeatCommand(t_s=t_s, rate_m_s=0.0)
