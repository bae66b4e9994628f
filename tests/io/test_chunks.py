"""Chunks: their concatenation is the record, and errors at a border are detected."""

import tracemalloc
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from treadline.core.errors import LogFormatError, PeriodMismatch, SettingsError
from treadline.core.models import InputOutputRecord
from treadline.io import _csv_files as files
from treadline.io.records import ChunkReader

KINDS = ("csv", "spreadsheet", "parquet")


@pytest.fixture
def tiny_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Read CSV in blocks of five lines."""
    monkeypatch.setattr(files, "BLOCK_ROWS", 5)


def chunks_of(log, **options: object) -> ChunkReader:
    return ChunkReader(log.path, log.inputs, log.outputs, **options)


@pytest.mark.usefixtures("tiny_blocks")
@pytest.mark.parametrize("kind", KINDS)
def test_the_fraction_grows_to_one_and_a_second_pass_is_the_first(written, record: InputOutputRecord, kind: str) -> None:
    reader = chunks_of(written(kind, record), rows=5)
    for _ in range(2):
        seen = [(reader.fraction, len(part)) for part in reader]
        assert seen == sorted(seen)
        assert [length for _, length in seen] == [5] * 8
        assert reader.fraction == 1.0


@pytest.mark.usefixtures("tiny_blocks")
def test_what_came_before_a_fault_has_been_yielded(tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text("\n".join(["t_s,u,y", *(f"{0.25 * k},{k},{k}" for k in range(25)), "x,x,x"]))
    reader = iter(ChunkReader(tmp_path / "log.csv", ("u",), ("y",), rows=4))
    assert next(reader).u[:, 0].tolist() == [0, 1, 2, 3]
    with pytest.raises(LogFormatError):
        list(reader)


def test_a_stream_needs_rows_a_period_and_a_kind_that_streams(written, record: InputOutputRecord) -> None:
    with pytest.raises(SettingsError, match="two"):
        chunks_of(written("csv", record), rows=1)
    with pytest.raises(LogFormatError, match="CSV, Parquet and Feather"):
        chunks_of(written("npz", record))
    with pytest.raises(PeriodMismatch, match="--period"):
        chunks_of(written("csv", record), period_s=-1.0)


@pytest.mark.usefixtures("tiny_blocks")
@pytest.mark.parametrize("kind", KINDS)
def test_a_stream_holds_a_chunk_and_not_the_file(
    written, record: InputOutputRecord, monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    long = replace(record, u=np.tile(record.u, (400, 1)), y=np.tile(record.y, (400, 1)))
    monkeypatch.setattr(files, "BLOCK_ROWS", 200)
    reader = chunks_of(written(kind, long), rows=200)
    tracemalloc.start()
    try:
        assert sum(len(part) for part in reader) == len(long)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    # As floats alone the file is 510 kB, as text a megabyte.
    assert peak < 400_000


def test_a_file_without_lines_is_not_held_in_memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(files, "MAX_LINE", 8000)
    (tmp_path / "log.csv").write_bytes(b"1" * 100_000)
    with pytest.raises(LogFormatError, match="longer than 8000 characters"):
        list(ChunkReader(tmp_path / "log.csv", ("u",), ("y",)))
