"""Sequences of nosings that form a flight: consecutive steps with sufficient common width, unlike furniture."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from treadline.perception.nosings import SAME_RUN_M, STEP_RISE_M, STEP_RUN_M, Axes, Direction, NosingObservation
from treadline.perception.planes import Surface
from treadline.perception.riser_tops import with_heights

LEAST_WIDTH_M, WIDTH_M, ROW_WIDTH_M = 0.08, 0.30, 0.20
"""Width across the flight [m]: common to two neighbours, total of two, total of more. Cartons and books are narrower, and seldom
three in a row."""
PAIR_WIDTH_M = 0.5
"""Common width of two nosings without a third [m]: two cartons can lie like steps."""
SAME_LEVEL = 0.15
"""Relative tolerance for a third level one rise before or behind two nosings; with it a total of ``WIDTH_M`` suffices."""
TOP_MARGIN_M = 0.05
"""Largest distance of a riser's highest block from its top [m]."""


def is_step(near: NosingObservation, far: NosingObservation, axes: Axes, direction: Direction) -> bool:
    """Return whether two nosings follow each other on a stair."""
    run = far.ahead_m - near.ahead_m
    if not STEP_RUN_M[0] <= run <= STEP_RUN_M[1]:
        return False
    if _common_width(near, far) < LEAST_WIDTH_M:
        return False
    rise = float((far.point - near.point) @ axes.up)
    rise = rise if direction == "up" else -rise
    margin = TOP_MARGIN_M if near.up_m is None or far.up_m is None else 0.0
    return STEP_RISE_M[0] - margin <= rise <= STEP_RISE_M[1] + margin and rise <= run


def _common_width(near: NosingObservation, far: NosingObservation) -> float:
    return min(near.sides_m[1], far.sides_m[1]) - max(near.sides_m[0], far.sides_m[0])


def flight_of(
    nosings: Sequence[NosingObservation], treads: Sequence[Surface], axes: Axes, direction: Direction
) -> list[NosingObservation]:
    """Return the sequence of consecutive nosings with the most evidence; empty without a single step."""
    levels = np.array([float(tread.centre @ axes.up) for tread in treads])
    best: list[list[NosingObservation]] = []
    for nosing in nosings:
        # The sequence with most evidence that this nosing continues; an outlier edge in between does not end it, a riser does.
        rows = [row for row in best if is_step(row[-1], nosing, axes, direction) and not _between(row[-1], nosing, nosings)]
        best.append([*max(rows, key=_weight, default=[]), nosing])
    if direction == "up":
        best = [with_heights(row, axes) for row in best]
    rows = [row for row in best if _is_flight(row, levels)]
    return max(rows, key=_weight, default=[])


def _between(near: NosingObservation, far: NosingObservation, nosings: Sequence[NosingObservation]) -> bool:
    """Return whether a riser of the stair's width stands between two nosings, which excludes them as neighbours."""
    inside = (near.ahead_m + SAME_RUN_M, far.ahead_m - SAME_RUN_M)
    return any(
        inside[0] < nosing.ahead_m < inside[1] and nosing.riser is not None and _common_width(near, nosing) > WIDTH_M
        for nosing in nosings
    )


def _is_flight(row: Sequence[NosingObservation], levels: Float[np.ndarray, " t"]) -> bool:
    """Return whether a sequence is sufficient for a stair: two plain edges with a direction, or three of any kind."""
    width_m = max(nosing.sides_m[1] for nosing in row) - min(nosing.sides_m[0] for nosing in row)
    if width_m < (WIDTH_M if len(row) == 2 else ROW_WIDTH_M):
        return False
    if len(row) == 2 and _common_width(row[0], row[1]) < (WIDTH_M if _goes_on(row[0], row[1], levels) else PAIR_WIDTH_M):
        return False
    telling = [nosing for nosing in row if nosing.has_direction]
    # The foot of a wall behind a bench, truncated by the image, must not count as a second riser: heights must be visible.
    if sum(nosing.up_m is not None for nosing in telling) < 2:
        return False
    if len(telling) >= 3:
        return True
    plain = sum(nosing.is_plain for nosing in telling)
    # A corner can belong to a board; a further level one step below or above, and one plain edge, confirm a stair.
    return len(telling) == 2 and (plain == 2 or (plain == 1 and _corner_goes_on(row, levels)))


def _corner_goes_on(row: Sequence[NosingObservation], levels: Float[np.ndarray, " t"]) -> bool:
    return len(row) == 2 and _common_width(row[0], row[1]) > PAIR_WIDTH_M and _goes_on(row[0], row[1], levels)


def _goes_on(near: NosingObservation, far: NosingObservation, levels: Float[np.ndarray, " t"]) -> bool:
    """Return whether there is a level one further rise below or above two nosings."""
    if near.up_m is None or far.up_m is None:
        return False
    rise = far.up_m - near.up_m
    off = np.minimum(np.abs(levels - (far.up_m + rise)), np.abs(levels - (near.up_m - rise)))
    return bool((off < SAME_LEVEL * abs(rise)).any())


def _weight(row: Sequence[NosingObservation]) -> float:
    return sum(nosing.weight for nosing in row)
