"""Edge direction of the stair from all treads, risers and nosings in view, with its uncertainty.

Every tread, every riser and every plane through a nosing and the camera centre contains the edge direction e, so each normal n
satisfies n·e = 0. The unknowns are small angles relative to an initial direction: α, the rotation of the edges about the vertical
at the chair, ρ, their tilt from horizontal, and τ, the turn of a winding flight from one step to the next. Risers determine α,
treads and gravity ρ, nosings seen from above a mixture of both.

The error of a surface has three parts: sensor noise, visible in the residuals; irregularity of the stair, whose steps are not
exactly parallel: riser and nosing of a step rotate together, tread and nosing tilt together; and errors common to all surfaces
(``_nuisance``). All are normal, so that one covariance holds them. The sizes of irregularity and warp are unknown and are
marginalised over a grid, as is whether the flight winds.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from jaxtyping import Bool, Float, Int

from treadline.core.angles import DEG
from treadline.core.camera_images import PinholeCamera
from treadline.core.rotations import Vector3
from treadline.perception._gravity_direction import gravity_variance
from treadline.perception._nuisance import SIZES as WARPS
from treadline.perception._nuisance import posterior_weights, turns_of_lines, turns_of_surfaces
from treadline.perception._nuisance_kernels import normal_equations
from treadline.perception._plane_segmentation import Surface
from treadline.perception._step_parts import Axes, NosingObservation, axes_about

ANGLES = np.geomspace(0.03 * DEG, 1.0 * DEG, 4)
"""Grid of the standard deviations of step irregularity, about the vertical and from horizontal [rad]: 0.5 to 17 mm over a
metre."""
WARPS_PX = np.geomspace(0.01, 0.1, 3)
"""Grid of warp sizes [px of Kinect disparity]: from a good calibration to factory calibration."""
RANGE_SCALE = 6.0
"""Size of a smooth range error relative to a disparity warp: multipath of 20 mm over an image at 1.5 m, instead of 0.1 px."""
FLAT_RAD = 0.5
"""Prior standard deviation of α and ρ [rad]: nearly uninformative."""
WINDING, TURNS_RAD, TURN_SHARE = 0.04, np.array([-9.0, -3.0, -1.0, 1.0, 3.0, 9.0]) * DEG, 1.0 / 3.0
"""Prior probability of a winding flight; means of its turn per step, to the right and to the left [rad], and the standard deviation
of each relative to it: the mixture reaches from 0.4 to 15°, radii of 40 to 1 m."""
TURN_STEPS = np.arange(-15.0, 16.0) * DEG
"""Turns per step with which nosings may agree [rad]."""
STRAY = 0.03
"""Prior probability that a surface or a line does not belong to the stair: an object on a tread tilts it, or has an edge of its
own."""
SAME_STEP_M = 0.03
"""Largest distance between a nosing and the plane of its tread [m]."""
OUTLIER, OUTLIER_SIGMAS = 3.0 * DEG, 5.0
"""Surfaces whose directions differ by more than this angle [rad], and by this number of standard deviations, do not belong to one
flight."""
LEFT_OUT = 0.05
"""Probability below which straight or winding does not enter the moments: its tail would otherwise dominate the variance. A flight
that is straight with less is called winding."""


DETOUR_RAD = 0.35 * DEG
"""Standard deviation of the tilt of all risers by light that takes a detour to a time-of-flight camera, longer at one side [rad]:
5 mm of range over 0.8 m, of 2 to 50 mm in a corner (Fuchs, ICPR 2010)."""
AS_DRAWN = 0.1
"""Prior probability of no irregularity, warp and motion at all: rendered images, new concrete before a well calibrated camera."""


def _grid() -> tuple[Float[np.ndarray, "g 4"], Float[np.ndarray, " g"], Float[np.ndarray, "c 4"]]:
    """Return the sizes of rotation, tilt, warp and motion, the last none at all, their log prior, and a coarser grid of one warp.

    Any logarithm of an irregularity is as likely, and any warp.
    """
    uneven = np.column_stack([sizes.ravel() for sizes in np.meshgrid(ANGLES, ANGLES, WARPS_PX, 1.0, indexing="ij")])
    sizes = np.vstack([uneven, [0.01 * ANGLES[0], 0.01 * ANGLES[0], 0.01 * WARPS_PX[0], 0.0]])
    belief = (1.0 - AS_DRAWN) * uneven[:, 2] / uneven[:, 2].sum()
    coarse = np.isin(uneven[:, :2], ANGLES[::2]).all(axis=1) & (uneven[:, 2] == WARPS_PX[1])
    return sizes, np.log([*belief, AS_DRAWN]), uneven[coarse]


SIZES, LOGS, COARSE = _grid()


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
    widest_rad: float
    """Largest angle about the vertical between a nosing and the edge direction [rad]."""
    winding: float
    """Probability that the flight winds."""
    turn_per_step_rad: float
    """Turn of the edges from one step to the next if the flight winds, positive to the left [rad]."""
    turn_sigma_rad: float
    """Standard deviation of the turn per step if the flight winds [rad]."""
    warp_px: float
    """Root of the mean square of the depth warp's size [px of Kinect disparity]."""
    rotation_rad: float
    """Root of the mean square of the rotation of single steps about the vertical, built or by noise [rad]."""
    agrees: tuple[bool, ...]
    """Whether each nosing has a direction that is consistent with the estimate."""
    directed: int
    """Number of nosings of which a riser or a line is not an outlier."""

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
    tilts: Bool[np.ndarray, " k"]
    """Whether the normal tilts with a tread."""
    group: Int[np.ndarray, " k"]
    """Index of the nosing that rotates with the normal; -1 for none."""
    step: Int[np.ndarray, " k"]
    """Index of the step: that of a nosing, or a separate one for a tread without nosing; -1 for gravity."""
    ahead: Float[np.ndarray, " k"]
    """Number of steps from the chair: the edges of a winding flight turn by as many; 0 for gravity."""

    def only(self, chosen: Bool[np.ndarray, " k"]) -> "_Normals":
        """Return some of the normals."""
        return _Normals(**{field.name: getattr(self, field.name)[chosen] for field in fields(self)})


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Rows:
    """Linear equations ``by · (τ, α, ρ) = value``, one per normal, with the covariance of their errors."""

    normals: _Normals
    value: Float[np.ndarray, " k"]
    by: Float[np.ndarray, "k 3"]
    noise: Float[np.ndarray, " k"]
    """Variance of each normal's angle across the edges [rad²]."""
    shared: Float[np.ndarray, "5 k k"]
    """Covariances of the errors that normals share: rotation and tilt of a step, warp of 1 px, motion, and all others."""


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
        measures_range: Whether the camera is one of time of flight, which exposes all rows at once and sees detours of light.
    """
    has_direction = [nosing.has_direction for nosing in nosings]
    nosings = [nosing for nosing in nosings if nosing.has_direction]
    edge = start / np.linalg.norm(start)
    steps, treads_ahead = _steps_ahead(nosings, treads, camera, axes_about(edge, down).ahead)
    normals = _normals(
        nosings, treads, down, edge, camera, spread_px, np.array([*treads_ahead, *steps, 0.0]), measures_range=measures_range
    )
    for _ in range(2):
        axes = axes_about(edge, down)
        rows = _rows(normals, down_sigma_rad, axes)
        angles, variances = _angles(rows, len(nosings))
        kept = _agreeing_nosings(angles, variances, steps)
        middle = float(np.average(angles[kept], weights=1.0 / variances[kept]))
        edge = axes.right + middle * axes.ahead
        edge /= np.linalg.norm(edge)
    chosen = np.append(kept, True)[normals.group]
    rows = _rows(normals.only(chosen), down_sigma_rad, axes)
    rows = _rows(rows.normals.only(_of_the_stair(rows)), down_sigma_rad, axes)
    agrees = np.zeros(len(has_direction), dtype=np.bool_)
    agrees[has_direction] = kept
    return _fitted(rows, axes, angles, kept, tuple(agrees.tolist()))


def _fitted(
    rows: _Rows, axes: Axes, angles: Float[np.ndarray, " n"], kept: Bool[np.ndarray, " n"], agrees: tuple[bool, ...]
) -> EdgeFit:
    """Return the edge direction with the sizes of irregularity and warp, and whether the flight winds, marginalised."""
    squares = np.column_stack([SIZES**2, np.ones(len(SIZES))])
    logs, products = normal_equations(rows.noise, rows.shared, squares, np.column_stack([rows.by, rows.value]))
    # A straight flight has no turn per step.
    deviations = np.array([1e-9, *TURN_SHARE * np.abs(TURNS_RAD)])
    precisions = np.column_stack([deviations**-2.0, np.full((deviations.size, 2), FLAT_RAD**-2.0)])
    expected = np.array([0.0, *TURNS_RAD])
    covariances = np.linalg.inv(products[:, None, :3, :3] + precisions[:, :, None] * np.eye(3))
    right = products[:, None, :3, 3] + np.outer(expected * precisions[:, 0], [1.0, 0.0, 0.0])
    means = np.einsum("ghij,ghj->ghi", covariances, right)
    gained = np.einsum("ghi,ghi->gh", means, right) + np.linalg.slogdet(covariances)[1]
    gained += np.log(precisions[:, 0]) - expected**2 * precisions[:, 0]
    beliefs = np.log([1.0 - WINDING, *np.full(TURNS_RAD.size, WINDING / TURNS_RAD.size)])
    weights = posterior_weights(logs[:, None] + LOGS[:, None] - 0.5 * products[:, 3, 3, None] + 0.5 * gained + beliefs)
    winding = float(weights[:, 1:].sum())
    turn, turn_variance = _moments(weights[:, 1:], means[:, 1:, :1], covariances[:, 1:, :1, :1])
    entering = weights * [winding < 1.0 - LEFT_OUT, *np.full(TURNS_RAD.size, winding > LEFT_OUT)]
    (alpha, rho), covariance = _moments(entering, means[..., 1:], covariances[..., 1:, 1:])
    edge = axes.right + alpha * axes.ahead - rho * axes.up
    return EdgeFit(
        edge=edge / np.linalg.norm(edge),
        ahead=axes.ahead,
        down=-axes.up,
        covariance=covariance,
        widest_rad=float(np.abs(angles - angles[kept].mean()).max()),
        winding=winding,
        turn_per_step_rad=float(turn[0]),
        turn_sigma_rad=float(np.sqrt(turn_variance[0, 0])),
        warp_px=float(np.sqrt(weights.sum(axis=1) @ squares[:, 2])),
        rotation_rad=float(np.sqrt(weights.sum(axis=1) @ squares[:, 0])),
        agrees=agrees,
        directed=np.unique(rows.normals.group[rows.normals.group >= 0]).size,
    )


def _moments(
    weights: Float[np.ndarray, "g h"], means: Float[np.ndarray, "g h n"], covariances: Float[np.ndarray, "g h n n"]
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n n"]]:
    """Return mean and covariance of a mixture."""
    weights = weights / weights.sum()
    mean = np.einsum("gh,ghi->i", weights, means)
    off = means - mean
    return mean, np.einsum("gh,ghij->ij", weights, covariances + off[..., :, None] * off[..., None, :])


def _steps(nosings: Sequence[NosingObservation], treads: Sequence[Surface]) -> list[int]:
    """Return the step index of each tread: that of its nosing, or a new one."""
    found: list[int] = []
    for tread in treads:
        off = [abs(float(tread.normal @ nosing.point) - 1.0) * tread.distance_m for nosing in nosings]
        nearest = int(np.argmin(off)) if off else 0
        own = bool(off) and off[nearest] < SAME_STEP_M and nearest not in found
        found.append(nearest if own else len(nosings) + len(found))
    return found


def _steps_ahead(
    nosings: Sequence[NosingObservation], treads: Sequence[Surface], camera: PinholeCamera, ahead: Vector3
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " t"]]:
    """Return the number of steps from the chair to each nosing and to each tread."""
    steps, places = np.array([nosing.step for nosing in nosings]), np.array([nosing.ahead_m for nosing in nosings])
    run_m, origin_m = np.ptp(places) / max(np.ptp(steps), 1) or 1.0, float(np.array(camera.mount_m) @ camera.R_BC @ ahead)
    return (places + origin_m) / run_m, (np.array([tread.centre @ ahead for tread in treads]) + origin_m) / run_m


def _normals(
    nosings: Sequence[NosingObservation],
    treads: Sequence[Surface],
    down: Vector3,
    edge: Vector3,
    camera: PinholeCamera,
    spread_px: float,
    steps_ahead: Float[np.ndarray, " s"],
    *,
    measures_range: bool,
) -> _Normals:
    """Return all normals.

    Args:
        steps_ahead: Number of steps from the chair to each tread and to each nosing, and 0.
    """
    risers = [(k, nosing.riser) for k, nosing in enumerate(nosings) if nosing.riser is not None]
    lines = [(k, line) for k, nosing in enumerate(nosings) for line in nosing.lines]
    surfaces = [*treads, *(riser for _, riser in risers)]
    of_lines = turns_of_lines([line for _, line in lines], camera, spread_px)
    turns = np.concatenate([turns_of_surfaces(surfaces, camera), of_lines, np.zeros((1, *of_lines.shape[1:]))])
    if measures_range:
        turns = turns * np.repeat([RANGE_SCALE, 0.0, 1.0], [WARPS.size, turns.shape[2] - WARPS.size - 1, 1])
        turns[len(treads) : len(surfaces), :, -1] = DETOUR_RAD * edge
    group = np.array([*(-1 for _ in treads), *(k for k, _ in risers), *(k for k, _ in lines), -1])
    return _Normals(
        unit=np.array([*(surface.unit for surface in surfaces), *(line.normal for _, line in lines), down]),
        covariance=np.array(
            [*(surface.unit_covariance for surface in surfaces), *(line.covariance for _, line in lines), np.zeros((3, 3))]
        ),
        turns=turns,
        tilts=np.array([*(True for _ in treads), *(False for _ in risers), *(True for _ in lines), False]),
        group=group,
        step=np.array([*_steps(nosings, treads), *group[len(treads) :]]),
        ahead=np.append(steps_ahead[: len(treads)], steps_ahead[len(treads) :][group[len(treads) :]]),
    )


def _rows(normals: _Normals, down_sigma_rad: float, axes: Axes) -> _Rows:
    """Return the equations of all normals, gravity last."""
    value, turned, tilted = (normals.unit @ axis for axis in (-axes.right, axes.ahead, -axes.up))
    noise = np.asarray(normals.covariance @ axes.right @ axes.right)
    levels = (normals.group < 0) & normals.tilts
    noise[-1] = gravity_variance(value[levels] / tilted[levels] - value[-1] / tilted[-1], down_sigma_rad)
    same = (normals.step[:, None] == normals.step) & (normals.step >= 0)
    of_step = (np.where(own, by, 0.0) for own, by in ((normals.group >= 0, turned), (normals.tilts, tilted)))
    common = np.split(axes.right @ normals.turns, [WARPS.size, -1], axis=1)
    return _Rows(
        normals=normals,
        value=value,
        by=np.column_stack([turned * normals.ahead, turned, tilted]),
        noise=noise,
        shared=np.array([*(same * np.outer(by, by) for by in of_step), *(part @ part.T for part in common)]),
    )


def _angles(rows: _Rows, count: int) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Return the angle about the vertical of each single nosing, and its variance."""
    own = rows.normals.group >= 0
    group, by = rows.normals.group[own], rows.by[own, 1]
    weight = by**2 / rows.noise[own]
    total = np.bincount(group, weight, count)
    return np.bincount(group, weight * np.arctan(rows.value[own] / by), count) / total, 1.0 / total


