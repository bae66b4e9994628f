"""Faults while the belts turn: the guard process stops the box within 0.3 s whatever the loop does, names the cause, and waits.

Times are those of the box's clock, the monotonic one of this machine.
"""

import json
import math
import os
import signal
import time
from collections.abc import Iterator
from typing import Any

import pytest
from processes import Heard, wait_for
from robots import TestRobot

from treadline.core.signals import OperatorInput
from treadline.hardware._arming import BenchSession
from treadline.hardware._guard_client import GuardClient
from treadline.hardware.drive import Robot

pytestmark = pytest.mark.xdist_group("guard process")  # most tests share one
HELD = {"dead_man": True, "speed": 1.0}


class Bench:
    """``treadline drive --bench`` in a process, driven at 0.1 m/s."""

    def __init__(self, robot: TestRobot) -> None:
        self.robot = robot
        self.host = Heard("treadline", "drive", robot.path, "--bench", "--out", robot.folder / "run", obey=robot.obey)
        self.process = self.host.process
        wait_for(lambda: self.host.has("bench: "), lambda: self.host.lines)

    def drive(self) -> None:
        """Mend the box, re-arm it while it is latched, and push the stick until the belts move at 0.09 m/s."""
        self.robot.broken()
        wait_for(self._is_driving, lambda: self.host.lines, pause_s=0.05)
        self.before = len(self.host.lines)

    def _is_driving(self) -> bool:
        if self.robot.done()[-1]["latched"]:
            self.robot.obey("re-arm")
            time.sleep(0.3)  # three reports of the handset
        self.robot.hold(**HELD)
        done = self.robot.done()
        return not done[-1]["latched"] and [entry["what"] for entry in done if entry["what"] in ("moving", "slow")][-1:] == [
            "moving"
        ]

    def stopped(self, fault_s: float) -> float:
        """Return the time from a fault to the stop of the box [s]."""
        done = wait_for(lambda: [entry for entry in self.robot.done() if entry["latched"] and entry["box_s"] > fault_s])
        return float(done[0]["box_s"] - fault_s)

    def cause(self) -> str:
        """Return the cause of the hold, since the chair drove, as the person reads it."""
        return str(wait_for(lambda: [line for line in self.host.lines[self.before :] if " hold: " in line])[0])


def started(robot: TestRobot) -> Iterator[Bench]:
    made = Bench(robot)
    yield made
    made.host.end()


@pytest.fixture(scope="module")
def process(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bench]:
    yield from started(TestRobot(tmp_path_factory.mktemp("robot")))


@pytest.fixture
def driven(process: Bench) -> Bench:
    """A process that tests share: a chair that has been held drives on."""
    process.drive()
    return process


@pytest.fixture
def bench(robot: TestRobot) -> Iterator[Bench]:
    """A process for one test, which ends it."""
    for made in started(robot):
        made.drive()
        yield made


def test_a_loop_that_is_stopped_stops_the_chair_until_a_person_rearms(driven: Bench) -> None:
    """Test: SIGSTOP; SIGCONT; then a re-arm. Expected result: latched within 0.3 s and awake, then it drives."""
    os.kill(driven.process.pid, signal.SIGSTOP)
    fault_s = time.monotonic()
    assert driven.stopped(fault_s) <= 0.3
    os.kill(driven.process.pid, signal.SIGCONT)
    assert "the loop stood still for " in driven.cause()
    assert driven.robot.done()[-1]["latched"]
    driven.drive()


def test_a_loop_that_is_killed_stops_the_chair(bench: Bench) -> None:
    bench.process.kill()
    fault_s = time.monotonic()
    assert bench.stopped(fault_s) <= 0.3
    assert wait_for(lambda: bench.robot.done()[-1]["what"] == "close")


@pytest.mark.parametrize(
    ("fault", "said"),
    [
        ("error", "the plant braked by itself: overcurrent of the left motor"),
        ("restart", "the plant braked by itself: the box latched a stop"),
        ("right_report_reversed", "right track runs backwards: -0.10 m/s where 0.10 is expected"),
        ({"dead_man": False, "speed": 1.0}, "the dead-man switch is released"),
        ({"dead_man": True, "stop": True, "speed": 1.0}, "operator stop"),
    ],
)
def test_a_fault_of_the_box_and_the_persons_hand_hold_and_are_named(driven: Bench, fault: str | dict[str, Any], said: str) -> None:
    fault_s = time.monotonic()
    if isinstance(fault, str):
        driven.robot.broken(fault)
    else:
        driven.robot.hold(**fault)
    # A person's stop asks for zero speed at once, and the brake, which the box latches, falls in 0.3 s later: 0.5 s by row 21.
    assert driven.stopped(fault_s) <= (0.5 if said in ("operator stop", "the dead-man switch is released") else 0.3)
    assert said in driven.cause()


def test_an_unplugged_line_ends_the_run_with_its_cause(bench: Bench) -> None:
    bench.robot.broken("unplugged")
    assert bench.process.wait(60.0) == 2
    bench.host.end()
    assert "the line is unplugged" in bench.host.lines[-1]


def test_ctrl_c_stops_the_chair_and_keeps_the_log(bench: Bench) -> None:
    fault_s = time.monotonic()
    bench.process.send_signal(signal.SIGINT)
    assert bench.stopped(fault_s) <= 0.3
    assert bench.process.wait(60.0) == 0
    result = json.loads((bench.robot.folder / "run" / "result.json").read_text())
    assert [event["name"] for event in result["events"]][-1] == "rearmed"


def test_a_link_whose_readings_are_none_ends_the_run_with_the_box_stopped(bench: Bench) -> None:
    """A driver of the user: what it returns has no stamp."""
    fault_s = time.monotonic()
    bench.robot.broken("nonsense")
    assert bench.stopped(fault_s) <= 0.3
    assert wait_for(lambda: bench.robot.done()[-1]["what"] == "close")
    assert next(entry["what"] for entry in bench.robot.done() if entry["box_s"] > fault_s) == "stop"
    assert bench.process.wait(60.0) == 2


def test_a_new_session_knows_nothing_of_the_one_before(robot: TestRobot) -> None:
    client = GuardClient(robot.file())
    config = Robot.of(robot.file()).bench_config()
    session = BenchSession(client, config, "first")
    robot.hold(dead_man=False)
    session.wait("no handset", 60.0, lambda: OperatorInput in session.newest)
    time.sleep(1.0)  # a release that is meant
    robot.hold(dead_man=True, rearm=True)
    session.wait("no re-arm", 60.0, lambda: client.holding is None)
    time.sleep(0.1)  # reports of the first session wait to be read
    start_s = client.begin(config, "second")
    readings: list[Any] = []
    while len(readings) < 20:
        client.receive()
        assert client.holding == "second"
        readings += client.readings(math.inf)
        assert all(reading.t_s <= time.monotonic() - start_s for reading in readings)
        client.step(0.0, None)
    client.close()
