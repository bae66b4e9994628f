"""Golden files: logs as spreadsheets, loggers, ROS tools and MATLAB write them, and damaged ones, read or refused in one line.

``golden.toml`` says for each file what reading it gives. The recorded files in ``wild`` hold the same 60 rows; others are written
from the table.
"""

import gzip
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bags import bag, one_topic
from scipy.io import savemat

from treadline.core import errors
from treadline.io import _csv_files
from treadline.io.records import ARROW, DELIMITED, ChunkReader, read_record

TABLE = Path(__file__).with_name("golden.toml")
ROWS, PERIOD_S = 60, 0.05
VALUES = np.round(np.random.default_rng(42).uniform(-1.0, 1.0, (ROWS, 3)), 3)
"""Columns left, right and yaw of each recorded file."""
LEFT, RIGHT, YAW = VALUES.T
T = PERIOD_S * np.arange(ROWS)
ARRAYS: dict[str, np.ndarray] = {
    "t": T,
    "left": LEFT,
    "right": RIGHT,
    "yaw": YAW,
    "u": VALUES[:, :2],
    "y": VALUES[:, 2:],
    "t row": T[None],
    "left column": LEFT[:, None],
    "yaw row": YAW[None],
    "59": T[:59],
    "none": T[:0],
    "2 x 60": VALUES[:, :2].T,
    "cube": np.ones((ROWS, 2, 2)),
    "complex": 1j * LEFT,
    "letters": np.array(["a"] * ROWS),
    "moments": np.datetime64("2024-01-31T23:00:00", "ns") + np.arange(ROWS) * np.timedelta64(50, "ms"),
    "hole": np.where(np.arange(ROWS) == 5, np.nan, T),
    "gaps": np.where(np.arange(ROWS) < 24, np.nan, LEFT),
    "cells": np.array(["a"], object),
    "words": np.array("seconds"),
}
"""Arrays that the table names."""
HOW = ("period_s", "resample", "allow_gaps")


READ, REFUSED = (
    {name + suffix: case for name, case in section.items() for suffix in case.get("suffixes", ("",))}
    for section in tomllib.loads(TABLE.read_text(encoding="utf-8")).values()
)
"""Files by name, one for each of their suffixes."""


def arrays_of(table: dict[str, Any]) -> dict[str, Any]:
    """Return the arrays that a table names; numbers stand for themselves, tables for structs."""
    return {
        name: arrays_of(given) if isinstance(given, dict) else ARRAYS[given] if isinstance(given, str) else given
        for name, given in table.items()
    }


def write_arrays(path: Path, arrays: dict[str, Any]) -> None:
    if path.suffix == ".npz":
        np.savez(path, **arrays)
    elif path.suffix == ".mat":
        savemat(path, arrays)
    else:
        arrow = pytest.importorskip("pyarrow", reason="pyarrow is an extra")
        from pyarrow import feather, parquet

        write = {".parquet": parquet.write_table, ".feather": feather.write_feather}[path.suffix]
        write(arrow.table(arrays), path)


def channel(given: Any) -> list[tuple[float, float]]:
    """Return times and values; a table stands for counting at a constant rate."""
    if isinstance(given, dict):
        return [(given.get("start", 0.0) + given["step"] * k, float(k)) for k in range(given["count"])]
    return [(t_s, value) for t_s, value in given]


def made(path: Path, case: dict[str, Any]) -> Path:
    """Return the file of a case: written, or recorded."""
    match case:
        case {"text": text}:
            path.write_text(text, encoding="utf-8")
        case {"arrays": arrays}:
            write_arrays(path, arrays_of(arrays))
        case {"channels": channels}:
            stamps = {name: [t for t, _ in channel(it)] for name, it in channels.items() if "stamped" in it}
            bag(path, stamps=stamps, **{name: channel(given) for name, given in channels.items()})
        case {"topic": topic}:
            one_topic(path, **topic)
        case {"packed": name}:
            path.write_bytes(gzip.compress((TABLE.with_name("wild") / name).read_bytes()))
        case _:
            return TABLE.with_name("wild") / path.name
    return path


