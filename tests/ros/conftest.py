"""The graph over a wire, started as a user starts it, and a bystander who watches it."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from processes import SHORT_FLIGHT

from treadline.ros import channels as on
from treadline.ros._node_signals import Clock
from treadline.ros.wire import WireTransport


class Graph:
    """``treadline nodes`` and its processes."""

    def __init__(self, folder: Path, transport: str, options: list[str]) -> None:
        scenario = folder / "short.toml"
        scenario.write_text(f"{SHORT_FLIGHT}[drive]\nduration_s = 60\n")
        self._err = (folder / "stderr").open("w+")
        command = [sys.executable, "-m", "treadline", "nodes", str(scenario), "--transport", transport, "--json", *options]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=self._err, text=True)

    def pid(self, name: str) -> int:
        deadline = time.monotonic() + 60.0
        while time.monotonic() < deadline:
            found = re.search(rf"treadline: {name} +pid (\d+)", Path(self._err.name).read_text())
            if found:
                return int(found[1])
            time.sleep(0.1)
        raise AssertionError(Path(self._err.name).read_text())

    def kill(self, name: str) -> None:
        os.kill(self.pid(name), signal.SIGKILL)

    def result(self) -> dict[str, Any]:
        out, _ = self.process.communicate(timeout=240)
        return json.loads(out)

    def close(self) -> None:
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGINT)
            self.process.wait(20)
        self.process.stdout.close()
        self._err.close()


class Bystander:
    """Takes the clock, and what else it is asked to."""

    def __init__(self, wire: WireTransport, *channels: str) -> None:
        self.wire = wire
        self.t_s = 0.0
        self.heard: dict[str, list[tuple[float, Any]]] = {channel: [] for channel in channels}
        wire.subscribe(on.CLOCK, self._clock)
        for channel in channels:
            wire.subscribe(channel, lambda signal, channel=channel: self.heard[channel].append((self.t_s, signal)))

    def until(self, done: Callable[[], bool], timeout_s: float = 120.0) -> None:
        deadline = time.monotonic() + timeout_s
        while not done():
            assert time.monotonic() < deadline, f"at {self.t_s} s of the graph's clock"
            self.wire.deliver(0.05)

    def _clock(self, clock: Clock) -> None:
        self.t_s = clock.t_s


@pytest.fixture
def start(tmp_path: Path) -> Any:
    """Start graphs; what is started is ended."""
    running: list[Graph] = []

    def started(transport: str, *options: str) -> Graph:
        running.append(Graph(tmp_path, transport, list(options)))
        return running[-1]

    yield started
    for graph in running:
        graph.close()


@pytest.fixture
def bystander() -> type[Bystander]:
    """Hand the class out: test folders are not packages."""
    return Bystander
