"""Runner of one node in a process of its own: clock, heartbeat, and behaviour without messages.

Time is that of a simulated plant (``/clock``), else the wall clock. A simulated plant waits until the guard is ready, keeps its
pace, and waits for nodes that fall behind: a busy machine slows the simulation, not the chair's reactions.
"""

import math
import time
from collections.abc import Callable
from threading import Event as Flag
from typing import Any, Literal

from treadline.core.errors import TreadlineError
from treadline.core.signals import TICK_S
from treadline.ros import channels as on
from treadline.ros._node_signals import Beat, Clock
from treadline.ros.block_nodes import GuardNode, Node
from treadline.ros.plant_node import PlantNode
from treadline.ros.wire import WireTransport

BEAT_S = 0.2
"""Interval of the heartbeat [s]."""
SILENT_S = 0.6
"""Silence of ``/clock`` after which the guard counts time by itself [s]: a stopped simulator must not stop the guard."""
LEAPT_S = 0.1
"""A wall clock that steps back by less is waited for [s]; by more, the node follows it, and the guard holds for the leap. A message
further ahead of the node's clock shows that the node was kept from running."""
SLEPT_S = 0.1
"""A guard that was kept from running for longer does not know which node was silent meanwhile [s]."""
PATIENCE_S = 60.0
"""Startup timeout for required channels [s]."""
LAG_S = 0.05
"""Lag of the guard up to which a simulated plant does not wait [s]."""
BEHIND_S = 0.35
"""The same for any other node, by its last heartbeat [s]."""
STUCK_S = 0.5
"""Longest wait of a simulated plant for a node that is behind [s]; then it continues without that node."""
OTHER_CLOCK_S = 10.0
"""Distance of a first stamp from the clock beyond which the stamp belongs to another clock [s]."""
POLL_S = 0.005

ClockKind = Literal["sim", "wall"]


class NodeRunner:
    """Runs a node: delivers messages, ticks by the clock, publishes the heartbeat."""

    def __init__(self, node: Node, transport: WireTransport, *, clock: ClockKind = "sim", patience_s: float = PATIENCE_S) -> None:
        self._node = node
        self._transport = transport
        self._sim = clock == "sim"
        self._patience_s = patience_s
        self._t_s = 0.0
        self._clock_at: float | None = None
        self._last_s = 0.0
        self._beat_at = -math.inf
        self._received: set[str] = set()
        self._began = self._turned_at = time.monotonic()
        transport.announce(on.DIAGNOSTICS)
        for channel in node.publishes:
            transport.announce(channel)
        node.listen(_Subscriptions(transport, self._receive))
        if self._sim and not isinstance(node, PlantNode):
            transport.subscribe(on.CLOCK, self._take_clock)

    def run(self, stop: Flag) -> None:
        """Run until ``stop`` is set.

        Raises:
            TreadlineError: If a required channel is silent or of another type, or stamps belong to another clock.
        """
        self._began = time.monotonic()
        looked = False
        while not stop.is_set():
            self._transport.deliver(POLL_S)
            self._turn()
            if not looked and time.monotonic() - self._began > self._patience_s:
                looked = True
                self._check_required()

    def _turn(self) -> None:
        """Tick where no message does it, and publish the heartbeat."""
        now = time.monotonic()
        slept, self._turned_at = now - self._turned_at > SLEPT_S, now
        if not self._sim:
            t_s = math.floor(time.time() / TICK_S) * TICK_S
            if t_s > self._t_s or t_s < self._t_s - LEAPT_S:
                self._tick(t_s)
        elif not isinstance(self._node, GuardNode) or self._clock_at is None:
            pass
        elif slept and self._t_s <= self._last_s:
            self._clock_at = now - SLEPT_S
        elif now - self._clock_at > SILENT_S:
            t_s = self._last_s + math.floor((now - self._clock_at) / TICK_S) * TICK_S
            if t_s > self._t_s:
                self._tick(t_s)
        self.beat(now)

    def beat(self, now: float) -> None:
        """Publish the heartbeat where it is due."""
        if now - self._beat_at < BEAT_S:
            return
        self._beat_at = now
        state = "ready"
        if isinstance(self._node, GuardNode):
            missing = self._node.missing
            state = f"waits for {', '.join(sorted(missing))}" if missing else "ready"
            if missing:
                self._node.tick(self._t_s)
            else:
                self._node.repeat_state()
        self._transport.publish(on.DIAGNOSTICS, Beat(t_s=self._t_s, node=self._node.name, state=state))

    def _take_clock(self, clock: Clock) -> None:
        self._clock_at, self._last_s = time.monotonic(), clock.t_s
        self._tick(clock.t_s)

    def _tick(self, t_s: float) -> None:
        self._t_s = t_s
        self._node.tick(t_s)

    def _receive(self, channel: str, signal: Any) -> None:
        """Update the node's clock where a stamp is far ahead of it; compare the first stamp of a sensor with the clock."""
        if getattr(signal, "t_s", -math.inf) - self._t_s > LEAPT_S:
            self._catch_up()
        if channel in self._received:
            return
        known = not self._sim or self._clock_at is not None
        if channel in on.SENSORS:
            now_s = self._t_s if self._sim else time.time()
            apart_s = signal.t_s - now_s
            if known and abs(apart_s) > OTHER_CLOCK_S:
                remedy = (
                    "--clock wall is for drivers that stamp with the wall's" if self._sim else "--clock sim is for a simulator's"
                )
                raise TreadlineError(
                    f"{channel}: stamped {signal.t_s:.3f} s where the clock shows {now_s:.3f} s: stamps of another clock; {remedy}"
                )
        if known:
            self._received.add(channel)

    def _catch_up(self) -> None:
        """Set the node's clock to now: messages that came while the process did not run are newer than its last tick."""
        now: Clock | None = self._transport.newest(on.CLOCK) if self._sim else Clock(t_s=time.time())
        if now is not None:
            self._node.advance(now.t_s)

    def _check_required(self) -> None:
        after = f"after {self._patience_s:.0f} s"
        for channels in self._node.needs:
            if any(channel in self._received for channel in channels):
                continue
            why = self._transport.trouble(channels[0])
            if why is None and self._sim and self._clock_at is None:
                break
            raise TreadlineError(f"{self._node.name}: nothing on {channels[0]} {after}: {why or 'it is published, and silent'}")
        if self._sim and self._clock_at is None and self._transport.trouble(on.CLOCK) is not None:
            raise TreadlineError(
                f"{self._node.name}: no /clock {after}: start a simulated plant (treadline node plant), "
                "or give --clock wall for real drivers"
            )


