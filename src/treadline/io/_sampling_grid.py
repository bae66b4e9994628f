"""Sampling grids: test of a table's time axis for a constant period, and resampling.

Inputs are resampled by sample-and-hold, as they acted; outputs by linear interpolation. If rows are missing and the others lie on
the grid, the missing rows become rows of NaN instead of interpolated values.
"""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float64

from treadline.core.errors import PeriodMismatch, RecordError
from treadline.io._tables import MOST_GAPS, Table, check_gaps, gaps_in

Times = Float64[np.ndarray, " n"]
"""Times [s]."""

IRREGULAR = 0.05
"""Largest relative deviation of a sampling interval from the period."""
MOST_ROWS = 10_000_000
"""Largest number of resampled rows: four weeks at 4 Hz; a single wrong time stamp would require more."""
RESAMPLE = "pass --resample"
"""Default remedy in error messages."""


def period_of(table: Table, t_s: Times, period_s: float | None, before_s: float | None = None) -> float:
    """Return the requested period, or the median step; time must increase.

    Args:
        t_s: Clock of the table.
        before_s: Time of the row before the table, if the table continues another one.
    """
    steps = _steps(t_s, before_s)
    back = np.flatnonzero(steps <= 0.0)
    if back.size:
        raise RecordError(f"{_behind(table, int(back[0]), before_s)}: column '{table.clock}' does not increase")
    return float(np.median(steps)) if period_s is None else period_s


def uneven(
    table: Table, t_s: Times, period_s: float, before_s: float | None = None, *, remedy: str = RESAMPLE
) -> PeriodMismatch | None:
    """Return the error for the first step that differs from the period, or None."""
    steps = _steps(t_s, before_s)
    off = np.flatnonzero(np.abs(steps - period_s) > IRREGULAR * period_s)
    if not off.size:
        return None
    k = int(off[0])
    places = places_of(t_s, period_s, before_s)
    # The fraction of missing rows of a stream is unknown before its end.
    if places is not None and (before_s is not None or len(t_s) >= (1.0 - MOST_GAPS) * (places[-1] + 1.0)):
        remedy = f"if rows are missing, pass --allow-gaps, else {remedy.removeprefix('pass ')}"
    return PeriodMismatch(
        f"{_behind(table, k, before_s)}: a step of {steps[k]:.4g} s where the period is {period_s:.4g} s; {remedy}"
    )


def with_gaps(table: Table, t_s: Times, period_s: float) -> Float64[np.ndarray, "k c"] | None:
    """Return the columns with rows of NaN for missing rows; None if a step is not a multiple of the period.

    Raises:
        NotFinite: If too many rows are missing or contain NaN.
    """
    places = places_of(t_s, period_s)
    if places is None:
        return None
    rows = int(places[-1]) + 1
    check_gaps(table.file, rows - len(table) + gaps_in(table), rows)
    return next(spread(table.values, places, rows))


def spread(values: Float64[np.ndarray, "n c"], places: Times, rows: int) -> Iterator[Float64[np.ndarray, "_ c"]]:
    """Yield rows at their places with rows of NaN between them, in parts of at most ``rows`` rows."""
    total = int(places[-1]) + 1
    for start in range(0, total, rows):
        part = np.full((min(rows, total - start), values.shape[1]), np.nan)
        first, last = np.searchsorted(places, (start, start + len(part))).tolist()
        part[places[first:last].astype(int) - start] = values[first:last]
        yield part


def places_of(t_s: Times, period_s: float, before_s: float | None = None) -> Times | None:
    """Return the index of each row on the sampling grid, or None if a step is not a multiple of the period.

    Args:
        before_s: Time of the row before the first, from which indices are counted; without it the first row has index 0.
    """
    steps = _steps(t_s, before_s) / period_s
    whole = np.rint(steps)
    # The negated form also catches NaN from an overflow, which fails every comparison.
    if not ((np.abs(steps - whole) <= IRREGULAR) & (whole >= 1.0)).all():
        return None
    return np.concatenate([[0.0], np.cumsum(whole)]) if before_s is None else np.cumsum(whole) - 1.0


def resampled(table: Table, t_s: Times, inputs: int, period_s: float) -> Float64[np.ndarray, "k c"]:
    """Return the columns on the sampling grid, the first ``inputs`` of them by sample-and-hold."""
    grid = t_s[0] + period_s * np.arange(rows_of(str(table.file), t_s[0], t_s[-1], period_s))
    values = np.empty((len(grid), len(table.names)))
    for j, column in enumerate(table.values.T):
        values[:, j] = held(grid + 1e-9 * period_s, t_s, column) if j < inputs else np.interp(grid, t_s, column)
    return values


def held(grid: Float64[np.ndarray, " k"], times: Times, values: Float64[np.ndarray, " n"]) -> Float64[np.ndarray, " k"]:
    """Return the last value at or before each grid point."""
    return values[np.clip(np.searchsorted(times, grid, side="right") - 1, 0, len(times) - 1)]


def rows_of(what: str, first: float, last: float, period: float) -> int:
    """Return the number of points of a grid; times and period in the same unit."""
    count = (last - first) / period + 1.0
    if not count <= MOST_ROWS:
        raise RecordError(f"{what}: {count:.3g} rows at that period; at most {MOST_ROWS} are made: give a longer --period")
    return int(count)


def _steps(t_s: Times, before_s: float | None) -> Float64[np.ndarray, " k"]:
    return np.diff(t_s) if before_s is None else np.diff(t_s, prepend=before_s)


def _behind(table: Table, k: int, before_s: float | None) -> str:
    """Return the location of the row at the end of step k."""
    return table.where(k + 1 if before_s is None else k)
