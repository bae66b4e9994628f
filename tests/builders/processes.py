"""Other processes and what they do in their own time."""

import time
from collections.abc import Callable
from pathlib import Path

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


def wait_for(condition: Callable[[], bool], within_s: float = 60.0, pause_s: float = 0.02) -> None:
    """Wait until something is so, and fail if it does not become so."""
    limit = time.monotonic() + within_s
    while not (is_so := condition()) and time.monotonic() < limit:
        time.sleep(pause_s)
    assert is_so


def alive(pid: int) -> bool:
    """Return whether a process runs; one that ended and that nobody asked about does not."""
    stat = Path(f"/proc/{pid}/stat")
    return stat.exists() and stat.read_text().rpartition(")")[2].split()[0] != "Z"
