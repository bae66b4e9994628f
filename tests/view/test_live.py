"""Live runs: the loop does the same with and without a viewer, and a run can be repeated to the bit."""

from dataclasses import fields, replace
from functools import partial
from typing import Any

import numpy as np
import pytest

from treadline.core.ports import Truth
from treadline.core.signals import FlipperCommand, SeatCommand, TrackCommand
from treadline.playback import Recording
from treadline.run.episode import run_episode
from treadline.run.resolve import resolve
from treadline.scenario.chair import read_chair
from treadline.scenario.faults import Conditions, Fault
from treadline.scenario.scenario import DriveSettings, Scenario, Sensors, Start
from treadline.vehicle.bodies import vehicle
from treadline.view._feed import Feed
from treadline.view._live_run import LiveRun, Pacer
from treadline.view._messages import Handset, Order
from treadline.view._process import Worker
from treadline.view._session import Session

from .conftest import FakeWorker

# Literals, so that a changed value in the code is detected here.
GRAVITY_M_S2 = 9.81

LOGGED = (TrackCommand, SeatCommand, FlipperCommand, Truth)
SHORT = Scenario(
    start=Start(place="flight", step=4, heading_deg=6.0),
    drive=DriveSettings(duration_s=2.0, check=False),
    sensors=Sensors(camera="statistical"),
)
"""Two seconds on the flight, with a heading error that the loop corrects; without images, which the plant draws slowly."""
RENDERED = SHORT.model_copy(update={"sensors": Sensors(), "drive": DriveSettings(duration_s=0.6, check=False)})
"""Some frames with images and the detector."""


def keep(logged: list[str], signal: Any, taken_s: float) -> None:
    if isinstance(signal, LOGGED):
        logged.append(f"{taken_s!r} {signal!r}")


def viewed(order: Order, commands: dict[int, list[Any]] | None = None, *, roomy: bool = True) -> tuple[Feed, list[str]]:
    """Run an order in this process with a viewer that takes everything, or one that takes nothing before the end."""
    feed, logged, calls = Feed.live(order, read_chair(order.scenario.chair.model)), [], [0]
    refused = [0]

    def send(message: Any) -> bool:
        if not roomy and message[0] != "end" and refused[0] < 20:
            refused[0] += 1
            return False
        feed.take(*message)
        return True

    def receive() -> list[Any]:
        calls[0] += 1
        return (commands or {}).get(calls[0], [])

    LiveRun(replace(order, speed=0.0), send, receive, partial(keep, logged)).run()
    return feed, logged


def of(scenario: Scenario = SHORT, seed: int = 5, *, commands: dict[int, list[Any]] | None = None, **more: Any) -> Feed:
    """Return the feed of a run in this process."""
    return viewed(Order(scenario=scenario, seed=seed, **more), commands)[0]


def bits(feed: Feed, rows: Any = slice(None)) -> dict[str, bytes]:
    """Return every quantity of the samples of a run as bytes."""
    arrays = {item.name: getattr(feed.recording, item.name) for item in fields(Recording) if item.name != "frames_t_s"}
    return {name: values[rows].tobytes() for name, values in arrays.items() if isinstance(values, np.ndarray)}


def alone(scenario: Scenario, seed: int) -> list[str]:
    """Run a scenario without any viewer."""
    logged: list[str] = []
    run_episode(resolve(scenario, None, seed), sink=partial(keep, logged))
    return logged


@pytest.mark.parametrize(
    ("scenario", "roomy"),
    [(SHORT, True), (RENDERED, True), (RENDERED, False)],
    ids=["statistical", "rendered", "viewer that takes nothing"],
)
def test_the_loop_commands_the_same_with_and_without_a_viewer(scenario: Scenario, roomy: bool) -> None:
    """Test: ground truth and all commands of a run, as text. Expected: identical to the last digit; no sample is lost."""
    feed, logged = viewed(Order(scenario=scenario, seed=3), roomy=roomy)
    assert logged == alone(scenario, 3)
    assert len(logged) > 180
    np.testing.assert_allclose(np.diff(feed.recording.t_s), 0.01, atol=1e-9)
    assert feed.recording.duration_s == pytest.approx(scenario.drive.duration_s)


