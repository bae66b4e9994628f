"""Jobs on a process pool: jobs and results are plain data, and the order of results does not depend on timing.

A ``RunJob`` is one recorded run: settings in, summary out, everything else in its run folder.
"""

import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from multiprocessing import active_children, get_context
from pathlib import Path
from types import TracebackType
from typing import Any, Protocol, TypeVar, runtime_checkable

from treadline.core.models import ControllerDesign
from treadline.core.processes import end_with_parent
from treadline.run.recorded_run import recorded_run
from treadline.run.resolve import Opener, PlantName, resolve
from treadline.scenario.scenario import Scenario

R_co = TypeVar("R_co", covariant=True)
R = TypeVar("R")
Item = TypeVar("Item")
OnText = Callable[[str], None]


@runtime_checkable
class Job(Protocol[R_co]):
    """Unit of work that one worker process runs independently."""

    @property
    def title(self) -> str:
        """Text of the job in the progress line."""

    def run(self) -> R_co:
        """Run the job and return its result."""


@dataclass(frozen=True, slots=True, eq=False)
class Call:
    """Call of a module-level function as a job."""

    title: str
    function: Callable[..., Any]
    arguments: tuple[Any, ...]

    def run(self) -> Any:
        """Return the function's result."""
        return self.function(*self.arguments)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RunJob:
    """A scenario, a seed and a controller; ``labels`` are returned unchanged with the result."""

    name: str
    """Name of the run folder."""
    title: str
    scenario: Scenario
    seed: int
    controller: ControllerDesign | None
    """Controller design; None for the one shipped for the vehicle."""
    runs: Path
    """Folder of the run folders."""
    labels: dict[str, Any]
    image_every: int = 0
    """Keep every n-th frame in the log; 0 keeps none."""
    open_plant: Opener | PlantName = "mujoco"
    """Simulator: its name, or a module-level function, because the job may run in another process."""

    def run(self) -> dict[str, Any]:
        """Run the scenario and return the labels with the run's summary."""
        setup = resolve(self.scenario, self.controller, self.seed, open_plant=self.open_plant)
        run = recorded_run(self.runs / self.name, setup, image_every=self.image_every)
        return {**self.labels, **run.summary(), "cpu_s": run.cpu_s, "run": self.name}


class JobPool:
    """Process pool reused between lists of jobs: starting a worker costs as much as ten simulated seconds."""

    def __init__(self, workers: int, done: OnText, running: OnText | None = None) -> None:
        """Create the pool; worker processes start with the first job.

        Args:
            workers: Number of processes; with one, jobs run in this process.
            done: Called with the title of each finished job, in a thread of the pool.
            running: Called with the titles of the jobs that run, whenever they change.
        """
        self._done, self._running = done, running
        self._open: dict[Future[Any], str] = {}
        self._count = workers
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
        """Queue jobs; return a function that waits for the jobs and returns their results in order."""
        if self._workers is None:
            return lambda: list(self._in_this_process(jobs))
        futures = [self._workers.submit(job.run) for job in jobs]
        self._open |= {future: job.title for future, job in zip(futures, jobs, strict=True)}
        self._report_running()
        for future in futures:
            future.add_done_callback(self._report)
        return lambda: _results(futures)

    def map(self, title: str, function: Callable[[Item], R], items: Sequence[Item]) -> list[R]:
        """Return a module-level function's results for all items, in order."""
        return self.begin([Call(title, function, (item,)) for item in items])()

    def _in_this_process(self, jobs: Sequence[Job[R]]) -> Iterator[R]:
        for job in jobs:
            if self._running is not None:
                self._running(job.title)
            result = job.run()
            self._done(job.title)
            yield result

    def _report(self, future: Future[R]) -> None:
        title = self._open.pop(future)
        if not future.cancelled() and future.exception() is None:
            self._done(title)
        self._report_running()

    def _report_running(self) -> None:
        """Report the oldest jobs that are not finished, one per worker: jobs start in their order."""
        titles = list(self._open.values())[: self._count]
        if self._running is not None and titles:
            self._running("; ".join(titles))


def _results(futures: list[Future[R]]) -> list[R]:
    for future in as_completed(futures):
        future.result()  # the first failure ends all jobs
    return [future.result() for future in futures]


def _begin_worker() -> None:
    """Let Ctrl-C and the end of the parent process end a worker at once, without a traceback: the parent reports the interrupt."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    end_with_parent()
