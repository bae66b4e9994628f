"""Runs on a process pool: each job is data, each result is data, order does not depend on timing."""

import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from functools import partial
from multiprocessing import active_children, get_context
from types import TracebackType
from typing import Protocol, TypeVar, runtime_checkable

from treadline.processes import end_with_parent

R_co = TypeVar("R_co", covariant=True)
R = TypeVar("R")


@runtime_checkable
class Job(Protocol[R_co]):
    """Something a worker can do alone."""

    @property
    def name(self) -> str:
        """A word for the progress line."""

    def run(self) -> R_co:
        """Do it."""


class JobPool:
    """Workers that stay from one list of jobs to the next: to start one costs as much as to drive for ten seconds."""

    def __init__(self, workers: int, done: Callable[[str], None]) -> None:
        """Start nothing yet.

        Args:
            workers: Processes; one does the jobs in this process.
            done: Hears the name of each job as it ends, in a thread of the pool's.
        """
        self._done = done
        # Spawned, not forked: a fork would copy the threads' locks of BLAS and OpenCV in whatever state they are.
        spawn = get_context("spawn")
        self._workers = (
            ProcessPoolExecutor(max_workers=workers, mp_context=spawn, initializer=_begin_worker) if workers > 1 else None
        )

    def __enter__(self) -> "JobPool":
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        if self._workers is None:
            return
        self._workers.shutdown(wait=error is None, cancel_futures=error is not None)
        if error is not None:
            for worker in active_children():
                worker.terminate()

    def begin(self, jobs: Sequence[Job[R]]) -> Callable[[], list[R]]:
        """Queue jobs behind those already begun; the answer waits for them and returns their results in the jobs' order."""
        if self._workers is None:
            return lambda: list(self._in_this_process(jobs))
        futures = [self._workers.submit(_run, job) for job in jobs]
        for job, future in zip(jobs, futures, strict=True):
            future.add_done_callback(partial(self._tell, job.name))
        return lambda: _results(futures)

    def _in_this_process(self, jobs: Sequence[Job[R]]) -> Iterator[R]:
        for job in jobs:
            result = job.run()
            self._done(job.name)
            yield result

    def _tell(self, name: str, future: Future[R]) -> None:
        if not future.cancelled() and future.exception() is None:
            self._done(name)


def run_jobs(jobs: Sequence[Job[R]], *, workers: int, done: Callable[[str], None]) -> list[R]:
    """Return the jobs' results in the jobs' order; ``done`` hears each name as it ends."""
    with JobPool(min(workers, len(jobs)), done) as pool:
        return pool.begin(jobs)()


def _results(futures: list[Future[R]]) -> list[R]:
    for future in as_completed(futures):
        future.result()  # the first that fails ends it all
    return [future.result() for future in futures]


def _begin_worker() -> None:
    """Let Ctrl-C end a worker at once and without a traceback, and the parent's end too: the parent tells what happened."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    end_with_parent()


def _run(job: Job[R]) -> R:
    return job.run()
