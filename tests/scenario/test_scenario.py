"""Scenario files: meaning of keys, and rejection of invalid ones."""

import math
import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from treadline.core.errors import SettingsError
from treadline.scenario.chair import read_chair
from treadline.scenario.scenario import Scenario, Stair, chair_of_run, read_scenario, shipped_scenarios


def read(text: str, tmp_path: Path) -> Scenario:
    path = tmp_path / "scenario.toml"
    path.write_text(text, encoding="utf-8")
    return read_scenario(path)


def refusal(text: str, tmp_path: Path) -> str:
    with pytest.raises(SettingsError) as refused:
        read(text, tmp_path)
    where, name, message = str(refused.value).partition("scenario.toml:")
    assert Path(where) == tmp_path
    assert name
    assert "\n" not in message
    return re.sub(r"^\d*:? ", "", message)


def test_every_key_has_a_default(tmp_path: Path) -> None:
    assert read("", tmp_path) == Scenario()


@given(slope_deg=st.floats(5.0, 45.0), run_m=st.floats(0.15, 0.60))
def test_a_slope_is_another_way_to_write_the_rise(slope_deg: float, run_m: float) -> None:
    rise = run_m * math.tan(math.radians(slope_deg))
    if 0.01 <= rise <= 0.30:
        stair = Stair(slope_deg=slope_deg, run_m=run_m)
        assert stair.rise_m == rise
        # tan and atan2 are each good to a few ulp.
        assert stair.slope_rad == pytest.approx(math.radians(slope_deg), rel=1e-14)
    else:
        with pytest.raises(ValueError, match=r"slope_deg .*run_m .*rise of .*from 0\.01 to 0\.3 m"):
            Stair(slope_deg=slope_deg, run_m=run_m)


@pytest.mark.parametrize("slope_deg", [28, 28.072486935852957])
def test_rise_and_slope_are_refused_together_even_where_they_agree(slope_deg: float, tmp_path: Path) -> None:
    text = f"[stair]\nrise_m = 0.16\nrun_m = 0.3\nslope_deg = {slope_deg}"
    assert refusal(text, tmp_path) == "stair: give rise_m or slope_deg, not both"


def test_missing_steps_lie_between_the_floor_and_the_landing(tmp_path: Path) -> None:
    assert read("[stair]\nsteps = 20\nmissing_steps = [0, 18]", tmp_path).stair.missing_steps == (0, 18)


def test_a_start_on_the_floor_may_name_any_step(tmp_path: Path) -> None:
    read('[stair]\nsteps = 8\n[start]\nplace = "floor"\nstep = 8', tmp_path)  # where the step means nothing


def test_a_chair_file_is_sought_next_to_the_scenario_then_in_the_working_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    working, beside = tmp_path / "here", tmp_path / "there"
    for folder in (working, beside):
        folder.mkdir()
    monkeypatch.chdir(working)
    text = '[chair]\nmodel = "own.toml"'
    said = refusal(text, beside)
    assert said == f"chair.model: no file 'own.toml' (looked for {beside / 'own.toml'}, own.toml); correct the path"
    (working / "own.toml").touch()
    assert read(text, beside).chair.model == "own.toml"
    (beside / "own.toml").touch()
    assert read(text, beside).chair.model == str(beside / "own.toml")


@pytest.mark.parametrize("name", list(shipped_scenarios()))
def test_a_shipped_scenario_is_unchanged_by_serialisation(name: str) -> None:
    scenario = read_scenario(name)
    assert Scenario.model_validate_json(scenario.model_dump_json()) == scenario
    assert Scenario.model_validate(scenario.model_dump()) == scenario


def test_a_shipped_scenario_is_found_next_to_a_folder_of_its_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "paper-28").mkdir()
    assert read_scenario("paper-28").start.heading_deg == 30.0


@pytest.mark.parametrize(
    ("settings", "name"),
    [
        ({"robot": {"mission": {"chair": "wheelchair"}}}, "wheelchair"),
        ({"chair": {"model": "rescue"}}, "rescue"),
        ({"replay": {}, "scenario": {"chair": {"model": "rescue"}}}, "rescue"),
        ({"replay": {}, "scenario": None}, "wheelchair"),
    ],
)
def test_the_chair_of_a_run_is_that_of_its_robot_file_its_scenario_or_its_log(settings: dict[str, object], name: str) -> None:
    assert chair_of_run(settings, "settings") == read_chair(name)
