"""Calibration gate: orientation of images, focal length, image size, mount and depth scale, tested before a heading is used.

``StairDetection, PinholeCamera, gravity -> CalibrationEvidence -> CalibrationFault | None``. Floors and treads are horizontal,
walls and risers vertical. With a wrong pinhole model, a plane has the normal Mᵀn, with a matrix M of both models. So a wrong focal
length tilts treads and risers against each other, a wrong mount tilts both alike, and leaning risers or a sloping floor tilt one
kind alone; a floor that slopes does not tilt treads. Each frame adds linear equations of these errors, each hypothesis is a prior
of their sizes, and the summed normal equations give its Bayesian evidence in closed form. A focal length changes the distance of
the floor as well, by up to half as much: 8 % are within the error of a mount measured by hand, 25 % are not. A depth scale leaves
all angles: the camera's height above the floor shows it.

A mirrored image shows its roll with the wrong sign. Frames without roll do not show it, and a roll that is the same in all frames
can be an error of the mount. A focal length shows best at a camera pitch of 45°, and only with treads and risers in view.
"""

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float, Int

from treadline.core.angles import DEG
from treadline.core.arrays import cross
from treadline.core.camera_images import PinholeCamera
from treadline.core.rotations import Rotation, Vector3, rotation_z
from treadline.perception._gravity_direction import BUNDLE, BUNDLE_BLOCKS, MIDDLES, levelled
from treadline.perception._lattice import TREAD_GAP_M, UPRIGHT
from treadline.perception._lattice_kernels import SIGMAS
from treadline.perception._plane_segmentation import PlanarBlocks, planes_of
from treadline.perception.detection import StairDetection, refused

FRAMES = 20
"""Number of frames on which the gate decides: a systematic error of 0.5° outweighs the noise of more."""
RARE = math.log(0.1)
"""Prior log-odds of leaning risers or a sloping floor against an upright building, and of a largest level surface that is another
than the chair's own, anywhere within a factor of e of its height; an assumption: one in ten."""
DECIDED = 3.0
"""Log-odds of a fault against all other hypotheses above which frames are refused [nats]: 20 to 1."""
FACING, RISER_BLOCKS = 0.5, 150
"""Least z of the normal of a vertical block that faces the camera, because focal length and lean do not tilt side walls; and least
number of such blocks, those of a riser 1 m wide at 2 m: the front edges of open treads are blends of planes."""
AGREEMENT, OUTLIERS, SURFACES = 7.0 * DEG, 0.2, 8.0
"""Standard deviation of a block's angle from vertical or horizontal [rad], fraction of blocks on neither, and number of independent
surfaces in a frame, for the orientation of images."""
SURFACE_SIGMA = 0.6 * DEG
"""Standard deviation of the angle between surfaces and gravity in one frame [rad]: on 23 lifelike frames, each with another stair
and camera, the median deviation was 0.4°."""
TOLERATED = np.array([0.01, *np.array([0.5, 0.5, 0.3, 0.3, 0.3, 0.5]) * DEG])
"""Standard deviations of the errors of a sound calibration and a usual building: relative focal length; pitch and roll of the
mount, with those of gravity; slope of level surfaces along x, y and z of C, 1 % of it for drainage; lean of risers [rad]."""
OFF_CENTRE = 0.05
"""Least offset of the principal point from the middle, in image widths, of a calibration of another image size: five times that of
shipped cameras."""
UPRIGHT_LEAST = 0.5
"""Least part of gravity in the image plane by which a turned camera is seen: cameras look at most 60° down."""
LEVEL, HEIGHT_SIGMA_M, HEIGHT_FRAMES = 3.0 * DEG, 0.03, 5
"""Largest angle of a level chair from gravity [rad]; standard deviation of the camera's height above its floor [m], by a mount that
is measured by hand, and 0.5° at 1.5 m; least number of frames, whose median has two outliers to spare."""

