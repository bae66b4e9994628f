"""One run, whole: a scenario, a seed and a driver in; scores, and a log if asked, out.

This is where the two worlds meet: the mission gets the plant's sensors, the scores get the plant's truth.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float

from treadline.angles import DEG
from treadline.attendant import rearms_until_s
from treadline.compiling import compiling
from treadline.errors import SimulationDiverged
from treadline.estimation import HeadingHealth
from treadline.experiments.scores import Scores, Trace, score
from treadline.experiments.slide import LEVEL_RAD, SlideWatch
from treadline.faults import Fault, Message, Process, is_killed, stamp_of
from treadline.mechanics.chair import ChairDescription, read_chair
from treadline.mechanics.staircase import as_designed
from treadline.mechanics.verdict import check
from treadline.mission.config import MissionConfig, build_blocks, is_full_traversal
from treadline.mission.drivers import Driver
from treadline.mission.loop import GuardMessage, Mission, Signal, Tick
from treadline.models import ControllerDesign
from treadline.ports import Truth, TruthPlant
from treadline.scenario import Scenario
from treadline.signals import TICK_S, Event, MotionPlan, StairMap
from treadline.sim import open_plant as open_mujoco
from treadline.sim.faults import faulty

FALLEN_RAD = 25.0 * DEG
"""Pitch beyond the stair's slope or below level, or roll, at which the chair counts as fallen."""
FALLEN_SLIDE_M = 0.5
"""Slide down the flight beyond which the chair counts as fallen: a step and a half that nothing stopped."""
SEAT_SHIFT_M = 0.10
"""How far the seat may shift along the chair before a traversal, to gain the margin that ``check`` asks for."""

MESSAGES = {StairMap: Message.MAP, MotionPlan: Message.PLAN, HeadingHealth: Message.HEALTH}
Opener = Callable[[Scenario, int], TruthPlant]
"""Makes a scenario's plant from a seed."""
Sink = Callable[[Signal | Truth, float], None]
"""Takes a signal and the mission time at which it was taken [s]."""
"""Takes all that happens in a run, truth included: a log."""
Watch = Callable[[Tick], None]
"""Sees each tick as it ends."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Traverse:
    """What a run came to."""

    scenario: Scenario
    seed: int
    verdict: str
    """``arrived``, ``held``, ``refused``, ``fell``, ``time_up`` or ``diverged``."""
    cause: str | None
    scores: Scores
    trace: Trace
    estimate_rad: Float[np.ndarray, " T"]
    """What the mission believed at each tick; NaN before it believed anything."""
    events: tuple[Event, ...]
    cpu_s: float
    """Without what the first run on a machine compiles."""

    def summary(self) -> dict[str, Any]:
        """Return the run as JSON values, under the contract's keys."""
        return {
            "verdict": self.verdict,
            "cause": self.cause,
            "seed": self.seed,
            **asdict(self.scores),
            "events": [asdict(event) for event in self.events],
            "real_time_factor": self.scores.duration_s / max(self.cpu_s, 1e-9),
        }


class _Ending:
    """Says when a run is over, and how; the simulator's truth decides what the mission cannot know."""

    def __init__(self, scenario: Scenario, chair: ChairDescription) -> None:
        self._slope_rad = scenario.stair.slope_rad
        self._duration_s = scenario.drive.duration_s
        staircase = as_designed(scenario.stair, scenario.step)
        self._last_x_m = staircase.last_nosing_m
        # Where only a flight is driven, it is the first, and it ends with the front pulley at its last nosing.
        self._end_x_m = staircase.alone(0).last_nosing_m - 0.5 * chair.tracks.flat_run_m
        self._is_up = scenario.drive.direction == "up"
        self._slide = SlideWatch(upward=self._is_up)
        self._rearms_until_s = rearms_until_s(scenario.operator)

    def fall(self, truth: Truth) -> tuple[str, str] | None:
        """Return that the chair has tipped or slid, or None; takes every tick once."""
        above = max(truth.pitch_rad - self._slope_rad, -truth.pitch_rad, abs(truth.roll_rad))
        if above > FALLEN_RAD:
            return "fell", f"tilted {above / DEG:.0f}° beyond the stair at {truth.t_s:.2f} s"
        roll_back_m = self._slide.update(truth)
        return ("fell", f"slid {roll_back_m:.2f} m down the flight by {truth.t_s:.2f} s") if roll_back_m > FALLEN_SLIDE_M else None

    def verdict(self, truth: Truth, plan: MotionPlan, holding: str | None) -> tuple[str, str | None] | None:
        fallen = self.fall(truth)
        if fallen is not None:
            return fallen
        if holding is not None and truth.t_s >= self._rearms_until_s:
            return "held", holding
        if plan.phase == "arrived":
            if self._is_there(truth):
                return "arrived", None
            return "held", f"believed to have arrived at {truth.t_s:.2f} s, and has not"
        if plan.phase == "refused":
            return "refused", plan.cause
        if plan.phase == "drive" and self._is_up and truth.x_m >= self._end_x_m:
            return "arrived", None
        if truth.t_s >= self._duration_s - 0.5 * TICK_S:
            return "time_up", None
        return None

    def _is_there(self, truth: Truth) -> bool:
        """Say whether the chair lies level, mid-track beyond the flight's last nosing."""
        beyond_m = truth.x_m - self._last_x_m if self._is_up else -truth.x_m
        return abs(truth.pitch_rad) < LEVEL_RAD and beyond_m > 0.0


