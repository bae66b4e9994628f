"""``python -m treadline`` is ``treadline``: the process as a whole, from before the first heavy import to its end."""

import signal
import sys


def main() -> int:
    """Run the command line of this process; a Ctrl-C at any moment is one line and exit code 130."""
    try:
        from treadline.cli import main as run

        code = run()
    except KeyboardInterrupt:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        sys.stderr.write("treadline: interrupted\n")
        return 130
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # all is done: what comes now has nothing to interrupt
    return code


if __name__ == "__main__":
    sys.exit(main())
