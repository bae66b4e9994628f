"""Stairs and conditions of real buildings: single deviations, the ``buildings`` sweep, and stairs that turn, each run judged.

Run: ``python benchmarks/buildings.py [--seeds N] [--only WORDS] [--workers N]`` for single deviations: one scenario each, run with
the statistical camera (fifteen minutes of CPU). Every run is a whole traversal of a 28° flight with a payload of 50 kg and friction
0.62/0.5, unless the row says otherwise. ``python benchmarks/buildings.py --sweep FOLDER`` judges the runs of
``treadline sweep buildings --out FOLDER``. ``python benchmarks/buildings.py --turned N --seed SEED`` draws N buildings of two and
three flights with quarter and half landings, up and down alternately, and runs each with the statistical camera.

A run ends rightly if it arrived, rocked by at most 2° (listed apart), or was refused, set back or held, without a rough moment, for
a reason that its scenario bears out: a dimension beyond the stated range that ``REASONS`` joins to the cause.
"""

import argparse
import csv
import math
import re
import sys
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from itertools import pairwise, product, repeat
from pathlib import Path
from typing import Any

import numpy as np
from profiles import ROCKS_DEG, beyond_deg
from tables import markdown

from treadline.campaign._results import clopper_pearson
from treadline.core.angles import DEG
from treadline.core.processes import default_workers
from treadline.core.step_sizes import TURN_CLEAR_M
from treadline.run.episode import Traverse, traverse
from treadline.scenario.scenario import Scenario, read_scenario, scenario_of
from treadline.scenario.shipped_files import shipped_controller
from treadline.vehicle.landing_turn import OFF_PLAN_M, landing_of, least_landing_m
from treadline.vehicle.landing_turn_kernels import Outline, is_free
from treadline.vehicle.staircase import as_designed
from treadline.vehicle.start_checks import crossing_flights, outline_of

RISE_M = 0.1595128
"""Rise of the nominal step [m]: 28° with a run of 0.30 m."""
STAIR = {"slope_deg": 28.0, "steps": 8, "landing_m": 3.0}
DOWN: dict[str, Any] = {"start": {"place": "landing"}, "drive": {"direction": "down"}}
MIDWAY = {"place": "flight", "step": 4}
REARMED = [{"kind": "stop", "at_s": 2.0}, {"kind": "rearm", "at_s": 62.0}]
ASIDE = DOWN | {"start": {"place": "landing", "lateral_m": 0.3}}
WOUND = [{"index": -3, "yaw_deg": 4.0}, {"index": -2, "yaw_deg": 8.0}, {"index": -1, "yaw_deg": 12.0}]
WET = [{"index": index, "friction": [0.36, 0.3]} for index in (4, 5, 6)]
SPLIT = {"steps": 9, "friction": [0.8, 0.65], "friction_right": [0.48, 0.39]}
RAMP = {"kind": "gyro_ramp", "value": 0.6, "at_s": 10.0, "for_s": 30.0}
HELD_S = 5.0
"""Time for which a held chair is watched [s]."""

Tables = Mapping[str, Any]


def case(stair: Tables | None = None, step: list[dict[str, Any]] | None = None, **tables: Any) -> Tables:
    """Return the tables of a scenario: the nominal flight with one deviation."""
    return {"stair": STAIR | dict(stair or {}), "step": step or [], "sensors": {"camera": "statistical"}, **tables}


def rise(index: int, more_mm: float) -> dict[str, Any]:
    """Return the table of one step that is higher than the nominal step."""
    return {"index": index, "rise_m": round(RISE_M + more_mm / 1000.0, 7)}


def low(steps: int, rise_m: float) -> list[dict[str, Any]]:
    """Return the tables of a few steps of one height."""
    return [{"index": index, "rise_m": rise_m} for index in range(steps)]


def stamped(message: int) -> dict[str, Any]:
    """Return the fault that stamps one kind of message 1e6 s ahead."""
    return {"kind": "wrong_stamp", "value": message, "at_s": 15.0, "for_s": 0.05}


