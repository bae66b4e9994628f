"""Command path from the mission to the actuators: delays, losses, and the actuators' watchdog.

``Command -> Command | None``. A timeout in the computer cannot act if the computer or its connection fails, so the last watchdog is
in the actuators (hazards 11 and 22). The watchdog belongs to the faulty plant only: experiments and tests without faults write once
and let time pass, and a mission writes a hundred times per second.
"""

from collections.abc import Sequence
from typing import NamedTuple

from treadline.core.signals import ROUNDING_S, FlipperCommand, SeatCommand, TrackCommand
from treadline.scenario.faults import Fault, Process, is_killed

SILENCE_S = 0.3
"""Longest time without a command before the actuators brake [s]: more than a control period of 0.25 s, and within the 0.8 s of
hazard 11 less the stopping time of the belts."""

RATE_SILENCE_S = 0.05
"""Longest time without a command before seat and flipper stop [s]: rates are commanded a hundred times per second."""


class Command(NamedTuple):
    """Commands of one write."""

    tracks: TrackCommand
    seat: SeatCommand
    flipper: FlipperCommand | None

    @classmethod
    def stop(cls, t_s: float) -> "Command":
        """Return the stop command of the watchdog."""
        return cls(TrackCommand.stop(t_s), SeatCommand(t_s=t_s, rate_m_s=0.0), None)


class CommandChannel:
    """Delay line for commands, with the delays and losses of the active faults."""

    def __init__(self, faults: Sequence[Fault]) -> None:
        self._faults = faults
        self._under_way: list[tuple[float, Command]] = []
        self._seat = SeatCommand(t_s=0.0, rate_m_s=0.0)
        self._seat_s = 0.0

    def send(self, t_s: float, command: Command) -> None:
        """Enqueue a command; it replaces queued commands with a later arrival."""
        if is_killed(self._faults, Process.MISSION, t_s):
            return
        late_s = max((fault.size for fault in self._faults if fault.kind == "late_tick" and fault.active(t_s)), default=0.0)
        due_s = t_s + late_s
        self._under_way = [(due, earlier) for due, earlier in self._under_way if due < due_s]
        self._under_way.append((due_s, command._replace(seat=self._seat_order(t_s, command.seat))))

    def arrived(self, t_s: float) -> Command | None:
        """Return the newest command that arrived since the last call, or None."""
        arrived = [command for due_s, command in self._under_way if due_s <= t_s + ROUNDING_S]
        self._under_way = self._under_way[len(arrived) :]
        return arrived[-1] if arrived else None

    def _seat_order(self, t_s: float, command: SeatCommand) -> SeatCommand:
        """Return the command for the seat actuator, whose own process may be stopped."""
        if not is_killed(self._faults, Process.SEAT, t_s):
            self._seat, self._seat_s = command, t_s
        elif t_s - self._seat_s > SILENCE_S + ROUNDING_S:
            self._seat = SeatCommand(t_s=t_s, rate_m_s=0.0)
        return self._seat


class Watchdog:
    """Watchdog of the actuators: brakes on silence or power loss, and releases after a command to stand still."""

    def __init__(self) -> None:
        self._heard_s: float | None = None
        self._last: Command | None = None
        self._latched = False

    def step(self, t_s: float, command: Command | None, *, powered: bool) -> Command | None:
        """Return the command for the actuators for a received command or None; None keeps the last one."""
        was_latched = self._latched
        silent = command is None and self._heard_s is not None and t_s - self._heard_s > SILENCE_S + ROUNDING_S
        self._latched = was_latched or silent or not powered
        if command is None:
            return Command.stop(t_s) if self._latched and not was_latched else self._stilled(t_s)
        self._heard_s, self._last = t_s, command
        if powered and command.tracks.left_m_s == 0.0 and command.tracks.right_m_s == 0.0:
            self._latched = False
        return command._replace(tracks=TrackCommand.stop(t_s)) if self._latched else command

    def _stilled(self, t_s: float) -> Command | None:
        """Return the last command with seat and flipper at rest, once, after ``RATE_SILENCE_S``; otherwise None."""
        if self._last is None or self._heard_s is None or self._latched or t_s - self._heard_s <= RATE_SILENCE_S + ROUNDING_S:
            return None
        flipper = None if self._last.flipper is None else FlipperCommand(t_s=t_s, rate_rad_s=0.0)
        stilled, self._last = self._last._replace(seat=SeatCommand(t_s=t_s, rate_m_s=0.0), flipper=flipper), None
        return stilled
