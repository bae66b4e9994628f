"""Common part of the transports over a wire: an inbox filled by any thread, delivered in one, the newest where not all fit."""

import time
from collections import Counter, deque
from collections.abc import Callable
from threading import Condition
from typing import Any

from treadline.core.camera_images import PinholeCamera
from treadline.core.errors import LogFormatError
from treadline.io.message_types import store
from treadline.ros._codec import Decoder, encoded
from treadline.ros.channels import CHANNELS, Channel, Senders, Topic, two_sources

_Subscriber = tuple[str, Decoder, Callable[[Any], object]]
"""Channel, its decoder, and the function that receives its signals."""


class Inbox:
    """Waiting messages in the order of arrival; of each topic at most its depth, the oldest are dropped."""

    def __init__(self) -> None:
        self._waiting: deque[tuple[str, bytes]] = deque()
        self._counts: Counter[str] = Counter()
        self._depths: dict[str, int] = {}
        self._come = Condition()
        self._senders = Senders()
        self.second: deque[tuple[str, str, str]] = deque()
        """Topics with two sources, and both, that are not reported yet."""
        self.newest: dict[str, bytes] = {}
        """Last message received on each topic, whether it has been delivered or still waits."""
        self.lost: Counter[str] = Counter()
        """Number of messages dropped for newer ones, by topic; a topic of depth 1 counts none."""

    def expect(self, topic: str, depth: int) -> None:
        """Take messages of a topic."""
        self._depths[topic] = max(depth, self._depths.get(topic, 0))

    def note(self, topic: str, sender: str) -> None:
        """Record who sent a message, whether it is delivered or gives way to a newer one."""
        other = self._senders.other(topic, sender, time.monotonic())
        if other is not None:
            self.second.append((topic, other, sender))

    def put(self, topic: str, data: bytes, sender: str = "") -> None:
        """Take one message; called by whatever thread brings it."""
        with self._come:
            self.note(topic, sender)
            if self._counts[topic] < self._depths[topic]:
                self._counts[topic] += 1
            else:
                del self._waiting[next(k for k, (name, _) in enumerate(self._waiting) if name == topic)]
                if self._depths[topic] > 1:
                    self.lost[topic] += 1
            self._waiting.append((topic, data))
            self.newest[topic] = data
            self._come.notify()

    def get(self, timeout_s: float) -> tuple[str, bytes] | None:
        """Return the next message, or None if nothing comes in time."""
        with self._come:
            if not self._come.wait_for(lambda: self._waiting, timeout_s):
                return None
            topic, data = self._waiting.popleft()
            self._counts[topic] -= 1
            return topic, data


