"""Which nosings make a flight: those that follow each other in steps, with enough in common to be no furniture."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from treadline.perception.nosings import SAME_RUN_M, STEP_RISE_M, STEP_RUN_M, Axes, Direction, Nosing
from treadline.perception.planes import Surface
from treadline.perception.uppers import with_heights

LEAST_WIDTH_M, WIDTH_M, ROW_WIDTH_M = 0.08, 0.30, 0.20
"""Across the flight, that two neighbours must have in common, and from side to side of two and of more: cartons and books are
narrower, and seldom three in a row."""
PAIR_WIDTH_M = 0.5
"""That two nosings must have in common where no third is seen: two cartons may lie like steps."""
SAME_LEVEL = 0.15
"""A third level one rise before or behind two nosings, to this share of it, confirms them: ``WIDTH_M`` of all is then enough."""
TOP_MARGIN_M = 0.05
"""By which the highest block of a riser may miss its top."""


def is_step(near: Nosing, far: Nosing, axes: Axes, direction: Direction) -> bool:
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


def _common_width(near: Nosing, far: Nosing) -> float:
    return min(near.sides_m[1], far.sides_m[1]) - max(near.sides_m[0], far.sides_m[0])


def flight_of(nosings: Sequence[Nosing], treads: Sequence[Surface], axes: Axes, direction: Direction) -> list[Nosing]:
    """Return the nosings that follow each other, of several such rows the one most seen; empty without a single step."""
    levels = np.array([float(tread.centre @ axes.up) for tread in treads])
    best: list[list[Nosing]] = []
    for nosing in nosings:
        # The heaviest row that this nosing goes on; a stray edge in between does not end it, a riser does.
        rows = [row for row in best if is_step(row[-1], nosing, axes, direction) and not _between(row[-1], nosing, nosings)]
        best.append([*max(rows, key=_weight, default=[]), nosing])
    if direction == "up":
        best = [with_heights(row, axes) for row in best]
    rows = [row for row in best if _is_flight(row, levels)]
    return max(rows, key=_weight, default=[])


def _between(near: Nosing, far: Nosing, nosings: Sequence[Nosing]) -> bool:
    """Return whether a riser of the stair's width stands between two nosings: they are no neighbours then."""
    inside = (near.ahead_m + SAME_RUN_M, far.ahead_m - SAME_RUN_M)
    return any(
        inside[0] < nosing.ahead_m < inside[1] and nosing.riser is not None and _common_width(near, nosing) > WIDTH_M
        for nosing in nosings
    )


def _is_flight(row: Sequence[Nosing], levels: Float[np.ndarray, " t"]) -> bool:
    """Return whether a row shows enough of a stair: two plain edges that tell a direction, or three of any kind."""
    width_m = max(nosing.sides_m[1] for nosing in row) - min(nosing.sides_m[0] for nosing in row)
    if width_m < (WIDTH_M if len(row) == 2 else ROW_WIDTH_M):
        return False
    if len(row) == 2 and _common_width(row[0], row[1]) < (WIDTH_M if _goes_on(row[0], row[1], levels) else PAIR_WIDTH_M):
        return False
    telling = [nosing for nosing in row if nosing.tells]
    # The foot of a wall behind a bench, cut off by the image, is no second riser: heights must be seen.
    if sum(nosing.up_m is not None for nosing in telling) < 2:
        return False
    if len(telling) >= 3:
        return True
    plain = sum(nosing.is_plain for nosing in telling)
    # A corner may be a board's; with a level below or above that goes on in steps, and one plain edge, it is a stair's.
    return len(telling) == 2 and (plain == 2 or (plain == 1 and _corner_goes_on(row, levels)))


def _corner_goes_on(row: Sequence[Nosing], levels: Float[np.ndarray, " t"]) -> bool:
    return len(row) == 2 and _common_width(row[0], row[1]) > PAIR_WIDTH_M and _goes_on(row[0], row[1], levels)


def _goes_on(near: Nosing, far: Nosing, levels: Float[np.ndarray, " t"]) -> bool:
    """Return whether there is a level as far below or above two nosings as they are apart."""
    if near.up_m is None or far.up_m is None:
        return False
    rise = far.up_m - near.up_m
    off = np.minimum(np.abs(levels - (far.up_m + rise)), np.abs(levels - (near.up_m - rise)))
    return bool((off < SAME_LEVEL * abs(rise)).any())


def _weight(row: Sequence[Nosing]) -> float:
    return sum(nosing.weight for nosing in row)
