"""Limits of a real chair: the lower of chair file and robot file, and sooner holds than the simulated chair has."""

from robots import TestRobot

from treadline.hardware.drive import Robot


def test_a_drive_holds_without_frames_for_0_3_s_or_without_the_inertial_sensor_for_0_1_s(robot: TestRobot) -> None:
    config = Robot.of(robot.file()).drive_config(0.25)
    assert (config.blind_timeout_s, config.vision_only_s) == (0.3, 0.1)
    assert config.awaits_ground
    assert config.needs_heading


def test_the_robot_file_lowers_the_speed_of_the_chair_file_and_the_bench_both(robot: TestRobot) -> None:
    assert Robot.of(robot.file()).drive_config(0.25).belt_limit_m_s == 0.3
    assert Robot.of(robot.file()).bench_config().belt_limit_m_s == 0.1
    robot.path.write_text(robot.path.read_text().replace("belt_m_s = 0.3", "belt_m_s = 0.06"))
    slow = Robot.of(robot.file())
    assert (slow.bench_config().belt_limit_m_s, slow.mission.climb_speed_m_s) == (0.06, 0.06)
