"""Inject each fault in each phase, up and down, with several seeds, and compare the outcome with the table of hazards.

Run: ``python benchmarks/faults.py`` (about an hour of CPU with five seeds), ``--quick`` for one seed of one load, ``--kinds
camera_lost flipper_lost`` or ``--phases crest edge`` for a part, ``--rest 60`` for the whole minute of rule H, ``--out FOLDER``
for a scenario file of each violation. A fault-free run with the same seed determines when each phase begins and ends. The fault
starts in the middle of the phase (``--place`` sets another place). The statistical camera, which renders no images, is used;
``false_edges``, which falsifies pixels only, is left out.

Rule H is checked where the friction allows a chair to hold. A chair that brakes at once slides away at a friction of 1.03 times the
slope's tangent (with one belt weaker than the other it also turns, and falls) and stands at 1.05. The slip faults here therefore
keep a mean of 1.05 (both belts) and 1.08 (one belt). The static margin under HOLD is judged on the flight and on flat ground. While
the chair pitches over the crest or the top entry it stands on its flipper's tip, and a dead flipper lowers the chair by design:
the pitch rate is judged there.
"""

import argparse
import itertools
import math
import sys
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from treadline.campaign.spec import scenario_toml
from treadline.core.angles import DEG
from treadline.core.processes import default_workers
from treadline.core.signals import TICK_S
from treadline.experiments._job_pool import run_jobs
from treadline.guard import TIPPING
from treadline.mission.loop import Tick
from treadline.plant.mujoco import open_plant
from treadline.plant.mujoco.mujoco_plant import MujocoPlant
from treadline.run.episode import Traverse, traverse
from treadline.scenario.faults import Fault, Process
from treadline.scenario.scenario import Chair, DriveSettings, Scenario, Sensors, Stair, Start
from treadline.scenario.shipped_files import shipped_controller

STEPS = 8
FRICTION_OF_TANGENT = 1.166
"""Ratio of the friction along the belt to the slope's tangent: the default of 0.62 at 28°."""
SETTLED_S = 0.5
"""Settling time after a hold [s], within which the chair comes to rest; rule H applies afterwards."""
SLIDE_M, TURN_DEG, MARGIN_DEG = 0.020, 2.0, 7.0
PITCH_RATE_DEG_S, SEAT_DEG, ROLL_BACK_M = 20.0, 5.0, 0.30
MOVING_M_S = 0.02
CLEAR_M = 0.3
"""Least distance to an obstacle in the path [m]."""
AFTERWARDS_S = 3.0
"""Time that a run continues after the end of the fault [s]."""
HEARD_S = 0.12
"""Longest time from an operator stop to the zero command [s]: the handset sends at 10 Hz, and the loop adds a tick."""
TOLD = ("slow", "hold", "re-referenced", "vision_dim", "back_off", "refused")
"""Events that count as detection of a fault."""


@dataclass(frozen=True)
class Leg:
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


@dataclass(frozen=True)
class Load:
    """Who sits in the chair, and on what slope."""

    payload_kg: float
    slope_deg: float


LOADS = (Load(50.0, 28.0), Load(80.0, 30.0))


@dataclass(frozen=True)
class Case:
    """A fault, and what its row of the table accepts; times from the fault's beginning."""

    row: str
    kind: str
    value: float = 0.0
    for_s: float = 10.0
    also: str = ""
    """A second fault, at the same time."""
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
        return f"{self.kind}{value}" + (f" + {self.also}" if self.also else "")


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
    Case("9", "camera_lost", also="imu_lost", held_s=0.5),
    Case("10", "clock_back", 0.5, 3.0, ends=ANY),
    Case("10", "clock_back", 2.0, 3.0, held_s=0.5),
    Case("11", "late_tick", 0.5, 3.0, still_s=0.8),
    Case("13", "track_stalled", 0.0, held_s=0.6, heading_deg=8.0),
    Case("13", "track_stalled", 1.0, held_s=0.6, heading_deg=8.0),
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


@dataclass(frozen=True)
class Undisturbed:
    """A run without a fault: when its phases begin."""

    leg: Leg
    load: Load
    seed: int
    places: tuple[float, ...]

    @property
    def title(self) -> str:
        """Return a word for the progress line."""
        return f"{self.leg.direction} from the {self.leg.place}, seed {self.seed}"

    def run(self) -> dict[tuple[str, float], tuple[float, np.ndarray]]:
        """Return when a fault is due, at each place in each phase, and how far off the heading is from then on without one [°]."""
        scenario = scenario_of(self.leg, self.load, 90.0)
        ride = traverse(scenario, controller=shipped_controller(scenario.chair.model), seed=self.seed)
        begins = [*ride.scores.phases, (ride.scores.duration_s, "")]
        due: dict[tuple[str, float], float] = {}
        for (begin_s, phase), (end_s, _) in itertools.pairwise(begins):
            for place in self.places:
                due.setdefault((phase, place), round((1.0 - place) * begin_s + place * end_s, 2))
        heading = np.abs(ride.trace["heading_rad"]) / DEG
        return {key: (at_s, heading[round(at_s / TICK_S) :]) for key, at_s in due.items() if key[0] in self.leg.phases}