def mission_config(scenario: Scenario, controller: ControllerDesign | None) -> MissionConfig:
    """Return what the operator would enter for this scenario: choices, files, and no truth."""
    chair = with_seat_shifted(read_chair(scenario.chair.model), scenario.chair.seat_shift_m)
    return MissionConfig(
        chair=chair,
        controller=controller,
        direction=scenario.drive.direction,
        payload_kg=scenario.chair.entered.payload_kg,
        climb_speed_m_s=scenario.drive.speed_m_s,
        flights=scenario.stair.flights,
        loop=scenario.control.loop,
        vision="paper" if scenario.control.vision == "paper" else "robust",
        allocation=scenario.control.allocation,
        reconstruct=scenario.control.reconstruct,
    )


def with_seat_shifted(chair: ChairDescription, shift_m: float) -> ChairDescription:
    """Return the chair as its mission knows it: the seat where it has been shifted to."""
    x, y, z = chair.seat.hinge_m
    seat = chair.seat.model_copy(update={"hinge_m": (x + shift_m, y, z)})
    return chair.model_copy(update={"seat": seat})


def ready(scenario: Scenario, chair: ChairDescription) -> tuple[Scenario, str | None, str | None]:
    """Return the scenario with the seat where it is wanted, why the traversal is refused, and what was done to the seat.

    What ``treadline check`` says, before anything moves; only whole traversals ask for it.
    """
    report = check(scenario, chair)
    if report.verdict == "go":
        return scenario, None, None
    shift_m = report.proposed_seat_shift_m
    if shift_m is not None and abs(shift_m - scenario.chair.seat_shift_m) <= SEAT_SHIFT_M:
        moved = scenario.model_copy(update={"chair": scenario.chair.model_copy(update={"seat_shift_m": shift_m})})
        if check(moved, chair).verdict == "go":
            was = scenario.chair.seat_shift_m
            return moved, None, f"seat shifted by {(shift_m - was) * 1000.0:+.0f} mm along the chair: {report.reasons[0]}"
    return scenario, "; ".join(report.reasons), None


def refusals(scenario: Scenario, controller: ControllerDesign | None) -> list[str]:
    """Return why a run would be refused before it begins, empty if it may: experiments on the flight alone shift no seat."""
    chair = read_chair(scenario.chair.model)
    report = check(scenario, chair)
    if not scenario.drive.check or report.verdict == "go":
        return []
    is_mended = is_full_traversal(mission_config(scenario, controller), None) and ready(scenario, chair)[1] is None
    return [] if is_mended else list(report.reasons)


