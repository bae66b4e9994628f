"""Runs of the uncertainty budget: turns, straight climbs, excitation, traversals, lugs, the seat, a braked chair and a slide."""

import itertools
import json
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from treadline.core.angles import DEG
from treadline.core.errors import RecordError, SimulationDiverged
from treadline.core.models import ControllerDesign, write_whole
from treadline.core.plain_values import plain
from treadline.core.ports import TruthPlant
from treadline.core.signals import SeatCommand, TrackCommand
from treadline.experiments import as_printed, dead_zone, fig05, fig11, lugs, plan
from treadline.experiments.variations import LUG_GROUP, MAIN_SOURCES, NOMINAL_VARIATION, Variation
from treadline.identification import IdentificationOptions, identify
from treadline.mission.belt_controllers import ConstantSpeed
from treadline.run.episode import FALLEN_SLIDE_M, traverse
from treadline.run.excitation_run import PERIOD_S, excite
from treadline.run.resolve import Opener, ready
from treadline.scenario.chair import GRAVITY_M_S2, read_chair
from treadline.scenario.controller_files import shipped_controller
from treadline.scenario.scenario import DriveSettings, Scenario, Stair, Start, read_scenario

CHAIR = "wheelchair"
START_DEG = 30
SLIDE_DEG = 32.4
"""0.6° beyond atan 0.62, the slope from which a braked chair slides."""
SLIDE_S = 3.0
SCORES = (
    "rms_heading_deg",
    "steady_rms_heading_deg",
    "final_heading_deg",
    "roll_back_m",
    "passenger_max_m_s2",
    "passenger_lateral_m_s2",
    "settle_s",
    "lateral_m",
    "max_pitch_rate_deg_s",
    "min_stability_margin_deg",
    "seat_max_deg",
    "max_belt_force_n",
    "airborne_share",
    "unconverged_share",
)
Outcome = tuple[str, dict[str, float | None]]
"""A verdict, ``ok`` where the run has its figures, and the figures."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Spans:
    """Durations [s] and the number of samples of the runs."""

    turn_s: float = 80.0
    straight_s: float = 60.0
    hold_s: float = 60.0
    samples: int = 400


WHOLE, QUICK = Spans(), Spans(turn_s=20.0, straight_s=10.0, hold_s=10.0, samples=120)


def _opener(variation: Variation) -> Opener:
    """Return what opens a scenario's plant with the variation in place, friction and passenger included."""

    def open_varied(scenario: Scenario, seed: int) -> TruthPlant:
        return variation.opener(scenario.chair.model)(variation.scenario(scenario), seed)

    return open_varied


def _driven(
    variation: Variation, nominal: Scenario, wanted: tuple[str, ...] = ("time_up",), controller: ControllerDesign | None = None
) -> Outcome:
    """Return the scores of a run, by the shipped controller unless one is given; a run with another verdict than wanted has none.

    The operator runs ``check`` on the nominal chair and friction, and shifts the seat for them.
    """
    scenario, refusal, _ = ready(plan.without_images(nominal), read_chair(CHAIR))
    if refusal is not None:
        return f"refused: {refusal}", {}
    scenario = variation.scenario(scenario.model_copy(update={"drive": scenario.drive.model_copy(update={"check": False})}))
    run = traverse(
        scenario,
        controller=controller or shipped_controller(CHAIR),
        seed=variation.seed,
        open_plant=variation.opener(scenario.chair.model),
    )
    if run.verdict not in wanted:
        return f"{run.verdict}: {run.cause}", {}
    return "ok", {name: getattr(run.scores, name) for name in SCORES}


def _turn(slope_deg: int, friction: plan.Friction, allocation: str = "climb-safe") -> Callable[[Variation, Spans], Outcome]:
    return lambda variation, spans: _driven(
        variation, plan.turn(slope_deg, START_DEG, spans.turn_s, friction=friction, allocation=allocation)
    )


def _straight(variation: Variation, spans: Spans) -> Outcome:
    return _driven(variation, plan.straight(plan.FIG10_SLOPE, "closed", spans.straight_s))


def _straight_open(variation: Variation, spans: Spans) -> Outcome:
    return _driven(variation, plan.straight(plan.FIG10_SLOPE, "open", spans.straight_s))


