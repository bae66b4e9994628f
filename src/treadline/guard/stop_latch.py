"""Latch of the HOLD: the first cause stays until a person re-arms. Collects the guard's events."""

import math

from treadline.core.signals import Event, TrackCommand
from treadline.guard._guard_config import GuardConfig
from treadline.guard._half_cosine_stop import RampedStop, Stop


class Button:
    """Edge detector of the re-arm button."""

    def __init__(self) -> None:
        self._down = False

    def press(self, *, down: bool) -> bool:
        """Return whether the button has just been pressed; a button that stays down counts once."""
        before, self._down = self._down, down
        return down and not before


class Latch:
    """First cause of the HOLD, and the events since the last call of ``take``.

    Args:
        config: Limits of the guard.
    """

    def __init__(self, config: GuardConfig) -> None:
        self.cause: str | None = None
        self._held_s = -math.inf
        self._config = config
        self._ramp = RampedStop(config)
        self._events: list[Event] = []
        self._slow = ""

    def hold(self, t_s: float, stop: Stop, cause: str | None) -> None:
        """Latch a cause; a later cause is not latched, but an urgent one ends a ramped stop. None is no cause."""
        if cause is None:
            return
        self._held_s = t_s if self.cause is None else min(self._held_s, t_s)  # the clock may have leapt back
        if self.cause is None:
            self.cause, self._ramp = cause, RampedStop(self._config)
            self.report(t_s, "hold", cause)
        elif stop is Stop.BRAKE and not self._ramp.is_over:
            self.report(t_s, "brake", cause)
        self._ramp.is_over = self._ramp.is_over or stop is Stop.BRAKE
        self._ramp.is_zero = self._ramp.is_zero or stop is Stop.ZERO

    def stop(self, t_s: float, belts_m_s: tuple[float, float]) -> TrackCommand:
        """Return the command of a held chair.

        Args:
            t_s: Time of the tick.
            belts_m_s: Present speeds, left and right.
        """
        return self._ramp.step(t_s, belts_m_s)

    def release(self, t_s: float, pressed_s: float) -> bool:
        """End a hold for a button pressed at ``pressed_s``; return whether there was one. A press before the hold is not meant."""
        if self.cause is None or pressed_s < self._held_s:
            return False
        self.report(t_s, "rearmed", f"by a person, after: {self.cause}")
        self.cause = None
        return True

    def slow(self, t_s: float, kind: str, cause: str) -> None:
        """Report a change of the speed restriction; an empty ``kind`` ends it."""
        if kind != self._slow:
            self.report(t_s, "slow" if kind else "resumed", cause)
        self._slow = kind

    def report(self, t_s: float, name: str, cause: str) -> None:
        """Append an event."""
        self._events.append(Event(t_s=t_s, name=name, cause=cause))

    def take(self) -> list[Event]:
        """Return the events since the last call."""
        events, self._events = self._events, []
        return events
