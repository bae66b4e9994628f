"""Run folders: whole files of plain JSON and CSV, with what the run returned and what is needed to repeat it."""

import json
import subprocess
from dataclasses import asdict
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest

from treadline.core.errors import SettingsError, TreadlineError
from treadline.core.models import InputOutputRecord
from treadline.core.ports import Truth
from treadline.identification.excitation_signal import ExcitationConfig
from treadline.io import runs
from treadline.io.mcap_read import read_log
from treadline.io.records import read_record
from treadline.io.runs import INPUTS, OUTPUTS, begin_run, read_series, write_manifest, write_result, write_series
from treadline.run.episode import Traverse
from treadline.run.excitation_run import excite
from treadline.scenario.scenario import read_scenario


def test_a_manifest_says_how_to_repeat_the_run_on_any_machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    argv = ["/bin/treadline", "climb", "my stairs/a b.toml", "--out", "/there/run", "--set=/x y", "--seed=3", "/x/c.json"]
    monkeypatch.setattr("sys.argv", argv)
    write_manifest(tmp_path, {"stair": {"rise_m": 0.16}}, 7)
    manifest = json.loads((tmp_path / "manifest.json").read_text())
    assert (manifest["settings"], manifest["seed"]) == ({"stair": {"rise_m": 0.16}}, 7)
    # For a shell.
    assert manifest["command"] == "treadline climb 'my stairs/a b.toml' --out run '--set=x y' --seed=3 c.json"
    assert {"python", "treadline", "numpy", "scipy", "mujoco-core"} <= set(manifest["versions"])


def test_a_tree_with_changes_is_said_to_be_no_commit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def git(*arguments: str) -> str:
        ours = ["-c", "user.name=a", "-c", "user.email=a@b", "-c", "commit.gpgsign=false"]
        done = subprocess.run(["git", "-C", tmp_path, *ours, *arguments], capture_output=True, text=True, check=True)
        return done.stdout.strip()

    source = tmp_path / "source.py"
    monkeypatch.setattr(runs, "__file__", str(source))
    git("init")
    source.write_text("1")
    git("add", ".")
    git("commit", "-m", "one")
    git("tag", "v1")
    assert runs.git_commit() == git("rev-parse", "HEAD")
    (tmp_path / "run.json").write_text("{}")  # an untracked file is none of what runs
    assert runs.git_commit() == git("rev-parse", "HEAD")
    source.write_text("2")
    assert runs.git_commit() == git("rev-parse", "HEAD") + "-dirty"


def test_without_git_or_with_one_that_hangs_there_is_no_commit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runs.subprocess, "run", Mock(side_effect=subprocess.TimeoutExpired("git", 10.0)))
    assert runs.git_commit() is None
    monkeypatch.setattr(runs.shutil, "which", lambda _: None)
    assert runs.provenance()["git_commit"] is None


def test_numbers_that_are_not_finite_are_null_in_a_result(tmp_path: Path) -> None:
    write_result(tmp_path, {"a": float("nan"), "b": np.array([1.0, np.inf]), "c": None})
    assert json.loads((tmp_path / "result.json").read_text()) == {"a": None, "b": [1.0, None], "c": None}


def test_a_series_comes_back_at_ten_hertz_to_six_digits(tmp_path: Path) -> None:
    columns = {"t_s": 0.01 * np.arange(101), "estimate_deg": np.random.default_rng(2).normal(size=101)}
    columns["estimate_deg"][0] = np.nan
    write_series(tmp_path, columns)
    back = read_series(tmp_path)
    assert list(back) == list(columns)
    for name, values in columns.items():
        # Six significant digits: half a unit of the last is 5e-6 of the value.
        np.testing.assert_allclose(back[name], values[::10], rtol=5e-6)
    assert [item.name for item in tmp_path.iterdir()] == ["series.csv"]


def test_what_cannot_be_written_is_one_typed_line_and_leaves_nothing(tmp_path: Path) -> None:
    (tmp_path / "result.json").mkdir()
    with pytest.raises(TreadlineError, match=r"result\.json: cannot be written"):
        write_result(tmp_path, {})
    assert [item.name for item in tmp_path.iterdir()] == ["result.json"]
    (tmp_path / "file").touch()
    with pytest.raises(TreadlineError, match="cannot be written"):
        write_result(tmp_path / "file" / "run", {})


def test_a_run_removes_what_an_earlier_one_wrote_and_nothing_else(tmp_path: Path) -> None:
    (tmp_path / "record.csv").write_text("measured by somebody")
    begin_run(tmp_path, {}, 1)
    assert (tmp_path / "record.csv").exists()  # there was no manifest: the folder was no run's
    (tmp_path / "notes.txt").write_text("keep")
    write_result(tmp_path, {"seed": 1})
    begin_run(tmp_path, {}, 2)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["manifest.json", "notes.txt"]


SCENARIO = read_scenario("paper-28")


@pytest.fixture(scope="module")
def excited(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, InputOutputRecord, Traverse]:
    folder = tmp_path_factory.mktemp("run")
    return folder, *excite(SCENARIO, folder=folder, samples=20, period_s=0.05, seed=1, image_every=5)


def test_the_files_of_a_run_hold_what_it_returned(excited: tuple[Path, InputOutputRecord, Traverse]) -> None:
    folder, record, run = excited
    back = read_record(folder, INPUTS, OUTPUTS)
    np.testing.assert_array_equal(back.u, record.u)
    np.testing.assert_array_equal(back.y, record.y)
    truth = [signal for signal in read_log(folder / "log.mcap") if isinstance(signal, Truth)]
    np.testing.assert_array_equal([sample.heading_rad for sample in truth], run.trace["heading_rad"])
    # Every tenth sample, in degrees, of six significant digits.
    wanted = np.rad2deg(run.trace["heading_rad"][::10])
    np.testing.assert_allclose(read_series(folder)["heading_deg"], wanted, rtol=5e-6)


def test_the_manifest_says_what_pulls_the_chair_back(excited: tuple[Path, InputOutputRecord, Traverse]) -> None:
    entry = json.loads((excited[0] / "manifest.json").read_text())["excitation"]
    assert entry == asdict(ExcitationConfig(mean_m_s=SCENARIO.drive.speed_m_s))
    assert entry["pull_m_s_per_rad"] > 0.0


def test_bad_settings_leave_no_folder(tmp_path: Path) -> None:
    throne = SCENARIO.model_copy(update={"chair": SCENARIO.chair.model_copy(update={"model": "throne"})})
    with pytest.raises(SettingsError, match=r"chair\.model"):
        excite(throne, folder=tmp_path / "run", samples=20, period_s=0.05, seed=1)
    assert not list(tmp_path.iterdir())
