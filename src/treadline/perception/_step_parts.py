"""Parts of a stair as numbers: heights and ends of treads, places and ends of risers, in axes across the edges.

A rising flight shows the fronts of its treads and its risers; a falling flight shows treads alone, each ending at the nosing that
hides the riser below.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from treadline.core.arrays import cross
from treadline.core.camera_images import PinholeCamera
from treadline.core.rotations import Rotation, Vector3
from treadline.core.signals import Direction
from treadline.perception import _plane_segmentation_kernels as surface_kernels
from treadline.perception._plane_segmentation import Line, PlanarBlocks, Surface

TREAD_SIGMA_M, EDGE_SIGMA_M, RISER_SIGMA_M = 0.007, 0.008, 0.010
"""Standard deviations near the camera [m]: of a tread's height, the plane of a hundred blocks; of a nosing and of a riser's ends,
edges rounded by 10 mm; of a riser, whose board leans by 2°, and of a tread's corner with it."""
VAGUE_SIGMA_M = 0.020
"""Additional standard deviation of an end past which nothing is known [m]: the width of a metal strip or a shadow."""
END_PX = 0.6
"""Standard deviation of a surface's end in the image [px]: edges of a Kinect jitter by 0.8 px of its sensor."""
LEAST_LEVER = 0.17
"""Least component of a line's normal along ahead: a nosing within 10° of the camera height determines a height but no direction."""
LEVEL_LEAST = 0.2
"""Least horizontal component of the chair's longitudinal axis for the definition of the forward direction."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Axes:
    """Orthonormal axes in C: horizontal and perpendicular to the edges, up, and along the edges to the right."""

    ahead: Vector3
    up: Vector3
    right: Vector3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Tread:
    """Horizontal surface and the lines at its ends in the image."""

    surface: Surface
    lower: Line | None
    upper: Line | None

    def ends(self, axes: Axes) -> tuple[Line | None, Line | None]:
        """Return the line at the near and at the far end."""
        if self.lower is None or self.upper is None:
            known = self.upper if self.lower is None else self.lower
            if known is None:
                return None, None
            near = float(known.middle @ axes.ahead) < float(self.surface.centre @ axes.ahead)
            return (known, None) if near else (None, known)
        if float(self.lower.middle @ axes.ahead) <= float(self.upper.middle @ axes.ahead):
            return self.lower, self.upper
        return self.upper, self.lower

    def front(self, axes: Axes, direction: Direction) -> Line | None:
        """Return the line at the nosing: at the near end in a rising flight, at the far one in a falling flight."""
        return self.ends(axes)[0 if direction == "up" else 1]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Riser:
    """Vertical surface no higher than a step, and the line at its upper end."""

    surface: Surface
    upper: Line | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NosingObservation:
    """Observation of one edge of the stair: its riser, its lines, or both."""

    step: int
    """Number of the step in its flight, rising with height."""
    ahead_m: float
    """Horizontal distance from the camera, perpendicular to the edges [m]."""
    point: Vector3
    """Point on the edge in C [m]."""
    sides_m: tuple[float, float]
    """Lateral range of visibility across the flight, to the right [m]."""
    riser: Surface | None
    lines: tuple[Line, ...]
    """Lines that determine the edge direction; lines near the camera height do not."""

    @property
    def has_direction(self) -> bool:
        """Whether the nosing determines the edge direction."""
        return self.riser is not None or bool(self.lines)

    def ends_m(self, edge: Vector3, aside: Vector3) -> Float[np.ndarray, "2 3"]:
        """Return the first and last visible point along an edge direction, in C [m].

        Args:
            aside: Unit vector of ``sides_m``.
        """
        along = (np.array(self.sides_m) - float(self.point @ aside)) / float(edge @ aside)
        return np.asarray(self.point + along[:, None] * edge)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Flight:
    """Visible part of a flight."""

    direction: Direction
    evidence: float
    """Log-evidence against a scene without a stair [nats]."""
    rise_m: float
    run_m: float
    levels: int
    """Number of steps with a measured height."""
    size_prior: tuple[tuple[float, float], tuple[float, float]]
    """Mean and standard deviation of the rise, and of the run, before the measurement [m]."""
    treads: list[Surface]
    """All horizontal surfaces in view."""
    nosings: list[NosingObservation]
    """Nosings, nearest first."""
    facing: Vector3
    """Horizontal unit vector, approximately perpendicular to the edges, in C."""
    matched_treads: list[tuple[int, bool, Tread]]
    """Step, whether the front is a nosing, and tread."""
    matched_risers: list[tuple[int, Riser]]
    """Step and riser."""
    is_single: bool = False
    """Whether this is a single step, a kerb: nothing repeats, and the run is nominal."""

    @property
    def risers(self) -> list[Surface]:
        """Risers of the nosings."""
        return [nosing.riser for nosing in self.nosings if nosing.riser is not None]

    @property
    def steps(self) -> list[Surface]:
        """Treads of the flight, with a floor or landing on its lattice."""
        return [tread.surface for *_, tread in self.matched_treads]


def viewing_direction(R_BC: Rotation) -> float:
    """Return 1 for a front camera, and -1 for a camera looking back over the chair.

    For a camera looking straight down, the upper edge of its image gives the direction.
    """
    look, image_up = R_BC[0, 2], -R_BC[0, 1]
    return 1.0 if look + image_up > 0.0 else -1.0


def axes_about(edge: Vector3, down: Vector3) -> Axes:
    """Return the axes of edges along a unit vector in C, with the vertical as near to ``down`` as they allow."""
    d = down - float(down @ edge) * edge
    d = d / np.linalg.norm(d)
    return Axes(ahead=cross(edge, d), up=-d, right=edge)


def level_axes(down: Vector3, R_BC: Rotation) -> Axes | None:
    """Return horizontal axes, forward in the camera's viewing direction along the chair, or up the image if undefined."""
    for towards in (viewing_direction(R_BC) * R_BC[0], np.array([0.0, -1.0, 0.0])):
        ahead = towards - float(towards @ down) * down
        length = float(np.linalg.norm(ahead))
        if length > LEVEL_LEAST:
            ahead = ahead / length
            return Axes(ahead=ahead, up=-down, right=cross(down, ahead))
    return None


