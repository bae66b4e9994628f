"""Runs on a cluster of Dask workers (the extra ``cluster``); ``local`` starts one on this machine.

Whoever reaches a Dask scheduler may run code on its workers: addresses are for networks one trusts.
"""

import asyncio
import logging
import signal
from collections.abc import Iterable, Iterator
from types import TracebackType
from typing import Any

from treadline.campaign.pool import LIVES, ONE_THREAD, not_for_children
from treadline.campaign.run import Flight, Fly, Row, failed, run_one
from treadline.errors import SettingsError
from treadline.io.provenance import versions

LOCAL = "local"
ANSWERS_WITHIN_S = 10.0
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
            from distributed import Client, LocalCluster
        except ImportError:
            raise SettingsError("--cluster needs Dask: pip install 'treadline[cluster]', or leave it out for a pool here") from None
        for name in ("distributed", "tornado.application"):
            logging.getLogger(name).setLevel(logging.CRITICAL)  # what matters is said by our errors and rows
        dask.config.set(SETTINGS)
        if self._address != LOCAL:
            _must_answer(self._address)
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
        return self

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
        from distributed import KilledWorker, as_completed

        futures = {self._client.submit(run_one, self._fly, flight, pure=False): flight for flight in flights}
        for future in as_completed(list(futures), loop=self._client.loop):
            flight = futures.pop(future)
            try:
                yield future.result()
            except KilledWorker:
                suspects.append(flight)
            future.release()


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
