"""Chair behind a pseudo-terminal: the firmware's serial line as a host sees it."""

import contextlib
import os
import pty
import tty
from collections.abc import Iterator
from functools import partial
from pathlib import Path

from treadline.core.errors import LinkError
from treadline.core.signals import TICK_S
from treadline.hardware._frame import HostMessage, Kind
from treadline.hardware.device_threads import DeviceThreads, received_bytes, write_or_lose
from treadline.hardware.emulators._chair import EmulatedChair
from treadline.hardware.emulators._faults import Faults, FaultyLine, spoilt_bytes
from treadline.hardware.emulators._firmware import DriveBox, Inputs

TICK_MS = round(1000 * TICK_S)
SOUND = Inputs(dead_man=True)
"""Inputs of a box without switches at its drives."""


class Terminal:
    """Pseudo-terminal under a name that stays: a symbolic link.

    Args:
        port: Path of the link.

    Raises:
        LinkError: If the path is another file.
    """

    def __init__(self, port: Path) -> None:
        if port.exists() and not port.is_symlink():
            raise LinkError(f"{port} exists and is no port of an emulator; give another --port")
        self._near, self._far = pty.openpty()
        tty.setraw(self._far)
        os.set_blocking(self._near, False)
        self._threads: DeviceThreads[bytes, bytes] = DeviceThreads(
            partial(received_bytes, self._near), partial(write_or_lose, self._near), str
        )
        port.unlink(missing_ok=True)
        port.symlink_to(os.ttyname(self._far))
        self._rest = b""

    def read(self) -> list[bytes]:
        """Return the frames that have arrived, ending zeros included."""
        with contextlib.suppress(LinkError):
            self._rest += b"".join(data for _, data in self._threads.read())
        *frames, self._rest = self._rest.split(b"\0")
        return [frame + b"\0" for frame in frames]

    def write(self, frame: bytes) -> None:
        """Send a frame; a host that does not read loses it."""
        self._threads.write(frame)

    def close(self) -> None:
        """Remove the device: to the host it has gone."""
        self._threads.close()
        os.close(self._far)
        os.close(self._near)


class SerialBox:
    """Box with its firmware between a terminal and a chair."""

    def __init__(self, chair: EmulatedChair, faults: Faults, terminal: Terminal) -> None:
        self._chair, self._faults, self._terminal = chair, faults, terminal
        self._line = FaultyLine(faults, spoilt_bytes)
        self._start()

    def _start(self) -> None:
        """Switch the box on."""
        self._box, self._started_s = DriveBox(), self._chair.t_s

    def step(self) -> Iterator[str]:
        """Run the main loop of the box once; yield a line for each latched stop and re-arm."""
        t_s = self._chair.t_s
        if self._faults.once("brown_out", t_s):
            self._start()
        if self._faults.once("gone", t_s):
            self._terminal.close()
        now_ms = round(1000 * (t_s - self._started_s))
        for frame in self._received(t_s, now_ms):
            self._box.receive(frame)
        outputs = self._box.tick(now_ms, self._chair.inputs)
        yield from self._box.events()
        state = self._box.frame(self._chair.step(outputs))
        if not self._faults.active("unplugged", t_s):
            self._terminal.write(state)

    def _received(self, t_s: float, now_ms: int) -> Iterator[bytes]:
        """Yield the frames that reach the box."""
        yield from self._line.carry(self._terminal.read(), t_s)
        if self._faults.once("second_host", t_s):
            # The sender of another program; a link draws its own above zero.
            yield HostMessage(kind=Kind.HOLD, sender=0, sequence=0, stamp_ms=now_ms).frame()
