"""The moving picture: the chair is drawn where the ground truth has it."""

from pathlib import Path

import pytest

from treadline.errors import SettingsError
from treadline.io.mcap_log import RunLog
from treadline.ports import Truth
from treadline.report.climb_picture import write_climb_picture

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


def test_a_log_without_the_pose_is_refused_by_name(run_folder: Path, tmp_path: Path) -> None:
    """Test: a log from before the pose was kept. Expected: one sentence that says so, and what to do."""
    with RunLog(run_folder / "log.mcap") as log:
        log(ROOT_TRUTH)
    with pytest.raises(SettingsError, match="before logs kept the chair's pose"):
        write_climb_picture(run_folder, tmp_path / "climb.gif")


def test_a_run_without_a_log_is_refused(run_folder: Path, tmp_path: Path) -> None:
    with pytest.raises(SettingsError, match=r"no log\.mcap"):
        write_climb_picture(run_folder, tmp_path / "climb.gif")
