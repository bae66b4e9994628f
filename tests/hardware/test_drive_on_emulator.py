"""The whole chain on the emulated chair: robot file, guard process, serial line, firmware in C, MuJoCo. Times are the box's own."""

import os
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from threading import Thread

import pytest
from robots import TestRobot
from waiting import wait

for module in ("serial", "can", "msgpack"):
    pytest.importorskip(module, reason="the extra hardware is not installed")
pytestmark = pytest.mark.skipif(shutil.which("cc") is None and shutil.which("gcc") is None, reason="no C compiler")

SCENARIO = """
[stair]
slope_deg = 28
[start]
place = "floor"
[sensors]
camera = "statistical"
"""


class Heard:
    """A process whose lines are read as they come."""

    def __init__(self, *arguments: str, obey: TestRobot | None = None) -> None:
        command = [sys.executable, "-m", *arguments]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        self.lines: list[str] = []
        self.host: Heard = self
        self._robot = obey
        self._ear = Thread(target=self._hear, daemon=True)
        self._ear.start()

    def _hear(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self.lines.append(line.strip())
            if self._robot is not None:
                self._robot.obey(line)

    def has(self, text: str) -> bool:
        return any(text in line for line in self.lines)

    def end(self) -> None:
        self.process.kill()
        self.process.wait()
        self._ear.join()
        assert self.process.stdout is not None
        self.process.stdout.close()


@pytest.fixture
def box(robot: TestRobot, monkeypatch: pytest.MonkeyPatch) -> Iterator[Heard]:
    """An emulated chair that is driven at 0.1 m/s on the bench."""
    monkeypatch.chdir(robot.folder)
    robot.hold(dead_man=False)
    text = robot.path.read_text().replace(
        'link = "box:FloorBox"\n' + f'folder = "{robot.folder}"', 'link = "serial"\nport = "chair"'
    )
    robot.path.write_text(text)
    Path("scenario.toml").write_text(SCENARIO)
    emulator = Heard("treadline.hardware.emulators", "serial", "--port", "chair", "--scenario", "scenario.toml")
    wait(lambda: emulator.has("START"), lambda: emulator.lines)
    host = Heard("treadline", "drive", "robot.toml", "--bench", "--out", "run", obey=robot)
    emulator.host = host
    try:
        wait(lambda: host.has("bench: "), lambda: host.lines)
        yield emulator
    finally:
        host.process.send_signal(signal.SIGCONT)
        host.end()
        emulator.end()


def guard_of(host: Heard) -> int:
    listed = subprocess.run(["ps", "-o", "pid=", "--ppid", str(host.process.pid)], capture_output=True, text=True, check=True)
    return int(listed.stdout.split()[0])


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_a_guard_process_that_is_gone_leaves_the_box_to_its_watchdog(box: Heard, number: signal.Signals) -> None:
    """Test: the guard process is killed, or stopped. Expected result: latched 0.1 s after the last command, and the run ends."""
    armed = len([line for line in box.lines if "ARMED" in line])
    os.kill(guard_of(box.host), number)
    line = wait(lambda: [line for line in box.lines if "WATCHDOG" in line], lambda: box.lines)[-1]
    assert int(re.findall(r"(\d+) ms old", line)[0]) <= 100
    assert box.host.process.wait(60.0) == 2
    assert box.host.has("the box's watchdog has stopped the belts")
    assert len([line for line in box.lines if "ARMED" in line]) == armed


def test_a_loop_that_is_stopped_is_stopped_by_the_guard_and_not_by_the_watchdog(box: Heard) -> None:
    """Test: the loop is stopped, and wakes. Expected result: the guard, which still speaks, stops the box and names the cause."""
    stops = len([line for line in box.lines if "STOPPED" in line])
    box.host.process.send_signal(signal.SIGSTOP)
    wait(lambda: len([line for line in box.lines if "STOPPED" in line]) > stops, lambda: box.lines)
    box.host.process.send_signal(signal.SIGCONT)
    wait(lambda: box.host.has("hold: the loop stood still for 0."), lambda: box.host.lines)
