"""Runner of one node in a process of its own: clock, heartbeat, and behaviour without messages.

Time is that of a simulated plant (``/clock``), else the wall clock. A simulated plant waits until the guard is ready, keeps its
pace, and waits for nodes that fall behind: a busy machine slows the simulation, not the chair's reactions.
"""

import math
import sys
import time
from contextlib import ExitStack
from threading import Event as Flag
from typing import Any, Literal, Self

from treadline.core.errors import TreadlineError
from treadline.core.loop_watchdog import LoopWatchdog
from treadline.core.signals import TICK_S, Event
from treadline.guard import SILENCE_S
from treadline.ros import channels as on
from treadline.ros.block_nodes import GuardNode, Node
from treadline.ros.plant_node import PlantNode
from treadline.ros.wire import WireTransport

START_S = TICK_S
"""First stamp of a simulated clock [s]: ROS takes a stamp of zero for no stamp."""
SILENT_S = 0.6
"""Silence of ``/clock`` after which the guard holds [s]: the plant waits ``STUCK_S`` for nodes that are behind."""
LEAPT_S = 0.1
"""A wall clock that steps back by less is waited for [s]; by more, the node follows it (the guard holds above a second). A message
further ahead of the node's clock shows that the node was kept from running."""
APART_S = 0.75
"""Distance of a sensor's stamps from the node's clock, and its duration, above which their clocks differ [s]: half as much again as
the longest camera latency that a scenario accepts."""
PATIENCE_S = 60.0
"""Startup timeout for required channels [s]."""
LAG_S = 0.05
"""Lag of the guard up to which a simulated plant does not wait [s]."""
BEHIND_S = 0.35
"""The same for any other node, by its last heartbeat [s]."""
STUCK_S = 0.5
"""Longest wait of a simulated plant for a node that is behind [s]; then it continues without that node."""
ANSWER_S = 1.5 * TICK_S
"""Lag of the guard behind the plant from which an answer is due [s]: of a guard that keeps up it is one tick."""
OTHER_CLOCK_S = 10.0
"""Distance of stamps from the clock above which they belong to a clock of another kind, simulated or the wall's [s]."""
POLL_S = 0.005