@dataclass(frozen=True)
class Outcome:
    """What became of one run, from its fault on."""

    case: Case
    leg: Leg
    load: Load
    phase: str
    seed: int
    verdict: str
    cause: str
    found_s: float
    held_s: float
    still_s: float
    slide_m: float
    turn_deg: float
    margin_deg: float
    roll_back_m: float
    heading_deg: float
    """Largest heading error after the start of the fault, less the error at its start [°]."""
    pitch_rate_deg_s: float
    seat_deg: float
    faulty: tuple[str, ...] = field(default=())
    """Limits of the table that the run violates."""
    toml: str = ""


@dataclass(frozen=True)
class Disturbed:
    """A run with one fault."""

    case: Case
    leg: Leg
    load: Load
    phase: str
    seed: int
    at_s: float
    sound_deg: np.ndarray
    """How far off the heading is from then on without a fault, tick by tick."""
    rest_s: float

    @property
    def title(self) -> str:
        """Return a word for the progress line."""
        return f"{self.case.name} in {self.phase} {self.leg.direction}, seed {self.seed}"

    def run(self) -> Outcome:
        """DriveSettings, and judge."""
        case = self.case
        kinds = [(case.kind, case.value)] + ([(case.also, 0.0)] if case.also else [])
        faults = [
            Fault.model_validate({"kind": kind, "value": value, "at_s": self.at_s, "for_s": case.for_s}) for kind, value in kinds
        ]
        duration_s = self.at_s + min(case.for_s, 30.0) + AFTERWARDS_S
        scenario = scenario_of(self.leg, self.load, duration_s, faults)
        strange: list[float] = []
        gaps_m: list[float] = []
        plants: list[MujocoPlant] = []

        def opened(scenario: Scenario, seed: int) -> MujocoPlant:
            plants.append(open_plant(scenario, seed))
            return plants[-1]

        def watch(tick: Tick) -> None:
            gap_m = plants[-1].gap_m
            if gap_m is not None:
                gaps_m.append(gap_m)
            if not all(map(math.isfinite, (tick.tracks.left_m_s, tick.tracks.right_m_s, tick.seat.rate_m_s))):
                strange.append(tick.t_s)

        controller = shipped_controller(scenario.chair.model)
        rest_s = SETTLED_S + self.rest_s
        ride = traverse(scenario, controller=controller, seed=self.seed, watch=watch, after_hold_s=rest_s, open_plant=opened)
        seen = self._seen(ride, scenario)
        wrong = [*self._wrong(seen, ride.scores.duration_s - self.at_s), *(["NaN command"] if strange else [])]
        if gaps_m and min(gaps_m) < CLEAR_M:
            wrong.append(f"{min(gaps_m):.2f} m before what stands in the way, {CLEAR_M:g} wanted")
        if wrong:
            print(f"  {self.title}: {'; '.join(wrong)}  [{seen.verdict}: {seen.cause}]", file=sys.stderr, flush=True)
        return replace(seen, faulty=tuple(wrong))

    def _seen(self, ride: Traverse, scenario: Scenario) -> Outcome:
        # The event of a missing sample carries the time of the previous sample.
        told = [(event.t_s, event.name) for event in ride.events if event.t_s >= self.at_s - 1.5 * TICK_S]
        held_s = next((t_s for t_s, name in told if name == "hold"), math.nan)
        after = slice(round(self.at_s / TICK_S), None)
        trace = {name: column[after] for name, column in ride.trace.columns.items()}
        rest = slice(None) if math.isnan(held_s) else slice(round((held_s - self.at_s + SETTLED_S) / TICK_S), None)
        x, y, heading = trace["x_m"][rest], trace["y_m"][rest], trace["heading_rad"][rest]
        rests = not math.isnan(held_s) and len(x) > 0
        moving = np.flatnonzero((np.abs(trace["left_m_s"]) > 1e-3) | (np.abs(trace["right_m_s"]) > 1e-3))
        runs = np.flatnonzero(np.maximum(np.abs(trace["left_m_s"]), np.abs(trace["right_m_s"])) > MOVING_M_S)
        due_s = self.at_s + (int(runs[0]) * TICK_S if self.case.moving and runs.size else 0.0)
        onward = trace["x_m"] if self.leg.direction == "up" else -trace["x_m"]
        backs_s = next((t_s - self.at_s for t_s, name in told if name == "back_off"), math.inf)
        onward = onward[: max(round(min(backs_s / TICK_S, len(onward))), 1)]  # backing off is commanded motion, not a slide
        return Outcome(
            case=self.case,
            leg=self.leg,
            load=self.load,
            phase=self.phase,
            seed=self.seed,
            verdict=ride.verdict,
            cause=ride.cause or "",
            found_s=next((t_s - due_s for t_s, name in told if name in TOLD), math.nan),
            held_s=held_s - due_s,
            still_s=(int(moving[-1]) + 1) * TICK_S if moving.size else 0.0,
            slide_m=float(np.hypot(x - x[0], y - y[0]).max()) if rests else math.nan,
            turn_deg=float(np.ptp(heading)) / DEG if rests else math.nan,
            margin_deg=float(trace["stability_margin_rad"][rest].min()) / DEG if rests else math.nan,
            roll_back_m=float((np.maximum.accumulate(onward) - onward).max()),
            heading_deg=float(np.abs(trace["heading_rad"]).max() - abs(trace["heading_rad"][0])) / DEG
            - (self._sound_growth_deg(len(trace["heading_rad"])) if self.case.beyond_sound else 0.0),
            pitch_rate_deg_s=float(np.abs(trace["pitch_rate_rad_s"]).max()) / DEG,
            seat_deg=float(np.abs(trace["seat_pitch_rad"]).max()) / DEG,
            toml=scenario_toml(scenario, f"{self.title}: {ride.verdict}, {ride.cause}"),
        )

    def _sound_growth_deg(self, ticks: int) -> float:
        sound = self.sound_deg[:ticks]
        return float(sound.max() - sound[0])

    def _wrong(self, seen: Outcome, after_s: float) -> Iterator[str]:
        case = self.case
        # It may be there before its time is up.
        in_time = seen.verdict == "arrived" and not case.moving and after_s <= case.held_s
        if seen.verdict not in case.ends and not in_time:
            yield f"{seen.verdict} ({seen.cause})"
        for what, value, limit, unit in (
            ("found after", seen.found_s, case.found_s, "s"),
            ("held after", seen.held_s, case.held_s, "s"),
            ("still after", seen.still_s, case.still_s, "s"),
            ("heading", seen.heading_deg, case.heading_deg, "°"),
            ("seat", seen.seat_deg, case.seat_deg, "°"),
            ("pitch rate", seen.pitch_rate_deg_s, PITCH_RATE_DEG_S, "°/s"),
        ):
            if value > limit + 1e-6 or (math.isnan(value) and limit < math.inf and not in_time):
                yield f"{what} {value:.2f} {unit}, {limit:g} wanted"
        if seen.roll_back_m > ROLL_BACK_M:
            yield f"rolled back {seen.roll_back_m:.2f} m"
        if self.phase in TIPPING and case.kind == "flipper_lost":
            return
        if seen.slide_m > SLIDE_M:
            yield f"slides {seen.slide_m * 1000.0:.0f} mm"
        if seen.turn_deg > TURN_DEG:
            yield f"turns {seen.turn_deg:.1f}° while held"
        if self.phase not in TIPPING and seen.margin_deg < MARGIN_DEG:
            yield f"margin {seen.margin_deg:.1f}°"


