"""One rule for the stamp of every message: reading, frame, map, health, plan, command, operator (row 10). ``stamp -> bool``."""

import math
from collections import Counter
from typing import Protocol

from treadline.core.signals import ROUNDING_S
from treadline.guard._guard_config import GuardConfig


class Stamped(Protocol):
    """Message with the time of its measurement or computation."""

    @property
    def t_s(self) -> float:
        """Mission-clock time [s]."""


class Stamps:
    """Accepts a stamp that is finite, not ahead of the guard's clock, newer than the last of its kind, and not too old.

    Nothing is accepted before the first tick.
    """

    def __init__(self, config: GuardConfig) -> None:
        self._config = config
        self._now_s: float | None = None
        self._last_s: dict[tuple[str, str], float] = {}
        self.rejected: Counter[str] = Counter()
        """Number of messages rejected for their stamp or their content, by kind."""
        self.rejection: str | None = None
        """Reason of the last rejection; None if the message was overtaken, repeated, or before the first tick."""
        self.leap: str | None = None
        """How far the stamp of the last message leapt, if by more than ``clock_jump_s``."""

    def advance(self, now_s: float) -> None:
        """Set the clock."""
        self._now_s = now_s

    def accept(self, message: Stamped, by: str = "", content: str = "") -> bool:
        """Return whether a message is acceptable; each message is asked for once.

        Args:
            message: The message.
            by: Sender of what is no reading, where two send messages of one type.
            content: Fault of the message's content, if any.
        """
        kind = type(message).__name__
        fault = self._fault(kind, by, message)
        if fault is None and not content:
            self._last_s[kind, by] = message.t_s
            return True
        fault = content if fault is None else fault
        self.rejected[kind] += 1
        self.rejection = f"{kind} {fault}" if fault else None
        return False

    def restart(self) -> None:
        """Accept what is newer than now, after the clock has leapt back."""
        self._last_s = {key: min(last_s, self._now_s or 0.0) for key, last_s in self._last_s.items()}

    def _fault(self, kind: str, by: str, message: Stamped) -> str | None:
        """Return the fault of a stamp, empty for a repeated or overtaken message and before the first tick; None for a good one."""
        self.leap = None
        t_s, now_s, limits = message.t_s, self._now_s, self._config
        if now_s is None:
            return ""
        if not math.isfinite(t_s):
            return "has no time stamp"
        last_s = self._last_s.get((kind, by), -math.inf)
        if t_s - now_s > limits.ahead_s + ROUNDING_S:
            if t_s - now_s > limits.clock_jump_s:
                self.leap = f"clock of {kind} leapt {t_s - now_s:.2f} s ahead"
            return f"stamped {t_s - now_s:.2f} s ahead of the clock"
        if last_s - t_s > limits.clock_jump_s:
            if not by:  # a sensor's clock holds; later readings are compared with the new time, so that a person can re-arm
                self._last_s[kind, by] = t_s
            self.leap = f"clock of {kind} leapt {last_s - t_s:.2f} s back"
            return f"stamped {last_s - t_s:.2f} s before the last one"
        if t_s <= last_s:
            return ""
        return f"is {now_s - t_s:.2f} s old" if now_s - t_s > limits.blind_timeout_s else None
