"""Treads and risers as planes: blocks of pixels, sorted by gravity, joined where they lie on one surface.

A plane n·p = 1 appears in the image as w = n·(x, y, 1) with w = 1/Z, so the three coefficients of a block's fit are its
normal. Blocks find the surfaces; each surface is then fitted to all of its pixels, column by column, which also tells
where it ends and what lies beyond.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Float32, Int

from treadline.angles import DEG
from treadline.perception import kernels
from treadline.signals import PinholeCamera

CELL_AT_240 = 4
"""Cell edge in pixels for an image of 240 rows; a block is two cells wide."""
NEAR_M, FAR_M = 0.4, 4.5
DISPARITY_PX_M = 575.0 * 0.075
"""f·B of the Kinect 1: residuals are judged in pixels of its disparity."""
BLOCK_RESIDUAL = 0.16 / DISPARITY_PX_M
"""Largest RMS residual of a block on one surface [1/m]; Kinect frames have 0.055 to 0.075 px."""
DEPTH_RESIDUAL_M = 0.003
"""The same for sensors whose noise is one of depth and not of disparity: a Kinect 2 on carpet close by."""
LEAST_RESIDUAL = 0.02 / DISPARITY_PX_M
TURN_LIMIT = 8.0 * DEG
"""A block whose normal is known no better says nothing of where it faces."""
FRAGMENT = 8
"""Planes that many times smaller than the largest of their level are wrinkles of it."""
SAMPLE = 16
"""Blocks of a surface that tell its noise."""
FULL = 0.6
"""Share of a block's pixels that must have a depth."""
TOLERANCE, TOLERANCE_SIGMAS = 0.22 / DISPARITY_PX_M, 3.5
"""How far off its surface a pixel may be: at least so much, and so many RMS residuals."""
JUMP = 0.45 / DISPARITY_PX_M
"""Between a surface and what lies behind its end: 9 cm at 3 m."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Blocks:
    """Blocks that lie on one plane each, and the pixels that they are of."""

    nearness: Float[np.ndarray, "w h"]
    """1/Z, a row for each column of the image; NaN without a depth."""

    sums: Float[np.ndarray, "b 10"]
    normals: Float[np.ndarray, "b 3"]
    """n with n·p = 1; its length is the inverse distance."""
    unit: Float[np.ndarray, "b 3"]
    """Unit normals that point away from the camera."""
    centres: Float[np.ndarray, "b 3"]
    """Points of the blocks' middles in C [m]."""
    places: Int[np.ndarray, "b 3"]
    """First row and column of cells, and how many rows of cells the block has."""
    cell_px: int


