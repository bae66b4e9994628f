"""Stairs that turn: the chair turns on a landing between two flights, up and down, and goes on over the next flight."""

import re

import numpy as np
import pytest

from treadline.core.angles import DEG
from treadline.run.episode import Traverse, traverse
from treadline.scenario.scenario import read_scenario
from treadline.scenario.shipped_files import shipped_controller

pytestmark = pytest.mark.usefixtures("without_shape_checks")


@pytest.fixture(scope="module", params=[("quarter-up", "statistical"), ("quarter-down", "rendered")], ids=" ".join)
def ride(request: pytest.FixtureRequest) -> Traverse:
    name, model = request.param
    scenario = read_scenario(name)
    scenario = scenario.model_copy(update={"sensors": scenario.sensors.model_copy(update={"model": model})})
    return traverse(scenario, controller=shipped_controller("wheelchair"), seed=1)


def test_the_chair_arrives_over_both_flights(ride: Traverse) -> None:
    """Test: two flights of five steps, a quarter landing of 2 m. Expected result: arrival, one turn, quiet; square to each
    flight as to a single one."""
    assert (ride.verdict, ride.cause) == ("arrived", None)
    assert [phase for _, phase in ride.scores.phases].count("turn") == 1
    assert ride.scores.max_pitch_rate_deg_s <= 15.0
    assert ride.scores.aligned_max_heading_deg is not None
    assert ride.scores.aligned_max_heading_deg < 6.0


def test_the_turn_is_on_its_plan_and_comfortable(ride: Traverse) -> None:
    """Expected result: the search of the next flight says at most 4 cm off the plan; below 20 °/s while it turns."""
    said = next(event.cause for event in ride.events if "off its plan" in (event.cause or ""))
    found = re.search(r"at most (\d+) cm off its plan", said or "")
    assert found is not None
    assert int(found[1]) <= 4
    begins, ends = (t_s for t_s, phase in ride.scores.phases[ride_index(ride) : ride_index(ride) + 2])
    within = (ride.trace["t_s"] >= begins) & (ride.trace["t_s"] <= ends)
    rates = np.gradient(np.unwrap(ride.trace["yaw_rad"][within]), ride.trace["t_s"][within])
    assert np.abs(rates).max() < 22.0 * DEG


def ride_index(ride: Traverse) -> int:
    return [phase for _, phase in ride.scores.phases].index("turn")
