"""From surfaces and lines to the stair's edges: which riser, tread and line belong to one nosing.

A flight that rises shows its risers and, above the eye, their upper ends; with open risers, the front ends of its treads.
A flight that falls shows treads alone: each ends, further up in the image, at the nosing that hides the riser below it.
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
from treadline.perception.planes import Blocks, Surface
from treadline.signals import PinholeCamera

STEP_RUN_M, STEP_RISE_M = (0.15, 0.52), (0.08, 0.25)
SAME_RUN_M, SAME_RISE_M = 0.08, 0.07
"""Less than half of the smallest run and rise: within them, two findings are of one nosing."""
LEAST_LEVER = 0.17
"""Of a line's normal along ahead: a nosing within 10° of the eye's height tells a height and no direction."""
PLAIN_ENDS = 3
"""Ends of treads with something further away behind them: where so many are seen, depth is not smoothed over its edges."""
TREAD_ABOVE_M, TREAD_BEHIND_M = (-0.04, 0.10), (-0.10, 0.20)
"""Where the tread of a riser starts, against the riser's highest block and its plane: blocks end short of edges."""

Direction = Literal["up", "down"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Axes:
    """Directions in C: level and square to the edges, up, and along the edges to the right."""

    ahead: Float[np.ndarray, " 3"]
    up: Float[np.ndarray, " 3"]
    right: Float[np.ndarray, " 3"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Nosing:
    """What is seen of one edge of the stair: its riser, its line, or both."""

    ahead_m: float
    """Along the horizontal across the edges, from the camera."""
    up_m: float | None
    """Height against the camera; None where neither a tread nor a line shows it."""
    point: Float[np.ndarray, " 3"]
    """On the edge, in C; as high as the riser is seen where the height is not known."""
    sides_m: tuple[float, float]
    """From where to where it is seen across the flight, to the right."""
    riser: Surface | None
    lines: tuple[Line, ...]
    """Those that tell the edge's direction: near the eye's height they do not."""
    weight: float
    """Pixels' worth of evidence."""
    top_m: float | None = None
    """Where the riser ends in the image, under the nosing or at it; None where what follows is not known."""

    @property
    def is_plain(self) -> bool:
        """Whether a riser or something further away is seen behind it: a corner alone may be a board's."""
        return self.riser is not None or any(not line.is_corner for line in self.lines)

    @property
    def tells(self) -> bool:
        """Whether it says anything of the edges' direction."""
        return self.riser is not None or bool(self.lines)


def direction_of(treads: Sequence[Surface], axes: Axes) -> Direction | None:
    """Return whether treads rise or fall ahead, or None where they do not tell."""
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
    blocks: Blocks,
    camera: PinholeCamera,
    axes: Axes,
    direction: Direction,
) -> list[Nosing]:
    """Return the edges in view, the nearest first.

    Args:
        ends: The line at the end of each tread that the flight's direction makes its nosing.
    """
    fronts = np.array([tread.span_m(blocks, axes.ahead)[0] for tread in treads])
    found = [_of_riser(riser, treads, fronts, blocks, camera, axes) for riser in risers]
    smoothed = direction == "down" and sum(line is not None and not line.is_corner for line in ends) < PLAIN_ENDS
    for line in ends:
        # Where a tread's far end meets what rises behind it, there is no nosing; depth that is smoothed over an edge shows a
        # corner, too, but with a step down behind it.
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
    """Return whether a tread follows a step below and behind a line."""
    ahead, up = float(line.middle @ axes.ahead), float(line.middle @ axes.up)
    left, right = sorted((line.ends_m @ axes.right).tolist())
    return any(
        STEP_RISE_M[0] < up - float(tread.centre @ axes.up) < STEP_RISE_M[1]
        and 0.0 < float(tread.centre @ axes.ahead) - ahead < STEP_RUN_M[1]
        and left < float(tread.centre @ axes.right) < right
        for tread in treads
    )


def _of_line(line: Line, axes: Axes) -> Nosing:
    aside = line.ends_m @ axes.right
    return Nosing(
        ahead_m=float(line.middle @ axes.ahead),
        up_m=float(line.middle @ axes.up),
        point=line.middle,
        sides_m=(float(aside.min()), float(aside.max())),
        riser=None,
        lines=_telling(line, axes),
        weight=float(line.count),
    )


def _both(owner: Nosing, line: Nosing, axes: Axes) -> Nosing:
    """Return a nosing with one more line of its tread, which may tell its height."""
    point, up_m = owner.point, owner.up_m
    if up_m is None and line.up_m is not None:
        up_m = line.up_m
        point = point + (up_m - float(point @ axes.up)) * axes.up
    return Nosing(
        ahead_m=owner.ahead_m,
        up_m=up_m,
        point=point,
        sides_m=(min(owner.sides_m[0], line.sides_m[0]), max(owner.sides_m[1], line.sides_m[1])),
        riser=owner.riser,
        lines=owner.lines + line.lines,
        weight=owner.weight + line.weight,
        top_m=owner.top_m,
    )


def _telling(line: Line, axes: Axes) -> tuple[Line, ...]:
    return (line,) if abs(float(line.normal @ axes.ahead)) > LEAST_LEVER else ()


def _same(owner: Nosing, other: Nosing) -> bool:
    if abs(owner.ahead_m - other.ahead_m) > SAME_RUN_M:
        return False
    return owner.up_m is None or other.up_m is None or abs(owner.up_m - other.up_m) < SAME_RISE_M


def _of_riser(
    riser: Surface,
    treads: Sequence[Surface],
    fronts_m: Float[np.ndarray, " t"],
    blocks: Blocks,
    camera: PinholeCamera,
    axes: Axes,
) -> Nosing:
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
    return Nosing(
        ahead_m=ahead_m,
        up_m=up_m,
        point=riser.centre + (height_m - float(riser.centre @ axes.up)) * axes.up,
        sides_m=riser.span_m(blocks, axes.right),
        riser=riser,
        lines=() if line is None else _telling(line, axes),
        weight=float(riser.blocks.size * blocks.cell_px) + (0.0 if line is None else line.count),
        top_m=_top_of(riser, camera, axes),
    )


def _top_of(riser: Surface, camera: PinholeCamera, axes: Axes) -> float | None:
    """Return the height at which a riser ends, or None where most of its end is cut off."""
    ends, pinhole = riser.upper, (camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px)
    top_m = kernels.height_of_end(ends.columns, ends.rows, ends.follows, riser.normal, axes.up, *pinhole)
    return None if math.isnan(top_m) else top_m


def _height_at(tread: Surface, beside: Float[np.ndarray, " 3"], axes: Axes) -> float:
    """Return the height of a tread's plane straight above or below a point."""
    foot = beside - float(beside @ axes.up) * axes.up
    return float((1.0 - tread.normal @ foot) / (tread.normal @ axes.up))
