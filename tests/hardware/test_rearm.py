"""A box that takes its time to re-arm is no fault, and one that never does is one."""

from types import SimpleNamespace
from typing import Any

import pytest

from treadline.core.signals import PlantState
from treadline.hardware import _links
from treadline.hardware._links import REARM_S, Links
from treadline.hardware.ports import DriveState

STATE = {"left_m_s": 0.0, "right_m_s": 0.0, "box_s": None, "voltage_v": None, "watchdog_tripped": False}


class Box:
    """Drives that report what the test says; with ``latched`` None their messages cannot be read."""

    def __init__(self, *, latched: bool | None) -> None:
        self.latched, self.error, self.called = latched, None, list[str]()

    def __getattr__(self, name: str) -> Any:
        return lambda: self.called.append(name)

    def poll(self) -> list[DriveState]:
        if self.latched is None:
            raise ValueError("half a message")
        return [DriveState(t_s=0.0, latched=self.latched, error=self.error, **STATE)]


def links_of(box: Box) -> Links:
    return Links({"drives": box}, {"swapped": False, "left": 1, "right": 1})


def fault_of(links: Links) -> str | None:
    return next(signal.fault for signal in links.poll(0.0) if isinstance(signal, PlantState))


def test_a_box_that_rearms_slowly_has_no_fault_meanwhile_and_one_that_does_not_is_one(monkeypatch: pytest.MonkeyPatch) -> None:
    now = SimpleNamespace(s=100.0)
    monkeypatch.setattr(_links, "time", SimpleNamespace(monotonic=lambda: now.s))
    box = Box(latched=True)
    links = links_of(box)
    box.error = "two hosts send commands to the box; stop one of them"
    assert fault_of(links) == box.error
    links.rearm()
    now.s += 0.9 * REARM_S
    assert (fault_of(links), links.is_rearming) == (None, True)
    box.error = None
    now.s += 0.2 * REARM_S
    assert fault_of(links) == "the box latched a stop"
    box.latched = False
    assert (fault_of(links), links.is_rearming) == (None, False)
    box.latched = True
    assert fault_of(links) == "the box latched a stop"


def test_drives_that_are_lost_are_still_stopped_and_closed() -> None:
    box = Box(latched=None)
    links = links_of(box)
    assert list(links.poll(0.0)) == []
    assert links.lost == "drives: ValueError: half a message"
    links.close()
    assert box.called == ["stop", "close"]
