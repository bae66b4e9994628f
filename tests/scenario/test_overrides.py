"""Values by dotted key in place of a scenario's: what is set holds, what contradicts it goes, and mistakes are one line."""

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from treadline.core.errors import SettingsError
from treadline.core.overrides import parse_items
from treadline.scenario.scenario import read_scenario, shipped_scenarios, with_values

FILE = """
[stair]
rise_m = 0.16
run_m = 0.28
[[step]]
index = 3
friction_left = [0.4, 0.4]
friction_right = [0.3, 0.3]
[[fault]]
kind = "camera_lost"
at_s = 5.0
"""


@pytest.fixture
def path(tmp_path: Path) -> Path:
    found = tmp_path / "mine.toml"
    found.write_text(FILE)
    return found


@given(name=st.sampled_from(sorted(shipped_scenarios())), slope_deg=st.floats(15.0, 40.0))
def test_a_set_slope_takes_the_place_of_the_rise_and_a_set_rise_that_of_the_slope(name: str, slope_deg: float) -> None:
    before = read_scenario(name)
    tilted = read_scenario(name, {"stair.slope_deg": slope_deg})
    # tan and atan2 are each good to a few ulp.
    assert tilted.stair.slope_rad == pytest.approx(math.radians(slope_deg), rel=1e-14)
    assert tilted.stair.run_m == before.stair.run_m
    assert with_values(tilted.model_dump(), {"stair.rise_m": before.stair.rise_m}) == before
    assert with_values(before.model_dump(), {"stair.slope_deg": slope_deg}) == tilted


def test_of_a_list_one_item_is_set_or_added(path: Path) -> None:
    changed = read_scenario(
        path, {"step.0.friction": [0.5, 0.4], "fault.0.at_s": 9, "fault.1.kind": "imu_lost", "chair.lean_m.1": 0.1}
    )
    assert (changed.step[0].index, changed.step[0].friction) == (3, (0.5, 0.4))
    assert changed.step[0].friction_left is changed.step[0].friction_right is None
    assert [(fault.kind, fault.at_s) for fault in changed.fault] == [("camera_lost", 9.0), ("imu_lost", 10.0)]
    assert changed.chair.lean_m == (0.0, 0.1)


def test_a_table_is_merged_and_arrays_and_paths_are_values(path: Path) -> None:
    values = {"stair": {"steps": np.int64(7), "friction": np.array([0.6, 0.5])}, "start.heading_deg": np.float64(4.0)}
    changed = read_scenario(path, values)
    assert (changed.stair.steps, changed.stair.friction, changed.stair.run_m) == (7, (0.6, 0.5), 0.28)
    assert changed.start.heading_deg == 4.0
    with pytest.raises(SettingsError, match="no file 'none"):
        read_scenario(path, {"chair.model": Path("none.toml")})


def test_items_of_the_command_line_are_toml_or_text_and_the_last_of_a_key_holds() -> None:
    items = ["a.b = 30", "a.c=[1, 2.5]", "a.d=wood", "a.e='x=y'", "f=true", "a.b=31", "g=", "h=1 2"]
    expected = {"a.b": 31, "a.c": [1, 2.5], "a.d": "wood", "a.e": "x=y", "f": True, "g": "", "h": "1 2"}
    assert parse_items(items) == expected
    with pytest.raises(SettingsError, match="--set here: must be key=value"):
        parse_items(["here"])


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"slope_deg": 30}, "slope_deg: unknown key here; it belongs to [stair]"),
        ({"stairs.steps": 30}, "stairs: unknown table; did you mean [stair]?"),
        ({"stair.steps.x": 30}, "stair.steps: must be a whole number from 1 to 2000 (got a table)"),
        ({"stair": 3}, "stair: must be a table, [stair] (got 3)"),
    ],
)
def test_a_mistake_names_scenario_key_and_remedy(values: dict[str, object], message: str, path: Path) -> None:
    with pytest.raises(SettingsError) as refused:
        read_scenario(path, values)
    assert str(refused.value) == f"{path}, as changed: {message}"


@pytest.mark.parametrize("key", ["fault.2.at_s", "fault.at_s", "chair.lean_m.x"])
def test_an_index_outside_its_list_is_refused(key: str, path: Path) -> None:
    with pytest.raises(SettingsError, match=rf"set {key}: '\w+' must be the index of an item, from 0 to [12]$"):
        read_scenario(path, {key: 1})
