"""Inject each fault in each phase, up and down, with several seeds, and compare the outcome with the table of hazards.

Run: ``python benchmarks/faults.py`` (about an hour of CPU with five seeds), ``--quick`` for one seed of one load, ``--kinds
camera_lost flipper_lost`` or ``--phases crest edge`` for a part, ``--rest 60`` for the whole minute of rule H, ``--out FOLDER``
for a scenario file of each violation. A fault-free run with the same seed determines when each phase begins and ends. The fault
starts in the middle of the phase (``--place`` sets another place). The statistical camera, which renders no images, is used;
``false_edges``, which falsifies pixels only, is left out.

``--pairs 500 --seed 1`` draws pairs of faults instead, from the same table: two rows with their sizes and durations, load,
direction, phase and place of the first fault, and when the second begins: while the first acts, or up to three seconds after.
Number n of seed S is the same pair in each list. A pair is judged by what holds for any fault: no fall, commands finite and within
the limits of table and chair file, pitch rate, seat, roll-back, a HOLD that stays, rule H, and the times of an operator's stop.
Two faults that both take friction are not drawn together: no brake holds the chair on what they leave.

Rule H is checked where the friction allows a chair to hold. A chair that brakes at once slides away at a friction of 1.03 times the
slope's tangent (with one belt weaker than the other it also turns, and falls) and stands at 1.05. The slip faults here therefore
keep a mean of 1.05 (both belts) and 1.08 (one belt). The static margin under HOLD is judged on the flight and on flat ground. While
the chair pitches over the crest or the top entry it stands on its flipper's tip, and a dead flipper lowers the chair by design:
the pitch rate is judged there.
"""

import argparse
import itertools
import math
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from tables import table

from treadline.campaign._results import clopper_pearson
from treadline.campaign.spec import scenario_toml
from treadline.core.angles import DEG
from treadline.core.processes import default_workers
from treadline.core.signals import TICK_S, FlipperCommand, HeadingEstimate, SeatCommand, TrackCommand
from treadline.experiments._job_pool import JobPool
from treadline.guard import TIPPING
from treadline.plant.mujoco import open_plant
from treadline.run.episode import Traverse, traverse
from treadline.scenario.chair import read_chair
from treadline.scenario.faults import Fault, Process
from treadline.scenario.scenario import Chair, DriveSettings, Scenario, Sensors, Stair, Start
from treadline.scenario.shipped_files import shipped_controller

STEPS = 8
FRICTION_OF_TANGENT = 1.166
"""Ratio of the friction along the belt to the slope's tangent: the default of 0.62 at 28°."""
SETTLED_S = 0.5
"""Settling time after a hold [s], within which the chair comes to rest; rule H applies afterwards."""
LIMITS = {"back m": 0.30, "rate °/s": 20.0, "slide mm": 20.0, "turn °": 2.0}
"""Largest figures with any fault, from the table of hazards; slide and turn are those of a held chair (rule H)."""
SEAT_DEG, MARGIN_DEG = 5.0, 7.0
MOVING_M_S = 0.02
CLEAR_M = 0.3
"""Least distance to an obstacle in the path [m]."""
AFTERWARDS_S = 3.0
"""Time that a run continues after the end of the fault [s]."""
HEARD_S = 0.12
"""Longest time from an operator stop to the zero command [s]: the handset sends at 10 Hz, and the loop adds a tick."""
RAMP_S = 0.32
"""Longest time from a HOLD to zero speed and brake [s]: a ramp of 0.3 s, and two ticks."""
COMMANDED_M_S = {"belt": 1.0, "square": 0.30, "turning": 0.55}
"""Largest command of one belt, and largest mean of a square chair and of one that turns, likewise."""
SQUARE_DEG = 5.0
DECLARED = ("slow", "hold", "re-referenced", "vision_dim", "back_off", "refused")
"""Events that count as detection of a fault."""


class Leg(NamedTuple):
    """Where a run starts, and the phases that it is there for."""

    direction: str
    place: str
    step: int
    heading_deg: float
    phases: tuple[str, ...]


LEGS = (
    Leg("up", "floor", 0, 15.0, ("align", "approach", "mount", "traction")),
    Leg("up", "flight", 3, 0.0, ("climb", "crest", "land")),
    Leg("down", "landing", 0, 15.0, ("align", "approach", "edge")),
    Leg("down", "flight", 7, 0.0, ("descend", "leave")),
)


