"""Runs on processes of this machine. A process that dies is replaced, and its run is done again: once.

The standard library's pool gives up all its runs when one process dies and does not say whose fault it was; here each
process has its own pipe, so the run that killed it is known.
"""

import os
import signal
from collections import Counter, deque
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing import get_context, resource_tracker
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess
from types import TracebackType
from typing import Protocol, runtime_checkable

from treadline.campaign.run import Flight, Fly, Row, failed, run_one
from treadline.processes import end_with_parent

ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OPENCV_FOR_THREADS_NUM", "NUMBA_NUM_THREADS")
"""Read by libraries as they are loaded: the same sums in the same order, and no fight for cores."""
LIVES = 2
"""Processes that a run may cost before it is given up."""


@runtime_checkable
class Runners(Protocol):
    """Whatever flies: processes here, or a cluster."""

    def __enter__(self) -> "Runners":
        """Start."""

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        """End, at once and whatever is still in the air."""

    def results(self, flights: Iterable[Flight]) -> Iterator[Row]:
        """Yield a row for each flight, as each ends."""


@dataclass(frozen=True, slots=True, eq=False)
class _Worker:
    process: SpawnProcess
    pipe: Connection


class Pool:
    """So many processes, each with one run at a time."""

    def __init__(self, fly: Fly, workers: int) -> None:
        self._fly = fly
        self._count = workers
        self._workers: list[_Worker] = []
        self._air: dict[_Worker, Flight] = {}

    def __enter__(self) -> "Pool":
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        for worker in self._workers:
            worker.process.kill()
        while self._workers:
            self._bury(self._workers[0])

    def results(self, flights: Iterable[Flight]) -> Iterator[Row]:
        """Yield a row for each flight, as each ends."""
        waiting, deaths = deque(flights), Counter[int]()
        while waiting or self._air:
            self._hand_out(waiting)
            ready = wait([worker.pipe for worker in self._air])
            for worker in [worker for worker in self._air if worker.pipe in ready]:
                flight = self._air.pop(worker)
                try:
                    row: Row = worker.pipe.recv()
                except (EOFError, OSError):
                    # A pipe that ends without a row: its process is dead.
                    cause = self._bury(worker)
                    deaths[flight.index] += 1
                    if deaths[flight.index] < LIVES:
                        waiting.appendleft(flight)
                        continue
                    row = failed(flight, "crashed", f"its process {cause}, {LIVES} times")
                yield row

    def _hand_out(self, waiting: deque[Flight]) -> None:
        while waiting and len(self._air) < self._count:
            worker = next((worker for worker in self._workers if worker not in self._air), None) or self._hire()
            self._air[worker] = waiting.popleft()
            with suppress(OSError):  # it died idle: its pipe has ended, which is seen where results are waited for
                worker.pipe.send(self._air[worker])

    def _hire(self) -> _Worker:
        context = get_context("spawn")  # a fork would copy the locks of BLAS and OpenCV in whatever state they are
        pipe, theirs = context.Pipe()
        process = context.Process(target=_work, args=(self._fly, theirs), daemon=True)
        with not_for_children(signal.SIGINT), _environment(dict.fromkeys(ONE_THREAD, "1")):
            process.start()
        theirs.close()
        worker = _Worker(process, pipe)
        self._workers.append(worker)
        return worker

    def _bury(self, worker: _Worker) -> str:
        """Return how a process ended."""
        worker.process.join()
        worker.pipe.close()
        self._workers.remove(worker)
        self._air.pop(worker, None)
        code = worker.process.exitcode or 0
        return f"was killed by {signal.Signals(-code).name}" if code < 0 else f"ended with exit code {code}"


@contextmanager
def not_for_children(number: signal.Signals) -> Iterator[None]:
    """Keep a signal from the processes started meanwhile.

    Ctrl-C goes to all of a terminal's processes; the parent alone answers. What is blocked here stays so in a child.
    """
    resource_tracker.ensure_running()  # started with the first process, it would unblock Ctrl-C
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {number})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def _environment(wanted: Mapping[str, str]) -> Iterator[None]:
    """Set variables for the processes that are started meanwhile."""
    before = {name: os.environ.get(name) for name in wanted}
    os.environ.update(wanted)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def _work(fly: Fly, pipe: Connection) -> None:
    end_with_parent()
    while True:
        try:
            flight = pipe.recv()
        except EOFError:
            return
        pipe.send(run_one(fly, flight))
