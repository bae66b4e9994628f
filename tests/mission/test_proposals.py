"""Who asks the belts for what, and when."""

from dataclasses import replace

import pytest
from world import estimate

from treadline.core.signals import HeadingEstimate, MotionPlan, TrackCommand
from treadline.mission.belt_controllers import Proposals

KNOWN = estimate(0.0, 0.1)


class Steering:
    """A driver that turns by a fixed difference, stands without an estimate, and counts."""

    period_s = 0.25
    follows_plan = False

    def __init__(self) -> None:
        self.knew: list[HeadingEstimate | None] = []

    def step(self, known: HeadingEstimate | None, t_s: float, plan: MotionPlan) -> TrackCommand:
        self.knew.append(known)
        if known is None:
            return TrackCommand.stop(t_s)
        return TrackCommand(t_s=t_s, left_m_s=plan.speed_m_s - 0.02, right_m_s=plan.speed_m_s + 0.02)


def plan(t_s: float, *, turn_m_s: float | None = None, pitch_feedforward_m_s: float = 0.0) -> MotionPlan:
    return MotionPlan(t_s=t_s, phase="climb", speed_m_s=0.2, turn_m_s=turn_m_s, pitch_feedforward_m_s=pitch_feedforward_m_s)


def belts(command: TrackCommand | None) -> tuple[float, float] | None:
    return None if command is None else (round(command.left_m_s, 9), round(command.right_m_s, 9))


def test_the_driver_speaks_when_it_is_due_and_a_fall_does_not_wait_for_it() -> None:
    """Test: the chair falls between two periods of the driver. Expected result: both belts give way at once, the turn stays,
    and each change has its own time; the driver hears of none of it."""
    driver = Steering()
    proposals = Proposals(driver)
    assert belts(proposals.step(plan(0.0), KNOWN, held=False, due=True)) == (0.18, 0.22)
    assert proposals.step(plan(0.01), KNOWN, held=False, due=False) is None
    falls = proposals.step(plan(0.02, pitch_feedforward_m_s=-0.1), KNOWN, held=False, due=False)
    assert (belts(falls), falls.t_s) == ((0.08, 0.12), 0.02)
    assert proposals.step(plan(0.03, pitch_feedforward_m_s=-0.1), KNOWN, held=False, due=False) is None
    assert belts(proposals.step(plan(0.04), KNOWN, held=False, due=False)) == (0.18, 0.22)
    assert driver.knew == [KNOWN]


def test_the_plans_own_turn_is_asked_at_each_tick_and_the_driver_forgets() -> None:
    driver = Steering()
    proposals = Proposals(driver)
    assert belts(proposals.step(plan(0.0, turn_m_s=0.05, pitch_feedforward_m_s=0.1), KNOWN, held=False, due=True)) == (0.25, 0.35)
    assert belts(proposals.step(plan(0.01, turn_m_s=0.05), KNOWN, held=False, due=False)) == (0.15, 0.25)
    assert driver.knew == [None]


def test_the_driver_of_a_held_chair_gets_no_heading() -> None:
    """Test: the guard holds the chair, then a person lets it go. Expected result: the driver is asked without a heading, and
    then with it."""
    driver = Steering()
    proposals = Proposals(driver)
    assert belts(proposals.step(plan(0.0), KNOWN, held=True, due=True)) == (0.0, 0.0)
    assert belts(proposals.step(plan(0.25), KNOWN, held=False, due=True)) == (0.18, 0.22)
    assert driver.knew == [None, KNOWN]


def test_what_the_driver_said_before_the_plan_turned_is_void() -> None:
    """Test: the driver steers, the plan turns, and leaves steering to the driver as the chair falls, before it is due. Expected
    result: nothing is asked until it is."""
    proposals = Proposals(Steering())
    proposals.step(plan(0.0), KNOWN, held=False, due=True)
    proposals.step(plan(0.01, turn_m_s=0.0), KNOWN, held=False, due=False)
    assert proposals.step(plan(0.02, pitch_feedforward_m_s=0.1), KNOWN, held=False, due=False) is None
    assert belts(proposals.step(plan(0.25, pitch_feedforward_m_s=0.1), KNOWN, held=False, due=True)) == (0.28, 0.32)


@pytest.mark.parametrize("pitch_feedforward_m_s", [0.1, -0.1])
def test_belts_that_are_to_stand_stand(pitch_feedforward_m_s: float) -> None:
    """Test: no heading is known, so the driver stops. Expected result: no fall moves the belts."""
    asked = Proposals(Steering()).step(plan(0.0, pitch_feedforward_m_s=pitch_feedforward_m_s), None, held=False, due=True)
    assert (belts(asked), asked.brake) == ((0.0, 0.0), True)


def test_a_driver_that_repeats_itself_grows_old_whatever_falls() -> None:
    """Test: a driver says at 0.5 s what it said at 0.25 s; then the chair falls. Expected result: what is asked stays as old as it
    is, for the guard to detect a dead driver."""

    class Dead(Steering):
        def step(self, known: HeadingEstimate | None, t_s: float, plan: MotionPlan) -> TrackCommand:
            return replace(super().step(known, t_s, plan), t_s=min(t_s, 0.25))

    proposals = Proposals(Dead())
    asked = [proposals.step(plan(t_s), KNOWN, held=False, due=True) for t_s in (0.25, 0.5)]
    assert [command.t_s for command in asked if command is not None] == [0.25, 0.25]
    falls = proposals.step(plan(0.6, pitch_feedforward_m_s=0.1), KNOWN, held=False, due=False)
    assert falls.t_s == pytest.approx(0.35)
