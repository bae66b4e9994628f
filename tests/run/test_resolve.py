"""One resolved run: what is read, how often, and what follows from it."""

from pathlib import Path
from typing import Any

import pytest

import treadline.mission.mission_config
import treadline.run.resolve
import treadline.scenario.chair
from treadline.core.errors import SettingsError
from treadline.mission.belt_controllers import ConstantSpeed
from treadline.mission.mission_config import is_full_traversal
from treadline.run.resolve import resolve
from treadline.scenario.scenario import Scenario, read_scenario
from treadline.scenario.shipped_files import CONTROLLERS, shipped_controller


def test_a_seat_shifted_so_that_the_chair_may_climb_is_the_missions() -> None:
    heavy = {"payload_kg": 80.0, "payload_offset_m": [-0.2, 0.0, 0.05]}
    tables = {"stair": {"slope_deg": 28.0, "steps": 8}, "start": {"place": "floor"}, "chair": heavy}
    setup = resolve(Scenario.model_validate(tables))
    assert setup.seat_shift is not None
    assert setup.scenario.chair.seat_shift_m != 0.0
    assert setup.rejections == ()
    assert setup.report.verdict == "refuse"  # of the scenario as given
    assert setup.mission.chair == setup.chair.with_seat_shifted(setup.scenario.chair.seat_shift_m)


def test_a_rejected_scenario_needs_no_controller(tmp_path: Path) -> None:
    chair = (Path(treadline.__file__).parent / "data" / "chairs" / "wheelchair.toml").read_text()
    (tmp_path / "mine.toml").write_text(chair.replace('name = "wheelchair"', 'name = "mine"', 1))
    scenario = tmp_path / "scenario.toml"
    scenario.write_text('[stair]\nslope_deg = 44\n[chair]\nmodel = "mine.toml"\n')
    setup = resolve(scenario)
    assert any("44.0° steep" in reason for reason in setup.rejections)
    assert setup.mission.controller is None
    scenario.write_text('[chair]\nmodel = "mine.toml"\n')
    with pytest.raises(SettingsError, match="no controller is shipped for 'mine'"):
        resolve(scenario)


@pytest.mark.parametrize("kind", [str, Path])
def test_a_controller_is_a_path_a_design_or_left_out(kind: type) -> None:
    design = shipped_controller("wheelchair")
    for given in (None, design, kind(CONTROLLERS / "wheelchair.json")):
        found = resolve("up-28", given).mission.controller
        assert (found.K == design.K).all()


def test_an_open_loop_and_an_experiments_driver_need_no_controller() -> None:
    opened = resolve(Scenario.model_validate({"control": {"loop": "open"}}))
    assert opened.mission.controller is None
    assert not is_full_traversal(opened.mission, opened.driver)
    driver = ConstantSpeed(0.1, 0.25)
    own = resolve("up-28", driver)
    assert own.build_blocks().driver is driver
    assert not is_full_traversal(own.mission, own.driver)


def test_an_own_plant_reports_the_ground_where_it_declares_it() -> None:
    measures = Scenario.model_validate({"sensors": {"camera": "statistical"}})

    class Own:
        reports_ground = True

    plants: tuple[tuple[Any, bool], ...] = (("mujoco", True), ("gazebo", True), (lambda *_: None, False), (Own, True))
    for plant, reports in plants:
        assert resolve(measures, open_plant=plant).mission.reports_ground is reports
    assert resolve("up-28").mission.reports_ground  # rendered images


def test_a_scenario_is_a_name_a_path_or_itself(tmp_path: Path) -> None:
    scenario = read_scenario("up-28")
    path = tmp_path / "here.toml"
    path.write_bytes((Path(treadline.__file__).parent / "data" / "scenarios" / "up-28.toml").read_bytes())
    assert resolve(scenario).scenario == resolve("up-28").scenario == resolve(path).scenario == resolve(str(path)).scenario
