"""One row of the summary: our figure, the paper's figure, the target and the verdict."""

import math
from dataclasses import dataclass, replace

from treadline.report.channels import suffix

REACHED, NO_TARGET = "reached", "–"


@dataclass(frozen=True, slots=True, kw_only=True)
class Comparison:
    """One row of the summary."""

    what: str
    ours: str
    paper: str = "–"
    target: str = "–"
    verdict: str = NO_TARGET
    """``reached``, ``missed by …``, ``-`` without a target, or that a quick run is not judged."""
    conditions: str = ""
    sensitivity: str = ""
    """Change of the figure with step size, stiffness and friction, in words; empty where it was not measured."""
    from_runs: bool = True
    """Whether the figure depends on the duration of the runs."""
    figure: str = ""
    """Key of the figure in ``sensitivity`` of ``results.json``; empty for a figure outside the uncertainty budget."""


def judged(
    what: str,
    value: float | None,
    unit: str,
    *,
    target: float | None,
    at_least: bool = False,
    printed: str = "–",
    conditions: str = "",
    from_runs: bool = True,
    figure: str = "",
) -> Comparison:
    """Return a row with its verdict from value and target; an absent value misses every target."""
    known = value is not None and math.isfinite(value)
    row = Comparison(
        what=what,
        ours=written(value, unit) if value is not None and known else "none",
        paper=printed,
        conditions=conditions,
        from_runs=from_runs,
        figure=figure,
    )
    if target is None:
        return row
    row = replace(row, target=f"{'≥' if at_least else '≤'} {target:g}{suffix(unit)}")
    if value is None or not known:
        return replace(row, verdict="missed")
    gap = target - value if at_least else value - target
    return replace(row, verdict=REACHED if gap <= 0.0 else f"missed by {gap_text(gap)}{suffix(unit)}")


def gap_text(gap: float) -> str:
    """Return the distance to a target with two digits, or as an integer from 100 on: never in exponential form above 1."""
    return f"{gap:.0f}" if gap >= 100.0 else f"{gap:.2g}"


def written(value: float, unit: str) -> str:
    """Return a value with three digits, a length to the millimetre."""
    text = f"{value:.3f}" if unit == "m" else f"{value:.0f}" if abs(value) >= 100.0 else f"{value:.3g}"
    return text + suffix(unit)