def traverse(
    scenario: Scenario,
    *,
    controller: ControllerDesign | None = None,
    seed: int,
    driver: Driver | None = None,
    sink: Sink | None = None,
    watch: Watch | None = None,
    after_hold_s: float = 0.0,
    open_plant: Opener = open_mujoco,
) -> Traverse:
    """Return one run, driven by ``controller`` unless an experiment brings its own ``driver``.

    Args:
        after_hold_s: How long a held chair is watched before the run ends.
        open_plant: Which simulator.

    Raises:
        SettingsError: If the scenario asks for what the chair cannot do.
    """
    config = mission_config(scenario, controller)
    shifted = refusal = None
    if is_full_traversal(config, driver) and scenario.drive.check:
        scenario, refusal, shifted = ready(scenario, read_chair(scenario.chair.model))
        config = mission_config(scenario, controller)
    blocks = build_blocks(config, driver)
    ride = _Ride(scenario, seed, sink)
    if shifted is not None:
        ride.log(Event(t_s=0.0, name="seat_shifted", cause=shifted), 0.0)
    if refusal is not None:
        ride.log(Event(t_s=0.0, name="refused", cause=refusal), 0.0)
    plant = faulty(open_plant(scenario, seed), scenario, seed)
    started = time.process_time() - compiling().spent_s
    ending = _Ending(scenario, config.chair)
    over: tuple[str, str | None] | None = None if refusal is None else ("refused", refusal)
    held_s = 0.0
    try:
        faults = scenario.fault
        mission = Mission(
            plant,
            blocks,
            ride.log,
            lambda t_s: is_killed(faults, Process.CONTROLLER, t_s),
            _stamper(faults),
        )
        if over is not None:
            ride.collect(plant)
        while over is None or (over[0] == "held" and held_s < after_hold_s):
            tick = mission.tick()
            ride.note(tick, plant)
            if watch is not None:
                watch(tick)
            if over is None:
                over = ending.verdict(ride.truth[-1], tick.plan, blocks.guard.holding)
            else:
                held_s += TICK_S
                over = ending.fall(ride.truth[-1]) or over
    except SimulationDiverged as error:
        # A start that is refused may also be one in which no chair can be put down.
        over = ("diverged", str(error)) if refusal is None else ("refused", refusal)
    finally:
        plant.close()
    return ride.result(over, time.process_time() - compiling().spent_s - started)


def _stamper(faults: Sequence[Fault]) -> Callable[[GuardMessage], GuardMessage]:
    """Return what stamps messages to the guard: as they are, or as a fault has it."""
    if not any(fault.kind == "wrong_stamp" for fault in faults):
        return lambda message: message
    return lambda message: replace(message, t_s=stamp_of(faults, MESSAGES[type(message)], message.t_s))


class _Ride:
    """What is kept of a run as it goes."""

    def __init__(self, scenario: Scenario, seed: int, sink: Sink | None) -> None:
        self._scenario, self._seed, self._sink = scenario, seed, sink
        self.truth: list[Truth] = []
        self._estimates: list[float] = []
        self._phases: list[tuple[float, str]] = []
        self._events: list[Event] = []
        self._touched = False

    def log(self, signal: Signal, taken_s: float) -> None:
        """Record a signal of the mission, taken at ``taken_s``."""
        if isinstance(signal, Event):
            self._events.append(signal)
        if self._sink is not None:
            self._sink(signal, taken_s)

    def note(self, tick: Tick, plant: TruthPlant) -> None:
        """Take one tick."""
        self._estimates.append(np.nan if tick.estimate is None else tick.estimate.heading_rad)
        if not self._phases or self._phases[-1][1] != tick.plan.phase:
            self._phases.append((tick.t_s, tick.plan.phase))
        self.collect(plant)

    def collect(self, plant: TruthPlant) -> None:
        """Take the truth of the ticks that have passed."""
        for sample in plant.truth():
            if sample.hull_contacts > 0.0 and not self._touched:
                self._touched = True
                self.log(
                    Event(t_s=sample.t_s, name="hull_contact", cause="hull, seat or passenger touches stair, wall or obstacle"),
                    sample.t_s,
                )
            self.truth.append(sample)
            if self._sink is not None:
                self._sink(sample, sample.t_s)

    def _held_s(self) -> float | None:
        """Return the time of the last hold, unless a person re-armed after it."""
        last = next((event for event in reversed(self._events) if event.name in ("hold", "rearmed")), None)
        return last.t_s if last is not None and last.name == "hold" else None

    def result(self, over: tuple[str, str | None], cpu_s: float) -> Traverse:
        """Return the run."""
        trace = Trace.of(self.truth)
        return Traverse(
            scenario=self._scenario,
            seed=self._seed,
            verdict=over[0],
            cause=over[1],
            scores=score(trace, tuple(self._phases), upward=self._scenario.drive.direction == "up", held_s=self._held_s()),
            trace=trace,
            estimate_rad=np.array(self._estimates),
            events=tuple(self._events),
            cpu_s=cpu_s,
        )
