"""Execution of runs on a cluster of Dask workers (extra ``cluster``); ``local`` starts a cluster on this machine.

Anyone with access to a Dask scheduler can execute code on its workers: use addresses in trusted networks only.
"""

import asyncio
import logging
import signal
import time
from collections.abc import Generator, Iterable, Iterator
from concurrent.futures import CancelledError
from contextlib import ExitStack
from itertools import islice
from typing import Any

from treadline.campaign._pool import BLOCK, LIVES, ONE_THREAD, Episode, EpisodeRunner, Row, failed, not_for_children, run_one
from treadline.core.errors import SettingsError
from treadline.io.runs import versions

LOCAL = "local"
ANSWERS_WITHIN_S = 10.0
POLL_S = 0.1
STALLED_S = 60.0
"""Time with waiting runs but no busy worker after which the workers are restarted [s]; a killed worker is back sooner."""
SETTINGS = {
    "distributed.comm.timeouts.connect": f"{ANSWERS_WITHIN_S} s",
    "distributed.scheduler.allowed-failures": LIVES - 1,
    "distributed.scheduler.worker-saturation": 1.0,  # a queued run on a worker would be blamed if the worker dies
    "distributed.nanny.pre-spawn-environ": dict.fromkeys(ONE_THREAD, 1),
}
"""Dask settings of a local cluster; only the connection timeout applies to other clusters."""


