"""One simulated run: a resolved setup in, scores and (through a sink) a log out.

The mission receives the plant's sensors only; verdict and scores are computed from the ground truth of a simulator. A run on a
plant without ground truth has the verdicts of planner and guard, and no scores.
"""

import time
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float

from treadline.core.errors import SimulationDiverged
from treadline.core.kernel_cache import compiling
from treadline.core.models import ControllerDesign
from treadline.core.ports import Plant, Truth
from treadline.core.printing import Brief
from treadline.core.signals import TICK_S, Event, HeadingHealth, MotionPlan, StairMap
from treadline.mission.belt_controllers import Driver
from treadline.mission.loop import Blocks, GuardMessage, Mission, Signal, Tick
from treadline.mission.mission_blocks import warm_up
from treadline.run.ending import Ending, rough_cause
from treadline.run.resolve import Opener, PlantName, Setup, resolve
from treadline.run.run_scores import Scores, Trace, score
from treadline.scenario.faults import Fault, Message, Process, is_killed, stamp_of
from treadline.scenario.scenario import Scenario

MESSAGES = {StairMap: Message.MAP, MotionPlan: Message.PLAN, HeadingHealth: Message.HEALTH}
Sink = Callable[[Signal | Truth, float], None]
"""Receives every signal of a run, ground truth included, and the mission time at which it was taken [s]: a log."""
Watch = Callable[[Tick], None]
"""Receives each tick as it ends."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Traverse(Brief):
    """Result of one simulated run."""

    scenario: Scenario
    seed: int
    verdict: str
    """``arrived`` (on the landing or the floor), ``arrived_rough`` (there, but too rough for a passenger), ``end_of_flight`` (a run
    along one flight that ends at its last nosing), ``held``, ``held_rough``, ``refused``, ``fell``, ``time_up`` or
    ``diverged``."""
    cause: str | None
    scores: Scores | None
    """Scores by ground truth; None without ground truth."""
    trace: Trace
    """Ground truth; no rows without it."""
    estimate_rad: Float[np.ndarray, " T"]
    """Heading estimate at each tick [rad]; NaN before the first estimate."""
    phases: tuple[tuple[float, str], ...]
    """Start time [s] and name of each phase of the mission, known without ground truth."""
    events: tuple[Event, ...]
    cpu_s: float
    """CPU time of the run [s], without just-in-time compilation."""

    def summary(self) -> dict[str, Any]:
        """Return the run as JSON values, under the contract's keys."""
        duration_s = max(len(self.estimate_rad) - 1, 0) * TICK_S
        run = {"verdict": self.verdict, "cause": self.cause, "seed": self.seed, "duration_s": duration_s, "phases": self.phases}
        scores = {} if self.scores is None else asdict(self.scores)
        events = [asdict(event) for event in self.events]
        return run | scores | {"events": events, "real_time_factor": duration_s / max(self.cpu_s, 1e-9)}


def run_episode(
    setup: Setup,
    *,
    blocks: Blocks | None = None,
    sink: Sink | None = None,
    watch: Watch | None = None,
    after_hold_s: float = 0.0,
    plant: Plant | None = None,
    faults: Sequence[Fault] | None = None,
    attended: bool = False,
    pace: Callable[[float], None] | None = None,
) -> Traverse:
    """Return one run of a resolved setup.

    Args:
        blocks: The blocks to run, if they have been built already.
        plant: The plant to run on, if it has been made already.
        faults: Faults in the messages to the guard, which may grow during the run; those of the scenario when left out.
        attended: Whether a person may re-arm at any time: a hold does not end the run.
        sink: Receives every signal, ground truth included.
        watch: Receives each tick as it ends.
        after_hold_s: Time for which a held chair is simulated before the run ends [s].
        pace: Waits until the run may pass a time, for a viewer that pauses; a pause is no standstill of the loop.

    Raises:
        SettingsError: If a block cannot be built.
    """
    scenario = setup.scenario
    recorder = _EpisodeRecorder(scenario, setup.seed, sink)
    blocks = None if setup.refusal else blocks or setup.build_blocks()
    if setup.seat_shift is not None:
        recorder.log(Event(t_s=0.0, name="seat_shifted", cause=setup.seat_shift), 0.0)
    if setup.refusal:
        recorder.log(Event(t_s=0.0, name="refused", cause=setup.refusal), 0.0)
    plant = plant or setup.open_plant()
    faults = scenario.fault if faults is None else faults
    over: tuple[str, str | None] = ("refused", setup.refusal)
    started = time.process_time() - compiling().spent_s
    try:
        if blocks is None:
            plant.start()
            recorder.collect(plant)
        else:
            ending = Ending(scenario, setup.mission.chair, attended=attended)
            if not _is_virtual(plant):
                warm_up(setup.mission)
            over = _drive(ending, plant, blocks, recorder, watch, after_hold_s, faults, pace)
    except SimulationDiverged as error:
        over = over if setup.refusal else ("diverged", str(error))
    finally:
        plant.close()
    return recorder.result(over, time.process_time() - compiling().spent_s - started)


