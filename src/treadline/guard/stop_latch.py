"""Latch of the HOLD: the first cause stays until a person re-arms. Collects the guard's events."""

import math

from treadline.core.signals import ROUNDING_S, Event, OperatorInput, TrackCommand
from treadline.guard._guard_config import GuardConfig
from treadline.guard._half_cosine_stop import RampedStop, Stop

ACT_S, HELD_S, AGAIN_S = 0.75, 0.5, 1.0
"""Shortest release of the dead-man switch after which pressing it again is meant, age of a hold from which a press answers it, and
time between two re-arms [s]. A terminal over a slow link pauses the repeats of a held key for up to 0.6 s; a person answers what
has happened after half a second; and a button that bounces at 10 Hz drives a chair by 20 mm each time."""
QUIET_S = 10.0
"""Time in which one kind of rejected message is reported once [s]: a person reads an event, not a thousand."""


class Rearm:
    """Distinguishes a person who re-arms from a key that is held on: re-arming is an act of its own.

    The re-arm button is pressed anew while the dead-man switch is held, so with another key; or both were released for ``ACT_S``
    since the hold began, as where one key is both.
    """

    def __init__(self) -> None:
        self._down, self._dead_man = False, True
        self._released_s = math.inf

    def press(self, operator: OperatorInput, held_s: float) -> bool:
        """Update with a report of the handset; return whether it re-arms.

        Args:
            operator: The report.
            held_s: Time since which the chair is held; infinite if it is not.
        """
        t_s, is_new, was_held = operator.t_s, operator.rearm and not self._down, self._dead_man
        released_for_s = t_s - max(self._released_s, held_s)
        self._down, self._dead_man = operator.rearm, operator.dead_man
        if operator.dead_man:
            self._released_s = math.inf
        elif math.isinf(self._released_s):
            self._released_s = t_s
        is_another_key = was_held or released_for_s >= ACT_S - ROUNDING_S
        is_answer = t_s - held_s >= HELD_S - ROUNDING_S
        return is_new and is_another_key and is_answer and operator.dead_man and not operator.stop


class Latch:
    """First cause of the HOLD, and the events since the last call of ``take``.

    Args:
        config: Limits of the guard.
    """

    def __init__(self, config: GuardConfig) -> None:
        self.cause: str | None = None
        self.held_s = math.inf
        """Time since which the chair is held [s]; infinite if it is not."""
        self._config = config
        self._ramp = RampedStop(config)
        self._events: list[Event] = []
        self._slow = ""
        self._rejected: dict[str, tuple[float, int]] = {}
        """Of each kind of message that was rejected: when one was last reported, and how many have been rejected since."""

    def hold(self, t_s: float, stop: Stop, cause: str | None) -> None:
        """Latch a cause; a later cause is not latched, but an urgent one ends a ramped stop. None is no cause."""
        if cause is None:
            return
        self.held_s = min(self.held_s, t_s)  # the clock may have leapt back
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

    def release(self, t_s: float) -> None:
        """End the hold."""
        self.report(t_s, "rearmed", f"by a person, after: {self.cause}")
        self.cause, self.held_s = None, math.inf

    def slow(self, t_s: float, kind: str, cause: str) -> None:
        """Report a change of the speed restriction; an empty ``kind`` ends it."""
        if kind != self._slow:
            self.report(t_s, "slow" if kind else "resumed", cause)
        self._slow = kind

    def report(self, t_s: float, name: str, cause: str) -> None:
        """Append an event."""
        self._events.append(Event(t_s=t_s, name=name, cause=cause))

    def reject(self, t_s: float, cause: str | None) -> None:
        """Report a rejected message, of each kind at most once in ``QUIET_S``, with the number of those between.

        None is not reported.
        """
        if cause is None:
            return
        kind = cause.split(maxsplit=1)[0]
        reported_s, count = self._rejected.get(kind, (-math.inf, 0))
        if t_s - reported_s < QUIET_S:
            self._rejected[kind] = min(reported_s, t_s), count + 1
            return
        self._rejected[kind] = t_s, 0
        self.report(t_s, "rejected", cause + (f"; {count} more since" if count else ""))

    def take(self) -> list[Event]:
        """Return the events since the last call."""
        events, self._events = self._events, []
        return events
