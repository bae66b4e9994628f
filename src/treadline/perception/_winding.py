"""Wedge-shaped treads: the steps of a winding flight, which repeat in no lattice of parallel edges."""

import math
from collections.abc import Sequence

import numpy as np

from treadline.core.angles import DEG
from treadline.core.arrays import cross
from treadline.perception._plane_segmentation import Line, Surface
from treadline.perception._step_parts import Axes, Tread

WEDGE, ALIKE = 5.0 * DEG, 6.0 * DEG
"""Least angle between front and back of a wedge-shaped tread [rad], and largest difference between two treads of one flight: treads
of winding house stairs have 10 to 15°."""
RISE_LEAST_M = 0.1
"""Least height from one tread to the next [m]: building codes allow 0.10 to 0.22 m."""


def turn_per_step(treads: Sequence[Tread], level: Axes) -> float | None:
    """Return the turn of the edges from one step to the next, positive to the left [rad]; None without two wedge-shaped treads.

    The back of a tread is parallel to the next nosing: both lines of a tread are one step apart.
    """
    ends = [(tread.surface, *tread.ends(level)) for tread in treads]
    found = sorted(
        (float(s.centre @ level.up), _turn(near, s, level), _turn(far, s, level)) for s, near, far in ends if near and far
    )
    groups: list[list[tuple[float, float, float]]] = []
    for first in found:
        group = [first]
        for other in found:
            alike = abs((other[2] - other[1]) - (first[2] - first[1])) < ALIKE
            if alike and other[0] > group[-1][0] + RISE_LEAST_M and abs(first[2] - first[1]) > WEDGE:
                group.append(other)
        groups.append(group)
    longest = max(groups, key=len, default=[])
    if len(longest) < 2:
        return None
    steps = np.arange(len(longest))
    _, fronts, backs = np.array(longest).T
    turn_rad = float(np.polyfit([*steps, *(steps + 1)], [*fronts, *backs], 1)[0])
    return turn_rad if abs(turn_rad) > WEDGE else None


def _turn(line: Line, surface: Surface, level: Axes) -> float:
    """Return the turn of a line on its surface about the vertical, positive to the left [rad]."""
    along = cross(line.normal, surface.unit)
    return (math.atan2(float(along @ level.ahead), float(along @ level.right)) + 0.5 * math.pi) % math.pi - 0.5 * math.pi
