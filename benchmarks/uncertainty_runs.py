"""Runs of the uncertainty budget, and the one-at-a-time variations of plant, stair and numerics in which they are made.

A variation changes the plant alone: the mission keeps the nominal chair file and the weight that the operator entered, as in a
building where nobody has measured the friction.
"""

import itertools
import json
import math
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from treadline.core.angles import DEG
from treadline.core.errors import RecordError, SimulationDiverged
from treadline.core.files import write_whole
from treadline.core.models import ControllerDesign
from treadline.core.ports import TruthPlant
from treadline.core.printing import plain
from treadline.core.signals import SeatCommand, TrackCommand
from treadline.experiments import _dead_zone, _fig05, _lugs, as_printed, fig11, plan
from treadline.experiments._sensitivity import MAIN_SOURCES
from treadline.identification import IdentificationOptions, identify
from treadline.mission.belt_controllers import ConstantSpeed
from treadline.perception import StairDetector
from treadline.plant.mujoco import NOMINAL, MujocoPlant, Physics
from treadline.run.episode import traverse
from treadline.run.excitation_run import PERIOD_S, excite
from treadline.run.resolve import Opener, checked, ready
from treadline.scenario.chair import GRAVITY_M_S2, ChairDescription, read_chair
from treadline.scenario.scenario import Belts, DriveSettings, Scenario, Stair, Start, read_scenario
from treadline.scenario.shipped_files import shipped_controller


@dataclass(frozen=True, slots=True, kw_only=True)
class Variation:
    """One change of the plant; factors of 1 and shifts of 0 change nothing."""

    name: str
    group: str
    """Source of uncertainty; the largest move of a group counts."""
    physics: Physics = NOMINAL
    friction: tuple[float, float] = (1.0, 1.0)
    """Factors on the friction along the belt and across."""
    chassis: float = 1.0
    """Factor on the mass of the chassis."""
    payload: float = 1.0
    """Factor on the passenger's mass; the operator entered the nominal one."""
    com_m: tuple[float, float] = (0.0, 0.0)
    """Shift of the centre of mass, chassis and passenger alike: forward and up."""
    lag: float = 1.0
    """Factor on the lag of the belts' drives."""
    lug_phase: float = 0.0
    """Shift of both belts' lugs along the belt, as a share of the lug pitch; no effect on smooth belts."""
    seed: int = 0

    def scenario(self, nominal: Scenario) -> Scenario:
        """Return the scenario on this friction with this passenger."""
        along, across = nominal.stair.friction
        stair = nominal.stair.model_copy(update={"friction": (along * self.friction[0], across * self.friction[1])})
        entered = nominal.chair.entered.payload_kg
        weight = {"payload_kg": nominal.chair.payload_kg * self.payload, "entered_payload_kg": entered}
        return nominal.model_copy(update={"stair": stair, "chair": nominal.chair.model_copy(update=weight)})

    def chair(self, model: str) -> ChairDescription:
        """Return the chair as it is, where its file gives the nominal one."""
        nominal = read_chair(model)
        forward_m, up_m = self.com_m

        def moved(place: tuple[float, float, float]) -> tuple[float, float, float]:
            return place[0] + forward_m, place[1], place[2] + up_m

        masses, seat, drives = nominal.masses, nominal.levelled_seat, nominal.drives
        heavier = {"chassis_kg": masses.chassis_kg * self.chassis, "chassis_com_m": moved(masses.chassis_com_m)}
        return nominal.model_copy(
            update={
                "masses": masses.model_copy(update=heavier),
                "seat": seat.model_copy(update={"payload_com_m": moved(seat.payload_com_m)}),
                "drives": drives.model_copy(update={"lag_s": drives.lag_s * self.lag}),
            }
        )

    def opener(self, model: str) -> Opener:
        """Return what makes the varied plant of a scenario and a seed."""
        return partial(_ShiftedLugsPlant, chair=self.chair(model), physics=self.physics, lug_phase=self.lug_phase)


