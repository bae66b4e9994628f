"""Summary of the scores of ``treadline frames --score``."""

from dataclasses import asdict
from pathlib import Path
from typing import Any

from treadline.cli.answer import Answer
from treadline.experiments.heading_scores import (
    LEAST_SHARE,
    Fraction,
    HeadingResult,
    HeadingScores,
    TrueFrame,
    read_results,
    read_truth,
    score,
)


def scores_answer(results: Path, truth: Path) -> Answer:
    """Return the scores of a results table, of all frames and of each condition."""
    true = read_truth(truth)
    answers = read_results(results, true)
    scores = score(answers, true)
    conditions = _by_condition(answers, true)
    values = _values(scores) | {"frames": len(true), "conditions": {name: _values(part) for name, part in conditions.items()}}
    return Answer(values=values, summary=[*_summary(scores), *(f"  {name}: {_short(part)}" for name, part in conditions.items())])


def _by_condition(answers: dict[str, HeadingResult], true: dict[str, TrueFrame]) -> dict[str, HeadingScores]:
    """Return the scores of each folder in the frames' names; nothing for names without a folder."""
    folders = dict.fromkeys(name.rpartition("/")[0] for name in true if "/" in name)
    return {
        folder: score(answers, {name: frame for name, frame in true.items() if name.rpartition("/")[0] == folder})
        for folder in folders
    }


def _values(scores: HeadingScores) -> dict[str, Any]:
    fractions = {"accepted": scores.accepted, "inside_95": scores.inside_95, "false_accepts": scores.false_accepts}
    return {key: value for key, value in asdict(scores).items() if key not in fractions} | {
        key: {"hits": part.hits, "count": part.count, "share": part.share, "interval_95": list(part.interval)}
        for key, part in fractions.items()
    }


def _summary(scores: HeadingScores) -> list[str]:
    return [
        f"accepted: {_percent(scores.accepted)} of the frames with a stair on at least {100 * LEAST_SHARE:.0f} % of the image",
        f"heading error: {_errors(scores)}",
        f"inside the declared 95 % interval: {_percent(scores.inside_95)}",
        f"false accepts: {_percent(scores.false_accepts)} of the frames without a stair",
    ]


def _short(scores: HeadingScores) -> str:
    if scores.false_accepts.count:
        return f"false accepts {scores.false_accepts.hits}/{scores.false_accepts.count}"
    return f"accepted {scores.accepted.hits}/{scores.accepted.count}, {_errors(scores)}"


def _errors(scores: HeadingScores) -> str:
    if scores.rmse_deg is None:
        return "no accepted frame"
    return f"RMSE {scores.rmse_deg:.3f}°, p95 {scores.p95_deg:.3f}°, worst {scores.worst_deg:.3f}°"


def _percent(part: Fraction) -> str:
    if part.share is None:
        return "no frames"
    low, high = part.interval
    return f"{part.hits}/{part.count} = {100 * part.share:.1f} % [{100 * low:.1f}, {100 * high:.1f}]"
