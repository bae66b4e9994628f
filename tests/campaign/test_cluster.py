"""A cluster whose workers come back late or never: no run is lost and no sweep hangs. The cluster itself is played here."""

from collections.abc import Iterator
from concurrent.futures import CancelledError
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import flown
import numpy as np
import pytest

from treadline.campaign import cluster
from treadline.campaign.cluster import LOCAL, Cluster
from treadline.campaign.run import Flight, Fly, Row
from treadline.campaign.spec import read_spec
from treadline.campaign.sweep import SweepPlan
from treadline.errors import SettingsError

distributed = pytest.importorskip("distributed", reason="Dask is an extra")


@dataclass(eq=False)
class Promise:
    """A run that was handed in."""

    run: Any
    fly: Fly
    flight: Flight
    lost: bool = False

    def result(self) -> Row:
        if self.lost:
            raise CancelledError
        row: Row = self.run(self.fly, self.flight)
        return row

    def release(self) -> None:
        pass


@dataclass(eq=False)
class Scheduler:
    """Stands for a Dask client: each life flies so many runs, and then all its workers are gone."""

    lives: list[int]
    deadly: frozenset[int] = frozenset()
    """Runs of which no worker comes back."""
    loop: None = None
    left: int = 0
    handed: list[list[int]] = field(default_factory=list)

    def hire(self) -> None:
        self.left = self.lives.pop(0) if self.lives else 0
        self.handed.append([])

    def submit(self, run: Any, fly: Fly, flight: Flight, *, pure: bool) -> Promise:
        assert not pure
        self.handed[-1].append(flight.index)
        return Promise(run, fly, flight)

    def batches(self, promises: list[Promise]) -> Iterator[list[Promise]]:
        for promise in promises:
            if promise.flight.index in self.deadly or self.left == 0:
                self.left = 0
                break
            self.left -= 1
            yield [promise]
        while True:
            yield []

    def processing(self) -> dict[str, list[str]]:
        return {"worker": []}

    def cancel(self, promises: list[Promise], *, force: bool) -> None:
        del promises
        assert force


@pytest.fixture
def flies(monkeypatch: pytest.MonkeyPatch) -> Any:
    def make(scheduler: Scheduler, address: str = LOCAL) -> Cluster:
        class AsCompleted:
            def __init__(self, promises: list[Promise], loop: None) -> None:
                assert loop is scheduler.loop
                self._batches = scheduler.batches(promises)

            def next_batch(self, *, block: bool) -> list[Promise]:
                assert not block
                return next(self._batches)

        monkeypatch.setattr(distributed, "as_completed", AsCompleted)
        monkeypatch.setattr(cluster, "STALLED_S", 0.01)
        monkeypatch.setattr(cluster, "POLL_S", 0.001)
        made = Cluster(flown.quick, address, 2)
        made._client = scheduler
        monkeypatch.setattr(made, "_hire_again", scheduler.hire)
        scheduler.hire()
        return made

    return make


def flights(small: Path, count: int) -> list[Flight]:
    plan = SweepPlan(spec=read_spec(small), runs=count, seed=1)
    point = np.full(plan.spec.dimension, 0.5)
    return [plan.flight(index, point) for index in range(count)]


def test_workers_that_nobody_brings_back_are_hired_again_and_no_run_is_lost(small: Path, flies: Any) -> None:
    scheduler = Scheduler(lives=[3, 0, 2, 9])
    rows = list(flies(scheduler).results(flights(small, 8)))
    assert [row["index"] for row in rows] == list(range(8))
    assert {row["verdict"] for row in rows} <= {"arrived", "held"}
    assert scheduler.handed == [[*range(8)], [*range(3, 8)], [*range(3, 8)], [*range(5, 8)]]


def test_a_run_of_which_no_worker_ever_comes_back_is_flown_alone_and_told(small: Path, flies: Any) -> None:
    scheduler = Scheduler(lives=[99] * 20, deadly=frozenset({2}))
    rows = {row["index"]: row for row in flies(scheduler).results(flights(small, 5))}
    assert rows.keys() == set(range(5))
    assert [index for index, row in rows.items() if row["verdict"] == "crashed"] == [2]
    assert rows[2]["cause"] == "its process died, 2 times"
    # Three times among the others, of which the first two runs were flown, and twice alone.
    assert scheduler.handed[:4] == [[0, 1, 2, 3, 4], [2, 3, 4], [2, 3, 4], [2]]
    assert sum(2 in handed for handed in scheduler.handed) == 5


def test_a_scheduler_that_is_gone_is_told(small: Path, flies: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    scheduler = Scheduler(lives=[9])
    monkeypatch.setattr(scheduler, "submit", lambda run, fly, flight, pure: Promise(run, fly, flight, lost=not pure))
    with pytest.raises(SettingsError, match=r"--cluster tcp://a:1: its scheduler is gone; start it, and go on with --resume"):
        list(flies(scheduler, "tcp://a:1").results(flights(small, 2)))
