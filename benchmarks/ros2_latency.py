"""Delay from camera to command on ROS 2: ``. "$(ros2/environment.sh)/env.sh"; python benchmarks/ros2_latency.py [SECONDS]``.

The graph drives in real time on the MuJoCo plant, its six nodes in one process or in six, on an idle machine and next to one
process that keeps a core busy. A bystander measures from a frame's arrival to the guard's first command that uses the heading
of this frame. The driver sends at 4 Hz, the guard at 100 Hz; only guard commands count.
"""

import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import rclpy
from treadline_ros2.lifecycle_node import Executor
from treadline_ros2.transport import RclpyTransport

from treadline.core.camera_images import RgbdFrame
from treadline.core.signals import HeadingEstimate, HeadingMeasurement, TrackCommand
from treadline.ros import channels as on

ROLES = ("guard", "camera", "heading", "seat", "driver", "plant")
SCENARIO = """
[stair]
steps = 66
width_m = 2.4
[start]
place = "flight"
step = 6
heading_deg = 10
[drive]
duration_s = 600
"""


class FrameToCommand:
    """Delays from a frame's arrival to the guard's first command after the estimate with its heading [ms]."""

    def __init__(self, watch: RclpyTransport) -> None:
        self.delays_ms: list[float] = []
        self.t_s = 0.0
        self._arrived_s: dict[float, float] = {}
        self._seen_s: float | None = None
        self._known_s: float | None = None
        watch.subscribe(on.CAMERA, self._frame)
        watch.subscribe(on.MEASURED, self._measured)
        watch.subscribe(on.ESTIMATE, self._estimated)
        watch.subscribe(on.TRACKS_CMD, self._commanded)

    def _frame(self, picture: RgbdFrame) -> None:
        self._arrived_s[picture.t_s] = time.monotonic()

    def _measured(self, seen: HeadingMeasurement) -> None:
        self._seen_s, self._known_s = self._arrived_s.get(seen.t_s), None

    def _estimated(self, estimate: HeadingEstimate) -> None:
        self.t_s, self._known_s = estimate.t_s, self._seen_s

    def _commanded(self, _: TrackCommand) -> None:
        if self._known_s is not None:
            self.delays_ms.append(1e3 * (time.monotonic() - self._known_s))
            self._seen_s = self._known_s = None


def delays(scenario: Path, processes: Sequence[Sequence[str]], seconds: float) -> list[float]:
    """Return the delays of one drive [ms]."""
    node, executor = rclpy.create_node("latency"), Executor()
    executor.add_node(node)
    watch = FrameToCommand(RclpyTransport(node, lambda do, *given: do(*given)))
    given = ["--ros-args", "-p", f"scenario:={scenario}", "-p", "use_sim_time:=true", "-p", "autostart:=true"]
    command = [sys.executable, "-m", "treadline_ros2.node"]
    started = [subprocess.Popen([*command, *roles, *given], stderr=subprocess.DEVNULL) for roles in processes]
    while watch.t_s < seconds:
        executor.spin_once(timeout_sec=0.05)
    for process in started:
        process.send_signal(signal.SIGINT)
    for process in started:
        process.wait(30)
    executor.shutdown()
    node.destroy_node()
    return watch.delays_ms[3:]


def main() -> None:
    """Print a table."""
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 30.0
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    rclpy.init()
    print("| graph | frames | p50 / p95 / p99 [ms] |\n| --- | --- | --- |")
    with tempfile.TemporaryDirectory() as folder:
        scenario = Path(folder) / "climb.toml"
        scenario.write_text(SCENARIO)
        for load in ("", ", one core busy"):
            others = [subprocess.Popen([sys.executable, "-c", "while True: pass"])] if load else []
            for name, processes in (("one process", [ROLES]), ("six processes", [[role] for role in ROLES])):
                found_ms = delays(scenario, processes, seconds)
                p50, p95, p99 = np.percentile(found_ms or [np.nan], (50, 95, 99))
                print(f"| rclpy, {name}{load} | {len(found_ms)} | {p50:.0f} / {p95:.0f} / {p99:.0f} |", flush=True)
            for process in others:
                process.kill()
                process.wait()
    rclpy.shutdown()


if __name__ == "__main__":
    main()
