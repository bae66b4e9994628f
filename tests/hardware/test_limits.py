"""Limits of a real chair: the lower of chair file and robot file, and sooner holds than the simulated chair has."""

import pytest
from robots import TestRobot

from treadline.hardware.drive import Robot


def test_a_drive_holds_0_3_s_after_a_frame_was_due_or_0_1_s_without_the_inertial_sensor(robot: TestRobot) -> None:
    config = Robot.of(robot.file()).drive_config(0.25, 0.1)
    assert (config.blind_timeout_s, config.vision_only_s) == pytest.approx((0.4, 0.1))
    assert config.awaits_ground
    assert config.needs_heading


def test_the_robot_file_lowers_the_speed_of_the_chair_file_and_the_bench_both(robot: TestRobot) -> None:
    assert Robot.of(robot.file()).drive_config(0.25, 0.1).belt_limit_m_s == 0.3
    assert Robot.of(robot.file()).bench_config().belt_limit_m_s == 0.1
    robot.path.write_text(robot.path.read_text().replace("belt_m_s = 0.3", "belt_m_s = 0.06"))
    slow = Robot.of(robot.file())
    assert (slow.bench_config().belt_limit_m_s, slow.mission.climb_speed_m_s) == (0.06, 0.06)
