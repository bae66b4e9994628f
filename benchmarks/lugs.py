"""Smooth belts compared with lugged belts, on corrected contact: ``python benchmarks/lugs.py``; see ``docs/evidence/lugs.md``."""

import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from treadline.core.angles import DEG
from treadline.core.ports import Truth
from treadline.run.episode import Traverse, traverse
from treadline.scenario.scenario import Belts, DriveSettings, Scenario, Sensors, Stair, Start
from treadline.scenario.shipped_files import shipped_controller
from treadline.vehicle.comfort import passenger_acceleration

sys.path.append(str(Path(__file__).parents[1] / "tests" / "plant" / "mujoco"))
from oracles.plant_runs import held, plant_on

RUN_M = 0.30
SEEDS = (1, 2, 3, 4)
"""Seeds of the lugs' position at the start of a run."""
SMOOTHING = 5
"""Window [ticks] that averages the passenger's position before it is differentiated twice: 50 ms, as a seat cushion."""
SETTLED = 100
"""Number of ticks at the start of a run that the figures exclude."""
BELTS = {
    "smooth": Belts(),
    "8/60": Belts(lug="8/60"),
    "15/80": Belts(lug="15/80"),
    "20/80": Belts(lug="20/80"),
    "15/80, rubber 0.005 s": Belts(lug="15/80", stiffness_s=0.005),
    "15/80, rubber 0.02 s": Belts(lug="15/80", stiffness_s=0.02),
}


MADE = {
    "15/80": BELTS["15/80"],
    "15/80, rubber 0.02 s": BELTS["15/80, rubber 0.02 s"],
    "8/60": BELTS["8/60"],
    "15/52": Belts(lug="15/80", pitch_m=0.052),
    "15/40": Belts(lug="15/80", pitch_m=0.04, flank_m=0.008),
    "10/40": Belts(height_m=0.010, pitch_m=0.04, tip_m=0.02, flank_m=0.01),
}
"""What a chair's maker can change about the belts."""
ISOLATION_HZ, ISOLATION_DAMPING = 2.0, 0.3
"""Natural frequency [Hz] and damping ratio of a seat on springs."""
TURNS = ((-30.0, 0.1, 0.7), (30.0, 0.7, 0.1))
"""Start heading [°] and left and right belt speed [m/s] of each turn towards zero heading."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """A chair on a flight, driven open loop."""

    slope_deg: float = 28.0
    heading_deg: float = 0.0
    friction: tuple[float, float] = (0.62, 0.5)
    left_m_s: float = 0.2
    right_m_s: float = 0.2
    duration_s: float = 9.0


def run(case: Case, belts: Belts, seed: int) -> list[Truth]:
    """Return the truth of one run; both belt speeds zero brake the chair."""
    plant = plant_on(case.slope_deg, case.friction, case.heading_deg, seed=seed, steps=40, tables={"belts": belts})
    braked = case.left_m_s == case.right_m_s == 0.0
    return held(plant, case.left_m_s, case.right_m_s, case.duration_s, brake=braked)


def passenger_m_s2(samples: Sequence[Truth]) -> float:
    """Return the passenger's largest acceleration, along and up."""
    place = np.array([(sample.passenger_x_m, sample.passenger_z_m) for sample in samples])
    smooth = np.apply_along_axis(lambda column: np.convolve(column, np.ones(SMOOTHING) / SMOOTHING, "valid"), 0, place)
    return float(np.hypot(*np.diff(smooth, 2, axis=0)[SETTLED:].T).max() * 1e4)


def roll_back_m(samples: Sequence[Truth]) -> float:
    """Return how far the chair falls behind its highest place on the flight."""
    x = np.array([sample.x_m for sample in samples])
    return float((np.maximum.accumulate(x) - x).max())


def traversal(belts: Belts, direction: Literal["up", "down"], seed: int, speed_m_s: float = 0.2) -> Traverse:
    """Return a whole traversal of six steps at 28°."""
    scenario = Scenario(
        stair=Stair(rise_m=RUN_M * math.tan(28.0 * DEG), steps=6),
        belts=belts,
        start=Start(place="landing" if direction == "down" else "floor"),
        drive=DriveSettings(direction=direction, speed_m_s=speed_m_s),
        sensors=Sensors(camera="statistical"),
    )
    return traverse(scenario, controller=shipped_controller("wheelchair"), seed=seed)


def isolated(place_W: NDArray[np.float64], axes: Sequence[int], step_s: float = 0.01) -> NDArray[np.float64]:
    """Return a passenger's place on a seat that is sprung along some axes."""
    omega, sprung = 2.0 * math.pi * ISOLATION_HZ, place_W.copy()
    A = np.array([[0.0, 1.0], [-(omega**2), -2.0 * ISOLATION_DAMPING * omega]])
    b = np.array([[0.0, 0.0], [omega**2, 2.0 * ISOLATION_DAMPING * omega]])
    lead = expm(np.block([[A, b], [np.zeros((2, 4))]]) * step_s)
    for axis in axes:
        base = np.stack([place_W[axis], np.gradient(place_W[axis], step_s)])
        state = base[:, 0]
        for k in range(1, base.shape[1]):
            state = lead[:2, :2] @ state + lead[:2, 2:] @ (0.5 * (base[:, k - 1] + base[:, k]))
            sprung[axis, k] = state[0]
    return sprung


