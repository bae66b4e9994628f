"""Delay from camera to command on ROS 2: ``. "$(ros2/environment.sh)/env.sh"; python benchmarks/ros2_latency.py [SECONDS]``.

The graph drives in real time, its six nodes in one process or in six, on an idle machine and next to one process that keeps a core
busy. A bystander measures from a frame's arrival to the guard's first command with its heading. CPU time is that of the nodes by
simulated second; ``zenoh`` is ``treadline nodes`` on the same scenario.
"""

import math
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from nodes import ENDPOINT, SCENARIO, FrameToCommand, wire
from treadline_ros2.lifecycle_node import Executor
from treadline_ros2.transport import RclpyTransport

ROLES = ("guard", "camera", "heading", "seat", "driver", "plant")


def cpu_s() -> float:
    """Return the CPU time of this process's descendants that run, the busy one left out [s]."""
    rows = {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            words = stat.read_text().rpartition(")")[2].split()
            rows[int(stat.parent.name)] = int(words[1]), int(words[11]) + int(words[12]), (stat.parent / "cmdline").read_bytes()
        except OSError:
            continue  # it has ended meanwhile
    ours, before = {os.getpid()}, 0
    while len(ours) != before:
        before = len(ours)
        ours |= {pid for pid, (parent, _, words) in rows.items() if parent in ours and BUSY.encode() not in words}
    return sum(rows[pid][1] for pid in ours - {os.getpid()} if pid in rows) / os.sysconf("SC_CLK_TCK")


class Used:
    """CPU time of the nodes by simulated second, from the first simulated second on."""

    def __init__(self, delays: FrameToCommand) -> None:
        self._delays, self._began = delays, (0.0, 0.0)
        self.by_second = math.nan

    def look(self) -> None:
        """Take the CPU time now; the last look counts."""
        t_s = self._delays.t_s
        if t_s < 1.0:
            return
        if self._began[0] == 0.0:
            self._began = t_s, cpu_s()
        elif t_s > self._began[0] + 1.0:
            self.by_second = (cpu_s() - self._began[1]) / (t_s - self._began[0])


BUSY = "while True: pass"


def busy() -> subprocess.Popen[bytes]:
    return subprocess.Popen([sys.executable, "-c", BUSY])


def report(what: str, delays: FrameToCommand, used: Used) -> None:
    p50, p95, p99 = np.percentile(delays.to_command[3:] or [np.nan], (50, 95, 99))
    print(f"| {what} | {len(delays.to_command)} | {p50:.0f} / {p95:.0f} / {p99:.0f} | {used.by_second:.2f} |", flush=True)


def ros2(scenario: Path, processes: Sequence[Sequence[str]], seconds: float) -> tuple[FrameToCommand, Used]:
    """Return the delays, and the nodes' CPU time."""
    node, executor = rclpy.create_node("latency"), Executor()
    executor.add_node(node)

    def attempt(do: Any, *given: Any) -> None:
        do(*given)

    delays = FrameToCommand(RclpyTransport(node, attempt))
    used = Used(delays)
    given = ["--ros-args", "-p", f"scenario:={scenario}", "-p", "use_sim_time:=true", "-p", "autostart:=true"]
    command = [sys.executable, "-m", "treadline_ros2.node"]
    started = [subprocess.Popen([*command, *roles, *given], stderr=subprocess.DEVNULL) for roles in processes]
    while delays.t_s < seconds:
        executor.spin_once(timeout_sec=0.05)
        if 1.0 < delays.t_s < 1.1:
            used.look()
    used.look()
    for process in started:
        process.send_signal(signal.SIGINT)
    for process in started:
        process.wait(30)
    executor.shutdown()
    node.destroy_node()
    return delays, used


def zenoh(scenario: Path, seconds: float) -> tuple[FrameToCommand, Used]:
    """Return the delays, and the nodes' CPU time."""
    options = ["--transport", "zenoh", "--endpoint", ENDPOINT, "--duration", str(seconds)]
    started = subprocess.Popen([sys.executable, "-m", "treadline", "nodes", str(scenario), *options], stderr=subprocess.DEVNULL)
    watch = wire("zenoh", "bystander")
    delays = FrameToCommand(watch)
    used = Used(delays)
    while started.poll() is None:
        watch.deliver(0.05)
        if 1.0 < delays.t_s < 1.1 or seconds - 0.5 < delays.t_s < seconds - 0.2:  # the nodes still run
            used.look()
    watch.close()
    return delays, used


def main() -> None:
    """Print a table."""
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 30.0
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    rclpy.init()
    print("| graph | frames | p50 / p95 / p99 [ms] | CPU by simulated second [s] |\n| --- | --- | --- | --- |")
    with tempfile.TemporaryDirectory() as folder:
        scenario = Path(folder) / "climb.toml"
        scenario.write_text(SCENARIO)
        for load in ("", ", one core busy"):
            others = [busy()] if load else []
            for name, processes in (("one process", [ROLES]), ("six processes", [[role] for role in ROLES])):
                report(f"rclpy, {name}{load}", *ros2(scenario, processes, seconds))
            report(f"zenoh, six processes{load}", *zenoh(scenario, seconds))
            for process in others:
                process.kill()
                process.wait()
    rclpy.shutdown()


if __name__ == "__main__":
    main()
