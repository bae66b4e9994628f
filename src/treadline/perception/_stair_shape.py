"""Axes and dimensions of a flight: vertical, rise, run and slope with their standard deviations.

Errors have three parts: those of single surfaces, irregularity of single steps and of single spacings, and errors common to all
steps, which do not average out: the vertical, and a warp of the depth image. A tread far away covers few rows, and pixels of the
risers at its ends within the tolerance of its plane turn it towards the nosing plane: the vertical takes this into account.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from treadline.core.arrays import cross
from treadline.core.camera_images import PinholeCamera, StairAxes
from treadline.core.rotations import Vector3
from treadline.core.signals import Direction
from treadline.perception import _plane_segmentation_kernels as surface_kernels
from treadline.perception._gravity_direction import gravity_variance
from treadline.perception._lattice_kernels import HIDDEN_SIGMA_M, OVERHANG_SIGMA_M
from treadline.perception._nuisance import pooled_mean, posterior_weights, stretch_of
from treadline.perception._nuisance_kernels import normal_equations
from treadline.perception._plane_segmentation import Ends, PlanarBlocks, Surface
from treadline.perception._step_parts import VAGUE_SIGMA_M, Axes, Flight, axes_about, riser_rows, tread_rows
from treadline.perception.free_ground import blind_distance_m

IRREGULAR_M = np.geomspace(0.0005, 0.015, 4)
"""Grid of the standard deviations of single steps from the lattice, and of single spacings [m]: from cast steps to worn ones."""
USUAL_M = 0.0031
"""Standard deviation at which the prior of the irregularity is halved [m], decreasing beyond: the largest and the smallest of ten
risers then differ by 9.5 mm, the limit of building codes (IBC 1011.5.4)."""
DETOUR_M = 0.005
"""Standard deviation of the change of range along a tread towards its corner with the next riser, by light that takes a detour over
that riser to a time-of-flight camera [m]: of 2 to 50 mm in a corner (Fuchs, ICPR 2010)."""


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
    distance_m: float
    """Horizontal distance from the camera to the nearest visible nosing, perpendicular to the nosing [m]."""
    blind_m: float
    """Distance from the camera below which a nosing of this flight is below the image [m]: a nearer one may be there."""
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


class Placed(NamedTuple):
    """Values of parts on a lattice: heights of treads, tops of risers, and so on."""

    steps: Int[np.ndarray, " k"]
    values_m: Float[np.ndarray, " k"]
    variances_m2: Float[np.ndarray, " k"]
    """Variance of each value; infinite for an unknown one."""
    shared_m: Float[np.ndarray, "k o"]
    """Change of each value by one standard deviation of each error that parts of one kind have in common."""
    common_m: Float[np.ndarray, "k c"]
    """Change by each error that all surfaces of the frame have in common."""


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
    edge: Vector3, down: Vector3, down_sigma_rad: float, flight: Flight, blocks: PlanarBlocks, camera: PinholeCamera
) -> Levelled:
    """Return the axes of the stair, with the vertical as weighted mean of treads and gravity.

    Args:
        edge: Unit vector along the edges, pointing right in the camera's view.
        down: Gravity direction from the IMU or from the treads.
    """
    start = axes_about(edge, down)
    d, ahead = -start.up, start.ahead
    runs_m = {id(tread.surface): flight.run_m for _, on, tread in flight.matched_treads if on}
    tilts, variances, detours = [0.0], [down_sigma_rad**2], [0.0]
    for tread in flight.treads:
        n = math.copysign(1.0, float(tread.unit @ d)) * tread.unit
        tilts.append(math.atan2(float(n @ ahead), float(n @ d)))
        by_risers_rad = tread.adjoining_tilt_rad(camera, ahead, blocks.noise, runs_m.get(id(tread), math.inf))
        variances.append(float(ahead @ tread.unit_covariance @ ahead) + by_risers_rad**2)
        along_normal = tread.distance_m / float(np.linalg.norm(tread.centre))
        detours.append(DETOUR_M * along_normal / flight.run_m if blocks.measures_range else 0.0)
    by_detours = float(np.mean(np.square(detours[1:]))) if flight.treads else 0.0
    variances[0] = gravity_variance(np.array(tilts[1:]), math.sqrt(down_sigma_rad**2 + by_detours)) - by_detours
    regular = np.arange(len(tilts)) == 0
    tilt_rad, sigma_rad = pooled_mean(np.array(tilts), np.array(variances), regular, common=np.array(detours))
    d = np.cos(tilt_rad) * d + np.sin(tilt_rad) * ahead
    return Levelled(axes=Axes(ahead=cross(edge, d), up=-d, right=edge), down_sigma_rad=sigma_rad)


def stair_axes_of(t_s: float, levelled: Levelled, shape: StairShape, edge: Vector3) -> StairAxes:
    """Return the stair's directions in C, for the calibration of the camera mount.

    Args:
        edge: Unit vector along the edges, to the chair's right.
    """
    axes = levelled.axes
    return StairAxes(t_s=t_s, edge_C=edge, down_C=-axes.up, normal_C=shape.normal(axes), down_sigma_rad=levelled.down_sigma_rad)


def shape_of(flight: Flight, blocks: PlanarBlocks, camera: PinholeCamera, levelled: Levelled, warp_px: float) -> StairShape:
    """Return the dimensions of a flight.

    Args:
        warp_px: Size of the depth warp [px of Kinect disparity].
    """
    rise, run = _rise_and_run(flight, blocks, camera, levelled, warp_px)
    square = rise.mean_m**2 + run.mean_m**2
    common = (run.mean_m * rise.common_m - rise.mean_m * run.common_m) / square
    own = (run.mean_m**2 * rise.own_variance_m2 + rise.mean_m**2 * run.own_variance_m2) / square**2
    slope_rad = math.atan2(rise.mean_m, run.mean_m)
    return StairShape(
        rise_m=rise.mean_m,
        run_m=run.mean_m,
        rise_sigma_m=rise.sigma_m,
        run_sigma_m=run.sigma_m,
        slope_rad=slope_rad,
        slope_sigma_rad=math.sqrt(own + float(common @ common)),
        distance_m=flight.nosings[0].ahead_m,
        blind_m=_blind_m(flight, camera, levelled.axes, slope_rad if flight.direction == "up" else -slope_rad),
        direction=flight.direction,
    )


def _blind_m(flight: Flight, camera: PinholeCamera, axes: Axes, tilt_rad: float) -> float:
    """Return the horizontal distance from which on the nosing plane is in the image, straight ahead [m]."""
    along = math.cos(tilt_rad) * axes.ahead + math.sin(tilt_rad) * axes.up
    plane = np.stack([along, -axes.right, cross(-axes.right, -along)])
    height_m = -float(plane[2] @ flight.nosings[0].point)
    seen_m = blind_distance_m(camera, plane, np.array([0.0, 0.0, height_m]), 0.0)
    return min(seen_m * math.cos(tilt_rad) + height_m * math.sin(tilt_rad), flight.nosings[0].ahead_m)


def _rise_and_run(
    flight: Flight, blocks: PlanarBlocks, camera: PinholeCamera, levelled: Levelled, warp_px: float
) -> tuple[Spacing, Spacing]:
    """Return rise and run: planes determine them, ends add to them."""
    axes, sign = levelled.axes, 1.0 if flight.direction == "up" else -1.0
    of_tread = np.array([step for step, *_ in flight.matched_treads], dtype=np.int64)
    of_riser = np.array([step for step, _ in flight.matched_risers], dtype=np.int64)
    front_on = np.array([on for _, on, _ in flight.matched_treads], dtype=np.bool_)
    treads = tread_rows([tread for *_, tread in flight.matched_treads], blocks, axes, camera, flight.direction)
    risers = riser_rows([riser for _, riser in flight.matched_risers], blocks, axes, camera)
    faces = [riser.surface for _, riser in flight.matched_risers]
    surfaces = [*(tread.surface for *_, tread in flight.matched_treads), *faces]
    centres = np.array([surface.centre for surface in surfaces])
    noise = np.array([surface.distance_variance for surface in surfaces])
    stretch = warp_px * stretch_of(centres, camera)
    # A rotation about the edges lowers what is ahead, and moves what is above ahead.
    lowered, moved = (levelled.down_sigma_rad * (centres @ axis) for axis in (-axes.ahead, sign * axes.up))
    own, above = slice(None, len(treads)), slice(len(treads), None)

    def placed(steps: Any, values: Any, variances: Any, of: slice, turned: Any, *shared: Any) -> Placed:
        """Return parts, with the errors that their kind shares: an offset of its own, and shifts of ends."""
        columns = np.zeros((len(values), 4))
        for k, column in shared:
            columns[:, k] = column
        return Placed(steps, values, variances, columns, np.column_stack([values[:, None] * stretch[of], turned[of]]))

    rise = [placed(of_tread, treads[:, 0], noise[own] * treads[:, 0] ** 2, own, lowered)]
    for end, down, at, outward in (("upper", 0, 2, 1.0), ("lower", 1, 4, -1.0)):
        past, of_window = outward * _shifts_m(faces, [getattr(face, end) for face in faces], blocks, camera)
        offset = (down, HIDDEN_SIGMA_M)
        rise.append(placed(of_riser - down, risers[:, at], risers[:, at + 1], above, lowered, offset, (2, past), (3, of_window)))
    fronts = np.where(front_on, treads[:, 3], np.inf)
    run = [
        placed(of_riser, risers[:, 0], noise[above] * risers[:, 0] ** 2, above, moved),
        placed(of_tread, treads[:, 2], fronts, own, moved, (0, OVERHANG_SIGMA_M)),
    ]
    return spacing(rise, flight.size_prior[0]), spacing(run, flight.size_prior[1])


def _shifts_m(
    risers: Sequence[Surface], ends: Sequence[Ends], blocks: PlanarBlocks, camera: PinholeCamera
) -> Float[np.ndarray, "2 k"]:
    """Return the standard deviations of the common outward shifts of the risers' ends that have no surface next to them [m].

    Half of the width of a metal strip or a shadow shifts all of them alike; a matching window shifts those before a larger depth
    by pixels.
    """
    follows = np.array([np.bincount(end.follows, minlength=1).argmax() for end in ends], dtype=np.int64)
    pixels_m = np.array([riser.distance_m for riser in risers]) / camera.fy_px
    of_window = np.where(follows == surface_kernels.BEYOND, blocks.spread_px * pixels_m, 0.0)
    return np.array([np.where(follows == surface_kernels.CREASE, 0.0, 0.5 * VAGUE_SIGMA_M), of_window])


def spacing(parts: Sequence[Placed], prior: tuple[float, float]) -> Spacing:
    """Return the spacing of a stair's steps from all kinds of parts.

    Single spacings differ, so that deviations of the steps from the lattice accumulate, and each step deviates on its own, with all
    of its parts. The sizes of both deviations are unknown: the estimates for each pair of sizes are averaged by posterior weight.

    Args:
        prior: Mean and standard deviation of the spacing.
    """
    known = np.concatenate([np.isfinite(part.variances_m2) for part in parts])
    steps, values, variances, shared, common = (np.concatenate(field)[known] for field in zip(*parts, strict=True))
    after = (steps - steps.min(initial=0)).astype(float)
    kinds = np.array([after[:, None] == after, np.minimum.outer(after, after), shared @ shared.T + common @ common.T])
    alone, accumulated = (sizes.ravel() for sizes in np.meshgrid(IRREGULAR_M, IRREGULAR_M))
    squares = np.column_stack([alone, accumulated, np.ones(alone.size)]) ** 2
    right = np.column_stack([np.ones(after.size), after, values, common])
    logs, products = normal_equations(variances, kinds, squares, right)
    weight = prior[1] ** -2.0
    target = products[:, :2, 2] + np.array([0.0, prior[0] * weight])
    # The first height is hardly known in advance: to a metre.
    covariance = np.linalg.inv(products[:, :2, :2] + np.diag([1.0, weight]))
    solution = np.einsum("gij,gj->gi", covariance, target)
    logs = logs + 0.5 * (np.linalg.slogdet(covariance)[1] + np.einsum("gi,gi->g", solution, target) - products[:, 2, 2])
    weights = posterior_weights(logs - np.log1p(alone / USUAL_M) - np.log1p(accumulated / USUAL_M))
    mean = float(weights @ solution[:, 1])
    total = float(weights @ (covariance[:, 1, 1] + (solution[:, 1] - mean) ** 2))
    response = weights @ np.einsum("gi,gic->gc", covariance[:, 1], products[:, :2, 3:])
    return Spacing(mean_m=mean, own_variance_m2=max(total - float(response @ response), 0.0), common_m=response)