Cause = Literal["turned", "mirrored", "focal length", "image size", "mount", "depth scale"]
MIRRORED, RESIZED = 4, 5
"""Transforms of an image after its four quarter turns. At a camera pitch of 45°, treads that are upside down look like risers and
risers like treads; at 40°, like a mount that is 10° off; at 0°, side walls that are turned by 90° look like a floor."""
HYPOTHESES: tuple[tuple[Cause | None, int, dict[int, float]], ...] = (
    (None, 0, {}),
    (None, 0, dict.fromkeys((3, 4, 5), 8.0 * DEG)),
    (None, 0, {6: 8.0 * DEG}),
    ("focal length", 0, {0: 0.25}),
    *(("mount", 0, dict.fromkeys(errors, 5.0 * DEG)) for errors in ((1,), (2,), (1, 2))),
    *(("turned", quarter, {}) for quarter in (1, 2, 3)),
    ("mirrored", MIRRORED, {}),
    ("image size", RESIZED, {0: 0.25}),
)
"""Cause of each hypothesis, transform of the image, and standard deviations that differ from ``TOLERATED``. A sloping floor, as a
ramp of 8°, and leaning risers are no faults."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CalibrationFault:
    """Fault of a calibration."""

    cause: Cause
    text: str
    """Sentence with the figure and the value to set."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CalibrationEvidence:
    """Sums over frames of one camera; the evidence of frames is added."""

    camera: PinholeCamera
    frames: int
    agreement: Float[np.ndarray, " 6"]
    """Log-likelihood of the normals in each transform of the image."""
    quarters: Int[np.ndarray, " 4"]
    """Number of frames by quarter turns of gravity from the mount's."""
    gram: Float[np.ndarray, "6 8 8"]
    """Normal equations of the errors of ``TOLERATED``, with the right side last, in each transform."""
    heights: tuple[Float[np.ndarray, "6 8"], ...]
    """Equation of the camera's height above the largest level surface in each frame and transform; zero without one."""
    below_m: tuple[float, ...]
    """Height of the camera above the floor in each frame that shows it [m]."""

    def __add__(self, other: "CalibrationEvidence") -> "CalibrationEvidence":
        """Return the evidence of all frames."""
        added = ("frames", "agreement", "quarters", "gram", "heights", "below_m")
        return replace(self, **{name: getattr(self, name) + getattr(other, name) for name in added})

    @property
    def fault(self) -> CalibrationFault | None:
        """The fault that is decided; None without one."""
        if self.quarters.argmax():
            return self._turned(int(self.quarters.argmax()))
        lead = self.agreement - self.agreement[[0, MIRRORED, RESIZED]].max()
        lead[[0, MIRRORED, RESIZED]] = 0.0
        # A transform without level surfaces in most frames explains nothing.
        tried = [one for one in HYPOTHESES if one[1] == 0 or self.gram[one[1], 3, 3] > 0.5 * self.frames / SURFACE_SIGMA**2]
        logs, residuals, errors = zip(*(self._posterior(at, wide) for _, at, wide in tried), strict=True)
        logs = np.array(logs) + [lead[at] + RARE * (cause is None and len(wide) > 0) for cause, at, wide in tried]
        found = int(np.argmax(logs))
        # Frames that no hypothesis explains have larger deviations than assumed.
        odds = np.exp((logs - logs[found]) / max(1.0, residuals[found] / (3 * self.frames)))
        cause = tried[found][0]
        others = sum(odd for odd, one in zip(odds, tried, strict=True) if one[0] != cause)
        if cause is None or others > math.exp(-DECIDED):
            return self._depth_scale()
        if cause == "turned":
            return self._turned(tried[found][1])
        return self._fault(cause, self._remedy(cause, *errors[found][:3].tolist()))

    def _posterior(self, at: int, wide: dict[int, float]) -> tuple[float, float, Float[np.ndarray, " 7"]]:
        """Return what ``_posterior`` does, with the height of the largest level surface, which may be another than the floor."""
        other, rows = _posterior(self.gram[at], wide), [frame[at] for frame in self.heights if frame[at].any()]
        if not rows:
            return other
        row = np.median(rows, axis=0)  # systematic: more frames do not measure the mount any better
        log, residual, errors = _posterior(self.gram[at] + np.outer(row, row), wide)
        as_floor = log + math.log(self.camera.mount_m[2] / (math.sqrt(2.0 * math.pi) * HEIGHT_SIGMA_M))
        as_other = other[0] + RARE
        best = (residual, errors) if as_floor > as_other else other[1:]
        return float(np.logaddexp(as_floor, as_other)), *best

    def _turned(self, quarter: int) -> CalibrationFault:
        roll_deg = self.camera.mount_roll_rad / DEG
        remedy = f"set mount_roll_deg to {(roll_deg - 90.0 * quarter + 180.0) % 360.0 - 180.0:.0f} (is {roll_deg:.0f})"
        return self._fault("turned", f"images are turned clockwise by {90 * quarter}° from gravity; turn them back, or {remedy}")

    def _fault(self, cause: Cause, text: str) -> CalibrationFault:
        return CalibrationFault(cause=cause, text=f"{text}: {self.frames} frame{'s' * (self.frames > 1)}")

    def _remedy(self, cause: Cause, longer: float, pitch_rad: float, roll_rad: float) -> str:
        camera = self.camera
        if cause == "mirrored":
            return "images are mirrored: floor and risers roll against gravity; exchange left and right"
        if cause == "mount":
            pitch_deg, roll_deg = camera.mount_pitch_rad / DEG, camera.mount_roll_rad / DEG
            return (
                f"treads and risers are pitched by {pitch_rad / DEG:+.1f}° and rolled by {roll_rad / DEG:+.1f}° from gravity; set "
                f"mount_pitch_deg to {pitch_deg + pitch_rad / DEG:.1f} (is {pitch_deg:.1f}) and mount_roll_deg to "
                f"{roll_deg + roll_rad / DEG:.1f} (is {roll_deg:.1f}), or correct gravity"
            )
        resized = _transforms(camera)[RESIZED, 0, 0] if cause == "image size" else 1.0
        fx, fy = (resized * focal / math.exp(longer) for focal in (camera.fx_px, camera.fy_px))
        text = f"focal length {abs(camera.fx_px / fx - 1.0):.0%} too {'long' if fx < camera.fx_px else 'short'}; "
        if cause == "image size":
            cx, cy = 0.5 * (camera.width_px - 1), 0.5 * (camera.height_px - 1)
            text = f"calibration of another image size; set cx to {cx} (is {camera.cx_px:g}), cy to {cy} (is {camera.cy_px:g}), "
        return f"{text}set fx to {fx:.0f} (is {camera.fx_px:.0f}) and fy to {fy:.0f} (is {camera.fy_px:.0f})"

    def _depth_scale(self) -> CalibrationFault | None:
        if len(self.below_m) < HEIGHT_FRAMES:
            return None
        below_m, height_m = float(np.median(self.below_m)), self.camera.mount_m[2]
        if abs(below_m - height_m) < SIGMAS * HEIGHT_SIGMA_M:
            return None
        scale = f"multiply the depth scale (depth_unit_m) by {height_m / below_m:.2f}"
        return self._fault("depth scale", f"the floor is {below_m:.2f} m below the camera, mount_m says {height_m:.2f}; {scale}")


