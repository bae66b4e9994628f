"""Other processes and what they do in their own time."""

import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from threading import Thread
from typing import Any

SHORT_FLIGHT = """
[stair]
steps = 12
[start]
place = "flight"
step = 4
heading_deg = 8
[sensors]
camera = "kinect1"
"""
"""Scenario of a graph whose nodes are other processes: a chair on a flight, turned."""


def wait_for(
    condition: Callable[[], Any], said: Callable[[], object] = str, *, within_s: float = 60.0, pause_s: float = 0.01
) -> Any:
    """Return the first true result of a condition; a test that waits in vain fails with what was said."""
    limit = time.monotonic() + within_s
    while not (result := condition()) and time.monotonic() < limit:
        time.sleep(pause_s)
    assert result, f"it did not come to pass: {said()}"
    return result


class Heard:
    """Process of Python whose lines are read as they come.

    Args:
        arguments: Module and its arguments.
        obey: Receives each line.
    """

    def __init__(self, *arguments: object, obey: Callable[[str], None] = lambda _: None) -> None:
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.STDOUT}
        self.process = subprocess.Popen([sys.executable, "-m", *map(str, arguments)], text=True, **pipes)
        self.lines: list[str] = []
        self._obey = obey
        self._ear = Thread(target=self._hear, daemon=True)
        self._ear.start()

    def _hear(self) -> None:
        for line in self.process.stdout:
            self.lines.append(line.strip())
            self._obey(line)

    def type(self, line: str) -> None:
        self.process.stdin.write(line + "\n")
        self.process.stdin.flush()

    def has(self, text: str) -> bool:
        return any(text in line for line in self.lines)

    def end(self) -> None:
        """End it, stopped or not, and read the rest."""
        self.process.kill()
        self.process.wait()
        self._ear.join()
        self.process.communicate()


def alive(pid: int) -> bool:
    """Return whether a process runs; one that ended and that nobody asked about does not."""
    stat = Path(f"/proc/{pid}/stat")
    return stat.exists() and stat.read_text().rpartition(")")[2].split()[0] != "Z"
