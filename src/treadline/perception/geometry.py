"""The stair's axes and measures, from the nosings of one frame."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from statistics import median

import numpy as np
from jaxtyping import Float

from treadline.perception.direction import gravity_variance
from treadline.perception.irregular import pooled
from treadline.perception.nosings import STEP_RISE_M, STEP_RUN_M, Axes, Direction, Nosing
from treadline.perception.planes import Surface
from treadline.perception.sight import StairShape
from treadline.perception.vectors import cross
from treadline.signals import StairAxes

EVEN = 0.25
"""Share by which one step of a flight may differ from another: furniture differs by more."""
SAME_LEVEL_M = 0.03
"""Heights closer than this are one level."""
ALIKE = 0.75
"""Share of the nosings seen that must be evenly apart."""
SHAPE_SIGMA_M = 0.0055
"""Of a nosing's place: noise of the sensor and the stair's own irregularity."""


def first_crowd(places: Float[np.ndarray, " k"], within: float, least: int) -> list[float]:
    """Return the smallest place with enough others close behind it, and these, in order; an empty list if there is none."""
    places = np.sort(places)
    together = np.searchsorted(places, places + within) - np.arange(places.size)
    first = np.flatnonzero(together >= least)
    return places[first[0] : first[0] + together[first[0]]].tolist() if first.size else []


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Levelled:
    """The stair's axes with what level is taken from."""

    axes: Axes
    down_sigma_rad: float


def way_of(R_BC: Float[np.ndarray, "3 3"]) -> float:
    """Return 1 for a camera that looks where the chair's front points, and -1 for one that looks back over it.

    A camera that looks straight down has its image's upper edge there.
    """
    look, image_up = R_BC[0, 2], -R_BC[0, 1]
    return 1.0 if look + image_up > 0.0 else -1.0


def axes_of(
    edge: Float[np.ndarray, " 3"], down: Float[np.ndarray, " 3"], down_sigma_rad: float, treads: Sequence[Surface]
) -> Levelled:
    """Return the axes of the stair: level as treads and gravity, weighed, have it.

    Args:
        edge: Unit vector along the edges, pointing right as the camera looks at them.
        down: Down as the IMU or, without one, the bundle of treads tells it.
        treads: Surfaces that are taken for level.
    """
    d = down - float(down @ edge) * edge
    d /= np.linalg.norm(d)
    ahead = cross(edge, d)
    tilts, variances = [0.0], [down_sigma_rad**2]
    for tread in treads:
        n = tread.unit if float(tread.unit @ d) > 0.0 else -tread.unit
        tilts.append(float(np.arctan2(n @ ahead, n @ d)))
        variances.append(float(ahead @ tread.unit_covariance @ ahead))
    variances[0] = gravity_variance(np.array(tilts[1:]), down_sigma_rad)
    regular = np.zeros(len(tilts), dtype=bool)
    regular[0] = True
    tilt = pooled(np.array(tilts), np.array(variances), regular)
    d = np.cos(tilt.mean) * d + np.sin(tilt.mean) * ahead
    return Levelled(axes=Axes(ahead=cross(edge, d), up=-d, right=edge), down_sigma_rad=tilt.sigma)


def shape_of(flight: Sequence[Nosing], axes: Axes, direction: Direction) -> StairShape | None:
    """Return rise, run and slope, or None where no rise is seen or the steps are not alike."""
    places = _plain(flight) if len(_plain(flight)) >= 2 else flight
    ahead = np.array([float(nosing.point @ axes.ahead) for nosing in places])
    run = _spacing(ahead, STEP_RUN_M)
    rise = None if run is None else _rise(flight, axes, run)
    if run is None or rise is None:
        return None
    return StairShape(
        rise_m=rise,
        run_m=run,
        slope_rad=float(np.arctan2(rise, run)),
        distance_m=float(ahead.min()) - run * round((float(ahead.min()) - flight[0].ahead_m) / run),
        direction=direction,
    )


def _rise(flight: Sequence[Nosing], axes: Axes, run_m: float) -> float | None:
    """Return the rise from the heights that are known, of which some may be missing in between."""
    known = [nosing for nosing in flight if nosing.up_m is not None]
    number = np.array([float(round((nosing.ahead_m - flight[0].ahead_m) / run_m)) for nosing in known])
    heights = np.array([float(nosing.point @ axes.up) for nosing in known])
    if len(set(number.tolist())) < 2:
        return None
    slope, height = _straight(number, heights)
    rise = abs(slope)
    alike = np.abs(heights - height - slope * number) < EVEN * rise
    return rise if STEP_RISE_M[0] <= rise <= STEP_RISE_M[1] and alike.mean() >= ALIKE else None


def _plain(flight: Sequence[Nosing]) -> list[Nosing]:
    """Return the nosings whose place is known: a corner's is off by how far its tread is followed around it."""
    return [nosing for nosing in flight if nosing.is_plain]


