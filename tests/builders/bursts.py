"""Guard process on three pseudo-terminals, next to two processes that keep both cores busy in bursts.

``python -m bursts`` prints the durations of its ticks [s]. All have real-time scheduling: devices above the guard, because they do
not wait for the computer, and bursts below it.
"""

import contextlib
import json
import os
import socket
import subprocess
import sys
import time
import tty
from pathlib import Path
from typing import Any

from emulated_bno055 import EmulatedBno055
from emulated_chair import LIMITS
from world import limits

from treadline.core.processes import GUARD, LOOP, real_time
from treadline.hardware import _guard_process
from treadline.hardware._frame import Present
from treadline.hardware._process_messages import send
from treadline.hardware.emulators._firmware import DriveBox, Readings

TICKS = 1500
BURST_S, PAUSE_S = 0.2, 0.1
"""Two thirds of each core: the kernel leaves 95 % of a second to real-time processes."""


def say(*words: str) -> None:
    sys.stdout.write(" ".join(words) + "\n")
    sys.stdout.flush()


def burst() -> None:
    """Keep a core busy, with pauses."""
    with real_time(LOOP):
        while True:
            end_s = time.monotonic() + BURST_S
            while time.monotonic() < end_s:
                pass
            time.sleep(PAUSE_S)


def devices() -> None:
    """Print the ports of a box, a sensor and a keyboard with a held key, and send from them a hundred times a second."""
    with real_time(GUARD + 1):
        readings = Readings(
            present=Present.SEAT | Present.FLIPPER | Present.VOLTAGE, voltage_mv=25_000, seat=(1, 300), flipper=(70, 1)
        )
        sensor, frame, ends = EmulatedBno055(), DriveBox().frame(readings), [os.openpty() for _ in range(2)]
        for near, far in ends:
            tty.setraw(far)
            os.set_blocking(near, False)
        say(*[os.ttyname(far) for _, far in ends], sensor.port)
        while True:
            for (near, _), data in zip(ends, (frame, b"r"), strict=True):
                with contextlib.suppress(BlockingIOError):
                    os.write(near, data)
            time.sleep(0.01)


def guard(box: str, sensor: str) -> None:
    """Run the guard process of a session, with the keyboard at standard input; print what its ticks took."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    links: dict[str, Any] = {"drives": {"class": "treadline.hardware._serial_link:SerialLink", "options": {"port": box}}}
    links["imu"] = {"class": "treadline.hardware._bno055:Bno055Link", "options": {"port": sensor}}
    links["handset"] = {"class": "treadline.hardware._handset:Keyboard", "options": {}}
    send(ours, {"links": links, "limits": LIMITS, "signs": {"swapped": False, "left": 1, "right": 1}})
    session = {"config": limits(), "start_s": time.monotonic(), "note": "", "cause": "not armed", "rearms": True}
    send(ours, {"session": session})
    took, tick = list[float](), _guard_process.GuardProcess.tick

    def timed(process: Any, now_s: float) -> None:
        tick(process, now_s)
        took.append(time.monotonic() - now_s)
        if len(took) == TICKS:
            say(json.dumps({"took": took, "lost": process._links.lost, "box": process._links.state is not None}))
            ours.close()

    _guard_process.GuardProcess.tick = timed
    _guard_process.main(theirs.detach())


def main() -> None:
    """Start devices and bursts, then the guard."""
    command = [sys.executable, "-m", "bursts"]
    others = [subprocess.Popen([*command, "devices"], stdout=subprocess.PIPE, text=True)]
    try:
        box, keys, sensor = others[0].stdout.readline().split()
        others += [subprocess.Popen([*command, "burst"]) for _ in range(2)]
        with Path(keys).open("rb", buffering=0) as terminal:
            subprocess.run([*command, "guard", box, sensor], stdin=terminal, check=True, timeout=120.0)
    finally:
        for process in others:
            process.kill()
            process.wait()


if __name__ == "__main__":
    {"devices": devices, "burst": burst, "guard": guard}.get((sys.argv[1:] or [""])[0], main)(*sys.argv[2:])