def read(path: Path, case: dict[str, Any], reader: Callable[..., Any] = read_record, **options: Any) -> Any:
    inputs, outputs = case.get("inputs", ("left", "right")), case.get("outputs", ("yaw",))
    return reader(path, tuple(inputs), tuple(outputs), **{name: case[name] for name in HOW if name in case}, **options)


@pytest.mark.parametrize("name", READ)
def test_a_file_is_read_exactly(tmp_path: Path, name: str) -> None:
    """Test: the file by its channels. Expected: the values; of the first input rows ``gaps`` missing, true or false (``flags``)."""
    case, values = READ[name], VALUES.copy()
    values[case.get("gaps", []), 0] = np.nan
    if case.get("flags"):
        values[:, 0] = np.arange(ROWS) % 7 < 3
    values = np.array(case.get("gives", values), dtype=float)
    record = read(made(tmp_path / name, case), case)
    # Only interpolation rounds.
    np.testing.assert_allclose(np.column_stack([record.u, record.y]), values, rtol=0.0, atol=1e-15 if "channels" in case else 0.0)
    assert record.dt_s == case.get("period", PERIOD_S)
    assert record.u.shape == (len(values), values.shape[1] - 1)


def chunked(section: dict[str, Any]) -> list[str]:
    """Return the files that are read in chunks, of which none is resampled."""
    return [name for name, case in section.items() if Path(name).suffix in (*DELIMITED, *ARROW) and "resample" not in case]


@pytest.fixture(params=[2, 3, 7])
def in_chunks(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Callable[[Path, dict[str, Any]], Any]:
    """Read in chunks of so many rows, and text in blocks of five lines."""
    monkeypatch.setattr(_csv_files, "BLOCK_ROWS", 5)

    def parts_of(path: Path, case: dict[str, Any]) -> list[Any]:
        parts = list(read(path, case, ChunkReader, rows=request.param))
        assert all(len(part) <= request.param for part in parts)
        return parts

    return parts_of


@pytest.mark.parametrize("name", chunked(READ))
def test_chunks_of_a_file_are_its_record(tmp_path: Path, in_chunks, name: str) -> None:
    case = READ[name]
    path = made(tmp_path / name, case)
    whole, parts = read(path, case), in_chunks(path, case)
    assert {part.dt_s for part in parts} == {whole.dt_s}
    assert np.concatenate([part.u for part in parts]).tobytes() == whole.u.tobytes()
    assert np.concatenate([part.y for part in parts]).tobytes() == whole.y.tobytes()


@pytest.mark.parametrize("name", chunked(REFUSED))
def test_a_fault_is_named_with_its_line_whichever_chunk_it_is_in(tmp_path: Path, in_chunks, name: str) -> None:
    case = REFUSED[name]
    with pytest.raises(getattr(errors, case.get("error", "TreadlineError")), match=case.get("in_chunks", case["says"])):
        in_chunks(made(tmp_path / name, case), case)


@pytest.mark.parametrize("name", REFUSED)
def test_a_file_that_cannot_be_read_is_refused_in_one_line_with_the_remedy(tmp_path: Path, name: str) -> None:
    case = REFUSED[name]
    with pytest.raises(getattr(errors, case.get("error", "TreadlineError")), match=case["says"]) as caught:
        read(made(tmp_path / name, case), case)
    assert name in str(caught.value)
    assert "\n" not in str(caught.value)


def test_an_uneven_clock_is_resampled_where_that_is_asked(tmp_path: Path) -> None:
    assert len(read(made(tmp_path / "jitter.csv", {}), {"resample": True, "period_s": PERIOD_S})) == ROWS
    # 59 steps, each within the tolerance.
    assert len(read(made(tmp_path / "comma-blank.csv", {}), {"resample": True, "period_s": PERIOD_S / 1.02})) == ROWS + 1


@pytest.mark.parametrize("unit", [1, 10**3, 10**6, 10**9])
def test_the_period_decides_the_unit_of_a_clock_that_names_none(tmp_path: Path, unit: int) -> None:
    times = unit * np.arange(ROWS) // 20 if unit > 1 else T
    np.savetxt(tmp_path / "log.csv", np.column_stack([times, VALUES]), "%.15g", ",", header="time,left,right,yaw", comments="")
    assert read(tmp_path / "log.csv", {"period_s": PERIOD_S}).dt_s == PERIOD_S
