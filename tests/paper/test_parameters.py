"""Table I and the sampling time, read from the objects that run."""

import math

import pytest

from treadline.control.heading_controller import ControllerConfig
from treadline.core import paper
from treadline.core.signals import TICK_S
from treadline.experiments.as_printed import paper_controller
from treadline.experiments.plan import SLOPES_DEG, turn
from treadline.scenario.camera_file import KINECT_1
from treadline.scenario.scenario import Scenario


@pytest.fixture
def scenario() -> Scenario:
    return turn(int(paper.SLOPE_DEG), 30, paper.FIG10_DURATION_S)


def test_the_runs_carry_the_papers_payload_over_the_papers_friction(scenario: Scenario) -> None:
    assert scenario.chair.payload_kg == paper.PAYLOAD_KG
    assert tuple(scenario.stair.friction) == paper.FRICTION


def test_the_runs_climb_the_slopes_of_tables_1_and_2(scenario: Scenario) -> None:
    assert paper.SLOPE_DEG in SLOPES_DEG
    assert math.degrees(math.atan2(scenario.stair.rise_m, scenario.stair.run_m)) == pytest.approx(paper.SLOPE_DEG)


def test_sensors_and_loop_run_at_the_rates_of_table_1() -> None:
    assert pytest.approx(paper.IMU_RATE_HZ) == 1.0 / TICK_S
    assert pytest.approx(paper.CAMERA_RATE_HZ) == KINECT_1.rate_hz
    assert pytest.approx(paper.CONTROL_RATE_HZ) == 1.0 / ControllerConfig().period_s


def test_the_paper_tunes_for_one_period_and_controls_at_another() -> None:
    assert paper_controller(0.2).period_s == paper.SAMPLING_TIME_S
    assert pytest.approx(4.0) == paper.SAMPLING_TIME_S * paper.CONTROL_RATE_HZ