class Load(NamedTuple):
    """Who sits in the chair, and on what slope."""

    payload_kg: float
    slope_deg: float


LOADS = (Load(50.0, 28.0), Load(80.0, 30.0))


class Case(NamedTuple):
    """A fault, and what its row of the table accepts; times from the fault's beginning."""

    row: str
    kind: str
    value: float = 0.0
    for_s: float = 10.0
    also: "tuple[Case, float] | None" = None
    """A second fault, and how much later it begins [s]."""
    ends: tuple[str, ...] = ("held",)
    found_s: float = math.inf
    held_s: float = math.inf
    still_s: float = math.inf
    heading_deg: float = 6.0
    seat_deg: float = SEAT_DEG
    beyond_sound: bool = False
    """Whether the heading error is judged by its increase over the fault-free run, as where no stair is in view."""
    moving: bool = False
    """Whether the fault is observable only while the chair moves; times then count from the start of the belts."""

    @property
    def name(self) -> str:
        """Return what its line is called."""
        value = f" {self.value:g}" if self.value else ""
        return f"{self.kind}{value}" + (f" + {self.also[0].name} after {self.also[1]:g} s" if self.also else "")

    def parts(self, at_s: float) -> Iterator[tuple["Case", float]]:
        """Yield each single fault and when it begins [s]."""
        yield self, at_s
        if self.also:
            yield from self.also[0].parts(at_s + self.also[1])


ANY = ("held", "refused", "time_up", "arrived")
ON = ("time_up", "arrived")
CASES = (
    Case("1", "camera_lost", found_s=0.4, held_s=3.5),
    Case("2", "camera_frozen", found_s=0.4, held_s=3.9),
    Case("3", "camera_dark", 0.02, 3.0, ends=ON, heading_deg=3.0, beyond_sound=True),
    Case("3", "camera_dark", -0.02, found_s=0.4, held_s=3.5),
    Case("4", "depth_holes", 0.4, 5.0, ends=ON, heading_deg=2.0, beyond_sound=True),
    Case("4", "depth_holes", 0.95, 10.0, ends=ANY, heading_deg=5.0),
    Case("6", "imu_nan", found_s=0.3, held_s=1.3),
    Case("6", "imu_lost", found_s=0.3, held_s=1.3),
    Case("7", "imu_bias", 1.0, 6.0, ends=ANY, heading_deg=5.0),
    Case("7", "imu_bias", 5.0, 3.0, ends=ANY, heading_deg=5.0),
    Case("7", "imu_bias", 20.0, 3.0, ends=ANY, found_s=0.5, heading_deg=5.0),
    Case("7", "imu_bias", -30.0, 3.0, ends=ANY, found_s=0.5, heading_deg=5.0),
    Case("8", "imu_stuck", found_s=0.3, held_s=1.3, moving=True),
    Case("9", "camera_lost", also=(Case("9", "imu_lost"), 0.0), held_s=0.5),
    Case("10", "clock_back", 0.5, 3.0, ends=ANY),
    Case("10", "clock_back", 2.0, 3.0, held_s=0.5),
    Case("11", "late_tick", 0.5, 3.0, still_s=0.8),
    Case("13", "track_stalled", 0.0, held_s=0.6, heading_deg=8.0, moving=True),
    Case("13", "track_stalled", 1.0, held_s=0.6, heading_deg=8.0, moving=True),
    Case("13", "readings_lost", held_s=0.6),
    Case("14", "track_slip", 0.85, 6.0, ends=ANY, heading_deg=8.0),
    Case("14", "track_slip", -0.85, 6.0, ends=ANY, heading_deg=8.0),
    Case("14", "low_friction", 0.90, 6.0, ends=ANY),
    Case("19", "seat_stuck", 0.0, 15.0, ends=ANY, seat_deg=10.0),
    Case("21", "operator_stop", 0.0, 3.0, held_s=HEARD_S, still_s=0.5),
    Case("21", "operator_stop", 1.0, 3.0, held_s=HEARD_S, still_s=0.5),
    Case("21", "link_lost", 0.0, 3.0, held_s=0.45, still_s=0.9),
    Case("22", "process_killed", Process.MISSION, ends=ANY, still_s=0.8),
    Case("22", "process_killed", Process.PERCEPTION, found_s=0.4, held_s=3.5),
    Case("22", "process_killed", Process.CONTROLLER, held_s=0.8, still_s=1.2),
    Case("22", "process_killed", Process.SEAT, 15.0, ends=ANY, seat_deg=10.0),
    Case("24", "power_cut", 0.0, 3.0, ends=ANY, still_s=0.3),
    Case("25", "obstacle", 1.2, 60.0, ends=ANY),
    Case("18", "flipper_lost", 0.0, 60.0, ends=ANY),
    Case("18", "flipper_stuck", 0.0, 60.0, ends=ANY),
)
PAIR = "two faults"
"""Row of a pair."""
GRIP = {"track_slip", "low_friction"}


