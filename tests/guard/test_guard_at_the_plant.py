"""The guard at the actuators: which commands reach the drives, and when it brakes by itself (GUARD §1, holes 3, 12 and 14)."""

import math
from dataclasses import replace

import pytest
from drive import Drive, spoils
from world import limits

from treadline.core.signals import FlipperCommand, OperatorInput, SeatCommand, TrackCommand
from treadline.guard import LastGuard

SILENT_S = 0.3
"""Stated time without a command after which the plant brakes [s] (GUARD §2, rule 6)."""
BELTS = TrackCommand(t_s=1.0, left_m_s=0.1, right_m_s=0.2, sender="guard-1")
SEAT = SeatCommand(t_s=1.0, rate_m_s=0.05, sender="guard-1")
FLIPPER = FlipperCommand(t_s=1.0, rate_rad_s=-0.5, sender="guard-1")
VALUES = {TrackCommand: "right_m_s", SeatCommand: "rate_m_s", FlipperCommand: "rate_rad_s"}


def at(t_s: float) -> LastGuard:
    """Return a last guard of the paper's chair: belts 1 m/s, seat 0.06 m/s, flipper 30 °/s."""
    last = LastGuard(limits(belt_limit_m_s=1.0, seat_rate_m_s=0.06, flipper_rate_rad_s=math.radians(30.0)))
    last.advance(t_s)
    return last


@pytest.mark.parametrize("command", [BELTS, SEAT, FLIPPER], ids=lambda command: type(command).__name__)
@pytest.mark.parametrize("value", [math.nan, math.inf, -1e6, 1e6])
def test_no_value_beyond_the_chair_passes(command: TrackCommand | SeatCommand | FlipperCommand, value: float) -> None:
    last = at(1.0)
    assert not last.accept(replace(command, **{VALUES[type(command)]: value}))
    assert last.accept(replace(command, t_s=1.01))
    assert last.rejected == {type(command).__name__: 1}


@pytest.mark.parametrize("command", [BELTS, SEAT, FLIPPER], ids=lambda command: type(command).__name__)
@pytest.mark.parametrize("t_s", [math.nan, 1e6, -1e6, 1.2, 0.6, 0.99])
def test_no_stamp_that_is_not_fresh_passes(command: TrackCommand | SeatCommand | FlipperCommand, t_s: float) -> None:
    """Test: after a command stamped 1.00 s, stamps that are no number, ahead, old, or older than the one before. Expected result:
    rejected, and the next sound one is accepted; belts under way brake for a stamp that leapt by more than 1 s."""
    last = at(1.0)
    assert last.accept(command)
    assert not last.accept(replace(command, t_s=t_s))
    leapt = abs(t_s - 1.0) > 1.0
    assert (last.fault is not None) == (leapt and command is BELTS)
    assert last.accept(command) == (leapt and t_s < 0.0)  # later stamps are compared with the new one
    assert last.accept(replace(command, t_s=1.01))


@pytest.mark.parametrize("ahead_s", [0.0, 0.1])
def test_silence_brakes_until_a_person_re_arms_and_is_named(ahead_s: float) -> None:
    last = at(1.0)
    assert last.accept(replace(BELTS, t_s=1.0 + ahead_s))
    last.advance(1.0 + SILENT_S)
    assert last.fault is None
    assert not last.is_braking
    last.advance(1.01 + SILENT_S)
    assert last.fault == "no command for 0.31 s"
    assert last.accept(replace(BELTS, t_s=1.31))
    assert last.commands()[0].brake
    for k, pressed in enumerate(({"stop": True}, {}, {"dead_man": False}, {})):
        last.operate(OperatorInput(t_s=1.32 + 0.01 * k, rearm=bool(pressed), **pressed))
        assert last.fault is not None
    last.advance(2.4)
    last.operate(OperatorInput(t_s=2.4, rearm=True))
    assert last.fault is None
    assert last.commands()[0].brake  # until the guard speaks again
    assert not last.accept(replace(BELTS, t_s=2.39))
    assert last.accept(replace(BELTS, t_s=2.41))
    assert not last.accept(replace(BELTS, t_s=2.39, sender="guard-2"))
    assert last.commands()[0] == replace(BELTS, t_s=2.41)


