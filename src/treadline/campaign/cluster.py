"""Runs on a cluster of Dask workers (the extra ``cluster``); ``local`` starts one on this machine.

Whoever reaches a Dask scheduler may run code on its workers: addresses are for networks one trusts.
"""

import asyncio
import logging
import signal
import time
from collections.abc import Iterable, Iterator
from concurrent.futures import CancelledError
from types import TracebackType
from typing import Any

from treadline.campaign.pool import LIVES, ONE_THREAD, not_for_children
from treadline.campaign.run import Flight, Fly, Row, failed, run_one
from treadline.errors import SettingsError
from treadline.io.provenance import versions

LOCAL = "local"
ANSWERS_WITHIN_S = 10.0
POLL_S = 0.1
STALLED_S = 60.0
"""While runs are waiting and no worker has one: whoever was killed is back by then, or nobody brings it back."""
SETTINGS = {
    "distributed.comm.timeouts.connect": f"{ANSWERS_WITHIN_S} s",
    "distributed.scheduler.allowed-failures": LIVES - 1,
    "distributed.scheduler.worker-saturation": 1.0,  # a run that waits at a worker would be blamed for its death
    "distributed.nanny.pre-spawn-environ": dict.fromkeys(ONE_THREAD, 1),
}
"""Of a cluster that is started here; another has its own, but for the first."""


class Cluster:
    """A Dask client that flies."""

    def __init__(self, fly: Fly, address: str, workers: int) -> None:
        self._fly = fly
        self._address = address
        self._workers = workers
        self._client: Any = None
        self._cluster: Any = None

    def __enter__(self) -> "Cluster":
        try:
            import dask
            import distributed  # noqa: F401 - asked for early, for the error's sake
        except ImportError:
            remedy = "pip install '.[cluster]' in treadline's folder, or leave it out for a pool here"
            raise SettingsError(f"--cluster needs Dask: {remedy}") from None
        dask.config.set(SETTINGS)
        if self._address != LOCAL:
            _must_answer(self._address)
        self._open()
        return self

    def _open(self) -> None:
        from distributed import Client, LocalCluster

        for name in ("distributed", "tornado.application"):
            logging.getLogger(name).setLevel(logging.CRITICAL)  # what matters is said by our errors and rows
        try:
            if self._address == LOCAL:
                with not_for_children(signal.SIGINT):
                    self._cluster = LocalCluster(
                        n_workers=self._workers, threads_per_worker=1, processes=True, host="127.0.0.1", dashboard_address=None
                    )
            self._client = Client(self._cluster or self._address, timeout=ANSWERS_WITHIN_S, set_as_default=False)
            self._must_fly_as_here()
        except BaseException:
            self._close()
            raise

    def _must_fly_as_here(self) -> None:
        """Other versions of what a run depends on are other results."""
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
                f"--cluster {self._address}: cannot fly there: {error}; install treadline on all machines"
            ) from None
        for worker, there in found.items():
            other = sorted(name for name in here if there.get(name) != here[name])
            if other:
                raise SettingsError(
                    f"--cluster {self._address}: {worker} has {other[0]} {there.get(other[0])}, here is "
                    f"{here[other[0]]}; install the same versions there, or the results differ"
                )

    def _close(self) -> None:
        for part in (self._client, self._cluster):
            if part is not None:
                part.close()
        self._client = self._cluster = None

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._close()

    def results(self, flights: Iterable[Flight]) -> Iterator[Row]:
        """Yield a row for each flight, as each ends."""
        suspects: list[Flight] = []
        yield from self._fly_all(list(flights), suspects)
        # A worker's death is blamed on all it held. Alone, a run can only kill its own.
        for suspect in suspects:
            blamed: list[Flight] = []
            yield from self._fly_all([suspect], blamed)
            for flight in blamed:
                yield failed(flight, "crashed", f"its process died, {LIVES} times")

    def _fly_all(self, flights: list[Flight], suspects: list[Flight]) -> Iterator[Row]:
        """Yield rows; flights whose workers died become suspects, and so do all that are left where nobody flies any more."""
        left = {flight.index: flight for flight in flights}
        stalls = 0
        while left and stalls < LIVES:
            before = len(left)
            yield from self._fly_until_stalled(left, suspects)
            stalls = stalls + 1 if len(left) == before else 0
            if left:
                self._hire_again()
        suspects += left.values()

    def _fly_until_stalled(self, left: dict[int, Flight], suspects: list[Flight]) -> Iterator[Row]:
        """Take what has flown out of ``left``; end when all has, or when no worker has had any of it for too long."""
        from distributed import KilledWorker, as_completed

        futures = {self._client.submit(run_one, self._fly, flight, pure=False): index for index, flight in left.items()}
        finished = as_completed(list(futures), loop=self._client.loop)
        busy_s = time.monotonic()
        while futures and time.monotonic() - busy_s < STALLED_S:
            batch = finished.next_batch(block=False)
            for future in batch:
                flight = left.pop(futures.pop(future))
                try:
                    yield future.result()
                except KilledWorker:
                    suspects.append(flight)
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

    def _hire_again(self) -> None:
        """Bring workers back: a nanny gives up one that dies as it starts, and no other is sent for."""
        if self._address == LOCAL:
            self._close()
            self._open()
        else:
            self._must_fly_as_here()


def _must_answer(address: str) -> None:
    """A client that never connects is noisy and slow to give up; so ask first who is there."""
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
        # MemoryError: another service's words, read as a length.
        raise SettingsError(
            f"--cluster {address}: no Dask scheduler answers within {ANSWERS_WITHIN_S:.0f} s ({type(error).__name__}); "
            "start one with dask scheduler, or give --cluster local"
        ) from None
    if not isinstance(answer, dict) or answer.get("type") != "Scheduler":
        raise SettingsError(f"--cluster {address}: what answers there is no Dask scheduler; give a scheduler's address")