def _pair_of(rng: np.random.Generator) -> Case:
    """Return two faults, judged by what holds for any fault."""
    single = [case for case in CASES if not case.also]
    first, second = (single[i] for i in rng.choice(len(single), 2, replace=False))
    if {first.kind, second.kind} <= GRIP:
        return _pair_of(rng)
    delay_s = round(rng.uniform(0.0, min(first.for_s, 10.0) + AFTERWARDS_S), 2)
    seat_deg = max(first.seat_deg, second.seat_deg)
    return Case(PAIR, first.kind, first.value, first.for_s, (second, delay_s), ANY, heading_deg=math.inf, seat_deg=seat_deg)


def scenario_of(leg: Leg, load: Load, duration_s: float, faults: Sequence[Fault] = ()) -> Scenario:
    """Return one run's scenario."""
    along = round(FRICTION_OF_TANGENT * math.tan(load.slope_deg * DEG), 3)
    stair = {"slope_deg": load.slope_deg, "steps": STEPS, "landing_m": 3.0, "friction": (along, round(along / 1.24, 3))}
    return Scenario(
        stair=Stair.model_validate(stair),
        chair=Chair(payload_kg=load.payload_kg),
        start=Start.model_validate({"place": leg.place, "step": leg.step, "heading_deg": leg.heading_deg}),
        drive=DriveSettings.model_validate({"direction": leg.direction, "duration_s": duration_s}),
        sensors=Sensors(camera="statistical"),
        fault=tuple(faults),
    )


class Place(NamedTuple):
    """A phase of a run without a fault."""

    leg: Leg
    load: Load
    seed: int
    phase: str
    begin_s: float
    end_s: float
    heading_deg: np.ndarray
    """Size of the heading error in the whole run, tick by tick."""

    def at_s(self, share: float) -> float:
        """Return when a share of the phase has passed."""
        return round((1.0 - share) * self.begin_s + share * self.end_s, 2)

    def growth_deg(self, at_s: float, ticks: int) -> float:
        """Return how much the heading error grows without a fault."""
        after = self.heading_deg[round(at_s / TICK_S) :][:ticks]
        return float(after.max() - after[0])


def _undisturbed(start: tuple[Leg, Load, int]) -> list[Place]:
    """Return the phases of a run without a fault."""
    leg, load, seed = start
    scenario = scenario_of(leg, load, 90.0)
    ride = traverse(scenario, controller=shipped_controller(scenario.chair.model), seed=seed)
    begins = [*ride.scores.phases, (ride.scores.duration_s, "")]
    spans = {phase: (begin_s, end_s) for (begin_s, phase), (end_s, _) in reversed([*itertools.pairwise(begins)])}
    heading_deg = np.abs(ride.trace["heading_rad"]) / DEG
    return [Place(leg, load, seed, phase, *spans[phase], heading_deg) for phase in leg.phases if phase in spans]


class Outcome(NamedTuple):
    """What became of one run, from its fault on."""

    job: "Disturbed"
    verdict: str
    cause: str
    figures: dict[str, float]
    """The columns of the table; heading is the largest error after the start of the fault, less the error at its start."""
    hold_s: float
    """Time of the HOLD in the run [s]."""
    rest_phase: str
    """Phase in which the chair came to be held, or the run ended."""
    toml: str
    faulty: tuple[str, ...] = ()
    """Limits of the table that the run violates."""


