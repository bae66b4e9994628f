"""The whole graph in one process, tick by tick, with the same commands as ``mission.loop``.

Its transport is in-process: ``publish`` calls the subscribers, and returns when they have.
"""

import time
from collections import Counter, defaultdict
from collections.abc import Callable
from typing import Any

from treadline.core.camera_images import PinholeCamera
from treadline.core.ports import Plant
from treadline.core.signals import TICK_S, Event
from treadline.guard import GuardConfig
from treadline.mission.loop import Blocks
from treadline.ros import channels as on
from treadline.ros.block_nodes import CameraNode, DriverNode, GuardNode, HeadingNode, Node, SeatNode
from treadline.ros.plant_node import PlantNode


class InProcess:
    """Transport of one process, without copies, threads and queues; subscribers are called in the order of subscription.

    Args:
        now: Clock by which two publishers of one channel are found [s].
    """

    def __init__(self, now: Callable[[], float] = time.monotonic) -> None:
        self._sender, self._now, self._senders = "unnamed", now, on.Senders()
        self._takers: defaultdict[str, list[tuple[Callable[[str, str], None], Callable[[Any], object]]]] = defaultdict(list)
        self._names: Counter[str] = Counter()

    def end(self, node: str) -> "InProcess":
        """Return the end of the bus at which a node speaks and listens; the second of a name has a number, too."""
        end = InProcess(self._now)
        end._takers, end._names = self._takers, self._names
        self._names[node] += 1
        end._sender = node if self._names[node] == 1 else f"{node} {self._names[node]}"
        return end

    def announce(self, channel: str) -> None:
        """Do nothing."""

    def publish(self, channel: str, signal: Any) -> None:
        """Deliver a signal to all subscribers of a channel."""
        for note, take in self._takers[channel]:
            note(channel, self._sender)
            take(signal)

    def subscribe(self, channel: str, take: Callable[[Any], object]) -> None:
        """Subscribe to a channel."""
        self._takers[channel].append((self._note, take))

    def deliver(self, timeout_s: float) -> int:
        """Return zero: no message waits."""
        del timeout_s
        return 0

    def close(self) -> None:
        """Remove the subscriptions of this end."""
        for channel, takers in self._takers.items():
            self._takers[channel] = [(note, take) for note, take in takers if note != self._note]

    def _note(self, channel: str, sender: str) -> None:
        """Report two publishers of a channel; the guard holds for it."""
        other = self._senders.other(channel, sender, self._now())
        if other is not None:
            cause = on.two_sources(channel, other, sender)
            self.publish(on.DIAGNOSTICS, Event(t_s=self._now(), name=on.TWO_SOURCES, cause=cause))


class LockStep:
    """All nodes on one transport, run in the order of the loop."""

    def __init__(
        self,
        plant: Plant,
        blocks: Blocks,
        config: GuardConfig,
        *,
        beside: tuple[Node, ...] = (),
        mount: PinholeCamera | None = None,
    ) -> None:
        """Connect the nodes; those ``beside`` only subscribe, and ``mount`` is published for viewers."""
        self._tick = 0
        self.transport = InProcess(lambda: self._tick * TICK_S)
        self._plant = PlantNode(plant, config)
        driver = DriverNode(blocks.planner, blocks.driver, config)
        heading = HeadingNode(blocks.estimator, config, mount)
        camera = CameraNode(blocks.detector, config, blocks.swept_half_m)
        seat = [] if blocks.leveller is None else [SeatNode(blocks.leveller, config)]
        blocks_of: list[Node] = [camera, *seat, driver, heading]
        self.guard = GuardNode(config, tuple(node.name for node in blocks_of))
        # The guard gets each reading first, and publishes its commands last.
        listeners: list[Node] = [self._plant, self.guard, camera, heading, *seat, driver, *beside]
        for node in listeners:
            node.listen(self.transport.end(node.name))
        self.nodes: list[Node] = [*beside, *blocks_of, self.guard]
        self._beside = len(beside)
        self._plant.start()

    def tick(self) -> float:
        """Advance the plant to the next tick, and let each node do what is due; return the time."""
        t_s = self._tick * TICK_S
        for node in self.nodes[self._beside :]:  # the stamps of this tick's readings are compared with its time
            node.advance(t_s)
        self._plant.tick(t_s)
        for node in self.nodes:
            node.tick(t_s)
            if self._tick % round(on.BEAT_S / TICK_S) == 0:
                self.transport.publish(on.DIAGNOSTICS, on.Beat(t_s=t_s, node=node.name))
        self._tick += 1
        return t_s
