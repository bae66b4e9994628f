"""HOLD, and what was told: a cause stays until a person re-arms."""

from treadline.mission.guard.stopping import URGENT, CauseKind, RampedStop
from treadline.signals import Event, TrackCommand


class Button:
    """A button to re-arm."""

    def __init__(self) -> None:
        self._down = False

    def press(self, *, down: bool) -> bool:
        """Say whether it has just been pressed: one that is stuck is not."""
        before, self._down = self._down, down
        return down and not before


class Latch:
    """Keeps the first cause, and the events since they were last taken."""

    def __init__(self, drive_lag_s: float) -> None:
        self.cause: str | None = None
        self._drive_lag_s = drive_lag_s
        self._ramp = RampedStop(drive_lag_s)
        self._events: list[Event] = []
        self._slow = ""

    def hold(self, t_s: float, kind: CauseKind, cause: str | None) -> None:
        """Hold for a cause, unless there is none or the chair is held already; an urgent one ends a ramp."""
        if cause is None:
            return
        if self.cause is None:
            self.cause, self._ramp = cause, RampedStop(self._drive_lag_s)
            self.report(t_s, "hold", cause)
        elif kind in URGENT and not self._ramp.is_over:
            self.report(t_s, "brake", cause)
        if kind in URGENT:
            self._ramp.brake()

    def stop(self, t_s: float, belts_m_s: tuple[float, float]) -> TrackCommand:
        """Return the command of a held chair, whose belts run at these speeds."""
        return self._ramp.step(t_s, belts_m_s)

    def release(self, t_s: float) -> bool:
        """End a hold; say whether there was one."""
        if self.cause is None:
            return False
        self.report(t_s, "rearmed", f"by a person, after: {self.cause}")
        self.cause = None
        return True

    def slow(self, t_s: float, kind: str, cause: str) -> None:
        """Tell that the chair goes slowly, and why; an empty ``kind`` ends it."""
        if kind != self._slow:
            self.report(t_s, "slow" if kind else "resumed", cause)
        self._slow = kind

    def report(self, t_s: float, name: str, cause: str) -> None:
        """Add an event."""
        self._events.append(Event(t_s=t_s, name=name, cause=cause))

    def take(self) -> list[Event]:
        """Return the events since the last call."""
        events, self._events = self._events, []
        return events
