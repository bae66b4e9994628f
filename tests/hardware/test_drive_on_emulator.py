"""The whole chain on the emulated chair: robot file, guard process, serial line, firmware in C, MuJoCo. Times are the box's own."""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from processes import Heard, wait_for
from robots import TestRobot

for module in ("serial", "can", "msgpack"):
    pytest.importorskip(module, reason="the extra hardware is not installed")
pytestmark = [
    pytest.mark.skipif(shutil.which("cc") is None and shutil.which("gcc") is None, reason="no C compiler"),
    pytest.mark.xdist_group("a chair in real time"),  # one at a time: each keeps a core busy
]

BOX = 'link = "box:FloorBox"\nfolder = "{folder}"'
SERIAL = 'link = "serial"\nport = "chair"'
CAN = """link = "can"
interface = "udp_multicast"
channel = "239.74.163.2"
port = {port}
fd = false
left_node = 1
right_node = 2
wheel_radius_m = 0.07"""
VESC = """link = "vesc"
interface = "udp_multicast"
channel = "239.74.163.2"
port = {port}
fd = false
left_id = 1
right_id = 2
wheel_radius_m = 0.07
gear_ratio = 10.0
pole_pairs = 7"""
BASE = """link = "base"
wire = "treadline.hardware.emulators._base:DatagramWire"
port = {port}"""
OTHERS = {"can": CAN, "vesc": VESC, "base": BASE}
DRIVE = """speed_m_s = 0.2
[camera]
source = "treadline.hardware.emulators.camera:EmulatedCamera"
port = "chair.frame"
calibration = "chair.camera.toml"
"""


class Emulated:
    """An emulated chair before a short stair, and the robot file that drives it."""

    def __init__(self, robot: TestRobot, link: str) -> None:
        port = 20_000 + sum(str(robot.folder).encode()) % 20_000
        model, text = "wheelchair", robot.path.read_text()
        if link != "serial":  # no other carries a flipper
            model, text = "wheelchair-fixed", text + 'chair = "wheelchair-fixed"\n'
            text = text.replace('link = "drives"', SERIAL, 1).replace('link = "drives"', 'link = "imu"')
        if link == "base":  # which measures no battery
            text = text.replace("battery_least_v = 22.0\n", "")
        drives = SERIAL if link == "serial" else OTHERS[link].format(port=port)
        robot.path.write_text(text.replace(BOX.format(folder=robot.folder), drives) + DRIVE)
        scenario = 'stair = { slope_deg = 28, steps = 4 }\nstart = { place = "floor" }\n'
        Path("scenario.toml").write_text(scenario + f'chair = {{ model = "{model}" }}\n')
        options = ("--port", "chair", "--udp-port", str(port), "--scenario", "scenario.toml")
        self.hosts: list[Heard] = []
        self.rearms = True
        self.robot, self.box = robot, Heard("treadline.hardware.emulators", link, *options)
        wait_for(Path("chair.frame").exists, lambda: self.box.lines)

    def driven(self, *options: str) -> Heard:
        """Return a drive with a person who re-arms when asked, and after each hold."""
        self.robot.hold(dead_man=False)
        self.hosts.append(Heard("treadline", "drive", "robot.toml", *options, obey=self._obey))
        return self.hosts[-1]

    def _obey(self, line: str) -> None:
        asked = line.startswith(("hold the dead-man", "armed; ", "held: "))
        if asked or (self.rearms and " hold: " in line and "armed" not in line):
            self.robot.obey("re-arm")

    def times(self, what: str) -> list[float]:
        """Return when the box reported something [s]."""
        return [float(line.split()[0]) for line in self.box.lines if what in line]


