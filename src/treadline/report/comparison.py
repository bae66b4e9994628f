"""One row of the summary: ours, the paper's, the target, and the verdict that follows from them."""

import math
from dataclasses import dataclass, replace

from treadline.report.channels import suffix

REACHED, NO_TARGET = "reached", "-"


@dataclass(frozen=True, slots=True, kw_only=True)
class Comparison:
    """One row of the summary."""

    what: str
    ours: str
    paper: str = "–"
    target: str = "–"
    verdict: str = NO_TARGET
    """``reached``, ``missed by …``, ``-`` where there is no target, or that a quick run judges nothing."""
    conditions: str = ""
    from_runs: bool = True
    """Whether a shortened run changes what is measured."""
    figure: str = ""
    """Key of the figure in ``results.json``'s ``sensitivity``; empty for one that no budget has."""


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
    """Return a row whose verdict follows from value and target; no value misses every target."""
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
    return replace(row, verdict=REACHED if gap <= 0.0 else f"missed by {gap:.{2 if gap < 100.0 else 3}g}{suffix(unit)}")


def written(value: float, unit: str) -> str:
    """Return a value with three digits, a length to the millimetre: what is below is not a result."""
    text = f"{value:.3f}" if unit == "m" else f"{value:.0f}" if abs(value) >= 100.0 else f"{value:.3g}"
    return text + suffix(unit)
