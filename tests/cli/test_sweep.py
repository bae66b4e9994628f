"""``treadline sweep``, as a caller has it."""

import json
import os
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from treadline import sweeps

sys.path.insert(0, str(Path(__file__).parents[1] / "campaign"))  # spawned processes find what runs by its module's name
import short_runs

from .conftest import assert_refused

SPEC = """
[stair]
slope_deg = 25
run_m = 0.30
[drive]
duration_s = 100
[[draw]]
key = "chair.payload_kg"
uniform = [0, 80]
[[draw]]
key = "start.heading_deg"
uniform = [-5, 5]
"""


@pytest.fixture
def spec(tmp_path: Path) -> Path:
    path = tmp_path / "spec.toml"
    path.write_text(SPEC)
    return path


def test_a_sweep_answers_with_one_object(run: Callable, spec: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sweeps, "RunScenario", lambda **_: short_runs.quick)
    done = run("sweep", spec, "--runs", 6, "--seed", 3, "--workers", 1, "--out", tmp_path / "out", "--json")
    assert (done.code, done.values["runs"], done.values["seed"]) == (0, 6, 3), done.err
    assert done.values["verdicts"]["arrived"]["count"] == 6
    assert {path.name for path in (tmp_path / "out").iterdir()} >= {"runs.csv", "summary.json", "manifest.json", "report.html"}
    declared = run("sweep", spec, "--runs", 6, "--seed", 3, "--workers", 1, "--out", tmp_path / "out", "--resume")
    assert (declared.code, declared.err) == (0, "")  # all were run: nothing to show progress of


def test_a_run_that_failed_is_exit_code_1(run: Callable, spec: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sweeps, "RunScenario", lambda **_: short_runs.unlucky)
    monkeypatch.setenv("DIES_ONCE", os.devnull)
    spec.write_text(SPEC.replace("[0, 80]", "[85, 90]"))
    done = run("sweep", spec, "--runs", 2, "--workers", 1, "--out", tmp_path / "out", "--json")
    assert (done.code, done.values["verdicts"]["diverged"]["count"]) == (1, 2)


def test_without_dask_a_cluster_says_how_to_get_it(
    run: Callable, spec: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "dask", None)
    done = run("sweep", spec, "--runs", 3, "--cluster", "local", "--out", tmp_path / "out")
    assert_refused(done, "--cluster needs Dask: pip install '.[cluster]' in treadline's folder, or leave it out for a pool here\n")


def test_a_traversal_can_be_repeated_by_the_command_that_it_names(run: Callable, spec: Path, tmp_path: Path) -> None:
    spec.write_text(SPEC.replace("duration_s = 100", 'duration_s = 2\n[start]\nplace = "flight"'))
    done = run("sweep", spec, "--runs", 1, "--workers", 1, "--out", tmp_path / "out", "--json")
    row = json.loads((tmp_path / "out" / "journal.jsonl").read_text().splitlines()[-1])
    assert row["verdict"] not in ("error", "crashed"), row["cause"]
    words = done.values["worst"][0]["replay"].split()
    again = run(*words[1:], "--json")
    assert again.values["min_stability_margin_deg"] == row["min_stability_margin_deg"]
    assert again.values["verdict"] == row["verdict"]


def test_a_sweep_keeps_its_plug_ins_when_it_is_resumed_and_repeated(
    run: Callable, spec: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sweeps, "RunScenario", lambda **_: short_runs.quick)
    plugin = f"{Path(__file__).parents[2] / 'examples' / 'own_controller_pid.py'}:HeadingPid"
    common = ("sweep", spec, "--workers", 1, "--out", tmp_path / "out", "--json")
    done = run(*common, "--runs", 2, "--controller", plugin)
    assert done.values["worst"][0]["replay"].endswith(f"--controller {plugin}")
    other = run(*common, "--runs", 3, "--resume")
    assert (other.code, "options" in other.err) == (2, True)
    assert run(*common, "--runs", 3, "--resume", "--controller", plugin).values["runs"] == 3
    assert run(*common, "--runs", 1, "--force").values["runs"] == 1
