"""One resolved run: what is read, how often, and what follows from it."""

from collections import Counter
from pathlib import Path
from typing import Any

import pytest

import treadline.mission.mission_config
import treadline.run.resolve
import treadline.scenario.chair
from treadline.core.errors import SettingsError
from treadline.core.models import ControllerDesign
from treadline.mission.belt_controllers import ConstantSpeed
from treadline.run.resolve import resolve, with_seat_shifted
from treadline.scenario.scenario import Scenario, read_scenario
from treadline.scenario.shipped_files import CONTROLLERS, shipped_controller


@pytest.fixture
def counts(monkeypatch: pytest.MonkeyPatch) -> Counter[str]:
    """Count how often files are read, the scenario is checked, and the mission is configured."""
    counted: Counter[str] = Counter()

    def count(place: Any, name: str) -> None:
        real = getattr(place, name)

        def counting(*args: Any, **options: Any) -> Any:
            counted[name] += 1
            return real(*args, **options)

        monkeypatch.setattr(place, name, counting)

    count(treadline.scenario.chair, "read_toml")
    count(treadline.run.resolve, "check")
    count(treadline.run.resolve, "MissionConfig")
    real_load = ControllerDesign.load.__func__

    def load(cls: type[ControllerDesign], path: Path) -> ControllerDesign:
        counted["controller"] += 1
        design: ControllerDesign = real_load(cls, path)
        return design

    monkeypatch.setattr(ControllerDesign, "load", classmethod(load))
    return counted


def test_a_climb_reads_each_file_once_and_checks_once(counts: Counter[str], tmp_path: Path) -> None:
    from treadline.cli import main

    scenario = tmp_path / "short.toml"
    scenario.write_text('[drive]\nduration_s = 0.2\n[sensors]\ncamera = "statistical"\n')
    assert main(["climb", str(scenario), "--out", str(tmp_path / "run")]) == 0
    assert counts == {"read_toml": 1, "check": 1, "MissionConfig": 1, "controller": 1}


def test_only_a_shifted_seat_is_checked_again(counts: Counter[str]) -> None:
    heavy = {"payload_kg": 80.0, "payload_offset_m": [-0.1, 0.0, 0.05]}
    setup = resolve(Scenario.model_validate({"stair": {"slope_deg": 30.0}, "chair": heavy}))
    assert setup.seat_shift is not None
    assert setup.scenario.chair.seat_shift_m != 0.0
    assert setup.rejections == ()
    assert setup.report.verdict == "refuse"  # of the scenario as given
    assert counts["check"] == 2
    assert counts["read_toml"] == 1
    assert setup.mission.chair == with_seat_shifted(setup.chair, setup.scenario.chair.seat_shift_m)


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
    assert not opened.is_full_traversal
    driver = ConstantSpeed(0.1, 0.25)
    own = resolve("up-28", driver)
    assert own.build_blocks().driver is driver
    assert not own.is_full_traversal


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
