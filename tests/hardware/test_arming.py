"""Arming: what is wrong is named before the chair drives, and nothing but the wiggle moves."""

from threading import Timer

import pytest
from robots import TestRobot

from treadline.core.errors import LinkError
from treadline.hardware import drive as runs
from treadline.hardware._arming import Wiggle, report_fault, turn_fault
from treadline.io.runs import read_series
from treadline.playback import read_recording
from treadline.report import write_report

# The wheelchair's tracks are 0.65 m apart: one belt at 0.05 m/s turns it by 0.077 rad/s without slip, by 0.79 of it on a floor.
TURN_RAD_S = 0.79 * 0.05 / 0.65


def moved(own: float = 0.05, other: float = 0.0, turn: float = 0.0) -> Wiggle:
    return Wiggle(asked_m_s=0.05, own_m_s=own, other_m_s=other, turn_rad_s=turn)


@pytest.mark.parametrize(
    ("wiggle", "said"),
    [
        (moved(), None),
        (moved(own=0.036), None),
        (moved(own=0.064), None),
        (moved(own=0.034), "correct wheel radius"),
        (moved(own=0.2), "correct wheel radius"),
        (moved(own=0.0), "correct wheel radius, gear or supply"),
        (moved(own=-0.05), "reverse its encoder"),
        (moved(own=0.0, other=0.05), "crossed"),
        (moved(own=0.0, other=-0.05), "crossed"),
    ],
)
def test_a_belt_is_judged_by_its_own_report(wiggle: Wiggle, said: str | None) -> None:
    fault = report_fault("left", wiggle, 0.3)
    assert (fault is None) == (said is None)
    assert said is None or said in str(fault)


def test_a_wiggle_that_the_guard_ended_says_nothing_about_the_scale_but_about_the_sign() -> None:
    assert report_fault("left", moved(own=0.02), 0.3, whole=False) is None
    assert report_fault("left", moved(own=-0.03), 0.3, whole=False) is not None


@pytest.mark.parametrize(
    ("left", "right", "said", "on_floor"),
    [
        (-1.0, 1.0, None, True),
        (0.0, 0.0, None, False),
        (0.05, -0.05, None, False),
        (1.0, -1.0, "swapped", True),
        (1.0, 1.0, "signs.left = -1", True),
        (-1.0, -1.0, "signs.right = -1", True),
    ],
)
def test_the_direction_of_the_belts_is_judged_by_the_gyro(left: float, right: float, said: str | None, on_floor: bool) -> None:
    fault, stands = turn_fault(moved(turn=left * TURN_RAD_S), moved(turn=right * TURN_RAD_S), 0.65)
    assert (stands, fault is None) == (on_floor, said is None)
    assert said is None or said in str(fault)


@pytest.mark.parametrize(
    ("fault", "said"),
    [
        ("swapped", "the belts are swapped"),
        ("right_report_reversed", "the report of the right belt has the wrong sign"),
        ("imu_silent", "no reading of imu"),
        ("imu_upside_down", "correct the axes of the inertial sensor"),
        ("unplugged", "the line is unplugged"),
    ],
)
def test_a_fault_of_the_wiring_is_named_and_the_chair_does_not_drive(robot: TestRobot, fault: str, said: str) -> None:
    robot.broken(fault)
    with pytest.raises(LinkError, match=said) as error:
        runs.bench(robot.file(), robot.folder / "run", 1.0, robot.obey)
    assert "\n" not in str(error.value)
    assert max(abs(speed) for entry in robot.done() for speed in entry["asked"]) <= 0.05
    assert robot.done()[-1]["latched"]


def test_a_chair_whose_seat_has_no_link_is_named(robot: TestRobot) -> None:
    robot.path.write_text(robot.path.read_text().replace('[joints]\nlink = "drives"\n', ""))
    with pytest.raises(
        LinkError, match=r"arming: wheelchair has a seat or a flipper, and the robot file no \[joints\]; add the table"
    ):
        runs.bench(robot.file(), robot.folder / "run", 1.0, robot.obey)


def test_a_low_battery_is_not_armed(robot: TestRobot) -> None:
    robot.path.write_text(robot.path.read_text().replace('link = "box:FloorBox"', 'link = "box:FloorBox"\nvolts = 21.5'))
    with pytest.raises(LinkError, match=r"the battery is at 21.5 V, and 22 V are asked for; charge it"):
        runs.bench(robot.file(), robot.folder / "run", 1.0, robot.obey)
    assert [entry["what"] for entry in robot.done()] == ["open", "close"]


def test_a_swap_that_the_robot_file_states_is_undone(robot: TestRobot) -> None:
    robot.broken("swapped")
    robot.path.write_text(robot.path.read_text() + "[signs]\nswapped = true\n")
    said: list[str] = []

    def hear(line: str) -> None:
        said.append(line)
        robot.obey(line)

    run = runs.bench(robot.file(), robot.folder / "run", 0.5, hear)
    assert run["verdict"] == "time_up"
    assert "belts on the floor, signs right by the gyro" in said
    assert {entry["limit_m_s"] for entry in robot.done()} == {0.1}  # the box's own limit on the bench


@pytest.mark.parametrize(("fault", "cause"), [("imu_frozen", "gyro stuck for 0.1"), ("imu_silent", "no IMU sample for 0.1")])
def test_the_bench_holds_for_an_inertial_sensor_that_freezes_or_ends(robot: TestRobot, fault: str, cause: str) -> None:
    """Test: belts at 0.1 m/s by the stick; the gyro repeats one reading with fresh stamps, or sends none. Expected: held by the
    guard's rule, and the belts of the box are stopped."""
    said: list[str] = []

    def hear(line: str) -> None:
        said.append(line)
        robot.obey(line)
        if line.startswith("bench: "):
            robot.hold(dead_man=True, speed=1.0)
            Timer(1.0, robot.broken, [fault]).start()  # the belts move by then

    runs.bench(robot.file(), robot.folder / "run", 2.0, hear)
    (held,) = [line for line in said if "hold: " in line and "not armed" not in line]
    assert f"hold: {cause}" in held
    assert robot.done()[-1]["latched"]
    assert max(entry["asked"][0] for entry in robot.done()) == 0.1


def test_a_recording_needs_no_hand_moves_nothing_and_can_be_looked_at(robot: TestRobot) -> None:
    """Test: no handset, and a box that reports a re-arm again and again. Expected: it is not armed; a log and its page."""
    robot.path.write_text(robot.path.read_text().replace(f'[handset]\nlink = "box:Hand"\nfolder = "{robot.folder}"\n', ""))
    robot.broken("rearm_pressed")
    assert runs.record(robot.file(), robot.folder / "run", 1.5)["verdict"] == "time_up"
    assert all(entry["latched"] and entry["asked"] == [0.0, 0.0] for entry in robot.done())
    assert "chair of a test" in write_report(robot.folder / "run").read_text()
    assert read_recording(robot.folder / "run").duration_s == pytest.approx(1.5, abs=0.1)
    series = read_series(robot.folder / "run")
    assert series["pitch_deg"] == pytest.approx(0.0, abs=0.1)
    assert series["left_m_s"][1:] == pytest.approx(0.0)
