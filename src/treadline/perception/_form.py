"""Form of a flight from its matched surfaces: whether its edges are bowed, and where it ends at the sides.

A side is where several surfaces end at one lateral position: at a wall, when what follows is nearer, or open, when it is further
away or nothing. Surfaces that the image or an object cuts off give a bound only.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from treadline.core.camera_images import BASELINES_M, PinholeCamera
from treadline.core.signals import SideKind
from treadline.perception import _form_kernels as form_kernels
from treadline.perception import _plane_segmentation_kernels as surface_kernels
from treadline.perception._lattice_kernels import SIGMAS
from treadline.perception._plane_segmentation import JUMP, End, PlanarBlocks, Surface
from treadline.perception._step_parts import Axes, Flight, Tread
from treadline.perception.free_ground import CELL_M

LOOK_SHARE = 24
"""Image width divided by the largest number of columns past a surface's end in which its surroundings are looked for."""
SIDE_KINDS: tuple[SideKind, ...] = ("wall", "open")
"""What follows a side: something nearer, or something further away or nothing."""
CAMERA_BOW = 0.4
"""Standard deviation of the curvature that a depth warp of 1 px of Kinect disparity gives all edges alike [1/m]: 1.5 m away 0.05 px
bend half a metre by 2.5 mm."""
ARC_POINTS = 9
"""Least number of points of an edge: three for each of its thirds."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Side:
    """Side of a flight."""

    aside_m: float
    """Lateral position, to the right of the camera [m]."""
    kind: SideKind


def sides_of(
    surfaces: Sequence[Surface], blocks: PlanarBlocks, camera: PinholeCamera, axes: Axes
) -> tuple[Side | None, Side | None]:
    """Return the left and right side of a flight in the camera's view, from its surfaces; None where none is seen.

    Columns of an image rolled by more than 45° do not run along the flight: no side is known. Upside down, left is right.
    """
    if abs(axes.right[1]) > abs(axes.right[0]):
        return None, None
    columns, no_rows = [surface.upper.columns for surface in surfaces], np.zeros(0)
    places, kinds = form_kernels.lateral_ends(
        blocks.nearness,
        np.concatenate([np.zeros(0, dtype=np.int64), *columns]),
        np.concatenate([no_rows, *(surface.upper.rows for surface in surfaces)]),
        np.concatenate([no_rows, *(surface.lower.rows for surface in surfaces)]),
        np.cumsum([part.size for part in columns], dtype=np.int64),
        np.array([surface.normal for surface in surfaces]).reshape(-1, 3),
        axes.right,
        max(2, camera.width_px // LOOK_SHARE),
        JUMP * blocks.noise,
        BASELINES_M.get(camera.sensor, max(BASELINES_M.values())),  # the largest for an unknown one
        camera.pinhole,
    )
    order = (0, 1) if axes.right[0] > 0.0 else (1, 0)
    left, right = (_side(way * places[:, end], kinds[:, end], way) for way, end in zip((-1, 1), order, strict=True))
    if left is not None and right is not None and left.aside_m >= right.aside_m:
        return None, None
    return left, right


def _side(outward_m: Float[np.ndarray, " k"], kinds: Int[np.ndarray, " k"], way: int) -> Side | None:
    """Return the outermost position at which several surfaces end, unless others surpass it.

    Args:
        outward_m: Lateral distance of each end from the camera, outward; NaN where unknown.
        kinds: What follows each end, as from ``lateral_ends``.
        way: 1 for the right side, -1 for the left one.
    """
    known = np.isfinite(outward_m)
    for kind, name in enumerate(SIDE_KINDS, start=1):
        places = np.sort(outward_m[known & (kinds == kind)])[::-1]
        for place in places:
            together = places[np.abs(places - place) < CELL_M]
            if together.size >= 2:
                side_m = float(np.median(together))
                if not (outward_m[known] > side_m + CELL_M).any():
                    return Side(aside_m=way * side_m, kind=name)
                break
    return None


def bow_of(
    fronts: Sequence[Tread], flight: Flight, blocks: PlanarBlocks, camera: PinholeCamera, axes: Axes, warp_px: float
) -> float:
    """Return the mean curvature of the edges in the horizontal plane, positive for ends further away [1/m]; 0 for straight ones.

    The noise of an edge's curvature falls with the square of its width; how the edges differ gives that of their mean.

    Args:
        fronts: Treads whose front is a nosing.
        warp_px: Size of the depth warp, which bends all edges alike [px of Kinect disparity].
    """
    lines = [(tread.surface, tread.front(axes, flight.direction)) for tread in fronts]
    edges = [_seen_points(surface, line.end, camera) for surface, line in lines if line is not None]
    edges += [blocks.centres[riser.blocks] for riser in flight.risers]
    arcs = np.array([_arc(points, axes) for points in edges if len(points) >= ARC_POINTS]).reshape(-1, 2)
    curvatures, widths_m = arcs[np.isfinite(arcs[:, 0])].T
    if curvatures.size < 2:
        return 0.0
    weights = widths_m**4 / (widths_m**4).sum()
    mean = float(weights @ curvatures)
    variance = float(weights @ (curvatures - mean) ** 2 / (1.0 / (weights @ weights) - 1.0))
    return mean if abs(mean) > SIGMAS * math.hypot(math.sqrt(variance), CAMERA_BOW * warp_px) else 0.0


def _seen_points(surface: Surface, side: End, camera: PinholeCamera) -> Float[np.ndarray, "k 3"]:
    """Return the points in C of an end that neither an object nor the image border cuts off."""
    end = surface.upper if side == "upper" else surface.lower
    seen = surface_kernels.in_view(end.rows, end.follows, camera.height_px)
    rays = camera.pixel_to_point(end.columns[seen], end.rows[seen])
    return np.asarray(rays / (rays @ surface.normal)[:, None])


def _arc(points: Float[np.ndarray, "k 3"], axes: Axes) -> tuple[float, float]:
    """Return curvature [1/m] and width [m] of an edge, by the medians of its thirds; NaN for an edge without width."""
    across = points[np.argsort(points @ axes.right)][: len(points) // 3 * 3] @ np.stack([axes.right, axes.ahead], axis=1)
    aside, ahead = np.median(across.T.reshape(2, 3, -1), axis=2)
    apart = np.diff(aside)
    if not apart.min() > 0.0:
        return math.nan, 0.0
    slopes = np.diff(ahead) / apart
    return float(2.0 * (slopes[1] - slopes[0]) / apart.sum()), float(apart.sum())
