"""Form of a flight from its matched surfaces: the bow of its edges, and where it ends at the sides.

A side is where several surfaces end at one lateral position: at a wall, when what follows is nearer, or open, when it is further
away or nothing. Surfaces that the image or an object cuts off give a bound only.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float, Int

from treadline.core.camera_images import BASELINES_M, PinholeCamera
from treadline.perception import _form_kernels as form_kernels
from treadline.perception._irregularity import pooled_mean
from treadline.perception._step_parts import Axes
from treadline.perception.plane_segmentation import JUMP, Ends, PlanarBlocks, Surface

SideKind = Literal["wall", "open"]
"""What follows beyond the side of a flight."""
LOOK_SHARE = 24
"""Image width divided by the largest number of columns past a surface's end in which its surroundings are looked for."""
SAME_SIDE_M, SURPASSED_M = 0.05, 0.08
"""Largest lateral distance of ends at one side [m], and distance by which another surface surpasses a side that is none."""
ENDS_LEAST = 2
"""Least number of surfaces that end at one side."""
BIN_M, BINS = 0.04, 61
"""Width and number of bins across the flight for the common profile: 1.2 m to either side of the camera."""
PARTS = 16
"""Number of parts of a profile whose scatter gives the standard deviation of its curvature."""
CAMERA_BOW, CAMERA_WARP_PX = 0.02, 0.05
"""Standard deviation of a curvature that is the camera's, common to all edges [1/m], and the depth warp that has it [px]: at 1.5 m
it bends half a metre by 2.5 mm. It is also the largest one, because bowed edges make the estimated warp larger than it is."""
STEP_BOWS = np.geomspace(0.002, 0.5, 10)
"""Grid of the scatter of curvature between the edges of one flight [1/m]: 0.2 mm of bow over a metre, as drawn, to the errors of
profiles that objects cut off."""
BOWED, BOW_1_M = 0.05, 0.1
"""Prior probability of bowed edges, and standard deviation of their curvature [1/m]: a sagitta of 2 cm over 1.3 m."""
BOW_KNOWN = 0.12
"""Largest standard deviation of a curvature that is evaluated [1/m]. Of 156 frames facing down nine had a false curvature above
four deviations, all with deviations of 0.17 and more; of 24 frames of edges bowed by 15 cm the largest deviation was 0.09."""
COMMON_LEAST = 2.0
"""Least ratio of the mean square of the common profile to that expected from its scatter: noise alone reaches 2 in one frame of
four."""
UNSEEN_MIDDLE_M, MIDDLE_SIGMA_M, TURN_SHARE = 0.30, 0.05, 0.3
"""Assumed distance of the visible part from the middle of a bowed flight whose sides are not in view; error of the middle if they
are [m], and relative error of the correction."""


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
    kinds: Int[np.ndarray, " k"]
    """What follows: ``form_kernels.CUT``, ``WALL`` or ``OPEN``."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Bow:
    """Curvature of the edges in the horizontal plane."""

    curvature_1_m: float
    """Mean curvature, positive for edges whose ends are further away than their middle [1/m]."""
    sigma_1_m: float
    """Standard deviation of the curvature [1/m]; infinite without a profile."""
    seen_aside_m: float
    """Mean lateral position of the profiles, to the right of the camera [m]."""
    uneven_rad: float
    """Standard deviation of the edges' angle by what all profiles have in common beyond a curvature: a runner, or multipath near a
    wall [rad]."""

    @property
    def bowed(self) -> float:
        """Probability that the edges are bowed."""
        if self.sigma_1_m > BOW_KNOWN:
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
        """Root of the mean square of the curvature [1/m], straight edges included."""
        share = BOW_1_M**2 / (BOW_1_M**2 + self.sigma_1_m**2) if self.bowed else 0.0
        return math.sqrt(self.bowed * ((share * self.curvature_1_m) ** 2 + share * self.sigma_1_m**2)) if share else 0.0


def sides_of(ends: Sequence[LateralEnds]) -> tuple[Side | None, Side | None]:
    """Return the left and right side of a flight in the camera's view; None where none is seen."""
    left, right = (_side(end.outward_m, end.kinds, way) for way, end in zip((-1, 1), ends, strict=True))
    return left, right


