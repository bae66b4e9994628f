"""Chair files: required keys and invalid values."""

import math

import pytest

from treadline.scenario.chair import read_chair
from treadline.vehicle.tracks import pulley_centres


def test_the_nose_is_the_third_pulley() -> None:
    chair = read_chair("wheelchair")
    x, y, z = chair.nose_m
    front_x, front_z = pulley_centres(chair)[1].tolist()
    assert math.hypot(x - front_x, z - front_z) == pytest.approx(chair.tracks.approach_m)
    assert math.degrees(math.atan2(z - front_z, x - front_x)) == pytest.approx(chair.tracks.approach_angle_deg)
    assert y == 0.0
