"""A wire on which a test speaks."""

from typing import Any

from treadline.ros import channels as on
from treadline.ros._codec import encoded
from treadline.ros.wire import WireTransport


class Air(WireTransport):
    """Transport without a network; ``kinds`` are the types of the topics that somebody publishes."""

    def __init__(self, kinds: dict[str, str] | None = None) -> None:
        super().__init__()
        self.kinds = kinds or {}

    def say(self, channel: str, signal: Any) -> None:
        """Put a signal into the inbox, as another node would."""
        for topic, _, data in encoded(channel, signal, ros1=False):
            self.inbox.put(topic, data)

    def _advertise(self, topic: str, kind: str, channel: on.Channel) -> None:
        pass

    def _send(self, topic: str, data: bytes) -> None:
        pass

    def _receive(self, topic: str, kind: str, depth: int) -> None:
        pass

    def _kinds(self, topic: str) -> list[str]:
        return [self.kinds[topic]] if topic in self.kinds else []