def test_a_press_counts_with_a_fresh_stamp_alone_and_once() -> None:
    last = at(99.0)
    last.trip("first")
    last.advance(100.0)
    for stamp_s in (math.nan, 2.0, 100.2):
        last.operate(OperatorInput(t_s=stamp_s, rearm=True))
        assert last.fault == "first"
    messages = OperatorInput(t_s=99.99), OperatorInput(t_s=100.0, rearm=True)
    for fault in (None, "second"):
        for message in messages:
            last.operate(message)
        assert last.fault == fault
        last.trip("second")


@pytest.mark.parametrize("first", ["", "guard-1"])
def test_a_guard_may_be_replaced_before_the_chair_drove_and_after_a_silence(first: str) -> None:
    last = at(1.0)
    assert last.accept(replace(BELTS, brake=True, sender=first))
    last.advance(1.01 + SILENT_S)
    assert last.accept(replace(BELTS, t_s=1.31, sender="guard-2"))
    assert last.fault is None
    assert not last.accept(replace(BELTS, t_s=1.31, sender=first))
    assert last.fault == f"two guards send commands, guard-2 and {first}; stop one of them"


def test_the_cause_names_the_commands_that_were_rejected_meanwhile() -> None:
    last = at(1.0)
    assert last.accept(BELTS)
    for tick in range(1, 32):
        last.advance(1.0 + 0.01 * tick)
        last.accept(replace(BELTS, t_s=1.0 + 0.01 * tick, left_m_s=7.0))
    said = "no command for 0.31 s; TrackCommand asks for 7, beyond the chair's limit of 1"
    assert last.fault == said


def test_a_second_guard_brakes_the_belts_and_both_are_named() -> None:
    last = at(1.0)
    assert last.accept(BELTS)
    assert not last.accept(replace(SEAT, sender="guard-2"))
    assert last.fault == "two guards send commands, guard-1 and guard-2; stop one of them"
    assert last.accept(replace(BELTS, t_s=1.01))
    assert last.commands()[0].brake


def test_a_chair_that_was_never_driven_has_no_fault() -> None:
    last = at(5.0)
    assert last.fault is None
    assert last.is_braking
    assert last.commands() == (TrackCommand.stop(5.0), SeatCommand(t_s=5.0, rate_m_s=0.0), None)
    assert LastGuard(limits()).commands()[0] == TrackCommand.stop(0.0)
    assert last.accept(TrackCommand.stop(5.0))
    last.advance(9.0)
    assert last.fault is None


def test_rates_of_seat_and_flipper_end_with_their_validity() -> None:
    """Test: rates stamped 1.00 s, and belts that go on. Expected result: the rates act for 0.1 s."""
    last = at(1.0)
    for command in (SEAT, FLIPPER, BELTS):
        assert last.accept(command)
    assert last.commands() == (BELTS, SEAT, FLIPPER)
    for tick in range(1, 13):
        last.advance(1.0 + 0.01 * tick)
        assert last.accept(replace(BELTS, t_s=1.0 + 0.01 * tick))
        _, seat, flipper = last.commands()
        assert (seat.rate_m_s, flipper) == ((SEAT.rate_m_s, FLIPPER) if tick <= 10 else (0.0, None))


def test_the_guard_holds_for_what_the_plant_says_and_after_a_re_arm_only_if_it_lasts() -> None:
    """Test: the plant reports its brake, a person re-arms, and a report under way arrives. Expected result: HOLD with the plant's
    reason; the late report is ignored for 0.125 s, a lasting one holds again. A recording's plant is not held."""
    fault = spoils("plant", fault="no command for 0.31 s")
    drive, recorded = Drive(ahead_s=0.125), Drive(watches_motion=False)
    for driven in (drive, recorded):
        driven.run(1.0)
        driven.spoil = fault
        driven.run(0.02)
    assert drive.guard.holding == "the plant braked by itself: no command for 0.31 s"
    assert recorded.guard.holding is None
    drive.heal()
    drive.run(1.0).press(rearm=True)
    drive.spoil = fault
    assert drive.run(0.12).guard.holding is None
    assert drive.run(0.03).guard.holding is not None