class _Commanded:
    """The commands of a run as the plant receives them: what breaks a limit, and when the belts are not braked at rest."""

    def __init__(self, model: str) -> None:
        chair = read_chair(model)
        self._seat_m_s = 0.0 if chair.seat is None else chair.seat.max_rate_m_s
        self._flipper_rad_s = 0.0 if chair.flipper is None else chair.flipper.max_rate_deg_s * DEG
        self._mean = "turning"
        self.beyond: list[str] = []
        self.driven_s: list[float] = []

    def take(self, signal: object, taken_s: float) -> None:
        """Compare a command with its limits."""
        match signal:
            case HeadingEstimate():
                self._mean = "square" if abs(signal.heading_rad) <= SQUARE_DEG * DEG else "turning"
            case TrackCommand(left_m_s=left, right_m_s=right):
                if left or right or not signal.brake:
                    self.driven_s.append(taken_s)
                self._check("left belt", left, COMMANDED_M_S["belt"], taken_s)
                self._check("right belt", right, COMMANDED_M_S["belt"], taken_s)
                self._check(f"{self._mean} chair", 0.5 * (left + right), COMMANDED_M_S[self._mean], taken_s)
            case SeatCommand():
                self._check("seat", signal.rate_m_s, self._seat_m_s, taken_s)
            case FlipperCommand():
                self._check("flipper", signal.rate_rad_s, self._flipper_rad_s, taken_s)
            case _:
                pass

    def _check(self, what: str, value: float, limit: float, taken_s: float) -> None:
        if not abs(value) <= limit + 1e-9:
            self.beyond.append(f"{what} command {value:g} at {taken_s:.2f} s, {limit:g} allowed")


