"""In-process transport: ``publish`` calls the subscribers, and returns when they have."""

from collections import defaultdict
from collections.abc import Callable
from typing import Any


class InProcess:
    """Transport of one process, without copies, threads and queues; subscribers are called in the order of subscription."""

    def __init__(self) -> None:
        self._takers: defaultdict[str, list[Callable[[Any], object]]] = defaultdict(list)

    def announce(self, channel: str) -> None:
        """Do nothing."""

    def publish(self, channel: str, signal: Any) -> None:
        """Deliver a signal to all subscribers of a channel."""
        for take in self._takers[channel]:
            take(signal)

    def subscribe(self, channel: str, take: Callable[[Any], object]) -> None:
        """Subscribe to a channel."""
        self._takers[channel].append(take)

    def deliver(self, timeout_s: float) -> int:
        """Return zero: no message waits."""
        del timeout_s
        return 0

    def close(self) -> None:
        """Remove all subscriptions."""
        self._takers.clear()
