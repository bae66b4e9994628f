"""``python -m treadline`` is ``treadline``: the process as a whole, from before the first heavy import to its end."""

import signal
import sys

from treadline import interrupts


def main() -> int:
    """Run the command line of this process; a Ctrl-C at any moment is one line and exit code 130."""
    interrupts.install()
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
