"""Axes and dimensions of a flight: vertical, rise, run and slope with their standard deviations.

Errors have three parts: those of single surfaces, irregularity of single steps and of single spacings, and errors common to all
steps, which do not average out: the vertical, and a warp of the depth image. A tread far away covers few rows, and pixels of the
risers at its ends within the tolerance of its plane turn it towards the nosing plane: the vertical takes this into account.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from treadline.core.arrays import cross
from treadline.core.camera_images import PinholeCamera, StairAxes
from treadline.core.rotations import Vector3
from treadline.perception import _plane_segmentation_kernels as surface_kernels
from treadline.perception._gravity_direction import gravity_variance
from treadline.perception._irregularity import pooled_mean, posterior_weights
from treadline.perception._lattice_kernels import (
    HIDDEN_SIGMA_M,
    OVERHANG_SIGMA_M,
)
from treadline.perception._nuisance import stretch_of
from treadline.perception._step_parts import Axes, Direction, Flight, axes_about, riser_rows, tread_rows
from treadline.perception.plane_segmentation import End, PlanarBlocks, Surface

IRREGULAR_M = np.geomspace(0.0005, 0.015, 6)
"""Grid of the standard deviations of single steps from the lattice, and of single spacings [m]: from cast steps to worn ones."""
ENDS: tuple[End, End] = ("upper", "lower")
"""Ends of a surface in the image."""
PAST_SIGMA_M = 0.010
"""Standard deviation of the shift of ends without a surface next to them [m]: half of the width of a metal strip or a shadow."""
USUAL_M = 0.0031
"""Standard deviation at which the prior of the irregularity is halved [m], decreasing beyond: the largest and the smallest of ten
risers then differ by 9.5 mm, the limit of building codes (IBC 1011.5.4)."""
IRREGULAR_LOGS = -np.add.outer(np.log1p(IRREGULAR_M / USUAL_M), np.log1p(IRREGULAR_M / USUAL_M)).ravel()
"""Log prior of each pair of standard deviations, of steps and of spacings."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StairShape:
    """Dimensions of the stair from one frame."""

    rise_m: float
    run_m: float
    slope_rad: float
    rise_sigma_m: float
    run_sigma_m: float
    slope_sigma_rad: float
    """Standard deviation of the slope of the nosing plane, the error of the vertical included [rad]."""
    plane_sigma_rad: float
    """Standard deviation of the angle of the nosing plane in the camera frame, which has no error of the vertical [rad]."""
    distance_m: float
    """Horizontal distance from the camera to the nearest visible nosing, perpendicular to the nosing [m]."""
    direction: Direction
    """Direction of the visible flight: rising or falling."""

    def normal(self, axes: Axes) -> Vector3:
        """Return the unit normal of the nosing plane in C, pointing away from the stair."""
        tilt = self.slope_rad if self.direction == "up" else -self.slope_rad
        return np.asarray(np.cos(tilt) * axes.up - np.sin(tilt) * axes.ahead)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Levelled:
    """Axes of the stair and the uncertainty of the vertical."""

    axes: Axes
    down_sigma_rad: float
    """Standard deviation of the vertical [rad]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Placed:
    """Values of one kind of part: heights of treads, tops of risers, and so on."""

    steps: Int[np.ndarray, " k"]
    values_m: Float[np.ndarray, " k"]
    variances_m2: Float[np.ndarray, " k"]
    common_m: Float[np.ndarray, "k c"]
    """Change of each value by one standard deviation of each error that all parts have in common."""
    offset_sigma_m: float = 0.0
    """Standard deviation of an offset common to the kind [m]; zero for the kind that defines the nosing."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Spacing:
    """Spacing of a stair's steps."""

    mean_m: float
    own_variance_m2: float
    """Variance without that of the common errors."""
    common_m: Float[np.ndarray, " c"]
    """Change by one standard deviation of each common error."""

    @property
    def sigma_m(self) -> float:
        """Standard deviation, common errors included."""
        return math.sqrt(self.own_variance_m2 + float(self.common_m @ self.common_m))


def axes_of(
    edge: Vector3,
    down: Vector3,
    down_sigma_rad: float,
    treads: Sequence[Surface],
    adjoining_rad: Sequence[float],
) -> Levelled:
    """Return the axes of the stair, with the vertical as weighted mean of treads and gravity.

    Args:
        edge: Unit vector along the edges, pointing right in the camera's view.
        down: Gravity direction from the IMU or from the treads.
        treads: Surfaces assumed to be horizontal.
        adjoining_rad: Standard deviation of the tilt of each by pixels of adjacent risers.
    """
    start = axes_about(edge, down)
    d, ahead = -start.up, start.ahead
    tilts, variances = [0.0], [down_sigma_rad**2]
    for tread, by_risers_rad in zip(treads, adjoining_rad, strict=True):
        n = tread.unit if float(tread.unit @ d) > 0.0 else -tread.unit
        tilts.append(float(np.arctan2(n @ ahead, n @ d)))
        variances.append(float(ahead @ tread.unit_covariance @ ahead) + by_risers_rad**2)
    variances[0] = gravity_variance(np.array(tilts[1:]), down_sigma_rad)
    regular = np.zeros(len(tilts), dtype=bool)
    regular[0] = True
    tilt = pooled_mean(np.array(tilts), np.array(variances), regular)
    d = np.cos(tilt.mean) * d + np.sin(tilt.mean) * ahead
    return Levelled(axes=Axes(ahead=cross(edge, d), up=-d, right=edge), down_sigma_rad=tilt.sigma)