CASES: dict[str, Tables] = {
    "no deviation, up": case(),
    "no deviation, down": case(**DOWN),
    "last riser +15 mm, up": case(step=[rise(-1, 15.0)]),
    "last riser +20 mm, up": case(step=[rise(-1, 20.0)]),
    "last riser +30 mm, up": case(step=[rise(-1, 30.0)]),
    "last riser +50 mm, up": case(step=[rise(-1, 50.0)], drive={"duration_s": 150.0}),
    "last riser +30 mm, down": case(step=[rise(-1, 30.0)], **DOWN),
    "last riser +50 mm, down": case(step=[rise(-1, 50.0)], **DOWN),
    "last riser -50 mm, up": case(step=[rise(-1, -50.0)]),
    "first riser +50 mm, up": case(step=[rise(0, 50.0)]),
    "first riser -50 mm, up": case(step=[rise(0, -50.0)]),
    "one step 10 mm high, up": case({"steps": 9}, [rise(4, 10.0), rise(5, -10.0)]),
    "one step 10 mm high, down": case({"steps": 9}, [rise(4, 10.0), rise(5, -10.0)], **DOWN),
    "runs uneven, s.d. 12 mm, up": case({"steps": 9, "run_jitter_m": 0.012}),
    "runs uneven, s.d. 20 mm, up": case({"steps": 9, "run_jitter_m": 0.020}),
    "last nosings turned by 4, 8, 12 degrees, up": case({"steps": 9, "walls": "none"}, WOUND),
    "last nosings turned by 4, 8, 12 degrees, down": case({"steps": 9, "walls": "none", "width_m": 1.6}, WOUND, **DOWN),
    "kerb 50 mm, up": case({"steps": 1, "walls": "none"}, low(1, 0.05)),
    "kerb 100 mm, up": case({"steps": 1, "walls": "none"}, low(1, 0.10)),
    "kerb 100 mm, down": case({"steps": 1, "walls": "none"}, low(1, 0.10), **DOWN),
    "kerb 200 mm, up": case({"steps": 1, "walls": "none"}, low(1, 0.20)),
    "kerb 200 mm, down": case({"steps": 1, "walls": "none"}, low(1, 0.20), **DOWN),
    "two steps of 50 mm, up": case({"steps": 2}, low(2, 0.05)),
    "two steps of 70 mm, up": case({"steps": 2}, low(2, 0.07)),
    "two steps of 150 mm, up": case({"steps": 2}, low(2, 0.15)),
    "two steps of 150 mm, down": case({"steps": 2}, low(2, 0.15), **DOWN),
    "lean 0.12 m and sway 0.08 m to the left, down": case(chair={"lean_m": [0.0, 0.12], "sway_m": [0.0, 0.08]}, **DOWN),
    "entered 75 kg of 50, down": case(chair={"entered_payload_kg": 75.0}, **DOWN),
    "side slope 2 degrees, down": case({"side_slope_deg": 2.0}, **DOWN),
    "three winders (quarter turn), check off, up": case({"steps": 11, "winders": 3}, drive={"check": False}),
    "right belt on 0.6 of friction 0.8, down": case(SPLIT, **DOWN),
    "three wet steps (0.36 of 0.8), up": case({"steps": 10, "friction": [0.8, 0.65]}, WET),
    "three wet steps (0.36 of 0.8), down": case({"steps": 10, "friction": [0.8, 0.65]}, WET, **DOWN),
    "stop button at 0.2 m/s": case({"steps": 10}, operator=[{"kind": "stop", "at_s": 7.0}], start=MIDWAY),
    "held for 60 s, then re-armed": case({"steps": 10}, operator=REARMED, start=MIDWAY, drive={"duration_s": 120.0}),
    "map stamped 1e6 s": case(fault=[stamped(0)]),
    "plan stamped 1e6 s": case(fault=[stamped(1)]),
    "health stamped 1e6 s": case(fault=[stamped(2)]),
    "gyro ramp to 0.6 deg/s, up": case(fault=[RAMP]),
    "gyro ramp to 0.6 deg/s, down": case(fault=[RAMP], **DOWN),
    "landing 1.2 m deep, up": case({"landing_m": 1.2}),
    "landing 1.2 m deep, start 0.3 m off centre, down": case({"landing_m": 1.2, "width_m": 1.6}, **ASIDE),
}


