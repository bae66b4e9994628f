"""``treadline compile``: what becomes of a failure in one of its two processes."""

import os
import re
from functools import partial
from pathlib import Path

import pytest

from treadline.cli import compile as module

from .conftest import Run


@pytest.fixture
def marker(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    path = tmp_path / "marker"
    monkeypatch.setattr("treadline.core.compile_cache.marker_path", lambda: path)
    return path


def test_a_killed_process_ends_the_command(run: Run, marker: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "GROUPS", {"stair detection": os.abort})
    outcome = run("compile")
    assert outcome.code == 2
    assert re.search(r"\Atreadline: .*stair detection was killed.*memory", outcome.err.splitlines()[-1])
    assert not marker.exists()


def test_an_error_in_a_process_is_the_commands_error(run: Run, marker: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "GROUPS", {"one": partial(os.listdir, "/nowhere"), "other": os.getpid})
    outcome = run("compile")
    assert outcome.code == 2
    assert re.search(r"\Atreadline: /nowhere: No such file", outcome.err.splitlines()[-1])
    assert not marker.exists()


def test_what_is_compiled_is_not_compiled_again(run: Run, marker: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "GROUPS", {"one": os.getpid, "other": os.getppid})
    assert run("compile", "--json").values["compiled"]
    assert marker.exists()
    assert not run("compile", "--json").values["compiled"]


class DamagedKernel:
    name = "treadline.plant.kernels.step"

    def __init__(self) -> None:
        self.error: Exception | None = ValueError("wrong checksum")

    def state(self) -> bool | Exception:
        return self.error or False

    def remove(self, error: Exception) -> None:
        assert error is self.error
        self.error = None


def test_a_damaged_kernel_is_named_by_doctor_and_made_again_by_compile(
    run: Run, marker: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    kernel = DamagedKernel()
    monkeypatch.setattr("treadline.core.kernel_cache.kernel_caches", lambda: [kernel])
    monkeypatch.setattr(module, "GROUPS", {"one": os.getpid, "other": os.getppid})
    marker.touch()
    assert "damaged: treadline.plant.kernels.step; to mend them: treadline compile\n" in run("doctor").out
    assert run("doctor", "--json").values["kernels"] == {"loaded": [], "damaged": [kernel.name], "missing": []}
    answer = run("compile", "--json").values
    assert (answer["compiled"], answer["mended"]) == (True, [kernel.name])
    assert "damaged" not in run("doctor").out