def levels_of(treads: Sequence[Surface], axes: Axes) -> int:
    """Return how many levels of treads are evenly apart."""
    row = _row(_levels([float(tread.centre @ axes.up) for tread in treads]), STEP_RISE_M)
    return 0 if row is None else len(row[0])


def _levels(heights: Sequence[float]) -> list[float]:
    """Return the means of heights that are one level."""
    levels: list[list[float]] = []
    for height in sorted(heights):
        if levels and height - levels[-1][-1] <= SAME_LEVEL_M:
            levels[-1].append(height)
        else:
            levels.append([height])
    return [float(np.mean(level)) if len(level) > 1 else level[0] for level in levels]


def _spacing(places: Float[np.ndarray, " k"], limits: tuple[float, float]) -> float | None:
    """Return the distance of places that are equally far apart, some of them missing; None where too few are."""
    row = _row(places.tolist(), limits)
    if row is None or len(row[0]) < ALIKE * len(places):
        return None
    return _straight(row[1], row[0])[0]


def _straight(x: Float[np.ndarray, " k"], y: Float[np.ndarray, " k"]) -> tuple[float, float]:
    """Return slope and level at zero of the straight line through some points."""
    mx, my = float(x.mean()), float(y.mean())
    slope = float((x - mx) @ (y - my)) / float((x - mx) @ (x - mx))
    return slope, my - slope * mx


def _row(places: Sequence[float], limits: tuple[float, float]) -> tuple[Float[np.ndarray, " j"], Float[np.ndarray, " j"]] | None:
    """Return the longest row of places that are equally far apart, and the number of each."""
    places = sorted(places)
    gaps = [far - near for near, far in pairwise(places)]
    steps = [gap for gap in gaps if limits[0] <= gap <= limits[1]]
    if not steps:
        return None
    first = median(steps)
    rows = [[(places[0], 0)]]
    for place, gap in zip(places[1:], gaps, strict=True):
        # Whole numbers of steps between neighbours; a gap that is none ends the row.
        count = round(gap / first)
        if count >= 1 and abs(gap - count * first) < EVEN * first:
            rows[-1].append((place, rows[-1][-1][1] + count))
        else:
            rows.append([(place, 0)])
    row = max(rows, key=len)
    if len(row) < 2:
        return np.array([0.0, first]), np.array([0.0, 1.0])
    return np.array([place for place, _ in row]), np.array([float(number) for _, number in row])


def directions_of(
    t_s: float,
    flight: Sequence[Nosing],
    levelled: Levelled,
    shape: StairShape,
    edge: Float[np.ndarray, " 3"],
    edge_sigma_rad: float,
) -> StairAxes:
    """Return the stair's directions in C, for whoever wants to know how the camera is mounted.

    Args:
        edge: Unit vector along the edges, to the chair's right.
    """
    axes = levelled.axes
    span = max(len(flight) - 1, 1) * float(np.hypot(shape.rise_m, shape.run_m))
    return StairAxes(
        t_s=t_s,
        edge_C=edge,
        down_C=-axes.up,
        normal_C=normal_of(axes, shape),
        edge_sigma_rad=edge_sigma_rad,
        down_sigma_rad=levelled.down_sigma_rad,
        normal_sigma_rad=float(np.sqrt(2.0) * SHAPE_SIGMA_M / span),
    )


def normal_of(axes: Axes, shape: StairShape) -> Float[np.ndarray, " 3"]:
    """Return the unit normal of the nosing plane, away from the stair."""
    tilt = shape.slope_rad if shape.direction == "up" else -shape.slope_rad
    return np.asarray(np.cos(tilt) * axes.up - np.sin(tilt) * axes.ahead)


def points_of(flight: Sequence[Nosing], axes: Axes, shape: StairShape) -> list[Float[np.ndarray, " 3"]]:
    """Return a point on each nosing; heights that are not seen, and places of corners, follow from those that are known."""
    sign = 1.0 if shape.direction == "up" else -1.0
    high = [nosing for nosing in flight if nosing.up_m is not None]
    plain = _plain(flight)
    points = []
    for nosing in flight:
        point = nosing.point
        if nosing.up_m is None and high:
            nearest, steps = _neighbour(nosing, high, shape.run_m)
            up_m = float(nearest.point @ axes.up) + sign * steps * shape.rise_m
            point = point + (up_m - float(point @ axes.up)) * axes.up
        if not nosing.is_plain and plain:
            nearest, steps = _neighbour(nosing, plain, shape.run_m)
            ahead_m = float(nearest.point @ axes.ahead) + steps * shape.run_m
            point = point + (ahead_m - float(point @ axes.ahead)) * axes.ahead
        points.append(point)
    return points


def _neighbour(nosing: Nosing, others: Sequence[Nosing], run_m: float) -> tuple[Nosing, int]:
    """Return the nearest of some nosings and how many steps ahead of it a nosing is."""
    nearest = min(others, key=lambda other: abs(other.ahead_m - nosing.ahead_m))
    return nearest, round((nosing.ahead_m - nearest.ahead_m) / run_m)