def _traversal(variation: Variation, spans: Spans, name: str) -> Outcome:
    del spans  # a traversal ends on arrival
    return _driven(variation, read_scenario(name), ("arrived",))


def _lugged_turn(variation: Variation, spans: Spans, slope_deg: int) -> Outcome:
    del spans
    return _driven(variation, lugs.lugged_turn(slope_deg, lugs.PLAIN_LUGS))


def _lugged_traversal(variation: Variation, spans: Spans) -> Outcome:
    del spans
    return _driven(variation, lugs.lugged_traversal(lugs.PLAIN_LUGS), ("arrived",))


def _as_printed(variation: Variation, spans: Spans) -> Outcome:
    """Return the scores of the printed controller; the run counts however it ends."""
    verdicts = ("time_up", "held", "fell")
    return _driven(variation, as_printed.as_printed_turn(spans.turn_s), verdicts, as_printed.paper_controller(plan.TABLE_SPEED_M_S))


def _seat(variation: Variation, spans: Spans) -> Outcome:
    del spans
    standing = fig11.at_rest(plan.turn(plan.FIG10_SLOPE, 0, fig11.DURATION_S))
    driver = ConstantSpeed(0.0, PERIOD_S)
    run = traverse(standing, seed=variation.seed, driver=driver, open_plant=_opener(variation))
    return ("ok", fig11.seat_figures(run.trace)) if run.verdict == "time_up" else (f"{run.verdict}: {run.cause}", {})


def _dead_zone(variation: Variation, spans: Spans) -> Outcome:
    del spans
    opener = _opener(variation)
    starts = itertools.product(dead_zone.HEADINGS_DEG, dead_zone.DIFFERENCES_M_S)
    rows = [dead_zone.row(heading, difference, variation.seed, opener) for heading, difference in starts]
    return "ok", {f"yaw_rate_{row['heading_deg']}_{row['difference_m_s']:g}": row["yaw_rate_deg_s"] for row in rows}


def _seen(variation: Variation, spans: Spans) -> Outcome:
    del spans
    return "ok", {"robust_error_deg": fig05.robust_error_deg(variation.seed, _opener(variation))}


def _identified(variation: Variation, spans: Spans) -> Outcome:
    nominal = plan.without_images(plan.excitation(plan.CONTROLLER_GROUND))
    scenario = variation.scenario(nominal)
    excited = excite(
        scenario,
        samples=spans.samples,
        period_s=PERIOD_S,
        seed=variation.seed,
        open_plant=variation.opener(scenario.chair.model),
    )
    if len(excited.record) < spans.samples:
        return f"{excited.run.verdict}: {excited.run.cause}", {}
    report = identify(excited.record, IdentificationOptions(method="okid-era")).report
    # The heading integrates: its pole lies near 1. The next one is the chair's and its drives'.
    poles = sorted((math.hypot(*pole) for pole in report.poles), reverse=True)
    return "ok", {
        "yaw_rate_vaf_percent": report.one_step_vaf_percent["yaw_rate_rad_s"],
        "yaw_rate_pole": poles[1] if len(poles) > 1 else None,
    }


def _braked(variation: Variation, slope_deg: float) -> TruthPlant:
    """Return a started plant on a flight, brakes on from the first tick."""
    scenario = Scenario(
        stair=Stair(slope_deg=slope_deg, run_m=0.30, steps=30, width_m=2.4),
        start=Start(place="flight", step=22),
        drive=DriveSettings(check=False),
    )
    scenario = variation.scenario(plan.without_images(scenario))
    plant = variation.opener(scenario.chair.model)(scenario, variation.seed)
    plant.start()
    plant.write(TrackCommand(t_s=0.0, left_m_s=0.0, right_m_s=0.0, brake=True), SeatCommand(t_s=0.0, rate_m_s=0.0))
    return plant


def _creep(variation: Variation, spans: Spans) -> Outcome:
    plant = _braked(variation, float(plan.FIG10_SLOPE))
    try:
        plant.advance(1.0)  # the contacts take up the load
        first_m = last_m = plant.truth()[-1].x_m
        for second in range(2, round(spans.hold_s) + 2):
            plant.advance(float(second))
            last_m = plant.truth()[-1].x_m
            if abs(last_m - first_m) > FALLEN_SLIDE_M:
                return "slides", {}
    finally:
        plant.close()
    return "ok", {"creep_mm_min": 1000.0 * abs(last_m - first_m) / (spans.hold_s / 60.0)}