def report(outcomes: Sequence[Outcome]) -> None:
    """Print one line for each fault and phase, then the matrix."""
    cells: dict[tuple[str, str, str], list[Outcome]] = defaultdict(list)
    for outcome in outcomes:
        cells[outcome.case.name, outcome.leg.direction, outcome.phase].append(outcome)
    print(
        f"{'row':>3} {'fault':24} {'phase':14} {'found':>6} {'held':>6} {'still':>6} {'slide':>6} {'turn':>5} {'margin':>6} "
        f"{'back':>5} {'head':>5} {'rate':>5} {'seat':>5}  ends"
    )
    print(f"{'':44}{'s':>6} {'s':>6} {'s':>6} {'mm':>6} {'°':>5} {'°':>6} {'m':>5} {'°':>5} {'°/s':>5} {'°':>5}")
    for (name, direction, phase), cell in cells.items():
        ends = ", ".join(f"{verdict} {count}" for verdict, count in Counter(one.verdict for one in cell).items())
        figures = (
            f"{_worst(cell, 'found_s'):6.2f} {_worst(cell, 'held_s'):6.2f} {_worst(cell, 'still_s'):6.2f} "
            f"{1000.0 * _worst(cell, 'slide_m'):6.1f} {_worst(cell, 'turn_deg'):5.2f} {-_worst(cell, 'margin_deg', -1.0):6.1f} "
            f"{_worst(cell, 'roll_back_m'):5.2f} {_worst(cell, 'heading_deg'):5.1f} {_worst(cell, 'pitch_rate_deg_s'):5.1f} "
            f"{_worst(cell, 'seat_deg'):5.1f}"
        )
        mark = "  <-" if any(one.faulty for one in cell) else ""
        print(f"{cell[0].case.row:>3} {name:24} {phase + ' ' + direction:14} {figures}  {ends}{mark}")
    phases = list(dict.fromkeys((leg.direction, phase) for leg in LEGS for phase in leg.phases))
    print(f"\n{'runs that break a figure / runs':28}" + "".join(f"{phase[:8] + ' ' + way[0]:>11}" for way, phase in phases))
    for name in dict.fromkeys(outcome.case.name for outcome in outcomes):
        line = (cells.get((name, way, phase), []) for way, phase in phases)
        print(f"{name:28}" + "".join(f"{_share(cell):>11}" for cell in line))


