"""The fast numerical settings against the nominal ones: turns, creep, scores and ranks of policies."""

from pathlib import Path

import numpy as np
import pytest

from treadline.bench.scoring import BenchRun, summarise
from treadline.core.angles import DEG
from treadline.core.signals import SeatCommand, TrackCommand
from treadline.plant.mujoco import FAST, NOMINAL, Physics, open_plant
from treadline.scenario.scenario import Control, Scenario, Stair, Start


def driven(
    physics: Physics, slope_deg: float, friction: tuple[float, float], belts_m_s: tuple[float, float], for_s: float
) -> tuple:
    """Return heading [°] and distance down the flight [mm] of a chair that starts square on it."""
    stair = Stair(slope_deg=slope_deg, run_m=0.3, steps=20, width_m=6.0, friction=friction, walls="none")
    scenario = Scenario(stair=stair, start=Start(place="flight"), control=Control(vision="truth"))
    plant = open_plant(scenario, physics=physics)
    plant.start()
    (begun,) = plant.truth()
    plant.write(TrackCommand(t_s=0.0, left_m_s=belts_m_s[0], right_m_s=belts_m_s[1]), SeatCommand(t_s=0.0, rate_m_s=0.0))
    _, truth = plant.drive(round(for_s * 100))
    return truth.heading_rad / DEG, 1000.0 * (begun.x_m - truth.x_m)


@pytest.mark.parametrize(
    ("slope_deg", "friction", "belts_m_s", "for_s"),
    [(20.0, (0.62, 0.5), (0.05, 0.20), 5.0), (28.0, (0.9, 0.5), (0.0, 0.25), 4.0), (24.0, (0.75, 0.6), (0.25, 0.05), 4.0)],
)
def test_a_turn_differs_by_less_than_two_percent(slope_deg: float, friction: tuple, belts_m_s: tuple, for_s: float) -> None:
    (nominal, _), (fast, _) = (driven(physics, slope_deg, friction, belts_m_s, for_s) for physics in (NOMINAL, FAST))
    assert abs(nominal) > 5.0
    assert fast == pytest.approx(nominal, rel=0.02)


@pytest.mark.parametrize("slope_deg", [20.0, 28.0])
def test_the_creep_of_belts_at_rest_differs_by_less_than_a_millimetre(slope_deg: float) -> None:
    (_, nominal), (_, fast) = (driven(physics, slope_deg, (0.62, 0.5), (0.0, 0.0), 5.0) for physics in (NOMINAL, FAST))
    assert abs(fast - nominal) < 1.0


GAINS = (0.0, 0.15, 0.3, 0.6, 1.0, 1.5, 2.5, 4.0)


@pytest.mark.slow
def test_scores_and_ranks_of_eight_policies_are_those_of_nominal_physics(tmp_path: Path) -> None:
    lines = ["from functools import partial", "from treadline.bench.policies import proportional"]
    lines += [f"Gain{k} = partial(proportional, gain={gain})" for k, gain in enumerate(GAINS)]
    (tmp_path / "gains.py").write_text("\n".join(lines))
    found = {}
    for physics in ("nominal", "fast"):
        runs = [BenchRun(policy=f"{tmp_path}/gains.py:Gain{k}", task="Straighten", physics=physics) for k in range(len(GAINS))]
        found[physics] = [summarise([run(run.scenario(seed), seed, 0.0) for seed in range(6)]) for run in runs]
    nominal, fast = (np.array([summary["score"] for summary in found[physics]]) for physics in ("nominal", "fast"))
    assert np.abs(nominal - fast).max() <= 0.02
    ranks = [np.argsort(np.argsort(scores)) for scores in (nominal, fast)]
    assert np.corrcoef(*ranks)[0, 1] >= 0.95
    for low in range(len(GAINS)):
        for high in range(len(GAINS)):
            if found["nominal"][low]["interval"][1] < found["nominal"][high]["interval"][0]:
                assert fast[low] < fast[high]
