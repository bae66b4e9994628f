"""Result tables: ``runs.csv`` always, ``runs.parquet`` with pyarrow; times separately, because they vary between repetitions."""

import csv
import io
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from treadline.campaign.sampled_run import TIMES, VIEW, Row
from treadline.core.models import write_whole, written_whole


def write_tables(folder: Path, rows: Sequence[Row]) -> list[Path]:
    """Write the results in the given order and the times next to them; return the result files."""
    results = [flat(row) for row in rows]
    _write_csv(folder / "runs.csv", results)
    _write_csv(folder / "times.csv", [{name: row.get(name) for name in ("index", *TIMES)} for row in rows])
    parquet = _write_parquet(folder / "runs.parquet", results)
    return [folder / "runs.csv", *([folder / "runs.parquet"] if parquet else [])]


def flat(row: Mapping[str, Any], prefix: str = "") -> Row:
    """Return a row of single values: tables with dotted names, lists of numbers as JSON, events counted, no times, no poses."""
    values: Row = {}
    for key, value in row.items():
        name = prefix + key
        if name in TIMES or name == VIEW:
            continue
        if isinstance(value, Mapping):
            values |= flat(value, f"{name}.")
        elif isinstance(value, list):
            values[name] = len(value) if name == "events" else json.dumps(value)
        else:
            values[name] = value
    return values


def _columns(rows: Sequence[Row]) -> list[str]:
    return list(dict.fromkeys(name for row in rows for name in row))


def _write_csv(path: Path, rows: Sequence[Row]) -> None:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    names = _columns(rows)
    writer.writerow(names)
    writer.writerows([[_cell(row.get(name)) for name in names] for row in rows])
    write_whole(path, text.getvalue())


def _cell(value: object) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    return "" if value is None else str(value)


def _write_parquet(path: Path, rows: Sequence[Row]) -> bool:
    try:
        import pyarrow as pa
        from pyarrow import parquet
    except ImportError:
        return False
    columns = {name: _of_one_kind([row.get(name) for row in rows]) for name in _columns(rows)}
    with written_whole(path) as part:
        parquet.write_table(pa.table(columns), part, compression="zstd")
    return True


def _of_one_kind(values: list[Any]) -> list[Any]:
    """Return a column with a single type: mixed numbers become floats, any other mixture strings."""
    kinds = {type(value) for value in values if value is not None}
    if kinds == {int, float}:
        return [None if value is None else float(value) for value in values]
    return values if len(kinds) <= 1 else [None if value is None else str(value) for value in values]
