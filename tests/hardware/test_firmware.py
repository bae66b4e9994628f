"""The firmware in C: its frames against literals, its rules against a twin that was written a second time."""

import shutil
import subprocess
from pathlib import Path

import pytest
from firmware_memory import HAS_COMPILER, first_difference, memory_of
from hypothesis import given
from hypothesis import strategies as st

from treadline.core.signals import OperatorInput
from treadline.guard.stop_latch import Rearm
from treadline.hardware._frame import (
    Cause,
    FrameReader,
    HostMessage,
    Kind,
    Present,
    Reply,
    content_of,
    frame_of,
    state_of,
)
from treadline.hardware.emulators._firmware import SOURCES, DriveBox, Inputs, Readings

compiled = pytest.mark.skipif(not HAS_COMPILER, reason="no C compiler (cc, gcc or clang) on the path")
HELD = Inputs(dead_man=True)
LIMITS = (10000, 4000, 1000, 100, 600, 500)


def message(kind: Kind, values: tuple[int, ...] = (0,) * 6, **given: int) -> HostMessage:
    return HostMessage(**{"sender": 7, "sequence": 1, "stamp_ms": 0, "latch": 1, **given}, kind=kind, values=values)


@given(st.binary(min_size=1, max_size=90))
def test_a_frame_holds_one_zero_at_its_end_and_gives_its_content_back(content: bytes) -> None:
    frame = frame_of(content)
    assert frame.index(0) == len(frame) - 1
    assert content_of(frame[:-1]) == content


@given(st.sets(st.integers(0, 30 * 8 - 1), min_size=1, max_size=3))
def test_up_to_three_flipped_bits_are_found(flipped: set[int]) -> None:
    """CRC-32 of IEEE 802.3 has Hamming distance 5 and more at this length."""
    sound = message(Kind.DRIVE, (2000, 2000, 0, 0, 0, 0))
    frame = bytearray(sound.frame())
    for bit in flipped:
        frame[bit // 8] ^= 1 << bit % 8
    assert all(content == content_of(sound.frame()[:-1]) for content in FrameReader().feed(bytes(frame)))


def test_a_half_frame_costs_no_other_frame() -> None:
    reader, sound = FrameReader(), frame_of(b"sound")
    assert list(reader.feed(sound + sound[:4] + b"\0" + sound)) == [b"sound", b"sound"]
    assert reader.broken == 1
    assert [*reader.feed(b"\x55" * 100_000), *reader.feed(b"\0" + sound)] == [b"sound"]


@compiled
def test_the_self_test_passes_under_the_sanitisers_and_takes_each_branch(tmp_path: Path) -> None:
    if shutil.which("make") is None or shutil.which("gcov") is None:
        pytest.skip("no make or no gcov on the path")
    done = subprocess.run(["make", "-C", SOURCES, "test", f"BUILD={tmp_path}"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.count(": 100.00 %") == 4


@compiled
@pytest.mark.parametrize("seed", range(4))
def test_firmware_and_twin_agree_on_random_traffic(seed: int) -> None:
    """``benchmarks/firmware_fuzz.py`` does the same on 10⁷ ticks."""
    assert first_difference(seed, 25_000) is None


def test_the_theorems_on_the_rules_hold() -> None:
    """docs/reference/firmware.md lists them with their assumptions."""
    pytest.importorskip("z3", reason="z3-solver is not installed")
    from firmware_proof import theorems, verdict

    proved = {name: verdict(assumption, claim) for name, assumption, claim in theorems()}
    assert len(proved) == 20
    assert set(proved.values()) == {("proved", "")}


@compiled
def test_the_state_says_what_the_rules_hold_and_what_was_measured() -> None:
    box = DriveBox()
    for now_ms in range(0, 600, 100):  # a stop of 0.5 s is old enough for a re-arm
        box.tick(now_ms, HELD)
    box.receive(message(Kind.LIMITS, LIMITS, stamp_ms=500).frame() + message(Kind.REARM, stamp_ms=500).frame())
    drive = message(Kind.DRIVE, (2000, -2000, 600, -500, 0, 0), sequence=2, stamp_ms=500)
    box.receive(drive.frame() + b"\x03\x07\x00")
    box.tick(510, Inputs(dead_man=True, belts=(-5, 6)))
    readings = Readings(present=Present.IMU | Present.VOLTAGE, voltage_mv=26_600, orientation=(16384, 0, 0, -1))
    content = content_of(box.frame(readings)[:-1])
    assert content is not None
    state = state_of(content)
    assert state is not None
    assert (state.now_ms, state.latch, state.cause, state.sender, state.heard_ms) == (510, 1, Cause.ARMED, 7, 500)
    assert (state.set_points_um_s, state.limits) == ((40_000, -40_000), LIMITS)  # 4 m/s² in 10 ms
    assert (state.reply, state.rejections) == (Reply.BROKEN, 1)
    assert (state.present, state.belts, state.voltage_mv) == (Present.IMU | Present.VOLTAGE, (-5, 6), 26_600)
    assert state.orientation == (16384, 0, 0, -1)


@compiled
@given(st.lists(st.tuples(st.integers(-700, 700), st.integers(1, 40), st.integers(1, 90)), max_size=20))
def test_the_contactor_opens_where_a_belt_turns_for_a_fifth_of_a_second_although_the_box_stands(
    spells: list[tuple[int, int, int]],
) -> None:
    """Test: either belt at speeds around 0.05 m/s, in spells of any length and period of the tick. Expected: open from then on."""
    box, now_ms, is_open, since_ms = DriveBox(), 0, False, None
    for speed, ticks, period_ms in spells:
        for number in range(ticks):
            now_ms += period_ms
            outputs = box.tick(now_ms, Inputs(dead_man=True, belts=(speed, 0) if number % 2 else (0, speed)))
            since_ms = (now_ms if since_ms is None else since_ms) if abs(speed) > 500 else None
            is_open |= since_ms is not None and now_ms - since_ms >= 200
            assert outputs.contactor is not is_open
            assert outputs.brake


@compiled
@given(st.lists(st.tuples(st.booleans(), st.booleans(), st.integers(1, 12)), max_size=20))
def test_a_press_at_the_box_is_an_act_where_it_is_one_for_the_guard(spells: list[tuple[bool, bool, int]]) -> None:
    """Test: dead-man switch and re-arm button in spells of 0.1 to 1.2 s. Expected: box and guard count the same presses."""
    box, button, now_ms = DriveBox(), Rearm(), 0
    for dead_man, rearm, tenths in spells:
        for _ in range(tenths):
            now_ms += 100
            box.tick(now_ms, Inputs(dead_man=dead_man, handset=True, rearm=rearm))
            is_act = button.press(OperatorInput(t_s=now_ms / 1000, dead_man=dead_man, rearm=rearm), 0.0)
            assert (memory_of(box)["pressed"] == 0) is is_act


@compiled
def test_bytes_of_any_kind_move_nothing() -> None:
    box = DriveBox()

    @given(st.binary(max_size=300))
    def feed(received: bytes) -> None:
        box.receive(received)
        outputs = box.tick(0, HELD)
        assert outputs.brake
        assert tuple(outputs.belts_um_s) == (0, 0)

    feed()
    assert memory_of(box)["cause"] == Cause.START
