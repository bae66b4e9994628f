"""Planes and lines of a depth image: planar blocks of pixels, surfaces joined from them, and the lines at their ends.

A plane n·p = 1 appears in the image as w = n·(x, y, 1) with w = 1/Z, so the three coefficients of a block's fit are its normal. The
blocks find the surfaces; each surface is then fitted to all of its pixels, column by column, which also gives its ends and their
surroundings.

A line in the image and the camera centre span a plane that contains the edge, so its normal m satisfies m·e = 0, like the normal of
a tread. Depth along the edge, where it is least accurate, is not needed.
"""

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float, Float32, Int

from treadline.core.angles import DEG
from treadline.core.camera_images import BASELINES_M, PinholeCamera, RgbdFrame, black
from treadline.core.rotations import Rotation, Vector3
from treadline.perception import _plane_segmentation_kernels as surface_kernels

CELL_AT_240 = 4
"""Edge of a cell at 240 rows [px]; a block is two cells wide."""
NEAR_M, FAR_M = 0.4, 6.0
"""Depth range in use [m]: a Kinect 1 and a D455 measure up to 6 m. With 4.5 m, 2 of 11 frames of a Kinect 1 from 5 m before a
flight were accepted; with 6 m or more, 6 of 11."""
DISPARITY_PX_M = 575.0 * 0.075
"""Product f·B of the Kinect 1 [px m]: residuals are expressed in pixels of its disparity."""
BLOCK_RESIDUAL = 0.16 / DISPARITY_PX_M
"""Largest RMS residual of a block on one surface [1/m]; Kinect frames have 0.055 to 0.075 px."""
TURN_LIMIT = 8.0 * DEG
"""Largest standard deviation of a block's normal for use [rad]."""
FULL = 0.6
"""Least fraction of pixels with depth in a block, and next to pixels with depth in an image that is not reduced."""
TOLERANCE, TOLERANCE_SIGMAS = 0.22 / DISPARITY_PX_M, 3.5
"""Largest distance of a pixel from its surface: absolute [1/m] and in RMS residuals, whichever is larger."""
COPIED = 0.95
"""Fraction of pixels with the depth of their left neighbour above which a driver has filled a cell. Recorded frames of a Kinect 1
and an Xtion, whose depths are steps apart, have 0.62 and no block of 16×16 pixels above 0.95."""
NOISE_QUANTILE, NOISE_MARGIN, NOISE_MOST = 0.35, 2.2, 3.0
"""Quantile of the residuals of all blocks that stands for a frame's noise, its ratio to the largest residual of a planar block
(recorded Kinect 1 frames give a noise of 1 to 1.8), and the largest noise: beyond it steps 2 m away are no planes."""
FALLING_NOISE = -0.1
"""Largest change of the logarithm of the noise of w in a standard deviation of log depth of a time-of-flight camera: -0.5 to
-0.25 over its kinds of rendered frames, -0.22 in a recorded frame of a Kinect 2, above -0.05 for disparities."""
LOWEST_M = 0.1
"""Rise of a low step [m]."""
CELLS_ALIKE = 1.8
"""Ratio of a matching window's width to the square root of its contrast, both less one: adjacent cells share a window. A mean
over 7×7 px has a contrast of 4.1² in cells of 8 px, one over 3×3 px of 2.3² in cells of 4 px."""
JUMP = 0.45 / DISPARITY_PX_M
"""Depth difference between a surface and the background at its end [1/m]: 9 cm at 3 m."""
NEAR_AT_240 = 1.5
"""Largest distance of a point from a line at 240 rows [rows]: depth is ragged at edges."""
ALIASING_PX = 0.15
"""Lower limit of the relative error of a line's ends, for any number of points [px]: rows are integers. Without it, 10 instead of
none of 120 perfect frames with pixels missing have errors outside their 95 % interval."""
LEAST_SHARE = 0.08
"""Least length of a line as a fraction of the image width."""

LineKind = Literal["edge", "corner", "vague"]
"""Kind of a line by what is measured past it."""
End = Literal["upper", "lower"]
"""End of a surface in the image."""
_KINDS: dict[int, LineKind] = {surface_kernels.BEYOND: "edge", surface_kernels.CREASE: "corner", surface_kernels.UNKNOWN: "vague"}


