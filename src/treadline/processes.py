"""Worker processes: how many this machine should run, and how they end with the one that started them."""

import ctypes
import os
import signal
import sys
import threading
from collections.abc import Callable
from multiprocessing import parent_process
from typing import Any

PR_SET_PDEATHSIG = 1


def default_workers() -> int:
    """Return the number of cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else (os.cpu_count() or 1)


def end_with_parent() -> None:
    """Let this worker end as soon as its parent has: one that is killed outright cannot end its processes."""
    threading.Thread(target=_wait_and_end, daemon=True).start()


def killed_with_starter() -> Callable[[], None] | None:
    """Return what a new process must call before its program begins, to be killed with the thread that started it; on Linux."""
    if not sys.platform.startswith("linux"):
        return None
    prctl = ctypes.CDLL(None).prctl
    return lambda: prctl(PR_SET_PDEATHSIG, signal.SIGKILL)


def _wait_and_end() -> None:
    parent: Any = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
