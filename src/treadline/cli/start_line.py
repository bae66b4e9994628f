"""First line of a long command: written to stderr within two seconds of its start."""

import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

AFTER_S = 1.5
"""Time after which the line is written [s]: two seconds, less the start of Python and of the command line (0.3 s)."""


@contextmanager
def start_line(tokens: Sequence[str], after_s: float = AFTER_S) -> Iterator[None]:
    """Write that a command runs, unless the command ends before ``after_s``.

    Progress begins later, after the import of libraries and the compilation of kernels.
    """
    name = next((token for token in tokens if not token.startswith("-")), "")
    timer = threading.Timer(after_s, _write, [f"treadline {name}".strip() + f": {_activity(tokens)}; Ctrl-C stops it\n"])
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


def _activity(tokens: Sequence[str]) -> str:
    """Return what the command does: a command with ``--export FILE`` writes a file and ends."""
    words = [word for item in tokens for word in (item.split("=", 1) if item.startswith("--export=") else [item])]
    if "--export" not in words[:-1]:
        return "running"
    return f"writing {words[words.index('--export') + 1]}"


def _write(line: str) -> None:
    if sys.stderr is not None:
        sys.stderr.write(line)
        sys.stderr.flush()
