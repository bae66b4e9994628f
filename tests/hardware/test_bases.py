"""Bases with a time-out of their own: it is measured before they drive, and what a base does wrong is named in one line."""

import random
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from firmware_memory import HAS_COMPILER

pytest.importorskip("serial", reason="pyserial is not installed: pip install 'treadline[hardware]'")
pytest.importorskip("can", reason="python-can is not installed: pip install 'treadline[hardware]'")
if not HAS_COMPILER:
    pytest.skip("no C compiler (cc, gcc or clang) on the path", allow_module_level=True)

from emulated_chair import Rig, base_rig, vesc_rig

from treadline.core.errors import LinkError
from treadline.core.signals import TICK_S

RIGS = {"base": base_rig, "vesc": vesc_rig}
Start = Callable[..., Rig]


@pytest.fixture
def start(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Start]:
    made: list[Rig] = []

    def begin(kind: str, *faults: str, timeout_s: float = 0.3) -> Rig:
        made.append(RIGS[kind](tmp_path, monkeypatch, *faults, timeout_s=timeout_s))
        return made[-1]

    yield begin
    for rig in made:
        rig.link.close()
        rig.off()


def used(rig: Rig) -> None:
    """Stand, re-arm and drive, three times."""
    for _ in range(3):
        rig.run(1.0, 0.0, 0.0)
        rig.rearm()
        rig.run(2.0, 0.1, 0.1)


@pytest.mark.parametrize("kind", RIGS)
def test_lag_and_time_out_are_measured_before_the_first_command(kind: str, start: Start) -> None:
    """Test: a base whose belts follow at once, with a time-out of 0.4 s. Expected result: the figures, within the ticks of the
    messages; a second re-arm moves nothing."""
    rig = start(kind, timeout_s=0.4)
    rig.rearm()
    probe = rig.link.probe
    assert probe.silent_s == pytest.approx(0.4, abs=3.0 * TICK_S)
    assert (probe.lag_s, probe.zero_s) == pytest.approx((TICK_S, TICK_S), abs=2.0 * TICK_S)
    assert rig.states[-1].note == str(probe)
    rig.link.stop()
    rig.run(0.5, 0.0, 0.0)
    moved = len(rig.chair.fastest)
    rig.link.rearm()
    rig.run(0.2, 0.0, 0.0)
    assert not rig.states[-1].latched
    assert {speed for _, speed in rig.chair.fastest[moved:]} == {0.0}


@pytest.mark.parametrize("kind", RIGS)
def test_a_time_out_above_half_a_second_is_refused_with_the_figure(kind: str, start: Start) -> None:
    rig = start(kind, timeout_s=0.8)
    cause = r"the base stands 0\.8\d s after the last command, and 0\.5 s are allowed; shorten its time-out"
    with pytest.raises(LinkError, match=f"^{cause}$"):
        rig.rearm()
    assert max(speed for _, speed in rig.chair.fastest) == pytest.approx(0.05, abs=1e-3)


WRONG = {
    "unplugged@4": r"the base's odometry is silent for 0\.2\d s; is it powered\?",
    "other_frame": "the base's odometry is of frame 'base_footprint', not 'base_link'; set frame in \\[drives\\]",
    "moves": r"the base moves by itself: \+0\.20 m/s 1\.\d s after the last command; is another program driving it\?",
    "ignores_zero": r"the base ignores zero: .* m/s 1\.\d s after the last command; .*",
    "two_bases": r"two bases publish odometry \(.* and .*\); stop one, or give it a namespace",
    "jump@1": r"the base's odometry jumps by 1\.00 m in 0\.01 s; see its driver",
}


@pytest.mark.parametrize("fault", WRONG)
def test_a_base_that_is_wrong_is_refused_in_one_line(fault: str, start: Start) -> None:
    rig = start("base", fault)
    with pytest.raises(LinkError, match=f"^{WRONG[fault]}$"):
        used(rig)


def test_a_base_that_reports_nothing_gives_no_reading(start: Start) -> None:
    """Test: a base that is off. Expected result: no state, so the arming list names the drives; nothing is commanded but zero."""
    rig = start("base", "unplugged")
    assert rig.run(1.0, 0.1, 0.1) == []
    assert {speed for _, speed in rig.chair.fastest} == {0.0}


@pytest.mark.parametrize("kind", RIGS)
def test_a_line_that_breaks_stops_the_base_by_its_own_time_out(kind: str, start: Start) -> None:
    """Test: at 0.2 m/s nothing reaches the base any more. Expected result: it stands after its time-out, and the link names it."""
    rig = start(kind, "unplugged@4")
    rig.rearm()
    with pytest.raises(LinkError, match=r"^the base's odometry is silent for 0\.2\d s; is it powered\?$"):
        rig.run(5.0)
    rig.coast(0.5)
    assert [speed for t_s, speed in rig.chair.fastest if 3.0 <= t_s <= 4.0] == pytest.approx([0.2] * 101, abs=1e-3)
    assert all(speed == 0.0 for t_s, speed in rig.chair.fastest if t_s > 4.0 + 0.3 + 2.0 * TICK_S)


DRAWS = 12
"""Random faults of each base."""
CAUSES = {
    "unplugged": "silent for",
    "ignores_zero": "ignores zero",
    "moves": "moves",
    "jump": "jumps",
    "other_frame": "frame",
    "two_bases": "two bases",
    "silent": "watchdog",
}
"""Word of the cause of each fault; ``silent`` is a host without commands."""
STOPPED_S = 0.5 + 2.0 * TICK_S
"""Time in which a base stands after a fault: its own time-out at most, and the ticks of its messages."""


def trouble(rig: Rig, fault: str) -> str:
    """Drive at 0.2 m/s into a fault; return the cause that the link gives."""
    try:
        rig.rearm()
        rig.run(2.0)
        rig.run(1.5, silent=fault == "silent")
    except LinkError as error:
        rig.link.stop()
        rig.coast(1.0)
        return str(error)
    return "watchdog" if any(state.watchdog_tripped for state in rig.states) else ""


@pytest.mark.parametrize("kind", RIGS)
@pytest.mark.parametrize("seed", range(DRAWS))
def test_random_faults_stop_a_base_in_time_and_are_named(kind: str, seed: int, start: Start) -> None:
    """Test: a fault of the base, of its line or of the host, at a random time of a drive, with a random time-out below the limit.
    Expected result: the cause; a base that obeys stands within half a second, by its own time-out where nothing reaches it."""
    rng = random.Random(f"{kind} {seed}")
    fault = rng.choice([name for name in CAUSES if kind == "base" or name in ("unplugged", "silent")])
    begin_s, timeout_s = rng.uniform(2.5, 3.5), rng.uniform(0.1, 0.45)
    at = 0.0 if fault in ("ignores_zero", "moves") else begin_s  # what is found before the base is driven
    rig = start(kind, *([] if fault == "silent" else [f"{fault}@{at:.2f}"]), timeout_s=timeout_s)
    assert CAUSES[fault] in trouble(rig, fault), fault
    if fault in ("unplugged", "silent", "jump", "other_frame", "two_bases"):
        begin_s = rig.chair.t_s - 1.5 if fault == "silent" else begin_s
        assert all(speed == 0.0 for t_s, speed in rig.chair.fastest if t_s > begin_s + STOPPED_S)