class Disturbed(NamedTuple):
    """A run with one fault, or two."""

    case: Case
    place: Place
    seed: int
    at_s: float
    rest_s: float

    @property
    def title(self) -> str:
        """Return a word for the progress line."""
        at, load = self.place, self.place.load
        where = f"{at.phase} {at.leg.direction}, {load.payload_kg:g} kg at {load.slope_deg:g}°"
        return f"{self.case.row}: {self.case.name} in {where}, seed {self.seed}"

    def run(self) -> Outcome:
        """DriveSettings, and judge."""
        faults = [
            Fault.model_validate({"kind": one.kind, "value": one.value, "at_s": at_s, "for_s": one.for_s})
            for one, at_s in self.case.parts(self.at_s)
        ]
        duration_s = max(fault.at_s + min(fault.for_s, 30.0) for fault in faults) + AFTERWARDS_S
        scenario = scenario_of(self.place.leg, self.place.load, duration_s, faults)
        commanded = _Commanded(scenario.chair.model)
        gaps_m: list[float | None] = []
        plant = open_plant(scenario, self.seed)
        ride = traverse(
            scenario,
            controller=shipped_controller(scenario.chair.model),
            seed=self.seed,
            sink=commanded.take,
            watch=lambda _: gaps_m.append(plant.gap_m),
            after_hold_s=SETTLED_S + self.rest_s + faults[-1].at_s - self.at_s,
            open_plant=lambda _, __: plant,
        )
        seen = self._seen(ride, scenario)
        wrong = [*self._wrong(seen, ride.scores.duration_s - self.at_s), *commanded.beyond[:1]]
        wrong += self._driven(seen, commanded.driven_s)
        gap_m = min((gap for gap in gaps_m if gap is not None), default=math.inf)
        if gap_m < CLEAR_M and self.case.row != PAIR:
            wrong.append(f"{gap_m:.2f} m before what stands in the way, {CLEAR_M:g} wanted")
        return seen._replace(faulty=tuple(wrong))

    def _driven(self, seen: Outcome, driven_s: Sequence[float]) -> Iterator[str]:
        """Yield where the belts are commanded although they must not be any more: after a HOLD, and after an operator's stop."""
        parts = list(self.case.parts(self.at_s))
        late_s = sum(one.value for one, _ in parts if one.kind == "late_tick")
        due = [(f"the {one.kind}", at_s + one.held_s + RAMP_S + late_s) for one, at_s in parts if one.row == "21"]
        for what, due_s in [*due, ("the hold", seen.hold_s + RAMP_S)]:
            if driven_s and driven_s[-1] > due_s + 1e-6:
                yield f"belts driven at {driven_s[-1]:.2f} s, {driven_s[-1] - due_s:.2f} s too long after {what}"

    def _seen(self, ride: Traverse, scenario: Scenario) -> Outcome:
        # The event of a missing sample carries the time of the previous sample.
        declared = [(event.t_s, event.name) for event in ride.events if event.t_s >= self.at_s - 1.5 * TICK_S]
        held_s = next((t_s for t_s, name in declared if name == "hold"), math.nan)
        last = len(ride.trace["t_s"]) - 1  # a chair of another seed may arrive before its first fault
        after = slice(min(round(self.at_s / TICK_S), last), None)
        trace = {name: column[after] for name, column in ride.trace.columns.items()}
        rest = slice(None) if math.isnan(held_s) else slice(round((held_s - self.at_s + SETTLED_S) / TICK_S), None)
        x, y, heading = trace["x_m"][rest], trace["y_m"][rest], trace["heading_rad"][rest]
        rests = not math.isnan(held_s) and len(x) > 0
        phases = [phase for begin_s, phase in ride.scores.phases if not begin_s > held_s]
        moving = np.flatnonzero((np.abs(trace["left_m_s"]) > 1e-3) | (np.abs(trace["right_m_s"]) > 1e-3))
        runs = np.flatnonzero(np.maximum(np.abs(trace["left_m_s"]), np.abs(trace["right_m_s"])) > MOVING_M_S)
        due_s = self.at_s + (int(runs[0]) * TICK_S if self.case.moving and runs.size else 0.0)
        onward = trace["x_m"] if self.place.leg.direction == "up" else -trace["x_m"]
        backs_s = next((t_s - self.at_s for t_s, name in declared if name == "back_off"), math.inf)
        onward = onward[: max(round(min(backs_s / TICK_S, len(onward))), 1)]  # backing off is commanded motion, not a slide
        figures = {
            "found s": next((t_s - due_s for t_s, name in declared if name in DECLARED), math.nan),
            "held s": held_s - due_s,
            "still s": (int(moving[-1]) + 1) * TICK_S if moving.size else 0.0,
            "slide mm": 1000.0 * float(np.hypot(x - x[0], y - y[0]).max()) if rests else math.nan,
            "turn °": float(np.ptp(heading)) / DEG if rests else math.nan,
            "margin °": float(trace["stability_margin_rad"][rest].min()) / DEG if rests else math.nan,
            "back m": float((np.maximum.accumulate(onward) - onward).max()),
            "heading °": float(np.abs(trace["heading_rad"]).max() - abs(trace["heading_rad"][0])) / DEG
            - (self.place.growth_deg(self.at_s, len(trace["heading_rad"])) if self.case.beyond_sound else 0.0),
            "rate °/s": float(np.abs(trace["pitch_rate_rad_s"]).max()) / DEG,
            "seat °": float(np.abs(trace["seat_pitch_rad"]).max()) / DEG,
        }
        toml = scenario_toml(scenario, f"{self.title}: {ride.verdict}, {ride.cause}")
        return Outcome(self, ride.verdict, ride.cause or "", figures, held_s, phases[-1], toml)

    def _wrong(self, seen: Outcome, after_s: float) -> Iterator[str]:
        case = self.case
        # It may be there before its time is up.
        in_time = seen.verdict == "arrived" and not case.moving and after_s <= case.held_s
        if seen.verdict.replace("held_rough", "held") not in case.ends and not in_time:
            yield f"{seen.verdict} ({seen.cause})"
        limits = {"found s": case.found_s, "held s": case.held_s, "still s": case.still_s}
        limits |= LIMITS | {"heading °": case.heading_deg, "seat °": case.seat_deg}
        pitches = seen.rest_phase in TIPPING
        if pitches and any(one.kind == "flipper_lost" for one, _ in case.parts(self.at_s)):
            del limits["slide mm"], limits["turn °"]
        for figure, limit in limits.items():
            value = seen.figures[figure]
            is_missing = figure in ("found s", "held s") and math.isnan(value) and limit < math.inf and not in_time
            if value > limit + 1e-6 or is_missing:
                yield f"{figure} {value:.2f}, {limit:g} allowed"
        if not pitches and seen.figures["margin °"] < MARGIN_DEG:
            yield f"margin {seen.figures['margin °']:.1f}°, {MARGIN_DEG:g} wanted"