def _traversals() -> None:
    """Print the passenger's acceleration in whole traversals: by phase, and on a sprung seat."""
    print("whole traversals of six steps at 28°: passenger, median of the seeds, least, most; on a seat sprung upwards, all ways")
    for (name, belts), direction in product(MADE.items(), ("up", "down")):
        runs = [traversal(belts, direction, seed) for seed in SEEDS]
        places = [np.stack([run.trace[f"passenger_{axis}_m"] for axis in "xyz"]) for run in runs]
        for seat, axes in (("", ()), (" sprung upwards", (2,)), (" sprung all ways", (0, 1, 2))):
            made = [
                passenger_acceleration(isolated(place, axes), run.trace["yaw_rad"]) for place, run in zip(places, runs, strict=True)
            ]
            _row(f"{name}, {direction}{seat}", [float(np.linalg.norm(acceleration, axis=0).max()) for acceleration in made], "m/s²")
        peaks = [phase_of_peak(run, places[k]) for k, run in enumerate(runs)]
        print(f"    largest in {', '.join(peaks)}; {', '.join(run.verdict for run in runs)}", flush=True)


def phase_of_peak(run: Traverse, place_W: NDArray[np.float64]) -> str:
    """Return the phase in which the passenger's acceleration is largest."""
    acceleration = passenger_acceleration(place_W, run.trace["yaw_rad"])
    at_s = float(run.trace["t_s"][int(np.linalg.norm(acceleration, axis=0).argmax()) + 3])
    return [name for start_s, name in run.summary()["phases"] if start_s <= at_s][-1]


def _row(name: str, values: Sequence[float], unit: str) -> None:
    print(f"  {name:22s} median {np.median(values):6.3f}  least {min(values):6.3f}  most {max(values):6.3f} {unit}", flush=True)


def main() -> None:
    print(f"seeds {SEEDS}, corrected contact; friction 0.62/0.5 unless given")
    print("up 28° straight at 0.2 m/s, 9 s: passenger acceleration, pitch rate, load, distance, heading at the end")
    for name, belts in BELTS.items():
        runs = [run(Case(), belts, seed) for seed in SEEDS]
        _row(name, [passenger_m_s2(samples) for samples in runs], "m/s²")
        _row("", [max(abs(sample.pitch_rate_rad_s) for sample in samples[SETTLED:]) / DEG for samples in runs], "°/s")
        _row("", [max(sample.contact_force_share for sample in samples[SETTLED:]) for samples in runs], "× weight")
        _row("", [samples[-1].x_m - samples[0].x_m for samples in runs], "m of 1.77")
        _row("", [abs(samples[-1].heading_rad) / DEG for samples in runs], "°")
    compared = {name: BELTS[name] for name in ("smooth", "15/80")}
    print("square to the flight, belts 0.15/0.25 m/s, 3 s: yaw rate after one second (wheels: 8.8 °/s)")
    for slope_deg, name in product((28.0, 30.0), ("smooth", "8/60", "15/80")):
        steered = Case(slope_deg=slope_deg, left_m_s=0.15, right_m_s=0.25, duration_s=3.0)
        runs = [run(steered, BELTS[name], seed) for seed in SEEDS]
        yaw = [(samples[-1].heading_rad - samples[SETTLED].heading_rad) / 2.0 / DEG for samples in runs]
        _row(f"{name}, {slope_deg:.0f}°", yaw, "°/s")
    print("turn at 30° from ±30°, belts 0.1/0.7 m/s, 3 s: roll-back, heading reached")
    for name, belts in compared.items():
        turns = [Case(slope_deg=30.0, heading_deg=h, left_m_s=a, right_m_s=b, duration_s=3.0) for h, a, b in TURNS]
        runs = [run(turn, belts, seed) for turn in turns for seed in SEEDS[:2]]
        _row(name, [roll_back_m(samples) for samples in runs], "m")
        turned = [abs(samples[-1].heading_rad - samples[0].heading_rad) / DEG for samples in runs]
        _row("", turned, "° turned")
    print("braked for 10 s at 28° and 35°: distance slid")
    for slope_deg, (name, belts) in product((28.0, 35.0), compared.items()):
        braked = Case(slope_deg=slope_deg, left_m_s=0.0, right_m_s=0.0, duration_s=10.0)
        runs = [run(braked, belts, seed) for seed in SEEDS]
        _row(f"{name}, {slope_deg:.0f}°", [samples[0].x_m - samples[-1].x_m for samples in runs], "m")
    print("traction: straight at 28°, 5 s at 0.2 m/s, distance climbed (belts run 0.97 m)")
    for along, (name, belts) in product((0.40, 0.45, 0.50, 0.55), compared.items()):
        case = Case(friction=(along, 0.8 * along), duration_s=5.0)
        runs = [run(case, belts, seed) for seed in SEEDS]
        _row(f"{name}, friction {along:.2f}", [samples[-1].x_m - samples[0].x_m for samples in runs], "m")
    _traversals()


if __name__ == "__main__":
    main()
