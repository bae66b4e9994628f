"""Nuisance parameters: errors common to all surfaces of a frame, and the unknown size of a stair's irregularity.

Each direction in which a common error rotates the normals of planes and lines is an unknown of the edge fit, scaled to a prior
standard deviation of one:

* Warp of the depth image, specific to the camera: Legendre terms in the image coordinates, with decreasing sizes.
* Spread of edges: a matching window enlarges near surfaces by half of its width, which shifts the lines at their ends outwards. A
  shifted image line of an edge that is not parallel to the image has another direction.
* Motion during the readout of a rolling shutter: each row sees the stair from another pose.

Estimates are averaged over all sizes of the irregularity, each weighted by its likelihood on a geometric grid (DerSimonian, Laird
1986, with a prior in place of their estimate). For the edge direction the prior is a mixture of two components (spike and slab:
Mitchell, Beauchamp 1988). The first has no irregularity and no warp: rendered images, and new concrete seen by a well calibrated
camera. In the second all three sizes are independent; up to the accuracy of a careful builder, a few tenths of a degree, the prior
is nearly uniform over the grid, beyond it decreasing. Since perfection applies to all three sizes or none, nosings that agree by
chance do not suffice for the first component: treads and depth would have to agree as well.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float

from treadline.core.angles import DEG
from treadline.core.arrays import cross
from treadline.core.camera_images import PinholeCamera
from treadline.perception._nuisance_kernels import normal_equations
from treadline.perception._plane_segmentation import DISPARITY_PX_M, Line, Surface

ORDER = 3
"""Largest order of the Legendre terms, down and across the image."""
POINTS = 16
"""Number of columns used to represent a surface."""
READOUT_S = 0.033
"""Largest readout time of a rolling shutter [s]: one frame at 30 Hz."""
RATE_RAD_S, SPEED_M_S = 3.6 * DEG, 0.09
"""Standard deviations of the angular rates [rad/s] and the speed [m/s] in a frame of an unknown camera: 8°/s, rocking by 1.8° at
1 Hz, and 0.2 m/s in one of five; others have a global shutter or a chair that stands still."""
TURNS = np.geomspace(0.003 * DEG, 2.0 * DEG, 18)
"""Grid of the irregularity: standard deviation of the surfaces' angles [rad]."""


def _sizes() -> Float[np.ndarray, " t"]:
    """Return the standard deviation of each warp term [1/m] for a warp of 1 px of Kinect disparity over the image.

    Terms of higher order are smaller, because distortions of lens and projector are smooth; the constant term is excluded.
    """
    down, across = np.indices((ORDER + 1, ORDER + 1)).reshape(2, -1)[:, 1:]
    sizes = 1.0 / (1.0 + down + across)
    mean_squares = 1.0 / ((2.0 * down + 1.0) * (2.0 * across + 1.0))
    return np.asarray(sizes / np.sqrt(sizes**2 @ mean_squares) / DISPARITY_PX_M)


SIZES = _sizes()


def turns_of_surfaces(surfaces: Sequence[Surface], camera: PinholeCamera) -> Float[np.ndarray, "s 3 c"]:
    """Return the derivative of the unit normal of each surface with respect to each direction: warp terms, motion, spread."""
    samples = np.array([_sampled(surface, camera) for surface in surfaces]).reshape(-1, 3, POINTS)
    columns, tops, bottoms = samples[:, 0], samples[:, 1], samples[:, 2]
    u, v = np.tile(columns, 3), np.concatenate([tops, 0.5 * (tops + bottoms), bottoms], axis=1)
    normals = np.array([surface.normal for surface in surfaces]).reshape(-1, 3)
    rays = np.stack([(u - camera.cx_px) / camera.fx_px, (v - camera.cy_px) / camera.fy_px, np.ones(u.shape)], axis=-1)
    motions = _motions(normals, rays, (rays @ normals[:, :, None])[..., 0], camera)
    errors = np.concatenate([_warps(u, v, camera), motions, np.zeros((*u.shape, 1))], axis=-1)
    across = rays.transpose(0, 2, 1)
    turned = np.linalg.solve(across @ rays, across @ errors)
    return np.asarray(turned / np.linalg.norm(normals, axis=1)[:, None, None])


