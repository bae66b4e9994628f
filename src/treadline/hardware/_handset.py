"""Handsets: keys held down in the terminal, and a gamepad by the joystick interface of Linux.

``key, button, stick -> OperatorInput, StickReading``, ten times a second and at each change.
"""

import os
import struct
import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from treadline.core.errors import LinkError
from treadline.core.signals import OperatorInput
from treadline.guard import SILENCE_S
from treadline.hardware.device_threads import DeviceThreads, received_bytes
from treadline.hardware.ports import StickReading
from treadline.scenario.operator_actions import REPORT_S

HELD_S = 0.15
"""Time between two repeats of a key up to which it is held down [s]: terminals repeat at 10 Hz or faster."""
KEYS = {"r": (0.0, 0.0), "w": (1.0, 0.0), "s": (-1.0, 0.0), "a": (0.0, 1.0), "d": (0.0, -1.0)}
"""Keys that are held down, with their speed and turn on the bench."""
EVENT = struct.Struct("IhBB")
"""Event of the joystick interface: time [ms], value, type, number (linux/joystick.h)."""
AXIS, BUTTON = 2, 1
FULL = 32767.0
BUTTONS = {"dead_man": 4, "stop": 1, "rearm": 7, "flight_ends": 3, "go_back": 2}
"""Buttons of a gamepad in the order of the kernel's xpad driver: left shoulder, B, start, Y, X."""


class _Reports:
    """Reports at their period and at each change."""

    _last: tuple[object, ...] = ()
    _due_s = 0.0

    def of(self, t_s: float, stick: tuple[float, float], **buttons: bool) -> list[OperatorInput | StickReading]:
        """Return the reports that are due."""
        state = (stick, *buttons.items())
        if state == self._last and t_s < self._due_s:
            return []
        self._last, self._due_s = state, t_s + REPORT_S
        return [OperatorInput(t_s=t_s, **buttons), StickReading(t_s=t_s, speed=stick[0], turn=stick[1])]


class Keyboard:
    """Keys of the terminal as a dead-man switch: a held key repeats, and the chair may move while it does.

    ``r`` re-arms and drives the mission; ``w``, ``s``, ``a`` and ``d`` re-arm and drive on the bench; ``e`` is "this is the end",
    ``b`` is "go back"; every other key, and none, stops. A key re-arms after it was released for 0.75 s (``guard.stop_latch``).
    """

    def __init__(self, descriptor: int = 0) -> None:
        if not os.isatty(descriptor):
            raise LinkError("the keyboard is no terminal; run treadline drive in a terminal, or take a gamepad")
        # The terminal stays blocking: its output, to which the loop prints, shares the mode.
        self._threads: DeviceThreads[bytes, bytes] = DeviceThreads(
            partial(received_bytes, descriptor), None, lambda error: f"the terminal has gone ({error}); start again in another"
        )
        self._key, self._first_s, self._pressed_s = "", 0.0, 0.0
        self._reports = _Reports()

    def poll(self) -> Sequence[OperatorInput | StickReading]:
        """Return the reports that are due."""
        now_s = time.monotonic()
        for t_s, typed in self._threads.read():
            for key in typed.decode(errors="ignore"):
                if key != self._key or t_s - self._pressed_s > HELD_S:
                    self._first_s = t_s
                self._key, self._pressed_s = key, t_s
        # A key that was pressed once is not held: a repeat must have followed.
        held = self._key in KEYS and self._pressed_s > self._first_s and now_s - self._pressed_s <= HELD_S
        is_new = now_s - self._pressed_s <= REPORT_S
        words = {"flight_ends": is_new and self._key == "e", "go_back": is_new and self._key == "b"}
        return self._reports.of(now_s, KEYS[self._key] if held else (0.0, 0.0), dead_man=held, rearm=held, **words)

    def close(self) -> None:
        """Leave the terminal as it is: the verb that set its mode restores it."""
        self._threads.close()


class Gamepad:
    """Gamepad: left shoulder button is the dead-man switch, start re-arms, B stops, the left stick drives on the bench.

    Args:
        port: Device of the joystick interface.
    """

    def __init__(self, port: str = "/dev/input/js0") -> None:
        try:
            self._file = os.open(Path(port), os.O_RDONLY | os.O_NONBLOCK)
        except OSError as error:
            raise LinkError(f"{port}: {error.strerror}; plug the gamepad in, and let this user read it (group input)") from None
        self._port = port
        self._threads: DeviceThreads[bytes, bytes] = DeviceThreads(
            partial(received_bytes, self._file), None, lambda error: f"{port}: the gamepad has gone ({error}); plug it in"
        )
        self._down: dict[int, bool] = {}
        self._axes = {0: 0.0, 1: 0.0}
        self._reports = _Reports()

    def poll(self) -> Sequence[OperatorInput | StickReading]:
        """Return the reports that are due.

        Raises:
            LinkError: If the gamepad has gone, or its thread stands still: a button that is released would not be seen.
        """
        now_s = time.monotonic()
        data = b"".join(data for _, data in self._threads.read())
        if now_s - self._threads.awake_s > SILENCE_S:
            raise LinkError(f"{self._port} cannot be read for {now_s - self._threads.awake_s:.2f} s; plug the gamepad in anew")
        for _, value, kind, number in EVENT.iter_unpack(data):
            if kind & BUTTON:
                self._down[number] = value != 0
            elif kind & AXIS and number in self._axes:
                self._axes[number] = -value / FULL
        pressed = {name: self._down.get(number, False) for name, number in BUTTONS.items()}
        return self._reports.of(now_s, (self._axes[1], self._axes[0]), **pressed)

    def close(self) -> None:
        """Release the device."""
        self._threads.close()
        os.close(self._file)
