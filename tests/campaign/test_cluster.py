"""Cluster with late or missing workers: no run is lost and no sweep hangs. The cluster itself is a fake."""

from collections.abc import Iterator
from concurrent.futures import CancelledError
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import short_runs

from treadline.campaign import _cluster as cluster
from treadline.campaign._cluster import LOCAL, Cluster
from treadline.campaign._pool import Episode, EpisodeRunner, Row
from treadline.campaign.spec import read_spec
from treadline.campaign.sweep import SweepPlan
from treadline.core.errors import SettingsError

distributed = pytest.importorskip("distributed", reason="Dask is an extra")


@dataclass(eq=False)
class Promise:
    """Future of a submitted run."""

    run: Any
    run_episode: EpisodeRunner
    episode: Episode
    lost: bool = False

    def result(self) -> Row:
        if self.lost:
            raise CancelledError
        row: Row = self.run(self.run_episode, self.episode)
        return row

    def release(self) -> None:
        pass


@dataclass(eq=False)
class Scheduler:
    """Fake Dask client: each life completes a number of runs, then all workers are gone."""

    lives: list[int]
    deadly: frozenset[int] = frozenset()
    """Indices of runs whose worker never returns."""
    loop: None = None
    left: int = 0
    most_waiting: int = 0
    handed: list[list[int]] = field(default_factory=list)

    def hire(self) -> None:
        self.left = self.lives.pop(0) if self.lives else 0
        self.handed.append([])

    def submit(self, run: Any, run_episode: EpisodeRunner, episode: Episode, *, pure: bool) -> Promise:
        assert not pure
        self.handed[-1].append(episode.index)
        return Promise(run, run_episode, episode)

    def batches(self, promises: list[Promise]) -> Iterator[list[Promise]]:
        while promises:
            promise = promises.pop(0)
            self.most_waiting = max(self.most_waiting, len(promises) + 1)
            if promise.episode.index in self.deadly or self.left == 0:
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
def cluster_of(monkeypatch: pytest.MonkeyPatch) -> Any:
    def make(scheduler: Scheduler, address: str = LOCAL) -> Cluster:
        class AsCompleted:
            def __init__(self, loop: None) -> None:
                assert loop is scheduler.loop
                self._promises: list[Promise] = []
                self.add, self._batches = self._promises.append, scheduler.batches(self._promises)

            def next_batch(self, *, block: bool) -> list[Promise]:
                assert not block
                return next(self._batches)

        monkeypatch.setattr(distributed, "as_completed", AsCompleted)
        monkeypatch.setattr(cluster, "STALLED_S", 0.01)
        monkeypatch.setattr(cluster, "POLL_S", 0.001)
        made = Cluster(short_runs.quick, address, 2)
        made._client = scheduler
        monkeypatch.setattr(made, "_restart_workers", scheduler.hire)
        scheduler.hire()
        return made

    return make


def episodes(small: Path, count: int) -> list[Episode]:
    plan = SweepPlan(spec=read_spec(small), runs=count, seed=1)
    point = np.full(plan.spec.dimension, 0.5)
    return [plan.episode(index, point) for index in range(count)]


def test_lost_workers_are_restarted_and_no_run_is_lost(small: Path, cluster_of: Any) -> None:
    scheduler = Scheduler(lives=[3, 0, 2, 9])
    rows = list(cluster_of(scheduler).results(episodes(small, 8)))
    assert [row["index"] for row in rows] == list(range(8))
    assert {row["verdict"] for row in rows} <= {"arrived", "held"}
    assert scheduler.handed == [[*range(8)], [*range(3, 8)], [*range(3, 8)], [*range(5, 8)]]


def test_few_runs_are_submitted_at_a_time(small: Path, cluster_of: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cluster, "BLOCK", 3)
    scheduler = Scheduler(lives=[99])
    assert [row["index"] for row in cluster_of(scheduler).results(iter(episodes(small, 8)))] == [*range(8)]
    assert scheduler.most_waiting == 3


def test_a_run_that_kills_every_worker_is_run_alone_and_reported(small: Path, cluster_of: Any) -> None:
    scheduler = Scheduler(lives=[99] * 20, deadly=frozenset({2}))
    rows = {row["index"]: row for row in cluster_of(scheduler).results(episodes(small, 5))}
    assert rows.keys() == set(range(5))
    assert [index for index, row in rows.items() if row["verdict"] == "crashed"] == [2]
    assert rows[2]["cause"] == "its process died, 2 times"
    # Three times among the others, of which the first two runs were executed, and twice alone.
    assert scheduler.handed[:4] == [[0, 1, 2, 3, 4], [2, 3, 4], [2, 3, 4], [2]]
    assert sum(2 in handed for handed in scheduler.handed) == 5


def test_a_lost_scheduler_is_reported(small: Path, cluster_of: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    scheduler = Scheduler(lives=[9])
    monkeypatch.setattr(scheduler, "submit", lambda run, run_once, episode, pure: Promise(run, run_once, episode, lost=not pure))
    with pytest.raises(SettingsError, match=r"--cluster tcp://a:1: its scheduler is gone; start it, and go on with --resume"):
        list(cluster_of(scheduler, "tcp://a:1").results(episodes(small, 2)))
