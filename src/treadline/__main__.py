"""``python -m treadline`` is ``treadline``: the process as a whole, from before the first heavy import to its end."""

import signal
import sys
import time
from types import FrameType

BURST_S = 0.2
"""Ctrl-C pressed again within it is the same wish: one that falls while the first is being answered would be an error."""


class Interrupts:
    """Raises ``KeyboardInterrupt`` once for a burst of Ctrl-C."""

    def __init__(self) -> None:
        self._heard_s = -BURST_S

    def __call__(self, number: int, frame: FrameType | None) -> None:
        """Answer a signal."""
        before_s, self._heard_s = self._heard_s, time.monotonic()
        if self._heard_s - before_s >= BURST_S:
            signal.default_int_handler(number, frame)


def main() -> int:
    """Run the command line of this process; a Ctrl-C at any moment is one line and exit code 130."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:  # a shell may have had it ignored
        signal.signal(signal.SIGINT, Interrupts())
    try:
        from treadline.cli import main as run

        code = run()
    except KeyboardInterrupt:
        sys.stderr.write("treadline: interrupted\n")
        code = 130
    # Python notes an interrupt that falls into source text run by a library (the methods of a dataclass), whoever answers it, and
    # would end a module by the signal. The next source text clears the note.
    eval("0")  # noqa: S307
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # all is done: what comes now has nothing to interrupt
    return code


if __name__ == "__main__":
    sys.exit(main())
