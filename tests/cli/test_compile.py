"""``treadline compile``: a failing run, a second call, a folder that cannot be written, and commands with an empty cache."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numba
import pytest

from treadline.cli import compile as module

from .conftest import Run


@pytest.fixture
def marker(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    path = tmp_path / "marker"
    monkeypatch.setattr(module, "marker_path", lambda: path)
    return path


def test_a_failing_run_is_the_commands_error_and_is_tried_again(run: Run, marker: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "RUNS", ("see /nowhere",))
    outcome = run("compile")
    assert outcome.code == 2
    assert "treadline: /nowhere" in outcome.err.splitlines()[-1]
    assert not marker.exists()


def test_what_is_compiled_is_not_compiled_again(run: Run, marker: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "RUNS", ())
    assert not run("doctor", "--json").values["kernels"]["compiled"]
    assert [run("compile", "--json").values["compiled"] for _ in range(2)] == [True, False]
    assert marker.exists()
    assert run("doctor", "--json").values["kernels"]["compiled"]


def test_without_a_folder_for_kernels_nothing_is_compiled(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(numba.config, "CACHE_LOCATOR_CLASSES", "IPythonCacheLocator")  # as where no folder can be written
    assert not run("compile", "--json").values["compiled"]
    assert not run("doctor", "--json").values["kernels"]["compiled"]


COUNTED = """
import sys
from treadline.core.kernel_cache import compiling
from treadline.cli import main
code = main(sys.argv[1:])
print(f"compiled {compiling().spent_s:.3f}", file=sys.stderr)
sys.exit(code)
"""


@pytest.mark.slow
def test_after_treadline_compile_no_command_compiles_and_two_at_once_compile_once(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    compile_ = [sys.executable, "-m", "treadline", "compile", "--json"]
    both = [subprocess.Popen(compile_, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) for _ in range(2)]
    assert sorted(json.loads(process.communicate()[0])["compiled"] for process in both) == [False, True]
    for command in (
        "frames --out frames --count 3 --seed 7",
        "see frames",
        "climb up-28 --set drive.duration_s=2 --out climb",
        "climb flight-20 --set drive.duration_s=2 sensors.camera=statistical --out statistical",
        "excite flight-20 --samples 60 --out excite",
        "identify excite --method best --out model.json",
        "identify excite --method pbsid --validate 0.5 --out pbsid.json",
    ):
        done = subprocess.run(
            [sys.executable, "-c", COUNTED, *command.split()], capture_output=True, text=True, check=False, cwd=tmp_path
        )
        assert "compiled 0.000" in done.stderr, (command, done.stdout, done.stderr)


@pytest.mark.slow
def test_a_first_climb_reports_compiling_and_its_speed_leaves_compiling_out(tmp_path: Path) -> None:
    command = "climb flight-20 --set drive.duration_s=1 --json --out"
    env = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "empty")}
    first = subprocess.run(
        [sys.executable, "-m", "treadline", *command.split(), tmp_path / "run"],
        capture_output=True,
        text=True,
        check=False,
        env=env,
    )
    assert first.stderr.count("compiling for this machine") == 1
    assert json.loads(first.stdout)["real_time_factor"] > 0.3  # compiling takes tens of seconds
