"""Treads and risers as planes: blocks of pixels, sorted by gravity, joined where they lie on one surface.

A plane n·p = 1 appears in the image as w = n·(x, y, 1) with w = 1/Z, so the three coefficients of a block's fit are its
normal. Sums of blocks add: a whole riser is fitted from its blocks' sums without touching a pixel again.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from treadline.perception import kernels
from treadline.signals import PinholeCamera

BLOCK_AT_240 = 8
"""Block edge in pixels for an image of 240 rows: a riser 3 m away is two blocks high."""
NEAR_M, FAR_M = 0.4, 4.5
DISPARITY_PX_M = 575.0 * 0.075
"""f·B of the Kinect 1: residuals are judged in pixels of its disparity."""
BLOCK_RESIDUAL_PX = 0.16
"""Largest RMS residual of a block on one surface; Kinect frames have 0.055 to 0.075."""
FULL = 0.6
"""Share of a block's pixels that must have a depth."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Blocks:
    """Blocks that lie on one surface each."""

    sums: Float[np.ndarray, "b 10"]
    normals: Float[np.ndarray, "b 3"]
    """n with n·p = 1; its length is the inverse distance."""
    centres: Float[np.ndarray, "b 3"]
    """Points of the blocks' middles in C [m]."""
    places: Int[np.ndarray, " b"]
    """Index of each block in the grid."""
    stair_share: float
    """Share of all blocks that made it here."""


def surface_blocks(depth_m: Float[np.ndarray, "h w"], camera: PinholeCamera) -> Blocks:
    """Return the blocks of a depth image on which one plane fits."""
    size = max(4, round(BLOCK_AT_240 * camera.height_px / 240))
    sums = kernels.block_sums(depth_m, size, camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px, NEAR_M, FAR_M)
    planes, residuals = np.empty((len(sums), 3)), np.empty(len(sums))
    kernels.fit_planes(sums, planes, residuals)
    with np.errstate(invalid="ignore"):
        good = (sums[:, kernels.COUNT] >= FULL * size * size) & (residuals * DISPARITY_PX_M < BLOCK_RESIDUAL_PX)
    places = np.flatnonzero(good)
    kept = sums[good]
    count = np.maximum(kept[:, kernels.COUNT], 1.0)
    x, y, w = kept[:, kernels.X] / count, kept[:, kernels.Y] / count, kept[:, kernels.W] / count
    centres = np.column_stack([x / w, y / w, 1.0 / w])
    return Blocks(
        sums=kept,
        normals=planes[good],
        centres=centres,
        places=places,
        stair_share=float(good.mean()) if good.size else 0.0,
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Surface:
    """One tread or riser."""

    normal: Float[np.ndarray, " 3"]
    covariance: Float[np.ndarray, "3 3"]
    """Of the normal, from the residuals about the plane."""
    level: float
    """Distance along the direction that sorts the surfaces: depth of a riser, height of a tread [m]."""
    blocks: Int[np.ndarray, " k"]


def joined(
    blocks: Blocks, members: Bool[np.ndarray, " b"], direction: Float[np.ndarray, " 3"], gap_m: float, least: int
) -> list[Surface]:
    """Return the surfaces among some blocks: runs of blocks at one level along a direction.

    Args:
        direction: Unit vector in C along which surfaces are told apart.
        gap_m: Levels further apart than this are different surfaces.
        least: Blocks that a surface needs.
    """
    chosen = np.flatnonzero(members)
    if chosen.size < least:
        return []
    levels = blocks.centres[chosen] @ direction
    order = np.argsort(levels, kind="stable")
    chosen, levels = chosen[order], levels[order]
    edges = np.flatnonzero(np.diff(levels) > gap_m) + 1
    surfaces = []
    for run in np.split(np.arange(chosen.size), edges):
        surface = _surface(blocks, chosen[run], direction, least)
        if surface is not None:
            surfaces.append(surface)
    return surfaces


def _surface(blocks: Blocks, chosen: Int[np.ndarray, " k"], direction: Float[np.ndarray, " 3"], least: int) -> Surface | None:
    """Fit one plane to all pixels of some blocks, leaving out blocks that do not lie on it."""
    kept = chosen
    for _ in range(3):
        if kept.size < least:
            return None
        total = blocks.sums[kept].sum(axis=0)
        M, r = _normal_equations(total)
        try:
            normal = np.linalg.solve(M, r)
        except np.linalg.LinAlgError:
            return None
        misfit = _mean_square(blocks.sums[chosen], normal)
        limit = (BLOCK_RESIDUAL_PX / DISPARITY_PX_M) ** 2
        inside = chosen[misfit < max(limit, 0.0)]
        if inside.size == kept.size and np.array_equal(inside, kept):
            break
        kept = inside
    if kept.size < least:
        return None
    variance = max(float(total[kernels.WW] - normal @ r) / max(float(total[kernels.COUNT]) - 3.0, 1.0), 1e-12)
    level = float(np.median(blocks.centres[kept] @ direction))
    return Surface(normal=normal, covariance=variance * np.linalg.inv(M), level=level, blocks=kept)


def _normal_equations(s: Float[np.ndarray, " 10"]) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, " 3"]]:
    M = np.array(
        [
            [s[kernels.XX], s[kernels.XY], s[kernels.X]],
            [s[kernels.XY], s[kernels.YY], s[kernels.Y]],
            [s[kernels.X], s[kernels.Y], s[kernels.COUNT]],
        ]
    )
    return M, np.array([s[kernels.XW], s[kernels.YW], s[kernels.W]])


def _mean_square(sums: Float[np.ndarray, "k 10"], normal: Float[np.ndarray, " 3"]) -> Float[np.ndarray, " k"]:
    """Return the mean squared residual of each block about one plane."""
    a, b, c = normal
    s = sums.T
    quadratic = (
        a * a * s[kernels.XX]
        + b * b * s[kernels.YY]
        + c * c * s[kernels.COUNT]
        + 2.0 * (a * b * s[kernels.XY] + a * c * s[kernels.X] + b * c * s[kernels.Y])
    )
    linear = a * s[kernels.XW] + b * s[kernels.YW] + c * s[kernels.W]
    return np.asarray((s[kernels.WW] - 2.0 * linear + quadratic) / s[kernels.COUNT])