@dataclass(frozen=True, kw_only=True, eq=False)
class PlanarBlocks:
    """Planar blocks of a depth image with their pixels."""

    nearness: Float[np.ndarray, "w h"]
    """Inverse depth 1/Z, one row per image column; NaN without depth."""

    sums: Float[np.ndarray, "b 10"]
    unit: Float[np.ndarray, "b 3"]
    """Unit normals pointing away from the camera."""
    centres: Float[np.ndarray, "b 3"]
    """Centres of the blocks in C [m]."""
    places: Int[np.ndarray, "b 3"]
    """First row and column of cells, and number of rows of cells of each block."""
    turns: Float[np.ndarray, " b"]
    """Standard deviation of each block's normal [rad]."""
    cell_px: int
    noise: float
    """Noise of this frame relative to a Kinect 1; thresholds on residuals are multiplied by it."""
    window_px: float
    """Width of the noise's correlation: that of the matching window of a stereo camera [px]."""
    unresolved: int
    """Number of blocks on no plane so far away that a block is higher than a step."""
    measures_range: bool
    """Whether the camera is one of time of flight: by its file, or for an unknown one by the dependence of the noise on depth."""

    @property
    def spread_px(self) -> float:
        """Standard deviation of the shift of all surfaces' ends: half of the matching window [px]."""
        return 0.5 * (self.window_px - 1.0)


def reduced(frame: RgbdFrame) -> RgbdFrame:
    """Return a frame whose depth image is dense enough for planes: the median of the valid pixels of squares, without colours.

    Next to a pixel with depth, a fraction of ``dense`` of the pixels has depth. If pixels miss at random, a square of n pixels has
    depth with a probability of 1 - (1 - dense)ⁿ. Holes that are wider than a few pixels leave ``dense`` near one.
    """
    known, camera, side = frame.depth_m > 0.0, frame.camera, 1
    beside = int(np.count_nonzero(known[1:] & known[:-1]) + np.count_nonzero(known[:, 1:] & known[:, :-1]))
    dense = beside / max(int(np.count_nonzero(known[1:]) + np.count_nonzero(known[:, 1:])), 1)
    while beside > 0 and 1.0 - (1.0 - dense) ** side**2 < FULL:
        side += 1
    if side == 1:
        return frame
    depth_m = surface_kernels.pooled(frame.depth_m, side, JUMP)
    smaller = replace(camera, height_px=depth_m.shape[0], width_px=depth_m.shape[1])
    smaller = replace(smaller, fx_px=camera.fx_px / side, fy_px=camera.fy_px / side)
    smaller = replace(smaller, cx_px=(camera.cx_px + 0.5) / side - 0.5, cy_px=(camera.cy_px + 0.5) / side - 0.5)
    # Pixels that miss in a pattern, as every second row, leave less than those that miss at random.
    return reduced(RgbdFrame(t_s=frame.t_s, rgb=black(*depth_m.shape), depth_m=depth_m, camera=smaller))


def noise_of(fits: Float[np.ndarray, "r c 7"]) -> tuple[float, float]:
    """Return the noise of a frame relative to a Kinect 1, and the width of its correlation, from the flatter blocks [px].

    The quantile holds planar blocks alone as long as a third of the image is flat. Noise that is correlated over a square of
    ``window`` pixels has cell means of ``window²`` times the variance of white noise.
    """
    residuals = fits[..., 3][np.isfinite(fits[..., 3])]
    if residuals.size == 0:
        return 1.0, 1.0
    at = int(NOISE_QUANTILE * (residuals.size - 1))
    quantile = float(np.partition(residuals, at)[at])
    white = float(np.mean(fits[..., 5][fits[..., 3] <= quantile]))
    window_px = 1.0 + CELLS_ALIKE * (math.sqrt(max(white, 1.0)) - 1.0)
    return float(np.clip(NOISE_MARGIN * quantile / BLOCK_RESIDUAL, 1.0, NOISE_MOST)), window_px


def surface_blocks(depth_m: Float32[np.ndarray, "h w"], camera: PinholeCamera) -> PlanarBlocks:
    """Return the planar blocks of a depth image."""
    return _blocks_of(depth_m, camera, max(3, round(CELL_AT_240 * camera.height_px / 240)))


