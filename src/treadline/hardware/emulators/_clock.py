"""Clock of an emulator: its own, at most as fast as the wall clock."""

import time

from treadline.core.signals import TICK_S


class TickPacer:
    """Waits between ticks.

    A tick that is late delays all later ones instead of being made up for: the emulator's clock never runs faster than the wall
    clock, so that a busy computer slows the chair down and does not leave it without commands.

    Args:
        pace: Emulated seconds in a second of the wall clock.
    """

    def __init__(self, pace: float) -> None:
        self._period_s = TICK_S / pace
        self._due_s = time.monotonic()

    def wait(self) -> None:
        """Wait until the next tick is due."""
        now_s = time.monotonic()
        self._due_s = max(self._due_s + self._period_s, now_s)
        time.sleep(self._due_s - now_s)
