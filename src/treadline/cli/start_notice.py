"""Notice of a long command: one line on stderr within two seconds of its start."""

import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

AFTER_S = 1.5
"""Time after which the notice is written [s]: two seconds, less the start of Python and of the command line (0.3 s)."""


@contextmanager
def start_notice(tokens: Sequence[str], after_s: float = AFTER_S) -> Iterator[None]:
    """Write that a command runs, unless the command ends before.

    Progress may begin much later: libraries load and kernels compile first.
    """
    name = next((token for token in tokens if not token.startswith("-")), "")
    notice = threading.Timer(after_s, _write, [f"treadline {name}".strip() + ": running; Ctrl-C stops it\n"])
    notice.daemon = True
    notice.start()
    try:
        yield
    finally:
        notice.cancel()


def _write(line: str) -> None:
    if sys.stderr is not None:
        sys.stderr.write(line)
        sys.stderr.flush()
