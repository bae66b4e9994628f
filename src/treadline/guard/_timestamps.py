"""Time stamps of messages (row 10): one rule for what is ahead of the clock, and one clock per kind of reading."""

import math
from collections import Counter

from treadline.core.signals import ROUNDING_S


class Timestamps:
    """Checks stamps against the guard's clock, and readings against the previous stamp of their kind.

    Args:
        ahead_s: A message whose stamp is further ahead of the clock is rejected and counted [s].
        leap_s: A reading whose stamp is further ahead, or further behind the previous one, is a fault of its clock [s].
    """

    def __init__(self, ahead_s: float, leap_s: float) -> None:
        self._ahead_s, self._leap_s = ahead_s, leap_s
        self._now_s: float | None = None
        self._last_s: dict[str, float] = {}
        self._is_rejected: set[str] = set()
        self.rejected: Counter[str] = Counter()
        """Number of messages rejected because their stamp is ahead of the clock, by kind."""
        self.rejection: str | None = None
        """Reason of the last rejection, if the message before it of the same kind was accepted."""
        self.leap: str | None = None
        """How far the stamp of the last reading leapt, if it did."""

    def advance(self, now_s: float) -> None:
        """Set the clock."""
        self._now_s = now_s

    def accept(self, kind: str, t_s: float) -> bool:
        """Return whether a stamp is not ahead of the clock; before the first tick every stamp is accepted."""
        self.rejection = None
        ahead_s = 0.0 if self._now_s is None else t_s - self._now_s
        if not ahead_s > self._ahead_s + ROUNDING_S:
            self._is_rejected.discard(kind)
            return True
        self.rejected[kind] += 1
        if kind not in self._is_rejected:
            self._is_rejected.add(kind)
            self.rejection = f"{kind} stamped {ahead_s:.2f} s ahead of the clock"
        return False

    def accept_reading(self, kind: str, t_s: float) -> bool:
        """Return whether a reading's stamp is not ahead of the clock, and newer than the previous one of its kind."""
        self.leap = None
        if not self.accept(kind, t_s):
            ahead_s = t_s - (self._now_s or 0.0)
            if ahead_s > self._leap_s:
                self.leap = f"clock of {kind} leapt {ahead_s:.2f} s ahead"
            return False
        last_s = self._last_s.get(kind, -math.inf)
        if last_s - t_s > self._leap_s:
            # Later readings are compared with the new time, so that a person can re-arm.
            self._last_s[kind] = t_s
            self.leap = f"clock of {kind} leapt {last_s - t_s:.2f} s back"
            return False
        if not (math.isfinite(t_s) and t_s > last_s):
            return False
        self._last_s[kind] = t_s
        return True


class SilenceMonitor:
    """Time since each of several sources last reported; a source that has never reported is not awaited."""

    def __init__(self, timeout_s: float, what: str) -> None:
        self._timeout_s = timeout_s
        self._what = what
        self._heard_s: dict[str, float] = {}

    def heard(self, source: str, t_s: float) -> None:
        """Record a report."""
        self._heard_s[source] = max(t_s, self._heard_s.get(source, t_s))

    def cause(self, t_s: float) -> str | None:
        """Return which source has been silent for too long, or None; a report from the future counts as made now."""
        for source, heard_s in self._heard_s.items():
            self._heard_s[source] = min(heard_s, t_s)
            if t_s - heard_s > self._timeout_s:
                return f"{self._what}{source} silent for {t_s - heard_s:.2f} s"
        return None

    def restart(self, t_s: float) -> None:
        """Wait for each source anew."""
        self._heard_s = dict.fromkeys(self._heard_s, t_s)
