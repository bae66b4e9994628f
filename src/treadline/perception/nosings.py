"""Nosings from surfaces and lines: assignment of risers, treads and lines to one nosing.

An ascending flight shows its risers and, above the camera height, their upper ends; with open risers, the front ends of its treads.
A descending flight shows treads only: each ends, upwards in the image, at the nosing that hides the riser below.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import median
from typing import Literal

import numpy as np
from jaxtyping import Float

from treadline.perception import kernels
from treadline.perception.lines import Line, nosing_line
from treadline.perception.planes import PlanarBlocks, Surface
from treadline.signals import PinholeCamera

STEP_RUN_M, STEP_RISE_M = (0.15, 0.52), (0.08, 0.25)
"""Ranges of run and rise of a step [m]."""
SAME_RUN_M, SAME_RISE_M = 0.08, 0.07
"""Largest differences within one nosing [m]: less than half of the smallest run and rise."""
LEAST_LEVER = 0.17
"""Least component of a line's normal along ahead: a nosing within 10° of the camera height determines a height but no direction."""
PLAIN_ENDS = 3
"""Number of tread ends with a larger depth behind, above which depth is considered not smoothed over edges."""
TREAD_ABOVE_M, TREAD_BEHIND_M = (-0.04, 0.10), (-0.10, 0.20)
"""Range of the tread's position relative to the highest block and the plane of its riser [m]: blocks end short of edges."""

Direction = Literal["up", "down"]
"""Direction of the flight ahead."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Axes:
    """Orthonormal axes in C: horizontal and perpendicular to the edges, up, and along the edges to the right."""

    ahead: Float[np.ndarray, " 3"]
    up: Float[np.ndarray, " 3"]
    right: Float[np.ndarray, " 3"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NosingObservation:
    """Observation of one edge of the stair: its riser, its line, or both."""

    ahead_m: float
    """Horizontal distance from the camera, perpendicular to the edges [m]."""
    up_m: float | None
    """Height relative to the camera [m]; None without a tread or line."""
    point: Float[np.ndarray, " 3"]
    """Point on the edge in C [m]; at unknown height, the highest visible point of the riser."""
    sides_m: tuple[float, float]
    """Lateral range of visibility across the flight, to the right [m]."""
    riser: Surface | None
    lines: tuple[Line, ...]
    """Lines that determine the edge direction; lines near the camera height do not."""
    weight: float
    """Evidence [px]."""
    top_m: float | None = None
    """Height of the riser's end in the image, at or under the nosing [m]; None if the surroundings are unknown."""

    @property
    def is_plain(self) -> bool:
        """Whether a riser or a larger depth is visible behind the nosing: a corner alone can belong to a board."""
        return self.riser is not None or any(not line.is_corner for line in self.lines)

    @property
    def has_direction(self) -> bool:
        """Whether the nosing determines the edge direction."""
        return self.riser is not None or bool(self.lines)


def direction_of(treads: Sequence[Surface], axes: Axes) -> Direction | None:
    """Return whether treads rise or fall ahead, or None if undetermined."""
    if len(treads) < 2:
        return None
    centres = np.array([tread.centre for tread in treads])
    ahead, up = centres @ axes.ahead, centres @ axes.up
    order = np.argsort(up)
    steps, rises = np.diff(ahead[order]), np.diff(up[order])
    next_ones = rises < STEP_RISE_M[1]
    if not next_ones.any():
        return None
    return "up" if median(steps[next_ones].tolist()) > 0.0 else "down"


def nosings_of(
    risers: Sequence[Surface],
    treads: Sequence[Surface],
    ends: Sequence[Line | None],
    blocks: PlanarBlocks,
    camera: PinholeCamera,
    axes: Axes,
    direction: Direction,
) -> list[NosingObservation]:
    """Return the visible edges, nearest first.

    Args:
        ends: Line at the end of each tread that is its nosing for the flight's direction.
    """
    fronts = np.array([tread.span_m(blocks, axes.ahead)[0] for tread in treads])
    found = [_of_riser(riser, treads, fronts, blocks, camera, axes) for riser in risers]
    smoothed = direction == "down" and sum(line is not None and not line.is_corner for line in ends) < PLAIN_ENDS
    for line in ends:
        # The far end of a tread at a riser is not a nosing; depth smoothed over an edge shows a corner as well, but with a step
        # down behind it.
        if line is None or (line.is_corner and direction == "down" and not (smoothed and _falls_behind(line, treads, axes))):
            continue
        of_line = _of_line(line, axes)
        alike = [k for k, nosing in enumerate(found) if _same(nosing, of_line)]
        if alike:
            found[alike[0]] = _both(found[alike[0]], of_line, axes)
        else:
            found.append(of_line)
    return sorted(found, key=lambda nosing: nosing.ahead_m)