def surface_blocks(depth_m: Float32[np.ndarray, "h w"], camera: PinholeCamera) -> Blocks:
    """Return the blocks of a depth image on which one plane fits."""
    size = max(3, round(CELL_AT_240 * camera.height_px / 240))
    nearness = kernels.nearness_of(depth_m)
    cells = kernels.cell_sums(nearness, size, camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px, NEAR_M, FAR_M)
    sums, normals, unit, centres, places = kernels.plane_blocks(
        cells, FULL * size * size, BLOCK_RESIDUAL, DEPTH_RESIDUAL_M, TURN_LIMIT, LEAST_RESIDUAL
    )
    return Blocks(nearness=nearness, sums=sums, normals=normals, unit=unit, centres=centres, places=places, cell_px=size)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Ends:
    """The upper or lower end of a surface in the image, column by column."""

    columns: Int[np.ndarray, " k"]
    rows: Float[np.ndarray, " k"]
    """Half a pixel beyond the last one on the surface."""
    follows: Int[np.ndarray, " k"]
    """What lies there: ``kernels.CREASE``, ``BEYOND``, ``BEFORE`` or ``UNKNOWN``."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Surface:
    """One tread or riser."""

    normal: Float[np.ndarray, " 3"]
    """n with n·p = 1."""
    covariance: Float[np.ndarray, "3 3"]
    """Of the normal, from the residuals about the plane."""
    centre: Float[np.ndarray, " 3"]
    """On the plane, in the middle of its pixels, in C [m]."""
    blocks: Int[np.ndarray, " k"]
    upper: Ends
    lower: Ends

    @cached_property
    def unit(self) -> Float[np.ndarray, " 3"]:
        """Unit normal, pointing away from the camera."""
        return np.asarray(self.normal * self.distance_m)

    @cached_property
    def unit_covariance(self) -> Float[np.ndarray, "3 3"]:
        """Covariance of the unit normal, as far as it is across it."""
        return np.asarray(self.covariance * self.distance_m**2)

    @cached_property
    def distance_m(self) -> float:
        """From the camera to the plane."""
        return 1.0 / math.sqrt(float(self.normal @ self.normal))

    def span_m(self, blocks: Blocks, direction: Float[np.ndarray, " 3"]) -> tuple[float, float]:
        """Return from where to where its blocks' middles lie along a direction."""
        return kernels.span(blocks.centres, self.blocks, direction)

    def heights_m(self, camera: PinholeCamera, up: Float[np.ndarray, " 3"]) -> Float[np.ndarray, " k"]:
        """Return how far it goes up in each of its columns."""
        x = (self.upper.columns - camera.cx_px) / camera.fx_px
        ends = [
            np.column_stack([x, (rows - camera.cy_px) / camera.fy_px, np.ones(x.size)])
            for rows in (self.upper.rows, self.lower.rows)
        ]
        top, bottom = ((rays @ up) / (rays @ self.normal) for rays in ends)
        return np.asarray(top - bottom)

    def within(self, kept: Bool[np.ndarray, " k"], blocks: Blocks) -> "Surface":
        """Return the part of it in some of its columns; its plane stays."""
        columns = self.upper.columns[kept]
        left = blocks.places[self.blocks, 1] * blocks.cell_px
        width = 2 * blocks.cell_px
        full = np.searchsorted(columns, left + width) - np.searchsorted(columns, left) == width
        upper, lower = (Ends(columns=columns, rows=e.rows[kept], follows=e.follows[kept]) for e in (self.upper, self.lower))
        return replace(self, blocks=self.blocks[full], upper=upper, lower=lower)


def joined(
    camera: PinholeCamera,
    blocks: Blocks,
    members: Int[np.ndarray, " m"],
    direction: Float[np.ndarray, " 3"],
    *,
    gap_m: float,
    least: int,
) -> list[Surface]:
    """Return the surfaces among some blocks: runs of blocks at one level along a direction.

    Args:
        members: Their numbers.
        direction: Unit vector in C along which surfaces are told apart.
        gap_m: Levels further apart than this are different surfaces.
        least: Blocks that a surface needs.
    """
    if members.size < least:
        return []
    levels = blocks.centres[members] @ direction
    order = np.argsort(levels, kind="stable")
    members, stops, normals, squares = kernels.planes_along(
        blocks.sums, blocks.centres, members[order], levels[order], gap_m, least, BLOCK_RESIDUAL, DEPTH_RESIDUAL_M, SAMPLE, FRAGMENT
    )
    found = kernels.surfaces(
        blocks.nearness,
        members,
        stops,
        blocks.places,
        blocks.cell_px,
        normals,
        squares,
        TOLERANCE,
        TOLERANCE_SIGMAS,
        JUMP,
        LEAST_RESIDUAL**2,
        camera.fx_px,
        camera.fy_px,
        camera.cx_px,
        camera.cy_px,
    )
    return list(_surfaces(members, stops, *found))


def _surfaces(
    members: Int[np.ndarray, " k"],
    stops: Int[np.ndarray, " s"],
    normals: Float[np.ndarray, "s 3"],
    covariances: Float[np.ndarray, "s 3 3"],
    centres: Float[np.ndarray, "s 3"],
    held: Int[np.ndarray, " s"],
    columns: Int[np.ndarray, "s w"],
    upper: Float[np.ndarray, "s w"],
    lower: Float[np.ndarray, "s w"],
    above: Int[np.ndarray, "s w"],
    below: Int[np.ndarray, "s w"],
) -> Iterator[Surface]:
    """Yield the surfaces that have a plane, as ``kernels.surfaces`` tells them."""
    begin = 0
    for s, (stop, count) in enumerate(zip(stops.tolist(), held.tolist(), strict=True)):
        group, begin = members[begin:stop], stop
        if count:
            yield Surface(
                normal=normals[s],
                covariance=covariances[s],
                centre=centres[s],
                blocks=group,
                upper=Ends(columns=columns[s, :count], rows=upper[s, :count], follows=above[s, :count]),
                lower=Ends(columns=columns[s, :count], rows=lower[s, :count], follows=below[s, :count]),
            )
