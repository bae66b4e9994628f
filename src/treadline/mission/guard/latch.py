"""HOLD, and what was told: a cause stays until a person re-arms."""

from treadline.signals import Event


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

    def __init__(self) -> None:
        self.cause: str | None = None
        self._events: list[Event] = []
        self._slow = ""

    def hold(self, t_s: float, cause: str | None) -> None:
        """Hold for a cause, unless there is none or the chair is held already."""
        if cause is not None and self.cause is None:
            self.cause = cause
            self.tell(t_s, "hold", cause)

    def release(self, t_s: float) -> bool:
        """End a hold; say whether there was one."""
        if self.cause is None:
            return False
        self.tell(t_s, "rearmed", f"by a person, after: {self.cause}")
        self.cause = None
        return True

    def slow(self, t_s: float, kind: str, cause: str) -> None:
        """Tell that the chair goes slowly, and why; an empty ``kind`` ends it."""
        if kind != self._slow:
            self.tell(t_s, "slow" if kind else "resumed", cause)
        self._slow = kind

    def tell(self, t_s: float, name: str, cause: str) -> None:
        """Add an event."""
        self._events.append(Event(t_s=t_s, name=name, cause=cause))

    def take(self) -> list[Event]:
        """Return the events since the last call."""
        events, self._events = self._events, []
        return events