@pytest.fixture
def emulated(robot: TestRobot, request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[Emulated]:
    monkeypatch.chdir(robot.folder)
    made = Emulated(robot, request.param)
    yield made
    for process in (*made.hosts, made.box):
        process.end()


@pytest.mark.parametrize("emulated", ["serial"], indirect=True)
def test_the_chair_climbs_a_short_stair_on_the_wall_clock(emulated: Emulated) -> None:
    """Test: arming, then four steps of 28°. Expected result: arrived, with a log that can be reported without ground truth."""
    drive = emulated.driven("--out", "run")
    assert drive.process.wait(180.0) == 0, drive.lines
    result = json.loads(Path("run/result.json").read_text())
    assert result["verdict"] == "arrived"
    assert "heading_rms_deg" not in result  # which needs the ground truth
    begun = list(dict.fromkeys(event["name"] for event in result["events"]))
    phases = ["approach", "mount", "climb", "crest", "land", "arrived"]
    assert [name for name in begun if name in phases] == phases
    subprocess.run([sys.executable, "-m", "treadline", "report", "run"], check=True)
    assert "arrived" in Path("run/report.html").read_text()


@pytest.mark.parametrize("emulated", ["serial"], indirect=True)
def test_a_guard_process_that_is_gone_leaves_the_box_to_its_watchdog(emulated: Emulated) -> None:
    """Test: a guard process is killed, another stopped. Expected result: latched 0.1 s after the last command, and the run ends."""
    box, emulated.rearms = emulated.box, False
    for number in (signal.SIGKILL, signal.SIGSTOP):
        host = emulated.driven("--bench", "--out", number.name)
        wait_for(lambda: host.has("bench: "), lambda: host.lines)  # noqa: B023 - called at once
        armed, before = (len(emulated.times(word)) for word in ("ARMED", "WATCHDOG"))
        guard = subprocess.run(["ps", "-o", "pid=", "--ppid", str(host.process.pid)], capture_output=True, text=True, check=True)
        os.kill(int(guard.stdout.split()[0]), number)
        line = wait_for(lambda: [line for line in box.lines if "WATCHDOG" in line][before:], lambda: box.lines)[0]  # noqa: B023
        assert int(re.findall(r"(\d+) ms old", line)[0]) <= 100
        assert host.process.wait(60.0) == 2
        host.end()
        assert "the box's watchdog has stopped the belts" in host.lines[-1]
        assert len(emulated.times("ARMED")) == armed


@pytest.mark.parametrize("emulated", ["base", "vesc"], indirect=True)
def test_a_base_is_measured_and_then_follows_on_the_bench(emulated: Emulated) -> None:
    """Test: the robot file of the page, and the bench. Expected result: the base's figures are said, its signs are right."""
    host = emulated.driven("--bench", "--seconds", "2", "--out", "run")
    assert host.process.wait(90.0) == 0, "\n".join(host.lines)
    assert host.has("base: lag 0.")
    assert host.has("belts on the floor, signs right by the gyro")


@pytest.mark.parametrize("emulated", ["serial", "can"], indirect=True)
def test_faults_of_sensors_stop_the_chair_and_are_named(emulated: Emulated) -> None:
    """Test: in motion, camera and gyro fail for a second. Expected result: each fault stops the box in time, by its own clock, and
    the box stands until a person re-arms."""
    box, drive = emulated.box, emulated.driven("--out", "run")
    wait_for(lambda: drive.has("rearmed: by a person, after: armed"), lambda: drive.lines)
    emulated.rearms = False
    # A camera is silent from the moment at which its next frame is due, 0.1 s after the last one; the guard holds within 0.3 s
    # and ramps down from 0.2 m/s with 1 m/s² at most, a half cosine of 0.31 s.
    camera_s, gyro_s = 0.1 + 0.3 + 0.31, 0.3 + 0.31
    for fault, cause, limit_s in (
        ("camera_gone", "hold: no frame for 0.4 s", camera_s),
        ("imu_frozen", "hold: gyro stuck for 0.", gyro_s),
    ):
        time.sleep(1.2)  # drives on CAN have proved their watchdog, and the belts are at 0.2 m/s
        box.type(f"{fault}=1")
        wait_for(lambda: drive.has(cause), lambda: drive.lines)  # noqa: B023 - called at once
        fault_s = emulated.times(f"fault {fault}")[-1]
        stop_s = wait_for(lambda: [t_s for t_s in emulated.times("STOPPED") if t_s > fault_s])[0]  # noqa: B023 - called at once
        assert stop_s - fault_s <= limit_s + 0.05  # ticks of sensor, loop, guard and box; both times are rounded to 10 ms
        time.sleep(1.5)  # the fault has passed
        assert not [t_s for t_s in emulated.times("ARMED") if t_s > stop_s]
        emulated.robot.obey("re-arm")
        wait_for(lambda: [t_s for t_s in emulated.times("ARMED") if t_s > stop_s])  # noqa: B023 - called at once