def least_grip(scenario: Scenario) -> float:
    """Return the least friction along the belts on either half of any step, over what the steepest two steps need."""
    stair, steps = scenario.stair, as_designed(scenario.stair, scenario.step).steps
    rise_m = max((0.5 * (low.rise_m + high.rise_m) for low, high in pairwise(steps)), default=stair.rise_m)
    return min(along for step in steps for along, _ in step.friction) * stair.run_m / rise_m


def is_irregular(scenario: Scenario) -> bool:
    """Return whether a riser or the number of steps lies beyond the stated range: 20 mm at the ends, 9.5 mm between them."""
    stair, steps = scenario.stair, as_designed(scenario.stair, scenario.step).steps
    off_m = [abs(step.rise_m - stair.rise_m) for step in steps]
    ends_m, inner_m = max(off_m[0], off_m[-1]), max(off_m[1:-1], default=0.0)
    jitters = stair.rise_jitter_m > 0.002 or stair.run_jitter_m > 0.002
    turned = any(step.yaw_rad for step in steps)
    return stair.steps < 4 or stair.steps > 20 or ends_m > 0.0201 or inner_m > 0.0096 or jitters or turned


def is_burdened(scenario: Scenario) -> bool:
    """Return whether lean, sway or the error of the entered weight lies beyond the stated range."""
    chair = scenario.chair
    off = abs(chair.entered.payload_kg - chair.payload_kg) > 0.1 * chair.payload_kg
    return off or max(map(abs, chair.lean_m)) > 0.04 or max(chair.sway_m) > 0.02


def sees_late(scenario: Scenario) -> bool:
    """Return whether frames are later, or lost more often, than stated."""
    realism = scenario.realism
    return realism.camera_latency_s > 0.10 or realism.camera_jitter_s > 0.02 or realism.camera_drop_rate > 0.05


REASONS: tuple[tuple[str, Callable[[Scenario], bool]], ...] = (
    ("friction|slid|slip|rolled|traction|steer", lambda scenario: least_grip(scenario) < 1.08),
    ("riser|nosing|edge|steps|flipper|kerb|pitch|flight beyond|floor beyond", is_irregular),
    ("landing|ground|edge", lambda scenario: scenario.stair.landing_m < 1.5),
    ("side|wall|wide|narrow", lambda scenario: scenario.stair.width_m < 1.1 or abs(scenario.start.lateral_m) > 0.15),
    ("margin|payload|tip|pitch|nothing carried", is_burdened),
    ("frame|camera|view|stair|vision|gyro", sees_late),
    ("margin|steer|roll", lambda scenario: abs(scenario.stair.side_slope_deg) > 1.0),
    ("operator|stamp|gyro|clock", lambda scenario: bool(scenario.operator or scenario.fault)),
)
"""Words of a cause, and whether a scenario lies beyond the stated range (``buildings.toml``) in the dimension that they name.

Friction: 1.2 tan β on the left and 0.9 of it on the right are stated."""


def ends_rightly(verdict: str, cause: str, passenger_m_s2: float, margin_deg: float, scenario: Callable[[], Scenario]) -> bool:
    """Return whether a run ended as it should."""
    if verdict == "arrived":
        return True
    if verdict not in ("refused", "held") or passenger_m_s2 > 4.0 or margin_deg < 0.0:
        return False
    return any(re.search(words, cause) is not None and beyond(scenario()) for words, beyond in REASONS)


