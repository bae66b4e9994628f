"""``python -m treadline`` and the ``treadline`` command: interrupt handling of the whole process, including heavy imports."""

import gc
import signal
import sys

from treadline.core import processes


def main() -> int:
    """Run the command line of this process; Ctrl-C at any time gives one line and exit code 130."""
    processes.install_interrupts()
    gc.set_threshold(50_000, 20, 20)  # what modules create lives to the end: collecting it takes a tenth of the start
    try:
        from treadline.cli import main as run

        code = run()
    except KeyboardInterrupt:
        sys.stderr.write("treadline: interrupted\n")
        code = 130
    # An interrupt inside source text executed by a library (the methods of a dataclass) sets a flag in the interpreter, which would
    # end the process by the signal even after the exception is handled. Executing another source text clears the flag.
    eval("0")  # noqa: S307
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # all work is finished; a late Ctrl-C must not change the exit code
    return code


if __name__ == "__main__":
    sys.exit(main())
