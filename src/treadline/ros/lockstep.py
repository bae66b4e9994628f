"""The whole graph in one process, tick by tick, with the same commands as ``mission.loop``.

Its transport is in-process: ``publish`` calls the subscribers, and returns when they have.
"""

from collections import defaultdict
from collections.abc import Callable
from typing import Any

from treadline.core.camera_images import PinholeCamera
from treadline.core.ports import Plant, Transport
from treadline.core.signals import TICK_S
from treadline.guard import GuardConfig
from treadline.mission.loop import Blocks
from treadline.ros import channels as on
from treadline.ros.block_nodes import CameraNode, DriverNode, GuardNode, HeadingNode, Node, SeatNode
from treadline.ros.plant_node import PlantNode


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
        self.transport: Transport = InProcess()
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
            node.listen(self.transport)
        self.nodes: list[Node] = [*beside, *blocks_of, self.guard]
        self._beside = len(beside)
        self._tick = 0
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
