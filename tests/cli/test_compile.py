"""``treadline compile``: what becomes of a failure in one of its two processes, and a first command with an empty cache."""

import json
import os
import re
import subprocess
import sys
from functools import partial
from pathlib import Path

import pytest

from treadline.cli import compile as module

from .conftest import Run

SLOW = pytest.mark.skipif("TREADLINE_SLOW" not in os.environ, reason="make slow runs this: it compiles everything anew")


@pytest.fixture
def marker(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    path = tmp_path / "marker"
    monkeypatch.setattr(module, "marker_path", lambda: path)
    return path


@pytest.mark.parametrize(
    ("group", "said"),
    [
        (os.abort, r"a process that compiled kernels was killed.*memory"),
        (partial(os.listdir, "/nowhere"), "/nowhere: No such file"),
    ],
    ids=["killed", "error"],
)
def test_a_failure_in_a_process_is_the_commands_error(
    run: Run, marker: Path, monkeypatch: pytest.MonkeyPatch, group: object, said: str
) -> None:
    monkeypatch.setattr(module, "GROUPS", (group, os.getpid))
    outcome = run("compile")
    assert outcome.code == 2
    assert re.search(rf"\Atreadline: {said}", outcome.err.splitlines()[-1])
    assert not marker.exists()


def test_what_is_compiled_is_not_compiled_again(run: Run, marker: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "GROUPS", (os.getpid, os.getppid))
    assert not run("doctor", "--json").values["kernels"]["compiled"]
    assert [run("compile", "--json").values["compiled"] for _ in range(2)] == [True, False]
    assert marker.exists()
    assert run("doctor", "--json").values["kernels"]["compiled"]


COUNTED = """
import sys
from treadline.core.kernel_cache import compiling
compiling()
from treadline.cli import main
code = main(sys.argv[1:])
print(f"compiled {compiling().spent_s:.3f}", file=sys.stderr)
sys.exit(code)
"""


@pytest.mark.slow
@SLOW
def test_after_treadline_compile_no_command_compiles_and_two_at_once_compile_once(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    (tmp_path / "short.toml").write_text(module.SCENARIO)
    (tmp_path / "images.toml").write_text(module.SCENARIO.replace('"statistical"', '"kinect1"'))
    compile_ = [sys.executable, "-m", "treadline", "compile", "--json"]
    both = [subprocess.Popen(compile_, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) for _ in range(2)]
    assert sorted(json.loads(process.communicate()[0])["compiled"] for process in both) == [False, True]
    for command in (
        "frames --out frames --count 3 --seed 7",
        "see frames",
        "climb short.toml --out climb",
        "climb images.toml --out images",
        "excite short.toml --samples 60 --out excite",
        "identify excite --method best --out model.json",
        "identify excite --method pbsid --validate 0.5 --out pbsid.json",
    ):
        done = subprocess.run(
            [sys.executable, "-c", COUNTED, *command.split()], capture_output=True, text=True, check=False, cwd=tmp_path
        )
        assert "compiled 0.000" in done.stderr, (command, done.stdout, done.stderr)


@pytest.mark.slow
@SLOW
def test_no_kernel_is_compiled_in_both_processes_and_a_first_climb_reports_compiling(tmp_path: Path) -> None:
    """Test: each half of the kernels with a cache of its own. Expected result: no file in common; numba's files have no lock."""
    halves = [tmp_path / str(k) for k in range(2)]
    for k, folder in enumerate(halves):
        source = f"from treadline.cli.compile import GROUPS; GROUPS[{k}]()"
        subprocess.run([sys.executable, "-c", source], env=os.environ | {"NUMBA_CACHE_DIR": str(folder)}, check=True)
    detection, simulation = ({path.name for path in folder.rglob("*.nbi")} for folder in halves)
    assert min(len(detection), len(simulation)) > 30
    assert not detection & simulation
    (tmp_path / "short.toml").write_text(module.SCENARIO)
    command = [sys.executable, "-m", "treadline", "climb", tmp_path / "short.toml", "--out", tmp_path / "run", "--json"]
    env = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "empty")}
    first = subprocess.run(command, capture_output=True, text=True, check=False, env=env)
    assert first.stderr.count("compiling for this machine") == 1
    assert json.loads(first.stdout)["real_time_factor"] > 0.3  # compiling takes tens of seconds; the factor leaves it out
