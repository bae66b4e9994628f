"""Robot files: speed limits are required, links are named, each error is one line with the key and the remedy."""

import math
from pathlib import Path

import pytest
from robots import TestRobot

from treadline.core.errors import LinkError, SettingsError
from treadline.hardware._guard_client import GuardClient
from treadline.hardware.drive import Robot, camera_of


@pytest.mark.parametrize(
    ("line", "instead", "said"),
    [
        ("belt_m_s = 0.3", "", "limits.belt_m_s"),
        ("acceleration_m_s2 = 1.0", "", "limits.acceleration_m_s2"),
        ("belt_m_s = 0.3", "belt_m_s = 0.0", "limits.belt_m_s"),
        ("belt_m_s = 0.3", 'belt_m_s = "0.3"', "limits.belt_m_s"),
        ("acceleration_m_s2 = 1.0", "acceleration_m_s2 = 1.0\nwatchdog_s = 0.5", "limits.watchdog_s"),
        ("payload_kg = 50.0", "payload_kg = 50.0\nspeed = 1.0", "mission.speed"),
        ('[imu]\nlink = "drives"', '[imu]\nlink = "bno"', "give serial, can"),
        ('[drives]\nlink = "box:FloorBox"', '[drives]\nlink = "drives"', "give serial, can, or module:Class"),
        ('[imu]\nlink = "drives"', '[imu]\nlink = "serial"\nport = "/dev/ttyACM0"', None),
    ],
)
def test_a_wrong_line_is_named(robot: TestRobot, line: str, instead: str, said: str | None) -> None:
    text = robot.path.read_text()
    assert line in text
    robot.path.write_text(text.replace(line, instead))
    if said is None:
        assert robot.file().imu.link == "serial"
        return
    with pytest.raises(SettingsError) as error:
        robot.file()
    assert said in str(error.value)
    assert "\n" not in str(error.value)
    assert str(robot.path) in str(error.value)


def test_the_box_receives_the_rates_of_seat_and_flipper_of_the_chair_file(robot: TestRobot) -> None:
    """Commands at these rates are sound; a box with smaller limits would reject them, and stop."""
    limits = robot.file().drive_limits
    assert (limits.seat_m_s, limits.flipper_rad_s) == (0.06, math.radians(30.0))
    robot.path.write_text(robot.path.read_text().replace('[joints]\nlink = "drives"\n', ""))
    limits = robot.file().drive_limits
    assert (limits.seat_m_s, limits.flipper_rad_s) == (0.0, 0.0)


def test_an_own_camera_is_sought_in_the_working_folder(robot: TestRobot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Test: a module of the working folder without the class. Expected result: the class is missed, not the module."""
    (tmp_path / "camera_of_a_lab.py").write_text("")
    monkeypatch.chdir(tmp_path)
    table = '[camera]\nsource = "camera_of_a_lab:LabCamera"\ncalibration = "camera.toml"\n'
    robot.path.write_text(robot.path.read_text() + table)
    with pytest.raises(LinkError, match="module 'camera_of_a_lab' has no attribute 'LabCamera'"):
        camera_of(robot.file())


def test_two_links_on_one_port_are_refused_though_it_has_two_names(robot: TestRobot) -> None:
    (robot.folder / "alias").symlink_to("/dev/ttyACM0")
    text = robot.path.read_text().replace('"box:FloorBox"', '"serial"\nport = "/dev/ttyACM0"', 1)
    robot.path.write_text(text.replace('[imu]\nlink = "drives"', f'[imu]\nlink = "serial"\nport = "{robot.folder}/alias"'))
    with pytest.raises(SettingsError, match=r"imu\.port is '.*alias', which drives opens; write imu.link = 'drives'"):
        robot.file()


@pytest.mark.parametrize(
    ("link", "instead", "said"),
    [
        (
            '[drives]\nlink = "box:FloorBox"',
            '[drives]\nlink = "nowhere:Box"',
            r"drives: nowhere:Box cannot be imported \(No module named 'nowhere'\); pip install .*, or correct the name",
        ),
        ('[drives]\nlink = "box:FloorBox"', '[drives]\nlink = "box:Hand"', r"drives: .*limits.*correct the keys of \[drives\]"),
        ('[handset]\nlink = "box:Hand"', '[handset]\nlink = "box:Hand"\nbaud = 9600', "handset: .*baud.*correct the keys"),
        ('[handset]\nlink = "box:Hand"', '[handset]\nlink = "keyboard"', "handset: .*correct the keys"),
    ],
)
def test_a_link_that_does_not_open_is_one_line(robot: TestRobot, link: str, instead: str, said: str) -> None:
    robot.path.write_text(robot.path.read_text().replace(link, instead))
    with pytest.raises(LinkError, match=said) as error:
        GuardClient(robot.file())
    assert "\n" not in str(error.value)


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
