"""Results of a campaign: tables, and their summary: verdicts with exact bounds, scores, the worst runs, and the failure frontier.

``runs.csv`` always, ``runs.parquet`` with pyarrow; times separately, because they vary between repetitions.

The frontier is over the two drawn quantities whose values separate failed from other runs best (Mann-Whitney U, as area under the
ROC curve), among quantities that do not follow from each other. The share of failed runs follows from a logistic regression with
linear, quadratic and product terms; the frontier is its contour. Where few runs fail, the contour is an extrapolation: the page
draws every run next to it.
"""

import csv
import json
from array import array
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from heapq import nsmallest
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from treadline.campaign._pool import BLOCK, TIMES, VIEW, Row
from treadline.core.arrays import CONFIDENCE, rms
from treadline.core.files import written_whole
from treadline.io.runs import COMPLETED

FAILED = ("fell", "diverged", "crashed", "error")
"""Verdicts that must not occur in a campaign."""
NOT_SCORES = ("index", "seed", "events")
AVERAGES: Mapping[str, Callable[[Float[np.ndarray, " n"]], float]] = {
    "mean": np.mean,
    "rms": rms,
    **{word: partial(np.percentile, q=q) for word, q in (("p1", 1), ("p5", 5), ("median", 50), ("p95", 95), ("p99", 99))},
}
"""Statistics of the completed runs."""
DISTANCE = "climbed_m"
"""Distance score; negative on the way down, and the shortest distance is the worst."""


def clopper_pearson(count: float, total: int, confidence: float = CONFIDENCE) -> tuple[float, float]:
    """Return the exact two-sided confidence bounds of a proportion, wider ones of the mean of numbers from 0 to 1 with that sum.

    Clopper and Pearson, 1934: proportions for which ``count`` or more, and ``count`` or fewer, of ``total`` have a probability of
    half of the complement. The coverage is at least the nominal one, also at 0 and at ``total``.
    """
    from scipy.special import betaincinv  # quantile of the beta distribution; importing scipy.stats takes a second

    tail = 0.5 * (1.0 - confidence)
    low = float(betaincinv(count, total - count + 1, tail)) if count else 0.0
    high = float(betaincinv(count + 1, total - count, 1.0 - tail)) if count < total else 1.0
    return low, high


def summarise(rows: Iterable[Row], drawn: Sequence[str], choices: Sequence[str], score: str) -> dict[str, Any]:
    """Return the summary of the runs.

    Scores include only runs that drove: the heading of a refused chair on the floor has no meaning. Means and quantiles are those
    of completed runs, worst values those of all: a run that ended early has the scores of a shorter time.

    Args:
        rows: Rows of all runs; iterated several times, so that they need not be in memory.
        drawn: Columns that are not scores.
        choices: Columns by which verdicts are counted.
        score: Score that ranks the worst runs.
    """
    verdicts, causes, names = Counter[str](), Counter[str](), dict[str, None]()
    by: dict[str, dict[str, Counter[str]]] = {key: {} for key in choices}
    for row in map(flat, rows):
        verdicts[row["verdict"]] += 1
        for key, values in by.items():
            values.setdefault(str(row.get(key)), Counter())[row["verdict"]] += 1
        if row["verdict"] != "arrived":
            causes[_kind(row)] += 1
        if row["verdict"] != "refused":
            names |= dict.fromkeys(row)
    total = verdicts.total()
    return {
        "runs": total,
        "verdicts": {name: _share(verdicts[name], total) for name in sorted({*verdicts, "arrived", "arrived_rough", "fell"})},
        "by": {key: {value: dict(sorted(values[value].items())) for value in sorted(values)} for key, values in by.items()},
        "causes": dict(causes.most_common(20)),
        "scores": _scores(rows, total, [name for name in names if name not in {*drawn, *NOT_SCORES}]),
        "score": score,
        "worst": [{name: row.get(name) for name in ("index", "seed", "verdict", "cause", score)} for row in worst(rows, score)],
    }


