"""Handsets: a key that repeats is held, a key pressed once is not; buttons and sticks of a gamepad by the kernel's events."""

import os
import struct
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest
from processes import wait_for

from treadline.core.errors import LinkError
from treadline.core.signals import OperatorInput
from treadline.hardware import _handset, device_threads
from treadline.hardware._handset import Gamepad, Keyboard
from treadline.hardware.ports import StickReading

Typing = Callable[[str, float], tuple[bool, bool, float, float]]


@pytest.fixture
def typing(monkeypatch: pytest.MonkeyPatch) -> Iterator[Typing]:
    """Return a hand on a keyboard: keys that are typed ``after_s`` later, and their repeat, to what is reported then."""
    clock = SimpleNamespace(now_s=100.0, monotonic=lambda: clock.now_s)
    for module in (_handset, device_threads):
        monkeypatch.setattr(module, "time", clock)
    keys, end = os.pipe()
    monkeypatch.setattr(os, "isatty", lambda _: True)
    keyboard = Keyboard(keys)

    def state(typed: str, after_s: float) -> tuple[bool, bool, float, float]:
        for pause_s in (after_s, 0.1):
            clock.now_s += pause_s
            os.write(end, typed.encode())
            wait_for(lambda: keyboard._threads._arrived or not typed)
            reports = keyboard.poll()
        operator, stick = reports
        assert isinstance(operator, OperatorInput)
        assert isinstance(stick, StickReading)
        return operator.dead_man, operator.rearm, stick.speed, stick.turn

    yield state
    keyboard.close()
    assert os.get_blocking(keys)  # the loop prints to the terminal that the keys come from, and both share its mode
    for descriptor in (keys, end):
        os.close(descriptor)


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
def test_a_key_that_repeats_is_held(typing: Typing, key: str, wanted: tuple[object, ...]) -> None:
    assert typing(key, 1.0) == wanted


def test_a_key_that_stops_repeating_and_another_key_stop(typing: Typing) -> None:
    for typed, after_s in (("", 0.1), ("q", 0.05)):
        assert typing("r", 1.0)[0]
        assert not typing(typed, after_s)[0]


def test_without_a_terminal_the_keyboard_is_refused(tmp_path: Path) -> None:
    with (tmp_path / "file").open("w+") as file, pytest.raises(LinkError, match="run treadline drive in a terminal"):
        Keyboard(file.fileno())


def test_a_gamepad_is_read_by_the_kernels_events_and_a_missing_one_is_named(tmp_path: Path) -> None:
    pad = tmp_path / "js0"
    # struct js_event: time [ms], value, type (1 button, 2 axis; 128 initial state), number.
    events = [(0, 1, 1, 4), (5, 1, 129, 7), (9, -32767, 2, 1), (9, 16384, 130, 0), (9, 30000, 2, 5)]
    os.mkfifo(pad)
    link = Gamepad(str(pad))
    with pad.open("wb") as kernel:
        kernel.write(b"".join(struct.pack("=IhBB", *event) for event in events))
        kernel.flush()
        assert link.poll()  # the buttons that are up
        operator, stick = wait_for(link.poll)
    assert isinstance(operator, OperatorInput)
    assert (operator.dead_man, operator.stop, operator.rearm) == (True, False, True)
    assert isinstance(stick, StickReading)
    assert (stick.speed, stick.turn) == (1.0, pytest.approx(-0.5, abs=1e-4))
    with pytest.raises(LinkError, match=r"js0: the gamepad has gone"):
        wait_for(lambda: link.poll() and False)
    link.close()
    with pytest.raises(LinkError, match=r"js7: No such file or directory; plug the gamepad in"):
        Gamepad(str(tmp_path / "js7"))
