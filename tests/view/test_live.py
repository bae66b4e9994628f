"""Live runs: the loop does the same with and without a viewer, and a run can be repeated to the bit."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from treadline.core.ports import Truth
from treadline.core.signals import FlipperCommand, SeatCommand, TrackCommand
from treadline.run.episode import run_episode
from treadline.run.resolve import resolve
from treadline.scenario.chair import GRAVITY_M_S2, read_chair
from treadline.scenario.faults import Conditions, Fault
from treadline.scenario.scenario import DriveSettings, Scenario, Sensors, Start
from treadline.vehicle.bodies import vehicle
from treadline.view.orders import Handset, Order, Worker
from treadline.view.session import Feed, Session
from treadline.view.tape import NUMBER, Tape
from treadline.view.worker import LiveRun, Pacer

LOGGED = (TrackCommand, SeatCommand, FlipperCommand, Truth)
SHORT = Scenario(
    start=Start(place="flight", step=4, heading_deg=6.0),
    drive=DriveSettings(duration_s=2.0, check=False),
    sensors=Sensors(camera="statistical"),
)
"""Two seconds on the flight, with a heading error that the loop corrects; without images, which the plant draws slowly."""
RENDERED = SHORT.model_copy(update={"sensors": Sensors(), "drive": DriveSettings(duration_s=0.6, check=False)})
"""Some frames with images and the detector."""


def viewed(order: Order, commands: dict[int, list[Any]] | None = None, *, roomy: bool = True) -> tuple[Tape, list[str], Feed]:
    """Run an order in this process with a viewer that takes everything, or one that takes nothing before the end."""
    feed, logged, calls = Feed(order=order), [], [0]
    refused = [0]

    def send(message: Any) -> bool:
        if not roomy and message[0] != "end" and refused[0] < 20:
            refused[0] += 1
            return False
        feed._take(*message)
        return True

    def receive() -> list[Any]:
        calls[0] += 1
        return (commands or {}).get(calls[0], [])

    def log(signal: Any, taken_s: float) -> None:
        if isinstance(signal, LOGGED):
            logged.append(f"{taken_s!r} {signal!r}")

    LiveRun(replace(order, speed=0.0), send, receive, log).run()
    return feed.tape, logged, feed


def alone(scenario: Scenario, seed: int) -> list[str]:
    """Run a scenario without any viewer."""
    logged = []

    def log(signal: Any, taken_s: float) -> None:
        if isinstance(signal, LOGGED):
            logged.append(f"{taken_s!r} {signal!r}")

    run_episode(resolve(scenario, None, seed), sink=log)
    return logged


@pytest.mark.parametrize(
    ("scenario", "roomy"),
    [(SHORT, True), (RENDERED, True), (RENDERED, False)],
    ids=["statistical", "rendered", "viewer that takes nothing"],
)
def test_the_loop_commands_the_same_with_and_without_a_viewer(scenario: Scenario, roomy: bool) -> None:
    """Test: ground truth and all commands of a run, as text. Expected: identical to the last digit."""
    _, logged, _ = viewed(Order(scenario=scenario, seed=3), roomy=roomy)
    assert logged == alone(scenario, 3)
    assert len(logged) > 180


@pytest.fixture(scope="module")
def run() -> Tape:
    return viewed(Order(scenario=SHORT, seed=5))[0]


def test_an_unchanged_fork_coincides_to_the_bit(run: Tape) -> None:
    fork, _, _ = viewed(Order(scenario=SHORT, seed=5, pictures=False))
    assert len(run) == len(fork) == 201
    assert run.rows.tobytes() == fork.rows.tobytes()


@pytest.mark.parametrize(("kind", "value"), [("low_friction", 0.3), ("obstacle", 0.5)])
def test_a_fork_coincides_up_to_its_change_and_differs_after(run: Tape, kind: Any, value: float) -> None:
    """Test: one fault at 1 s. Expected: the rows before are the same to the bit, and something differs within the next second."""
    fault = Fault(kind=kind, at_s=1.0, for_s=100.0, value=value)
    fork, _, feed = viewed(Order(scenario=SHORT, seed=5, script=((100, fault),)))
    assert run.rows[:100].tobytes() == fork.rows[:100].tobytes()
    assert run.rows[: len(fork)].tobytes() != fork.rows.tobytes()
    assert (kind == "obstacle") == bool(feed.tape.obstacles)


def test_a_fault_injected_during_a_run_is_the_same_fault_of_the_scenario() -> None:
    fault = Fault(kind="track_slip", at_s=1.0, for_s=1.0, value=0.1)
    live, _, _ = viewed(Order(scenario=SHORT, seed=2, script=((100, fault),)))
    planned, _, _ = viewed(Order(scenario=SHORT.model_copy(update={"fault": (fault,)}), seed=2))
    assert live.rows.tobytes() == planned.rows.tobytes()


def test_stop_holds_and_rearm_goes_on() -> None:
    """Test: stop at 0.5 s, re-arm at 1.2 s in an attended run. Expected: both events, belts at rest between, and motion after."""
    script = ((50, Handset(stop=True)), (100, Handset()), (120, Handset(rearm=True)), (150, Handset()))
    tape, _, _ = viewed(Order(scenario=SHORT, seed=1, attended=True, script=script))
    names = [event.name for event in tape.events if event.name in ("hold", "rearmed")]
    assert names == ["hold", "rearmed"]
    left = tape.column("left_m_s")
    assert abs(left[110]) < 1e-3  # at rest after six time constants of the drives
    assert left[-1] > 0.05
    assert tape.verdict == "time_up"


def test_a_released_dead_man_switch_holds_and_an_unattended_run_then_ends() -> None:
    tape, _, _ = viewed(Order(scenario=SHORT, seed=1, script=((50, Handset(dead_man=False)),)))
    assert tape.verdict == "held: operator stop"
    assert tape.end_s < 1.0


def test_a_person_steers_within_the_limits_of_the_guard() -> None:
    """Test: by hand at 0.1 m/s with a turn to the left from 0.5 s. Expected: the right belt runs faster, as asked."""
    script = ((50, Handset(manual=True, speed_m_s=0.1, turn_m_s=0.05)),)
    tape, _, _ = viewed(Order(scenario=SHORT, seed=1, attended=True, script=script))
    at = tape.at(1.8)
    assert (at["command_left_m_s"], at["command_right_m_s"]) == (pytest.approx(0.05), pytest.approx(0.15))


def test_commands_return_with_their_tick_so_that_the_session_can_be_repeated() -> None:
    first, _, feed = viewed(
        Order(scenario=SHORT, seed=4, attended=True), {30: [("act", Handset(stop=True))], 60: [("act", Handset())]}
    )
    assert [command for _, command in feed.script] == [Handset(stop=True), Handset()]
    again, _, _ = viewed(Order(scenario=SHORT, seed=4, attended=True, script=tuple(feed.script)))
    assert first.rows.tobytes() == again.rows.tobytes()


def test_a_viewer_that_takes_nothing_costs_images_but_no_rows() -> None:
    tape, _, _ = viewed(Order(scenario=RENDERED, seed=3), roomy=False)
    np.testing.assert_allclose(tape.column("t_s"), 0.01 * np.arange(61), atol=1e-9)


def test_a_pacer_keeps_real_time_and_does_not_catch_up_after_a_second(monkeypatch: pytest.MonkeyPatch) -> None:
    clock, slept = [0.0], []
    monkeypatch.setattr("treadline.view.worker.time.perf_counter", lambda: clock[0])
    monkeypatch.setattr("treadline.view.worker.time.sleep", slept.append)
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
    planned, _, _ = viewed(Order(scenario=SHORT.model_copy(update={"fault": tuple(faults)}), seed=2))
    script = ((101, Conditions(friction=(2.0, 0.3), payload_m=shift_m)),)
    live, _, _ = viewed(Order(scenario=SHORT, seed=2, script=script))
    # Conditions follow the ground truth of their tick, which counts margin and friction without them.
    np.testing.assert_array_equal(np.delete(live.rows, 100, axis=0), np.delete(planned.rows, 100, axis=0))
    np.testing.assert_array_equal(live.rows[100, : NUMBER["margin_rad"]], planned.rows[100, : NUMBER["margin_rad"]])
    shift = live.rows[:, NUMBER["payload_forward_m"] :]
    assert not shift[:101].any()
    np.testing.assert_array_equal(shift[101:], np.broadcast_to(shift_m, (len(live) - 101, 3)))


def test_the_last_conditions_replace_those_before(run: Tape) -> None:
    """Test: other conditions from 0.5 s, withdrawn before the next tick. Expected: a run as without."""
    script = ((50, Conditions(friction=(0.1, 2.0), payload_m=(0.3, 0.3, 0.3))), (50, Conditions()))
    assert viewed(Order(scenario=SHORT, seed=5, script=script))[0].rows.tobytes() == run.rows.tobytes()


def test_contact_forces_carry_the_chair_and_do_not_change_the_run(run: Tape) -> None:
    """Test: contact forces from about 0.3 s on. Expected: the same run to the bit; on average they carry the weight."""
    tape, _, feed = viewed(Order(scenario=SHORT, seed=5), {30: [("contacts", True)], 150: [("contacts", False)]})
    assert tape.rows.tobytes() == run.rows.tobytes()
    assert len(feed.tape.contacts) == 120
    assert tape.contacts_at(0.1) is None
    assert tape.contacts_at(1.9) is None
    total_n = np.mean([found.forces_W.sum(axis=0) for found in tape.contacts], axis=0)
    # Of the weight, the component normal to the slope; forces at rounded nosings and at the flipper are turned by some degrees.
    loading = Scenario().chair
    bodies = vehicle(read_chair(loading.model), loading).bodies
    weight_n = sum(body.mass_kg for body in bodies) * GRAVITY_M_S2
    assert np.linalg.norm(total_n) == pytest.approx(weight_n * np.cos(SHORT.stair.slope_rad), rel=0.1)
    found = tape.contacts_at(1.0)
    assert found is not None
    assert found.points_W.shape == found.forces_W.shape == (len(found.points_W), 3)


def test_a_recorded_run_is_repeated_for_its_contact_forces(run: Tape) -> None:
    """Test: contact forces asked of a run that has ended, then of its fork. Expected: those of every tick, as during a live run."""
    live, _, _ = viewed(Order(scenario=SHORT, seed=5, contacts=True))
    feed = Feed(order=Order(scenario=SHORT, seed=5), tape=run)
    session = Session(feed=feed)
    repeated: list[Order] = []

    def make(order: Order) -> Worker:
        repeated.append(order)
        return FinishedWorker(order)

    feed.start_repeat(make)
    assert "repeating the run" in session.contacts_note
    feed.drain()
    assert feed.repeat is None
    assert session.contacts_note == ""
    assert [found.t_s for found in feed.tape.contacts] == [found.t_s for found in live.contacts]
    for found, expected in zip(feed.tape.contacts, live.contacts, strict=True):
        np.testing.assert_array_equal(found.forces_W, expected.forces_W)
    assert repeated[0].seed == 5
    session.ask_contacts(asked=True)  # known already: no process starts
    assert feed.repeat is None


class FinishedWorker(Worker):
    """Worker that has simulated its order within this process."""

    def __init__(self, order: Order) -> None:
        self._sent: list[Any] = []

        def send(message: Any) -> bool:
            self._sent.append(message)
            return True

        LiveRun(order, send, list).run()

    def receive(self) -> list[Any]:
        sent, self._sent = self._sent, []
        return sent

    def close(self) -> None:
        pass