def worst(rows: Iterable[Row], score: str, count: int = 10) -> list[Row]:
    """Return the worst runs: falls, then failures, then rough runs, then by the score."""
    rank = {"fell": 0} | dict.fromkeys(FAILED[1:], 1) | {"arrived_rough": 2, "held_rough": 2}
    return nsmallest(count, map(flat, rows), key=lambda row: (rank.get(row["verdict"], 3), harm(row, score), row["index"]))


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


def _kind(row: Row) -> str:
    """Return a cause without its numbers, so that similar causes are counted together."""
    words = [word for word in str(row.get("cause")).split(";")[0].split() if not any(letter.isdigit() for letter in word)]
    return f"{row['verdict']}: {' '.join(words[:8])}"


def _scores(rows: Iterable[Row], total: int, names: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Return the statistics of the numeric columns of runs that drove, from as many columns at a time as memory may hold."""
    scores: dict[str, dict[str, Any]] = {}
    width = max(1, BLOCK**2 // max(total, 1))
    for start in range(0, len(names), width):
        columns = {name: array("d") for name in names[start : start + width]}
        indices, completed = array("q"), bytearray()
        for row in map(flat, rows):
            if row["verdict"] != "refused":
                indices.append(row["index"])
                completed.append(row["verdict"] in COMPLETED)
                for name, column in columns.items():
                    value: Any = row.get(name)
                    column.append(value if type(value) in (int, float) else np.nan)
        for name, column in columns.items():
            values, has_ended = np.array(column), np.frombuffer(completed, dtype=bool)
            is_known = ~np.isnan(values)
            if is_known.any():
                scores[name] = _figures(name, np.array(indices)[is_known], values[is_known], values[is_known & has_ended])
    return scores


def _figures(
    name: str, indices: Int[np.ndarray, " n"], values: Float[np.ndarray, " n"], completed: Float[np.ndarray, " m"]
) -> dict[str, Any]:
    """Return the statistics of a score."""
    sizes = np.abs(values) if name == DISTANCE or not lower_is_worse(name) else values
    bad = int(np.argmin(sizes) if lower_is_worse(name) else np.argmax(sizes))
    return {
        "count": len(values),
        "averaged": len(completed),
        **{word: float(average(completed)) if len(completed) else None for word, average in AVERAGES.items()},
        "min": float(values.min()),
        "max": float(values.max()),
        "worst": float(values[bad]),
        "worst_run": int(indices[bad]),
    }


def write_tables(folder: Path, rows: Iterable[Row]) -> list[Path]:
    """Write the results in the given order and the times next to them; return the result files."""
    kinds: dict[str, set[type]] = {}
    for row in map(flat, rows):
        for name, value in row.items():
            kinds.setdefault(name, set()).add(type(value))
    _write_csv(folder / "runs.csv", map(flat, rows), list(kinds))
    _write_csv(folder / "times.csv", rows, ["index", *TIMES])
    parquet = _write_parquet(folder / "runs.parquet", rows, kinds)
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


def _write_csv(path: Path, rows: Iterable[Row], names: Sequence[str]) -> None:
    with written_whole(path) as part, part.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(names)
        writer.writerows([str(cell).lower() if isinstance(cell := row.get(name), bool) else cell for name in names] for row in rows)


def _write_parquet(path: Path, rows: Iterable[Row], kinds: Mapping[str, set[type]]) -> bool:
    """Write the rows, ``BLOCK`` at a time; a column of mixed numbers holds floats, one of any other mixture strings."""
    try:
        import pyarrow as pa
        from pyarrow import parquet
    except ImportError:
        return False
    types = {name: _one_type(found - {type(None)}) for name, found in kinds.items()}
    arrow = {type(None): pa.null(), bool: pa.bool_(), int: pa.int64(), float: pa.float64(), str: pa.string()}
    schema = pa.schema([(name, arrow[kind]) for name, kind in types.items()])
    remaining = map(flat, rows)
    with written_whole(path) as part, parquet.ParquetWriter(part, schema, compression="zstd") as writer:
        while block := list(islice(remaining, BLOCK)):
            columns = {
                name: [None if (value := row.get(name)) is None else kind(value) for row in block] for name, kind in types.items()
            }
            writer.write_table(pa.table(columns, schema=schema))
    return True


def _one_type(kinds: set[type]) -> type:
    if kinds == {int, float}:
        return float
    return kinds.pop() if len(kinds) == 1 else str if kinds else type(None)


ARRIVED = ("arrived", "end_of_flight")
"""Verdicts of runs that did what was asked."""
LEVELS = (0.1, 0.5)
"""Shares of failed runs whose contours are drawn."""
COLLINEAR = 0.9
"""Rank correlation from which on two quantities count as one, as rise and slope of a stair whose run is fixed. At this correlation
the variance of a coefficient is 5 times that with independent quantities (variance inflation factor)."""
GRID = 40
"""Points of the contour's grid in each direction."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Frontier:
    """Two quantities, and the contours of the share of failed runs over them."""

    keys: tuple[str, str]
    contours: dict[float, list[Float[np.ndarray, "_ 2"]]]
    """Lines of each level, in the quantities' units."""


def frontier_of(rows: Sequence[Row], drawn: Sequence[str]) -> Frontier | None:
    """Return the frontier, or None unless two drawn numbers vary independently and enough runs failed and did not fail."""
    from scipy.stats import spearmanr  # takes a second to import

    keys = [key for key in drawn if _varies(rows, key)]
    failed = np.array([row["verdict"] not in ARRIVED for row in rows])
    # A fit of six coefficients needs at least five runs of each kind.
    if len(keys) < 2 or min(int(failed.sum()), int((~failed).sum())) < 5:
        return None
    values = {key: np.array([float(row[key]) for row in rows]) for key in keys}
    first, *rest = sorted(keys, key=lambda key: (-separation(values[key], failed), key))
    second = next((key for key in rest if abs(float(spearmanr(values[first], values[key]).statistic)) < COLLINEAR), None)
    if second is None:
        return None
    points = np.column_stack([values[first], values[second]])
    return Frontier(keys=(first, second), contours=_contours(points, failed))


def _varies(rows: Sequence[Row], key: str) -> bool:
    found = [row.get(key) for row in rows]
    return all(type(value) in (int, float) for value in found) and len(set(found)) > 2


def separation(values: Float[np.ndarray, " n"], failed: Bool[np.ndarray, " n"]) -> float:
    """Return the distance of the area under the ROC curve from that of chance: 0 is none, 0.5 is complete separation."""
    from scipy.stats import mannwhitneyu

    pairs = failed.sum() * (~failed).sum()
    return abs(float(mannwhitneyu(values[failed], values[~failed]).statistic / pairs) - 0.5)


def _contours(points: Float[np.ndarray, "n 2"], failed: Bool[np.ndarray, " n"]) -> dict[float, list[Float[np.ndarray, "_ 2"]]]:
    from contourpy import contour_generator

    middle, scale = points.mean(axis=0), points.std(axis=0)
    weights = _logistic(_terms((points - middle) / scale), failed.astype(float))
    x, y = np.meshgrid(*(np.linspace(points[:, k].min(), points[:, k].max(), GRID) for k in (0, 1)))
    grid = (np.column_stack([x.ravel(), y.ravel()]) - middle) / scale
    share = (1.0 / (1.0 + np.exp(-_terms(grid) @ weights))).reshape(GRID, GRID)
    lines: Any = contour_generator(x, y, share)
    return {level: list(lines.lines(level)) for level in LEVELS}


def _terms(z: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 6"]:
    a, b = z.T
    return np.column_stack([np.ones(len(z)), a, b, a * a, a * b, b * b])


def _logistic(X: Float[np.ndarray, "n 6"], y: Float[np.ndarray, " n"]) -> Float[np.ndarray, " 6"]:
    """Return the coefficients of the logistic regression; a penalty on all but the constant keeps separable runs finite."""
    from scipy.optimize import minimize

    def cost(weights: Float[np.ndarray, " 6"]) -> float:
        z = X @ weights
        return float(np.logaddexp(0.0, z).sum() - y @ z + 0.05 * weights[1:] @ weights[1:])

    return np.asarray(minimize(cost, np.zeros(X.shape[1])).x)