def _slide(variation: Variation, spans: Spans) -> Outcome:
    del spans
    plant = _braked(variation, SLIDE_DEG)
    try:
        plant.advance(SLIDE_S)
        x_m = np.array([sample.x_m for sample in plant.truth()[-11:]])
    finally:
        plant.close()
    speed = float(x_m[0] - x_m[-1]) / 0.1
    along = 0.62 * variation.friction[0]
    slope = SLIDE_DEG * DEG
    # The speed over the last 0.1 s is that at its middle.
    theory = (SLIDE_S - 0.05) * GRAVITY_M_S2 * max(math.sin(slope) - along * math.cos(slope), 0.0)
    return "ok", {"slide_speed_m_s": speed, "slide_gap_m_s": speed - theory}


RUNS: dict[str, Callable[[Variation, Spans], Outcome]] = {
    **{f"turn-{slope}": _turn(slope, plan.PAPER_FRICTION) for slope in plan.SLOPES_DEG},
    "turn-28-mu0.9-0.5": _turn(plan.FIG10_SLOPE, plan.GOOD_GRIP),
    "straight-28": _straight,
    "excite-20": _identified,
    "up-28": partial(_traversal, name="up-28"),
    "down-28": partial(_traversal, name="down-28"),
    "creep-28": _creep,
    "slide-32.4": _slide,
}
"""Runs that are made in each variation."""
LUG_RUNS: dict[str, Callable[[Variation, Spans], Outcome]] = {
    **{f"turn-{slope}-lugs": partial(_lugged_turn, slope_deg=slope) for slope in plan.SLOPES_DEG},
    "up-28-lugs": _lugged_traversal,
}
"""Runs with lugs, made in the variations of the main sources and of the lugs' phase."""
SIDE_RUNS: dict[str, Callable[[Variation, Spans], Outcome]] = {
    "turn-28-rollback": _turn(plan.FIG10_SLOPE, plan.PAPER_FRICTION, "paper"),
    "straight-28-open": _straight_open,
    "as-printed-28": _as_printed,
    "seat-28": _seat,
    "dead-zone-28": _dead_zone,
    "frame-28": _seen,
}
"""Runs behind figures without a target, made in the variations of the main sources alone: step, stiffness, friction."""
ALL_RUNS = RUNS | LUG_RUNS | SIDE_RUNS


def runs_of(variation: Variation) -> tuple[str, ...]:
    """Return the names of the runs that are made in a variation."""
    if variation.group == LUG_GROUP:
        return tuple(LUG_RUNS)
    return tuple(ALL_RUNS if variation is NOMINAL_VARIATION or variation.group in MAIN_SOURCES else RUNS)


QUICK_RUNS = ("turn-28", "straight-28", "creep-28", "slide-32.4")


@dataclass(frozen=True, slots=True, kw_only=True)
class BudgetJob:
    """One run of one variation. Its outcome is kept in a file, so that an interrupted budget continues."""

    variation: Variation
    run_name: str
    spans: Spans
    folder: Path

    @property
    def name(self) -> str:
        """Variation and run."""
        return f"{self.variation.name}: {self.run_name}"

    @property
    def path(self) -> Path:
        """File of the outcome."""
        stem = "".join(letter if letter.isalnum() or letter in "+-." else "_" for letter in self.variation.name)
        return self.folder / stem / f"{self.run_name}.json"

    def run(self) -> dict[str, Any]:
        """Return ``variation``, ``run``, ``verdict`` and ``figures``."""
        if self.path.exists():
            return dict(json.loads(self.path.read_text(encoding="utf-8")))
        try:
            verdict, figures = ALL_RUNS[self.run_name](self.variation, self.spans)
        except (SimulationDiverged, RecordError) as error:
            verdict, figures = f"diverged: {error}", {}
        found = {"variation": self.variation.name, "run": self.run_name, "verdict": verdict, "figures": plain(figures)}
        self.path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(self.path, json.dumps(found, indent=1) + "\n")
        return found