def stair_axes_of(t_s: float, levelled: Levelled, shape: StairShape, edge: Vector3, edge_sigma_rad: float) -> StairAxes:
    """Return the stair's directions in C, for the calibration of the camera mount.

    Args:
        edge: Unit vector along the edges, to the chair's right.
    """
    axes = levelled.axes
    return StairAxes(
        t_s=t_s,
        edge_C=edge,
        down_C=-axes.up,
        normal_C=shape.normal(axes),
        edge_sigma_rad=edge_sigma_rad,
        down_sigma_rad=levelled.down_sigma_rad,
        normal_sigma_rad=shape.plane_sigma_rad,
    )


def shape_of(flight: Flight, blocks: PlanarBlocks, camera: PinholeCamera, levelled: Levelled, warp_px: float) -> StairShape:
    """Return the dimensions of a flight.

    Args:
        warp_px: Size of the depth warp [px of Kinect disparity].
    """
    rise, run = _rise_and_run(flight, blocks, camera, levelled, warp_px)
    square = rise.mean_m**2 + run.mean_m**2
    common = (run.mean_m * rise.common_m - rise.mean_m * run.common_m) / square
    own = (run.mean_m**2 * rise.own_variance_m2 + rise.mean_m**2 * run.own_variance_m2) / square**2
    # The angle of the nosing plane in the camera frame is the slope less the error of the vertical, which is the last one.
    in_camera = common + np.append(np.zeros(common.size - 1), levelled.down_sigma_rad)
    return StairShape(
        rise_m=rise.mean_m,
        run_m=run.mean_m,
        rise_sigma_m=rise.sigma_m,
        run_sigma_m=run.sigma_m,
        slope_rad=math.atan2(rise.mean_m, run.mean_m),
        slope_sigma_rad=math.sqrt(own + float(common @ common)),
        plane_sigma_rad=math.sqrt(own + float(in_camera @ in_camera)),
        distance_m=flight.nosings[0].ahead_m,
        direction=flight.direction,
    )


def _rise_and_run(
    flight: Flight, blocks: PlanarBlocks, camera: PinholeCamera, levelled: Levelled, warp_px: float
) -> tuple[Spacing, Spacing]:
    """Return rise and run: planes determine them, ends add to them."""
    axes, sign = levelled.axes, 1.0 if flight.direction == "up" else -1.0
    treads = tread_rows([tread for *_, tread in flight.matched_treads], blocks, axes, camera, flight.direction)
    risers = riser_rows([riser for _, riser in flight.matched_risers], blocks, axes, camera)
    of_tread = np.array([step for step, *_ in flight.matched_treads], dtype=np.int64)
    front_on = np.array([on for _, on, _ in flight.matched_treads], dtype=np.bool_)
    of_riser = np.array([step for step, _ in flight.matched_risers], dtype=np.int64)
    surfaces = [tread.surface for *_, tread in flight.matched_treads] + [riser.surface for _, riser in flight.matched_risers]
    centres = np.array([surface.centre for surface in surfaces])
    stretch = warp_px * stretch_of(centres, camera)
    noise = np.array([surface.distance_variance for surface in surfaces])
    # A rotation about the edges lowers what is ahead, and moves what is above ahead.
    lowered, moved = (levelled.down_sigma_rad * (centres @ axis)[:, None] for axis in (-axes.ahead, sign * axes.up))

    def placed(
        steps: Int[np.ndarray, " k"],
        values: Float[np.ndarray, "k 2"],
        turned: Float[np.ndarray, "k 1"],
        stretched: Float[np.ndarray, "k t"],
        offset_sigma_m: float,
        shifts_m: Float[np.ndarray, "k 2"] | float = 0.0,
    ) -> Placed:
        known = np.isfinite(values[:, 1])
        shifts = np.full((len(values), 2), shifts_m)
        common = np.column_stack([values[:, :1] * stretched, shifts, turned])[known]
        return Placed(
            steps=steps[known],
            values_m=values[known, 0],
            variances_m2=values[known, 1],
            common_m=common,
            offset_sigma_m=offset_sigma_m,
        )

    of_treads, of_risers = slice(None, len(treads)), slice(len(treads), None)
    heights, places = treads[:, 0], risers[:, 0]
    own_heights = np.column_stack([heights, noise[of_treads] * heights**2])
    own_places = np.column_stack([places, noise[of_risers] * places**2])
    low, high = lowered[of_risers], stretch[of_risers]
    of_upper, of_lower = (_shifts_m([riser.surface for _, riser in flight.matched_risers], end, blocks, camera) for end in ENDS)
    rise = [
        placed(of_tread, own_heights, lowered[of_treads], stretch[of_treads], 0.0),
        placed(of_riser, risers[:, 2:4], low, high, HIDDEN_SIGMA_M, of_upper),
        placed(of_riser - 1, risers[:, 4:6], low, high, HIDDEN_SIGMA_M, -of_lower),
    ]
    run = [
        placed(of_riser, own_places, moved[of_risers], stretch[of_risers], 0.0),
        placed(
            of_tread[front_on], treads[front_on, 2:4], moved[of_treads][front_on], stretch[of_treads][front_on], OVERHANG_SIGMA_M
        ),
    ]
    return spacing(rise, flight.size_prior[0]), spacing(run, flight.size_prior[1])


