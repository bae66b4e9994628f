"""Every example of docs/scenarios.md is a scenario file: it is read, built, and the simulator runs a second of it."""

import re
from pathlib import Path

import numpy as np
import pytest

from treadline.core.errors import MechanicsError
from treadline.core.signals import SeatCommand, TrackCommand
from treadline.plant.faults import faulty
from treadline.plant.mujoco import open_plant
from treadline.run.resolve import checked as check
from treadline.scenario.chair import read_chair
from treadline.scenario.scenario import Scenario, read_scenario

PAGE = (Path(__file__).parents[2] / "docs" / "scenarios.md").read_text(encoding="utf-8")
EXAMPLES: dict[str, str] = dict(re.findall(r"\n### ([^\n]+)\n[^#]*?```toml\n(.*?)```", PAGE, re.DOTALL))


def scenario(title: str, folder: Path) -> Scenario:
    path = folder / "example.toml"
    path.write_text(EXAMPLES[title], encoding="utf-8")
    return read_scenario(path)


def test_every_example_of_the_page_is_among_these() -> None:
    assert len(EXAMPLES) == PAGE.count("```toml") == PAGE.count("\n### ")


@pytest.mark.parametrize("title", list(EXAMPLES))
def test_an_example_is_built_and_runs(title: str, tmp_path: Path) -> None:
    """Test: belts driven for a second from the start. Expected result: it moves its way, upright, on its belts alone."""
    asked = scenario(title, tmp_path)
    asked = asked.model_copy(update={"sensors": asked.sensors.model_copy(update={"camera": "statistical"})})
    plant = faulty(open_plant(asked, 2), asked, 2)
    plant.start()
    speed_m_s = 0.1 if asked.drive.direction == "up" else -0.1
    for k in range(101):
        plant.advance(0.01 * k)
        plant.read()
        plant.write(TrackCommand(t_s=0.01 * k, left_m_s=speed_m_s, right_m_s=speed_m_s), SeatCommand(t_s=0.01 * k, rate_m_s=0.0))
    truth = plant.truth()
    moved_m = (truth[-1].x_m - truth[0].x_m) / speed_m_s
    # 0.15 s of lag are lost, and on level ground x is counted along the slope: 0.85 s by cos 35° at least.
    assert 0.6 < moved_m < 0.95
    assert abs(truth[-1].roll_rad) < np.radians(3.0)
    assert max(sample.hull_contacts for sample in truth) == 0.0


@pytest.mark.parametrize("title", list(EXAMPLES))
def test_check_has_an_answer_for_every_example(title: str, tmp_path: Path) -> None:
    asked = scenario(title, tmp_path)
    try:
        report = check(asked, read_chair(asked.chair.model))
    except MechanicsError as error:
        report, said = None, str(error)
    if report is None:
        assert "cannot stand at its start: " in said
        return
    assert report.verdict == ("refuse" if report.reasons else "go")
    assert all("; " in reason for reason in report.reasons)
