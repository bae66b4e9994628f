"""Form of a flight from its matched surfaces: the bow of its edges, and where it ends at the sides.

A side is where several surfaces end at one lateral position: at a wall, when what follows is nearer, or open, when it is further
away or nothing. Surfaces that the image or an object cuts off give a bound only.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float

from treadline.core.camera_images import BASELINES_M, PinholeCamera
from treadline.perception import _form_kernels as form_kernels
from treadline.perception._irregularity import pooled_mean
from treadline.perception._plane_segmentation import JUMP, Ends, PlanarBlocks, Surface
from treadline.perception._step_parts import Axes

SideKind = Literal["wall", "open"]
"""What follows beyond the side of a flight."""
LOOK_SHARE = 24
"""Image width divided by the largest number of columns past a surface's end in which its surroundings are looked for."""
SAME_SIDE_M = 0.05
"""Largest lateral distance of ends at one side [m]."""
BIN_M, BINS = 0.04, 101
"""Width and number of bins across the flight for the profiles of edges: 2 m to either side of the camera."""
LEAST_BINS = 6
"""Least number of bins of a profile: three for its shape, three for its scatter."""
KEPT_SIGMAS = 3.7
"""Largest residual of a bin in medians of their size: 2.5 standard deviations."""
CAMERA_BOW = 0.02
"""Standard deviation of a curvature that is the camera's, common to all edges [1/m]: by a warp of 0.05 px of Kinect disparity,
which at 1.5 m bends half a metre by 2.5 mm."""
STEP_BOWS = np.geomspace(0.002, 0.5, 10)
"""Grid of the scatter of curvature between the edges of one flight [1/m]: 0.2 mm of bow over a metre, as drawn, to the errors of
profiles that objects cut off."""
BOWED, BOW_1_M = 0.1, 0.1
"""Prior probability of bowed edges, and standard deviation of their curvature [1/m]: a sagitta of 2 cm over 1.3 m."""
UNSEEN_MIDDLE_M, TURN_SHARE = 0.30, 0.3
"""Assumed distance of the visible part from the middle of a bowed flight whose sides are not in view [m], and relative error of the
correction if they are."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Side:
    """Side of a flight."""

    aside_m: float
    """Lateral position, to the right of the camera [m]."""
    kind: SideKind


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LateralEnds:
    """Ends of surfaces on one side."""

    outward_m: Float[np.ndarray, " k"]
    """Lateral distance of each end from the camera, outward [m]; NaN where unknown."""
    walls: Bool[np.ndarray, " k"]
    """Whether something nearer follows, and ``opens`` whether something further away or nothing; neither where it is cut off."""
    opens: Bool[np.ndarray, " k"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Bow:
    """Curvature of the edges in the horizontal plane."""

    curvature_1_m: float
    """Mean curvature, positive for edges whose ends are further away than their middle [1/m]."""
    sigma_1_m: float
    """Standard deviation of the curvature [1/m]; infinite without a profile."""
    seen_aside_m: float
    """Mean lateral position of the profiles, to the right of the camera [m]."""

    @property
    def bowed(self) -> float:
        """Probability that the edges are bowed."""
        if math.isinf(self.sigma_1_m):
            return 0.0
        wide = self.sigma_1_m**2 + BOW_1_M**2
        gain = 0.5 * self.curvature_1_m**2 * (1.0 / self.sigma_1_m**2 - 1.0 / wide)
        odds = BOWED / (1.0 - BOWED) * self.sigma_1_m / math.sqrt(wide) * math.exp(min(gain, 100.0))
        return odds / (1.0 + odds)

    @property
    def is_bowed(self) -> bool:
        """Whether the edges are more likely bowed than straight."""
        return self.bowed > 0.5

    @property
    def root_mean_square_1_m(self) -> float:
        """Root of the mean square of the curvature [1/m], straight edges included.

        The curvature of bowed edges is estimated from itself if it is larger than a usual one (James, Stein 1961).
        """
        square = max(BOW_1_M**2, self.curvature_1_m**2 - self.sigma_1_m**2)
        share = square / (square + self.sigma_1_m**2) if self.bowed else 0.0
        return math.sqrt(self.bowed * ((share * self.curvature_1_m) ** 2 + share * self.sigma_1_m**2)) if share else 0.0


def sides_of(ends: Sequence[LateralEnds]) -> tuple[Side | None, Side | None]:
    """Return the left and right side of a flight in the camera's view; None where none is seen."""
    left, right = (_side(end, way) for way, end in zip((-1, 1), ends, strict=True))
    if left is not None and right is not None and left.aside_m >= right.aside_m:
        return None, None
    return left, right