def rejected_run(setup: Setup) -> Traverse:
    """Return the result of a rejected scenario, without a simulation."""
    recorder, cause = _EpisodeRecorder(setup.scenario, setup.seed, None), "; ".join(setup.rejections)
    recorder.log(Event(t_s=0.0, name="refused", cause=cause), 0.0)
    return recorder.result(("refused", cause), 0.0)


def _drive(
    ending: Ending,
    plant: Plant,
    blocks: Blocks,
    recorder: "_EpisodeRecorder",
    watch: Watch | None,
    after_hold_s: float,
    faults: Sequence[Fault],
    pace: Callable[[float], None] | None,
) -> tuple[str, str | None]:
    """Run the mission to its end; return verdict and cause."""
    mission = Mission(plant, blocks, recorder.log, lambda t_s: is_killed(faults, Process.CONTROLLER, t_s), _stamper(faults))
    over: tuple[str, str | None] | None = None
    held_s = 0.0
    with nullcontext() if _is_virtual(plant) else mission.watchdog:
        while over is None or (over[0] == "held" and held_s < after_hold_s):
            tick = mission.tick()
            recorder.note(tick, plant)
            if watch is not None:
                watch(tick)
            if pace is not None:
                with mission.watchdog.paused():
                    pace(tick.t_s)
            if over is None:
                over = ending.verdict(recorder.last_truth, tick.plan, blocks.guard.holding)
            else:
                held_s += TICK_S
                last = recorder.last_truth
                over = over if last is None else ending.fall(last) or over
    return over


def _is_virtual(plant: Plant) -> bool:
    """Return whether the plant states that its time advances in ``advance`` alone."""
    return getattr(plant, "virtual_time", False) is True


def traverse(
    scenario: Scenario,
    *,
    controller: ControllerDesign | None = None,
    seed: int,
    driver: Driver | None = None,
    sink: Sink | None = None,
    watch: Watch | None = None,
    after_hold_s: float = 0.0,
    open_plant: Opener | PlantName = "mujoco",
) -> Traverse:
    """Resolve a scenario and return one simulated run, see ``run_episode``.

    Args:
        controller: Design of the controller; the one shipped for the vehicle when left out.
        driver: An experiment's own driver in place of the controller.
        open_plant: Simulator: its name, or a factory of the plant.

    Raises:
        SettingsError: If the scenario asks for what the chair cannot do.
    """
    setup = resolve(scenario, controller if driver is None else driver, seed, open_plant=open_plant)
    return run_episode(setup, sink=sink, watch=watch, after_hold_s=after_hold_s)


def _stamper(faults: Sequence[Fault]) -> Callable[[GuardMessage], GuardMessage]:
    """Return the function that stamps messages to the guard: the identity, or the one of an injected fault; a list may grow."""
    if isinstance(faults, tuple) and not any(fault.kind == "wrong_stamp" for fault in faults):
        return lambda message: message
    return lambda message: replace(message, t_s=stamp_of(faults, MESSAGES[type(message)], message.t_s))


class _EpisodeRecorder:
    """Recorder of one run: ground truth, estimates, phases and events."""

    def __init__(self, scenario: Scenario, seed: int, sink: Sink | None) -> None:
        self._scenario, self._seed, self._sink = scenario, seed, sink
        self._truth: list[Truth] = []
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

    @property
    def last_truth(self) -> Truth | None:
        """Ground truth of the last tick; None without ground truth."""
        return self._truth[-1] if self._truth else None

    def note(self, tick: Tick, plant: Plant) -> None:
        """Record one tick."""
        self._estimates.append(np.nan if tick.estimate is None else tick.estimate.heading_rad)
        if not self._phases or self._phases[-1][1] != tick.plan.phase:
            self._phases.append((tick.t_s, tick.plan.phase))
        self.collect(plant)

    def collect(self, plant: Plant) -> None:
        """Record the ground truth of the ticks since the last call, if the plant has any."""
        for sample in getattr(plant, "truth", tuple)():
            if sample.hull_contacts > 0.0 and not self._touched:
                self._touched = True
                self.log(
                    Event(t_s=sample.t_s, name="hull_contact", cause="hull, seat or passenger touches stair, wall or obstacle"),
                    sample.t_s,
                )
            self._truth.append(sample)
            if self._sink is not None:
                self._sink(sample, sample.t_s)

    def result(self, over: tuple[str, str | None], cpu_s: float) -> Traverse:
        """Return the run."""
        trace, phases = Trace.of(self._truth), tuple(self._phases)
        upward = self._scenario.drive.direction == "up"
        last = next((event for event in reversed(self._events) if event.name in ("hold", "rearmed")), None)
        held_s = last.t_s if last is not None and last.name == "hold" else None
        scores = score(trace, phases, upward=upward, held_s=held_s) if self._truth else None
        if over[0] in ("arrived", "held") and scores is not None and (rough := rough_cause(scores)) is not None:
            over = f"{over[0]}_rough", "; ".join(filter(None, (over[1], rough)))
        return Traverse(
            scenario=self._scenario,
            seed=self._seed,
            verdict=over[0],
            cause=over[1],
            scores=scores,
            trace=trace,
            estimate_rad=np.array(self._estimates),
            phases=phases,
            events=tuple(self._events),
            cpu_s=cpu_s,
        )
