"""Failure frontier of a campaign: share of runs that fail over the two drawn quantities that matter most.

The two quantities are those whose values separate failed from other runs best (Mann-Whitney U, as area under the ROC curve), among
quantities that do not follow from each other. The share follows from a logistic regression with linear, quadratic and product
terms; the frontier is its contour. Where few runs fail, the contour is an extrapolation: the page draws every run next to it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from treadline.campaign.pool import Row

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
    """Two quantities, their runs, and the contours of the share of failed runs."""

    keys: tuple[str, str]
    points: Float[np.ndarray, "n 2"]
    index: tuple[int, ...]
    verdicts: tuple[str, ...]
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
    return Frontier(
        keys=(first, second),
        points=points,
        index=tuple(int(row["index"]) for row in rows),
        verdicts=tuple(str(row["verdict"]) for row in rows),
        contours=_contours(points, failed),
    )


def _varies(rows: Sequence[Row], key: str) -> bool:
    found = [row.get(key) for row in rows]
    return all(type(value) in (int, float) for value in found) and len(set(found)) > 2


def separation(values: Float[np.ndarray, " n"], failed: Bool[np.ndarray, " n"]) -> float:
    """Return the distance of the area under the ROC curve from that of chance: 0 is none, 0.5 is complete separation."""
    from scipy.stats import rankdata

    n, m = int(failed.sum()), int((~failed).sum())
    area = (rankdata(values)[failed].sum() - 0.5 * n * (n + 1)) / (n * m)
    return abs(float(area) - 0.5)


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
    """Return the coefficients of the logistic regression, by Newton's method; a penalty keeps separable runs finite."""
    weights = np.zeros(X.shape[1])
    penalty = 0.1 * np.diag([0.0, *np.ones(X.shape[1] - 1)])
    for _ in range(30):
        share = 1.0 / (1.0 + np.exp(-np.clip(X @ weights, -30.0, 30.0)))
        gradient = X.T @ (share - y) + penalty @ weights
        curvature = (X * (share * (1.0 - share))[:, None]).T @ X + penalty + 1e-9 * np.eye(X.shape[1])
        step = np.linalg.solve(curvature, gradient)
        weights = weights - step
        if np.abs(step).max() < 1e-8:
            break
    return weights
