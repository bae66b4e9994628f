"""The graph on a real roscore: a closed loop through ROS, whole streams, killed nodes, and bad input reported in one line.

``make test-ros1`` installs ROS 1 and runs these; ``make test`` skips them.
"""

import os
import re
import shutil
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

pytestmark = pytest.mark.skipif(
    os.environ.get("TREADLINE_ROS1") != "1" or shutil.which("rostest") is None,
    reason="ROS 1: make test-ros1 installs it and runs these",
)

ROOT = Path(__file__).parents[2]
TREADLINE = [sys.executable, "-m", "treadline"]
TESTS = ROOT / "legacy" / "treadline_ros1" / "test"


@pytest.fixture(scope="module")
def environment(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """ROS finds the package next to Debian's; nodes find this venv's treadline."""
    home = tmp_path_factory.mktemp("ros")
    return os.environ | {
        "ROS_PACKAGE_PATH": f"{ROOT / 'legacy'}:/usr/share",
        "ROS_IP": "127.0.0.1",
        "ROS_HOME": str(home),
        "TREADLINE": str(Path(sys.executable).with_name("treadline")),
    }


@pytest.fixture(scope="module")
def roscore(environment: dict[str, str]) -> Iterator[dict[str, str]]:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    with_master = environment | {"ROS_MASTER_URI": f"http://127.0.0.1:{port}"}
    core = subprocess.Popen(["roscore", "-p", str(port)], env=with_master, stdout=subprocess.DEVNULL)
    deadline = time.monotonic() + 30.0
    while time.monotonic() < deadline:
        with socket.socket() as client:
            if client.connect_ex(("127.0.0.1", port)) == 0:
                break
        time.sleep(0.1)
    yield with_master
    core.terminate()
    core.wait(20)


CASES = [
    ("climb", ""),
    ("paper_names", ""),
    *(("kill", node) for node in ("depth", "heading", "seat", "controller", "guard", "plant")),
]


@pytest.mark.parametrize(("name", "victim"), CASES, ids=["-".join(filter(None, case)) for case in CASES])
def test_rostest_passes(environment: dict[str, str], tmp_path: Path, name: str, victim: str) -> None:
    command = ["rostest", "treadline_ros1", f"{name}.test", *([f"victim:={victim}"] if victim else [])]
    env = environment | {"ROS_HOME": str(tmp_path)}
    done = subprocess.run(command, env=env, capture_output=True, text=True, timeout=200, check=False)
    results = [ET.parse(path).getroot() for path in tmp_path.rglob("rostest-*.xml")]  # noqa: S314 - rostest's own
    counted = [[int(result.get(key, "0")) for key in ("tests", "failures", "errors")] for result in results]
    assert done.returncode == 0, done.stdout[-3000:]
    assert counted
    assert all(tests > 0 and not failures and not errors for tests, failures, errors in counted), done.stdout[-3000:]


SOURCE = """
import sys, time
import numpy as np
from treadline.ros import channels as on
from treadline.ros.ros1 import Ros1Transport
from treadline.core.camera_images import PinholeCamera, RgbdFrame
from treadline.core.signals import ImuSample
wire = Ros1Transport("source")
camera = PinholeCamera(width_px=320, height_px=240, fx_px=287.5, fy_px=287.5, cx_px=159.5, cy_px=119.5)
rgb, depth = np.full((240, 320, 3), 99, np.uint8), np.full((240, 320), 1.5, np.float32)
wire.announce(on.CAMERA)
wire.announce(on.IMU)
time.sleep(2.0)
began = time.monotonic()
for k in range(500):
    wire.publish(on.IMU, ImuSample(t_s=(k + 1) / 100, orientation=np.array([1.0, 0, 0, 0]), angular_velocity_rad_s=np.zeros(3),
                                   linear_acceleration_m_s2=np.zeros(3)))
    if k % 10 == 0:
        wire.publish(on.CAMERA, RgbdFrame(t_s=(k + 1) / 100, rgb=rgb, depth_m=depth, camera=camera))
    time.sleep(max(0.0, began + (k + 1) / 100 - time.monotonic()))
time.sleep(1.0)
wire.close()
"""
SINK = """
import sys, time
from treadline.ros import channels as on
from treadline.ros.ros1 import Ros1Transport
wire = Ros1Transport("sink")
wire.spare = 50
came = {on.IMU: [], on.CAMERA: []}
for channel, kept in came.items():
    wire.subscribe(channel, lambda signal, kept=kept: kept.append(round(100 * signal.t_s)))
deadline = time.monotonic() + 40
while (len(came[on.IMU]) < 500 or len(came[on.CAMERA]) < 50) and time.monotonic() < deadline:
    wire.deliver(0.05)
wire.close()
assert came == {on.IMU: list(range(1, 501)), on.CAMERA: list(range(1, 501, 10))}, came
"""


def test_nothing_is_lost_between_two_processes(roscore: dict[str, str]) -> None:
    sink = subprocess.Popen([sys.executable, "-c", SINK], env=roscore)
    source = subprocess.Popen([sys.executable, "-c", SOURCE], env=roscore)
    assert source.wait(60) == 0
    assert sink.wait(60) == 0


LISTENER = """
import time
from treadline.ros import channels as on
from treadline.ros.ros1 import Ros1Transport
wire, began, held = Ros1Transport("listener"), [], []
wire.subscribe(on.SEAT, lambda seat: began.append(time.monotonic()) if seat.pitch_rad == 1.0 else None)
wire.subscribe(on.GUARD, lambda state: held.append(state.holding) if state.holding else None)
deadline = time.monotonic() + 40
while not held and time.monotonic() < deadline:
    wire.deliver(0.05)
print(time.monotonic() - began[0], *held)
"""


def test_two_sources_of_a_sensor_are_held_and_named_within_a_second(roscore: dict[str, str]) -> None:
    pub = ("rostopic", "pub", "-r", "50", "/seat/state", "sensor_msgs/JointState")
    started = [subprocess.Popen([*TREADLINE, "node", "guard", "--clock", "wall"], env=roscore)]
    started.append(subprocess.Popen([*pub, "{position: [0.1, 0.2]}"], env=roscore))
    listener = subprocess.Popen([sys.executable, "-c", LISTENER], env=roscore, stdout=subprocess.PIPE, text=True)
    time.sleep(8.0)  # all are there
    started.append(subprocess.Popen([*pub, "{position: [0.1, 1.0]}"], env=roscore))
    took, said = listener.communicate(timeout=60)[0].split(maxsplit=1)
    for process in started:
        process.terminate()  # so that it leaves the master
        process.wait(20)
    assert float(took) < 1.0
    assert re.match(r"two sources of /seat/state, /rostopic_\S+ and /rostopic_\S+; stop one of them", said)


def line_of(command: list[str], env: dict[str, str]) -> str:
    """Return the one line that a command that cannot go on leaves on stderr; it may have been printed before the patience ended."""
    done = subprocess.run([*TREADLINE, *command], env=env, capture_output=True, text=True, timeout=100, check=False)
    assert done.returncode == 2, done.stderr
    *declared, last = [line for line in done.stderr.splitlines() if line.startswith("treadline:")]
    assert [line.removeprefix("treadline: seat: ") in last for line in declared] in ([], [True]), done.stderr
    assert "Traceback" not in done.stderr
    return last


def test_a_dead_roscore_is_reported_in_one_line(environment: dict[str, str]) -> None:
    env = environment | {"ROS_MASTER_URI": "http://127.0.0.1:9"}
    line = line_of(["node", "guard", "--transport", "ros1"], env)
    assert line == "treadline: no roscore answers at http://127.0.0.1:9: start one (roscore), or set ROS_MASTER_URI"


def test_a_missing_topic_is_reported_in_one_line(roscore: dict[str, str]) -> None:
    line = line_of(["node", "seat", "--transport", "ros1", "--patience", "2"], roscore)
    assert line == "treadline: seat: nothing on /seat/state after 2 s: nobody publishes /seat/state"


def test_a_wrong_type_is_reported_in_one_line(roscore: dict[str, str]) -> None:
    other = subprocess.Popen(["rostopic", "pub", "-r", "10", "/seat/state", "sensor_msgs/Imu", "{}"], env=roscore)
    try:
        line = line_of(["node", "seat", "--transport", "ros1", "--patience", "3"], roscore)
    finally:
        other.terminate()
        other.wait(10)
    assert "/seat/state is published as sensor_msgs/msg/Imu; sensor_msgs/msg/JointState is read" in line


def test_stamps_of_another_clock_are_reported_in_one_line(roscore: dict[str, str]) -> None:
    stamped = "{header: {stamp: {secs: 5, nsecs: 0}}, position: [0.1, 0.0]}"
    other = subprocess.Popen(["rostopic", "pub", "-r", "10", "/seat/state", "sensor_msgs/JointState", stamped], env=roscore)
    try:
        line = line_of(["node", "seat", "--transport", "ros1", "--clock", "wall", "--patience", "20"], roscore)
    finally:
        other.terminate()
        other.wait(10)
    assert "/seat/state: stamped 5.000 s where the clock shows 1" in line
    assert "stamps of another clock" in line


def test_what_was_recorded_through_ros_is_replayed(roscore: dict[str, str], tmp_path: Path) -> None:
    bag = tmp_path / "run.bag"
    options = ["--transport", "ros1", "--pace", "0.5", "--duration", "3", "--out", str(bag)]
    done = subprocess.run([*TREADLINE, "nodes", str(TESTS / "short.toml"), *options], env=roscore, check=False, timeout=240)
    assert done.returncode == 0
    info = subprocess.run(["rosbag", "info", str(bag)], capture_output=True, text=True, check=True).stdout
    assert "sensor_msgs/Image" in info
    again = subprocess.run([*TREADLINE, "replay", str(bag), "--out", str(tmp_path / "again")], check=False, capture_output=True)
    assert again.returncode == 0, again.stderr