def _worst(cell: Sequence[Outcome], figure: str, sign: float = 1.0) -> float:
    values = [sign * getattr(one, figure) for one in cell if not math.isnan(getattr(one, figure))]
    return max(values, default=math.nan)


def _share(cell: Sequence[Outcome]) -> str:
    wrong = sum(bool(one.faulty) for one in cell)
    return f"{wrong}/{len(cell)}" if wrong else ("." if cell else "")


def main() -> None:
    """Run all cases and report the outcomes."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--quick", action="store_true", help="one seed, the first load")
    parser.add_argument("--kinds", nargs="*", help="as in a scenario's [[fault]]")
    parser.add_argument("--phases", nargs="*")
    parser.add_argument("--place", nargs="*", type=float, default=[0.5], help="where in a phase, 0 to 1")
    parser.add_argument("--rest", type=float, default=3.0, help="seconds for which a held chair is watched")
    parser.add_argument("--heavy", action="store_true", help="every seed with the second load as well, not the first alone")
    parser.add_argument("--workers", type=int, default=default_workers())
    parser.add_argument("--out", type=Path, help="folder for the scenario of each violation")
    asked = parser.parse_args()

    seeds = range(1 if asked.quick else asked.seeds)
    loads = [(LOADS[0], seed) for seed in seeds]
    if not asked.quick:
        loads += [(LOADS[1], seed) for seed in (seeds if asked.heavy else seeds[:1])]
    legs = [leg for leg in LEGS if not asked.phases or set(asked.phases) & set(leg.phases)]
    first = [Undisturbed(leg, load, seed, tuple(asked.place)) for load, seed in loads for leg in legs]
    due = run_jobs(first, workers=asked.workers, done=lambda _: None)
    for one, times in zip(first, due, strict=True):
        for phase in one.leg.phases:
            if (phase, asked.place[0]) not in times:
                print(f"{one.title}, {one.load.payload_kg:g} kg at {one.load.slope_deg:g}°: no phase {phase}")
    cases = [case for case in CASES if not asked.kinds or case.kind in asked.kinds]
    jobs = [
        Disturbed(case, one.leg, one.load, phase, one.seed, at_s, sound_deg, asked.rest)
        for case in cases
        for one, times in zip(first, due, strict=True)
        for (phase, _), (at_s, sound_deg) in times.items()
        if not asked.phases or phase in asked.phases
    ]
    outcomes = run_jobs(jobs, workers=asked.workers, done=lambda _: None)
    report(outcomes)

    wrong = [outcome for outcome in outcomes if outcome.faulty]
    print(f"\n{len(wrong)} of {len(outcomes)} runs break a figure")
    for number, one in enumerate(wrong):
        path = ""
        if asked.out:
            asked.out.mkdir(parents=True, exist_ok=True)
            file = asked.out / f"{number:03}-{one.case.kind}-{one.phase}-{one.leg.direction}.toml"
            file.write_text(one.toml, encoding="utf-8")
            path = f"  treadline climb {file} --seed {one.seed}"
        where = f"{one.case.name} in {one.phase} {one.leg.direction}, {one.load.payload_kg:g} kg at {one.load.slope_deg:g}°"
        print(f"row {one.case.row}: {where}, seed {one.seed}: {'; '.join(one.faulty)}  [{one.verdict}: {one.cause}]{path}")


if __name__ == "__main__":
    main()