class _Subscriptions:
    """Transport that passes each signal to the runner before it is delivered."""

    def __init__(self, transport: WireTransport, receive: Callable[[str, Any], None]) -> None:
        self._transport = transport
        self._receive = receive
        self.announce, self.publish = transport.announce, transport.publish
        self.deliver, self.close = transport.deliver, transport.close

    def subscribe(self, channel: str, take: Callable[[Any], object]) -> None:
        """Subscribe; the runner gets each signal first."""

        def received(signal: Any) -> None:
            self._receive(channel, signal)
            take(signal)

        self._transport.subscribe(channel, received)


def run_plant(
    node: PlantNode,
    transport: WireTransport,
    *,
    stop: Flag,
    pace: float = 1.0,
    duration_s: float = math.inf,
    patience_s: float = 60.0,
) -> float:
    """Run a simulated plant by the wall clock; return the simulated time at its end [s].

    Args:
        pace: Simulated seconds per second.

    Raises:
        TreadlineError: If no guard is ready in time.
    """
    runner = NodeRunner(node, transport, patience_s=math.inf)
    transport.announce(on.CLOCK)
    peers = _Peers(node)
    transport.subscribe(on.DIAGNOSTICS, peers.receive)
    node.start()
    began = time.monotonic()
    while peers.guard != "ready" and not stop.is_set():
        transport.deliver(POLL_S)
        runner.beat(time.monotonic())
        if time.monotonic() - began > patience_s:
            raise TreadlineError(f"plant: the guard is not ready after {patience_s:.0f} s: {peers.guard}; start the missing nodes")
    due = time.monotonic()
    tick, t_s = 0, 0.0
    while not stop.is_set() and t_s < duration_s:
        t_s = tick * TICK_S
        node.tick(t_s)
        transport.publish(on.CLOCK, Clock(t_s=t_s))
        due = max(due + TICK_S / pace, time.monotonic() - TICK_S)
        waits_from = time.monotonic()
        while (now := time.monotonic()) < due or peers.keep_waiting(t_s, now - waits_from):
            runner.beat(now)
            transport.deliver(min(POLL_S, max(due - now, 0.001)))
        tick += 1
    return t_s


class _Peers:
    """Progress of the other nodes, by their heartbeats."""

    def __init__(self, node: PlantNode) -> None:
        self._node = node
        self._t_s: dict[str, float] = {}
        self._given_up: set[str] = set()
        self.guard = "not heard"
        """State that the guard reports of itself."""

    def receive(self, message: object) -> None:
        """Take a heartbeat."""
        if not isinstance(message, Beat) or message.node in ("plant", "recorder"):
            return
        self._t_s[message.node] = message.t_s
        self._given_up.discard(message.node)
        if message.node == "guard":
            self.guard = message.state

    def keep_waiting(self, t_s: float, waited_s: float) -> bool:
        """Return whether a node is too far behind; a node that stays behind for ``STUCK_S`` is not waited for any more."""
        behind = {name for name, then_s in self._t_s.items() if t_s - then_s > BEHIND_S}
        if t_s - self._node.commanded_s > LAG_S:
            behind.add("guard")
        if waited_s > STUCK_S:
            self._given_up |= behind
        return bool(behind - self._given_up)
