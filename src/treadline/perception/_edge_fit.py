"""Edge direction of the stair from all treads, risers and nosings in view, with its uncertainty.

Every tread, every riser and every plane through a nosing and the camera centre contains the edge direction e, so each normal n
satisfies n·e = 0. The unknowns are small angles relative to an initial direction: α, the rotation of the edges about the vertical,
ρ, their tilt from horizontal, and the nuisance directions of camera and flight (``nuisance``). Risers determine α,
treads and gravity ρ, nosings seen from above a mixture of both. A warp tilts all planes from depth, increasingly with distance, but
no line in the image: lines and planes together, and planes at different places and distances, determine it.

The error of a surface has two parts: sensor noise, visible in the residuals, and irregularity of the stair, whose steps are not
exactly parallel: riser and nosing of a step rotate together, tread and nosing tilt together. The sizes of irregularity and warp,
and the hypotheses of a curved flight, a rolling shutter and multipath, are nuisance parameters and are marginalised
(``nuisance_kernels``).
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from jaxtyping import Bool, Float, Int

from treadline.core.angles import DEG
from treadline.core.camera_images import PinholeCamera
from treadline.core.rotations import Vector3
from treadline.perception._gravity_direction import gravity_variance
from treadline.perception._irregularity import Prior, prior
from treadline.perception._nuisance import (
    COLUMNS,
    CURVATURE,
    CURVATURE_1_M,
    SPREAD,
    TERMS,
    NuisanceModel,
    drift_of,
    nuisance_model_of,
    reach_of,
    turns_of_line,
    turns_of_surface,
)
from treadline.perception._nuisance_kernels import marginal_posterior, reject_outliers, variances
from treadline.perception._step_parts import Axes, NosingObservation, axes_about
from treadline.perception.plane_segmentation import Surface

ANGLES = np.geomspace(0.0005 * DEG, 2.0 * DEG, 8)
"""Grid of the standard deviations of step irregularity, about the vertical and from horizontal [rad]."""
WARPS_PX = np.geomspace(0.0003, 0.1, 7)
"""Grid of warp sizes [px of Kinect disparity]: from a good calibration to factory calibration."""
FINE = prior(ANGLES, ANGLES, WARPS_PX)
"""Prior on the full grid."""
ROUGH = prior(ANGLES[4:5], ANGLES[4:5], WARPS_PX, as_drawn=0.0)
"""Prior for the initial estimate of the rotation."""
COARSE = prior(*(grid[::3].copy() for grid in (ANGLES, ANGLES, WARPS_PX)), as_drawn=0.0, usual_rad=np.inf)
"""Prior for outlier rejection; copied, because a different memory layout would compile the kernels again."""
STRAY, CORNER_STRAY = 0.003, 0.03
"""Prior probability that a surface or a corner line does not belong to the stair: an object on a tread tilts it, or starts at a
possible nosing."""
SAME_STEP_M = 0.03
"""Largest distance between a nosing and the plane of its tread [m]."""
OUTLIER, OUTLIER_SIGMAS = 3.0 * DEG, 5.0
"""Surfaces whose directions differ by more than this angle [rad], and by this number of standard deviations, do not belong to one
straight flight."""
ASSUMED_TILT = 0.5 * DEG
"""Assumed standard deviation of a single tread's tilt in the comparison of risers and nosings [rad]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EdgeFit:
    """Estimated edge direction in C."""

    edge: Vector3
    """Unit vector along the edges."""
    ahead: Vector3
    """Horizontal unit vector perpendicular to the edges: the direction in which a rotation about the vertical moves the edge
    vector."""
    down: Vector3
    covariance: Float[np.ndarray, "2 2"]
    """Covariance of the edge angles about the vertical and from horizontal [rad²]."""
    agreeing: float
    """Fraction of the nosings consistent with the estimate."""
    widest_rad: float
    """Largest angle about the vertical between a nosing and the edge direction [rad]."""
    planes_against_lines_rad: tuple[float, float] | None
    """Angle about the vertical from risers minus that from lines, and its standard deviation [rad]; None unless both are
    available."""
    curvature_1_m: float
    """Curvature of the flight if it is curved [1/m]: rotation of the edges per distance ahead of the chair."""
    curved: float
    """Probability of a curved flight."""
    warp_px: float
    """Root of the mean square of the depth warp's size [px of Kinect disparity]."""

    def sigma_of(self, change: Vector3) -> float:
        """Return the standard deviation of a quantity with the differential ``change · de``."""
        by = np.array([float(change @ self.ahead), float(change @ self.down)])
        return float(np.sqrt(by @ self.covariance @ by))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Normals:
    """All unit normals, treads first and gravity last."""

    unit: Float[np.ndarray, "k 3"]
    covariance: Float[np.ndarray, "k 3 3"]
    """Covariance of the normals; zero for gravity, whose variance depends on the treads."""
    turns: Float[np.ndarray, "k 3 c"]
    """Derivative of each normal with respect to each nuisance direction."""
    reach_m: Float[np.ndarray, " k"]
    """Distance of each normal's nosing ahead of the camera [m]; zero for a tread and gravity."""
    tilts: Bool[np.ndarray, " k"]
    """Whether the normal tilts with a tread."""
    group: Int[np.ndarray, " k"]
    """Index of the nosing that rotates with the normal; -1 for none."""
    step: Int[np.ndarray, " k"]
    """Index of the step: that of a nosing, or a separate one for a tread without nosing; -1 for gravity."""
    stray: Float[np.ndarray, " k"]
    """Prior probability that the normal does not belong to the stair."""
    treads: int


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Rows:
    """Linear equations ``by · (α, ρ) + turns · nuisances = value``, one per normal."""

    value: Float[np.ndarray, " k"]
    by: Float[np.ndarray, "k 2"]
    turns: Float[np.ndarray, "k c"]
    noise: Float[np.ndarray, " k"]
    """Variance of the normal's angle across the edges [rad²]."""
    tilts: Bool[np.ndarray, " k"]
    """Whether the normal tilts with a tread; this and the following fields as in ``_Normals``."""
    group: Int[np.ndarray, " k"]
    step: Int[np.ndarray, " k"]
    stray: Float[np.ndarray, " k"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Solution:
    mean: Float[np.ndarray, " n"]
    """Estimated nuisances, α and ρ."""
    covariance: Float[np.ndarray, "2 2"]
    """Covariance of α and ρ [rad²]."""
    likeliest: Float[np.ndarray, "n n"]
    """Covariance of all unknowns at the most likely hypothesis, irregularity and warp size."""
    beliefs: Float[np.ndarray, " h"]
    """Probability of each hypothesis."""
    warp_px: float


def fit_edges(
    nosings: Sequence[NosingObservation],
    treads: Sequence[Surface],
    down: Vector3,
    down_sigma_rad: float,
    start: Vector3,
    camera: PinholeCamera,
    *,
    spread_px: float = 0.0,
    measures_range: bool = False,
) -> EdgeFit:
    """Return the direction perpendicular to all normals.

    Args:
        nosings: At least one, with a riser or a line.
        down: Unit vector in C. Edges are horizontal: gravity is equivalent to one more tread, with its own uncertainty.
        start: Initial edge direction.
        spread_px: Standard deviation of the shift of surfaces' ends that all lines have in common [px].
        measures_range: Whether the camera is one of time of flight.
    """
    possible = nuisance_model_of(measures_range=measures_range)
    edge = start / np.linalg.norm(start)
    nosings = [nosing for nosing in nosings if nosing.has_direction]
    normals = _normals(nosings, treads, down, edge, camera, spread_px)
    for last in (False, True):
        axes = axes_about(edge, down)
        rows = _rows(normals, down_sigma_rad, axes, camera)
        angles, noise = _angles(rows, len(nosings))
        kept = _agreeing(angles, noise)
        chosen = np.concatenate([kept, [True]])[rows.group]
        chosen[rows.group < 0] = _agreeing_treads(rows)
        if last:
            chosen[chosen] = _of_the_stair(_only(rows, chosen))
        rows = _only(rows, chosen)
        solution = _solved(rows, *((FINE, possible) if last else (ROUGH, possible.simplest)))
        alpha, rho = solution.mean[-2:].tolist()
        edge = axes.right + alpha * axes.ahead - rho * axes.up
        edge /= np.linalg.norm(edge)
    off = angles - alpha
    return EdgeFit(
        edge=edge,
        ahead=axes.ahead,
        down=-axes.up,
        covariance=solution.covariance,
        agreeing=float(kept.mean()),
        widest_rad=float(np.abs(off).max()),
        planes_against_lines_rad=_planes_against_lines(rows, solution),
        curvature_1_m=CURVATURE_1_M * float(solution.mean[CURVATURE]),
        curved=float(solution.beliefs[1]),
        warp_px=solution.warp_px,
    )


def _steps(nosings: Sequence[NosingObservation], treads: Sequence[Surface]) -> list[int]:
    """Return the step index of each tread: that of its nosing, or a new one."""
    found: list[int] = []
    for tread in treads:
        off = [abs(float(tread.normal @ nosing.point) - 1.0) * tread.distance_m for nosing in nosings]
        nearest = int(np.argmin(off)) if off else 0
        own = bool(off) and off[nearest] < SAME_STEP_M and nearest not in found
        found.append(nearest if own else len(nosings) + len(found))
    return found


def _normals(
    nosings: Sequence[NosingObservation],
    treads: Sequence[Surface],
    down: Vector3,
    edge: Vector3,
    camera: PinholeCamera,
    spread_px: float,
) -> _Normals:
    drift = drift_of(camera)
    found = [(tread.unit, tread.unit_covariance, turns_of_surface(tread, None, camera, drift), True, -1, STRAY) for tread in treads]
    for number, nosing in enumerate(nosings):
        if nosing.riser is not None:
            turns = turns_of_surface(nosing.riser, edge, camera, drift)
            found.append((nosing.riser.unit, nosing.riser.unit_covariance, turns, False, number, STRAY))
        for line in nosing.lines:
            turns, own = turns_of_line(line, camera, drift, spread_px), STRAY if line.kind == "edge" else CORNER_STRAY
            found.append((line.normal, line.covariance, turns, True, number, own))
    found.append((down, np.zeros((3, 3)), np.zeros((3, COLUMNS)), False, -1, 0.0))
    unit, covariance, of_nuisances, tilts, group, stray = map(np.array, zip(*found, strict=True))
    return _Normals(
        unit=unit,
        covariance=covariance,
        turns=of_nuisances,
        reach_m=np.array([0.0 if k < 0 else nosings[k].ahead_m for k in group.tolist()]),
        tilts=tilts,
        group=group,
        step=np.array([*_steps(nosings, treads), *group[len(treads) :].tolist()]),
        stray=stray,
        treads=len(treads),
    )


def _rows(normals: _Normals, down_sigma_rad: float, axes: Axes, camera: PinholeCamera) -> _Rows:
    """Return the equations of all normals, gravity last."""
    value = -(normals.unit @ axes.right)
    by = np.column_stack([normals.unit @ axes.ahead, normals.unit @ -axes.up])
    noise = variances(normals.covariance, axes.right)
    level = value[: normals.treads] / by[: normals.treads, 1]
    noise[-1] = gravity_variance(level - value[-1] / by[-1, 1], down_sigma_rad)
    turns = -np.einsum("i,kit->kt", axes.right, normals.turns)
    turns[:, CURVATURE] = CURVATURE_1_M * by[:, 0] * (normals.reach_m + reach_of(camera, axes.ahead)) * (normals.group >= 0)
    return _Rows(
        value=value,
        by=by,
        turns=turns,
        noise=noise,
        tilts=normals.tilts,
        group=normals.group,
        step=normals.step,
        stray=normals.stray,
    )


def _only(rows: _Rows, chosen: Bool[np.ndarray, " k"]) -> _Rows:
    return _Rows(**{field.name: getattr(rows, field.name)[chosen] for field in fields(rows)})


def _angles(rows: _Rows, count: int) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Return the angle about the vertical of each single nosing, and its variance."""
    of_nosing = rows.group >= 0
    weight = rows.by[of_nosing, 0] ** 2 / rows.noise[of_nosing]
    total = np.bincount(rows.group[of_nosing], weight, count)
    angle = np.bincount(rows.group[of_nosing], weight * rows.value[of_nosing] / rows.by[of_nosing, 0], count) / total
    return angle, 1.0 / total


def _without_nuisances(rows: _Rows, solution: _Solution) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, " k"]]:
    """Return what estimated tilt and warp leave of the equations' values, and its variance without that of single tilts [rad²]."""
    others = np.column_stack([rows.turns, np.zeros(len(rows.value)), rows.by[:, 1]])
    left = rows.value - others @ solution.mean
    return left, rows.noise + np.einsum("ki,ij,kj->k", others, solution.likeliest, others)


def _agreeing(values: Float[np.ndarray, " n"], variances: Float[np.ndarray, " n"]) -> Bool[np.ndarray, " n"]:
    """Return the mask of values in the largest consistent subset."""
    if not len(values):
        return np.ones(0, dtype=bool)
    apart = np.abs(values[:, None] - values[None, :])
    crowds = apart < np.maximum(OUTLIER, OUTLIER_SIGMAS * np.sqrt(variances[:, None] + variances[None, :]))
    return np.asarray(crowds[int(np.argmax(crowds.sum(axis=1)))])


def _agreeing_treads(rows: _Rows) -> Bool[np.ndarray, " t"]:
    """Return the mask of treads, and gravity, consistent with each other."""
    treads = (rows.group < 0) & rows.tilts
    level = rows.value[treads] / rows.by[treads, 1]
    return np.append(_agreeing(level, rows.noise[treads]), True)


def _of_the_stair(rows: _Rows) -> Bool[np.ndarray, " k"]:
    """Return the mask of equations accepted by the evidence; the others fit better as uniform outliers."""
    kept = np.ones(len(rows.value), dtype=np.bool_)
    with np.errstate(divide="ignore"):
        penalty = np.log(2.0 * OUTLIER) - np.log(rows.stray / (1.0 - rows.stray))
    reject_outliers(*_equations(rows, SPREAD + 1), COARSE.turns, COARSE.tilts, COARSE.warps, COARSE.logs, TERMS, penalty, kept)
    return kept


def _solved(rows: _Rows, tried: Prior, possible: NuisanceModel) -> _Solution:
    """Return nuisances, α and ρ with hypothesis, irregularity and warp size marginalised."""
    covariance = np.empty((COLUMNS + 2, COLUMNS + 2))
    mean, spread, beliefs, warp = marginal_posterior(
        *_equations(rows),
        tried.turns,
        tried.tilts,
        tried.warps,
        tried.logs,
        possible.present,
        possible.logs,
        possible.scales,
        TERMS,
        covariance,
    )
    covariance_of_angles = np.array([[spread[0], spread[2]], [spread[2], spread[1]]])
    return _Solution(
        mean=mean, covariance=covariance_of_angles, likeliest=covariance, beliefs=beliefs, warp_px=float(np.sqrt(warp))
    )


def _equations(
    rows: _Rows, columns: int = COLUMNS
) -> tuple[
    Float[np.ndarray, "k n"],
    Float[np.ndarray, " k"],
    Float[np.ndarray, " k"],
    Float[np.ndarray, " k"],
    Float[np.ndarray, " k"],
    Int[np.ndarray, " k"],
    int,
]:
    """Return coefficients, values, noise and the dependence on the step rotations and tilts, for the compiled kernels.

    Args:
        columns: Number of nuisance directions in use.
    """
    turn_by = np.where(rows.group >= 0, rows.by[:, 0], 0.0)
    tilt_by = np.where(rows.tilts, rows.by[:, 1], 0.0)
    by = np.column_stack([rows.turns[:, :columns], rows.by])
    return by, rows.value, rows.noise, turn_by, tilt_by, rows.step, int(rows.step.max()) + 1


def _planes_against_lines(rows: _Rows, solution: _Solution) -> tuple[float, float] | None:
    """Return the angle about the vertical between risers and nosings without tilt and nuisances, and its standard deviation."""
    of_line = (rows.group >= 0) & rows.tilts
    of_riser = (rows.group >= 0) & ~rows.tilts
    if not of_line.any() or not of_riser.any():
        return None
    left, variance = _without_nuisances(rows, solution)
    variance = variance + np.where(rows.tilts, rows.by[:, 1] * ASSUMED_TILT, 0.0) ** 2
    means, variances = [], []
    for chosen in (of_riser, of_line):
        by = rows.by[chosen, 0]
        weight = by**2 / variance[chosen]
        total = float(weight.sum())
        means.append(float((left[chosen] / by * weight).sum()) / total)
        variances.append(1.0 / total)
    return means[0] - means[1], float(np.sqrt(sum(variances)))
