"""Files of compiled kernels: damage is found, said in one line and mended; the result is right in any case."""

import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
import numpy as np
import pytest

from treadline.core.compile_cache import marker_path
from treadline.core.errors import TreadlineError
from treadline.core.kernel_cache import njit


def cube(x: Any) -> Any:
    return x * x * x


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """Return the files of a compiled kernel by their ending."""
    folder = tmp_path_factory.mktemp("kernels")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(numba.config, "CACHE_DIR", str(folder))
        assert njit(cache=True)(cube)(3.0) == 27.0
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*.nb?")}


@pytest.fixture
def files(kept: dict[str, bytes], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, Path]:
    """Return index and data of the kernel in a folder of its own."""
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))
    for name, content in kept.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes(content)
    return {path.suffix: path for path in tmp_path.rglob("*.nb?")}


def call() -> bool:
    """Call the kernel as a new process does; return whether it was loaded."""
    kernel: Any = njit(cache=True)(cube)
    assert kernel(3.0) == 27.0
    return bool(kernel.stats.cache_hits)


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def flip(path: Path, place: float = 0.5) -> None:
    content = bytearray(path.read_bytes())
    content[int(place * len(content))] ^= 1
    path.write_bytes(content)


def link_to_itself(path: Path) -> None:
    path.unlink()
    path.symlink_to(path)  # reading fails, also for root


DAMAGES: dict[str, tuple[str, Callable[[Path], None]]] = {
    "an emptied index": (".nbi", lambda path: path.write_bytes(b"")),
    "a truncated index": (".nbi", cut),
    "an unreadable index": (".nbi", link_to_itself),
    "emptied data": (".nbc", lambda path: path.write_bytes(b"")),
    "truncated data": (".nbc", cut),
    "a wrong byte in the machine code": (".nbc", flip),
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_file_is_removed_and_the_kernel_compiled_again(
    files: dict[str, Path], caplog: pytest.LogCaptureFixture, damage: str
) -> None:
    assert call()
    ending, apply = DAMAGES[damage]
    other = files[ending].with_name("other.kernel-1.py311.nbi")
    other.write_bytes(b"")
    apply(files[ending])
    assert not call()
    (line,) = caplog.messages
    assert "test_kernel_cache.cube: a damaged file" in line
    assert "compiled again" in line
    assert "\n" not in line
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
        command = [sys.executable, script, str(kill_at)]
        return subprocess.run(command, capture_output=True, text=True, env=env, check=False)

    assert run(2, 0).stdout == "2.0\n"
    assert run(3, write).returncode == -signal.SIGKILL
    for _ in range(2):
        after = run(3, 0)
        assert (after.stdout, after.stderr) == ("3.0\n", "")


def test_without_a_folder_that_can_be_written_a_kernel_runs_and_the_remedy_is_said(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(numba.config, "CACHE_LOCATOR_CLASSES", "IPythonCacheLocator")  # as where no folder can be written
    assert [call() for _ in range(2)] == [False, False]
    assert [line for line in caplog.messages if "NUMBA_CACHE_DIR" in line] == caplog.messages
    assert len(caplog.messages) == 1
    with pytest.raises(TreadlineError, match="set NUMBA_CACHE_DIR"):
        marker_path()


def test_a_folder_that_stops_being_writable_ends_no_run(
    files: dict[str, Path], monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError(13, "Permission denied")

    kernel: Any = njit(cache=True)(cube)
    monkeypatch.setattr(os, "replace", refuse)
    assert kernel(3) == 27
    (line,) = caplog.messages
    assert "cannot be kept: Permission denied; set NUMBA_CACHE_DIR" in line
    assert files[".nbi"].exists()
