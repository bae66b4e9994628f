"""One run, whole: a scenario, a seed and a driver in; scores, and a log if asked, out.

This is where the two worlds meet: the mission gets the plant's sensors, the scores get the plant's truth.
"""

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from treadline.angles import DEG
from treadline.errors import SettingsError, SimulationDiverged
from treadline.experiments.scores import Scores, Trace, score
from treadline.mechanics.chair import ChairDescription, read_chair
from treadline.mission.config import MissionConfig, build_blocks
from treadline.mission.drivers import Driver
from treadline.mission.loop import Mission, Signal, Tick
from treadline.mission.rates import TICK_S
from treadline.models import ControllerDesign
from treadline.ports import Truth, TruthPlant
from treadline.scenario import Scenario
from treadline.signals import Event
from treadline.sim import open_plant

FALLEN_RAD = 25.0 * DEG
"""Pitch away from the stair's slope, or roll, at which the chair counts as fallen."""

Sink = Callable[[Signal | Truth], None]
"""Takes all that happens in a run, truth included: a log."""
Watch = Callable[[Tick], None]
"""Sees each tick as it ends."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Traverse:
    """What a run came to."""

    scenario: Scenario
    seed: int
    verdict: str
    """``arrived``, ``held``, ``fell``, ``time_up`` or ``diverged``."""
    cause: str | None
    scores: Scores
    trace: Trace
    estimate_rad: Float[np.ndarray, " T"]
    """What the mission believed at each tick; NaN before it believed anything."""
    events: tuple[Event, ...]
    cpu_s: float

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
        pitch_m = float(np.hypot(scenario.stair.rise_m, scenario.stair.run_m))
        # The front pulley at the last nosing: crossing the crest is another manoeuvre.
        self._end_x_m = (scenario.stair.steps - 1) * pitch_m - 0.5 * chair.tracks.flat_run_m

    def verdict(self, truth: Truth, holding: str | None) -> tuple[str, str | None] | None:
        tilted = max(abs(truth.pitch_rad - self._slope_rad), abs(truth.roll_rad))
        if tilted > FALLEN_RAD:
            return "fell", f"tilted {tilted / DEG:.0f}° away from the stair at {truth.t_s:.2f} s"
        if holding is not None:
            return "held", holding
        if truth.x_m >= self._end_x_m:
            return "arrived", None
        if truth.t_s >= self._duration_s - 0.5 * TICK_S:
            return "time_up", None
        return None


def mission_config(scenario: Scenario, controller: ControllerDesign | None) -> MissionConfig:
    """Return what the operator would enter for this scenario: choices, files, and no truth."""
    chair = read_chair(scenario.chair.model)
    if scenario.start.place != "flight":
        raise SettingsError(
            f"start.place is '{scenario.start.place}'; this version starts on the flight only: set place = \"flight\""
        )
    if scenario.drive.direction != "up":
        raise SettingsError("drive.direction is 'down'; this version climbs only: set direction = \"up\"")
    if scenario.fault:
        raise SettingsError(f"fault.kind '{scenario.fault[0].kind}': this version injects no faults; remove [[fault]]")
    return MissionConfig(
        chair=chair,
        controller=controller,
        climb_speed_m_s=scenario.drive.speed_m_s,
        loop=scenario.control.loop,
        vision="paper" if scenario.control.vision == "paper" else "robust",
        allocation=scenario.control.allocation,
        reconstruct=scenario.control.reconstruct,
    )


def traverse(
    scenario: Scenario,
    *,
    controller: ControllerDesign | None = None,
    seed: int,
    driver: Driver | None = None,
    sink: Sink | None = None,
    watch: Watch | None = None,
) -> Traverse:
    """Return one run, driven by ``controller`` unless an experiment brings its own ``driver``.

    Raises:
        SettingsError: If the scenario asks for what this version cannot do.
    """
    config = mission_config(scenario, controller)
    blocks = build_blocks(config, driver)
    plant = open_plant(scenario, seed)
    truth: list[Truth] = []
    estimates: list[float] = []
    events: list[Event] = []

    def log(signal: Signal) -> None:
        if isinstance(signal, Event):
            events.append(signal)
        if sink is not None:
            sink(signal)

    started = time.process_time()
    ending = _Ending(scenario, config.chair)
    try:
        mission = Mission(plant, blocks, log)
        over: tuple[str, str | None] | None = None
        while over is None:
            tick = mission.tick()
            estimates.append(np.nan if tick.estimate is None else tick.estimate.heading_rad)
            _collect(plant, truth, sink)
            if watch is not None:
                watch(tick)
            over = ending.verdict(truth[-1], blocks.guard.holding)
    except SimulationDiverged as error:
        over = "diverged", str(error)
    finally:
        plant.close()
    trace = Trace.of(truth)
    return Traverse(
        scenario=scenario,
        seed=seed,
        verdict=over[0],
        cause=over[1],
        scores=score(trace),
        trace=trace,
        estimate_rad=np.array(estimates),
        events=tuple(events),
        cpu_s=time.process_time() - started,
    )


def _collect(plant: TruthPlant, truth: list[Truth], sink: Sink | None) -> None:
    for sample in plant.truth():
        truth.append(sample)
        if sink is not None:
            sink(sample)
