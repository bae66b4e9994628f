"""The command line as a caller has it: arguments in; exit code, stdout and stderr out."""

import errno
import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from treadline.cli import main


@dataclass(frozen=True)
class Outcome:
    code: int
    out: str
    err: str

    @property
    def values(self) -> dict[str, Any]:
        value: dict[str, Any] = json.loads(self.out)
        return value


Run = Callable[..., Outcome]


def assert_refused(outcome: Outcome, *words: str) -> None:
    """Assert exit code 2 and one line on stderr, which holds the words."""
    assert (outcome.code, outcome.out) == (2, ""), outcome
    assert outcome.err.count("\n") == 1, outcome.err
    assert outcome.err.startswith("treadline: ")
    for word in words:
        assert word in outcome.err, outcome.err


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str]) -> Run:
    def call(*arguments: object) -> Outcome:
        code = main([str(argument) for argument in arguments])
        captured = capsys.readouterr()
        return Outcome(code=code, out=captured.out, err=captured.err)

    return call


@pytest.fixture
def no_room_for(monkeypatch: pytest.MonkeyPatch) -> Callable[[str], None]:
    """Fill the disk for files whose name begins so."""
    write = Path.write_bytes

    def fill(beginning: str) -> None:
        def full(path: Path, data: bytes) -> int:
            if path.name.startswith(beginning):
                write(path, data[: len(data) // 2])
                raise OSError(errno.ENOSPC, "No space left on device")  # as write(2) fails: it knows no name
            return write(path, data)

        monkeypatch.setattr(Path, "write_bytes", full)

    return fill
