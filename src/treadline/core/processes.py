"""Worker processes: their default number, and their termination together with the parent process."""

import ctypes
import os
import signal
import sys
import threading
from collections.abc import Callable
from multiprocessing import parent_process
from typing import Any

PR_SET_PDEATHSIG = 1
"""Option number of Linux ``prctl``: signal to the child at the death of its parent."""


def default_workers() -> int:
    """Return the number of cores available to this process."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else (os.cpu_count() or 1)


def end_with_parent() -> None:
    """End this worker as soon as its parent ends; a parent killed outright cannot end its workers."""
    threading.Thread(target=_wait_and_end, daemon=True).start()


def killed_with_starter() -> Callable[[], None] | None:
    """Return a ``preexec_fn`` for a new process: SIGKILL at the end of the thread that started it; Linux only."""
    if not sys.platform.startswith("linux"):
        return None
    prctl = ctypes.CDLL(None).prctl
    return lambda: prctl(PR_SET_PDEATHSIG, signal.SIGKILL)


def _wait_and_end() -> None:
    parent: Any = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