class _ShiftedLugsPlant(MujocoPlant):
    """Plant whose lugs start further along the belts than the seed puts them."""

    def __init__(self, scenario: Scenario, seed: int, chair: ChairDescription, physics: Physics, lug_phase: float) -> None:
        super().__init__(scenario, seed, chair, physics)
        pitch_m = self._lugs.parameters.pitch
        if self._lugs.parameters.height > 0.0:
            self._lugs.start_m[:] = (self._lugs.start_m + lug_phase * pitch_m) % pitch_m


NOMINAL_VARIATION = Variation(name="nominal", group="nominal")
SEED_GROUP = "seed"
"""Another seed: sensor noise and uneven steps alone. A move that is no larger is no effect of its source; not in the sum."""
COARSE_GROUP = "coarse step"
"""A step of 5 ms, the largest that the contact's nominal time constant allows; not in the sum. Steps of 4 ms do not fill a tick."""
PARTS_OF_FRICTION = ("friction along", "friction across")
"""Parts of the group friction, in which both change together; not in the sum."""
LUG_GROUP = "lug phase"
"""Phase of the lugs, on runs with lugs alone; a quarter and half of the lug pitch."""
MASS, COM_M, FRICTION = 0.1, 0.02, 0.2


def _friction(group: str, along: bool, across: bool) -> tuple[Variation, ...]:
    return tuple(
        Variation(
            name=f"{group} {100.0 * change:+.0f} %",
            group=group,
            friction=(1.0 + change * along, 1.0 + change * across),
        )
        for change in (-FRICTION, FRICTION)
    )


VARIATIONS = (
    NOMINAL_VARIATION,
    Variation(name="step 1 ms", group="step", physics=Physics(timestep_s=0.001)),
    Variation(name="step 2.5 ms", group="step", physics=Physics(timestep_s=0.0025)),
    Variation(name="contact 0.005 s", group="stiffness", physics=Physics(contact_time_constant_s=0.005)),
    Variation(name="contact 0.02 s", group="stiffness", physics=Physics(contact_time_constant_s=0.02)),
    *_friction("friction", along=True, across=True),
    Variation(name="seed 1", group=SEED_GROUP, seed=1),
    Variation(name="seed 2", group=SEED_GROUP, seed=2),
    Variation(name="residual 0.001 m/s²", group="residual", physics=Physics(tolerance_m_s2=0.001)),
    Variation(name="residual 0.1 m/s²", group="residual", physics=Physics(tolerance_m_s2=0.1)),
    Variation(name="3 solves", group="solves", physics=Physics(max_solves=3)),
    Variation(name="20 solves", group="solves", physics=Physics(max_solves=20)),
    *(Variation(name=f"chassis {s * 10:+d} %", group="chassis mass", chassis=1.0 + s * MASS) for s in (-1, 1)),
    *(Variation(name=f"passenger {s * 10:+d} %", group="passenger mass", payload=1.0 + s * MASS) for s in (-1, 1)),
    *(Variation(name=f"centre of mass {s * 2:+d} cm along", group="centre along", com_m=(s * COM_M, 0.0)) for s in (-1, 1)),
    *(Variation(name=f"centre of mass {s * 2:+d} cm up", group="centre up", com_m=(0.0, s * COM_M)) for s in (-1, 1)),
    Variation(name="drive lag ×0.5", group="lag", lag=0.5),
    Variation(name="drive lag ×2", group="lag", lag=2.0),
    *_friction("friction along", along=True, across=False),
    *_friction("friction across", along=False, across=True),
    Variation(name="step 5 ms", group=COARSE_GROUP, physics=Physics(timestep_s=0.005)),
    Variation(name="lugs a quarter pitch on", group=LUG_GROUP, lug_phase=0.25),
    Variation(name="lugs half a pitch on", group=LUG_GROUP, lug_phase=0.5),
)
SOURCES = tuple(dict.fromkeys(item.group for item in VARIATIONS if item is not NOMINAL_VARIATION))
SUMMED = tuple(group for group in SOURCES if group not in (SEED_GROUP, COARSE_GROUP, *PARTS_OF_FRICTION))
"""Independent sources, which enter the root sum of squares."""
CHAIR = "wheelchair"
START_DEG = 30
TURN_S, MINUTE_S, SAMPLES = 80.0, 60.0, 400
"""Duration of a turn, duration of a straight run and of a hold [s], and length of the identification record."""
LUGS = Belts(lug="15/80")
"""Lugs whose rubber has the plant's contact time constant, so that a variation of the contact stiffness reaches it."""
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
    scenario, refusal, _ = ready(asked := plan.without_images(nominal), checked(asked, read_chair(CHAIR)))
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


