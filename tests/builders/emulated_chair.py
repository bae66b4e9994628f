"""Emulated chairs in processes of their own, and hosts that drive them through a link.

Times are those of the emulator's clock, which a busy machine slows down; ``PACE`` leaves a busy host four times the box's 0.1 s.
"""

import re
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from processes import wait_for

from treadline.hardware.ports import BoxReading, DriveLimits, DriveState

PACE = 0.25
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


class Emulator:
    """Process with an emulated chair."""

    def __init__(self, port: Path, *options: object) -> None:
        module = [sys.executable, "-m", "treadline.hardware.emulators"]
        command = [*module, *map(str, options), "--port", str(port)]
        self._process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        self.lines: list[str] = []
        self._reader = threading.Thread(target=self._read)
        self._reader.start()
        wait_for(lambda: bool(self.lines))

    @property
    def events(self) -> list[BoxEvent]:
        """Latched stops and re-arms so far."""
        found = filter(None, map(EVENT.match, self.lines))
        return [
            BoxEvent(float(t), int(axis) if axis else None, cause, int(age)) for t, axis, cause, age in (m.groups() for m in found)
        ]

    def close(self) -> None:
        """End the process."""
        self._process.kill()
        self._process.wait()
        self._reader.join()

    def _read(self) -> None:
        assert self._process.stdout is not None
        with self._process.stdout as lines:
            self.lines.extend(line.strip() for line in lines)


@contextmanager
def emulator(port: Path, *options: object) -> Iterator[Emulator]:
    """Open an emulated chair."""
    process = Emulator(port, *options)
    try:
        yield process
    finally:
        process.close()


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
