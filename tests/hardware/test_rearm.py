"""A box that takes its time to re-arm is no fault, and one that never does is one."""

import pytest

from treadline.core.signals import PlantState
from treadline.hardware._links import REARM_S, Links
from treadline.hardware.ports import BoxReading, DriveState

SIGNS = {"swapped": False, "left": 1, "right": 1}


class SilentBox:
    """Drives whose messages cannot be read."""

    def __init__(self) -> None:
        self.called: list[str] = []

    def poll(self) -> list[BoxReading]:
        raise ValueError("half a message")

    def stop(self) -> None:
        self.called.append("stop")

    def close(self) -> None:
        self.called.append("close")


class SlowBox:
    """Drives that report a latched stop until they are released."""

    def __init__(self) -> None:
        self.t_s, self.latched, self.error = 0.0, True, None

    def poll(self) -> list[BoxReading]:
        numbers = {"left_m_s": 0.0, "right_m_s": 0.0, "box_s": None, "voltage_v": None, "watchdog_tripped": False}
        return [DriveState(t_s=self.t_s, latched=self.latched, error=self.error, **numbers)]

    def stop(self) -> None: ...

    def rearm(self) -> None: ...


def fault_of(links: Links) -> str | None:
    return next(signal.fault for signal in links.poll(0.0) if isinstance(signal, PlantState))


def test_a_box_that_rearms_slowly_has_no_fault_meanwhile(monkeypatch: pytest.MonkeyPatch) -> None:
    clock_s = 100.0
    monkeypatch.setattr("treadline.hardware._links.time.monotonic", lambda: clock_s)
    box = SlowBox()
    links = Links({"drives": box}, SIGNS)
    box.error = "two hosts send commands to the box; stop one of them"
    assert fault_of(links) == box.error
    links.rearm()
    clock_s += 0.9 * REARM_S
    assert (fault_of(links), links.is_rearming) == (None, True)
    box.latched, box.error = False, None
    assert (fault_of(links), links.is_rearming) == (None, False)
    box.latched = True
    assert fault_of(links) == "the box latched a stop"


def test_a_box_that_does_not_rearm_is_a_fault(monkeypatch: pytest.MonkeyPatch) -> None:
    clock_s = 100.0
    monkeypatch.setattr("treadline.hardware._links.time.monotonic", lambda: clock_s)
    links = Links({"drives": SlowBox()}, SIGNS)
    links.rearm()
    clock_s += 1.1 * REARM_S
    assert fault_of(links) == "the box latched a stop"


def test_drives_that_are_lost_are_still_stopped_and_closed() -> None:
    box = SilentBox()
    links = Links({"drives": box}, SIGNS)
    assert list(links.poll(0.0)) == []
    assert links.lost == "drives: ValueError: half a message"
    links.close()
    assert box.called == ["stop", "close"]
