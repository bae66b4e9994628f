"""One edge direction from all treads, risers and nosings in view, and how sure it is.

Every tread, every riser and every plane through a nosing and the camera's centre holds the edges' direction e, so each
normal n says n·e = 0. Two small angles are sought: ρ, by which the edges are off level, which treads and gravity tell, and
α about the vertical, which risers and nosings tell. Two things disturb what each says: the sensor's noise, which residuals
show, and the stair itself, whose treads and nosings are not quite parallel. How irregular a stair is, nobody knows
beforehand: it is averaged over, weighted by how well it explains how much the surfaces disagree (a random-effects model).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from treadline.angles import DEG
from treadline.perception.lines import Line
from treadline.perception.nosings import Nosing
from treadline.perception.planes import Surface
from treadline.perception.vectors import cross

TURNS = np.geomspace(0.003 * DEG, 2.0 * DEG, 18)
"""Irregularities of a stair that are thought possible, each step as likely as the next: spread of its surfaces' angles."""
OUTLIER = 3.0 * DEG
"""A surface this far from the middle of three or more, and by many of its deviations, is no part of the stair."""
OUTLIER_SIGMAS = 5.0
GRAVITY_DOUBT, AGREED_SHARE = 2.0, 0.5
"""Declared deviations off which treads have the IMU doubted, if they agree within such a share of that."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EdgeFit:
    """The edges' direction in C."""

    edge: Float[np.ndarray, " 3"]
    """Unit vector."""
    ahead: Float[np.ndarray, " 3"]
    """Unit vector square to the edges, level: a turn of the edges about the vertical moves them along it."""
    down: Float[np.ndarray, " 3"]
    alpha_sigma_rad: float
    """Of the edges' angle about the vertical, with ρ as it is."""
    rho_sigma_rad: float
    """Of the angle by which they are off level."""
    alpha_per_rho: float
    """How a wrong ρ turns α: nosings are seen from above."""
    scatter_rad: float
    """Of the nosings' angles about the edges' direction, RMS."""
    planes_against_lines_rad: tuple[float, float] | None
    """Difference of α between risers and nosings, and its standard deviation; None unless there are both."""

    def sigma_of(self, change: Float[np.ndarray, " 3"]) -> float:
        """Return the standard deviation of a quantity that changes by ``change · de`` with the direction."""
        alpha = float(change @ self.ahead)
        rho = float(change @ self.down) + alpha * self.alpha_per_rho
        return float(np.hypot(alpha * self.alpha_sigma_rad, rho * self.rho_sigma_rad))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Pooled:
    mean: float
    sigma: float
    spread: float
    """Irregularity that was found, RMS."""
    weights: Float[np.ndarray, " k"]


def pooled(values: Float[np.ndarray, " k"], variances: Float[np.ndarray, " k"], regular: Bool[np.ndarray, " k"]) -> _Pooled:
    """Return the common angle of some measurements that scatter by their noise and by an unknown irregularity.

    The irregularity is integrated out over ``TURNS`` with its likelihood; the mean under each value of it is the usual
    weighted one (DerSimonian, Laird 1986 with a prior in place of their estimate).

    Args:
        regular: Measurements that do not suffer from the irregularity: gravity.
    """
    spread = variances[None, :] + np.where(regular, 0.0, 1.0)[None, :] * TURNS[:, None] ** 2
    precision = 1.0 / spread
    total = precision.sum(axis=1)
    means = precision @ values / total
    misfit = (precision * (values[None, :] - means[:, None]) ** 2).sum(axis=1)
    log = -0.5 * (np.log(spread).sum(axis=1) + np.log(total) + misfit)
    belief = np.exp(log - log.max())
    belief /= belief.sum()
    mean = float(belief @ means)
    variance = float(belief @ (1.0 / total + (means - mean) ** 2))
    return _Pooled(
        mean=mean,
        sigma=float(np.sqrt(variance)),
        spread=float(np.sqrt(belief @ TURNS**2)),
        weights=belief @ (precision / total[:, None]),
    )


def gravity_variance(tilts: Float[np.ndarray, " k"], sigma_rad: float) -> float:
    """Return the variance of the IMU's idea of level, given by how much treads are off it.

    Treads that agree with each other and not with the IMU tell of a mount that is not what the calibration says: degrees
    where half of one is declared.

    Args:
        tilts: Angles of the treads about one axis against the IMU's level.
        sigma_rad: Declared.
    """
    if len(tilts) >= 2:
        gap = abs(float(np.median(tilts)))
        if gap > GRAVITY_DOUBT * sigma_rad and float(np.ptp(tilts)) < AGREED_SHARE * gap:
            return gap**2
    return sigma_rad**2