def _agreeing_nosings(
    angles: Float[np.ndarray, " n"], variances: Float[np.ndarray, " n"], steps: Float[np.ndarray, " n"]
) -> Bool[np.ndarray, " n"]:
    """Return the mask of the nosings in the largest subset that agrees; with a turn per step if at least two more do so."""
    straight = _agreeing(angles, variances)
    if np.count_nonzero(straight) > len(angles) - 2:
        return straight
    turned = [_agreeing(angles - turn * steps, variances) for turn in TURN_STEPS]
    most = max(turned, key=np.count_nonzero)
    return most if np.count_nonzero(most) >= np.count_nonzero(straight) + 2 else straight


def _agreeing(values: Float[np.ndarray, " n"], variances: Float[np.ndarray, " n"]) -> Bool[np.ndarray, " n"]:
    """Return the mask of values in the largest consistent subset."""
    if not len(values):
        return np.ones(0, dtype=bool)
    apart = np.abs(values[:, None] - values[None, :])
    crowds = apart < np.maximum(OUTLIER, OUTLIER_SIGMAS * np.sqrt(variances[:, None] + variances[None, :]))
    return np.asarray(crowds[int(np.argmax(crowds.sum(axis=1)))])


def _of_the_stair(rows: _Rows) -> Bool[np.ndarray, " k"]:
    """Return the mask of equations accepted by the evidence; the others fit better as uniform outliers, the clearest first."""
    kept = np.ones(len(rows.value), dtype=np.bool_)
    count = len(COARSE)
    squares = np.column_stack([np.tile(COARSE, (2, 1)), np.ones((2 * count, 2)), np.repeat([0.0, TURNS_RAD[-2]], count)]) ** 2
    beliefs = np.log(np.repeat([1.0 - WINDING, WINDING], count))
    unknowns = FLAT_RAD * rows.by[:, 1:]
    shared = np.concatenate([rows.shared, [unknowns @ unknowns.T, np.outer(rows.by[:, 0], rows.by[:, 0])]])
    loss = np.log(2.0 * OUTLIER * (1.0 - STRAY) / STRAY)
    while kept.sum() > 2:
        some = np.flatnonzero(kept)
        right = np.column_stack([np.eye(some.size), rows.value[some]])
        logs, products = normal_equations(rows.noise[some], shared[:, some][:, :, some], squares, right)
        logs = logs + beliefs - 0.5 * products[:, -1, -1]
        # The density of each value given all others.
        precision = np.einsum("gkk->gk", products)[:, :-1]
        own = 0.5 * (np.log(precision / (2.0 * np.pi)) - products[:, :-1, -1] ** 2 / precision)
        gain = np.logaddexp.reduce(logs[:, None] - own, axis=0) - np.logaddexp.reduce(logs) - loss
        gain[-1] = -np.inf  # gravity stays
        worst = int(gain.argmax())
        if gain[worst] <= 0.0:
            break
        kept[some[worst]] = False
    return kept