def lateral_ends_of(
    surfaces: Sequence[Surface], blocks: PlanarBlocks, camera: PinholeCamera, axes: Axes
) -> tuple[LateralEnds, LateralEnds]:
    """Return where the surfaces of a flight end on the left and on the right, in the flight's axes.

    Columns of an image rolled by more than 45° do not run along the flight: no ends are known. Upside down, left is right.
    """
    places, walls, opens = form_kernels.sides_of(
        blocks.nearness,
        *_columns([(surface, surface.upper) for surface in surfaces])[:4],
        np.array([surface.normal for surface in surfaces]).reshape(-1, 3),
        axes.right,
        max(2, camera.width_px // LOOK_SHARE),
        JUMP * blocks.noise,
        BASELINES_M.get(camera.sensor, max(BASELINES_M.values())),  # the largest for an unknown one
        camera.pinhole,
    )
    if abs(axes.right[1]) > abs(axes.right[0]):
        places[:] = np.nan
    sides = (0, 1) if axes.right[0] > 0.0 else (1, 0)
    left, right = (
        LateralEnds(outward_m=way * places[:, side], walls=walls[:, side], opens=opens[:, side])
        for way, side in zip((-1, 1), sides, strict=True)
    )
    return left, right


def _columns(profiles: Sequence[tuple[Surface, Ends]]) -> tuple[np.ndarray, ...]:
    """Return columns, upper and lower rows of surfaces, one after the other, their stops, and rows and surroundings of an end."""
    if not profiles:
        whole, rows = np.zeros(0, dtype=np.int64), np.zeros(0)
        return whole, rows, rows, whole, rows, whole
    parts = [(surface.upper.columns, surface.upper.rows, surface.lower.rows, end.rows, end.follows) for surface, end in profiles]
    columns, upper, lower, rows, follows = (np.concatenate(part) for part in zip(*parts, strict=True))
    return columns, upper, lower, np.cumsum([part[0].size for part in parts]), rows, follows


def _side(end: LateralEnds, way: int) -> Side | None:
    """Return the outermost position at which several surfaces end, unless others surpass it."""
    known = end.outward_m[np.isfinite(end.outward_m)]
    kinds: tuple[tuple[Bool[np.ndarray, " k"], SideKind], ...] = ((end.walls, "wall"), (end.opens, "open"))
    for own, name in kinds:
        places = np.sort(end.outward_m[own & np.isfinite(end.outward_m)])[::-1]
        for place in places:
            together = places[np.abs(places - place) < SAME_SIDE_M]
            if together.size >= 2:
                side_m = float(np.median(together))
                if not (known > side_m + SAME_SIDE_M).any():
                    return Side(aside_m=way * side_m, kind=name)
                break
    return None


def bow_of(
    fronts: Sequence[tuple[Surface, Ends]],
    risers: Sequence[Surface],
    blocks: PlanarBlocks,
    camera: PinholeCamera,
    axes: Axes,
) -> Bow:
    """Return the curvature of the edges, pooled over the fronts of treads and the faces of risers.

    Args:
        fronts: Treads whose front is a nosing, with that end.
    """
    edges = [*fronts, *((riser, riser.upper) for riser in risers)]
    columns, upper, lower, stops, rows, follows = _columns(edges)
    places, counts = form_kernels.profiles_of(
        blocks.nearness,
        columns,
        upper,
        lower,
        rows,
        follows,
        stops,
        np.array([surface.normal for surface, _ in edges]).reshape(-1, 3),
        np.arange(len(edges)) >= len(fronts),
        axes.ahead,
        axes.right,
        BIN_M,
        BINS,
        camera.pinhole,
    )
    curvatures, variances, middles = _curvatures(places, counts)
    known = np.isfinite(variances)
    if not known.any():
        return Bow(curvature_1_m=0.0, sigma_1_m=math.inf, seen_aside_m=0.0)
    curvature_1_m, sigma_1_m = pooled_mean(
        curvatures[known], variances[known], np.zeros(np.count_nonzero(known), dtype=bool), STEP_BOWS
    )
    return Bow(
        curvature_1_m=curvature_1_m,
        sigma_1_m=math.hypot(sigma_1_m, CAMERA_BOW),
        seen_aside_m=float(np.average(middles[known], weights=1.0 / variances[known])),
    )


def _curvatures(
    places: Float[np.ndarray, "s b"], counts: Float[np.ndarray, "s b"]
) -> tuple[Float[np.ndarray, " s"], Float[np.ndarray, " s"], Float[np.ndarray, " s"]]:
    """Return the curvature of each profile, its variance and mean lateral position; an infinite variance without a profile.

    Errors of adjacent columns are correlated: the scatter of the bins gives the variance.
    """
    # Depth is ragged where a surface ends: the outermost bins do not belong to the profile.
    filled = np.cumsum(counts > 0.0, axis=1)
    weights = np.where((filled > 1) & (filled < filled[:, -1:]), counts, 0.0)
    x = BIN_M * (np.arange(places.shape[1]) - places.shape[1] // 2)
    middles = weights @ x / np.maximum(weights.sum(axis=1), 1.0)
    t = x - middles[:, None]
    by = np.stack([np.ones(t.shape), t, 0.5 * t * t], axis=1)
    for _ in range(3):
        used = np.count_nonzero(weights, axis=1)
        weighted = by * weights[:, None, :]
        inverse = np.linalg.inv(weighted @ by.transpose(0, 2, 1) + 1e-12 * np.eye(3))
        shapes = inverse @ weighted @ places[:, :, None]
        sizes = np.sqrt(weights) * np.abs(places - (shapes.transpose(0, 2, 1) @ by)[:, 0])
        variances = np.where(used < LEAST_BINS, np.inf, (sizes**2).sum(axis=1) / np.maximum(used - 3, 1) * inverse[:, 2, 2])
        medians = np.sort(sizes, axis=1)[np.arange(len(used)), sizes.shape[1] - 1 - used // 2]
        weights = np.where(sizes <= KEPT_SIGMAS * medians[:, None], weights, 0.0)
    return shapes[:, 2, 0], variances, middles


def turn_by(bow: Bow, sides: tuple[Side | None, Side | None]) -> tuple[float, float]:
    """Return the angle by which a bow turns the edge in view from the chord of the flight, and its standard deviation [rad]."""
    left, right = sides
    if left is None or right is None or not bow.is_bowed:
        return 0.0, bow.root_mean_square_1_m * UNSEEN_MIDDLE_M
    middle = 0.5 * (left.aside_m + right.aside_m)
    turn = bow.curvature_1_m * (middle - bow.seen_aside_m)
    return turn, abs(TURN_SHARE * turn)