def _scored(
    nominal: Callable[[], Scenario], wanted: tuple[str, ...] = ("time_up",), controller: ControllerDesign | None = None
) -> Callable[[Variation], Outcome]:
    """Return the run of a scenario, see ``_driven``."""
    return lambda variation: _driven(variation, nominal(), wanted, controller)


def _turn(slope_deg: int, friction: plan.Friction, allocation: str = "climb-safe") -> Callable[[Variation], Outcome]:
    return _scored(lambda: plan.turn(slope_deg, START_DEG, TURN_S, friction=friction, allocation=allocation))


def _straight(loop: str) -> Callable[[Variation], Outcome]:
    return _scored(lambda: plan.straight(plan.FIG10_SLOPE, loop, MINUTE_S))


def _lugged_turn(slope_deg: int) -> Callable[[Variation], Outcome]:
    return _scored(lambda: _lugs.lugged_turn(slope_deg, LUGS))


def _seat(variation: Variation) -> Outcome:
    standing = fig11.at_rest(plan.turn(plan.FIG10_SLOPE, 0, fig11.DURATION_S))
    driver = ConstantSpeed(0.0, PERIOD_S)
    run = traverse(standing, seed=variation.seed, driver=driver, open_plant=_opener(variation))
    return ("ok", fig11.seat_figures(run.trace)) if run.verdict == "time_up" else (f"{run.verdict}: {run.cause}", {})


def _yaw_rates(variation: Variation) -> Outcome:
    opener = _opener(variation)
    starts = itertools.product(_dead_zone.HEADINGS_DEG, _dead_zone.DIFFERENCES_M_S)
    rows = [_dead_zone.row(heading, difference, variation.seed, opener) for heading, difference in starts]
    return "ok", {f"yaw_rate_{row['heading_deg']}_{row['difference_m_s']:g}": row["yaw_rate_deg_s"] for row in rows}


def _seen(variation: Variation) -> Outcome:
    """Return the error of the robust heading on the frame of Fig. 5; None where the frame is rejected."""
    frame, gravity_C, true_heading_rad = _fig05.first_frame(variation.seed, _opener(variation))
    heading_rad = StairDetector().look(frame, gravity_C).heading_rad
    return "ok", {"robust_error_deg": None if heading_rad is None else (heading_rad - true_heading_rad) / DEG}


def _identified(variation: Variation) -> Outcome:
    nominal = plan.without_images(plan.excitation(plan.CONTROLLER_GROUND))
    scenario = variation.scenario(nominal)
    record, run = excite(
        scenario,
        samples=SAMPLES,
        period_s=PERIOD_S,
        seed=variation.seed,
        open_plant=variation.opener(scenario.chair.model),
    )
    if len(record) < SAMPLES:
        return f"{run.verdict}: {run.cause}", {}
    report = identify(record, IdentificationOptions(method="okid-era")).report
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


