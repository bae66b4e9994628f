"""Compiling: its CPU time is known, the user is informed once, and ``treadline compile`` leaves nothing to compile."""

import json
import os
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import pytest
from numba.core import event

from treadline.core import compile_cache as module
from treadline.core.compile_cache import CompileTimer, compiling, marker_path

SCENARIO = """
[stair]
slope_deg = 28
steps = 30
[start]
place = "flight"
step = 6
[drive]
duration_s = 0.5
[control]
vision = "truth"
[sensors]
camera = "statistical"
"""

KERNEL = {"dispatcher": SimpleNamespace(py_func=marker_path)}
"""Data of an event: any function of the program counts as a kernel."""


def burn(seconds: float) -> None:
    until = time.process_time() + seconds
    while time.process_time() < until:
        pass


def test_nested_compilation_counts_once_and_is_reported_once() -> None:
    watch, reported = CompileTimer(), []
    watch.call_once_if_long(lambda: reported.append(watch.spent_s))
    with event.install_listener("numba:compile", watch):
        for _ in range(4):
            with event.trigger_event("numba:compile", data=KERNEL), event.trigger_event("numba:compile", data=KERNEL):
                burn(0.6 * module.LONG_S)
    # A second of slack would be a quarter: the clock of a busy machine ticks coarsely.
    assert 2.4 * module.LONG_S <= watch.spent_s < 3.0 * module.LONG_S
    assert len(reported) == 1
    assert module.LONG_S < reported[0] < 1.6 * module.LONG_S


def test_each_kernel_is_reported_once_and_the_functions_of_numba_are_not() -> None:
    watch, kernels = CompileTimer(), []
    watch.call_for_each(lambda: kernels.append(1))
    foreign = {"dispatcher": SimpleNamespace(py_func=json.dumps)}
    with event.install_listener("numba:compile", watch):
        for data in (KERNEL, foreign, KERNEL):
            with event.trigger_event("numba:compile", data=data):
                pass
    assert len(kernels) == 1


def test_a_process_has_one_timer() -> None:
    assert compiling() is compiling()


@pytest.mark.slow
@pytest.mark.skipif("TREADLINE_SLOW" not in os.environ, reason="make slow runs this: it compiles a climb anew")
def test_a_first_climb_reports_compiling_and_excludes_it_from_the_real_time_factor(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    (tmp_path / "short.toml").write_text(SCENARIO)
    first, second = (
        subprocess.run(
            [sys.executable, "-m", "treadline", "climb", tmp_path / "short.toml", "--out", tmp_path / name, "--json"],
            capture_output=True,
            text=True,
            check=True,
        )
        for name in ("first", "second")
    )
    assert first.stderr.count("compiling for this machine") == 1
    assert "compiling" not in second.stderr
    cold, warm = (json.loads(done.stdout)["real_time_factor"] for done in (first, second))
    # Compiling takes tens of seconds, half a second of driving a tenth; loading what was compiled is in neither's way.
    assert cold > 0.3 * warm


COUNTED = """
import sys
from treadline.core.compile_cache import compiling
compiling()
from treadline.cli import main
code = main(sys.argv[1:])
print(f"compiled {compiling().spent_s:.3f}", file=sys.stderr)
sys.exit(code)
"""


@pytest.mark.slow
@pytest.mark.skipif("TREADLINE_SLOW" not in os.environ, reason="make slow runs this: it compiles everything anew")
def test_after_treadline_compile_no_command_compiles_and_two_at_once_compile_once(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setenv("PYTHONPATH", str(Path(module.__file__).parents[1]))  # commands run in another folder
    (tmp_path / "short.toml").write_text(SCENARIO)
    (tmp_path / "images.toml").write_text(SCENARIO.replace('vision = "truth"', "").replace('"statistical"', '"kinect1"'))
    compile_ = [sys.executable, "-m", "treadline", "compile", "--json"]
    both = [subprocess.Popen(compile_, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) for _ in range(2)]
    answers = [json.loads(process.communicate()[0]) for process in both]
    assert sorted(answer["compiled"] for answer in answers) == [False, True]

    for command in (
        "frames --out frames --count 3 --seed 7",
        "see frames",
        "climb short.toml --out climb",
        "climb images.toml --out images",
        "excite short.toml --samples 60 --out excite",
        "identify excite --method best --out model.json",
        "identify excite --method pbsid --out era.json",
        "identify excite --method pbsid --validate 0.5 --out pbsid.json",
    ):
        done = subprocess.run(
            [sys.executable, "-c", COUNTED, *command.split()], capture_output=True, text=True, check=False, cwd=tmp_path
        )
        assert "compiled 0.000" in done.stderr, (command, done.stdout, done.stderr)


@pytest.mark.slow
@pytest.mark.skipif("TREADLINE_SLOW" not in os.environ, reason="make slow runs this: it compiles everything anew")
def test_no_kernel_is_compiled_in_both_processes(tmp_path: Path) -> None:
    """Test: each half of the kernels with a cache of its own. Expected result: no file in common; numba's files have no lock."""
    halves = [tmp_path / str(k) for k in range(2)]
    for k, folder in enumerate(halves):
        source = f"from treadline.cli.compile import GROUPS; list(GROUPS.values())[{k}]()"
        subprocess.run([sys.executable, "-c", source], env=os.environ | {"NUMBA_CACHE_DIR": str(folder)}, check=True)
    detection, simulation = ({path.name for path in folder.rglob("*.nbi")} for folder in halves)
    assert min(len(detection), len(simulation)) > 30
    assert not detection & simulation