class NodeRunner:
    """Runs a node: delivers messages, ticks by the clock, publishes the heartbeat."""

    def __init__(
        self, node: Node, transport: WireTransport, *, clock: Literal["sim", "wall"] = "sim", patience_s: float = PATIENCE_S
    ) -> None:
        self._node = node
        self._transport = transport
        self._sim = clock == "sim"
        self._patience_s = patience_s
        self._t_s = START_S
        self._clock_at: float | None = None
        self._beat_at = -math.inf
        self._received: set[str] = set()
        self._apart_at: dict[str, float] = {}
        self._clock_faults: dict[str, str] = {}
        self._began, self._looked = time.monotonic(), False
        self._watchdog = LoopWatchdog(self._hold, limit_s=SILENCE_S)
        transport.on_broken = lambda reason: self._report("dropped", reason)
        transport.on_two_sources = self._hold_for_two
        transport.announce(on.DIAGNOSTICS)
        for channel in node.publishes:
            transport.announce(channel)
        transport.on_signal = self._receive
        node.listen(transport)
        if self._sim and not isinstance(node, PlantNode):
            transport.subscribe(on.CLOCK, self._take_clock)

    def run(self, stop: Flag) -> None:
        """Run until ``stop`` is set.

        Raises:
            TreadlineError: If a required channel is silent or of another type, or stamps belong to another clock.
        """
        with self:
            while not stop.is_set():
                self._transport.deliver(POLL_S)
                self.turn()

    def __enter__(self) -> Self:
        """Begin to run. A standstill counts from now on, or from the first simulated time: until then the chair has no command."""
        self._began, self._looked, self._clock_at = time.monotonic(), False, None
        if not self._sim:
            self._watchdog.__enter__()
        return self

    def __exit__(self, *_: object) -> None:
        """Stop running."""
        self._watchdog.__exit__()

    def turn(self) -> None:
        """Do what no message does: ticks by the wall clock, the heartbeat, the look at required channels; call every ``POLL_S``.

        Raises:
            TreadlineError: If a required channel is silent or of another type, or stamps belong to another clock.
        """
        self._watchdog.begin("the delivery of messages")
        now = time.monotonic()
        if not self._looked and now - self._began > self._patience_s:
            self._looked = True
            self._check_required()
        if not self._sim:
            t_s = math.floor(time.time() / TICK_S) * TICK_S
            if t_s > self._t_s or t_s < self._t_s - LEAPT_S:
                self._tick(t_s)
        elif self._clock_at is not None and now - self._clock_at > SILENT_S:
            self._hold(f"no /clock for {now - self._clock_at:.1f} s: the simulated plant stands still")
            self._clock_at = now
            self._tick(self._t_s)
        self.beat(now)

    def beat(self, now: float) -> None:
        """Publish the heartbeat where it is due."""
        if now - self._beat_at < on.BEAT_S:
            return
        self._beat_at = now
        state = next(iter(self._clock_faults.values()), "ready")
        if isinstance(self._node, GuardNode):
            state = self._node.waits_for or state
            if self._node.waits_for:
                self._node.tick(self._t_s)
            self._node.repeat_state()
        self._transport.publish(on.DIAGNOSTICS, on.Beat(t_s=self._t_s, node=self._node.name, state=state))

    def _hold(self, cause: str) -> None:
        if isinstance(self._node, GuardNode):
            self._node.hold(cause)

    def _hold_for_two(self, cause: str) -> None:
        """Hold for two publishers of one topic, and have the guard hold where this node is another."""
        self._hold(cause)
        self._report(on.TWO_SOURCES, cause)

    def _report(self, name: str, cause: str) -> None:
        self._transport.publish(on.DIAGNOSTICS, Event(t_s=self._t_s, name=name, cause=f"{self._node.name}: {cause}"))

    def _take_clock(self, clock: on.Clock) -> None:
        if self._clock_at is None:
            self._watchdog.__enter__()
        self._clock_at = time.monotonic()
        self._tick(clock.t_s)

    def _tick(self, t_s: float) -> None:
        self._watchdog.begin("a tick")
        self._t_s = t_s
        self._node.tick(t_s)

    def _receive(self, channel: str, signal: Any) -> None:
        """Update the node's clock where a stamp is far ahead of it; compare the stamps of a sensor with the clock at the start."""
        self._watchdog.begin("the delivery of messages")
        t_s = getattr(signal, "t_s", -math.inf)
        now_s = self._t_s
        if t_s - now_s > LEAPT_S:
            now_s = self._catch_up()
        if channel in self._received or (self._sim and self._clock_at is None):
            return
        if channel not in on.SENSORS or abs(t_s - now_s) <= APART_S:
            self._received.add(channel)
            self._clock_faults.pop(channel, None)
            return
        lasts_s = time.monotonic() - self._apart_at.setdefault(channel, time.monotonic())
        if lasts_s > APART_S and channel not in self._clock_faults:
            fault = f"{channel}: stamped {t_s:.3f} s where the clock shows {now_s:.3f} s: {self._remedy(t_s - now_s)}"
            self._clock_faults[channel] = fault
            sys.stderr.write(f"treadline: {self._node.name}: {fault}\n")
            self._report("clock", fault)

    def _remedy(self, apart_s: float) -> str:
        if abs(apart_s) < OTHER_CLOCK_S:
            return "clocks that differ; set those of all machines by one server (chrony, ntpd)"
        other = "--clock wall is for drivers that stamp with the wall's" if self._sim else "--clock sim is for a simulator's"
        return f"stamps of another clock; {other}"

    def _catch_up(self) -> float:
        """Set the node's clock to now: messages that came while the process did not run are newer than its last tick."""
        newest = self._transport.newest(on.CLOCK) if self._sim else on.Clock(t_s=time.time())
        if newest is None:
            return self._t_s
        self._node.advance(newest.t_s)
        return float(newest.t_s)

    def _check_required(self) -> None:
        after = f"after {self._patience_s:.0f} s"
        for channels in self._node.needs:
            if any(channel in self._received for channel in channels):
                continue
            why = self._clock_faults.get(channels[0]) or self._transport.trouble(channels[0])
            if why is None and self._sim and self._clock_at is None:
                break
            raise TreadlineError(f"{self._node.name}: nothing on {channels[0]} {after}: {why or 'it is published, and silent'}")
        if self._sim and self._clock_at is None and self._transport.trouble(on.CLOCK) is not None:
            raise TreadlineError(
                f"{self._node.name}: no /clock {after}: start a simulated plant (treadline node plant), "
                "or give --clock wall for real drivers"
            )
        if isinstance(self._node, GuardNode) and self._node.waits_for:
            sys.stderr.write(f"treadline: guard: {self._node.waits_for} {after}; start the missing nodes\n")


