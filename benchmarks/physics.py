"""Speed of the plant alone, without camera, and the cost of contact forces that obey Coulomb: ``python benchmarks/physics.py``."""

import math
import statistics
import time
from itertools import product

import numpy as np

from treadline.core.angles import DEG
from treadline.core.signals import SeatCommand, TrackCommand
from treadline.plant.mujoco import MujocoPlant, Physics, open_plant
from treadline.run.episode import traverse
from treadline.scenario.chair import read_chair
from treadline.scenario.scenario import Chair, Control, Scenario, Stair, Start, read_scenario
from treadline.scenario.shipped_files import shipped_controller

SEED = 0
SIMULATED_S = 30.0
REPEATS = 5
MOST_ON_A_FLIGHT, MOST_IN_A_TRAVERSAL = 1.4, 2.0
"""Bounds on the time per physics step with corrected contact forces, over that with MuJoCo's own."""
TURN_S = 6.0


def climbing(slope_deg: float) -> MujocoPlant:
    """Return a started plant that climbs at 0.2 m/s with a belt mismatch of 2 %."""
    scenario = Scenario(
        stair=Stair(rise_m=0.30 * math.tan(slope_deg * DEG), steps=60, width_m=10.0, walls="none"),
        chair=Chair(belt_mismatch=0.02),
        start=Start(place="flight", step=6),
        control=Control(vision="truth"),
    )
    plant = open_plant(scenario, SEED)
    plant.start()
    plant.write(TrackCommand(t_s=0.0, left_m_s=0.2, right_m_s=0.2), SeatCommand(t_s=0.0, rate_m_s=0.0))
    return plant


def factors(slope_deg: float) -> tuple[float, float]:
    """Return simulated seconds per processor second: physics alone, and with IMU, seat, drives and truth read."""
    plant = climbing(slope_deg)
    started = time.process_time()
    plant.advance(SIMULATED_S)
    physics_s = time.process_time() - started
    plant.read()
    plant.truth()
    all_s = time.process_time() - started
    return SIMULATED_S / physics_s, SIMULATED_S / all_s


def step_us_on_a_flight(slope_deg: float, belts: tuple[float, float], *, corrected: bool) -> float:
    """Return processor time per physics step at constant belt speeds, the brake never used [µs]."""
    plant = climbing(slope_deg)
    plant._corrected[0] = corrected  # noqa: SLF001 - the plant's switch for comparisons
    plant.write(TrackCommand(t_s=0.0, left_m_s=belts[0], right_m_s=belts[1]), SeatCommand(t_s=0.0, rate_m_s=0.0))
    plant.advance(1.0)
    started = time.process_time()
    plant.advance(1.0 + TURN_S)
    return 1e6 * (time.process_time() - started) / (100.0 * Physics().substeps * TURN_S)


class _TimedPlant(MujocoPlant):
    """A plant that adds up the processor time of its physics."""

    spent_s = 0.0
    steps = 0

    def correct(self, corrected: bool) -> None:
        """Switch the contact correction."""
        self._corrected[0] = corrected

    def _run(self, ticks: int, log: np.ndarray, friction: np.ndarray) -> None:
        started = time.process_time()
        super()._run(ticks, log, friction)
        self.spent_s += time.process_time() - started
        self.steps += Physics().substeps * ticks


def step_us_in_a_traversal(scenario_name: str, *, corrected: bool) -> float:
    """Return processor time per physics step of one whole traversal, approach and crest included [µs]."""
    scenario, plants = read_scenario(scenario_name), []

    def opened(scenario: Scenario, seed: int) -> MujocoPlant:
        plant = _TimedPlant(scenario, seed, read_chair(scenario.chair.model))
        plant.correct(corrected)
        plants.append(plant)
        return plant

    traverse(scenario, controller=shipped_controller(scenario.chair.model), seed=SEED, open_plant=opened)
    return 1e6 * plants[0].spent_s / plants[0].steps


def cost_of_correction() -> None:
    """Print the time per step with the contact correction and without, and their ratio next to its bound."""
    print(f"contact correction: time per step of 2 ms, medians of {REPEATS} on a flight, one run of a traversal")
    for slope_deg, belts in product((25.0, 28.0, 30.0), ((0.2, 0.2), (0.15, 0.25))):
        pairs = [[step_us_on_a_flight(slope_deg, belts, corrected=on) for on in (False, True)] for _ in range(REPEATS)]
        before, after = (statistics.median(column) for column in zip(*pairs, strict=True))
        print(
            f"  {slope_deg:.0f}° belts {belts[0]}/{belts[1]}   {before:.0f} -> {after:.0f} µs   × {after / before:.2f}"
            f"   (bound {MOST_ON_A_FLIGHT})"
        )
    for name in ("up-28", "down-28"):
        before, after = (step_us_in_a_traversal(name, corrected=on) for on in (False, True))
        print(f"  {name} traversal   {before:.0f} -> {after:.0f} µs   × {after / before:.2f}   (bound {MOST_IN_A_TRAVERSAL})")


def main() -> None:
    climbing(25.0).advance(1.0)  # the first run compiles, or loads what was compiled
    print(f"plant at 500 Hz, {SIMULATED_S:.0f} s of climbing, seed {SEED}, one core; real-time factor, median of {REPEATS}")
    for slope_deg in (25.0, 28.0, 30.0):
        physics, sensed = zip(*(factors(slope_deg) for _ in range(REPEATS)), strict=True)
        print(
            f"  {slope_deg:.0f}°   physics {statistics.median(physics):5.0f} ({min(physics):.0f}…{max(physics):.0f})"
            f"   with sensors and truth {statistics.median(sensed):4.0f} ({min(sensed):.0f}…{max(sensed):.0f})"
        )
    cost_of_correction()


if __name__ == "__main__":
    main()
