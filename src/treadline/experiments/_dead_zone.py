"""The dead zone: yaw rate over belt difference on 28° with Table I's friction, in the simulator and by Coulomb's law.

Near straight the inner belt sticks and no belt difference turns the chair, so that an excitation there identifies noise. Each row
starts a chair at a heading, drives the belts apart and compares its mean yaw rate with a quasi-static run from the same heading and
place (``vehicle.quasi_static``), which knows nothing of the simulator.
"""

import math
from contextlib import closing
from functools import partial
from typing import Any

from treadline.core.angles import DEG
from treadline.core.signals import SeatCommand, TrackCommand
from treadline.experiments.plan import FIG10_SLOPE, turn
from treadline.plant.mujoco import open_plant
from treadline.scenario.scenario import Scenario
from treadline.vehicle.bodies import centre_of_mass
from treadline.vehicle.quasi_static import quasi_static_run

HEADINGS_DEG = (0, 5, 10, 15, 30)
DIFFERENCES_M_S = (0.05, 0.1, 0.2, 0.4, 0.8)
SLOW_M_S = 0.1
"""Speed of the inner belt [m/s]."""
FROM_S, UNTIL_S = 0.3, 0.8
"""Averaging interval of the yaw rate [s]: from two lags of the belt drives after the start, shorter than a nosing's passage."""


def rows(seed: int) -> list[dict[str, Any]]:
    """Return one row per heading and belt difference."""
    return [row(heading, difference, seed) for heading in HEADINGS_DEG for difference in DIFFERENCES_M_S]


def row(heading_deg: int, difference_m_s: float, seed: int) -> dict[str, Any]:
    """Return simulated and theoretical yaw rate of one start; the left belt is faster, which turns the chair back to straight."""
    scenario = turn(FIG10_SLOPE, heading_deg, UNTIL_S).changed(chair={"belt_mismatch": 0.0}, control={"vision": "truth"})
    with closing(open_plant(scenario, seed)) as plant:
        plant.start()
        plant.write(
            TrackCommand(t_s=0.0, left_m_s=SLOW_M_S + difference_m_s, right_m_s=SLOW_M_S), SeatCommand(t_s=0.0, rate_m_s=0.0)
        )
        plant.advance(FROM_S)
        first = plant.truth()[-1]
        plant.advance(UNTIL_S)
        last = plant.truth()[-1]
    return {
        "slope_deg": FIG10_SLOPE,
        "heading_deg": heading_deg,
        "difference_m_s": difference_m_s,
        "yaw_rate_deg_s": (last.heading_rad - first.heading_rad) / (UNTIL_S - FROM_S) / DEG,
        "theory_deg_s": _theory(scenario, first.heading_rad, first.x_m, difference_m_s) / DEG,
    }


def _theory(scenario: Scenario, heading_rad: float, x_m: float, difference_m_s: float) -> float:
    """Return the mean yaw rate of a quasi-static run from the same heading and place [rad/s]."""
    stair = scenario.stair
    pitch_m = math.hypot(stair.rise_m, stair.run_m)
    chair = scenario.read_chair()
    run = quasi_static_run(
        chair,
        partial(centre_of_mass, chair, scenario.chair),
        stair.slope_rad,
        pitch_m,
        stair.friction,
        SLOW_M_S + difference_m_s,
        SLOW_M_S,
        UNTIL_S - FROM_S,
        heading_rad=heading_rad,
        nosing_ahead_m=pitch_m - math.fmod(x_m, pitch_m),
    )
    return run.yaw_rad_s