def uncertain_blocks(depth_m: Float32[np.ndarray, "h w"], camera: PinholeCamera, blocks: PlanarBlocks) -> PlanarBlocks:
    """Return the planar blocks of half the size, those with an uncertain normal included: far steps cover few rows."""
    return _blocks_of(depth_m, camera, blocks.cell_px // 2, blocks)


def _blocks_of(
    depth_m: Float32[np.ndarray, "h w"], camera: PinholeCamera, size: int, known: PlanarBlocks | None = None
) -> PlanarBlocks:
    """Return the planar blocks of cells of a size.

    Args:
        known: Blocks with the noise of this frame, which allow for uncertain normals; None: the noise is measured.
    """
    nearness, cells, copies = surface_kernels.cells_of(depth_m, size, camera.pinhole, NEAR_M, FAR_M)
    full, filled = FULL * size * size, copies > COPIED
    # An image without noise has equal neighbours everywhere.
    if 2 * np.count_nonzero(filled) < np.count_nonzero(cells[..., 0] >= full):
        cells[filled] = 0.0
    fits = surface_kernels.block_fits(cells, full)
    noise, window_px = noise_of(fits) if known is None else (known.noise, known.window_px)
    turn_limit = TURN_LIMIT if known is None else math.inf
    sums, unit, centres, places, residuals, turns = surface_kernels.plane_blocks(
        cells, fits, full, BLOCK_RESIDUAL * noise, turn_limit
    )
    measures_range = BASELINES_M.get(camera.sensor) == 0.0
    if camera.sensor == "auto":
        large = places[:, 2] == 2
        measures_range = _noise_law(centres[large, 2], residuals[large]) < FALLING_NOISE if known is None else known.measures_range
    return PlanarBlocks(
        nearness=nearness,
        sums=sums,
        unit=unit,
        centres=centres,
        places=places,
        turns=turns,
        cell_px=size,
        noise=noise,
        window_px=window_px,
        unresolved=int(
            np.count_nonzero((fits[..., 3] >= BLOCK_RESIDUAL * noise) & (fits[..., 6] * camera.fy_px * LOWEST_M < 2 * size))
        ),
        measures_range=measures_range,
    )


def _noise_law(depths_m: Float[np.ndarray, " b"], residuals: Float[np.ndarray, " b"]) -> float:
    """Return the change of the logarithm of the noise of w in a standard deviation of log depth.

    A disparity has the same noise at all depths; the noise of a range that is as accurate at all depths falls with their square.
    """
    if depths_m.size == 0:
        return 0.0
    x, y = np.log(depths_m), np.log(np.maximum(residuals, 1e-12))
    x -= x.mean()
    return float(x @ y / math.sqrt(max(depths_m.size * (x @ x), 1e-12)))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Ends:
    """Upper or lower end of a surface in the image, column by column."""

    columns: Int[np.ndarray, " k"]
    rows: Float[np.ndarray, " k"]
    """Row half a pixel beyond the last one on the surface."""
    follows: Int[np.ndarray, " k"]
    """Surroundings of the end: ``surface_kernels.CREASE``, ``BEYOND``, ``BEFORE`` or ``UNKNOWN``."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Line:
    """Image line of one nosing."""

    normal: Vector3
    """Unit normal m of the plane through the line and the camera centre, in C."""
    covariance: Rotation
    """Covariance of m, from the scatter of the points about the line."""
    middle: Vector3
    """Middle of the line on its surface, in C [m]."""
    ends_m: Float[np.ndarray, "2 3"]
    """Ends of the line on its surface, left end first, in C [m]."""
    kind: LineKind
    """Surroundings of the line: a larger depth (``edge``), an adjacent surface (``corner``), or nothing known (``vague``)."""
    count: int
    """Number of columns."""
    end: End
    """End of the surface in the image."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Surface:
    """Tread or riser."""

    normal: Vector3
    """Normal n with n·p = 1."""
    covariance: Rotation
    """Covariance of the normal, from the residuals about the plane."""
    centre: Vector3
    """Point on the plane in the middle of its pixels, in C [m]."""
    blocks: Int[np.ndarray, " k"]
    upper: Ends
    lower: Ends

    @cached_property
    def unit(self) -> Vector3:
        """Unit normal, pointing away from the camera."""
        return np.asarray(self.normal * self.distance_m)

    @cached_property
    def unit_covariance(self) -> Rotation:
        """Covariance of the unit normal, perpendicular to it."""
        return np.asarray(self.covariance * self.distance_m**2)

    @cached_property
    def distance_m(self) -> float:
        """Distance from the camera to the plane [m]."""
        return 1.0 / math.sqrt(float(self.normal @ self.normal))

    def span_m(self, blocks: PlanarBlocks, direction: Vector3) -> tuple[float, float]:
        """Return the range of the blocks' centres along a direction [m]."""
        return surface_kernels.span(blocks.centres, self.blocks, direction)

    def heights_m(self, camera: PinholeCamera, up: Vector3) -> Float[np.ndarray, " k"]:
        """Return the height of the surface in each of its columns [m]."""
        rays = (camera.pixel_to_point(end.columns, end.rows) for end in (self.upper, self.lower))
        top, bottom = ((ray @ up) / (ray @ self.normal) for ray in rays)
        return np.asarray(top - bottom)

    @property
    def distance_variance(self) -> float:
        """Variance of the centre's distance relative to it."""
        ray = self.centre / self.centre[2]
        return float(self.centre[2] ** 2 * (ray @ self.covariance @ ray))

    def adjoining_tilt_rad(self, camera: PinholeCamera, ahead: Vector3, noise: float, length_m: float) -> float:
        """Return the tilt of a horizontal surface by the pixels of risers at its ends within the tolerance of its plane [rad].

        The residual of the riser's pixels increases by ``step`` per row up to the tolerance. Least squares turn the plane over its
        rows by 3·tolerance²/(step·rows²) for each end, both towards the nosing plane.

        Args:
            ahead: Horizontal unit vector in C, perpendicular to the edges.
            noise: Noise of the frame.
            length_m: Largest extent of the surface along ``ahead``: the run of a tread. A plane far away that is turned extends
                over the risers at its ends.
        """
        creased = sum(float(np.mean(end.follows != surface_kernels.BEYOND)) for end in (self.upper, self.lower) if end.follows.size)
        y = float(self.centre[1] / self.centre[2])
        lever = abs(float(ahead[1] - y * ahead[2]))
        of_length = length_m * lever * camera.fy_px / float(self.centre[2])
        rows = min(float(np.median(self.lower.rows - self.upper.rows)), of_length)
        step = abs(float(self.normal[1] - ahead[1] / (ahead @ self.centre))) / camera.fy_px
        turned = creased * 3.0 * (TOLERANCE * noise) ** 2 / (step * rows**2)
        return turned * camera.fy_px * self.distance_m * lever

    def line(self, end: End, camera: PinholeCamera) -> Line | None:
        """Return the line at an end of the surface, or None; the image border and objects in front give no line.

        A corner belongs to a riser too low in the image to be a separate surface. The end of the surface has a constant offset
        along a corner, so that the direction of the line is correct.
        """
        ends = self.upper if end == "upper" else self.lower
        near_px, least = NEAR_AT_240 * camera.height_px / 240, LEAST_SHARE * camera.width_px
        end_of = ends.columns, ends.rows, ends.follows, self.normal, camera.height_px
        count, kind, normal, covariance, points = surface_kernels.nosing_line(*end_of, near_px, least, ALIASING_PX, camera.pinhole)
        if not count:
            return None
        return Line(
            normal=normal,
            covariance=covariance,
            middle=points[0],
            ends_m=points[1:],
            kind=_KINDS[kind],
            count=count,
            end=end,
        )

    def within(self, kept: Bool[np.ndarray, " k"], blocks: PlanarBlocks) -> "Surface":
        """Return the part of the surface in some of its columns, with the same plane."""
        columns = self.upper.columns[kept]
        left = blocks.places[self.blocks, 1] * blocks.cell_px
        width = 2 * blocks.cell_px
        full = np.searchsorted(columns, left + width) - np.searchsorted(columns, left) == width
        upper, lower = (Ends(columns=columns, rows=e.rows[kept], follows=e.follows[kept]) for e in (self.upper, self.lower))
        return replace(self, blocks=self.blocks[full], upper=upper, lower=lower)


def planes_of(
    blocks: PlanarBlocks, members: Int[np.ndarray, " m"], direction: Vector3, gap_m: float, least: int
) -> tuple[Float[np.ndarray, "p 3"], Int[np.ndarray, " p"]]:
    """Return the planes that ``surfaces_along`` begins with, as n with n·p = 1, and their numbers of blocks."""
    limit = BLOCK_RESIDUAL * blocks.noise
    _, stops, planes, _ = surface_kernels.planes_along(blocks.sums, blocks.centres, members, direction, gap_m, least, limit)
    return planes, np.diff(stops, prepend=0)


def surfaces_along(
    blocks: PlanarBlocks, members: Int[np.ndarray, " m"], direction: Vector3, camera: PinholeCamera, *, gap_m: float, least: int
) -> list[Surface]:
    """Return the surfaces among some blocks: runs of blocks at one level along a direction, each fitted to all of its pixels.

    Args:
        members: Indices of the blocks.
        direction: Unit vector in C along which surfaces are separated.
        gap_m: Separation of different surfaces.
        least: Least number of blocks of a surface.
    """
    held, stops, planes, squares = surface_kernels.planes_along(
        blocks.sums, blocks.centres, members, direction, gap_m, least, BLOCK_RESIDUAL * blocks.noise
    )
    limits = TOLERANCE * blocks.noise, TOLERANCE_SIGMAS, JUMP * blocks.noise
    normals, covariances, centres, counts, columns, upper, lower, above, below = surface_kernels.surfaces(
        blocks.nearness, held, stops, blocks.places, blocks.cell_px, planes, squares, *limits, camera.pinhole
    )
    # Pixels within a matching window have a common error.
    covariances *= blocks.window_px**2
    return [
        Surface(
            normal=normals[s],
            covariance=covariances[s],
            centre=centres[s],
            blocks=own,
            upper=Ends(columns=columns[s, :count], rows=upper[s, :count], follows=above[s, :count]),
            lower=Ends(columns=columns[s, :count], rows=lower[s, :count], follows=below[s, :count]),
        )
        for s, (count, own) in enumerate(zip(counts.tolist(), np.split(held, stops), strict=False))
        if count
    ]