class PlantRunner:
    """Runs a simulated plant by the wall clock: it starts when the guard is ready.

    Args:
        pace: Simulated seconds per second.
    """

    def __init__(self, node: PlantNode, transport: WireTransport, *, pace: float = 1.0, patience_s: float = PATIENCE_S) -> None:
        self._node, self._transport = node, transport
        self._period_s, self._patience_s = TICK_S / pace, patience_s
        self._runner = NodeRunner(node, transport, patience_s=math.inf)
        self._peers = _Peers(node)
        transport.announce(on.CLOCK)
        transport.subscribe(on.DIAGNOSTICS, self._peers.receive)
        node.start()
        self._ticks = 0
        self.t_s = START_S
        """Simulated time [s]."""

    def run(self, stop: Flag, duration_s: float = math.inf) -> float:
        """Run until ``stop`` is set, or for a simulated time; return the simulated time at the end [s].

        Raises:
            TreadlineError: If no guard is ready in time.
        """
        with self:
            while not stop.is_set() and self.t_s < duration_s:
                self._transport.deliver(self.turn())
        return self.t_s

    def __enter__(self) -> Self:
        """Begin to run: the wait for the guard counts from now on."""
        self._watchdog = LoopWatchdog(self._node.trip, self._node.brake, limit_s=SILENCE_S)
        self._armed, self._is_armed = ExitStack(), False
        self._began = self._due_at = self._answered_at = self._ticked_at = time.monotonic()
        self._commanded_s = -math.inf
        return self

    def __exit__(self, *_: object) -> None:
        """Stop running."""
        self._armed.close()

    def turn(self) -> float:
        """Do what is due; return the time after which something may be due again [s]. Messages are delivered between two turns.

        Raises:
            TreadlineError: If no guard is ready in time.
        """
        now = time.monotonic()
        self._runner.beat(now)
        if self._ticks == 0 and self._peers.guard != "ready":
            if now - self._began > self._patience_s:
                after = f"after {self._patience_s:.0f} s"
                raise TreadlineError(f"plant: the guard is not ready {after}: {self._peers.guard}; start the missing nodes")
            self._due_at = self._answered_at = self._ticked_at = now
            return POLL_S
        self._watchdog.begin("the delivery of messages")
        if self._node.commanded_s != self._commanded_s or self.t_s - self._node.commanded_s < ANSWER_S:
            self._commanded_s, self._answered_at = self._node.commanded_s, now
        self._node.hear_nothing(now - self._answered_at)
        if self._ticks == 0 or (now >= self._due_at and not self._peers.keep_waiting(self.t_s, now - self._ticked_at)):
            self._advance()
        return min(POLL_S, max(self._due_at - time.monotonic(), 0.001))

    def _advance(self) -> None:
        self._watchdog.begin("plant.advance")
        self.t_s = START_S + self._ticks * TICK_S
        self._node.tick(self.t_s)
        if not self._is_armed:  # the first tick compiles and loads, and the chair has no command yet
            self._armed.enter_context(self._watchdog)
            self._is_armed = True
        self._ticks += 1
        self._transport.publish(on.CLOCK, on.Clock(t_s=self.t_s))
        self._ticked_at = time.monotonic()
        self._due_at = max(self._due_at + self._period_s, self._ticked_at - TICK_S)


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
        if not isinstance(message, on.Beat) or message.node in ("plant", "recorder"):
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
