"""Compiled kernels: a damaged file is found and mended, the result is right in any case, and the time of compiling is known."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import patch

import numba
import numpy as np
import pytest
from numba.core import event

from treadline.core.kernel_cache import CompileTimer, compiling, njit


def cube(x: Any) -> Any:
    return x * x * x


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of a compiled kernel."""
    folder = tmp_path_factory.mktemp("kernels")
    with patch.object(numba.config, "CACHE_DIR", str(folder)):
        assert njit(cache=True)(cube)(3.0) == 27.0
    return folder


@pytest.fixture
def files(kept: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, Path]:
    """Return index and data of the kernel in a folder of its own."""
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))
    shutil.copytree(kept, tmp_path, dirs_exist_ok=True)
    return {path.suffix: path for path in tmp_path.rglob("*.nb?")}


def call() -> bool:
    """Call the kernel as a new process does; return whether it was loaded."""
    kernel: Any = njit(cache=True)(cube)
    assert kernel(3.0) == 27.0
    return bool(kernel.stats.cache_hits)


def flip(path: Path, place: float) -> None:
    content = bytearray(path.read_bytes())
    content[int(place * len(content))] ^= 1
    path.write_bytes(content)


@pytest.mark.parametrize(("ending", "kept_share"), [(".nbi", 0.0), (".nbi", 0.5), (".nbc", 0.0), (".nbc", 0.5), (".nbc", 1.0)])
def test_a_damaged_file_is_removed_and_the_kernel_compiled_again(
    files: dict[str, Path], caplog: pytest.LogCaptureFixture, ending: str, kept_share: float
) -> None:
    assert call()
    other = files[ending].with_name("other.kernel-1.py311.nbi")
    other.write_bytes(b"")
    content = files[ending].read_bytes()
    files[ending].write_bytes(content[: int(kept_share * len(content))])
    if kept_share == 1.0:
        flip(files[ending], 0.5)
    assert not call()
    (line,) = caplog.messages
    assert "test_kernel_cache.cube: a damaged file" in line
    assert "compiled again" in line
    assert call()
    assert other.exists()


def test_any_wrong_byte_gives_the_right_result(files: dict[str, Path]) -> None:
    for place in np.random.default_rng(0).random(12).tolist():
        for path in files.values():
            if path.exists():
                flip(path, place)
        call()


def test_data_of_another_kernel_under_this_name_are_not_run(files: dict[str, Path]) -> None:
    def square(x: Any) -> Any:
        return x * x

    njit(cache=True)(square)(3.0)
    (other,) = (path for path in files[".nbc"].parent.glob("*square*.nbc"))
    files[".nbc"].write_bytes(other.read_bytes())
    assert not call()


KERNEL = """
import os, signal, sys
from treadline.core.kernel_cache import njit

@njit(cache=True)
def factor(x):
    return FACTOR * x

replace, left = os.replace, [int(sys.argv[1])]
def killed(*names):
    left[0] -= 1
    if left[0] == 0:
        os.kill(os.getpid(), signal.SIGKILL)
    replace(*names)
os.replace = killed
print(factor(1.0))
"""


@pytest.mark.skipif(sys.platform == "win32", reason="there is no SIGKILL")
@pytest.mark.parametrize("write", [1, 2])
def test_a_process_killed_while_it_writes_leaves_no_old_code_under_a_new_index(tmp_path: Path, write: int) -> None:
    """Test: a kernel kept, its source changed, a kill in the index's or the data's write. Expected result: the new source's."""
    script = tmp_path / "script.py"

    def run(factor: int, kill_at: int) -> subprocess.CompletedProcess[str]:
        script.write_text(KERNEL.replace("FACTOR", str(factor)))
        env = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "cache")}
        return subprocess.run([sys.executable, script, str(kill_at)], capture_output=True, text=True, env=env, check=False)

    assert run(2, 0).stdout == "2.0\n"
    assert run(3, write).returncode == -signal.SIGKILL
    assert [run(3, 0).stdout for _ in range(2)] == ["3.0\n", "3.0\n"]


def test_without_a_folder_that_can_be_written_a_kernel_runs_and_the_remedy_is_said(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(numba.config, "CACHE_LOCATOR_CLASSES", "IPythonCacheLocator")  # as where no folder can be written
    assert [call() for _ in range(2)] == [False, False]
    assert ["NUMBA_CACHE_DIR" in line for line in caplog.messages] == [True]


@pytest.mark.parametrize("place", ["numba.core.caching.open", "os.replace"])
@pytest.mark.parametrize("error", [PermissionError(13, "Permission denied"), OSError(24, "Too many open files"), MemoryError()])
def test_a_file_that_the_system_refuses_ends_no_run_and_is_not_removed(
    files: dict[str, Path], caplog: pytest.LogCaptureFixture, place: str, error: Exception
) -> None:
    with patch(place, create=True, side_effect=error):
        assert [njit(cache=True)(cube)(3) for _ in range(2)] == [27, 27]
    (line,) = caplog.messages
    assert f"kept: {error.args[-1] if error.args else 'no memory'}; if that stays so, set NUMBA_CACHE_DIR" in line
    assert all(path.exists() for path in files.values())


def test_nested_compilation_counts_once_and_each_own_kernel_is_reported_once() -> None:
    watch, reported = CompileTimer(), list[float]()
    watch.on_kernel = lambda: reported.append(watch.spent_s)
    ours, foreign = ({"dispatcher": SimpleNamespace(py_func=function)} for function in (compiling, json.dumps))
    with event.install_listener("numba:compile", watch):
        for _ in range(3):
            with event.trigger_event("numba:compile", data=ours), event.trigger_event("numba:compile", data=foreign):
                until = time.process_time() + 0.1
                while time.process_time() < until:
                    pass
    assert 0.3 <= watch.spent_s < 0.45  # nested once: twice would be 0.6; the clock of a busy machine ticks coarsely
    assert reported == [pytest.approx(0.1, abs=0.05)]
    assert compiling() is compiling()
