"""Scenario files: meaning of keys, and rejection of invalid ones."""

import math
import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from treadline.core.errors import SettingsError
from treadline.scenario.scenario import Scenario, Stair, read_scenario, shipped_scenarios
from treadline.scenario.shipped_files import CHAIRS


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


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[stair]\nslope_deg = 90", "stair.slope_deg: must be a number from 5 to 45 (got 90)"),
        (
            "[stair]\nslope_deg = 45\nrun_m = 0.6",
            "stair: slope_deg = 45 with run_m = 0.6 is a rise of 0.600 m; it must be from 0.01 to 0.3 m",
        ),
        (
            '[belts]\nlug = "15/80"\ntip_m = 0.06',
            "belts: a lug's tip of 0.060 m and its two flanks of 0.014 m are longer than the pitch of 0.080 m: "
            "lugs would overlap; give belts.pitch_m of at least 0.088",
        ),
        (
            "[belts]\nstiffness_s = 0.002",
            "belts: belts.stiffness_s is 0.002, the contact's time constant; "
            "physics steps of 2 ms integrate from 0.004 s (two steps), and rubber is stiffer than 0.05 s",
        ),
        ('[start]\nplace = "roof"', "start.place: must be 'floor', 'flight' or 'landing' (got 'roof')"),
    ],
)
def test_a_wrong_key_is_named_as_it_stands_in_the_file(text: str, message: str, tmp_path: Path) -> None:
    assert refusal(text, tmp_path) == message


@pytest.mark.parametrize("slope_deg", [28, 28.072486935852957])
def test_rise_and_slope_are_refused_together_even_where_they_agree(slope_deg: float, tmp_path: Path) -> None:
    text = f"[stair]\nrise_m = 0.16\nrun_m = 0.3\nslope_deg = {slope_deg}"
    assert refusal(text, tmp_path) == "stair: give rise_m or slope_deg, not both"


def test_missing_steps_lie_between_the_floor_and_the_landing(tmp_path: Path) -> None:
    assert read("[stair]\nsteps = 20\nmissing_steps = [0, 18]", tmp_path).stair.missing_steps == (0, 18)
    for index in (19, 20):
        message = refusal(f"[stair]\nsteps = 20\nmissing_steps = [3, {index}]", tmp_path)
        assert message.startswith(f"stair: missing_steps names step {index} of a flight of 20 steps")
        assert "18" in message


def test_a_stair_of_one_step_has_none_that_may_be_missing(tmp_path: Path) -> None:
    message = refusal("[stair]\nsteps = 1\nmissing_steps = [0]", tmp_path)
    assert message == "stair: missing_steps names step 0, and with steps = 1 every step is a landing; remove it"


def test_a_start_on_the_flight_stands_on_one_of_its_steps(tmp_path: Path) -> None:
    message = refusal('[stair]\nsteps = 8\n[start]\nplace = "flight"\nstep = 8', tmp_path)
    assert message == "start.step is 8, the flight has 8 steps; give one from 0 to 7"
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


def test_an_unknown_chair_lists_the_shipped_ones(tmp_path: Path) -> None:
    shipped = ", ".join(sorted(path.stem for path in CHAIRS.glob("*.toml")))
    said = refusal('[chair]\nmodel = "throne"', tmp_path)
    assert said == f"chair.model: no shipped chair 'throne' (shipped: {shipped}); or give a path to a .toml"


@pytest.mark.parametrize("name", list(shipped_scenarios()))
def test_a_shipped_scenario_is_unchanged_by_serialisation(name: str) -> None:
    scenario = read_scenario(name)
    assert Scenario.model_validate_json(scenario.model_dump_json()) == scenario
    assert Scenario.model_validate(scenario.model_dump()) == scenario


def test_a_shipped_scenario_is_found_next_to_a_folder_of_its_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "paper-28").mkdir()
    assert read_scenario("paper-28").start.heading_deg == 30.0