def lateral_ends_of(
    surfaces: Sequence[Surface], blocks: PlanarBlocks, camera: PinholeCamera, axes: Axes
) -> tuple[LateralEnds, LateralEnds]:
    """Return where the surfaces of a flight end on the left and on the right."""
    look = max(2, camera.width_px // LOOK_SHARE)
    found: list[LateralEnds] = []
    for way in (-1, 1):
        places, kinds = np.empty(len(surfaces)), np.empty(len(surfaces), dtype=np.int64)
        for k, surface in enumerate(surfaces):
            places[k], kinds[k] = form_kernels.side_of(
                blocks.nearness,
                surface.upper.columns,
                surface.upper.rows,
                surface.lower.rows,
                surface.normal,
                axes.right,
                way,
                look,
                JUMP * blocks.noise,
                BASELINES_M.get(camera.sensor, max(BASELINES_M.values())),  # the largest for an unknown one
                camera.pinhole,
            )
        found.append(LateralEnds(outward_m=way * places, kinds=kinds))
    return found[0], found[1]


def narrower_by_m(ends: Sequence[LateralEnds], steps: Int[np.ndarray, " k"]) -> float:
    """Return the largest width by which higher steps extend beyond the ends of a single lower one [m].

    A step ends where its surfaces end together, at least one of them open: a footstool before a sofa, not a step behind an object.
    Several steps that end at one place belong to a flight whose landing is wider.

    Args:
        steps: Step of each surface.
    """
    most_m: dict[int, float] = {}
    for end in ends:
        known = np.isfinite(end.outward_m)
        places_m: dict[int, float] = {}
        for step in np.unique(steps).tolist():
            own = known & (steps == step) & (end.kinds != form_kernels.CUT)
            together = np.count_nonzero(own) >= ENDS_LEAST and np.ptp(end.outward_m[own]) < SAME_SIDE_M
            if together and (end.kinds[own] == form_kernels.OPEN).any():
                places_m[step] = float(end.outward_m[own].mean())
        for step, place_m in places_m.items():
            above = known & (steps > step)
            alone = all(other == step or abs(its_m - place_m) > SAME_SIDE_M for other, its_m in places_m.items())
            if alone and above.any():
                most_m[step] = most_m.get(step, 0.0) + max(float(end.outward_m[above].max()) - place_m, 0.0)
    return max(most_m.values(), default=0.0)


def _side(outward: Float[np.ndarray, " k"], kinds: np.ndarray, way: int) -> Side | None:
    """Return the outermost position at which several surfaces end, unless others surpass it."""
    known = np.isfinite(outward)
    for kind, name in ((form_kernels.WALL, "wall"), (form_kernels.OPEN, "open")):
        ends = np.sort(outward[known & (kinds == kind)])[::-1]
        for place in ends.tolist():
            together = ends[np.abs(ends - place) < SAME_SIDE_M]
            if together.size < ENDS_LEAST:
                continue
            side_m = float(np.median(together))
            if (outward[known] > side_m + SURPASSED_M).any():
                break
            return Side(aside_m=way * side_m, kind="wall" if name == "wall" else "open")
    return None


def bow_of(
    fronts: Sequence[tuple[Surface, Ends]],
    risers: Sequence[Surface],
    blocks: PlanarBlocks,
    camera: PinholeCamera,
    axes: Axes,
    warp_px: float,
) -> Bow:
    """Return the curvature of the edges, pooled over the fronts of treads and the faces of risers.

    Args:
        fronts: Treads whose front is a nosing, with that end.
        warp_px: Size of the depth warp [px of Kinect disparity].
    """
    curvatures: list[float] = []
    variances: list[float] = []
    middles: list[float] = []
    profiles = [(tread, end, False) for tread, end in fronts] + [(riser, riser.upper, True) for riser in risers]
    widths: list[float] = []
    of_riser: list[bool] = []
    shapes, weights = np.zeros((2, len(profiles) + 1, BINS))
    for surface, end, is_riser in profiles:
        row = len(curvatures)
        curvature, sigma, middle, width = form_kernels.curvature_of(
            blocks.nearness,
            surface.upper.columns,
            surface.upper.rows,
            surface.lower.rows,
            end.rows,
            end.follows,
            surface.normal,
            axes.ahead,
            axes.right,
            is_riser,
            PARTS,
            BIN_M,
            camera.pinhole,
            shapes[row],
            weights[row],
        )
        if math.isfinite(curvature):
            widths.append(width)
            of_riser.append(is_riser)
            curvatures.append(curvature)
            variances.append(sigma**2)
            middles.append(middle)
    if not curvatures:
        return Bow(curvature_1_m=0.0, sigma_1_m=math.inf, seen_aside_m=0.0, uneven_rad=0.0)
    pooled = pooled_mean(np.array(curvatures), np.array(variances), np.zeros(len(curvatures), dtype=bool), STEP_BOWS)
    precision = 1.0 / np.array(variances)
    # The slope of deviations that are alike over the whole width: that of a uniform density has a variance of 1/12.
    faces = np.array(of_riser)
    square, ratio = form_kernels.common_square(shapes[: len(faces)][faces], weights[: len(faces)][faces])
    uneven_m = math.sqrt(square * max(1.0 - COMMON_LEAST / max(ratio, COMMON_LEAST), 0.0))
    return Bow(
        curvature_1_m=pooled.mean,
        sigma_1_m=math.hypot(pooled.sigma, CAMERA_BOW * min(warp_px / CAMERA_WARP_PX, 1.0)),
        seen_aside_m=float(precision @ middles) / float(precision.sum()),
        uneven_rad=math.sqrt(12.0) * uneven_m / float(np.median(widths)),
    )


def turn_by(bow: Bow, sides: tuple[Side | None, Side | None]) -> tuple[float, float]:
    """Return the angle by which a bow turns the edge in view from the chord of the flight, and its standard deviation [rad]."""
    left, right = sides
    if left is None or right is None or not bow.is_bowed:
        return 0.0, bow.root_mean_square_1_m * UNSEEN_MIDDLE_M
    middle = 0.5 * (left.aside_m + right.aside_m)
    turn = bow.curvature_1_m * (middle - bow.seen_aside_m)
    return turn, math.hypot(bow.curvature_1_m * MIDDLE_SIGMA_M, TURN_SHARE * turn)
