"""Emulated chairs in processes of their own, and hosts that drive them through a link.

Times are those of the emulator's clock, which a busy machine slows down; ``PACE`` leaves a busy host four times the box's 0.1 s.
``in_lockstep`` runs box and host in turns, so that a busy machine changes nothing.
"""

import re
import select
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from processes import Heard, wait_for

from treadline.core.signals import TICK_S
from treadline.hardware._can_link import CanSimpleLink
from treadline.hardware._serial_link import SerialLink
from treadline.hardware.emulators._can import CanAxes
from treadline.hardware.emulators._faults import Faults
from treadline.hardware.emulators._firmware import Outputs, Readings
from treadline.hardware.emulators._serial import SerialBox, Terminal
from treadline.hardware.ports import BoxReading, DriveLimits, DriveState
from treadline.scenario.chair import read_chair

PACE = 0.25
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

    @property
    def t_s(self) -> float:
        return self.ticks * TICK_S

    def step(self, outputs: Outputs) -> Readings:
        self.ticks += 1
        return Readings(belts=tuple(round(speed / 100) for speed in outputs.belts_um_s))


def in_lockstep(port: Path, faults: list[str], until_s: float, *, rearms: int = 1000) -> tuple[list[BoxEvent], list[DriveState]]:
    """Drive a box at 0.2 m/s over a serial line with faults, one command for each state; return its events and states.

    Args:
        rearms: Largest number of re-arms, each after 20 states of a latched box.
    """
    chair, given, terminal = FlatChair(), Faults(faults), Terminal(port)
    box, link = SerialBox(chair, given, terminal), SerialLink(port=str(port), limits=LIMITS)

    def states() -> list[Any]:
        if given.active("unplugged", chair.t_s - TICK_S):
            return []
        return wait_for(link.poll, pause_s=0.0)

    found = _driven(
        chair, box, link, states, lambda t_s, _: t_s >= until_s, rearms, lambda: select.select([terminal], [], [], 60.0)
    )
    terminal.close()
    return found


def axes_in_lockstep(
    port: Path, faults: list[str], until: Callable[[float, list[DriveState]], bool], *, rearms: int = 1000
) -> tuple[list[BoxEvent], list[DriveState]]:
    """Drive two axes on a bus of this process, as ``in_lockstep`` drives a box.

    Args:
        until: Ends the drive; receives the time and the states so far.
    """
    chair, bus = FlatChair(), {"interface": "virtual", "channel": str(port)}
    axes = CanAxes(chair, Faults(faults), Terminal(port), bus)
    link = CanSimpleLink(left_node=1, right_node=2, wheel_radius_m=PULLEY_M, limits=LIMITS, **bus)
    return _driven(chair, axes, link, link.poll, until, rearms, lambda: None)


def _driven(
    chair: FlatChair, box: Any, link: Any, new_states: Any, until: Any, rearms: int, on_sent: Any
) -> tuple[list[BoxEvent], list[DriveState]]:
    lines, states, stood = list[str](), list[DriveState](), 0
    try:
        while not until(chair.t_s, states):
            lines.extend(f"{chair.t_s:.2f} s: {line}" for line in box.step())
            new = new_states()
            states.extend(new)
            stood = stood + len(new) if states and states[-1].latched else 0
            if stood >= 20 and rearms > 0:
                link.rearm()
                stood, rearms = 0, rearms - 1
            if new:
                link.send(0.2, 0.2)
                on_sent()
    finally:
        link.close()
    return events_in(lines), states


@contextmanager
def emulator(port: Path, *options: object) -> Iterator[Heard]:
    """Open an emulated chair in a process of its own."""
    chair = Heard("treadline.hardware.emulators", *options, "--port", port)
    try:
        wait_for(lambda: chair.lines)
        yield chair
    finally:
        chair.end()


def drive(
    link: Any,
    until: Callable[[list[DriveState]], bool],
    *,
    rearms: bool = True,
    readings: list[BoxReading] | None = None,
) -> list[DriveState]:
    """Drive at 0.2 m/s, one command for each state, and re-arm a latched box after 20 states; return the states.

    Args:
        until: Ends the drive; sees the states so far, is called often.
        readings: Receives all readings.
    """
    states: list[DriveState] = []
    stood = 0

    def is_done() -> bool:
        nonlocal stood
        new = link.poll()
        if readings is not None:
            readings.extend(new)
        for state in filter(lambda reading: isinstance(reading, DriveState), new):
            states.append(state)
            stood = stood + 1 if state.latched else 0
            if rearms and stood == 20:
                link.rearm()
                stood = 0
            link.send(0.2, 0.2)
        return until(states)

    wait_for(is_done, within_s=120.0, pause_s=0.002)
    return states
