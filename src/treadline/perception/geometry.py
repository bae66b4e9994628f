"""Axes and dimensions of the stair from the nosings of one frame."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from statistics import median

import numpy as np
from jaxtyping import Float

from treadline.perception.detection import StairShape
from treadline.perception.direction import gravity_variance
from treadline.perception.nosings import STEP_RISE_M, STEP_RUN_M, Axes, Direction, NosingObservation
from treadline.perception.planes import Surface
from treadline.perception.random_effects import pooled_mean
from treadline.perception.vectors import cross
from treadline.signals import StairAxes

EVEN = 0.25
"""Largest relative deviation of a single step: furniture deviates more."""
SAME_LEVEL_M = 0.03
"""Largest height difference within one level [m]."""
ALIKE = 0.75
"""Least fraction of the visible nosings with even spacing."""
SHAPE_SIGMA_M = 0.0055
"""Standard deviation of a nosing position [m]: sensor noise and irregularity of the stair."""


def first_crowd(places: Float[np.ndarray, " k"], within: float, least: int) -> list[float]:
    """Return the nearest cluster of at least ``least`` places, in order, and its start; an empty list without one."""
    places = np.sort(places)
    together = np.searchsorted(places, places + within) - np.arange(places.size)
    first = np.flatnonzero(together >= least)
    return places[first[0] : first[0] + together[first[0]]].tolist() if first.size else []


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Levelled:
    """Axes of the stair and the uncertainty of the vertical."""

    axes: Axes
    down_sigma_rad: float
    """Standard deviation of the vertical [rad]."""


def viewing_direction(R_BC: Float[np.ndarray, "3 3"]) -> float:
    """Return 1 for a front camera, and -1 for a camera looking back over the chair.

    For a camera looking straight down, the upper edge of its image gives the direction.
    """
    look, image_up = R_BC[0, 2], -R_BC[0, 1]
    return 1.0 if look + image_up > 0.0 else -1.0


def axes_of(
    edge: Float[np.ndarray, " 3"], down: Float[np.ndarray, " 3"], down_sigma_rad: float, treads: Sequence[Surface]
) -> Levelled:
    """Return the axes of the stair, with the vertical as weighted mean of treads and gravity.

    Args:
        edge: Unit vector along the edges, pointing right in the camera's view.
        down: Gravity direction from the IMU or from the treads.
        treads: Surfaces assumed to be horizontal.
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
    tilt = pooled_mean(np.array(tilts), np.array(variances), regular)
    d = np.cos(tilt.mean) * d + np.sin(tilt.mean) * ahead
    return Levelled(axes=Axes(ahead=cross(edge, d), up=-d, right=edge), down_sigma_rad=tilt.sigma)


def shape_of(flight: Sequence[NosingObservation], axes: Axes, direction: Direction) -> StairShape | None:
    """Return rise, run and slope, or None without a visible rise or with uneven steps."""
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


def _rise(flight: Sequence[NosingObservation], axes: Axes, run_m: float) -> float | None:
    """Return the rise from the known heights, some of which may be missing."""
    known = [nosing for nosing in flight if nosing.up_m is not None]
    number = np.array([float(round((nosing.ahead_m - flight[0].ahead_m) / run_m)) for nosing in known])
    heights = np.array([float(nosing.point @ axes.up) for nosing in known])
    if len(set(number.tolist())) < 2:
        return None
    slope, height = _straight(number, heights)
    rise = abs(slope)
    alike = np.abs(heights - height - slope * number) < EVEN * rise
    return rise if STEP_RISE_M[0] <= rise <= STEP_RISE_M[1] and alike.mean() >= ALIKE else None


def _plain(flight: Sequence[NosingObservation]) -> list[NosingObservation]:
    """Return the nosings with a known position: that of a corner depends on how far its tread is followed."""
    return [nosing for nosing in flight if nosing.is_plain]


def levels_of(treads: Sequence[Surface], axes: Axes) -> int:
    """Return the number of evenly spaced tread levels."""
    row = _row(_levels([float(tread.centre @ axes.up) for tread in treads]), STEP_RISE_M)
    return 0 if row is None else len(row[0])


def _levels(heights: Sequence[float]) -> list[float]:
    """Return the mean height of each level."""
    levels: list[list[float]] = []
    for height in sorted(heights):
        if levels and height - levels[-1][-1] <= SAME_LEVEL_M:
            levels[-1].append(height)
        else:
            levels.append([height])
    return [float(np.mean(level)) if len(level) > 1 else level[0] for level in levels]


def _spacing(places: Float[np.ndarray, " k"], limits: tuple[float, float]) -> float | None:
    """Return the spacing of evenly spaced places, some of them missing; None with too few places."""
    row = _row(places.tolist(), limits)
    if row is None or len(row[0]) < ALIKE * len(places):
        return None
    return _straight(row[1], row[0])[0]


def _straight(x: Float[np.ndarray, " k"], y: Float[np.ndarray, " k"]) -> tuple[float, float]:
    """Return slope and intercept of the least-squares line."""
    mx, my = float(x.mean()), float(y.mean())
    slope = float((x - mx) @ (y - my)) / float((x - mx) @ (x - mx))
    return slope, my - slope * mx


def _row(places: Sequence[float], limits: tuple[float, float]) -> tuple[Float[np.ndarray, " j"], Float[np.ndarray, " j"]] | None:
    """Return the longest sequence of evenly spaced places, and the index of each."""
    places = sorted(places)
    gaps = [far - near for near, far in pairwise(places)]
    steps = [gap for gap in gaps if limits[0] <= gap <= limits[1]]
    if not steps:
        return None
    first = median(steps)
    rows = [[(places[0], 0)]]
    for place, gap in zip(places[1:], gaps, strict=True):
        # Integer numbers of steps between neighbours; any other gap ends the sequence.
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
    flight: Sequence[NosingObservation],
    levelled: Levelled,
    shape: StairShape,
    edge: Float[np.ndarray, " 3"],
    edge_sigma_rad: float,
) -> StairAxes:
    """Return the stair's directions in C, for the calibration of the camera mount.

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
    """Return the unit normal of the nosing plane, pointing away from the stair."""
    tilt = shape.slope_rad if shape.direction == "up" else -shape.slope_rad
    return np.asarray(np.cos(tilt) * axes.up - np.sin(tilt) * axes.ahead)


def points_of(flight: Sequence[NosingObservation], axes: Axes, shape: StairShape) -> list[Float[np.ndarray, " 3"]]:
    """Return a point on each nosing; unknown heights, and positions of corners, follow from the known ones."""
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


def _neighbour(nosing: NosingObservation, others: Sequence[NosingObservation], run_m: float) -> tuple[NosingObservation, int]:
    """Return the nearest of some nosings, and the number of steps to it."""
    nearest = min(others, key=lambda other: abs(other.ahead_m - nosing.ahead_m))
    return nearest, round((nosing.ahead_m - nearest.ahead_m) / run_m)
