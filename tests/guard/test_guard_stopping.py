"""How a held chair stops: at once for urgent causes, along a half-cosine for all others."""

import math
from bisect import bisect

import numpy as np
import pytest
from world import TICK_S, belts, limits

from treadline.core.signals import MotionPlan, OperatorInput, TrackCommand
from treadline.guard import Guard
from treadline.guard._half_cosine_stop import RampedStop, Stop
from treadline.guard.stop_latch import Latch, Rearm

# Literals, so that a changed value in the code is detected here.
RAMP_S = 0.3
STANDING_M_S = 0.03

LAG_S = 0.15


def held(kind: Stop, speed_m_s: float = 0.2) -> tuple[Latch, TrackCommand]:
    """Return a latch held for a cause at 1.0 s, and its first command."""
    latch = Latch(limits())
    latch.hold(1.0, kind, kind.value)
    return latch, latch.stop(1.0, (speed_m_s, speed_m_s))


@pytest.mark.parametrize("kind", Stop)
def test_an_urgent_cause_brakes_within_its_tick_and_no_other_does(kind: Stop) -> None:
    _, command = held(kind)
    assert (command == TrackCommand.stop(1.0)) is (kind is Stop.BRAKE)
    assert command.brake is (kind is Stop.BRAKE)


@pytest.mark.parametrize("from_m_s", [(0.2, 0.2), (0.15, 0.25), (-0.1, -0.2)])
def test_belts_with_their_lag_follow_the_half_cosine_until_it_is_nearly_over(from_m_s: tuple[float, float]) -> None:
    """Test: belts with a first-order lag of 0.15 s. Expected result: the half-cosine to 0.23 of the speed (past 0.11 s the lead
    would ask for reverse, is zero, and a lag alone is slower), never reverse, never faster, no more than the half-cosine's own
    acceleration, and 30 mm of travel at 0.2 m/s to within a fifth."""
    ramp, speeds, travel = RampedStop(limits()), list(from_m_s), [0.0, 0.0]
    for k in range(round(RAMP_S / TICK_S)):
        command = ramp.step(k * TICK_S, from_m_s)
        assert not command.brake
        ideal = 0.5 * (1.0 + math.cos(math.pi * (k + 1) * TICK_S / RAMP_S))
        for side, asked in enumerate((command.left_m_s, command.right_m_s)):
            before = speeds[side]
            speeds[side] = asked + (before - asked) * math.exp(-TICK_S / LAG_S)
            travel[side] += TICK_S * speeds[side]
            assert 0.0 <= speeds[side] / from_m_s[side] <= before / from_m_s[side]
            assert abs(speeds[side] / from_m_s[side] - ideal) < 0.23
            # A tick's command is held for the whole tick: a tenth more than the continuous peak at most.
            assert abs(speeds[side] - before) / TICK_S <= 1.1 * abs(from_m_s[side]) * math.pi / (2.0 * RAMP_S)
    assert ramp.step(RAMP_S, from_m_s) == TrackCommand.stop(RAMP_S)
    assert [abs(way) for way in travel] == [pytest.approx(0.5 * abs(speed) * RAMP_S, rel=0.2) for speed in from_m_s]


def test_a_chair_that_stands_is_braked_at_once() -> None:
    for speed, brakes in ((STANDING_M_S, True), (1.1 * STANDING_M_S, False)):
        assert held(Stop.RAMP, speed)[1].brake is brakes
    assert not RampedStop(limits()).step(1.0, (0.0, 1.1 * STANDING_M_S)).brake


def test_an_urgent_cause_during_the_ramp_brakes_and_the_first_cause_stays() -> None:
    latch, command = held(Stop.RAMP)
    assert not command.brake
    latch.hold(1.05, Stop.RAMP, "another decision")
    assert not latch.stop(1.05, (0.2, 0.2)).brake
    latch.hold(1.1, Stop.BRAKE, "operator stop")
    latch.hold(1.1, Stop.BRAKE, "operator stop")
    assert latch.stop(1.1, (0.2, 0.2)) == TrackCommand.stop(1.1)
    assert latch.cause == "ramp"
    assert [(event.t_s, event.name) for event in latch.take()] == [(1.0, "hold"), (1.1, "brake")]


@pytest.mark.parametrize("next_s", [1.0, 0.99, 1.3, 9.0])
def test_a_clock_that_stands_turns_back_or_leaps_ends_the_ramp_for_good(next_s: float) -> None:
    latch, _ = held(Stop.RAMP)
    assert latch.stop(next_s, (0.2, 0.2)).brake
    assert latch.stop(1.01, (0.2, 0.2)).brake


