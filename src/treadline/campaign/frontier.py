"""Failure frontier of a campaign: share of runs that fail over the two drawn quantities that matter most.

The two quantities are those whose values separate failed from other runs best (Mann-Whitney U, as area under the ROC curve), among
quantities that do not follow from each other. The share follows from a logistic regression with linear, quadratic and product
terms; the frontier is its contour. Where few runs fail, the contour is an extrapolation: the page draws every run next to it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from treadline.campaign.sampled_run import Row

ARRIVED = ("arrived", "end_of_flight")
"""Verdicts of runs that did what was asked."""
LEVELS = (0.1, 0.5)
"""Shares of failed runs whose contours are drawn."""
LEAST_OF_EACH = 5
"""Least number of failed and of other runs for a fit of six coefficients to be drawn."""
COLLINEAR = 0.9
"""Rank correlation from which on two quantities count as one, as rise and slope of a stair whose run is fixed. At this correlation
the variance of a coefficient is 5 times that with independent quantities (variance inflation factor)."""
RIDGE = 0.1
"""Weight of the penalty on the coefficients: standardised quantities; separable runs have a finite fit."""
NEWTON_STEPS = 30
GRID = 40
"""Points of the contour's grid in each direction."""

Segment = tuple[float, float, float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Frontier:
    """Two quantities, their runs, and the contours of the share of failed runs."""

    keys: tuple[str, str]
    points: Float[np.ndarray, "n 2"]
    index: tuple[int, ...]
    verdicts: tuple[str, ...]
    contours: dict[float, list[Segment]]
    """Line segments (x0, y0, x1, y1) of each level, in the quantities' units."""


def frontier_of(rows: Sequence[Row], drawn: Sequence[str]) -> Frontier | None:
    """Return the frontier, or None unless two drawn numbers vary independently and enough runs failed and did not fail."""
    keys = [key for key in drawn if _varies(rows, key)]
    failed = np.array([row["verdict"] not in ARRIVED for row in rows])
    if len(keys) < 2 or min(int(failed.sum()), int((~failed).sum())) < LEAST_OF_EACH:
        return None
    values = {key: np.array([float(row[key]) for row in rows]) for key in keys}
    first, *rest = sorted(keys, key=lambda key: (-separation(values[key], failed), key))
    second = next((key for key in rest if abs(_rank_correlation(values[first], values[key])) < COLLINEAR), None)
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
    n, m = int(failed.sum()), int((~failed).sum())
    area = (_ranks(values)[failed].sum() - 0.5 * n * (n + 1)) / (n * m)
    return abs(float(area) - 0.5)


def _ranks(values: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Return the ranks from 1; ties share their mean rank."""
    order = np.argsort(values, kind="stable")
    ranks = np.empty(len(values))
    ranks[order] = np.arange(1.0, len(values) + 1.0)
    for value in np.unique(values):
        tied = values == value
        ranks[tied] = ranks[tied].mean()
    return ranks


def _rank_correlation(a: Float[np.ndarray, " n"], b: Float[np.ndarray, " n"]) -> float:
    """Return Spearman's correlation of two quantities."""
    return float(np.corrcoef(_ranks(a), _ranks(b))[0, 1])


def _contours(points: Float[np.ndarray, "n 2"], failed: Bool[np.ndarray, " n"]) -> dict[float, list[Segment]]:
    middle, scale = points.mean(axis=0), points.std(axis=0)
    weights = _logistic(_terms((points - middle) / scale), failed.astype(float))
    axes = [np.linspace(points[:, k].min(), points[:, k].max(), GRID) for k in (0, 1)]
    x, y = np.meshgrid(*axes, indexing="ij")
    grid = (np.column_stack([x.ravel(), y.ravel()]) - middle) / scale
    share = (1.0 / (1.0 + np.exp(-_terms(grid) @ weights))).reshape(GRID, GRID)
    return {level: _level(share - level, *axes) for level in LEVELS}


def _terms(z: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 6"]:
    a, b = z.T
    return np.column_stack([np.ones(len(z)), a, b, a * a, a * b, b * b])


def _logistic(X: Float[np.ndarray, "n 6"], y: Float[np.ndarray, " n"]) -> Float[np.ndarray, " 6"]:
    """Return the coefficients of the penalised logistic regression, by Newton's method."""
    weights = np.zeros(X.shape[1])
    penalty = RIDGE * np.diag([0.0, *np.ones(X.shape[1] - 1)])
    for _ in range(NEWTON_STEPS):
        share = 1.0 / (1.0 + np.exp(-np.clip(X @ weights, -30.0, 30.0)))
        gradient = X.T @ (share - y) + penalty @ weights
        curvature = (X * (share * (1.0 - share))[:, None]).T @ X + penalty + 1e-9 * np.eye(X.shape[1])
        step = np.linalg.solve(curvature, gradient)
        weights = weights - step
        if np.abs(step).max() < 1e-8:
            break
    return weights


def _level(f: Float[np.ndarray, "g g"], x: Float[np.ndarray, " g"], y: Float[np.ndarray, " g"]) -> list[Segment]:
    """Return the segments at which a function on a grid is zero: each cell in two triangles."""
    found: list[Segment] = []
    for i in range(len(x) - 1):
        for j in range(len(y) - 1):
            corners = [
                (x[i], y[j], f[i, j]),
                (x[i + 1], y[j], f[i + 1, j]),
                (x[i + 1], y[j + 1], f[i + 1, j + 1]),
                (x[i], y[j + 1], f[i, j + 1]),
            ]
            for triangle in ((0, 1, 2), (0, 2, 3)):
                ends = [
                    (a[0] + r * (b[0] - a[0]), a[1] + r * (b[1] - a[1]))
                    for a, b in ((corners[triangle[k]], corners[triangle[(k + 1) % 3]]) for k in range(3))
                    if (a[2] < 0.0) != (b[2] < 0.0)
                    for r in [a[2] / (a[2] - b[2])]
                ]
                if len(ends) == 2:
                    found.append((float(ends[0][0]), float(ends[0][1]), float(ends[1][0]), float(ends[1][1])))
    return found
