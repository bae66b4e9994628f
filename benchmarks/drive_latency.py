"""Latency of a real chair's software, from sensor to belt, as a table: idle, and with every core busy.

``python benchmarks/drive_latency.py --seconds 60``. A link inside the guard process emits readings and stamps what it is commanded;
everything between is that of ``treadline drive``. The line to the box, the box and the motors are not included.
"""

import argparse
import json
import multiprocessing
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from treadline.core.camera_images import NamedFrame, RgbdFrame
from treadline.core.processes import LOOP, real_time
from treadline.core.signals import FlipperReading, ImuSample, OperatorInput, SeatReading
from treadline.hardware._arming import BenchSession
from treadline.hardware._guard_client import GuardClient
from treadline.hardware._robot_plant import CameraThread
from treadline.hardware.drive import Robot
from treadline.hardware.ports import DriveLimits, DriveState
from treadline.hardware.robot_file import read_robot
from treadline.mission._warm_up import stair_frames
from treadline.mission.mission_blocks import detector_of, warm_up
from treadline.perception.frame_quality import quality_of
from treadline.perception.free_ground import ground_ahead

FRAME_S = 0.1
"""Period of the frames [s]: Table I, 10 Hz."""
STOP_S = 0.5
"""Interval of the stops [s]; each is followed by a re-arm."""
FILE = """
name = "latency"
limits = {{ belt_m_s = 0.3, acceleration_m_s2 = 1.0 }}
drives = {{ link = "drive_latency:StampLink", out = "{out}" }}
imu = {{ link = "drives" }}
handset = {{ link = "drives" }}
mission = {{ payload_kg = 0.0 }}
"""


class StampLink:
    """Link to drives, inertial sensor and handset that emits readings at 100 Hz and stamps the calls that answer them."""

    def __init__(self, *, limits: DriveLimits, out: str) -> None:
        del limits
        self.out, self.latched, self.due_s = Path(out), True, time.monotonic()
        self.stop_s: float | None = None
        self.next_stop_s = self.due_s + 5.0 * STOP_S
        self.brakes: list[float] = []
        self.sent: dict[str, float] = {}

    def poll(self) -> list[Any]:
        """Return a sample of each sensor, and the stops and re-arms that are due."""
        readings: list[Any] = []
        now_s = time.monotonic()
        if now_s < self.due_s:
            return readings
        self.due_s = max(self.due_s + 0.01, now_s)
        still = {"left_m_s": 0.0, "right_m_s": 0.0, "watchdog_tripped": False, "error": None, "voltage_v": None}
        readings.append(DriveState(t_s=now_s, box_s=None, latched=False, **still))
        readings.append(SeatReading(t_s=now_s, pitch_rad=0.0, stroke_m=0.03))
        readings.append(FlipperReading(t_s=now_s, angle_rad=0.7, torque_n_m=0.0))
        readings.append(
            ImuSample(
                t_s=now_s,
                orientation=(1.0, 0.0, 0.0, 0.0),
                angular_velocity_rad_s=(0.0,) * 3,
                linear_acceleration_m_s2=(0.0, 0.0, 9.81),
            )
        )
        stop = now_s >= self.next_stop_s and self.stop_s is None and not self.latched
        if stop:
            self.stop_s = now_s
        rearm = self.latched and now_s > self.next_stop_s + 0.2
        if rearm:
            self.next_stop_s = now_s + STOP_S
        readings.append(OperatorInput(t_s=now_s, dead_man=True, stop=stop, rearm=rearm))
        return readings

    def send(self, left_m_s: float, right_m_s: float) -> None:
        """Stamp a command that is new."""
        del right_m_s
        self.sent.setdefault(f"{left_m_s:.9f}", time.monotonic())

    def hold(self) -> None:
        """Ignore it."""

    def stop(self) -> None:
        """Stamp the answer to a stop."""
        if self.stop_s is not None:
            self.brakes.append(time.monotonic() - self.stop_s)
        self.stop_s, self.latched = None, True

    def rearm(self) -> None:
        """Drive again."""
        self.latched = False

    def close(self) -> None:
        """Write what was stamped."""
        self.out.write_text(json.dumps({"brakes": self.brakes, "sent": self.sent}))


