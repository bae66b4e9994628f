"""Progress where no person watches: a few plain lines, however many parts there are."""

import pytest

from treadline.cli._output import Progress


@pytest.mark.parametrize(("parts", "lines"), [(1, 1), (12, 12), (20, 20), (21, 20), (4000, 20)])
def test_a_job_of_many_parts_is_reported_in_a_few_lines(capsys: pytest.CaptureFixture[str], parts: int, lines: int) -> None:
    with Progress("frames", parts) as progress:
        for number in range(parts):
            progress.done(f"{number:05d}")
    told = capsys.readouterr().err.splitlines()
    assert len(told) == lines
    assert f" {parts}/{parts} {parts - 1:05d}" in told[-1]
