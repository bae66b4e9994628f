"""Command line of the emulators: ``python -m treadline.hardware.emulators serial``."""

import sys
from pathlib import Path
from typing import Literal

import cyclopts

from treadline.core.errors import TreadlineError
from treadline.hardware.emulators._chair import EmulatedChair
from treadline.hardware.emulators._clock import TickPacer
from treadline.hardware.emulators._faults import KINDS, Faults
from treadline.hardware.emulators._serial import SerialBox

app = cyclopts.App(name="python -m treadline.hardware.emulators", help_epilogue=f"Faults: {KINDS}")


@app.default
def emulate(
    link: Literal["serial"],  # noqa: ARG001 - the bus follows
    /,
    *,
    port: Path = Path("chair"),
    scenario: str = "up-28",
    seed: int = 0,
    fault: list[str] | None = None,
    pace: float = 1.0,
) -> None:
    """Emulate a chair: its motion in MuJoCo, and the firmware of its box, until Ctrl-C.

    Args:
        link: Link to the drives: serial, a line behind a pseudo-terminal.
        port: Path of the serial port: a link to the pseudo-terminal.
        scenario: Scenario, by name or file: stair, chair, load and start.
        seed: Random seed of the stair and of the sensors' noise.
        fault: Fault as KIND@START or KIND@START=VALUE, in seconds of the emulator's clock; may be repeated.
        pace: Emulated seconds in a second of the wall clock.
    """
    faults = Faults(fault or [])
    chair = EmulatedChair(scenario, seed, faults)
    box = SerialBox(chair, faults, port)
    print(f"chair at {port}; Ctrl-C ends it", flush=True)  # noqa: T201 - a program that runs in a terminal of its own
    pacer = TickPacer(pace)
    while True:
        box.step()
        pacer.wait()


def main() -> None:
    """Run the command line: an error is one line, and Ctrl-C no error."""
    try:
        app()
    except TreadlineError as error:
        sys.exit(f"treadline: {error}")
    except KeyboardInterrupt:
        return


if __name__ == "__main__":
    main()
