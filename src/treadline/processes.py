"""Worker processes: how many this machine should run, and how they end with the one that started them."""

import os
import threading
from multiprocessing import parent_process
from typing import Any


def default_workers() -> int:
    """Return the number of cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else (os.cpu_count() or 1)


def end_with_parent() -> None:
    """Let this worker end as soon as its parent has: one that is killed outright cannot end its processes."""
    threading.Thread(target=_wait_and_end, daemon=True).start()


def _wait_and_end() -> None:
    parent: Any = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