def judge(folder: Path) -> None:
    """Print the judgement of a sweep: shares by label, then the causes of all runs that did not arrive."""
    with (folder / "runs.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    counts: dict[str, Counter[str]] = defaultdict(Counter)
    causes: Counter[tuple[str, ...]] = Counter()
    for row in rows:
        path = folder / "scenarios" / f"{int(row['index']):04d}.toml"
        figures = float(row["passenger_max_m_s2"] or 0.0), float(row["min_stability_margin_deg"] or 90.0)
        right = ends_rightly(row["verdict"], row["cause"], *figures, lambda path=path: read_scenario(path))
        for group in (row["label"], f"{row['label'].split()[0]}, all", "all"):
            counts[group][row["verdict"]] += 1
            counts[group]["right"] += right
        if row["verdict"] != "arrived":
            words = re.sub(r"[-+]?\d[\d.]*", "#", row["cause"].split(";")[0])
            causes[("right" if right else "WRONG", row["label"], row["drive.direction"], row["verdict"], words)] += 1
    markdown("| label | runs | arrived | 95 % bounds | rough | refused | held | fell | ended rightly |", shares(counts))
    rows_of_causes = (f"| {number} | {' | '.join(words)} |" for words, number in causes.most_common())
    markdown("| count | ended | label | way | verdict | cause |", rows_of_causes)


def shares(counts: Mapping[str, Counter[str]]) -> Iterator[str]:
    """Yield a row for each label."""
    for group in sorted(counts):
        count = counts[group]
        total = sum(n for name, n in count.items() if name != "right")
        low, high = clopper_pearson(count["arrived"], total)
        ends = " | ".join(str(count[name]) for name in ("arrived_rough", "refused", "held", "fell"))
        arrived, right = (f"{count[name] / total:.1%}" for name in ("arrived", "right"))
        yield f"| {group} | {total} | {arrived} | {low:.1%} to {high:.1%} | {ends} | {right} |"


def turned_building(number: int, seed: int) -> Scenario:
    """Draw a stair of two or three flights of four to six steps with quarter and half landings, even numbers up, odd ones down.

    Each landing is 0.1 m above the least that ``check`` prints, to 2.2 m. One riser of each flight is up to 10 mm off.
    """
    rng = np.random.default_rng((seed, number))
    while True:
        scenario = turned_draw(rng, up=number % 2 == 0)
        if crossing_flights(as_designed(scenario.stair)) is None:
            return scenario


def turned_draw(rng: np.random.Generator, *, up: bool) -> Scenario:
    """Draw one stair; its flights may cross."""
    slope_deg, width_m = rng.uniform(20.0, 31.0), rng.uniform(1.1, 1.6)
    run_m = rng.uniform(0.25, 0.32)
    grip = rng.uniform(1.2 * math.tan(slope_deg * DEG), 1.0)
    payload_kg = rng.uniform(0.0, 110.0 if slope_deg < 26.0 else 80.0)
    flights: list[dict[str, Any]] = [{"steps": int(rng.integers(4, 7))}]
    for _ in range(rng.integers(1, 3)):
        turn_deg = float(rng.choice([-180.0, -90.0, 90.0, 180.0]))
        walls = [side for side in ("left", "right", "far") if rng.random() < 0.5]
        landing = {"turn_deg": turn_deg, "landing_walls": walls, "steps": int(rng.integers(4, 7))}
        flights.append(landing | drawn_size(width_m, turn_deg, rng, up=up))
    rises, ends = math.tan(slope_deg * DEG) * run_m, np.cumsum([flight["steps"] for flight in flights]).tolist()
    off = [
        (int(rng.integers(end - flight["steps"], end)), rng.uniform(-0.01, 0.01)) for end, flight in zip(ends, flights, strict=True)
    ]
    tables = {
        "stair": {"run_m": run_m, "rise_m": rises, "width_m": width_m, "landing_m": 3.0, "friction": [grip, 0.806 * grip]},
        "flight": flights,
        "step": [{"index": index, "rise_m": rises + more_m} for index, more_m in off],
        "start": {"place": "floor" if up else "landing"},
        "drive": {"direction": "up" if up else "down", "duration_s": 300},
        "chair": {"payload_kg": payload_kg},
        "sensors": {"model": "statistical"},
    }
    return scenario_of(tables, Path("buildings.toml"), where="turned")


def drawn_size(width_m: float, turn_deg: float, rng: np.random.Generator, *, up: bool) -> dict[str, float]:
    """Draw depth and width of a landing."""
    across_m = width_m * (2.0 if abs(turn_deg) > 90.0 else 1.0)
    flights = [{"steps": 4}, {"steps": 4, "turn_deg": turn_deg, "landing_depth_m": width_m, "landing_width_m": across_m}]
    given = scenario_of({"stair": {"width_m": width_m}, "flight": flights}, Path("buildings.toml"), where="landing")
    chair, plan = given.read_chair(), as_designed(given.stair).plans[0]
    least_m = least_landing_m(plan, width_m, outline_of(chair).wider(TURN_CLEAR_M + OFF_PLAN_M), None if up else chair.reach_m)
    side_m = rng.uniform(least_m + 0.1, max(least_m + 0.1, 2.2))
    return {"landing_depth_m": max(side_m, width_m), "landing_width_m": max(side_m, across_m)}


def turned_run(number: int, seed: int) -> dict[str, Any]:
    """Return what became of one drawn building: verdict, time and rate of each turn, and time of belts over an edge."""
    scenario, began_s = turned_building(number, seed), time.process_time()
    result = traverse(scenario, controller=shipped_controller("wheelchair"), seed=number, after_hold_s=HELD_S)
    turns = [abs(flight.turn_deg) for flight in scenario.flight[1:]]
    phases = [*result.phases, (math.inf, "")]
    spans = [(begin, end) for (begin, name), (end, _) in pairwise(phases) if name == "turn" and end < math.inf]
    t_s, rate = result.trace["t_s"], np.gradient(np.unwrap(result.trace["yaw_rad"]), result.trace["t_s"]) / DEG
    return {
        "number": number,
        "way": f"{scenario.drive.direction}, {' and '.join(f'{turn:.0f}°' for turn in turns)}",
        "verdict": result.verdict,
        "cause": result.cause or "",
        "at": phases[-2][1],
        "turns": list(
            zip(turns if scenario.drive.direction == "up" else turns[::-1], (end - begin for begin, end in spans), strict=False)
        ),
        "said": [event.cause for event in result.events if "off its plan" in (event.cause or "")],
        "deg_s": max((float(np.abs(rate[(t_s > begin) & (t_s < end)]).max()) for begin, end in spans), default=0.0),
        "over_s": over_an_edge_s(scenario, result),
        "cpu_s": time.process_time() - began_s,
    }


def over_an_edge_s(scenario: Scenario, result: Traverse) -> float:
    """Return for how long a belt was beyond an edge of a landing on which the chair turned and found the next flight [s]."""
    staircase, tracks = as_designed(scenario.stair, scenario.step), scenario.read_chair().tracks
    half_run_m, half_m = 0.5 * tracks.flat_run_m, 0.5 * (tracks.gauge_m + tracks.belt_width_m)
    belts = Outline(
        rear_m=half_run_m, front_m=half_run_m, half_m=half_m, belts_rear_m=half_run_m, belts_front_m=half_run_m, half_belts_m=half_m
    )
    x_m, y_m, yaw, t_s = (result.trace[name] for name in ("chassis_x_m", "chassis_y_m", "yaw_rad", "t_s"))
    count, turned, over = len(staircase.plans) - 1, 0, 0
    for (begin_s, phase), (end_s, _) in zip(result.phases, [*result.phases[1:], (math.inf, "")], strict=True):
        turned += phase == "turn"
        if not turned or phase not in ("turn", "search", "align"):
            continue
        number = turned - 1 if scenario.drive.direction == "up" else count - turned
        (R_WF, p_WF), plan = staircase.flight_frame(number), staircase.plans[number]
        (landing, mirrored), at = landing_of(plan, staircase.width_m), (t_s >= begin_s) & (t_s < end_s)
        places = (np.column_stack([x_m[at], y_m[at], np.zeros(at.sum())]) - p_WF) @ R_WF - staircase.flights[number][-1].nosing_F
        headings = yaw[at] - math.atan2(R_WF[1, 0], R_WF[0, 0])
        poses = np.column_stack([places[:, :2], headings]) * mirrored
        over += sum(not is_free(landing, belts, *pose) for pose in poses)
    return over * float(t_s[1] - t_s[0])


def turned_table(rows: list[dict[str, Any]]) -> None:
    """Print the verdicts of drawn buildings by their way, the figures of their turns, and the causes of all that did not arrive."""
    groups: dict[str, list[dict[str, Any]]] = defaultdict(list)
    for row in rows:
        for group in ("all", row["way"].split(",")[0]):
            groups[group].append(row)
    heads = (
        "| direction | draws | arrived | rough | refused | held | fell | belts over an edge | quarter turn s | half turn s | °/s |"
    )
    markdown(heads, (turned_line(group, groups[group]) for group in sorted(groups)))
    failed = [row for row in rows if row["verdict"] != "arrived" or row["over_s"]]
    lines = (
        f"| {row['number']} | {row['way']} | {row['verdict']} | {row['at']} | {row['over_s']:.2f} | {row['cause']} |"
        for row in failed
    )
    markdown("| draw | way | verdict | in | belts over s | cause |", lines)


def turned_line(group: str, rows: list[dict[str, Any]]) -> str:
    """Return the row of one direction."""
    count, over = Counter(row["verdict"] for row in rows), sum(row["over_s"] > 0.0 for row in rows)
    times = [sorted(took_s for row in rows for turn, took_s in row["turns"] if turn == by) or [math.nan] for by in (90.0, 180.0)]
    spans = " | ".join(f"{took[0]:.1f}–{took[-1]:.1f}, median {float(np.median(took)):.1f}" for took in times)
    ends = " | ".join(str(count[name]) for name in ("arrived", "arrived_rough", "refused", "held", "fell"))
    return f"| {group} | {len(rows)} | {ends} | {over} | {spans} | {max(row['deg_s'] for row in rows):.1f} |"


def run(name: str, seed: int) -> dict[str, Any]:
    """Return verdict and scores of one run."""
    scenario = scenario_of(CASES[name], Path("buildings.toml"), where=name)
    result = traverse(scenario, controller=shipped_controller("wheelchair"), seed=seed, after_hold_s=HELD_S)
    scores = result.scores
    measured = (scores.passenger_max_m_s2, scores.min_stability_margin_deg)
    rocks = result.verdict == "arrived_rough" and measured[0] <= 4.0 and beyond_deg(result) <= ROCKS_DEG
    return {
        "right": rocks or ends_rightly(result.verdict, result.cause or "", *measured, lambda: scenario),
        "verdict": "rocked" if rocks else result.verdict,
        "cause": result.cause,
        "pitch_rate_deg_s": scores.max_pitch_rate_deg_s,
        "passenger_m_s2": scores.passenger_max_m_s2,
        "margin_deg": scores.min_stability_margin_deg,
    }


def conditions(runs: Mapping[str, list[dict[str, Any]]]) -> Iterator[str]:
    """Yield a row for each condition."""
    for name, rows in runs.items():
        verdicts = ", ".join(f"{verdict} {count}" for verdict, count in Counter(row["verdict"] for row in rows).most_common())
        spans = [_span([row[key] for row in rows]) for key in ("pitch_rate_deg_s", "passenger_m_s2", "margin_deg")]
        cause = Counter(row["cause"] for row in rows if row["cause"]).most_common(1)
        right = sum(row["right"] for row in rows)
        yield f"| {name} | {verdicts} | {right} of {len(rows)} | {' | '.join(spans)} | {cause[0][0] if cause else ''} |"


def _span(values: list[float]) -> str:
    low, high = f"{min(values):.1f}", f"{max(values):.1f}"
    return low if low == high else f"{low} to {high}"


def main() -> None:
    """Print the table of the single deviations, of drawn buildings that turn, or the judgement of a sweep."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=3, help="runs of each condition, seeds from 0")
    parser.add_argument("--only", nargs="*", default=[""], help="conditions whose name contains one of these words")
    parser.add_argument("--workers", type=int, default=default_workers(), help="processes")
    parser.add_argument("--sweep", type=Path, help="folder of a sweep of buildings, which is judged instead")
    parser.add_argument("--turned", type=int, help="number of buildings with turns, which are drawn instead")
    parser.add_argument("--seed", type=int, default=0, help="seed of the drawn buildings")
    arguments = parser.parse_args()
    if arguments.turned is not None:
        rows = []
        with ProcessPoolExecutor(arguments.workers) as pool:
            for row in pool.map(turned_run, range(arguments.turned), repeat(arguments.seed)):
                rows.append(row)
                sys.stderr.write(f"{row}\n")
        turned_table(rows)
        return
    if arguments.sweep is not None:
        judge(arguments.sweep)
        return
    names = [name for name in CASES if any(word in name for word in arguments.only)]
    jobs = list(product(names, range(arguments.seeds)))
    runs: dict[str, list[dict[str, Any]]] = {name: [] for name in names}
    with ProcessPoolExecutor(arguments.workers) as pool:
        for done, ((name, _), row) in enumerate(zip(jobs, pool.map(run, *zip(*jobs, strict=True)), strict=True), start=1):
            runs[name].append(row)
            sys.stderr.write(f"{done}/{len(jobs)} {name}: {row['verdict']}\n")
    markdown("| condition | verdicts | ended rightly | pitch rate °/s | passenger m/s² | margin ° | cause |", conditions(runs))


if __name__ == "__main__":
    main()