def _creep(variation: Variation) -> Outcome:
    with closing(_braked(variation, float(plan.FIG10_SLOPE))) as plant:
        plant.advance(1.0)  # the contacts take up the load
        first_m = last_m = plant.truth()[-1].x_m
        for second in range(2, round(MINUTE_S) + 2):
            plant.advance(float(second))
            last_m = plant.truth()[-1].x_m
            if abs(last_m - first_m) > 0.5:  # m: the chair slides
                return "slides", {}
    return "ok", {"creep_mm_min": 1000.0 * abs(last_m - first_m) / (MINUTE_S / 60.0)}


def _slide(variation: Variation) -> Outcome:
    with closing(_braked(variation, SLIDE_DEG)) as plant:
        plant.advance(SLIDE_S)
        x_m = np.array([sample.x_m for sample in plant.truth()[-11:]])
    speed = float(x_m[0] - x_m[-1]) / 0.1
    along = 0.62 * variation.friction[0]
    slope = SLIDE_DEG * DEG
    # The speed over the last 0.1 s is that at its middle.
    theory = (SLIDE_S - 0.05) * GRAVITY_M_S2 * max(math.sin(slope) - along * math.cos(slope), 0.0)
    return "ok", {"slide_speed_m_s": speed, "slide_gap_m_s": speed - theory}


ARRIVED = ("arrived", "arrived_rough")
RUNS: dict[str, Callable[[Variation], Outcome]] = {
    **{f"turn-{slope}": _turn(slope, plan.PAPER_FRICTION) for slope in plan.SLOPES_DEG},
    "turn-28-mu0.9-0.5": _turn(plan.FIG10_SLOPE, plan.GOOD_GRIP),
    "straight-28": _straight("closed"),
    "excite-20": _identified,
    "up-28": _scored(lambda: read_scenario("up-28"), ARRIVED),
    "down-28": _scored(lambda: read_scenario("down-28"), ARRIVED),
    "creep-28": _creep,
    "slide-32.4": _slide,
}
"""Runs that are made in each variation."""
LUG_RUNS: dict[str, Callable[[Variation], Outcome]] = {
    **{f"turn-{slope}-lugs": _lugged_turn(slope) for slope in plan.SLOPES_DEG},
    "up-28-lugs": _scored(lambda: _lugs.lugged_traversal(LUGS), ARRIVED),
}
"""Runs with lugs, made in the variations of the main sources and of the lugs' phase."""
SIDE_RUNS: dict[str, Callable[[Variation], Outcome]] = {
    "turn-28-rollback": _turn(plan.FIG10_SLOPE, plan.PAPER_FRICTION, "paper"),
    "straight-28-open": _straight("open"),
    "as-printed-28": _scored(  # counts however it ends
        lambda: as_printed.as_printed_turn(TURN_S),
        ("time_up", "held", "held_rough", "fell"),
        as_printed.paper_controller(plan.TABLE_SPEED_M_S),
    ),
    "seat-28": _seat,
    "dead-zone-28": _yaw_rates,
    "frame-28": _seen,
}
"""Runs behind figures without a target, made in the variations of the main sources alone: step, stiffness, friction."""
ALL_RUNS = RUNS | LUG_RUNS | SIDE_RUNS


def runs_of(variation: Variation) -> tuple[str, ...]:
    """Return the names of the runs that are made in a variation."""
    if variation.group == LUG_GROUP:
        return tuple(LUG_RUNS)
    return tuple(ALL_RUNS if variation is NOMINAL_VARIATION or variation.group in MAIN_SOURCES else RUNS)


@dataclass(frozen=True, slots=True, kw_only=True)
class BudgetJob:
    """One run of one variation. Its outcome is kept in a file, so that an interrupted budget continues."""

    variation: Variation
    run_name: str
    folder: Path

    @property
    def title(self) -> str:
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
            verdict, figures = ALL_RUNS[self.run_name](self.variation)
        except (SimulationDiverged, RecordError) as error:
            verdict, figures = f"diverged: {error}", {}
        found = {"variation": self.variation.name, "run": self.run_name, "verdict": verdict, "figures": plain(figures)}
        self.path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(self.path, json.dumps(found, indent=1) + "\n")
        return found