def turns_of_lines(lines: Sequence[Line], camera: PinholeCamera, spread_px: float) -> Float[np.ndarray, "l 3 c"]:
    """Return the derivative of the unit normal of each line with respect to each direction.

    Args:
        spread_px: Standard deviation of the shift of a surface's end, up and down as well as across the image [px].
    """
    normals = np.array([line.normal for line in lines]).reshape(-1, 3)
    ends_m = np.array([line.ends_m for line in lines]).reshape(-1, 2, 3)
    rays = ends_m / ends_m[..., 2:]
    outward = np.array([1.0 if line.end == "lower" else -1.0 for line in lines])
    # A square window moves a slanting line by its half width up or down, and across.
    shift = (
        -spread_px
        * outward
        * np.sign(normals[:, 1])
        * (np.abs(normals[:, 0]) / camera.fx_px + np.abs(normals[:, 1]) / camera.fy_px)
    )
    motions = _motions(normals, rays, 1.0 / ends_m[..., 2], camera)
    warps, spreads = np.zeros((len(lines), 2, SIZES.size)), np.broadcast_to(shift[:, None, None], (len(lines), 2, 1))
    errors = np.concatenate([warps, motions, spreads], axis=-1)
    across = rays.transpose(0, 2, 1)
    return np.linalg.solve(across @ rays + normals[:, :, None] * normals[:, None, :], across @ errors)


def stretch_of(points: Float[np.ndarray, "k 3"], camera: PinholeCamera) -> Float[np.ndarray, "k t"]:
    """Return the relative change of the distance of points in C by each warp term of 1 px of Kinect disparity."""
    x, y, z = points.T
    return z[:, None] * _warps(camera.fx_px * x / z + camera.cx_px, camera.fy_px * y / z + camera.cy_px, camera)


def _sampled(surface: Surface, camera: PinholeCamera) -> list[Float[np.ndarray, " p"]]:
    """Return columns, top and bottom rows that represent a surface; with unknown ends it is assumed to fill the image."""
    columns, top, bottom = surface.upper.columns, surface.upper.rows, surface.lower.rows
    if columns.size < 2:
        columns, top, bottom = np.array([0, camera.width_px - 1]), np.zeros(2), np.full(2, camera.height_px - 1.0)
    at = np.arange(POINTS) * (columns.size - 1) // (POINTS - 1)
    return [columns[at].astype(float), top[at], bottom[at]]


def _warps(u: Float[np.ndarray, "*n"], v: Float[np.ndarray, "*n"], camera: PinholeCamera) -> Float[np.ndarray, "*n t"]:
    """Return the change of inverse depth by each warp term at pixels [1/m]."""
    across = np.polynomial.legendre.legvander(2.0 * u / (camera.width_px - 1.0) - 1.0, ORDER)
    down = np.polynomial.legendre.legvander(2.0 * v / (camera.height_px - 1.0) - 1.0, ORDER)
    products = (down[..., :, None] * across[..., None, :]).reshape(*u.shape, -1)
    return np.asarray(products[..., 1:] * SIZES)


def _motions(
    normals: Float[np.ndarray, "k 3"], rays: Float[np.ndarray, "k p 3"], nearness: Float[np.ndarray, "k p"], camera: PinholeCamera
) -> Float[np.ndarray, "k p 4"]:
    """Return the change of normal · ray at pixels for each unit of motion, in the rows of a rolling shutter."""
    after_s = READOUT_S * ((rays[..., 1] * camera.fy_px + camera.cy_px) / camera.height_px - 0.5)
    R_BC = camera.R_BC
    # The rates move the camera by the lever of the mount.
    drift = np.array([*(RATE_RAD_S * R_BC.T @ cross(axis, np.array(camera.mount_m)) for axis in R_BC.T), SPEED_M_S * R_BC[0]])
    changes = nearness[..., None] * (normals @ drift.T)[:, None, :]
    changes[..., :3] += RATE_RAD_S * rays @ np.cross(normals[:, None, :], np.eye(3)).transpose(0, 2, 1)
    return np.asarray(after_s[..., None] * changes)


def pooled_mean(
    values: Float[np.ndarray, " k"],
    variances: Float[np.ndarray, " k"],
    regular: Bool[np.ndarray, " k"],
    common: Float[np.ndarray, " k"],
) -> tuple[float, float]:
    """Return the pooled mean of angles with known noise and an unknown common irregularity, and its standard deviation.

    Args:
        regular: Mask of measurements without irregularity: gravity.
        common: Change of each value by one standard deviation of an error that they have in common.
    """
    kinds = np.array([np.diag(np.where(regular, 0.0, 1.0)), np.outer(common, common)])
    squares = np.column_stack([TURNS**2, np.ones(TURNS.size)])
    logs, products = normal_equations(variances, kinds, squares, np.column_stack([np.ones(values.size), values]))
    total = products[:, 0, 0]
    means = products[:, 0, 1] / total
    belief = posterior_weights(logs - 0.5 * (np.log(total) + products[:, 1, 1] - total * means**2))
    mean = float(belief @ means)
    return mean, float(np.sqrt(belief @ (1.0 / total + (means - mean) ** 2)))


def posterior_weights(log_likelihood: Float[np.ndarray, "*g"]) -> Float[np.ndarray, "*g"]:
    """Return the posterior weight of each irregularity from its log likelihood."""
    weight = np.exp(log_likelihood - log_likelihood.max())
    return np.asarray(weight / weight.sum())
