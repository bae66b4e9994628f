"""Plug-ins: a user's own controller, detector and estimator, by name, and what happens to one that cannot be used."""

import sys
from importlib.metadata import EntryPoint, EntryPoints
from pathlib import Path
from typing import Any

import pytest

from treadline.core.errors import SettingsError
from treadline.core.signals import TrackCommand
from treadline.estimation import HeadingFilter
from treadline.mission.mission_blocks import build_blocks, warm_up
from treadline.mission.mission_config import MissionConfig, Plugins, is_full_traversal
from treadline.mission.planner import Cruise
from treadline.mission.plugins import load_plugin
from treadline.mission.traversal import Traversal
from treadline.scenario.chair import read_chair

CHAIR = read_chair("wheelchair")
SOURCE = """
from treadline.core.signals import TrackCommand

class Straight:
    follows_plan = True
    period_s = 0.25
    def __init__(self, config):
        self.speed = config.climb_speed_m_s
    def step(self, estimate, t_s, plan):
        return TrackCommand(t_s=t_s, left_m_s=plan.speed_m_s, right_m_s=plan.speed_m_s)
"""


class WithoutPeriod:
    """No driver: nobody knows when to call it."""

    follows_plan = True

    def __init__(self, config: MissionConfig) -> None:
        self.config = config

    def step(self, estimate: object, t_s: float, plan: object) -> TrackCommand:
        del estimate, plan
        return TrackCommand.stop(t_s)


class Own(WithoutPeriod):
    """A controller."""

    period_s = 0.1


class OnOneFlight(Own):
    """A controller that has the flight for itself."""

    follows_plan = False


class Blind:
    """A detector that finds nothing."""

    maps_stair = True

    def __init__(self, config: MissionConfig) -> None:
        del config

    def see(self, frame: object, gravity_C: object = None) -> Any:
        raise NotImplementedError


class HeadingOnly(Blind):
    """A detector without a stair map."""

    maps_stair = False


class OwnFilter(HeadingFilter):
    """An estimator."""

    def __init__(self, config: MissionConfig) -> None:
        del config
        super().__init__()


def configured(**plugins: Any) -> MissionConfig:
    return MissionConfig(chair=CHAIR, plugins=Plugins(**plugins))


def test_the_warm_up_builds_no_plug_in() -> None:
    warm_up(configured(detector=pytest.fail, estimator=pytest.fail, controller=pytest.fail))


def test_a_controller_that_follows_the_plan_gets_every_phase_of_a_traversal() -> None:
    config = configured(controller=Own)
    blocks = build_blocks(config)
    assert isinstance(blocks.driver, Own)
    assert blocks.driver.config is config
    assert is_full_traversal(config)
    assert isinstance(blocks.planner, Traversal)
    assert blocks.guard.config.watches_slip
    assert blocks.guard.config.driver_timeout_s == pytest.approx(0.3)  # three of its periods


def test_a_controller_that_does_not_follow_the_plan_drives_the_flight_alone() -> None:
    blocks = build_blocks(configured(controller=OnOneFlight))
    assert isinstance(blocks.planner, Cruise)
    assert not blocks.guard.config.watches_slip


def test_a_detector_without_a_stair_map_drives_the_flight_alone() -> None:
    assert isinstance(build_blocks(configured(controller=Own, detector=Blind)).planner, Traversal)
    blocks = build_blocks(configured(controller=Own, detector=HeadingOnly))
    assert isinstance(blocks.planner, Cruise)
    assert isinstance(blocks.detector, HeadingOnly)


def test_an_estimator_takes_the_place_of_the_shipped_one() -> None:
    assert isinstance(build_blocks(configured(controller=Own, estimator=OwnFilter)).estimator, OwnFilter)


def test_what_a_plug_in_builds_must_be_a_driver() -> None:
    with pytest.raises(SettingsError, match="controller plug-in builds a WithoutPeriod without period_s; add it"):
        build_blocks(configured(controller=WithoutPeriod))


def test_a_class_is_found_in_a_module_of_the_working_directory_and_in_a_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "my_straight_controller.py").write_text(SOURCE)
    monkeypatch.chdir(tmp_path)
    before = list(sys.path)
    for source in ("my_straight_controller:Straight", "my_straight_controller.py:Straight"):
        plugin = load_plugin("controller", source)
        assert plugin.follows_plan
        blocks = build_blocks(MissionConfig(chair=CHAIR, plugins=Plugins(controller=plugin)))
        assert blocks.driver.period_s == 0.25
    assert sys.path == before


def test_an_entry_point_is_found_by_its_name(monkeypatch: pytest.MonkeyPatch) -> None:
    entries = EntryPoints([EntryPoint(name="steady", value=f"{__name__}:Own", group="treadline.controllers")])
    monkeypatch.setattr("treadline.mission.plugins.entry_points", lambda group: entries.select(group=group))
    assert load_plugin("controller", "steady").__name__ == "Own"
    with pytest.raises(SettingsError, match=r"'?steadi.*installed: steady.*did you mean 'steady'"):
        load_plugin("controller", "steadi")
    with pytest.raises(SettingsError, match=r"group treadline\.detectors"):
        load_plugin("detector", "steady")


def test_the_manifest_names_a_plug_in_by_module_and_class() -> None:
    assert Plugins(controller=Own).sources() == {"controller": f"{Own.__module__}:Own"}
    assert Plugins().sources() == {}
