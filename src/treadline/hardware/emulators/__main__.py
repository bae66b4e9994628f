"""Command line of the emulators: ``python -m treadline.hardware.emulators serial``."""

import os
import select
import sys
import time
from pathlib import Path
from typing import Any, Literal

import cyclopts

from treadline.core.errors import TreadlineError
from treadline.core.processes import LOOP, real_time
from treadline.core.signals import TICK_S
from treadline.hardware.emulators._chair import EmulatedChair
from treadline.hardware.emulators._faults import KINDS, Faults
from treadline.hardware.emulators._serial import SerialBox, Terminal
from treadline.hardware.emulators.camera import FrameFile

app = cyclopts.App(name="python -m treadline.hardware.emulators", help_epilogue=f"Faults: {KINDS}")


@app.default
def emulate(
    link: Literal["serial", "can", "base", "vesc"],
    /,
    *,
    port: Path = Path("chair"),
    channel: str = "239.74.163.2",
    udp_port: int = 43113,
    scenario: str = "up-28",
    seed: int = 0,
    fault: list[str] | None = None,
    pace: float = 1.0,
) -> None:
    """Emulate a chair: its motion in MuJoCo, and the firmware of its box, until Ctrl-C.

    A fault that is typed, KIND or KIND=VALUE and Enter, begins at once; an empty line ends all faults.

    Args:
        link: Link to the drives: serial, a line behind a pseudo-terminal; can and vesc, a bus of python-can's udp_multicast with
            the drives 1 (left) and 2 (right), whose motors turn the chair's pulleys (of vesc, 7 pole pairs and a gear of 10); or
            base, speeds and odometry in datagrams. The sensors are on the serial line in all.
        port: Path of the serial port: a link to the pseudo-terminal.
        channel: Multicast address that carries the CAN bus.
        udp_port: Port that carries the CAN bus, or the speeds of a base.
        scenario: Scenario, by name or file: stair, chair, load and start.
        seed: Random seed of the stair and of the sensors' noise.
        fault: Fault as KIND@START or KIND@START=VALUE, in seconds of the emulator's clock; may be repeated.
        pace: Emulated seconds in a second of the wall clock.
    """
    faults = Faults(fault or [])
    if link != "serial":
        from treadline.hardware.emulators._base import DatagramBase, VescDrives
        from treadline.hardware.emulators._can import CanAxes

        kinds: dict[str, Any] = {"can": CanAxes, "base": DatagramBase, "vesc": VescDrives}
    chair = EmulatedChair(scenario, seed, faults, FrameFile(port))
    bus = {"interface": "udp_multicast", "channel": channel, "port": udp_port, "fd": False}
    with real_time(LOOP) as granted:  # a chair does not slow down with the computer that drives it
        terminal = Terminal(port)
        made = chair, faults, terminal
        emulated: Any = SerialBox(*made) if link == "serial" else kinds[link](*made, bus)
        _say(f"chair at {port}{'' if link == 'serial' else f', drives on {channel} {udp_port}'}; Ctrl-C ends it")
        _say(granted)
        due_s = time.monotonic()
        while True:
            for line in _typed():
                faults.type(line, chair.t_s)
                _say(f"{chair.t_s:.2f} s: fault {line or 'none'}")
            t_s = chair.t_s
            for event in emulated.step():
                _say(f"{t_s:.2f} s: {event}")
            # A late tick delays all later ones: a busy computer slows the chair down and does not leave it without commands.
            due_s = max(due_s + TICK_S / pace, time.monotonic())
            time.sleep(max(due_s - time.monotonic(), 0.0))


def _typed() -> list[str]:
    """Return the lines that a person has typed."""
    is_ready = select.select([0], [], [], 0.0)[0]
    return os.read(0, 4096).decode().splitlines() if is_ready else []


def _say(text: str) -> None:
    print(text, flush=True)  # noqa: T201 - the program runs in a terminal of its own


def main() -> None:
    """Run the command line: an error is one line, and Ctrl-C no error."""
    try:
        app()
    except TreadlineError as error:
        sys.exit(f"treadline: {error}")
    except ModuleNotFoundError as error:
        sys.exit(f"treadline: {error}; pip install '.[hardware]' in treadline's folder")
    except KeyboardInterrupt:
        return


if __name__ == "__main__":
    main()
