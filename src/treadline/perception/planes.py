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
    centres: Float[np.ndarray, "b 3"]
    """Points of the blocks' middles in C [m]."""
    places: Int[np.ndarray, "b 3"]
    """First row and column of cells, and how many rows of cells the block has."""
    cell_px: int

    @cached_property
    def unit(self) -> Float[np.ndarray, "b 3"]:
        """Unit normals that point away from the camera."""
        return self.normals / np.sqrt(np.einsum("bi,bi->b", self.normals, self.normals))[:, None]


def surface_blocks(depth_m: Float32[np.ndarray, "h w"], camera: PinholeCamera) -> Blocks:
    """Return the blocks of a depth image on which one plane fits."""
    size = max(3, round(CELL_AT_240 * camera.height_px / 240))
    nearness = kernels.nearness_of(depth_m)
    cells = kernels.cell_sums(nearness, size, camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px, NEAR_M, FAR_M)
    sums, normals, places = kernels.plane_blocks(
        cells, FULL * size * size, BLOCK_RESIDUAL, DEPTH_RESIDUAL_M, TURN_LIMIT, LEAST_RESIDUAL
    )
    count = sums[:, kernels.COUNT]
    x, y, w = sums[:, kernels.X] / count, sums[:, kernels.Y] / count, sums[:, kernels.W] / count
    centres = np.column_stack([x / w, y / w, 1.0 / w])
    return Blocks(nearness=nearness, sums=sums, normals=normals, centres=centres, places=places, cell_px=size)


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
    members: Bool[np.ndarray, " b"],
    direction: Float[np.ndarray, " 3"],
    *,
    gap_m: float,
    least: int,
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
    groups, normals, squares = [], [], []
    for run, places in zip(np.split(chosen, edges), np.split(levels, edges), strict=True):
        for members_of_one, normal, square in _planes(blocks, run, places, gap_m, least):
            groups.append(members_of_one)
            normals.append(normal)
            squares.append(square)
    return _fitted(camera, blocks, groups, np.array(normals), np.array(squares)) if groups else []


def _planes(
    blocks: Blocks, run: Int[np.ndarray, " k"], levels: Float[np.ndarray, " k"], gap_m: float, least: int
) -> Iterator[tuple[Int[np.ndarray, " j"], Float[np.ndarray, " 3"], float]]:
    """Yield the planes in a run of blocks, the fullest first: things between two treads may join them to one run.

    Each comes as its blocks, n and the mean squared residual of its blocks about it.
    """
    while run.size >= least:
        # The fullest level starts the fit.
        together = np.searchsorted(levels, levels + gap_m) - np.arange(levels.size)
        start = int(np.argmax(together))
        normal, inside = np.empty(3), np.empty(run.size, dtype=np.bool_)
        limits = _limit(blocks.centres[run, 2])
        if not kernels.common_plane(blocks.sums, run, limits, start, start + int(together[start]), least, normal, inside):
            return
        members = run[inside]
        yield members, normal, kernels.mean_square_of(blocks.sums, members, max(1, members.size // SAMPLE), normal)
        least = max(least, members.size // FRAGMENT)
        if levels[-1] - levels[0] <= gap_m:
            return
        run, levels = run[~inside], levels[~inside]


def _limit(depth_m: Float[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
    """Return the RMS residual that a block on one surface may have [1/m]."""
    return np.maximum(BLOCK_RESIDUAL, DEPTH_RESIDUAL_M / depth_m**2)


def _fitted(
    camera: PinholeCamera,
    blocks: Blocks,
    groups: list[Int[np.ndarray, " _"]],
    normals: Float[np.ndarray, "s 3"],
    squares: Float[np.ndarray, " s"],
) -> list[Surface]:
    """Return the surfaces fitted to all pixels of theirs."""
    boxes, size = np.empty((len(groups), 4), dtype=np.int64), blocks.cell_px
    for box, group in zip(boxes, groups, strict=True):
        kernels.box_of(blocks.places, group, size, size + size // 2, camera.height_px, camera.width_px, box)
    shape = (len(groups), camera.width_px)
    first, last = np.empty(shape, dtype=np.int64), np.empty(shape, dtype=np.int64)
    before, after = np.empty(shape, dtype=np.int64), np.empty(shape, dtype=np.int64)
    sums = np.empty((len(groups), kernels.SUMS))
    limits = np.maximum(TOLERANCE, TOLERANCE_SIGMAS * np.sqrt(squares))
    pinhole = (camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px)
    kernels.extents(blocks.nearness, normals, boxes, limits, JUMP, *pinhole, first, last, before, after, sums)
    surfaces = []
    for s, group in enumerate(groups):
        count = sums[s, kernels.COUNT]
        normal, inverse = np.empty(3), np.empty((3, 3))
        variance = kernels.solved_plane(sums[s], normal, inverse)
        # Pixels in one row or column have no plane.
        if count < size**2 or math.isnan(variance):
            continue
        variance = max(variance, LEAST_RESIDUAL**2)
        ray = np.array([sums[s, kernels.X] / count, sums[s, kernels.Y] / count, 1.0])
        columns = np.flatnonzero(first[s] >= 0)
        surfaces.append(
            Surface(
                normal=normal,
                covariance=variance * inverse,
                centre=ray / float(normal @ ray),
                blocks=group,
                upper=Ends(columns=columns, rows=first[s, columns] - 0.5, follows=before[s, columns]),
                lower=Ends(columns=columns, rows=last[s, columns] + 0.5, follows=after[s, columns]),
            )
        )
    return surfaces