def _falls_behind(line: Line, treads: Sequence[Surface], axes: Axes) -> bool:
    """Return whether a tread follows one step below and behind a line."""
    ahead, up = float(line.middle @ axes.ahead), float(line.middle @ axes.up)
    left, right = sorted((line.ends_m @ axes.right).tolist())
    return any(
        STEP_RISE_M[0] < up - float(tread.centre @ axes.up) < STEP_RISE_M[1]
        and 0.0 < float(tread.centre @ axes.ahead) - ahead < STEP_RUN_M[1]
        and left < float(tread.centre @ axes.right) < right
        for tread in treads
    )


def _of_line(line: Line, axes: Axes) -> NosingObservation:
    aside = line.ends_m @ axes.right
    return NosingObservation(
        ahead_m=float(line.middle @ axes.ahead),
        up_m=float(line.middle @ axes.up),
        point=line.middle,
        sides_m=(float(aside.min()), float(aside.max())),
        riser=None,
        lines=_with_direction(line, axes),
        weight=float(line.count),
    )


def _both(owner: NosingObservation, line: NosingObservation, axes: Axes) -> NosingObservation:
    """Return a nosing with an additional line of its tread, which can determine its height."""
    point, up_m = owner.point, owner.up_m
    if up_m is None and line.up_m is not None:
        up_m = line.up_m
        point = point + (up_m - float(point @ axes.up)) * axes.up
    return NosingObservation(
        ahead_m=owner.ahead_m,
        up_m=up_m,
        point=point,
        sides_m=(min(owner.sides_m[0], line.sides_m[0]), max(owner.sides_m[1], line.sides_m[1])),
        riser=owner.riser,
        lines=owner.lines + line.lines,
        weight=owner.weight + line.weight,
        top_m=owner.top_m,
    )


def _with_direction(line: Line, axes: Axes) -> tuple[Line, ...]:
    return (line,) if abs(float(line.normal @ axes.ahead)) > LEAST_LEVER else ()


def _same(owner: NosingObservation, other: NosingObservation) -> bool:
    if abs(owner.ahead_m - other.ahead_m) > SAME_RUN_M:
        return False
    return owner.up_m is None or other.up_m is None or abs(owner.up_m - other.up_m) < SAME_RISE_M


def _of_riser(
    riser: Surface,
    treads: Sequence[Surface],
    fronts_m: Float[np.ndarray, " t"],
    blocks: PlanarBlocks,
    camera: PinholeCamera,
    axes: Axes,
) -> NosingObservation:
    ahead_m, top_m = float(riser.centre @ axes.ahead), riser.span_m(blocks, axes.up)[1]
    line = nosing_line(riser, "upper", camera)
    line = None if line is None or line.is_corner else line
    up_m = None if line is None else float(line.middle @ axes.up)
    on_top = []
    for tread, front_m in zip(treads, fronts_m.tolist(), strict=True):
        height_m = _height_at(tread, riser.centre, axes)
        above, behind = height_m - top_m, front_m - ahead_m
        if TREAD_ABOVE_M[0] < above < TREAD_ABOVE_M[1] and TREAD_BEHIND_M[0] < behind < TREAD_BEHIND_M[1]:
            on_top.append((abs(behind), height_m))
    if on_top:
        up_m = min(on_top)[1]
    height_m = top_m if up_m is None else up_m
    return NosingObservation(
        ahead_m=ahead_m,
        up_m=up_m,
        point=riser.centre + (height_m - float(riser.centre @ axes.up)) * axes.up,
        sides_m=riser.span_m(blocks, axes.right),
        riser=riser,
        lines=() if line is None else _with_direction(line, axes),
        weight=float(riser.blocks.size * blocks.cell_px) + (0.0 if line is None else line.count),
        top_m=_top_of(riser, camera, axes),
    )


def _top_of(riser: Surface, camera: PinholeCamera, axes: Axes) -> float | None:
    """Return the height of a riser's end, or None if most of its end is occluded or unknown."""
    ends, pinhole = riser.upper, (camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px)
    top_m = kernels.height_of_end(ends.columns, ends.rows, ends.follows, riser.normal, axes.up, *pinhole)
    return None if math.isnan(top_m) else top_m


def _height_at(tread: Surface, point: Float[np.ndarray, " 3"], axes: Axes) -> float:
    """Return the height of a tread's plane above or below a point."""
    foot = point - float(point @ axes.up) * axes.up
    return float((1.0 - tread.normal @ foot) / (tread.normal @ axes.up))
