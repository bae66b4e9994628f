"""How long this process has compiled kernels: numba does so at their first call on a machine, and keeps what it made.

Who tells how fast something is leaves that time out; who waits for it is told why.
"""

import time
from collections.abc import Callable
from functools import cache

from numba.core.event import Event, Listener, register

NOTICED_S = 1.0
"""CPU time of compiling from which on it is told: where all is kept from before, there is next to none."""


class Compiling(Listener):
    """Adds up the CPU time of compiling; what is compiled for something that is being compiled counts once."""

    def __init__(self) -> None:
        self._spent_s = 0.0
        self._begun_s = 0.0
        self._depth = 0
        self._tell: Callable[[], None] | None = None

    @property
    def spent_s(self) -> float:
        """CPU seconds so far."""
        return self._spent_s

    def tell_once(self, tell: Callable[[], None]) -> None:
        """Have somebody told once compiling takes long."""
        self._tell = tell

    def on_start(self, event: Event) -> None:  # noqa: ARG002 - numba's signature
        """Note that something begins to be compiled."""
        self._depth += 1
        if self._depth > 1:
            return
        self._begun_s = time.process_time()
        if self._tell is not None and self._spent_s > NOTICED_S:
            self._tell()
            self._tell = None

    def on_end(self, event: Event) -> None:  # noqa: ARG002 - the same
        """Note that it is done."""
        self._depth -= 1
        if self._depth == 0:
            self._spent_s += time.process_time() - self._begun_s


@cache
def compiling() -> Compiling:
    """Return the one that listens in this process, from its first call on."""
    listener = Compiling()
    register("numba:compile", listener)
    return listener
