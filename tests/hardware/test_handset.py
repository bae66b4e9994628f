"""Handsets: a key that repeats is held, a key pressed once is not; buttons and sticks of a gamepad by the kernel's events."""

import os
import struct
from collections.abc import Iterator
from pathlib import Path

import pytest

from treadline.core.errors import LinkError
from treadline.core.signals import OperatorInput
from treadline.hardware import _handset
from treadline.hardware._handset import Gamepad, Keyboard
from treadline.hardware.ports import StickReading


class Clock:
    """Time of the handset in the hand of the test."""

    def __init__(self) -> None:
        self.now_s = 100.0

    def monotonic(self) -> float:
        return self.now_s


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    made = Clock()
    monkeypatch.setattr(_handset, "time", made)
    return made


@pytest.fixture
def terminal(monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """Return the end of a pipe that types; the other end counts as a terminal."""
    keys, typing = os.pipe()
    monkeypatch.setattr(os, "isatty", lambda _: True)
    keyboard.append(Keyboard(keys))
    yield typing
    for descriptor in (keys, typing):
        os.close(descriptor)
    keyboard.clear()


keyboard: list[Keyboard] = []


def state(clock: Clock, typing: int, keys: str, after_s: float) -> tuple[bool, bool, float, float]:
    """Type keys ``after_s`` later; return dead-man switch, re-arm, speed and turn, of reports that are due by then."""
    clock.now_s += after_s
    os.write(typing, keys.encode())
    keyboard[0].poll()
    clock.now_s += 0.1
    os.write(typing, keys.encode())
    reports = keyboard[0].poll()
    operator = next(report for report in reports if isinstance(report, OperatorInput))
    stick = next(report for report in reports if isinstance(report, StickReading))
    return operator.dead_man, operator.rearm, stick.speed, stick.turn


@pytest.mark.parametrize(
    ("key", "wanted"),
    [
        ("r", (True, True, 0.0, 0.0)),
        ("w", (True, True, 1.0, 0.0)),
        ("s", (True, True, -1.0, 0.0)),
        ("a", (True, True, 0.0, 1.0)),
        ("d", (True, True, 0.0, -1.0)),
        ("x", (False, False, 0.0, 0.0)),
    ],
)
def test_a_key_that_repeats_is_held(clock: Clock, terminal: int, key: str, wanted: tuple[object, ...]) -> None:
    assert state(clock, terminal, key, 1.0) == wanted


def test_a_key_that_stops_repeating_and_a_key_pressed_once_are_not_held(clock: Clock, terminal: int) -> None:
    assert state(clock, terminal, "r", 1.0)[0]
    assert not state(clock, terminal, "", 0.1)[0]
    os.write(terminal, b"r")
    assert not state(clock, terminal, "", 0.5)[0]


def test_the_terminal_stays_as_it_was(monkeypatch: pytest.MonkeyPatch) -> None:
    """The loop prints to the terminal that the keys come from, and both share its mode."""
    keys, typing = os.pipe()
    monkeypatch.setattr(os, "isatty", lambda _: True)
    Keyboard(keys).poll()
    assert os.get_blocking(keys)
    for descriptor in (keys, typing):
        os.close(descriptor)


def test_another_key_stops(clock: Clock, terminal: int) -> None:
    assert state(clock, terminal, "r", 1.0)[0]
    assert not state(clock, terminal, "q", 0.05)[0]


def test_without_a_terminal_the_keyboard_is_refused(tmp_path: Path) -> None:
    with (tmp_path / "file").open("w+") as file, pytest.raises(LinkError, match="run treadline drive in a terminal"):
        Keyboard(file.fileno())


def test_a_gamepad_is_read_by_the_kernels_events(tmp_path: Path) -> None:
    pad = tmp_path / "js0"
    # struct js_event: time [ms], value, type (1 button, 2 axis; 128 initial state), number.
    events = [(0, 1, 1, 4), (5, 1, 129, 7), (9, -32767, 2, 1), (9, 16384, 130, 0), (9, 30000, 2, 5)]
    pad.write_bytes(b"".join(struct.pack("=IhBB", *event) for event in events))
    link = Gamepad(str(pad))
    operator, stick = link.poll()
    assert isinstance(operator, OperatorInput)
    assert (operator.dead_man, operator.stop, operator.rearm) == (True, False, True)
    assert isinstance(stick, StickReading)
    assert (stick.speed, stick.turn) == (1.0, pytest.approx(-0.5, abs=1e-4))
    link.close()


def test_a_gamepad_that_is_missing_is_named(tmp_path: Path) -> None:
    with pytest.raises(LinkError, match=r"js7: No such file or directory; plug the gamepad in"):
        Gamepad(str(tmp_path / "js7"))
