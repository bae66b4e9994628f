"""``python -m treadline`` is ``treadline``: the process as a whole, from before the first heavy import to its end."""

import signal
import sys


def main() -> int:
    """Run the command line of this process; a Ctrl-C at any moment is one line and exit code 130."""
    code: int | None = None
    while True:
        try:
            if code is None:
                from treadline.cli import main as run

                code = run()
            signal.signal(signal.SIGINT, signal.SIG_IGN)  # all is done: what comes now has nothing to interrupt
            return code  # noqa: TRY300 - an interrupt on the very way out is caught here too
        except KeyboardInterrupt:
            if code is None:
                sys.stderr.write("treadline: interrupted\n")
                code = 130


if __name__ == "__main__":
    sys.exit(main())