@pytest.fixture(scope="module")
def run() -> Feed:
    return of()


def test_a_viewer_receives_the_walk_that_check_made(run: Feed) -> None:
    walk = resolve(SHORT, None, 5).report.walk
    assert {name: values.tolist() for name, values in run.way[1].items()} == {n: v.tolist() for n, v in walk.columns.items()}


def test_an_unchanged_fork_coincides_to_the_bit(run: Feed) -> None:
    fork = of(pictures=False)
    assert len(run.recording.t_s) == len(fork.recording.t_s) == 201
    assert bits(run) == bits(fork)


@pytest.mark.parametrize(("kind", "value"), [("low_friction", 0.3), ("obstacle", 0.5)])
def test_a_fork_coincides_up_to_its_change_and_differs_after(run: Feed, kind: Any, value: float) -> None:
    """Test: one fault at 1 s. Expected: the samples before are the same to the bit, and something differs within a second."""
    fork = of(script=((100, Fault(kind=kind, at_s=1.0, for_s=100.0, value=value)),))
    before, all_there = slice(99), slice(len(fork.recording.t_s))  # a command of 1 s counts from the sample of its stamp on
    assert bits(run, before) == bits(fork, before)
    assert bits(run, all_there) != bits(fork)
    assert (kind == "obstacle") == bool(fork.obstacles)


def test_a_fault_injected_during_a_run_is_the_same_fault_of_the_scenario() -> None:
    fault = Fault(kind="track_slip", at_s=1.0, for_s=1.0, value=0.1)
    planned = SHORT.model_copy(update={"fault": (fault,)})
    assert bits(of(seed=2, script=((100, fault),))) == bits(of(planned, seed=2))


def test_stop_holds_and_rearm_goes_on() -> None:
    """Test: stop at 0.5 s, re-arm at 1.2 s in an attended run. Expected: both events, belts at rest between, and motion after."""
    script = ((50, Handset(stop=True)), (100, Handset()), (120, Handset(rearm=True)), (150, Handset()))
    found = of(seed=1, attended=True, script=script).recording
    assert [event.name for event in found.events if event.name in ("hold", "rearmed")] == ["hold", "rearmed"]
    left = found.belt_m_s[:, 0]
    assert abs(left[110]) < 1e-3  # at rest after six time constants of the drives
    assert left[-1] > 0.05
    assert found.outcome == "time_up"


def test_a_released_dead_man_switch_holds_and_an_unattended_run_then_ends() -> None:
    found = of(seed=1, script=((50, Handset(dead_man=False)),)).recording
    assert found.outcome == "held: the dead-man switch is released"
    assert found.duration_s < 1.0


def test_a_person_steers_within_the_limits_of_the_guard() -> None:
    """Test: by hand at 0.1 m/s with a turn to the left from 0.5 s. Expected: the right belt runs faster, as asked."""
    found = of(seed=1, attended=True, script=((50, Handset(manual=True, speed_m_s=0.1, turn_m_s=0.05)),)).recording
    assert found.command_m_s[180].tolist() == pytest.approx([0.05, 0.15])


def test_commands_return_with_their_tick_so_that_the_session_can_be_repeated() -> None:
    first = of(seed=4, attended=True, commands={30: [("act", Handset(stop=True))], 60: [("act", Handset())]})
    assert [command for _, command in first.script] == [Handset(stop=True), Handset()]
    assert bits(of(seed=4, attended=True, script=tuple(first.script))) == bits(first)


def test_a_pacer_keeps_real_time_and_does_not_catch_up_after_a_second(monkeypatch: pytest.MonkeyPatch) -> None:
    clock, slept = [0.0], []
    monkeypatch.setattr("treadline.view._live_run.time.perf_counter", lambda: clock[0])
    monkeypatch.setattr("treadline.view._live_run.time.sleep", slept.append)
    pacer = Pacer(speed=2.0)
    pacer.wait(0.0, lambda: None)
    pacer.wait(1.0, lambda: None)
    assert slept == [pytest.approx(0.5)]
    clock[0] = 10.0
    pacer.wait(1.01, lambda: None)
    pacer.wait(1.03, lambda: None)
    assert slept[1:] == [pytest.approx(0.01)]


