"""Whole sweeps: identical results for any executor, and no run lost after any interruption."""

import csv
import gc
import json
import os
import resource
import signal
import subprocess
import sys
import tracemalloc
import zlib
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import short_runs
from processes import alive, wait_for

from treadline.campaign._journal import Journal
from treadline.campaign._pool import Episode, Pool, Row, run_one
from treadline.campaign.spec import Spec, read_spec
from treadline.campaign.sweep import SweepPlan, replay_command, run_sweep
from treadline.core.errors import LogFormatError, SettingsError, TreadlineError
from treadline.io.runs import JOURNAL
from treadline.scenario.scenario import read_scenario

HERE = Path(__file__).parent


def run(index: int) -> Row:
    """Return the row of a run of the sweep with seed 1."""
    seed = int(np.random.SeedSequence([1, index, 1]).generate_state(1)[0])
    return {"index": index, "seed": seed, "verdict": "arrived", "cause": "the landing"}


def sealed(row: Row) -> bytes:
    """Return a line of a journal with the checksum of its text."""
    text = json.dumps(row)
    return f'{text[:-1]}, "crc32": "{zlib.crc32(text.encode()):08x}"}}\n'.encode()


class InProcess(Pool):
    """Executor without processes."""

    def __init__(self) -> None:
        super().__init__(short_runs.quick, 0)

    def results(self, episodes: Iterable[Episode]) -> Iterator[Row]:
        return (run_one(self._run_episode, episode) for episode in episodes)


class Counting(InProcess):
    """Executor that counts the runs in memory."""

    most = 0

    def results(self, episodes: Iterable[Episode]) -> Iterator[Row]:
        for number, row in enumerate(super().results(episodes)):
            if number % 20 == 0:
                self.most = max(self.most, sum(isinstance(kept, Episode) for kept in gc.get_objects()))
            yield row


def sweep(plan: SweepPlan, folder: Path, runners: Any = None, *, resume: bool = False, done: Any = None) -> dict[str, Any]:
    """Run a sweep; in this process unless ``runners`` says otherwise."""
    runners, done = runners or InProcess(), done or (lambda _row, _left: None)
    return run_sweep(plan, folder, runners, resume=resume, begin=lambda _left: None, done=done)


def results(folder: Path) -> dict[str, bytes]:
    """Return the files that must be identical: all but times, with the folder's name replaced."""
    summary = (folder / "summary.json").read_text().replace(str(folder), "OUT")
    names = ["runs.csv", "runs.parquet", "spec.toml", *(f"scenarios/{path.name}" for path in folder.glob("scenarios/*"))]
    return {"summary": summary.encode()} | {name: (folder / name).read_bytes() for name in names if (folder / name).exists()}


