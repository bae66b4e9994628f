"""Chair files: required keys and invalid values."""

import math
import re
from pathlib import Path

import pytest
from chairs import changed_chair

from treadline.core.errors import SettingsError
from treadline.scenario.chair import read_chair
from treadline.vehicle.tracks import pulley_centres


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "belt_width_m = 0.10",
            "belt_width_m = 0.10\nroad_wheels = 1",
            "tracks.road_wheels: 1 road wheel under each flat run; give 2 or ",
        ),
        ("gauge_m = 0.65", "", "tracks.gauge_m: missing; give a number > 0 and ≤ 10"),
        ("chassis_kg = 23.4", "chassis_kg = 23400", "masses.chassis_kg: must be a number > 0 and ≤ 1000 (got 23400)"),
        ("max_speed_m_s = 1.0", "max_speed_m_s = 60", "drives.max_speed_m_s: must be a number > 0 and ≤ 10 (got 60)"),
        ("torque_n_m = 200.0", "torque_n_m = -5.0", "flipper.torque_n_m: a torque limit of -5 N·m; give more than 0: "),
        ("\nlag_s = 0.15", "\nlag_s = 0.004", "drives.lag_s: a lag of 0.004 s is below the tick of 0.01 s; give 0.01 s or more: "),
        ("lag_s = 0.1\n", "lag_s = 0.009\n", "seat.lag_s: a lag of 0.009 s is below the tick of 0.01 s; "),
        (
            "no_load_speed_m_s = 1.25",
            "no_load_speed_m_s = 0.5",
            "motor.no_load_speed_m_s is 0.5, below drives.max_speed_m_s of 1: ",
        ),
        ("com_m = [0.0, 0.0, 0.17]", "com_m = [0.0, 0.4, 0.17]", "masses.chassis_com_m is [0, 0.4, 0.17], not above the tracks, "),
        ("com_m = [0.0, 0.0, 0.17]", "com_m = [0.0, 0.0, -0.17]", "masses.chassis_com_m is [0, 0, -0.17], not above the tracks, "),
        ("slope_deg = 32.0", "slope_deg = 0.56", "rating.slope_deg: must be a number from 5 to 45 (got 0.56); did you mean 32.1, "),
        ("[tracks]", "[track]", "track: unknown table; did you mean [tracks]? (and 1 more)"),
        (
            "range_deg = [-75.0, 60.0]",
            "range_deg = [-75.0, 30.0]",
            "tracks.approach_angle_deg is 40, where the flipper rests; flipper.range_deg is -75 to 30",
        ),
        ("hold_n = 6000.0\n", "", "seat: give push_n, no_load_m_s and hold_n together, or none"),
        ("[camera]", "[camera]\nzoom = 2", "camera.zoom: unknown key; known here: "),
    ],
)
def test_what_is_wrong_is_named(tmp_path: Path, old: str, new: str, message: str) -> None:
    path = changed_chair(tmp_path, old, new)
    with pytest.raises(SettingsError) as refused:
        read_chair(path)
    assert re.fullmatch(rf"{re.escape(str(path))}:\d+: {re.escape(message)}.*", str(refused.value))


def test_a_rule_of_two_tables_is_found_at_the_line_of_the_key_that_it_names(tmp_path: Path) -> None:
    path = changed_chair(tmp_path, "com_m = [0.0, 0.0, 0.17]", "com_m = [-0.5, 0.0, 0.17]")
    line = Path(path).read_text().splitlines().index("chassis_com_m = [-0.5, 0.0, 0.17]") + 1
    with pytest.raises(SettingsError, match=rf":{line}: masses\.chassis_com_m is"):
        read_chair(path)


def test_the_nose_is_the_third_pulley() -> None:
    chair = read_chair("wheelchair")
    x, y, z = chair.nose_m
    front_x, front_z = pulley_centres(chair)[1].tolist()
    assert math.hypot(x - front_x, z - front_z) == pytest.approx(chair.tracks.approach_m)
    assert math.degrees(math.atan2(z - front_z, x - front_x)) == pytest.approx(chair.tracks.approach_angle_deg)
    assert y == 0.0
