"""Runs on a process pool: each job is data, each result is data, order does not depend on timing."""

import os
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import active_children, get_context
from typing import Protocol, TypeVar, runtime_checkable

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


def run_jobs(jobs: Sequence[Job[R]], *, workers: int, done: Callable[[str], None]) -> list[R]:
    """Return the jobs' results in the jobs' order; ``done`` hears each name as it ends."""
    if workers <= 1 or len(jobs) <= 1:
        return list(_in_this_process(jobs, done))
    # Spawned, not forked: a fork would copy the threads' locks of BLAS and OpenCV in whatever state they are.
    with ProcessPoolExecutor(max_workers=workers, mp_context=get_context("spawn"), initializer=_die_quietly) as pool:
        futures = {pool.submit(_run, job): job.name for job in jobs}
        try:
            for future in as_completed(futures):
                future.result()
                done(futures[future])
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            for worker in active_children():
                worker.terminate()
            raise
        return [future.result() for future in futures]


def default_workers() -> int:
    """Return the number of cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else (os.cpu_count() or 1)


def _die_quietly() -> None:
    """Let Ctrl-C end a worker at once and without a traceback: the parent tells what happened."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def _run(job: Job[R]) -> R:
    return job.run()


def _in_this_process(jobs: Sequence[Job[R]], done: Callable[[str], None]) -> Iterator[R]:
    for job in jobs:
        result = job.run()
        done(job.name)
        yield result
