"""Time that this process spends compiling kernels.

numba compiles a kernel at its first call on a machine and keeps the result on disk. Measured speeds exclude this time, and a
command that compiles for long says so.
"""

import time
from collections.abc import Callable
from functools import cache

from numba.core.event import Event, Listener, register

LONG_S = 1.0
"""CPU time of compiling that counts as long [s]; loading every kernel from disk compiles nothing."""


class CompileTimer(Listener):
    """Sum of the CPU time of compiling; kernels compiled on behalf of another kernel count once."""

    def __init__(self) -> None:
        self._spent_s = 0.0
        self._begun_s = 0.0
        self._depth = 0
        self._on_long: Callable[[], None] | None = None

    @property
    def spent_s(self) -> float:
        """CPU time of compiling so far [s]."""
        return self._spent_s

    def call_once_if_long(self, on_long: Callable[[], None]) -> None:
        """Call ``on_long`` once, when more than ``LONG_S`` was spent and another kernel is to be compiled."""
        self._on_long = on_long

    def on_start(self, event: Event) -> None:  # noqa: ARG002 - numba's signature
        """Start the clock at the outermost kernel."""
        self._depth += 1
        if self._depth > 1:
            return
        self._begun_s = time.process_time()
        if self._on_long is not None and self._spent_s > LONG_S:
            self._on_long()
            self._on_long = None

    def on_end(self, event: Event) -> None:  # noqa: ARG002 - numba's signature
        """Stop the clock at the outermost kernel."""
        self._depth -= 1
        if self._depth == 0:
            self._spent_s += time.process_time() - self._begun_s


@cache
def compiling() -> CompileTimer:
    """Return this process's timer, which counts from the first call of this function."""
    timer = CompileTimer()
    register("numba:compile", timer)
    return timer
