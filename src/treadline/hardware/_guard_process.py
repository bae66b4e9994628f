"""The guard process: owns the links and runs the guard on the monotonic clock, whatever the loop does.

``python -m treadline.hardware._guard_process FD`` with one end of a pair of local sockets. The loop sends readings of the camera,
plans and proposals; the process sends readings of the box, the guard's commands and events, each once a tick. The loop's datagram
of each tick is its heartbeat. The process loads the guard and the links, and no numerical library.
"""

import gc
import select
import signal
import socket
import sys
import time
from dataclasses import replace
from typing import Any

from treadline.core.errors import LinkError
from treadline.core.processes import GUARD, real_time
from treadline.core.signals import TICK_S, Event, HeadingEstimate, OperatorInput, TrackCommand
from treadline.guard import SILENCE_S, Guard
from treadline.hardware._links import Links, open_links
from treadline.hardware._process_messages import received, send
from treadline.hardware.ports import DriveLimits, StickReading

CLOSING_TICKS = 5
"""Ticks for which a stop is repeated before the links are closed: a serial frame may be lost."""


class GuardProcess:
    """Guard of one chair, session after session: arming, then a drive.

    Args:
        channel: Socket to the loop.
        links: Open links.
        limits: Limits of the box; its watchdog is taken off the silence of the loop that is tolerated, so that the belts stop in
            time even if this process ends in the same instant.
    """

    def __init__(self, channel: socket.socket, links: Links, limits: DriveLimits) -> None:
        self._channel, self._links = channel, links
        self._loop_silence_s = SILENCE_S - limits.watchdog_s
        self._guard: Guard | None = None
        self._start_s = self._heard_s = time.monotonic()
        self._estimate: HeadingEstimate | None = None
        self._rearms = False
        self._ended: str | None = None
        self._notes: list[Event] = []

    def run(self) -> None:
        """Tick until the loop ends, or a tick fails, then stop the box."""
        due_s = time.monotonic()
        try:
            while self._ended is None:
                self.tick(time.monotonic())
                due_s = max(due_s + TICK_S, time.monotonic() - TICK_S)  # a tick that was missed is not made up for
                time.sleep(max(due_s - time.monotonic(), 0.0))
        finally:
            for _ in range(CLOSING_TICKS):
                self._links.stop()
                time.sleep(TICK_S)
            self._links.close()

    def tick(self, now_s: float) -> None:
        """Take what has arrived, step the guard, command the box, report."""
        t_s = now_s - self._start_s
        if self._guard is not None:
            self._guard.advance(t_s)
        self._hear(now_s)
        t_s, guard = now_s - self._start_s, self._guard
        if guard is None:
            list(self._links.poll(self._start_s))
            self._links.stop()
            send(self._channel, {"state": self._links.state, "failed": self._links.lost})
            return
        readings = self._sense(guard)
        silent_s = now_s - self._heard_s
        if silent_s > self._loop_silence_s:
            guard.hold(f"the loop stood still for {silent_s:.2f} s")
        if self._links.lost is not None:
            guard.hold(self._links.lost)
        commands = guard.step(t_s, self._estimate)
        self._estimate = None
        self._links.command(*commands, held=guard.holding is not None)
        report = {"start_s": self._start_s, "readings": readings, "commands": commands, "holding": guard.holding}
        events, self._notes = [*self._notes, *guard.take_events()], []
        send(self._channel, report | {"events": events, "state": self._links.state, "failed": self._links.lost})

    def _sense(self, guard: Guard) -> list[Any]:
        """Return the readings since the last tick, which the guard receives first; the person's re-arm reaches the box as well."""
        readings = list(self._links.poll(self._start_s))
        may_rearm = self._rearms and self._links.lost is None
        guard.advance(time.monotonic() - self._start_s)  # readings are stamped as they arrive, after the tick began
        for reading in readings:
            if isinstance(reading, StickReading):
                continue
            held = guard.holding
            is_hand = isinstance(reading, OperatorInput)
            guard.admit(replace(reading, rearm=reading.rearm and may_rearm) if is_hand else reading)
            if is_hand and held is not None and guard.holding is None:
                self._links.rearm()
        return readings

    def _hear(self, now_s: float) -> None:
        try:
            for message in received(self._channel):
                self._heard_s = now_s
                self._obey(message, now_s)
        except EOFError:
            self._ended = "the loop has ended"

    def _obey(self, message: dict[str, Any], now_s: float) -> None:
        if "session" in message:
            self._begin(now_s, **message["session"])
        self._ended = message.get("end", self._ended)
        guard = self._guard
        if guard is None:
            return
        if "hold" in message:
            guard.hold(message["hold"])
        self._estimate = message.get("estimate") or self._estimate
        for call, signal_ in message.get("calls", ()):
            waits = isinstance(signal_, TrackCommand) and self._links.is_rearming  # a command that nobody follows would be a stall
            getattr(guard, call)(TrackCommand.stop(signal_.t_s) if waits else signal_)

    def _begin(self, now_s: float, config: Any, start_s: float, note: str, cause: str, *, rearms: bool) -> None:
        """Begin a session with a new guard, which holds until a person presses re-arm anew: a button that is down counts as old."""
        self._links.stop()
        self._guard, self._start_s, self._estimate, self._rearms = Guard(config), start_s, None, rearms
        self._guard.advance(now_s - start_s)
        self._guard.hold(cause)
        self._guard.admit(OperatorInput(t_s=now_s - start_s, dead_man=False, rearm=True))
        self._notes = [Event(t_s=now_s - start_s, name="guard_process", cause=note)]


def main(descriptor: int) -> None:
    """Open the links that the first message asks for, and run until the loop ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C in the terminal reaches the loop, which ends this process in order
    channel = socket.socket(fileno=descriptor)
    select.select([channel], [], [])
    request = next(received(channel))
    with real_time(GUARD) as note:  # before the links are opened: their threads take the scheduling over
        try:
            links = Links(open_links(request["links"], request["limits"]), request["signs"])
        except LinkError as error:
            send(channel, {"failed": str(error)})
            return
        gc.collect()
        gc.freeze()
        send(channel, {"opened": note})
        GuardProcess(channel, links, request["limits"]).run()


if __name__ == "__main__":
    main(int(sys.argv[1]))