class Cluster:
    """Dask client that executes the runs of a campaign."""

    def __init__(self, run_episode: EpisodeRunner, address: str, workers: int) -> None:
        self._run_episode = run_episode
        self._address = address
        self._workers = workers
        self._client: Any = None
        self._open = ExitStack()
        """Client and local cluster, which are closed in this order."""

    def __enter__(self) -> "Cluster":
        try:
            import dask
            import distributed  # noqa: F401 - imported early for a clear error
        except ImportError:
            remedy = "pip install '.[cluster]' in treadline's folder, or leave it out for a pool here"
            raise SettingsError(f"--cluster needs Dask: {remedy}") from None
        dask.config.set(SETTINGS)
        if self._address != LOCAL:
            _check_scheduler(self._address)
        self._connect()
        return self

    def _connect(self) -> None:
        from distributed import Client, LocalCluster

        for name in ("distributed", "tornado.application"):
            logging.getLogger(name).setLevel(logging.CRITICAL)  # relevant events appear in our errors and rows
        with ExitStack() as stack:
            scheduler: Any = self._address
            if self._address == LOCAL:
                # Another sweep may use Dask's default port of the dashboard.
                options = {"dashboard_address": None, "scheduler_kwargs": {"dashboard_address": "127.0.0.1:0"}}
                with not_for_children(signal.SIGINT):
                    scheduler = LocalCluster(n_workers=self._workers, threads_per_worker=1, host="127.0.0.1", **options)
                stack.callback(scheduler.close)
            self._client = Client(scheduler, timeout=ANSWERS_WITHIN_S, set_as_default=False)
            stack.callback(self._client.close)
            self._check_versions()
            self._open = stack.pop_all()

    def _check_versions(self) -> None:
        """Check that every worker has the same versions, because results depend on them."""
        try:
            self._client.wait_for_workers(1, timeout=ANSWERS_WITHIN_S)
        except TimeoutError:
            raise SettingsError(
                f"--cluster {self._address}: no worker has joined it; start some: dask worker {self._address} --nthreads 1"
            ) from None
        here = versions()
        try:
            found = {"the scheduler": self._client.run_on_scheduler(versions), **self._client.run(versions)}
        except ImportError as error:
            raise SettingsError(
                f"--cluster {self._address}: cannot run there: {error}; install treadline on all machines"
            ) from None
        for worker, there in found.items():
            other = sorted(name for name in here if there.get(name) != here[name])
            if other:
                raise SettingsError(
                    f"--cluster {self._address}: {worker} has {other[0]} {there.get(other[0])}, here is "
                    f"{here[other[0]]}; install the same versions there, or the results differ"
                )

    def __exit__(self, *_: object) -> None:
        self._open.close()

    def results(self, episodes: Iterable[Episode]) -> Iterator[Row]:
        """Yield the row of each episode as it ends; at most ``BLOCK`` episodes have been drawn and have not ended."""
        waiting, suspects = iter(episodes), list[Episode]()
        yield from self._run_all(waiting, suspects)
        while suspects:
            # All runs on a dead worker are suspects. Executed alone, a run can only kill its own worker.
            for suspect in suspects:
                blamed: list[Episode] = []
                yield from self._run_all(iter([suspect]), blamed)
                for episode in blamed:
                    yield failed(episode, "crashed", f"its process died, {LIVES} times")
            suspects.clear()
            yield from self._run_all(waiting, suspects)

    def _run_all(self, waiting: Iterator[Episode], suspects: list[Episode]) -> Iterator[Row]:
        """Yield rows; runs whose workers died become suspects, as do all submitted runs if no worker makes progress."""
        left: dict[int, Episode] = {}
        stalls = 0
        while stalls < LIVES:
            has_progress = yield from self._run_until_stalled(left, waiting, suspects)
            if not left:
                return
            stalls = 0 if has_progress else stalls + 1
            self._restart_workers()
        suspects += left.values()

    def _run_until_stalled(
        self, left: dict[int, Episode], waiting: Iterator[Episode], suspects: list[Episode]
    ) -> Generator[Row, None, bool]:
        """Submit ``left``, and waiting episodes in place of those that end; return whether any ended.

        End when none is left or ``suspects`` are too many, or when no worker has been busy for too long.
        """
        from distributed import KilledWorker, as_completed

        futures: dict[Any, int] = {}
        finished = as_completed(loop=self._client.loop)

        def submit(episodes: Iterable[Episode]) -> None:
            for episode in episodes:
                future = self._client.submit(run_one, self._run_episode, episode, pure=False)
                left[episode.index], futures[future] = episode, episode.index
                finished.add(future)

        submit(list(left.values()))
        has_progress, busy_s = False, time.monotonic()
        while time.monotonic() - busy_s < STALLED_S:
            submit(islice(waiting, max(BLOCK - len(left) - len(suspects), 0)))
            if not futures:
                break
            batch = finished.next_batch(block=False)
            for future in batch:
                has_progress = True
                episode = left.pop(futures.pop(future))
                try:
                    yield future.result()
                except KilledWorker:
                    suspects.append(episode)
                except CancelledError:
                    raise SettingsError(
                        f"--cluster {self._address}: its scheduler is gone; start it, and go on with --resume"
                    ) from None
                future.release()
            if not batch:
                time.sleep(POLL_S)
            if batch or any(self._client.processing().values()):
                busy_s = time.monotonic()
        self._client.cancel(list(futures), force=True)
        return has_progress

    def _restart_workers(self) -> None:
        """Restart the workers: a nanny gives up on a worker that dies at start, without a replacement."""
        if self._address == LOCAL:
            self._open.close()
            self._connect()
        else:
            self._check_versions()


def _check_scheduler(address: str) -> None:
    """Check that a scheduler answers at the address; a client without a scheduler is noisy and slow to give up."""
    from distributed.comm import connect

    async def ask() -> object:
        comm = await connect(address, timeout=ANSWERS_WITHIN_S)
        try:
            await comm.write({"op": "identity", "reply": True})
            return await comm.read()
        finally:
            comm.abort()

    try:
        answer = asyncio.run(asyncio.wait_for(ask(), ANSWERS_WITHIN_S))
    except (OSError, ValueError, MemoryError, TimeoutError) as error:
        # MemoryError: the reply of another service, read as a length.
        raise SettingsError(
            f"--cluster {address}: no Dask scheduler answers within {ANSWERS_WITHIN_S:.0f} s ({type(error).__name__}); "
            "start one with dask scheduler, or give --cluster local"
        ) from None
    if not isinstance(answer, dict) or answer.get("type") != "Scheduler":
        raise SettingsError(f"--cluster {address}: the service there is not a Dask scheduler; give a scheduler's address")
