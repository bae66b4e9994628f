"""Summary of a campaign: verdicts with exact bounds, scores, and the worst runs."""

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from treadline.campaign.sampled_run import Row
from treadline.report.labels import channel, suffix

CONFIDENCE = 0.95
WORST = 10
FAILED = ("fell", "diverged", "crashed", "error")
"""Verdicts that must not occur in a campaign."""
NOT_SCORES = ("index", "seed", "events")
DISTANCE = "climbed_m"
"""Distance score; negative on the way down, and the shortest distance is the worst."""
SHOWN = (
    "min_stability_margin_deg",
    "max_pitch_rate_deg_s",
    "aligned_rms_heading_deg",
    "aligned_max_heading_deg",
    "rms_heading_deg",
    "steady_rms_heading_deg",
    "max_abs_heading_deg",
    "roll_back_m",
    "seat_max_deg",
    "passenger_max_m_s2",
    "passenger_lateral_m_s2",
    "duration_s",
)
"""Scores in the printed summary, if present; summary.json has all scores."""


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


def worst(rows: Sequence[Row], score: str, count: int = WORST) -> list[Row]:
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


def lines(summary: Mapping[str, Any]) -> list[str]:
    """Return the printed lines of the summary."""
    total = summary["runs"]
    said = [f"{total} runs; shares with {100 * CONFIDENCE:.0f} % bounds:"]
    for name, share in sorted(summary["verdicts"].items(), key=lambda item: -item[1]["count"]):
        low, high = (100.0 * bound for bound in share["bounds"])
        said.append(f"  {name:9s} {share['count']:5d}  {100 * share['share']:6.2f} %  ({low:.2f} to {high:.2f})")
    for name in SHOWN:
        if name in summary["scores"]:
            score, unit = summary["scores"][name], suffix(channel(name).unit or "")
            words = ("rms", "median", "worst") if has_rms(name) else ("median", "worst")
            figures = ", ".join(f"{'RMS' if word == 'rms' else word} {score[word]:.3g}{unit}" for word in words)
            said.append(f"  {name}: {figures} (run {score['worst_run']:04d})")
    return said


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
