"""Nuisance directions: how errors common to all surfaces of a frame rotate the normals of planes and lines.

Each direction is an unknown of the edge fit, scaled to a prior standard deviation of one:

* Warp of the depth image, specific to the camera: Legendre terms up to third order in the image coordinates, with decreasing sizes.
* Spread of edges: a matching window enlarges near surfaces by half of its width, which shifts all lines at their ends outwards. A
  shifted image line of an edge that is not parallel to the image has another direction.
* Detour: light that reaches a riser over treads and walls increases the distances of a time-of-flight camera, more so at one side.
* Curvature of the flight: edges rotate in proportion to their distance from the chair.
* Motion during the readout of a rolling shutter: each row sees the stair from another pose.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from treadline.core.angles import DEG
from treadline.core.arrays import cross
from treadline.core.camera_images import PinholeCamera
from treadline.core.rotations import Vector3
from treadline.perception import _nuisance_kernels as nuisance_kernels
from treadline.perception.plane_segmentation import DISPARITY_PX_M, Line, Surface

ORDER = 3
"""Largest order of the Legendre terms."""
POWERS = tuple((i, j) for i in range(ORDER + 1) for j in range(ORDER + 1) if 0 < i + j <= ORDER)
"""Orders down and across the image; the constant term is excluded."""
TERMS = len(POWERS)
"""Number of warp terms."""
_SIZES = np.array([1.0 / (1.0 + i + j) for i, j in POWERS])
_SQUARES = np.array([1.0 / ((2.0 * i + 1.0) * (2.0 * j + 1.0)) for i, j in POWERS])
SIZES = _SIZES / np.sqrt(_SIZES**2 @ _SQUARES) / DISPARITY_PX_M
"""Standard deviation of each term [1/m] for a warp of 1 px of Kinect disparity over the image."""
POINTS = 16
"""Number of columns used to represent a surface."""
SPREAD, DETOUR, CURVATURE = TERMS, TERMS + 1, TERMS + 2
"""Columns of spread, detour and curvature; warp terms precede them, motion follows."""
MOTION = slice(TERMS + 3, TERMS + 7)
"""Columns of the motion: three angular rates about the axes of C, and the speed of the chair."""
COLUMNS = TERMS + 7
"""Number of directions."""
DETOUR_RAD = 0.35 * DEG
"""Standard deviation of the tilt of all risers by light that takes a detour [rad]: 5 mm of range over 0.8 m, of 2 to 50 mm in a
corner (Fuchs, ICPR 2010). With 0.2° a time-of-flight camera's intervals held 87 to 90 % of 39 frames, with 0.35° 87 to 97 %."""
RANGE_SCALE = 6.0
"""Size of a smooth range error relative to a disparity warp: multipath of 20 mm over an image at 1.5 m, instead of 0.1 px."""
CURVATURE_1_M = 0.1
"""Standard deviation of the curvature of a flight that is not straight [1/m]: winding flights have radii of 3 to 30 m."""
READOUT_S = 0.033
"""Largest readout time of a rolling shutter [s]: one frame at 30 Hz."""
RATE_RAD_S, SPEED_M_S = 8.0 * DEG, 0.2
"""Standard deviations of the angular rates [rad/s] and the speed [m/s] of a chair on a flight: rocking by 1.8° at 1 Hz, and driving
at 0.2 m/s."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NuisanceModel:
    """Nuisance directions that are possible for a camera: hypotheses, each with those that are present together."""

    present: Bool[np.ndarray, "h c"]
    """Whether each direction is present under each hypothesis; warp and spread are present in all."""
    logs: Float[np.ndarray, " h"]
    """Log prior of each hypothesis."""
    scales: Float[np.ndarray, " h"]
    """Factor on the size of the warp under each hypothesis."""

    @property
    def simplest(self) -> "NuisanceModel":
        """The first hypothesis alone."""
        return NuisanceModel(present=self.present[:1], logs=np.zeros(1), scales=self.scales[:1])


CURVED, DRIVING, ROCKING, DETOURED = 0.04, 0.1, 0.1, 0.75
"""Prior probabilities: one flight in 25 is curved, one camera in five of an unknown kind has a rolling shutter on a chair that
drives, half of them on one that rocks as well, and three time-of-flight cameras in four see multipath that matters."""


def nuisance_model_of(*, measures_range: bool) -> NuisanceModel:
    """Return the hypotheses for a camera; the first has neither curvature, detour nor motion.

    Args:
        measures_range: Whether the camera is one of time of flight, which exposes all rows at once. Others may have a rolling
            shutter.
    """
    moving = list(range(MOTION.start, MOTION.stop))
    kinds = [([CURVATURE], CURVED, 1.0)]
    if measures_range:
        kinds.append(([DETOUR], DETOURED, RANGE_SCALE))
    else:
        kinds += [(moving[-1:], DRIVING, 1.0), (moving, ROCKING, 1.0)]
    present = np.zeros((1 + len(kinds), COLUMNS), dtype=np.bool_)
    present[:, : SPREAD + 1] = True
    for row, (columns, *_) in zip(present[1:], kinds, strict=True):
        row[columns] = True
    beliefs = [belief for _, belief, _ in kinds]
    return NuisanceModel(
        present=present,
        logs=np.log([1.0 - sum(beliefs), *beliefs]),
        scales=np.array([1.0, *(scale for *_, scale in kinds)]),
    )


def stretch_of(points: Float[np.ndarray, "k 3"], camera: PinholeCamera) -> Float[np.ndarray, "k t"]:
    """Return the relative change of the distance of points in C by each warp term of 1 px of Kinect disparity."""
    x, y, z = points.T
    u, v = camera.fx_px * x / z + camera.cx_px, camera.fy_px * y / z + camera.cy_px
    across = np.polynomial.legendre.legvander(2.0 * u / (camera.width_px - 1.0) - 1.0, ORDER)
    down = np.polynomial.legendre.legvander(2.0 * v / (camera.height_px - 1.0) - 1.0, ORDER)
    return np.column_stack([z * size * down[:, i] * across[:, j] for size, (i, j) in zip(SIZES, POWERS, strict=True)])


def drift_of(camera: PinholeCamera) -> Float[np.ndarray, "4 3"]:
    """Return the velocity of the camera in C for each unit of motion [m/s]: those of the rates by the lever of the mount."""
    R_BC = camera.R_BC
    mount_m = np.array(camera.mount_m)
    of_rates = [R_BC.T @ cross(RATE_RAD_S * axis, mount_m) for axis in R_BC.T]
    return np.array([*of_rates, SPEED_M_S * R_BC[0]])


def turns_of_surface(
    surface: Surface, edge: Vector3 | None, camera: PinholeCamera, drift: Float[np.ndarray, "4 3"]
) -> Float[np.ndarray, "3 c"]:
    """Return the derivative of a surface's unit normal with respect to each direction.

    Args:
        edge: Approximate direction of the edges; None for a tread.
    """
    columns, top, bottom = surface.upper.columns, surface.upper.rows, surface.lower.rows
    if columns.size < 2:  # with unknown ends the surface is assumed to fill the image
        columns, top, bottom = np.array([0, camera.width_px - 1]), np.zeros(2), np.full(2, camera.height_px - 1.0)
    turns = np.zeros((3, COLUMNS))
    nuisance_kernels.turns_of_plane(
        columns,
        top,
        bottom,
        POINTS,
        camera.width_px,
        camera.height_px,
        camera.pinhole,
        surface.normal,
        SIZES,
        READOUT_S,
        RATE_RAD_S,
        drift,
        turns,
    )
    turns *= surface.distance_m
    if edge is not None:
        turns[:, DETOUR] = DETOUR_RAD * edge
    return turns


def turns_of_line(line: Line, camera: PinholeCamera, drift: Float[np.ndarray, "4 3"], spread_px: float) -> Float[np.ndarray, "3 c"]:
    """Return the derivative of a line's unit normal with respect to each direction.

    Args:
        spread_px: Standard deviation of the shift of a surface's end [px].
    """
    turns = np.zeros((3, COLUMNS))
    shift = spread_px / camera.fy_px * (1.0 if line.end == "lower" else -1.0)
    right = np.zeros((3, COLUMNS))
    x, y, z = line.normal.tolist()
    turned = np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])  # rows: normal × unit vector
    by_drift = drift @ line.normal
    for row, point in enumerate(line.ends_m):
        ray = point / point[2]
        after_s = READOUT_S * ((ray[1] * camera.fy_px + camera.cy_px) / camera.height_px - 0.5)
        right[row, SPREAD] = -shift * line.normal[1]
        right[row, MOTION] = after_s * by_drift / point[2]
        right[row, MOTION.start : MOTION.stop - 1] += after_s * RATE_RAD_S * turned @ ray
    rays = np.array([*(line.ends_m / line.ends_m[:, 2:]), line.normal])
    turns[:] = np.linalg.solve(rays, right)
    return turns


def reach_of(camera: PinholeCamera, ahead: Vector3) -> float:
    """Return the distance of the camera ahead of the chair's origin along a direction in C [m]."""
    return float(np.array(camera.mount_m) @ camera.R_BC @ ahead)
