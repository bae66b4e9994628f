"""Emulated drives, and hosts that drive them through a link.

Times are those of the emulator's clock. A ``Rig`` runs drives and host in turns, so that a busy machine changes nothing.
"""

import re
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import patch

from processes import wait_for

from treadline.core.signals import TICK_S
from treadline.hardware import _base_link, _can_link
from treadline.hardware._base_link import BaseLink
from treadline.hardware._can_link import CanSimpleLink
from treadline.hardware._links import REARM_S
from treadline.hardware._serial_link import SerialLink
from treadline.hardware.emulators import _base
from treadline.hardware.emulators._base import GEAR_RATIO, POLE_PAIRS, DatagramBase, VescDrives
from treadline.hardware.emulators._can import CanAxes
from treadline.hardware.emulators._faults import Faults
from treadline.hardware.emulators._firmware import Inputs, Outputs, Readings
from treadline.hardware.emulators._serial import SerialBox, Terminal
from treadline.hardware.ports import DriveLimits, DriveState
from treadline.scenario.chair import read_chair

PULLEY_M = 0.07
LIMITS = DriveLimits(speed_m_s=1.0, acceleration_m_s2=4.0, watchdog_s=0.1, seat_m_s=0.06, flipper_rad_s=0.5)
EVENT = re.compile(r"([\d.]+) s: (?:axis (\d) )?(\w+), newest command (-?\d+) ms old")


@dataclass(frozen=True)
class BoxEvent:
    """Latched stop or re-arm of a box or an axis."""

    t_s: float
    axis: int | None
    cause: str
    age_ms: int
    """Age of the newest accepted command."""


def events_in(lines: list[str]) -> list[BoxEvent]:
    """Return the events that an emulator's lines report."""
    found = [match.groups() for match in map(EVENT.match, lines) if match]
    return [BoxEvent(float(t_s), int(axis) if axis else None, cause, int(age)) for t_s, axis, cause, age in found]


class FlatChair:
    """Chair whose belts follow their set points at once."""

    chair = read_chair("wheelchair")

    def __init__(self) -> None:
        self.ticks = 0
        self.fastest: list[tuple[float, float]] = []
        """Time, and the larger speed of both belts [m/s]."""
        self.inputs = Inputs(dead_man=True)
        self.runs_away_m_s = 0.0
        """Speed that a belt has in addition to its set point."""

    @property
    def t_s(self) -> float:
        return self.ticks * TICK_S

    def step(self, outputs: Outputs) -> Readings:
        self.ticks += 1
        self.fastest.append((self.t_s, max(map(abs, outputs.belts_um_s)) * 1e-6))
        away_um_s = 1e6 * self.runs_away_m_s * outputs.contactor
        self.inputs.belts[:] = [round((speed + away_um_s) / 100) for speed in outputs.belts_um_s]
        return Readings()


class Rig:
    """Link and drives, run in turns on the drives' clock, so that a busy machine changes nothing.

    Args:
        chair: Chair whose time advances at each step of the drives.
        drives: Runs the drives for a tick; returns their lines.
        poll: Returns the new states.
        on_sent: Waits until what the link sent can be read.
    """

    def __init__(self, chair: Any, link: Any, drives: Any, poll: Any, on_sent: Callable[[], object] = lambda: None) -> None:
        self.chair, self.link, self._drives, self._poll, self._on_sent = chair, link, drives, poll, on_sent
        self.off: Callable[[], object] = lambda: None
        """Releases what the drives hold."""
        self.states: list[DriveState] = []
        self.events: list[BoxEvent] = []

    def run(self, for_s: float, left_m_s: float = 0.2, right_m_s: float = 0.2, *, silent: bool = False) -> list[DriveState]:
        """Send speeds, one command for each state, or nothing; return the states."""
        first = len(self.states)
        for _ in range(round(for_s / TICK_S)):
            self.coast(TICK_S)
            new = self._poll()
            self.states += new
            if new and not silent:
                self.link.send(left_m_s, right_m_s)
                self._on_sent()
        return self.states[first:]

    def coast(self, for_s: float) -> None:
        """Run the drives alone."""
        for _ in range(round(for_s / TICK_S)):
            self.events += events_in([f"{self.chair.t_s:.2f} s: {line}" for line in self._drives()])

    def rearm(self) -> None:
        """Re-arm a stop that is old enough, and stand for the rest of a second; a base is measured meanwhile."""
        self.run(0.6, 0.0, 0.0)
        self.link.rearm()
        until_s = self.chair.t_s + REARM_S
        self.run(0.4, 0.0, 0.0)
        while isinstance(self.link, BaseLink) and self.states[-1].latched and self.chair.t_s < until_s:
            self.run(TICK_S, 0.0, 0.0)


