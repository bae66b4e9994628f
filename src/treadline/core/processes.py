"""Processes: Ctrl-C and requests to end as exceptions, number of workers, end with the parent process, real-time scheduling.

An interrupt (SIGINT, SIGTERM) is never raised in the middle of a file record.
"""

import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from types import FrameType, TracebackType

BURST_S = 0.2
"""Shortest interval between two interrupts [s]: further signals within it belong to the same key press or burst."""
GUARD, LOOP = 2, 1
"""Priorities: the least two of the system's, so that both run before every process without one, and the guard before the loop."""
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
    import ctypes

    prctl = ctypes.CDLL(None).prctl
    return lambda: prctl(PR_SET_PDEATHSIG, signal.SIGKILL)


def _wait_and_end() -> None:
    from multiprocessing import parent_process

    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


class Terminated(KeyboardInterrupt):
    """Request to end (SIGTERM): handled as Ctrl-C, with an exit code of its own."""


def interrupt(error: KeyboardInterrupt) -> None:
    """Raise an interrupt in the main thread, now or at the end of the running ``deferred`` block."""
    if _BLOCK.depth:
        _BLOCK.pending = _BLOCK.pending or error
        return
    raise error


class _Block:
    """Block of the main thread in which interrupts wait: nesting depth, and an interrupt received in it."""

    depth = 0
    pending: KeyboardInterrupt | None = None

    def __enter__(self) -> None:
        self.depth += 1

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.depth -= 1
        if not self.depth and (pending := self.pending) is not None:
            self.pending = None
            raise pending


_BLOCK, _NO_BLOCK, _MAIN_THREAD = _Block(), nullcontext(), threading.main_thread().ident


def deferred() -> AbstractContextManager[None]:
    """Return a context that postpones interrupts to its end.

    An exception between the two halves of a file record would leave a file that nobody can read. Blocks may nest. Signal handlers
    run in the main thread only, so other threads need no protection.
    """
    return _BLOCK if threading.get_ident() == _MAIN_THREAD else _NO_BLOCK


class Interrupts:
    """SIGINT handler that raises one ``KeyboardInterrupt`` for a burst of Ctrl-C."""

    def __init__(self) -> None:
        self._last_s = -BURST_S

    def __call__(self, number: int, frame: FrameType | None) -> None:
        """Handle one signal."""
        del number, frame
        before_s, self._last_s = self._last_s, time.monotonic()
        if self._last_s - before_s >= BURST_S:
            interrupt(KeyboardInterrupt())


def on_terminate(number: int, frame: FrameType | None) -> None:
    """Handle SIGTERM: raise ``Terminated``."""
    del number, frame
    interrupt(Terminated())


def install_interrupts() -> None:
    """Install the SIGINT handler of this process, unless the signal is ignored (by the starting shell)."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, Interrupts())


@contextmanager
def real_time(priority: int) -> Iterator[str]:
    """Run with real-time scheduling; yield what was granted, as words for the log."""
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except (OSError, AttributeError) as error:
        reason = getattr(error, "strerror", None) or "not of this system"
        yield f"no real-time scheduling ({reason}): allow it by 'rtprio {GUARD}' in /etc/security/limits.conf, or CAP_SYS_NICE"
        return
    try:
        yield f"real-time scheduling, SCHED_FIFO {priority}"
    finally:
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
