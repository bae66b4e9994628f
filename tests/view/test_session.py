"""Session of the viewer: cursor, transport, handset, and the changes that the page offers."""

import pytest

from treadline.report.labels import FAULTS
from treadline.scenario.faults import EXTENTS, Fault
from treadline.view._messages import Handset
from treadline.view._session import Session
from treadline.view._what_if import CHANGES, FORKS, NOTHING, fault_of, last_line, meaning, said_of

from .conftest import END_S, a_run, session_of


def test_a_recorded_session_plays_pauses_steps_and_seeks() -> None:
    session = session_of(a_run())
    session.advance(1.0)
    assert session.cursor_s == 0.0
    session.play()
    session.set_speed(5.0)
    session.advance(1.0)
    assert session.cursor_s == pytest.approx(5.0)
    session.press_transport("+0.01 s")
    assert (session.playing, session.cursor_s) == (False, pytest.approx(5.01))
    session.play()
    session.advance(99.0)
    assert (session.playing, session.cursor_s) == (False, pytest.approx(END_S))
    session.seek(99.0)
    assert session.cursor_s == pytest.approx(END_S)
    session.play()
    session.advance(0.1)
    assert session.cursor_s == pytest.approx(0.5)  # play at the end begins anew
    session.act(Fault(kind="imu_lost"))  # nothing to act on: ignored


def test_pause_step_and_speed_act_on_an_attended_simulation(attended: Session) -> None:
    """Test: the buttons of a live run. Expected: a speed below zero is the worker's pause."""
    attended.advance(0.1)
    assert attended.cursor_s == pytest.approx(END_S)
    attended.play(playing=False)
    attended.step(1)
    attended.play(playing=True)
    attended.set_speed(2.0)
    assert attended.feed.workers["run"].sent == [("speed", -1.0), ("step", 1), ("speed", 1.0), ("speed", 2.0)]


def test_a_session_that_only_views_passes_no_command_on(attended: Session) -> None:
    attended.attended = False
    attended.play(playing=False)
    attended.press("stop")
    attended.act(Fault(kind="imu_lost"))
    attended.set_manual(manual=True)
    attended.report(dead_man=True, ahead=1.0, turn=0.0)
    assert attended.feed.workers["run"].sent == []


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    now = [100.0]
    monkeypatch.setattr("treadline.view._session.time.monotonic", lambda: now[0])
    return now


@pytest.mark.parametrize(("silence_s", "dead_man"), [(0.29, True), (0.31, False)])
def test_a_silent_handset_counts_as_released(attended: Session, clock: list[float], silence_s: float, dead_man: bool) -> None:
    """Test: reports that stop. Expected: released after the 0.3 s of the guard's link, and the belts are at rest."""
    attended.set_manual(manual=True)
    attended.report(dead_man=True, ahead=2.0, turn=-0.5)
    driving = Handset(manual=True, speed_m_s=0.10, turn_m_s=-0.04)
    assert attended.feed.workers["run"].sent[-1][1] == driving
    clock[0] += silence_s
    attended.advance(0.0)
    assert attended.feed.workers["run"].sent[-1][1] == (driving if dead_man else Handset(manual=True, dead_man=False))


def test_a_pressed_button_is_released_by_itself(attended: Session, clock: list[float]) -> None:
    attended.press("stop")
    clock[0] += 1.0
    attended.advance(0.0)
    assert [command.stop for _, command in attended.feed.workers["run"].sent] == [True, False]


# ---- changes ----


@pytest.mark.parametrize("choice", CHANGES)
def test_each_change_is_a_fault_with_the_value_that_the_form_fills_in(choice: str) -> None:
    change = CHANGES[choice]
    fault = fault_of(choice, change.default, 2.0)
    assert (fault.kind, fault.size) == (change.kind, change.sign * change.default)
    assert (fault.for_s == 2.0) == (not change.stays)
    assert meaning(choice)


def test_every_fault_has_a_name_and_wet_steps_are_offered_first() -> None:
    """Test: names of the faults, and the form of a fork. Expected: each kind is named without its code; wet steps halve it."""
    assert FAULTS.keys() == EXTENTS.keys()
    assert not any("_" in name for name in CHANGES)
    wet = fault_of(FORKS[0], CHANGES[FORKS[0]].default, 1.0)
    assert (wet.kind, wet.size) == ("low_friction", 0.5)
    assert said_of(FORKS[0], 0.5, 1.0) == "wet steps, friction × 0.5"
    assert fault_of(NOTHING, 0.0, 1.0) is None
    twice = fault_of("friction of the right belt", 2.0, 1.0)
    assert (twice.kind, twice.size) == ("track_slip", -2.0)


@pytest.mark.parametrize(
    ("choice", "value", "said"),
    [
        ("wet steps (friction × 0.5)", 2.1, "value is 2.1; a factor on the friction must be from 0.1 to 2"),
        ("friction of the right belt", -0.5, "value is -0.5; a factor on the friction must be from 0.1 to 2"),
        ("passenger's weight up", 0.4, "value is 0.4; for payload_up it must be from -0.3 to 0.3"),
        ("passenger leans to the left for a time", -0.5, "value is -0.5; for payload_left it must be from -0.3 to 0.3"),
    ],
)
def test_a_value_out_of_range_is_refused_with_its_range(choice: str, value: float, said: str) -> None:
    with pytest.raises(ValueError, match="value is") as caught:
        fault_of(choice, value, 1.0)
    assert said in last_line(caught.value)