class WireTransport:
    """Channels as topics of ROS; a child knows how to advertise, send and receive.

    Args:
        mount: The camera whose place on the chair frames get.
    """

    ros1 = False

    def __init__(self, mount: PinholeCamera | None = None) -> None:
        self._mount = mount
        self.read_as: dict[str, str] = {}
        """Message types of topics that differ from those of their channel."""
        self._takers: dict[str, list[_Subscriber]] = {}
        self._announced: set[str] = set()
        self._failing: dict[str, str] = {}
        self.inbox = Inbox()
        self.broken: Counter[str] = Counter()
        """Number of messages dropped because their bytes could not be read, by topic."""
        self.on_signal: Callable[[str, Any], object] = lambda _channel, _signal: None
        """Receives channel and signal before each subscriber does."""
        self.on_broken: Callable[[str], object] = lambda _reason: None
        """Receives topic and reason of the first broken message of each series."""
        self.on_two_sources: Callable[[str], object] = lambda _cause: None
        """Receives which topic has two publishers, and which they are."""
        self.spare = 1
        """Factor on the depth of each channel."""

    def announce(self, channel: str) -> None:
        """Advertise the topics of a channel."""
        if channel in self._announced:
            return
        self._announced.add(channel)
        for topic in CHANNELS[channel].topics_of(ros1=self.ros1):
            kind = self._kind(topic)
            if self.ros1:
                store().get_msgdef(kind)  # compiled before the node turns
            self._advertise(topic.name, kind, CHANNELS[channel])

    def publish(self, channel: str, signal: Any) -> None:
        """Send a signal."""
        self.announce(channel)
        for topic, _, data in encoded(channel, signal, ros1=self.ros1):
            self._send(topic, data)

    def subscribe(self, channel: str, take: Callable[[Any], object]) -> None:
        """Subscribe to a channel."""
        spec = CHANNELS[channel]
        decoder = self._decoder(channel)
        for topic in spec.topics_of(ros1=self.ros1):
            if not topic.read:
                continue
            first = topic.name not in self._takers
            self._takers.setdefault(topic.name, []).append((channel, decoder, take))
            depth = self.spare * spec.depth
            self.inbox.expect(topic.name, depth)
            if first:
                self._receive(topic.name, self._kind(topic), depth)

    def _kind(self, topic: Topic) -> str:
        return self.read_as.get(topic.name) or topic.kind_of(ros1=self.ros1)

    def _decoder(self, channel: str) -> Decoder:
        return Decoder(channel, ros1=self.ros1, mount=self._mount, kinds=self.read_as)

    def deliver(self, timeout_s: float) -> int:
        """Deliver the waiting messages, up to a batch; wait for the first at most ``timeout_s``. Return their number."""
        for count in range(BATCH):
            message = self.inbox.get(timeout_s if count == 0 else 0.0)
            if message is None:
                return count
            self._take(*message)
        return BATCH

    def _take(self, topic: str, data: bytes) -> None:
        """Deliver one message; a broken one is dropped and counted."""
        while self.inbox.second:
            topic_of_two, *senders = self.inbox.second.popleft()
            self.on_two_sources(two_sources(topic_of_two, *(self._node_name(topic_of_two, sender) for sender in senders)))
        for channel, decoder, take in self._takers[topic]:
            try:
                signal = decoder.signal(topic, data)
            except LogFormatError as error:
                self._drop(topic, str(error))
                return
            if signal is not None:
                self.on_signal(channel, signal)
                take(signal)
        self._failing.pop(topic, None)

    def _drop(self, topic: str, reason: str) -> None:
        self.broken[topic] += 1
        if topic not in self._failing:
            self._failing[topic] = reason
            self.on_broken(reason)

    def newest(self, channel: str) -> Any | None:
        """Return the last signal received on a channel of one topic, whether processed or queued; None if broken or before it."""
        (topic,) = CHANNELS[channel].topics_of(ros1=self.ros1)
        data = self.inbox.newest.get(topic.name)
        try:
            return None if data is None else self._decoder(channel).signal(topic.name, data)
        except LogFormatError:
            return None

    def trouble(self, channel: str) -> str | None:
        """Return why a channel has no messages (broken, wrong type, no publisher), as far as it is known; otherwise None."""
        for topic in CHANNELS[channel].topics_of(ros1=self.ros1):
            if not topic.read:
                continue
            if topic.name in self._failing:
                return self._failing[topic.name]
            kinds = self._kinds(topic.name)
            expected = self._kind(topic)
            wrong = [kind for kind in kinds if kind != expected]
            if wrong:
                return f"{topic.name} is published as {wrong[0]}; {expected} is read"
            if not kinds:
                return f"nobody publishes {topic.name}"
        return None

    def close(self) -> None:
        """Leave."""

    def _advertise(self, topic: str, kind: str, channel: Channel) -> None:
        raise NotImplementedError

    def _send(self, topic: str, data: bytes) -> None:
        raise NotImplementedError

    def _receive(self, topic: str, kind: str, depth: int) -> None:
        """Have ``inbox.put(topic, data, sender)`` called for each message."""
        raise NotImplementedError

    def _node_name(self, topic: str, sender: str) -> str:
        """Return the name of a topic's publisher."""
        del topic
        return sender

    def _kinds(self, topic: str) -> list[str]:
        """Return the types, as ROS 2 writes them, that a topic is published as."""
        raise NotImplementedError


BATCH = 50
"""Messages delivered before the runner looks at its clock."""