def calibration_evidence(sight: StairDetection, camera: PinholeCamera, gravity_C: Vector3 | None) -> CalibrationEvidence | None:
    """Return the evidence of one frame, accepted or not; None without planar blocks or gravity."""
    if gravity_C is None or sight.blocks is None or not 0.0 < float(np.linalg.norm(gravity_C)) < math.inf:
        return None
    down = gravity_C / np.linalg.norm(gravity_C)
    few = sight.blocks.unit[:: max(1, len(sight.blocks.unit) // MIDDLES)]
    turned = few @ _transforms(camera)
    squares = np.square(turned @ down) / np.einsum("tbi,tbi->tb", turned, turned)
    off = np.minimum(squares, 1.0 - squares) / AGREEMENT**2
    agreement = np.log((1.0 - OUTLIERS) * np.exp(-0.5 * off) + OUTLIERS).mean(axis=1)
    quarters, gram, heights, level_C = np.zeros(4, np.int64), np.zeros((6, 8, 8)), np.zeros((6, 8)), -camera.R_BC[2]
    if min(math.hypot(*down[:2]), math.hypot(*level_C[:2])) >= UPRIGHT_LEAST:
        turned = math.atan2(down[1], down[0]) - math.atan2(level_C[1], level_C[0])
        quarters[round(turned / (0.5 * math.pi)) % 4] = 1
    unmirrored = [0, *(quarter for quarter in (1, 2, 3) if agreement[quarter] > agreement[0])]
    off_px = math.hypot(camera.width_px - 1 - 2.0 * camera.cx_px, camera.height_px - 1 - 2.0 * camera.cy_px)
    tried = [*unmirrored, MIRRORED, *([RESIZED] if off_px > 2.0 * OFF_CENTRE * camera.width_px else [])]
    for at in tried:
        gram[at], heights[at] = _equations(sight.blocks, _transforms(camera)[at], camera, down)
    # The slope of level surfaces and the lean of risers: errors that only one kind of surface shows.
    kinds = np.count_nonzero(gram[:, [3, 6], [3, 6]], axis=1)
    # Surfaces of a kind that one transform makes level or vertical and another does not are far off in the other.
    gram[tried, 7, 7] += (kinds[tried] < kinds[unmirrored].max()) * (UPRIGHT / SURFACE_SIGMA) ** 2
    below_m = _below_m(sight, camera, float(level_C @ down))
    return CalibrationEvidence(
        camera=camera,
        frames=1,
        agreement=SURFACES * agreement,
        quarters=quarters,
        gram=gram,
        heights=(heights,),
        below_m=below_m,
    )


def gated(sight: StairDetection, evidence: CalibrationEvidence | None) -> StairDetection:
    """Return the detection, refused where its calibration has a fault."""
    fault = None if evidence is None else evidence.fault
    return sight if fault is None else refused(fault.text)


@lru_cache(maxsize=8)
def _transforms(camera: PinholeCamera) -> Float[np.ndarray, "6 3 3"]:
    """Return the matrices M of images turned clockwise by quarter turns, mirrored, and of another size than the calibration's."""
    found = np.stack([rotation_z(0.5 * math.pi * quarter) for quarter in range(4)] + 2 * [np.eye(3)])
    fx, fy, cx, cy = camera.pinhole
    off = np.array([(camera.width_px - 1 - 2.0 * cx) / fx, (camera.height_px - 1 - 2.0 * cy) / fy])
    found[MIRRORED, 0] = -1.0, 0.0, off[0]
    found[RESIZED, :2] *= camera.height_px / (2.0 * cy + 1.0)
    found[RESIZED, :2, 2] = 0.5 * off
    return found


def _equations(
    blocks: PlanarBlocks, M: Rotation, camera: PinholeCamera, down: Vector3
) -> tuple[Float[np.ndarray, "8 8"], Float[np.ndarray, " 8"]]:
    """Return the normal equations of the surfaces in a frame, and the equation of its height above the largest level surface.

    Surfaces are the largest level one, all other level ones, and the vertical ones that face the camera.

    Args:
        M: Transform of the image.
    """
    lateral_C = camera.R_BC.T @ [-math.sin(camera.mount_yaw_rad), math.cos(camera.mount_yaw_rad), 0.0]
    tilts = np.stack([cross(down, lateral_C), cross(down, np.array([0.0, 0.0, 1.0]))])
    rows, height, unit = np.zeros((7, 8)), np.zeros(8), blocks.unit @ M
    unit /= np.sqrt(np.einsum("bi,bi->b", unit, unit))[:, None]
    lengthened = down * [1.0, 1.0, 0.0] - float(down[:2] @ down[:2]) * down
    level, leans = levelled(down, unit[:: max(1, len(unit) // (3 * MIDDLES))], UPRIGHT), unit @ down
    if level is not down:
        normals, counts = _planes(blocks, np.abs(unit @ level) > math.cos(BUNDLE), M, level)
        largest = counts == counts.max(initial=0)
        for own, is_floor in ((largest, 1.0), (~largest, 0.0)):
            if own.any():
                at = slice(0, 3) if is_floor else slice(3, 6)
                normal = _mean(normals[own], counts[own])
                rows[at, 0], rows[at, 1:3], rows[at, 3:6], rows[at, 7] = lengthened, tilts.T, is_floor * np.eye(3), normal - down
        if largest.any() and float(normals[largest][0] @ -camera.R_BC[2]) > 0.0 and camera.mount_m[2] > 0.0:
            distance_m = 1.0 / float(np.linalg.norm(normals[largest][0]))
            height[[0, 7]] = -float(down[:2] @ down[:2]), math.log(distance_m / camera.mount_m[2])
            height *= camera.mount_m[2] / HEIGHT_SIGMA_M
    facing = (np.abs(leans) < math.sin(UPRIGHT)) & (np.abs(unit[:, 2]) > FACING)
    if int(np.count_nonzero(facing)) >= RISER_BLOCKS:
        n, sigma_rad = _facing_normal(unit[facing], leans[facing], blocks.turns[facing])
        rows[6, 0], rows[6, 1:3], rows[6, 6:] = -n[2] * down[2], -tilts @ n, (1.0, float(n @ down))
        rows[6] *= SURFACE_SIGMA / math.hypot(SURFACE_SIGMA, sigma_rad)
    return np.asarray(rows.T @ rows / SURFACE_SIGMA**2), height


def _planes(
    blocks: PlanarBlocks, chosen: Bool[np.ndarray, " b"], M: Rotation, direction: Vector3
) -> tuple[Float[np.ndarray, "p 3"], Int[np.ndarray, " p"]]:
    """Return the planes among blocks of a transformed image, as n with n·p = 1, and their numbers of blocks.

    The mean of noisy normals would be biased.
    """
    along = np.linalg.inv(M).T @ direction
    planes, counts = planes_of(blocks, np.flatnonzero(chosen), along / np.linalg.norm(along), TREAD_GAP_M, BUNDLE_BLOCKS)
    return planes @ M, counts


def _mean(normals: Float[np.ndarray, "p 3"], counts: Int[np.ndarray, " p"]) -> Vector3:
    """Return the mean unit normal of planes, weighted by their numbers of blocks."""
    mean = (counts / np.linalg.norm(normals, axis=1)) @ normals
    return np.asarray(mean / np.linalg.norm(mean))


def _facing_normal(
    unit: Float[np.ndarray, "k 3"], leans: Float[np.ndarray, " k"], turns: Float[np.ndarray, " k"]
) -> tuple[Vector3, float]:
    """Return the mean normal of vertical blocks by precision, near their median lean, and its standard deviation [rad].

    Blocks over the edge of a tread lean towards its normal. Blocks overlap by half of their width and height.
    """
    order, weights = np.argsort(leans), 1.0 / (turns**2 + SURFACE_SIGMA**2)
    middle = leans[order][np.searchsorted(np.cumsum(weights[order]), 0.5 * weights.sum())]
    weights = np.where(np.abs(leans - middle) < BUNDLE, weights, 0.0) / weights.sum()
    mean = weights @ unit
    mean /= np.linalg.norm(mean)
    return mean, 2.0 * math.sqrt(float(weights**2 @ np.square(leans - middle)))


def _posterior(gram: Float[np.ndarray, "8 8"], wide: dict[int, float]) -> tuple[float, float, Float[np.ndarray, " 7"]]:
    """Return the log-evidence of a hypothesis, its least residual (χ² with the prior's) and the mean errors."""
    sigmas = TOLERATED.copy()
    sigmas[list(wide)] = list(wide.values())
    # In units of the prior's standard deviations.
    information = np.eye(7) + sigmas[:, None] * gram[:7, :7] * sigmas
    errors = np.linalg.solve(information, sigmas * gram[:7, 7])
    residual = float(gram[7, 7] - (sigmas * gram[:7, 7]) @ errors)
    return -0.5 * (residual + float(np.linalg.slogdet(information)[1])), residual, sigmas * errors


def _below_m(sight: StairDetection, camera: PinholeCamera, levelness: float) -> tuple[float, ...]:
    """Return the height of a level chair's camera above the floor before a flight that rises; nothing without one."""
    if sight.axes is None or sight.shape is None or sight.shape.direction != "up" or not sight.treads:
        return ()
    if levelness < math.cos(LEVEL) or camera.mount_m[2] <= 0.0:
        return ()
    below_m, height_m = max(float(tread.centre @ sight.axes.down_C) for tread in sight.treads), camera.mount_m[2]
    # The floor itself may be hidden below the camera: then it is whole rises below the lowest tread in view.
    return (below_m + max(0, round((height_m - below_m) / sight.shape.rise_m)) * sight.shape.rise_m,)
