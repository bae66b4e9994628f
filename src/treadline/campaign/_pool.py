"""Execution of runs: a scenario and a seed in, a row of results out, on processes of this machine.

A run that fails gives a row with its cause. A process that dies is replaced and its run repeated once.
The standard library's pool abandons all runs when one process dies and does not report the run; here each process has its
own pipe, so the run that killed it is known.
"""

import os
import signal
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing import get_context, resource_tracker
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess
from pathlib import Path
from traceback import extract_tb
from typing import Any

from treadline.core.errors import SimulationDiverged
from treadline.core.printing import plain
from treadline.core.processes import end_with_parent
from treadline.scenario.scenario import Scenario

EpisodeRunner = Callable[[Scenario, int, float], Mapping[str, Any]]
"""Function that runs a scenario with a seed, observes a held chair for some seconds, and returns verdict and scores.

The function must be importable by name, because worker processes import it.
"""
Row = dict[str, Any]
"""Results of a run as JSON values: ``index``, ``seed``, ``verdict``, ``cause``, drawn values, scores."""

VIEW = "view"
"""Key of the pose from which the page draws a run; no column of the tables."""
TIMES = ("cpu_s", "real_time_factor")
"""Columns that vary between repetitions of a run and are stored separately from the results."""
ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OPENCV_FOR_THREADS_NUM", "NUMBA_NUM_THREADS")
"""Environment variables that limit numerical libraries to one thread: reproducible sums, no competition for cores."""
BLOCK = 4096
"""Number of runs that are in memory at a time: submitted to a cluster, in a row group of a table, or drawn on the page.

4096 runs of 3 s keep a thousand cores busy for 12 s, and their rows of 6 kB take 25 MB. A power of two balances Sobol points.
"""
LIVES = 2
"""Number of processes a run may kill before it is given up."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Episode:
    """One run to be executed."""

    index: int
    seed: int
    scenario: Scenario
    values: dict[str, Any]
    """Drawn values by key."""

    @property
    def watched_s(self) -> float:
        """Time for which a held chair is observed [s], because the outcome of a hold is part of the verdict.

        Every tenth run is observed for a minute, for pass rule H.
        """
        return 60.0 if self.index % 10 == 0 else 3.0


def run_one(run_episode: EpisodeRunner, episode: Episode) -> Row:
    """Return the row of a run; an unexpected error gives a row with the error as cause.

    One failing run must not end a campaign of a thousand, so every exception is caught here and nowhere else.
    """
    started = time.process_time()
    try:
        result = dict(run_episode(episode.scenario, episode.seed, episode.watched_s))
    except SimulationDiverged as error:
        result = {"verdict": "diverged", "cause": str(error)}
    except Exception as error:  # noqa: BLE001 - see above
        where = extract_tb(error.__traceback__)[-1]
        place = f"{Path(where.filename).name}:{where.lineno}"
        result = {"verdict": "error", "cause": f"{type(error).__name__}: {error} ({place})"}
    result["cpu_s"] = time.process_time() - started
    return failed(episode, "error", "no verdict") | plain(result) | {"seed": episode.seed}


def failed(episode: Episode, verdict: str, cause: str) -> Row:
    """Return the row of a run without scores."""
    values: Row = plain(episode.values)
    return {"index": episode.index, "seed": episode.seed, "verdict": verdict, "cause": cause, **values}


class Pool:
    """Fixed number of processes, each with one run at a time."""

    def __init__(self, run_episode: EpisodeRunner, workers: int) -> None:
        self._run_episode = run_episode
        self._count = workers
        self._workers: dict[Connection, SpawnProcess] = {}
        self._running: dict[Connection, Episode] = {}

    def __enter__(self) -> "Pool":
        return self

    def __exit__(self, *_: object) -> None:
        for process in self._workers.values():
            process.kill()
        for pipe in list(self._workers):
            self._reap(pipe)

    def results(self, episodes: Iterable[Episode]) -> Iterator[Row]:
        """Yield the row of each episode as it ends; an episode is drawn when a process is free for it."""
        waiting, again, deaths = iter(episodes), list[Episode](), Counter[int]()
        while self._dispatch(waiting, again):
            ready = wait(self._running)
            for pipe in [pipe for pipe in self._running if pipe in ready]:
                episode = self._running.pop(pipe)
                try:
                    row: Row = pipe.recv()
                except (EOFError, OSError):
                    # End of file without a row: the process is dead.
                    cause = self._reap(pipe)
                    deaths[episode.index] += 1
                    if deaths[episode.index] < LIVES:
                        again.append(episode)
                        continue
                    row = failed(episode, "crashed", f"its process {cause}, {LIVES} times")
                del deaths[episode.index]
                yield row

    def _dispatch(self, waiting: Iterator[Episode], again: list[Episode]) -> bool:
        """Give each free process an episode, as far as there are any; return whether one runs."""
        while len(self._running) < self._count:
            episode = again.pop() if again else next(waiting, None)
            if episode is None:
                break
            pipe = next((pipe for pipe in self._workers if pipe not in self._running), None) or self._start()
            self._running[pipe] = episode
            with suppress(OSError):  # the process died idle; the closed pipe is handled where results are received
                pipe.send(episode)
        return bool(self._running)

    def _start(self) -> Connection:
        context = get_context("spawn")  # a fork would copy the locks of BLAS and OpenCV in an undefined state
        pipe, theirs = context.Pipe()
        process = context.Process(target=_work, args=(self._run_episode, theirs), daemon=True)
        with not_for_children(signal.SIGINT), _one_thread():
            process.start()
        theirs.close()
        self._workers[pipe] = process
        return pipe

    def _reap(self, pipe: Connection) -> str:
        """Remove a process; return how it ended."""
        process = self._workers.pop(pipe)
        process.join()
        pipe.close()
        self._running.pop(pipe, None)
        code = process.exitcode or 0
        return f"was killed by {signal.Signals(-code).name}" if code < 0 else f"ended with exit code {code}"


@contextmanager
def not_for_children(number: signal.Signals) -> Iterator[None]:
    """Block a signal in processes started within the context.

    Ctrl-C is sent to all processes of a terminal; only the parent handles it. A blocked signal stays blocked in a child.
    """
    resource_tracker.ensure_running()  # started with the first process, it would unblock Ctrl-C
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {number})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def _one_thread() -> Iterator[None]:
    """Limit numerical libraries to one thread in processes started within the context."""
    before = os.environ.copy()
    os.environ.update(dict.fromkeys(ONE_THREAD, "1"))
    try:
        yield
    finally:
        os.environ.clear()
        os.environ.update(before)


def _work(run_episode: EpisodeRunner, pipe: Connection) -> None:
    end_with_parent()
    while True:
        try:
            episode = pipe.recv()
        except EOFError:
            return
        pipe.send(run_one(run_episode, episode))
