"""Results of a campaign: tables, and their summary: verdicts with exact bounds, scores, and the worst runs.

``runs.csv`` always, ``runs.parquet`` with pyarrow; times separately, because they vary between repetitions.
"""

import csv
import io
import json
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from treadline.campaign.pool import TIMES, VIEW, Row
from treadline.core.models import write_whole, written_whole

CONFIDENCE = 0.95
FAILED = ("fell", "diverged", "crashed", "error")
"""Verdicts that must not occur in a campaign."""
NOT_SCORES = ("index", "seed", "events")
DISTANCE = "climbed_m"
"""Distance score; negative on the way down, and the shortest distance is the worst."""


def clopper_pearson(count: int, total: int, confidence: float = CONFIDENCE) -> tuple[float, float]:
    """Return the exact two-sided confidence bounds of a proportion.

    Clopper and Pearson, 1934: proportions for which ``count`` or more, and ``count`` or fewer, of ``total`` have a probability of
    half of the complement. The coverage is at least the nominal one, also at 0 and at ``total``.
    """
    from scipy.special import betaincinv  # quantile of the beta distribution; importing scipy.stats takes a second

    tail = 0.5 * (1.0 - confidence)
    low = float(betaincinv(count, total - count + 1, tail)) if count else 0.0
    high = float(betaincinv(count + 1, total - count, 1.0 - tail)) if count < total else 1.0
    return low, high


def summarise(rows: Sequence[Row], drawn: Sequence[str], choices: Sequence[str], score: str) -> dict[str, Any]:
    """Return the summary of flat rows.

    Scores include only runs that drove: the heading of a refused chair on the floor has no meaning.

    Args:
        rows: Flat rows of all runs.
        drawn: Columns that are not scores.
        choices: Columns by which verdicts are counted.
        score: Score that ranks the worst runs.
    """
    verdicts = Counter(row["verdict"] for row in rows)
    return {
        "runs": len(rows),
        "verdicts": {name: _share(verdicts[name], len(rows)) for name in sorted({*verdicts, "arrived", "fell"})},
        "by": {key: _crossed(rows, key) for key in choices},
        "causes": dict(Counter(_kind(row) for row in rows if row["verdict"] != "arrived").most_common(20)),
        "scores": _scores([row for row in rows if row["verdict"] != "refused"], drawn),
        "score": score,
        "worst": [_short(row, score) for row in worst(rows, score)],
    }


def worst(rows: Sequence[Row], score: str, count: int = 10) -> list[Row]:
    """Return the worst runs: falls, then failures, then by the score."""
    rank = {"fell": 0} | dict.fromkeys(FAILED[1:], 1)
    return sorted(rows, key=lambda row: (rank.get(row["verdict"], 2), harm(row, score), row["index"]))[:count]


def harm(row: Mapping[str, Any], score: str) -> float:
    """Return the score with the sign for which lower is worse; a run without the score is harmless."""
    value = row.get(score)
    if not isinstance(value, int | float):
        return 1e9
    if score == DISTANCE:
        return abs(float(value))
    return float(value) if lower_is_worse(score) else -float(value)


def lower_is_worse(score: str) -> bool:
    """Whether a lower score is worse, as for margins and distances, but not for rates."""
    return score.startswith("min_") or "margin" in score or score == DISTANCE


def has_rms(score: str) -> bool:
    """Whether an RMS over runs is meaningful: for scores that are RMS values themselves, not for times or margins."""
    return "rms_" in score


def _share(count: int, total: int) -> dict[str, Any]:
    return {"count": count, "share": count / max(total, 1), "bounds": list(clopper_pearson(count, total))}


def _crossed(rows: Sequence[Row], key: str) -> dict[str, dict[str, int]]:
    found = sorted({str(row.get(key)) for row in rows})
    return {value: dict(sorted(Counter(row["verdict"] for row in rows if str(row.get(key)) == value).items())) for value in found}


def _kind(row: Row) -> str:
    """Return a cause without its numbers, so that similar causes are counted together."""
    words = [word for word in str(row.get("cause")).split(";")[0].split() if not any(letter.isdigit() for letter in word)]
    return f"{row['verdict']}: {' '.join(words[:8])}"


def _scores(rows: Sequence[Row], drawn: Sequence[str]) -> dict[str, dict[str, Any]]:
    names = dict.fromkeys(name for row in rows for name in row)
    return {name: figures for name in names if name not in {*drawn, *NOT_SCORES} and (figures := _figures(rows, name))}


def _figures(rows: Sequence[Row], name: str) -> dict[str, Any] | None:
    """Return the statistics of a numeric column, or None for another column."""
    found = [(float(row[name]), row["index"]) for row in rows if type(row.get(name)) in (int, float)]
    if not found:
        return None
    values = np.array([value for value, _ in found])
    sizes = np.abs(values) if name == DISTANCE or not lower_is_worse(name) else values
    bad = int(np.argmin(sizes) if lower_is_worse(name) else np.argmax(sizes))
    return {
        "count": len(found),
        "mean": float(values.mean()),
        "rms": float(np.sqrt(np.mean(values**2))),
        "min": float(values.min()),
        **{word: float(np.percentile(values, q)) for word, q in (("p1", 1), ("p5", 5), ("median", 50), ("p95", 95), ("p99", 99))},
        "max": float(values.max()),
        "worst": found[bad][0],
        "worst_run": found[bad][1],
    }


def _short(row: Row, score: str) -> dict[str, Any]:
    return {name: row.get(name) for name in ("index", "seed", "verdict", "cause", score)}


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