def report(outcomes: Sequence[Outcome]) -> None:
    """Print the worst figures of each fault in each phase."""
    cells: dict[tuple[str, str, str], list[Outcome]] = defaultdict(list)
    for outcome in outcomes:
        case, at = outcome.job.case, outcome.job.place
        cells[case.row, "" if case.row == PAIR else case.name, f"{at.phase} {at.leg.direction}"].append(outcome)
    rows = []
    for key, cell in cells.items():
        worst = []
        for figure in cell[0].figures:
            values = [one.figures[figure] for one in cell if not math.isnan(one.figures[figure])]
            worst.append((min if figure == "margin °" else max)(values, default=math.nan))
        ends = ", ".join(f"{verdict} {count}" for verdict, count in Counter(one.verdict for one in cell).items())
        rows.append([*key, *(f"{value:.2f}" for value in worst), ends + ("  <-" if any(one.faulty for one in cell) else "")])
    table("Worst figures", ["row", "fault", "phase", *outcomes[0].figures, "ends"], rows)


def _jobs(asked: argparse.Namespace, pool: JobPool) -> Iterator[Disturbed]:
    """Yield the runs: a pair of faults for each number, or each case in each phase."""
    seeds = range(1 if asked.quick or asked.pairs else asked.seeds)
    loads = [(LOADS[0], seed) for seed in seeds] + ([] if asked.quick else [(LOADS[1], 0)])
    starts = [(leg, load, seed) for load, seed in loads for leg in LEGS if set(asked.phases) & set(leg.phases)]
    places = [place for run in pool.map("no fault", _undisturbed, starts) for place in run if place.phase in asked.phases]
    for number in range(asked.pairs):
        rng = np.random.default_rng((asked.seed, number))
        place = places[rng.integers(len(places))]
        at_s = place.at_s(rng.random())
        yield Disturbed(_pair_of(rng), place, number, at_s, asked.rest)
    for case in CASES if not asked.pairs else ():
        if case.kind in asked.kinds:
            yield from (Disturbed(case, at, at.seed, at.at_s(share), asked.rest) for at in places for share in asked.place)


def main() -> None:
    """Run all cases and report the outcomes."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--quick", action="store_true", help="one seed, the first load")
    parser.add_argument("--pairs", type=int, default=0, help="this many random pairs of faults, instead of each fault by itself")
    parser.add_argument("--seed", type=int, default=1, help="of the pairs")
    parser.add_argument("--kinds", nargs="*", default={case.kind for case in CASES}, help="as in a scenario's [[fault]]")
    parser.add_argument("--phases", nargs="*", default={phase for leg in LEGS for phase in leg.phases})
    parser.add_argument("--place", nargs="*", type=float, default=[0.5], help="where in a phase, 0 to 1")
    parser.add_argument("--rest", type=float, default=3.0, help="seconds for which a held chair is watched")
    parser.add_argument("--workers", type=int, default=default_workers())
    parser.add_argument("--out", type=Path, default=Path("runs/faults"), help="folder for the scenario of each violation")
    asked = parser.parse_args()

    outcomes: list[Outcome] = []
    asked.out.mkdir(parents=True, exist_ok=True)
    with JobPool(asked.workers, lambda _: None) as pool:
        jobs = list(_jobs(asked, pool))
        for ten in range(0, len(jobs), 10):
            for one in pool.begin(jobs[ten : ten + 10])():
                outcomes.append(one)
                if one.faulty:
                    print(f"{one.job.title}: {'; '.join(one.faulty)}  [{one.verdict}: {one.cause}]")
                    file = asked.out / f"{len(outcomes):03}-{one.job.case.kind}-{one.job.place.phase}.toml"
                    file.write_text(one.toml, encoding="utf-8")
                    print(f"  treadline climb {file} --seed {one.job.seed}", flush=True)
            wrong = sum(bool(one.faulty) for one in outcomes)
            most = 100.0 * clopper_pearson(wrong, len(outcomes), 0.90)[1]  # one-sided, 95 %
            so_far = f"{len(outcomes)} of {len(jobs)} runs, {wrong} break a figure"
            print(f"{so_far}: at most {most:.2f} % with 95 % confidence", flush=True)
    report(outcomes)


if __name__ == "__main__":
    main()
