"""The moving picture: the chair is drawn where the ground truth has it."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from treadline.errors import SettingsError
from treadline.mechanics.chair import read_chair
from treadline.ports import Truth
from treadline.report.climb_picture import chair_origin, write_climb_picture

ROOT_TRUTH = Truth(
    t_s=0.0,
    heading_rad=0.0,
    yaw_rad=0.0,
    heading_rate_rad_s=0.0,
    pitch_rad=0.0,
    roll_rad=0.0,
    pitch_rate_rad_s=0.0,
    x_m=0.0,
    y_m=0.0,
    seat_pitch_rad=0.0,
    left_m_s=0.0,
    right_m_s=0.0,
    stability_margin_rad=0.3,
    friction_use=0.0,
    passenger_x_m=0.0,
    passenger_y_m=0.0,
    passenger_z_m=0.0,
)


@pytest.mark.parametrize(("pitch_rad", "seat_pitch_rad"), [(0.0, 0.0), (0.5, 0.0), (0.5, 0.5), (0.3, -0.1)])
def test_the_origin_follows_from_the_passengers_place(pitch_rad: float, seat_pitch_rad: float) -> None:
    chair = read_chair("wheelchair")
    hinge, com = chair.seat.hinge_m, chair.seat.payload_com_m
    # Forward kinematics in the plane: the hinge turns with the chassis, the passenger about the hinge with the seat.
    x = 1.0 + hinge[0] * math.cos(pitch_rad) - hinge[2] * math.sin(pitch_rad)
    z = 2.0 + hinge[0] * math.sin(pitch_rad) + hinge[2] * math.cos(pitch_rad)
    x += com[0] * math.cos(seat_pitch_rad) - com[2] * math.sin(seat_pitch_rad)
    z += com[0] * math.sin(seat_pitch_rad) + com[2] * math.cos(seat_pitch_rad)
    truth = replace(ROOT_TRUTH, pitch_rad=pitch_rad, seat_pitch_rad=seat_pitch_rad, passenger_x_m=x, passenger_z_m=z)
    np.testing.assert_allclose(chair_origin(chair, truth), (1.0, 2.0), atol=1e-12)  # rounding alone


def test_a_run_without_a_log_is_refused(run_folder: Path, tmp_path: Path) -> None:
    with pytest.raises(SettingsError, match=r"no log\.mcap"):
        write_climb_picture(run_folder, tmp_path / "climb.gif")
