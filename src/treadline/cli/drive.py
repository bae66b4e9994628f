"""``treadline drive``: a real chair, by its robot file."""

import math
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from treadline.cli._arguments import Force, check_times, claim
from treadline.cli._output import Answer
from treadline.core.errors import SettingsError
from treadline.core.printing import say

WARNING = "drive was tried on emulators alone: no person may sit on the chair, and one person holds its dead-man switch"


def drive(
    robot: Path,
    /,
    *,
    out: Path,
    bench: bool = False,
    record: bool = False,
    log_images: bool = False,
    seconds: float | None = None,
    force: Force = False,
) -> Answer:
    """Drive a real chair up or down a stair: arming list, then mission, guard and log as in a simulated run.

    It was tried on emulators alone, and no person may sit on the chair. Nothing moves before a person holds the dead-man switch and
    re-arms. The guard runs in a process of its own; Ctrl-C stops the chair.

    treadline drive hardware.toml --bench --out runs/bench

    Args:
        robot: Robot file: links, speed limits, camera and mission (docs/how-to/drive-hardware.md).
        out: Run folder: log.mcap, result.json, manifest.json; of a drive also series.csv.
        bench: Drive the belts by the handset, at most 0.1 m/s, without camera and mission; lift the chair off the ground.
        record: Record all sensors, every frame included, without motion.
        log_images: Keep every frame of a drive in the log.
        seconds: Duration [s]. Default: until the mission or Ctrl-C ends it.
    """
    from treadline.hardware import drive as runs
    from treadline.hardware.robot_file import read_robot

    check_times(seconds=seconds)
    if bench and record:
        raise SettingsError("--bench and --record: give one of them")
    file = read_robot(robot)
    claim(out, force=force)
    limit_s = math.inf if seconds is None else seconds
    say(WARNING)
    with _keys(file.handset is not None and file.handset.link == "keyboard"):
        if record:
            values = runs.record(file, out, limit_s)
        elif bench:
            values = runs.bench(file, out, limit_s, say)
        else:
            values = runs.drive(file, out, limit_s, say, images=int(log_images))
    cause = f": {values['cause']}" if values["cause"] else ""
    return Answer(
        values=values | {"run": str(out)},
        summary=[
            f"{values['verdict']}{cause} after {values['duration_s']:.1f} s",
            f"run folder: {out} (treadline view {out} plays it)",
        ],
        code=0 if values["verdict"] in ("arrived", "time_up") else 1,
    )


@contextmanager
def _keys(wanted: bool) -> Iterator[None]:
    """Let keys arrive one by one and unprinted; restore the terminal at the end, however it comes."""
    if not (wanted and os.isatty(sys.stdin.fileno())):
        yield
        return
    import termios
    import tty

    before = termios.tcgetattr(sys.stdin)
    try:
        tty.setcbreak(sys.stdin)
        yield
    finally:
        termios.tcsetattr(sys.stdin, termios.TCSADRAIN, before)
