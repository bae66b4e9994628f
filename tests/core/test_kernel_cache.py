"""Compiled kernels: a damaged file is found and mended, the result is right in any case, and the time of compiling is known."""

import re
import runpy
import shutil
import time
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numba
import numpy as np
import pytest
from numba.core import event

from treadline.core.kernel_cache import compiling, njit, warn_once


def cube(x: Any) -> Any:
    return x * x * x


@pytest.fixture(autouse=True)
def _fresh_log(monkeypatch: pytest.MonkeyPatch) -> None:
    warn_once.cache_clear()
    monkeypatch.setattr("treadline.core.kernel_cache.LONG_S", 1e9)  # whether this machine has compiled before


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
    assert re.search(r"damaged, \w+\); it is compiled again", line)
    assert call()
    assert other.exists()


def test_any_wrong_byte_gives_the_right_result(files: dict[str, Path]) -> None:
    for place in np.random.default_rng(0).random(12).tolist():
        for path in files.values():
            if path.exists():
                flip(path, place)
        call()


KERNEL = """
from treadline.core.kernel_cache import njit

@njit(cache=True)
def scaled(x):
    return FACTOR * x
"""


def test_data_of_an_older_source_under_a_new_index_are_not_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Test: old data next to a new index, as a process killed between the two leaves them. Expected result: the new source's."""
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "cache"))
    script, contents = tmp_path / "script.py", []
    for factor in ("2", "3"):
        script.write_text(KERNEL.replace("FACTOR", factor))
        assert runpy.run_path(str(script))["scaled"](1.0) == float(factor)
        (data,) = (tmp_path / "cache").rglob("*.nbc")
        contents.append(data.read_bytes())
    data.write_bytes(contents[0])
    assert [runpy.run_path(str(script))["scaled"](1.0) for _ in range(2)] == [3.0, 3.0]


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
    assert str(error.args[-1] if error.args else "MemoryError") in line
    assert "NUMBA_CACHE_DIR" in line
    assert all(path.exists() for path in files.values())


def test_nested_compilation_counts_once_and_is_reported_once(monkeypatch: pytest.MonkeyPatch, caplog) -> None:
    monkeypatch.setattr("treadline.core.kernel_cache.LONG_S", 0.15)
    before_s = compiling().spent_s
    for _ in range(3):
        with event.trigger_event("numba:compile"), event.trigger_event("numba:compile"):
            until = time.process_time() + 0.1
            while time.process_time() < until:
                pass
    # Nested once: twice would be 0.6 s; the clock of a busy machine ticks coarsely.
    assert 0.3 <= compiling().spent_s - before_s < 0.45
    assert ["compiling for this machine" in line for line in caplog.messages] == [True]
