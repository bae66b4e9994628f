"""Recent values by time: what the chair's state was when a late frame was exposed."""

from collections import deque
from typing import Generic, TypeVar

T = TypeVar("T")

DEPTH = 50
"""Remembered values by default: 0.5 s at 100 Hz, the longest mean camera latency that a scenario accepts."""


class Recent(Generic[T]):
    """The last values of a signal with their time stamps.

    Args:
        depth: Number of values kept.
    """

    def __init__(self, depth: int = DEPTH) -> None:
        self._values: deque[tuple[float, T]] = deque(maxlen=depth)

    def add(self, t_s: float, value: T) -> None:
        """Append the value at ``t_s``."""
        self._values.append((t_s, value))

    def at(self, t_s: float) -> T | None:
        """Return the value whose stamp is nearest to ``t_s``, the newest of several; None before the first value."""
        if not self._values:
            return None
        return min(reversed(self._values), key=lambda item: abs(item[0] - t_s))[1]

    def copy(self) -> "Recent[T]":
        """Return an independent history with the same values."""
        twin: Recent[T] = Recent()
        twin._values = self._values.copy()
        return twin