def _shifts_m(risers: Sequence[Surface], end: End, blocks: PlanarBlocks, camera: PinholeCamera) -> Float[np.ndarray, "k 2"]:
    """Return the standard deviations of the common outward shifts of the risers' ends that have no surface next to them [m].

    A metal strip or a shadow shifts all of them alike; a matching window shifts those before a larger depth by pixels.
    """
    ends = [riser.upper if end == "upper" else riser.lower for riser in risers]
    follows = np.array([np.bincount(found.follows, minlength=1).argmax() for found in ends], dtype=np.int64)
    pixels_m = np.array([riser.distance_m for riser in risers]) / camera.fy_px
    of_window = np.where(follows == surface_kernels.BEYOND, blocks.spread_px * pixels_m, 0.0)
    return np.column_stack([np.where(follows == surface_kernels.CREASE, 0.0, PAST_SIGMA_M), of_window])


def spacing(parts: Sequence[Placed], prior: tuple[float, float]) -> Spacing:
    """Return the spacing of a stair's steps from all kinds of parts.

    Single spacings differ, so that deviations of the steps from the lattice accumulate, and each step deviates on its own, with all
    of its parts. The sizes of both deviations are unknown: the estimates for each pair of sizes are averaged by posterior weight.

    Args:
        prior: Mean and standard deviation of the spacing.
    """
    steps = np.concatenate([part.steps for part in parts])
    values = np.concatenate([part.values_m for part in parts])
    common = np.concatenate([part.common_m for part in parts])
    noise = np.diag(np.concatenate([part.variances_m2 for part in parts])) + common @ common.T
    kinds = np.concatenate([np.full(part.steps.size, k) for k, part in enumerate(parts)])
    offsets = np.array([part.offset_sigma_m for part in parts])[kinds] ** 2
    noise += np.where(kinds[:, None] == kinds[None, :], offsets[:, None], 0.0)
    # One weighted mean for each step has all of the information on the lattice.
    of_step = np.unique(steps)
    at = (steps[:, None] == of_step[None, :]).astype(float)
    pooled = np.linalg.inv(noise) @ at
    own = np.linalg.inv(at.T @ pooled)
    values, common = own @ pooled.T @ values, own @ pooled.T @ common
    after = (of_step - of_step[0]).astype(float)
    by = np.column_stack([np.ones(after.size), after])
    squares = IRREGULAR_M[:, None, None] ** 2
    alone, accumulated = squares * np.eye(after.size), squares * np.minimum.outer(after, after)
    inverse = np.linalg.inv(own + (alone[:, None] + accumulated[None, :]).reshape(-1, after.size, after.size))
    normal = by.T @ inverse @ by + np.diag([0.0, prior[1] ** -2])
    covariance = np.linalg.inv(normal)
    right = by.T @ inverse @ values + [0.0, prior[0] / prior[1] ** 2]
    solution = np.einsum("gij,gj->gi", covariance, right)
    chi = values @ inverse @ values + (prior[0] / prior[1]) ** 2 - np.einsum("gi,gi->g", solution, right)
    likelihoods = 0.5 * (np.linalg.slogdet(inverse)[1] + np.linalg.slogdet(covariance)[1] - chi)
    weights = posterior_weights(likelihoods + IRREGULAR_LOGS)
    mean = float(weights @ solution[:, 1])
    total = float(weights @ (covariance[:, 1, 1] + (solution[:, 1] - mean) ** 2))
    response = weights @ (covariance[:, 1:] @ by.T @ inverse @ common)[:, 0]
    return Spacing(mean_m=mean, own_variance_m2=max(total - float(response @ response), 0.0), common_m=response)