class Unthreaded:
    """``DeviceThreads`` whose calls reach the bus at once: a bus of this process makes nobody wait."""

    def __init__(self, receive: Any, transmit: Any, gone: Any) -> None:
        del gone
        self._receive, self.write = receive, transmit

    def read(self) -> list[tuple[float, Any]]:
        return [(time.monotonic(), item) for item in iter(lambda: self._receive(0.0), None)]

    def close(self) -> None:
        pass


def unthreaded() -> Any:
    """Return a context in which links to a CAN bus have no threads, so that drives and host run in turns."""
    return patch.object(_can_link, "DeviceThreads", Unthreaded)


def serial_rig(folder: Path, *faults: str) -> Rig:
    """Return a box on a serial line."""
    chair, given, terminal = FlatChair(), Faults(faults), Terminal(folder / "box")
    box, link = SerialBox(chair, given, terminal), SerialLink(port=str(folder / "box"), limits=LIMITS)

    def poll() -> Any:
        return [] if given.active("unplugged", chair.t_s - TICK_S) else wait_for(link.poll, pause_s=0.0)

    return Rig(chair, link, lambda: list(box.step()), poll, lambda: wait_for(lambda: terminal._threads._arrived))


def can_rig(folder: Path, *faults: str) -> Rig:
    """Return two axes on a bus of this process."""
    chair, bus = FlatChair(), {"interface": "virtual", "channel": str(folder)}
    axes = CanAxes(chair, Faults(faults), Terminal(folder / "sensors"), bus)
    with unthreaded():
        link = CanSimpleLink(left_node=1, right_node=2, wheel_radius_m=PULLEY_M, limits=LIMITS, **bus)
    return Rig(chair, link, lambda: list(axes.step()), link.poll)


def base_rig(folder: Path, patch_: Any, *faults: str, timeout_s: float = 0.3) -> Rig:
    """Return a base with odometry, and a host on the base's clock."""
    chair = FlatChair()
    clock = SimpleNamespace(monotonic=lambda: chair.t_s)
    for module in (_base_link, _base):
        patch_.setattr(module, "time", clock)
    emulated = DatagramBase(chair, Faults(faults), Terminal(folder / "sensors"), {"port": 0})
    emulated._timeout_s = timeout_s
    port = emulated._end._socket.getsockname()[1]
    link = BaseLink(limits=LIMITS, wire="treadline.hardware.emulators._base:DatagramWire", port=port)
    rig = Rig(chair, link, lambda: list(emulated.step()), link.poll)
    rig.off = emulated._end.close
    return rig


def vesc_rig(folder: Path, patch_: Any, *faults: str, timeout_s: float = 0.3) -> Rig:
    """Return two VESC drives on a bus of this process, and a host on their clock."""
    chair, bus = FlatChair(), {"interface": "virtual", "channel": str(folder)}
    patch_.setattr(_base_link, "time", SimpleNamespace(monotonic=lambda: chair.t_s))

    class OnTheClock(Unthreaded):
        def read(self) -> list[tuple[float, Any]]:
            return [(chair.t_s, item) for _, item in super().read()]

    patch_.setattr(_can_link, "DeviceThreads", OnTheClock)
    drives = VescDrives(chair, Faults(faults), Terminal(folder / "sensors"), bus)
    drives._timeout_s = timeout_s
    motors = {"left_id": 1, "right_id": 2, "wheel_radius_m": PULLEY_M, "pole_pairs": POLE_PAIRS, "gear_ratio": GEAR_RATIO}
    link = BaseLink(limits=LIMITS, wire="treadline.hardware._vesc_wire:VescWire", **motors, **bus)
    return Rig(chair, link, lambda: list(drives.step()), link.poll)