def tread_of(surface: Surface, camera: PinholeCamera) -> Tread:
    """Return a horizontal surface with the lines at its ends."""
    return Tread(surface=surface, lower=surface.line("lower", camera), upper=surface.line("upper", camera))


def riser_of(surface: Surface, camera: PinholeCamera) -> Riser:
    """Return a vertical surface with the line at its upper end before a larger depth."""
    line = surface.line("upper", camera)
    return Riser(surface=surface, upper=None if line is None or line.kind == "corner" else line)


def tread_rows(
    treads: Sequence[Tread], blocks: PlanarBlocks, axes: Axes, camera: PinholeCamera, direction: Direction
) -> Float[np.ndarray, "t 10"]:
    """Return the rows of ``_lattice_kernels`` for treads, mirrored for a falling flight."""
    rows = np.empty((len(treads), 10))
    for row, tread in zip(rows, treads, strict=True):
        near, far = tread.ends(axes)
        row[0], row[1] = float(tread.surface.centre @ axes.up), TREAD_SIGMA_M**2
        row[2], row[3] = _place(near, axes, camera)
        row[4], row[5] = _place(far, axes, camera)
        # The other end of a step is its corner with the next riser; in a falling flight the step above hides it.
        other, at = (far, 5) if direction == "up" else (near, 3)
        if direction == "down" or (other is not None and other.kind != "corner"):
            row[at] = math.inf
        row[6:8] = tread.surface.span_m(blocks, axes.right)
        row[8:10] = tread.surface.span_m(blocks, axes.ahead)
        if direction == "down":
            row[[2, 3, 4, 5]] = -row[4], row[5], -row[2], row[3]
            row[8], row[9] = -row[9], -row[8]
    return rows


def _place(line: Line | None, axes: Axes, camera: PinholeCamera) -> tuple[float, float]:
    """Return the distance of a line ahead and its variance; an infinite variance without a line."""
    if line is None:
        return 0.0, math.inf
    ahead, up = float(line.middle @ axes.ahead), float(line.middle @ axes.up)
    pixel_m = (ahead**2 + up**2) / (max(abs(up), 1e-3) * camera.fy_px)
    near = EDGE_SIGMA_M if line.kind == "edge" else RISER_SIGMA_M
    vague = VAGUE_SIGMA_M if line.kind == "vague" else 0.0
    return ahead, near**2 + TREAD_SIGMA_M**2 + (END_PX * pixel_m) ** 2 + vague**2


def riser_rows(risers: Sequence[Riser], blocks: PlanarBlocks, axes: Axes, camera: PinholeCamera) -> Float[np.ndarray, "r 10"]:
    """Return the rows of ``_lattice_kernels`` for risers."""
    rows = np.empty((len(risers), 10))
    for row, riser in zip(rows, risers, strict=True):
        surface = riser.surface
        pixel_m = surface.distance_m / camera.fy_px
        row[0], row[1] = float(surface.centre @ axes.ahead), RISER_SIGMA_M**2
        for k, ends in ((2, surface.upper), (4, surface.lower)):
            height_m = surface_kernels.height_of_end(
                ends.columns,
                ends.rows,
                ends.follows,
                surface.normal,
                axes.up,
                camera.height_px,
                camera.pinhole,
            )
            known = math.isfinite(height_m)
            row[k] = height_m if known else 0.0
            row[k + 1] = EDGE_SIGMA_M**2 + (END_PX * pixel_m) ** 2 if known else math.inf
        row[6:8] = surface.span_m(blocks, axes.right)
        row[8:10] = surface.span_m(blocks, axes.up)
    return rows


def seed_points(treads: Float[np.ndarray, "t 10"], risers: Float[np.ndarray, "r 10"]) -> Float[np.ndarray, "p 5"]:
    """Return the points of which pairs propose a staircase: fronts of treads, tops of risers, feet of risers."""
    fronts, tops, feet = treads[np.isfinite(treads[:, 3])], risers[np.isfinite(risers[:, 3])], risers[np.isfinite(risers[:, 5])]
    points = np.concatenate(
        [
            np.column_stack([np.full(len(rows), float(kind)), rows[:, columns]])
            for kind, rows, columns in ((0, fronts, [2, 0, 6, 7]), (1, tops, [0, 2, 6, 7]), (2, feet, [0, 4, 6, 7]))
        ]
    )
    return np.ascontiguousarray(points)  # numpy answers column-major unless a part has one row; each layout would be compiled