def test_each_hold_has_a_ramp_of_its_own() -> None:
    latch, _ = held(Stop.BRAKE)
    latch.release(2.0)
    latch.hold(3.0, Stop.RAMP, "seat")
    assert latch.stop(3.0, (0.2, 0.1)).left_m_s == pytest.approx(0.2)


def running() -> Guard:
    """Return a guard whose belts have run at 0.2 m/s for a second."""
    guard = Guard(limits(needs_heading=False, seat_rate_m_s=None, flipper_rate_rad_s=None))
    for k in range(101):
        guard.advance(k * TICK_S)
        guard.admit(belts(k * TICK_S))
        guard.propose(TrackCommand(t_s=k * TICK_S, left_m_s=0.2, right_m_s=0.2))
        guard.step(k * TICK_S, None)
    return guard


def test_the_operator_stops_the_belts_within_a_tick_also_while_they_ramp_down() -> None:
    """Test: the planner holds; 50 ms later, or at once, the operator lets go. Expected result: a ramp; zero within the operator's
    tick, and the brake 0.3 s after the hold."""
    for after in (0, 5):
        guard = running()
        guard.on_message(MotionPlan(t_s=1.0, phase="climb", speed_m_s=0.2, hold="nothing to see"))
        for k in range(after):
            passed = guard.step(1.01 + k * TICK_S, None).tracks
            assert not passed.brake
            assert 0.0 < passed.left_m_s <= 0.2
        guard.admit(OperatorInput(t_s=1.06, dead_man=False))
        stopped = guard.step(1.06, None).tracks
        assert (stopped.left_m_s, stopped.right_m_s, stopped.brake) == (0.0, 0.0, False)
        assert not guard.step(1.29, None).tracks.brake
        assert guard.step(1.37, None).tracks == TrackCommand.stop(1.37)
        assert guard.holding == "nothing to see"


def keyed(pauses_s: list[float], fault_s: float) -> bool:
    """Return whether a key re-arms a chair that a fault holds: held down for 0.7 s after each pause of its repeats, at 20 Hz."""
    repeats_s: list[float] = []
    for pause_s in pauses_s:
        began_s = pause_s + (repeats_s[-1] if repeats_s else 0.0)
        repeats_s += [began_s + 0.05 * k for k in range(15)]
    rearm = Rearm()
    for tick in range(round(20.0 * repeats_s[-1])):
        t_s = 0.05 * tick
        typed = repeats_s[: bisect(repeats_s, t_s)][-2:]
        # A terminal's key counts as held while its last repeat is 0.15 s old at most, and the one before 0.15 s older.
        held = len(typed) == 2 and t_s - typed[1] <= 0.15 and typed[1] - typed[0] <= 0.15
        if rearm.press(OperatorInput(t_s=t_s, dead_man=held, rearm=held), fault_s if t_s >= fault_s else math.inf):
            return True
    return False


def test_a_held_key_whose_repeats_pause_re_arms_nobody_and_an_act_does() -> None:
    """Test: 20,000 keys that are held on over a fault, with pauses of 0.05 to 0.6 s; a key released for a second and pressed;
    another key; buttons that are stuck, pressed with a stop, at once, or before the hold. Expected: the acts alone re-arm."""
    rng = np.random.default_rng(0)
    for _ in range(20_000):
        assert not keyed([0.0, *rng.uniform(0.05, 0.6, 3)], float(rng.uniform(0.3, 1.5)))
    assert keyed([0.0, 1.2], 0.3)

    def reported(*reports: tuple[float, bool, bool, bool]) -> list[bool]:
        button = Rearm()
        return [button.press(OperatorInput(t_s=t, dead_man=d, rearm=r, stop=s), 1.0) for t, d, r, s in reports]

    on, off = True, False
    assert reported((1.2, on, off, off), (1.6, on, on, off), (1.7, on, on, off)) == [off, on, off]
    assert reported((1.2, on, off, off), (1.4, on, on, off), (1.8, on, on, off)) == [off, off, off]
    assert reported((1.2, on, off, off), (1.6, on, on, on), (1.7, on, on, off)) == [off, off, off]
    assert reported((1.1, off, off, off), (1.8, on, on, off), (1.9, on, off, off), (2.0, on, on, off)) == [off, off, off, on]