def rows(folder: Path) -> list[dict[str, str]]:
    with (folder / "runs.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def test_one_process_or_four_give_the_same_bytes(small_spec: Spec, tmp_path: Path) -> None:
    plan = SweepPlan(spec=small_spec, runs=24, seed=5)
    for workers in (1, 4):
        sweep(plan, tmp_path / str(workers), Pool(short_runs.quick, workers))
    assert results(tmp_path / "1") == results(tmp_path / "4")
    table = rows(tmp_path / "1")
    assert [int(row["index"]) for row in table] == list(range(24))
    assert not {"cpu_s", "real_time_factor"} & set(table[0])
    assert {"stair.slope_deg", "stair.friction.0", "verdict", "min_stability_margin_deg"} <= set(table[0])


def test_every_tenth_held_chair_is_observed_for_a_minute(small_spec: Spec, tmp_path: Path) -> None:
    sweep(SweepPlan(spec=small_spec, runs=24, seed=5), tmp_path)
    assert [int(row["index"]) for row in rows(tmp_path) if float(row["watched_s"]) == 60.0] == [0, 10, 20]
    assert {float(row["watched_s"]) for row in rows(tmp_path)} == {3.0, 60.0}


def test_parquet_holds_what_csv_holds(small_spec: Spec, tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet", reason="pyarrow is an extra")
    sweep(SweepPlan(spec=small_spec, runs=6), tmp_path / "out")
    table = parquet.read_table(tmp_path / "out" / "runs.parquet").to_pylist()
    for as_text, typed in zip(rows(tmp_path / "out"), table, strict=True):
        assert {key: "" if value is None else str(value) for key, value in typed.items()} == as_text


def test_dask_gives_the_same_bytes_with_a_killed_worker(small_spec: Spec, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed", reason="Dask is an extra")
    from treadline.campaign._cluster import LOCAL, Cluster

    plan = SweepPlan(spec=small_spec, runs=40, seed=1)
    sweep(plan, tmp_path / "pool")
    monkeypatch.setenv("DIES_ONCE", str(tmp_path / "died"))
    sweep(plan, tmp_path / "dask", Cluster(short_runs.killed_once, LOCAL, 2))
    assert (tmp_path / "died").exists()  # a worker was killed, and its run repeated
    assert results(tmp_path / "pool") == results(tmp_path / "dask")


def test_a_process_has_one_run_at_a_time_and_no_other_is_drawn(small_spec: Spec) -> None:
    plan, drawn = SweepPlan(spec=small_spec, runs=40), []
    with Pool(short_runs.quick, 2) as pool:
        episodes = (drawn.append(k) or plan.episode(k, point) for k, point in enumerate(plan.first_points()))
        for ended, _row in enumerate(pool.results(episodes)):
            assert len(drawn) - ended <= 2


def test_memory_does_not_grow_with_the_number_of_runs(small_spec: Spec, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Test: 60 runs and 160, with 32 rows in memory. Expected: one episode in memory, and 100 kB for more runs; a row has 2 kB."""
    for module in ("_results", "_campaign_page", "_sobol_sampling"):
        monkeypatch.setattr(f"treadline.campaign.{module}.BLOCK", 32)
    peaks, most = [], []
    for runs in (8, 60, 160):  # the first sweep imports
        executor = Counting()
        gc.collect()  # what earlier tests and sweeps left
        tracemalloc.start()
        sweep(SweepPlan(spec=small_spec, runs=runs, sampling="sobol"), tmp_path / f"{runs}", executor)
        peaks.append(tracemalloc.get_traced_memory()[1])
        most.append(executor.most)
        tracemalloc.stop()
    assert most[2] <= most[1]
    assert peaks[2] - peaks[1] < 100_000


def test_a_failing_run_is_a_row_and_affects_no_other_run(small_spec: Spec, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    once = tmp_path / "died"
    monkeypatch.setenv("DIES_ONCE", str(once))
    sweep(SweepPlan(spec=small_spec, runs=40, seed=1), tmp_path / "out", Pool(short_runs.unlucky, 2))
    table = rows(tmp_path / "out")
    assert len(table) == 40
    seen = {"crashed": 0, "diverged": 0, "error": 0}
    for row in table:
        payload_kg = float(row["chair.payload_kg"])
        if payload_kg > short_runs.DEADLY_KG:
            expected, cause = "crashed", "its process was killed by SIGKILL, 2 times"
        elif payload_kg > short_runs.BAD_KG:
            expected, cause = "diverged", "time went back"
        elif row["stair.texture"] == "dark":
            expected, cause = "error", "ValueError: no light (short_runs.py:50)"
        else:
            assert row["verdict"] in ("arrived", "held")
            continue
        assert (row["verdict"], row["cause"]) == (expected, cause)
        seen[expected] += 1
    assert all(seen.values()), seen
    assert once.exists()  # a process ended with exit code 3, and its run was repeated


def test_a_longer_sweep_begins_with_the_shorter_one(small_spec: Spec, tmp_path: Path) -> None:
    done: list[int] = []
    for sampling in ("random", "sobol"):
        spec, out = small_spec, tmp_path / sampling
        sweep(SweepPlan(spec=spec, runs=5, sampling=sampling), out)
        sweep(SweepPlan(spec=spec, runs=12, sampling=sampling), out, resume=True, done=lambda row, _: done.append(row["index"]))
        sweep(SweepPlan(spec=spec, runs=12, sampling=sampling), tmp_path / f"{sampling}-at-once")
        assert results(out) == results(tmp_path / f"{sampling}-at-once")
    assert sorted(done) == sorted([*range(5, 12)] * 2)


@pytest.mark.parametrize("change", [{"seed": 1}, {"sampling": "sobol"}, {"adversarial": True}])
def test_a_different_sweep_is_not_continued(small_spec: Spec, small: Path, tmp_path: Path, change: dict[str, Any]) -> None:
    spec, out = small_spec, tmp_path / "out"
    sweep(SweepPlan(spec=spec, runs=8), out)
    before = (out / JOURNAL).read_bytes()
    with pytest.raises(SettingsError, match="a sweep is there already; go on with --resume, or give another --out"):
        sweep(SweepPlan(spec=spec, runs=8), out)
    with pytest.raises(SettingsError, match=r"the sweep there has .*; resume with what it was started with"):
        sweep(SweepPlan(spec=spec, runs=8, **change), out, resume=True)
    small.write_text(small.read_text().replace("[20, 30]", "[21, 30]"))
    with pytest.raises(SettingsError, match="the sweep there has spec"):
        sweep(SweepPlan(spec=read_spec(small), runs=8), out, resume=True)
    assert (out / JOURNAL).read_bytes() == before


def test_an_incomplete_last_line_is_run_again_and_a_damaged_line_is_rejected(small_spec: Spec, tmp_path: Path) -> None:
    plan, out = SweepPlan(spec=small_spec, runs=6), tmp_path / "out"
    sweep(plan, out)
    whole, journal = results(out), out / JOURNAL
    journal.write_bytes(journal.read_bytes()[:-40])
    done: list[int] = []
    sweep(plan, out, resume=True, done=lambda row, _: done.append(row["index"]))
    assert (done, results(out)) == ([5], whole)
    lines = journal.read_bytes().splitlines(keepends=True)
    journal.write_bytes(b"".join([*lines[:2], b'{"index": 1, "ver\n', *lines[3:]]))
    with pytest.raises(LogFormatError, match=r"journal.jsonl:3: the line has no checksum; remove the line"):
        sweep(plan, out, resume=True)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        (sealed(run(1)).replace(b'"arrived"', b'"held"'), "the checksum does not match"),
        (sealed(run(1)).replace(b'"crc32": "', b'"crc32": "0'), "the checksum does not match"),
        (json.dumps(run(1)).encode() + b"\n", "the line has no checksum"),
        (sealed(run(0)), "run 0 is there twice"),
        (sealed(run(1) | {"index": -1}), "no run has the index -1"),
        (sealed(run(1) | {"index": True}), "no run has the index True"),
        (sealed(run(1) | {"index": 2}), r"run 2 has the seed \d+, in this sweep \d+"),
        (sealed(run(9) | {"seed": 7}), r"run 9 has the seed 7, in this sweep \d+"),
        (sealed({"index": 1, "seed": run(1)["seed"]}), "run 1 has no verdict"),
    ],
)
def test_a_journal_line_that_is_not_a_run_of_the_sweep_is_rejected(tmp_path: Path, line: bytes, message: str) -> None:
    with Journal(tmp_path, {"seed": 1}, 5, resume=False) as journal:
        journal.add(run(0))
    with (tmp_path / JOURNAL).open("ab") as file:
        file.write(line)
    remedy = "remove the line to run it again, or give another --out"
    with pytest.raises(LogFormatError, match=rf"journal\.jsonl:3: {message}; {remedy}$"):
        Journal(tmp_path, {"seed": 1}, 5, resume=True)


def test_a_journal_is_locked_against_a_second_sweep(tmp_path: Path) -> None:
    with Journal(tmp_path, {"seed": 1}, 5, resume=False), pytest.raises(SettingsError, match="another sweep is writing it"):
        Journal(tmp_path, {"seed": 1}, 5, resume=True)


def test_ctrl_c_between_write_and_update_loses_no_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(_: int) -> None:
        raise KeyboardInterrupt

    with Journal(tmp_path, {"seed": 1}, 5, resume=False) as journal:
        with monkeypatch.context() as patch:
            patch.setattr("treadline.campaign._journal.os.fsync", interrupted)
            with pytest.raises(KeyboardInterrupt):
                journal.add(run(3))
        assert list(journal) == []
        journal.reload()
        assert list(journal) == [run(3)]


@pytest.mark.parametrize(("largest", "file"), [(3_000, "journal.jsonl"), (9_500, "report.html")])
def test_a_sweep_on_a_full_disk_can_be_resumed(small_spec: Spec, tmp_path: Path, largest: int, file: str) -> None:
    """Test: no file may grow beyond a size, at first. Expected: one line with the file, and the results of a sweep at once."""
    plan, out = SweepPlan(spec=small_spec, runs=8, seed=5), tmp_path / "out"
    sweep(plan, tmp_path / "at-once")
    limits, ignored = resource.getrlimit(resource.RLIMIT_FSIZE), signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (largest, limits[1]))
        with pytest.raises(TreadlineError, match=rf"{file}: cannot be written: File too large") as full:
            sweep(plan, out)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        signal.signal(signal.SIGXFSZ, ignored)
    kept = len((out / JOURNAL).read_bytes().splitlines()) - 1
    assert file != JOURNAL or f"; {kept} runs are kept there: make room and go on with --resume" in str(full.value)
    done: list[int] = []
    sweep(plan, out, resume=True, done=lambda row, _: done.append(row["index"]))
    assert (done, results(out)) == ([*range(kept, 8)], results(tmp_path / "at-once"))


def started(spec: Path, out: Path, *options: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, HERE / "sweep_slowly.py", "sweep", spec, "--runs", "60", "--workers", "2", "--out", out, *options],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,  # so that a signal can be sent to all processes, as Ctrl-C in a terminal
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # noqa: PLW1509 - no threads are started here
    )


@pytest.mark.parametrize("executor", [(), ("--cluster", "local")], ids=["pool", "dask"])
def test_ctrl_c_leaves_tables_and_a_killed_sweep_can_be_resumed(
    small_spec: Spec, small: Path, tmp_path: Path, executor: tuple[str, ...]
) -> None:
    if executor:
        pytest.importorskip("distributed", reason="Dask is an extra")
    out, journal = tmp_path / "out", tmp_path / "out" / JOURNAL
    kept = lambda: journal.read_bytes().count(b"\n") - 1 if journal.exists() else 0  # noqa: E731

    killed = started(small, out, *executor)
    wait_for(lambda: kept() >= 4)
    workers = children(killed.pid)
    killed.kill()
    killed.communicate(timeout=30.0)
    wait_for(lambda: not any(alive(worker) for worker in workers))  # orphaned workers end by themselves
    first = kept()
    assert 4 <= first < 60

    interrupted = started(small, out, "--resume")
    wait_for(lambda: kept() >= first + 4)
    os.killpg(interrupted.pid, signal.SIGINT)
    said, progress = interrupted.communicate(timeout=30.0)
    assert (interrupted.returncode, said) == (130, ""), progress
    assert "Traceback" not in progress
    assert progress.splitlines()[-1].startswith("treadline: interrupted")
    assert "left" in progress
    assert len(rows(out)) == kept() < 60
    assert json.loads((out / "summary.json").read_text())["runs"] == kept()

    done = started(small, out, "--resume", "--json")
    said, progress = done.communicate(timeout=60.0)
    assert json.loads(said)["runs"] == 60, progress
    at_once = tmp_path / "at-once"
    sweep(SweepPlan(spec=small_spec, runs=60), at_once)
    assert results(out) == results(at_once)


def children(pid: int) -> list[int]:
    return [int(child) for task in Path(f"/proc/{pid}/task").glob("*/children") for child in task.read_text().split()]


def test_every_run_that_did_not_arrive_can_be_repeated(small_spec: Spec, tmp_path: Path) -> None:
    plan, out = SweepPlan(spec=small_spec, runs=20, seed=2), tmp_path / "out"
    summary = sweep(plan, out)
    table = rows(out)
    missed = {f"{int(row['index']):04d}" for row in table if row["verdict"] != "arrived"}
    assert missed
    assert missed <= {path.stem for path in out.glob("scenarios/*.toml")}
    margins = sorted(float(row["min_stability_margin_deg"]) for row in table)
    assert [row["min_stability_margin_deg"] for row in summary["worst"]] == margins[:10]
    worst = summary["worst"][0]
    words = worst["replay"].split()
    assert words[:2] == ["treadline", "climb"]
    again = short_runs.quick(read_scenario(words[2]), int(words[words.index("--seed") + 1]), 3.0)
    assert again["min_stability_margin_deg"] == worst["min_stability_margin_deg"]


def test_the_adversarial_search_beats_sampling_and_can_be_resumed(small_spec: Spec, tmp_path: Path) -> None:
    spec = small_spec
    plan = SweepPlan(spec=spec, runs=96, seed=3, adversarial=True)
    found = sweep(plan, tmp_path / "whole")
    chance = sweep(SweepPlan(spec=spec, runs=96, seed=3), tmp_path / "chance")
    lowest = found["worst"][0]["min_stability_margin_deg"]
    # 110 kg at ±30° is the worst case: 12 - 5.5 - 6 = 0.5°, and noise of 0.01.
    assert lowest == pytest.approx(0.5, abs=0.15)
    assert lowest < chance["worst"][0]["min_stability_margin_deg"]
    lines = (tmp_path / "whole" / JOURNAL).read_bytes().splitlines(keepends=True)
    (tmp_path / "cut").mkdir()
    (tmp_path / "cut" / JOURNAL).write_bytes(b"".join(lines[:50]))
    sweep(plan, tmp_path / "cut", resume=True)
    assert results(tmp_path / "cut") == results(tmp_path / "whole")


def test_the_manifest_says_how_to_repeat_it(small_spec: Spec, tmp_path: Path) -> None:
    plan, out = SweepPlan(spec=small_spec, runs=2, seed=9, sampling="sobol"), tmp_path / "out"
    sweep(plan, out)
    manifest = json.loads((out / "manifest.json").read_text())
    assert manifest["seed"] == 9
    assert {"spec": plan.spec.digest, "sampling": "sobol", "runs": 2}.items() <= manifest["settings"].items()
    assert manifest["settings"]["commits"] == [manifest["git_commit"]]
    assert read_spec(out / "spec.toml").digest == plan.spec.digest


def test_the_replay_command_is_quoted_for_a_shell() -> None:
    said = replay_command(Path("my sweep"), {"index": 7, "seed": 3})
    assert said == "treadline climb 'my sweep/scenarios/0007.toml' --seed 3 --out 'my sweep/reruns/0007'"
