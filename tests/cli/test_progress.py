"""Progress where no person watches: a few plain lines, however many parts there are."""

import contextlib
import io
import time

import pytest

from treadline.cli import _output
from treadline.cli._output import Progress


@pytest.mark.parametrize(("parts", "lines"), [(1, 1), (12, 12), (20, 20), (21, 20), (4000, 20)])
def test_a_job_of_many_parts_is_reported_in_a_few_lines(capsys: pytest.CaptureFixture[str], parts: int, lines: int) -> None:
    with Progress("frames", parts) as progress:
        for number in range(parts):
            progress.done(f"{number:05d}")
    declared = capsys.readouterr().err.splitlines()
    assert len(declared) == lines
    assert f" {parts} of {parts}: {parts - 1:05d}" in declared[-1]


def test_a_silent_job_soon_says_what_runs(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """Test: a job silent for as long as may be, here half a second. Expected: one line, on the stream at its start."""
    assert _output.SILENCE_S < 10.0
    monkeypatch.setattr(_output, "SILENCE_S", 0.5)
    with Progress("reproduce", 3) as progress, contextlib.redirect_stderr(io.StringIO()):
        progress.running("Table II, 28°, from +30°")
        time.sleep(0.9)
    (line,) = capsys.readouterr().err.splitlines()
    assert "0 of 3: running Table II, 28°, from +30°" in line