def fit_edges(
    nosings: Sequence[Nosing],
    treads: Sequence[Surface],
    down: Float[np.ndarray, " 3"],
    down_sigma_rad: float,
    start: Float[np.ndarray, " 3"],
) -> EdgeFit:
    """Return the direction at right angles to all normals.

    Args:
        nosings: At least one, with a riser or a line.
        down: Unit vector in C. Edges are level: gravity is one more tread, as good as what tells it.
        start: Edge direction to start from.
    """
    edge = start / np.linalg.norm(start)
    nosings = [nosing for nosing in nosings if nosing.tells]
    for _ in range(3):
        d = down - (down @ edge) * edge
        d = d / np.linalg.norm(d)
        a = cross(d, edge)
        # The turn ρ about a tips e along d.
        level = [_said(tread.unit, tread.covariance / float(tread.normal @ tread.normal), edge, d) for tread in treads]
        off = -float(down @ edge)
        tilts = np.array([value for value, _ in level]) - off
        level.append((off, gravity_variance(tilts, down_sigma_rad)))
        values, variances = np.array(level).T
        regular = np.zeros(len(values), dtype=bool)
        regular[-1] = True
        kept = _agreeing(values, variances) | regular
        rho = pooled(values[kept], variances[kept], regular[kept])
        tipped = edge + rho.mean * d
        said = [_of_nosing(nosing, tipped, a, d, rho.spread) for nosing in nosings]
        angles, noise, per_rho = (np.array(column) for column in zip(*said, strict=True))
        kept = _agreeing(angles, noise)
        alpha = pooled(angles[kept], noise[kept], np.zeros(int(kept.sum()), dtype=bool))
        edge = tipped + alpha.mean * a
        edge /= np.linalg.norm(edge)
    return EdgeFit(
        edge=edge,
        ahead=a,
        down=d,
        alpha_sigma_rad=alpha.sigma,
        rho_sigma_rad=rho.sigma,
        alpha_per_rho=float(alpha.weights @ per_rho[kept]),
        scatter_rad=float(np.sqrt(np.mean((angles[kept] - alpha.mean) ** 2))),
        planes_against_lines_rad=_planes_against_lines(nosings, edge, a, d, rho.spread),
    )


def _said(
    n: Float[np.ndarray, " 3"], covariance: Float[np.ndarray, "3 3"], edge: Float[np.ndarray, " 3"], way: Float[np.ndarray, " 3"]
) -> tuple[float, float]:
    """Return the angle along ``way`` that a normal asks for, and its variance: n·(e + angle · way) = 0."""
    lever = float(n @ way)
    return -float(n @ edge) / lever, float(edge @ covariance @ edge) / lever**2


def _agreeing(values: Float[np.ndarray, " k"], variances: Float[np.ndarray, " k"]) -> Bool[np.ndarray, " k"]:
    if len(values) < 3:
        return np.ones(len(values), dtype=bool)
    off = np.abs(values - np.median(values))
    return off < np.maximum(OUTLIER, OUTLIER_SIGMAS * np.sqrt(variances))


def _of_line(
    line: Line,
    edge: Float[np.ndarray, " 3"],
    ahead: Float[np.ndarray, " 3"],
    down: Float[np.ndarray, " 3"],
    tilt_rad: float,
) -> tuple[float, float, float]:
    """Return the angle that a line asks for, its variance, and how it changes with ρ.

    Seen from above at a slant, an edge that is off level by itself, as its tread is, looks turned.
    """
    angle, variance = _said(line.normal, line.covariance, edge, ahead)
    per_rho = -float(line.normal @ down) / float(line.normal @ ahead)
    return angle, variance + (per_rho * tilt_rad) ** 2, per_rho


def _of_nosing(
    nosing: Nosing,
    edge: Float[np.ndarray, " 3"],
    ahead: Float[np.ndarray, " 3"],
    down: Float[np.ndarray, " 3"],
    tilt_rad: float,
) -> tuple[float, float, float]:
    """Return the angle one nosing asks for, its noise, and how it changes with ρ: riser and line turn together."""
    angles = [_of_line(line, edge, ahead, down, tilt_rad) for line in nosing.lines]
    if nosing.riser is not None:
        n = nosing.riser.unit
        said = _said(n, nosing.riser.covariance / float(nosing.riser.normal @ nosing.riser.normal), edge, ahead)
        angles.append((*said, -float(n @ down) / float(n @ ahead)))
    precision = np.array([1.0 / variance for _, variance, _ in angles])
    share = precision / precision.sum()
    angle = float(share @ [angle for angle, _, _ in angles])
    return angle, float(1.0 / precision.sum()), float(share @ [per_rho for _, _, per_rho in angles])


def _planes_against_lines(
    nosings: Sequence[Nosing],
    edge: Float[np.ndarray, " 3"],
    ahead: Float[np.ndarray, " 3"],
    down: Float[np.ndarray, " 3"],
    tilt_rad: float,
) -> tuple[float, float] | None:
    """Return by how much risers and nosings differ in α, and the standard deviation of that."""
    risers = [nosing.riser for nosing in nosings if nosing.riser is not None]
    planes = [_said(riser.unit, riser.covariance / float(riser.normal @ riser.normal), edge, ahead) for riser in risers]
    lines = [_of_line(line, edge, ahead, down, tilt_rad)[:2] for nosing in nosings for line in nosing.lines]
    if not planes or not lines:
        return None
    means = []
    for said in (planes, lines):
        values, variances = np.array(said).T
        means.append(pooled(values, variances, np.zeros(len(values), dtype=bool)))
    return means[0].mean - means[1].mean, float(np.hypot(means[0].sigma, means[1].sigma))
