"""One edge direction from all treads, risers and nosings in view, and how sure it is.

Every tread, every riser and every plane through a nosing and the camera's centre holds the edges' direction e, so each
normal n says n·e = 0. Small numbers are sought around a first direction: α, by which the edges are turned about the vertical,
ρ, by which they are off level, and the terms of the depth's warp (``unknowns.warp``). Risers tell α, treads and gravity ρ, nosings
seen from above a mixture of the two. A warp tilts every plane that depth shows, the further the more, and no line in the image:
lines and planes together, and planes at different places and distances, tell it.

What a surface says is off by the sensor's noise, which residuals show, and by the stair itself, whose steps are not quite parallel:
riser and nosing of a step turn with it, tread and nosing tilt with it. How irregular a stair is and how warped the depth, is
integrated out (``unknowns.kernels``).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from statistics import median

import numpy as np
from jaxtyping import Bool, Float, Int

from treadline.angles import DEG
from treadline.perception.nosings import Nosing
from treadline.perception.planes import Surface
from treadline.perception.unknowns.kernels import integrated_out, strays, variances
from treadline.perception.unknowns.prior import Prior, prior
from treadline.perception.unknowns.warp import TERMS, turns_of
from treadline.perception.vectors import cross
from treadline.signals import PinholeCamera

ANGLES = np.geomspace(0.0005 * DEG, 2.0 * DEG, 8)
"""Irregularities thought possible of steps: about the vertical, and off level."""
WARPS_PX = np.geomspace(0.0003, 0.1, 7)
"""Warps thought possible, in pixels of a Kinect's disparity: what a good calibration leaves, and what leaves the factory."""
FINE = prior(ANGLES, ANGLES, WARPS_PX)
ROUGH = prior(ANGLES[4:5], ANGLES[4:5], WARPS_PX, as_drawn=0.0)
"""For a first turn."""
COARSE = prior(*(grid[::3].copy() for grid in (ANGLES, ANGLES, WARPS_PX)), as_drawn=0.0, usual_rad=np.inf)
"""To tell strays by; copied, as compiled loops are compiled anew for each layout."""
STRAY, CORNER_STRAY = 0.003, 0.03
"""How often a surface or a line is none of the stair's: what lies on a tread tilts it, and begins where a nosing might be."""
SAME_STEP_M = 0.03
"""Between a nosing and the plane of its tread."""
OUTLIER, OUTLIER_SIGMAS = 3.0 * DEG, 5.0
"""Surfaces further apart than this, and by so many of their deviations, are not of one straight flight."""
GRAVITY_DOUBT, AGREED_SHARE = 2.0, 0.5
"""Declared deviations off which treads have the IMU doubted, if they agree within such a share of that."""
TILT_BELIEVED = 0.5 * DEG
"""Of a single tread, where risers and nosings are compared."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EdgeFit:
    """The edges' direction in C."""

    edge: Float[np.ndarray, " 3"]
    """Unit vector."""
    ahead: Float[np.ndarray, " 3"]
    """Unit vector square to the edges, level: a turn of the edges about the vertical moves them along it."""
    down: Float[np.ndarray, " 3"]
    covariance: Float[np.ndarray, "2 2"]
    """Of the edges' angle about the vertical and of the one by which they are off level [rad²]."""
    agreeing: float
    """Share of the nosings that agree on it."""
    widest_rad: float
    """Largest angle about the vertical between a nosing and the edges' direction."""
    planes_against_lines_rad: tuple[float, float] | None
    """Angle about the vertical by risers less that by lines, and its standard deviation; None unless there are both."""

    def sigma_of(self, change: Float[np.ndarray, " 3"]) -> float:
        """Return the standard deviation of a quantity that changes by ``change · de`` with the direction."""
        by = np.array([float(change @ self.ahead), float(change @ self.down)])
        return float(np.sqrt(by @ self.covariance @ by))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Axes:
    edge: Float[np.ndarray, " 3"]
    ahead: Float[np.ndarray, " 3"]
    down: Float[np.ndarray, " 3"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Normals:
    """All unit normals, of treads first and gravity last, whatever the edges' direction."""

    unit: Float[np.ndarray, "k 3"]
    covariance: Float[np.ndarray, "k 3 3"]
    """Of the normals; none of gravity's, which depends on what the treads say."""
    warp: Float[np.ndarray, "k 3 t"]
    """By how much each term of the warp changes a normal."""
    tilts: Bool[np.ndarray, " k"]
    """Whether it tilts with a tread."""
    group: Int[np.ndarray, " k"]
    """Number of the nosing it turns with; -1 for none."""
    step: Int[np.ndarray, " k"]
    """Number of the step it is of: a nosing's, or one of its own for a tread without one; -1 for gravity."""
    stray: Float[np.ndarray, " k"]
    """How likely it is beforehand to be of something else."""
    treads: int


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Rows:
    """Linear equations ``by · (α, ρ) + warp · terms = value``, one for each normal."""

    value: Float[np.ndarray, " k"]
    by: Float[np.ndarray, "k 2"]
    warp: Float[np.ndarray, "k t"]
    noise: Float[np.ndarray, " k"]
    """Variance of the normal's angle across the edges."""
    tilts: Bool[np.ndarray, " k"]
    """As of the normals, as are the following."""
    group: Int[np.ndarray, " k"]
    step: Int[np.ndarray, " k"]
    stray: Float[np.ndarray, " k"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Solution:
    mean: Float[np.ndarray, " n"]
    """The warp's terms, α and ρ."""
    covariance: Float[np.ndarray, "2 2"]
    """Of α and ρ."""
    likeliest: Float[np.ndarray, "n n"]
    """Covariance of all under the irregularity and the size of the warp that fit best."""


def gravity_variance(tilts: Float[np.ndarray, " k"], sigma_rad: float) -> float:
    """Return the variance of the IMU's idea of level, given by how much treads are off it.

    Treads that agree with each other and not with the IMU tell of a mount that is not what the calibration says: degrees
    where half of one is declared.

    Args:
        tilts: Angles of the treads about one axis against the IMU's level.
        sigma_rad: Declared.
    """
    if len(tilts) >= 2:
        gap = abs(median(tilts.tolist()))
        if gap > GRAVITY_DOUBT * sigma_rad and float(np.ptp(tilts)) < AGREED_SHARE * gap:
            return gap**2
    return sigma_rad**2


def off_gravity(normals: Float[np.ndarray, "k 3"], told: Float[np.ndarray, " 3"]) -> float | None:
    """Return how far treads are off the IMU's down if they agree with each other against it, both ways of tilting; else None.

    Args:
        normals: The treads' own, unit vectors that all point down.
        told: Unit vector that the IMU calls down.
    """
    if len(normals) < 2:
        return None
    mean = normals.mean(axis=0)
    gap = float(np.arccos(np.clip(mean @ told / np.linalg.norm(mean), -1.0, 1.0)))
    apart = float(np.arccos(np.clip((normals @ normals.T).min(), -1.0, 1.0)))
    return gap if apart < AGREED_SHARE * gap else None


def fit_edges(
    nosings: Sequence[Nosing],
    treads: Sequence[Surface],
    down: Float[np.ndarray, " 3"],
    down_sigma_rad: float,
    start: Float[np.ndarray, " 3"],
    camera: PinholeCamera,
) -> EdgeFit:
    """Return the direction at right angles to all normals.

    Args:
        nosings: At least one, with a riser or a line.
        down: Unit vector in C. Edges are level: gravity is one more tread, as good as what tells it.
        start: Edge direction to start from.
    """
    edge = start / np.linalg.norm(start)
    nosings = [nosing for nosing in nosings if nosing.tells]
    normals = _normals(nosings, treads, down, camera)
    for last in (False, True):
        axes = _axes(edge, down)
        rows = _rows(normals, down_sigma_rad, axes)
        angles, noise = _angles(rows, len(nosings))
        kept = _agreeing(angles, noise)
        chosen = np.concatenate([kept, [True]])[rows.group]
        chosen[rows.group < 0] = _agreeing_treads(rows)
        if last:
            chosen[chosen] = _of_the_stair(_only(rows, chosen))
        rows = _only(rows, chosen)
        solution = _solved(rows, FINE if last else ROUGH)
        alpha, rho = solution.mean[-2:].tolist()
        edge = axes.edge + alpha * axes.ahead + rho * axes.down
        edge /= np.linalg.norm(edge)
    off = angles - alpha
    return EdgeFit(
        edge=edge,
        ahead=axes.ahead,
        down=axes.down,
        covariance=solution.covariance,
        agreeing=float(kept.mean()),
        widest_rad=float(np.abs(off).max()),
        planes_against_lines_rad=_planes_against_lines(rows, solution),
    )


def _axes(edge: Float[np.ndarray, " 3"], down: Float[np.ndarray, " 3"]) -> _Axes:
    d = down - float(down @ edge) * edge
    d = d / np.linalg.norm(d)
    return _Axes(edge=edge, ahead=cross(edge, d), down=d)


def _warps(nosings: Sequence[Nosing], treads: Sequence[Surface], camera: PinholeCamera) -> Float[np.ndarray, "k 3 t"]:
    """Return by how much each term of the warp changes each normal, in the order of the rows."""
    none = np.zeros((3, TERMS))
    found = [tread.distance_m * turns_of(tread, camera) for tread in treads]
    for nosing in nosings:
        if nosing.riser is not None:
            found.append(nosing.riser.distance_m * turns_of(nosing.riser, camera))
        found += [none] * len(nosing.lines)
    return np.array([*found, none])


def _steps(nosings: Sequence[Nosing], treads: Sequence[Surface]) -> list[int]:
    """Return the number of each tread's step: that of its nosing, or a new one."""
    found: list[int] = []
    for tread in treads:
        off = [abs(float(tread.normal @ nosing.point) - 1.0) * tread.distance_m for nosing in nosings]
        nearest = int(np.argmin(off)) if off else 0
        own = bool(off) and off[nearest] < SAME_STEP_M and nearest not in found
        found.append(nearest if own else len(nosings) + len(found))
    return found


def _normals(
    nosings: Sequence[Nosing], treads: Sequence[Surface], down: Float[np.ndarray, " 3"], camera: PinholeCamera
) -> _Normals:
    units = [tread.unit for tread in treads]
    covariances = [tread.unit_covariance for tread in treads]
    tilts, group, stray = [True] * len(treads), [-1] * len(treads), [STRAY] * len(treads)
    for number, nosing in enumerate(nosings):
        if nosing.riser is not None:
            units.append(nosing.riser.unit)
            covariances.append(nosing.riser.unit_covariance)
            tilts.append(False)
            stray.append(STRAY)
        for line in nosing.lines:
            units.append(line.normal)
            covariances.append(line.covariance)
            tilts.append(True)
            stray.append(CORNER_STRAY if line.is_corner else STRAY)
        group += [number] * (len(units) - len(group))
    group.append(-1)
    return _Normals(
        unit=np.array([*units, down]),
        covariance=np.array([*covariances, np.zeros((3, 3))]),
        warp=_warps(nosings, treads, camera),
        tilts=np.array([*tilts, False]),
        group=np.array(group),
        step=np.array([*_steps(nosings, treads), *group[len(treads) :]]),
        stray=np.array([*stray, 0.0]),
        treads=len(treads),
    )


def _rows(normals: _Normals, down_sigma_rad: float, axes: _Axes) -> _Rows:
    """Return the equations of all normals, gravity the last."""
    value = -(normals.unit @ axes.edge)
    by = np.column_stack([normals.unit @ axes.ahead, normals.unit @ axes.down])
    noise = variances(normals.covariance, axes.edge)
    level = value[: normals.treads] / by[: normals.treads, 1]
    noise[-1] = gravity_variance(level - value[-1] / by[-1, 1], down_sigma_rad)
    return _Rows(
        value=value,
        by=by,
        warp=-np.einsum("i,kit->kt", axes.edge, normals.warp),
        noise=noise,
        tilts=normals.tilts,
        group=normals.group,
        step=normals.step,
        stray=normals.stray,
    )


def _only(rows: _Rows, chosen: Bool[np.ndarray, " k"]) -> _Rows:
    return _Rows(
        value=rows.value[chosen],
        by=rows.by[chosen],
        warp=rows.warp[chosen],
        noise=rows.noise[chosen],
        tilts=rows.tilts[chosen],
        group=rows.group[chosen],
        step=rows.step[chosen],
        stray=rows.stray[chosen],
    )


def _angles(rows: _Rows, count: int) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Return the angle about the vertical that each nosing asks for by itself, and its noise."""
    of_nosing = rows.group >= 0
    weight = rows.by[of_nosing, 0] ** 2 / rows.noise[of_nosing]
    total = np.bincount(rows.group[of_nosing], weight, count)
    angle = np.bincount(rows.group[of_nosing], weight * rows.value[of_nosing] / rows.by[of_nosing, 0], count) / total
    return angle, 1.0 / total


def _agreeing(values: Float[np.ndarray, " n"], variances: Float[np.ndarray, " n"]) -> Bool[np.ndarray, " n"]:
    """Return which values belong to the largest crowd."""
    if not len(values):
        return np.ones(0, dtype=bool)
    apart = np.abs(values[:, None] - values[None, :])
    crowds = apart < np.maximum(OUTLIER, OUTLIER_SIGMAS * np.sqrt(variances[:, None] + variances[None, :]))
    return np.asarray(crowds[int(np.argmax(crowds.sum(axis=1)))])


def _agreeing_treads(rows: _Rows) -> Bool[np.ndarray, " t"]:
    """Return which treads agree with each other, and gravity."""
    treads = (rows.group < 0) & rows.tilts
    level = rows.value[treads] / rows.by[treads, 1]
    return np.append(_agreeing(level, rows.noise[treads]), True)


def _of_the_stair(rows: _Rows) -> Bool[np.ndarray, " k"]:
    """Return which rows the evidence keeps: the others fit better as anything between the outliers' limits."""
    kept = np.ones(len(rows.value), dtype=np.bool_)
    with np.errstate(divide="ignore"):
        penalty = np.log(2.0 * OUTLIER) - np.log(rows.stray / (1.0 - rows.stray))
    strays(*_equations(rows), COARSE.turns, COARSE.tilts, COARSE.warps, COARSE.logs, penalty, kept)
    return kept


def _solved(rows: _Rows, tried: Prior) -> _Solution:
    """Return the warp's terms, α and ρ with what is not known of stair and camera integrated out."""
    covariance = np.empty((TERMS + 2, TERMS + 2))
    mean, spread = integrated_out(*_equations(rows), tried.turns, tried.tilts, tried.warps, tried.logs, covariance)
    return _Solution(mean=mean, covariance=np.array([[spread[0], spread[2]], [spread[2], spread[1]]]), likeliest=covariance)


def _equations(
    rows: _Rows,
) -> tuple[
    Float[np.ndarray, "k n"],
    Float[np.ndarray, " k"],
    Float[np.ndarray, " k"],
    Float[np.ndarray, " k"],
    Float[np.ndarray, " k"],
    Int[np.ndarray, " k"],
    int,
]:
    """Return what the compiled part takes: coefficients, values, noise, and how each row turns and tilts with which step."""
    turn_by = np.where(rows.group >= 0, rows.by[:, 0], 0.0)
    tilt_by = np.where(rows.tilts, rows.by[:, 1], 0.0)
    return np.column_stack([rows.warp, rows.by]), rows.value, rows.noise, turn_by, tilt_by, rows.step, int(rows.step.max()) + 1


def _planes_against_lines(rows: _Rows, solution: _Solution) -> tuple[float, float] | None:
    """Return by how much risers and nosings differ in α once level and warp are taken out, and the deviation of that."""
    of_line = (rows.group >= 0) & rows.tilts
    of_riser = (rows.group >= 0) & ~rows.tilts
    if not of_line.any() or not of_riser.any():
        return None
    others = np.column_stack([rows.warp, np.zeros(len(rows.value)), rows.by[:, 1]])
    left = rows.value - others @ solution.mean
    tilting = np.where(rows.tilts, rows.by[:, 1] * TILT_BELIEVED, 0.0)
    variance = rows.noise + np.einsum("ki,ij,kj->k", others, solution.likeliest, others) + tilting**2
    means, variances = [], []
    for chosen in (of_riser, of_line):
        by = rows.by[chosen, 0]
        weight = by**2 / variance[chosen]
        total = float(weight.sum())
        means.append(float((left[chosen] / by * weight).sum()) / total)
        variances.append(1.0 / total)
    return means[0] - means[1], float(np.sqrt(sum(variances)))