def test_conditions_are_the_same_as_faults_of_the_scenario() -> None:
    """Test: friction × 2 left and × 0.3 right, and the weight moved, at 1 s. Expected: as with these faults, to the bit."""
    shift_m = (-0.1, 0.05, 0.2)
    kinds = ("payload_forward", "payload_left", "payload_up")
    faults = [Fault(kind=kind, at_s=1.0, for_s=100.0, value=value) for kind, value in zip(kinds, shift_m, strict=True)]
    faults += [Fault(kind="track_slip", at_s=1.0, for_s=100.0, value=value) for value in (2.0, -0.3)]
    planned = of(SHORT.model_copy(update={"fault": tuple(faults)}), seed=2)
    live = of(seed=2, script=((101, Conditions(friction=(2.0, 0.3), payload_m=shift_m)),))
    # Conditions follow the ground truth of their tick, which counts margin and friction without them.
    others = np.flatnonzero(np.arange(len(planned.recording.t_s)) != 100)
    assert bits(live, others) == bits(planned, others)
    assert [live.payload_shift_at(0.01 * k) for k in (100, 101, 150)] == [(0.0, 0.0, 0.0), shift_m, shift_m]


def test_the_last_conditions_replace_those_before(run: Feed) -> None:
    """Test: other conditions from 0.5 s, withdrawn before the next tick. Expected: a run as without."""
    script = ((50, Conditions(friction=(0.1, 2.0), payload_m=(0.3, 0.3, 0.3))), (50, Conditions()))
    assert bits(of(script=script)) == bits(run)


def test_contact_forces_carry_the_chair_and_do_not_change_the_run(run: Feed) -> None:
    """Test: contact forces from about 0.3 s on. Expected: the same run to the bit; on average they carry the weight."""
    feed = of(commands={30: [("contacts", True)], 150: [("contacts", False)]})
    assert bits(feed) == bits(run)
    assert len(feed.contacts) == 120
    assert feed.contacts_at(0.1) is feed.contacts_at(1.9) is None
    total_n = np.mean([found.forces_W.sum(axis=0) for found in feed.contacts], axis=0)
    # Of the weight, the component normal to the slope; forces at rounded nosings and at the flipper are turned by some degrees.
    loading = Scenario().chair
    weight_n = sum(body.mass_kg for body in vehicle(read_chair(loading.model), loading).bodies) * GRAVITY_M_S2
    assert np.linalg.norm(total_n) == pytest.approx(weight_n * np.cos(SHORT.stair.slope_rad), rel=0.1)
    found = feed.contacts_at(1.0)
    assert found.points_W.shape == found.forces_W.shape == (len(found.points_W), 3)


def test_a_recorded_run_is_repeated_for_its_contact_forces(run: Feed) -> None:
    """Test: contact forces asked of a run that has ended. Expected: those of every tick, as during a live run."""
    live = of(contacts=True)
    session = Session(feed=Feed.recorded(run.recording, run.order))
    feed, repeated = session.feed, []

    def make(order: Order) -> Worker:
        repeated.append(order)
        return FinishedWorker(order)

    feed.start_repeat(make)
    assert "repeat" in feed.workers
    feed.drain()
    assert not feed.workers
    assert [found.t_s for found in feed.contacts] == [found.t_s for found in live.contacts]
    for found, expected in zip(feed.contacts, live.contacts, strict=True):
        np.testing.assert_array_equal(found.forces_W, expected.forces_W)
    assert repeated[0].seed == 5
    session.ask_contacts(asked=True)  # known already: no process starts
    assert not feed.workers


class FinishedWorker(FakeWorker):
    """Worker that has simulated its order within this process."""

    def __init__(self, order: Order) -> None:
        super().__init__()
        self.messages: list[Any] = []
        LiveRun(order, lambda message: self.messages.append(message) is None, list).run()

    def receive(self) -> list[Any]:
        taken, self.messages = self.messages, []
        return taken
