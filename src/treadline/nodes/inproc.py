"""Signals as calls: what is published has been taken when ``publish`` returns."""

from collections import defaultdict
from collections.abc import Callable
from typing import Any


class InProcess:
    """The transport of one process: no copies, no threads, no queues; who subscribes first takes first."""

    def __init__(self) -> None:
        self._takers: defaultdict[str, list[Callable[[Any], object]]] = defaultdict(list)

    def announce(self, channel: str) -> None:
        """Need nothing."""

    def publish(self, channel: str, signal: Any) -> None:
        """Hand a signal to all who take from the channel."""
        for take in self._takers[channel]:
            take(signal)

    def subscribe(self, channel: str, take: Callable[[Any], object]) -> None:
        """Have a channel's signals taken."""
        self._takers[channel].append(take)

    def deliver(self, timeout_s: float) -> int:
        """Nothing waits."""
        del timeout_s
        return 0

    def close(self) -> None:
        """Forget who takes."""
        self._takers.clear()
