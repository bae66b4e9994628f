"""Contract of every link to drives: a box on a serial line, axes on a CAN bus, bases, and the box of the guard process's tests.

Times are those of the drives' own clock. Faults of line and box are those of the emulators.
"""

import math
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import box
import pytest

pytest.importorskip("serial", reason="pyserial is not installed: pip install 'treadline[hardware]'")
pytest.importorskip("can", reason="python-can is not installed: pip install 'treadline[hardware]'")

from emulated_chair import LIMITS, Rig, base_rig, can_rig, serial_rig, vesc_rig
from firmware_memory import HAS_COMPILER

from treadline.core.signals import TICK_S
from treadline.hardware.ports import DriveLink, DriveState

if not HAS_COMPILER:
    pytest.skip("no C compiler (cc, gcc or clang) on the path", allow_module_level=True)

FAULT_S = 2.0
"""Start of a fault: the chair is armed within a second, and drives then."""
WATCHDOG_S = 0.1
"""The longest watchdog that a box accepts, literally."""


def floor_rig(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Rig:
    chair = SimpleNamespace(t_s=0.0, fastest=[])
    monkeypatch.setattr(box, "time", SimpleNamespace(monotonic=lambda: chair.t_s))
    (folder / "faults.json").write_text("[]")
    link, new = box.FloorBox(limits=LIMITS, folder=str(folder)), list[DriveState]()

    def drives() -> list[str]:
        chair.t_s += TICK_S
        new.extend(reading for reading in link.poll() if isinstance(reading, DriveState))
        chair.fastest.append((chair.t_s, max(map(abs, link.commanded))))
        return []

    def poll() -> list[DriveState]:
        return [new.pop(0) for _ in range(len(new))]

    return Rig(chair, link, drives, poll)


@pytest.fixture(params=["serial", "can", "floor", "base", "vesc"])
def rig(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Rig]:
    clocked = {"floor": floor_rig, "base": base_rig, "vesc": vesc_rig}
    unclocked = {"serial": serial_rig, "can": can_rig}
    name = request.param
    made = unclocked[name](tmp_path) if name in unclocked else clocked[name](tmp_path, monkeypatch)
    yield made
    made.link.close()
    made.off()


def stands(states: list[DriveState]) -> bool:
    return all(state.latched and state.left_m_s == state.right_m_s == 0.0 for state in states)


def test_drives_stand_until_the_first_rearm(rig: Rig) -> None:
    assert isinstance(rig.link, DriveLink)
    states = rig.run(1.0)
    assert states
    assert stands(states)


def test_a_speed_is_read_back_as_commanded(rig: Rig) -> None:
    rig.rearm()
    last = rig.run(2.0, 0.2, -0.1)[-1]
    # A box reports whole units of 0.1 mm/s; the belts of the floor's box lag by 0.15 s.
    assert (last.left_m_s, last.right_m_s) == pytest.approx((0.2, -0.1), abs=2e-4)
    assert not last.latched


def test_no_command_makes_a_belt_faster_than_the_limit(rig: Rig) -> None:
    """Test: 9 m/s, which one box caps and another rejects. Expected result: 1 m/s at most."""
    rig.rearm()
    rig.run(2.0, 9.0, 9.0)
    assert max(speed_m_s for _, speed_m_s in rig.chair.fastest) <= LIMITS.speed_m_s


def test_without_commands_the_drives_stop_within_the_watchdog_and_stand_until_rearmed(rig: Rig) -> None:
    rig.rearm()
    rig.run(1.0)
    silent_s = rig.chair.t_s
    rig.run(1.0, silent=True)
    stopped_s = next(t_s for t_s, speed_m_s in rig.chair.fastest if t_s > silent_s and speed_m_s == 0.0)
    assert stopped_s - silent_s <= WATCHDOG_S + TICK_S
    assert rig.states[-1].watchdog_tripped
    rig.run(2.0)  # the belts of the floor's box come to rest
    assert rig.states[-1].latched
    assert rig.chair.fastest[-1][1] == 0.0
    rig.rearm()
    assert rig.run(1.0)[-1].left_m_s == pytest.approx(0.2, abs=1e-3)


@pytest.mark.parametrize("stop", [lambda link: link.stop(), lambda link: link.send(math.nan, 0.1)], ids=["stop", "not a number"])
def test_a_stop_and_a_speed_that_is_none_latch_at_once(rig: Rig, stop: Callable[[Any], None]) -> None:
    rig.rearm()
    rig.run(1.0)
    stop(rig.link)
    stopped_s = rig.chair.t_s
    rig.run(2.0)
    assert all(speed_m_s == 0.0 for t_s, speed_m_s in rig.chair.fastest if t_s > stopped_s + 2.0 * TICK_S)
    assert rig.states[-1].latched


def test_a_hold_stands_and_the_next_command_drives(rig: Rig) -> None:
    rig.rearm()
    rig.run(1.0)
    for _ in range(200):  # repeated as commands are
        rig.run(TICK_S, silent=True)
        rig.link.hold()
    assert rig.states[-1].left_m_s == pytest.approx(0.0, abs=1e-3)
    assert not rig.states[-1].latched
    assert rig.run(1.0)[-1].left_m_s == pytest.approx(0.2, abs=1e-3)


def test_a_closed_link_leaves_drives_that_stand(rig: Rig) -> None:
    rig.rearm()
    rig.run(1.0)
    rig.link.close()
    rig.link.close()
    rig.coast(2.0 * TICK_S)
    assert rig.chair.fastest[-1][1] == 0.0


EMULATED = {"serial": serial_rig, "can": can_rig}
STOPPING = [
    ("serial", "unplugged=0.3", None),
    ("serial", "stuck=0.3", None),
    ("serial", "second_host", "two hosts send commands to the box; stop one of them"),
    ("serial", "brown_out", "the box has started anew; check its supply"),
    ("serial", "late=0.15", None),
    ("serial", "late=0.3", None),
    ("can", "unplugged=0.3", None),
    ("can", "second_host", "two hosts send commands to drive 1; stop one of them"),
    ("can", "brown_out", "drive 1 left closed-loop control; check its supply and errors (odrivetool)"),
    ("can", "late=0.15", None),
]


@pytest.mark.parametrize(("link", "fault", "error"), STOPPING, ids=[f"{link} {fault}" for link, fault, _ in STOPPING])
def test_a_fault_of_line_or_box_stops_the_belts_in_time_and_is_named(
    tmp_path: Path, link: str, fault: str, error: str | None
) -> None:
    """Test: a fault at 0.2 m/s, for 0.3 s or for good. Expected result: the drives stop 0.1 s later at the latest, both belts, and
    stand without a re-arm; a fault that has a cause of its own is named, any other is the watchdog's."""
    kind, _, value = fault.partition("=")
    rig = EMULATED[link](tmp_path, f"{kind}@{FAULT_S}" + (f"={value}" if value else ""))
    rig.rearm()
    rig.run(4.0)
    rig.link.close()
    driven = [speed_m_s for t_s, speed_m_s in rig.chair.fastest if 1.5 <= t_s <= FAULT_S]
    assert driven == pytest.approx([0.2] * len(driven))
    # The tick of the fault, the watchdog, and the tick at which the other axis follows.
    assert all(speed_m_s == 0.0 for t_s, speed_m_s in rig.chair.fastest if t_s > FAULT_S + WATCHDOG_S + 2.0 * TICK_S)
    assert rig.states[-1].latched
    assert any(event.t_s >= FAULT_S and event.cause != "ARMED" and event.age_ms <= 1000 * WATCHDOG_S for event in rig.events)
    named = [state for state in rig.states if (state.error == error if error else state.watchdog_tripped)]
    assert named


@pytest.mark.parametrize("link", EMULATED)
def test_a_line_that_is_a_little_bad_stops_nothing(tmp_path: Path, link: str) -> None:
    """Test: half a frame, a flipped bit, frames that overtake one another, and 50 ms of delay."""
    rig = EMULATED[link](tmp_path, "half@2", "flipped@2.5", "swapped_frames@3=1", "late@4.5=0.05")
    rig.rearm()
    assert not any(state.latched for state in rig.run(6.0))
    assert rig.states[-1].left_m_s == pytest.approx(0.2)
    rig.link.close()


def test_a_rearm_that_is_late_rearms_nothing(tmp_path: Path) -> None:
    rig = serial_rig(tmp_path, "late@0=0.15")
    rig.rearm()
    assert stands(rig.run(1.0))
    rig.link.close()


def test_a_belt_that_turns_in_a_hold_loses_its_power_and_a_rearm_gives_it_back(tmp_path: Path) -> None:
    """Test: a held belt slips at 0.06 m/s while it has power. Expected result: the contactor opens 0.2 s later, and says why."""
    rig = serial_rig(tmp_path)
    rig.rearm()
    for rig.chair.runs_away_m_s in (0.0, 0.06):
        for _ in range(50):
            rig.run(TICK_S, silent=True)
            rig.link.hold()
    turned = [state for state in rig.states if state.left_m_s == pytest.approx(0.06)]
    assert turned[-1].box_s - turned[0].box_s == pytest.approx(0.2)
    assert str(rig.states[-1].error).startswith("a belt turned although the box stood")
    rig.chair.runs_away_m_s = 0.0
    rig.rearm()
    assert rig.run(1.0)[-1].left_m_s == pytest.approx(0.2)
    rig.link.close()
