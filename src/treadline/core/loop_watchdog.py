"""Watchdog of a loop, by the monotonic clock: a loop that stands still is a fault, whatever holds it up.

The loop reports each step before it begins. A thread brakes the plant out of band while the step does not return; the loop itself
learns of its standstill at the next step, before it commands anything.
"""

import logging
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Condition, Thread


class LoopWatchdog:
    """Watch over a loop while its ``with`` block runs; outside of it ``begin`` does nothing.

    Args:
        latch: Receives the cause, in the loop's own thread, at the first step after a standstill.
        brake: Brakes the plant; called in another thread during a standstill. One that fails is logged, and called
            again in the next one.
        limit_s: Longest time that a step may take [s].
    """

    def __init__(self, latch: Callable[[str], object], brake: Callable[[], object] | None = None, *, limit_s: float) -> None:
        self._latch, self._brake, self._limit_s = latch, brake, limit_s
        self._change = Condition()
        self._step = "its start"
        self._since_s: float | None = None
        self._is_running = self._is_braked = False
        self._thread = Thread(target=self._watch, name="loop watchdog", daemon=True)

    def __enter__(self) -> "LoopWatchdog":
        """Begin to watch, once the kernels of the run are compiled."""
        self._is_running, self._since_s = True, time.monotonic()
        if self._brake is not None:
            self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Stop watching; a brake that is being applied is waited for, but not for longer than a standstill."""
        with self._change:
            self._is_running = False
            self._change.notify()
        if self._thread.is_alive():
            self._thread.join(self._limit_s)

    def begin(self, step: str) -> None:
        """Report the step that the loop is about to begin; latch if the step before took too long."""
        if not self._is_running:
            return
        now_s = time.monotonic()
        with self._change:
            before, since_s, stood = self._step, self._since_s, self._is_braked
            self._step, self._since_s, self._is_braked = step, now_s, False
        if since_s is not None and (stood or now_s - since_s > self._limit_s):
            self._latch(f"the loop stood still for {now_s - since_s:.1f} s in {before}")

    @contextmanager
    def paused(self) -> Iterator[None]:
        """Announce a pause, by the viewer for one: its time does not count."""
        self.begin("a pause")
        with self._change:
            self._since_s = None
        try:
            yield
        finally:
            with self._change:
                self._since_s = time.monotonic()

    def _watch(self) -> None:
        """Brake once in each standstill."""
        while self._brake is not None and self._stands():
            try:
                self._brake()
            except Exception:
                logging.getLogger(__name__).exception("the plant's brake failed")

    def _stands(self) -> bool:
        """Wait for a standstill; return False at the end of the run."""
        with self._change:
            while self._is_running:
                left_s = self._limit_s
                if self._since_s is not None and not self._is_braked:
                    left_s += self._since_s - time.monotonic()
                if left_s <= 0.0:
                    self._is_braked = True
                    return True
                self._change.wait(left_s)
        return False