def camera_frames(frame: RgbdFrame) -> Iterator[NamedFrame]:
    """Yield a frame of a staircase at 10 Hz, each time with other noise, stamped as it is handed over."""
    rng = np.random.default_rng(7)
    due_s, number = time.monotonic(), 0
    while True:
        depth_m = (frame.depth_m + 1e-3 * rng.standard_normal(frame.depth_m.shape)).astype(np.float32)
        due_s += FRAME_S
        time.sleep(max(due_s - time.monotonic(), 0.0))
        stamped = replace(frame, depth_m=depth_m, t_s=time.monotonic())
        yield NamedFrame(name=str(number), frame=stamped, mount_known=True, gravity_C=None)
        number += 1


def measure(seconds: float) -> dict[str, list[float]]:
    """Return latencies by row [ms]."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "link.json"
        path = Path(folder) / "robot.toml"
        path.write_text(FILE.format(out=out))
        robot = Robot.of(read_robot(path))
        warm_up(robot.mission)
        rows, proposed = _looped(robot, seconds)
        link = json.loads(out.read_text())
    rows["command → belt"] = [1e3 * (at - proposed[value]) for value, at in link["sent"].items() if value in proposed]
    rows["stop → guard → brake"] = [1e3 * value for value in link["brakes"]]
    return rows


def _looped(robot: Robot, seconds: float) -> tuple[dict[str, list[float]], dict[str, float]]:
    rows: dict[str, list[float]] = {"camera → heading": [], "IMU → loop": []}
    proposed: dict[str, float] = {}
    shown, gravity_C = list(stair_frames(robot.mission.chair.camera_at(), rises=True))[1]  # the first is out of range
    client, camera = GuardClient(robot.file), CameraThread(camera_frames(shown))
    detector = detector_of(robot.mission)
    try:
        session = BenchSession(client, robot.bench_config(), "waits for a re-arm")
        with real_time(LOOP) as granted:
            sys.stderr.write(f"loop: {granted}; guard: {client.note}\n")
            while session.t_s < seconds:
                speed = 0.01 + 1e-6 * round(session.t_s / 0.01)
                proposed.setdefault(f"{speed:.9f}", time.monotonic())
                for reading in session.tick(speed, speed):
                    if isinstance(reading, ImuSample):
                        rows["IMU → loop"].append(1e3 * (time.monotonic() - session.start_s - reading.t_s))
                for frame in camera.take(session.start_s):
                    quality_of(frame, ground_ahead(frame, gravity_C, robot.mission.chair.swept_half_m).obstacle_m)
                    if detector.see(frame, gravity_C).measurement is not None:
                        rows["camera → heading"].append(1e3 * (time.monotonic() - session.start_s - frame.t_s))
    finally:
        client.close()
        camera.close()
    return rows, proposed


@contextmanager
def busy(*, wanted: bool) -> Iterator[None]:
    """Keep every core busy."""
    count = multiprocessing.cpu_count() if wanted else 0
    burning = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(count)]
    try:
        yield
    finally:
        for process in burning:
            process.kill()
            process.wait()


def main() -> None:
    """Print the table in Markdown."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0)
    seconds = parser.parse_args().seconds
    os.environ["PYTHONPATH"] = os.pathsep.join([str(Path(__file__).parent), *sys.path[1:]])
    print("| path | cores | p50 [ms] | p95 | p99 | max | number |\n| --- | --- | --- | --- | --- | --- | --- |")
    for name, wanted in (("idle", False), ("busy", True)):
        with busy(wanted=wanted):
            rows = measure(seconds)
        for row, values in rows.items():
            p50, p95, p99 = np.percentile(values, (50, 95, 99))
            print(f"| {row} | {name} | {p50:.1f} | {p95:.1f} | {p99:.1f} | {max(values):.1f} | {len(values)} |", flush=True)


if __name__ == "__main__":
    main()
