"""Decision records: standard headings, at most 40 lines, listed in the index."""

from pathlib import Path

import pytest

DECISIONS = Path(__file__).parents[2] / "docs" / "decisions"
RECORDS = sorted(DECISIONS.glob("[0-9]*.md"))
LONGEST = 40
"""Lines of a record, by the language rules of the project."""
LEFT = {7, 20}
"""Numbers of records that left with version 0.3: one was superseded by 0012, one withdrawn. They are not used again."""


@pytest.mark.parametrize("record", RECORDS, ids=lambda path: path.stem)
def test_a_record_has_the_standard_form(record: Path) -> None:
    lines = record.read_text(encoding="utf-8").splitlines()
    assert lines[0].startswith(f"# {record.name[:4]}: ")
    assert len(lines) <= LONGEST
    assert [line for line in lines if line.startswith("## ")] == ["## Context", "## Decision", "## Consequences"]


def test_numbers_are_used_once_and_only_those_of_records_that_left_are_missing() -> None:
    numbers = [int(path.name[:4]) for path in RECORDS]
    assert len(set(numbers)) == len(numbers)
    assert set(range(1, max(numbers) + 1)) - set(numbers) == LEFT


def test_the_index_lists_every_record() -> None:
    index = (DECISIONS / "index.md").read_text(encoding="utf-8")
    assert [path.name for path in RECORDS if f"({path.name})" not in index] == []
