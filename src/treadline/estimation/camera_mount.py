"""Camera mount calibration: the camera's orientation on the chair from a minute of driving on a flight.

``StairAxes | ImuSample | TrackReading -> MountEstimate``. On the flight the belts lie on the nosing plane, so the normal of
the plane is the chair's z axis for any heading: pitch and roll follow from the camera alone. Gravity, measured by the
camera from the treads and by the IMU, adds the mount's yaw. At a constant heading a constant IMU tilt cannot be
distinguished from the mount's yaw; both become observable with turns and are reported only then.

The axes must come from frames processed without gravity (``StairDetector.look(frame)``). With gravity transformed by the
assumed mount, the detector would bias its edges towards the assumption, and the calibration would confirm itself.
"""

import math
from collections import deque
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from treadline.core.angles import DEG
from treadline.core.camera_images import CAMERA_AXES_IN_CHAIR, PinholeCamera, StairAxes
from treadline.core.rotations import Vector3, rotation_of, rotation_x, rotation_y, rotation_z
from treadline.core.signals import ImuSample, TrackReading

STEP_RAD = 1e-6
"""Step of the finite differences [rad]: far above rounding, small against the curvature."""
BISQUARE = 4.685
"""Tukey's bisquare constant [sigma]: 95 % efficient for normal errors, no weight for outliers."""
ITERATIONS = 12
FIRST = 3
"""Number of initial iterations with outliers defined relative to the median, because the mount error is still large."""
DONE_RAD = 1e-7
STANDING_M_S = 0.01
PAIRED_S = 0.05
"""Largest time between a frame and its IMU sample [s]."""
AVERAGED_S = 0.1
"""Half width of the averaging window of IMU samples around a frame [s]."""
UNIT = 1e-3
SQUARE = 0.02
"""Largest cosine between axes that count as perpendicular (one degree)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MountConfig:
    """Priors of the mount calibration and acceptance limits for frames."""

    camera: PinholeCamera
    """Camera calibration with the nominal mount."""
    mount_sigma_rad: float = 5.0 * DEG
    """Prior sigma of each mount angle [rad]."""
    tilt_sigma_rad: float = 0.35 * DEG
    """Prior sigma of the IMU's constant tilt about each axis [rad]: half a degree in all."""
    belts_sigma_rad: float = 0.06 * DEG
    """Sigma of the constant angle between z_B and the nosing plane's normal [rad]: soft rubber under an uneven load, and
    distortion of planes in the depth image; not reduced by averaging."""
    treads_sigma_rad: float = 0.1 * DEG
    """Sigma of the treads' constant slope [rad]: treads are built with a slope for drainage."""
    gravity_sigma_rad: float = 0.05 * DEG
    """Sigma of the IMU's instantaneous tilt [rad]."""
    slope_gate_rad: float = 3.0 * DEG
    """Largest difference between the slope by vision and by the IMU [rad]; beyond it the chair is not on the visible flight. Half a
    degree of tilt and a nosing 20 mm too high stay within the gate."""
    least_slope_rad: float = 10.0 * DEG
    rocking_rad_s: float = 5.0 * DEG
    """Pitch and roll rate, averaged over 0.2 s, above which the chair is mounting, cresting or tipping between nosings [rad/s]."""
    mount_gate_rad: float = 15.0 * DEG
    """Largest angle between the measured and the nominal normal [rad]; beyond it the plane is not the stair's."""
    axis_sigma_rad: float = 3.0 * DEG
    """Largest sigma of an axis that is used [rad]."""
    block_s: float = 3.0
    """Block length for the covariance [s]; errors of frames more than two blocks apart are independent: at 0.2 m/s the chair has
    passed three nosings."""
    least_blocks: int = 8
    every_s: float = 1.0
    """Time between two solutions [s]."""
    memory_frames: int = 1800
    """Largest number of frames kept: three minutes at 10 Hz."""
    yaw_known_rad: float = 0.5 * DEG
    """Largest sigma of the yaw at which the yaw is reported [rad]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MountEstimate:
    """Mount angles in the convention of ``PinholeCamera``, each with its sigma."""

    t_s: float
    pitch_rad: float
    roll_rad: float
    pitch_sigma_rad: float
    roll_sigma_rad: float
    yaw_rad: float | None
    """Mount yaw [rad]; None until turns separate it from the IMU's tilt."""
    yaw_sigma_rad: float | None
    imu_tilt_rad: tuple[float, float]
    """Rotation about x_B and y_B from the IMU's down direction to the true one [rad]."""
    frame_count: int
    """Number of frames with nonzero weight."""


def calibrated(camera: PinholeCamera, estimate: MountEstimate) -> PinholeCamera:
    """Return the camera with the estimated mount; an unknown yaw stays unchanged."""
    yaw = camera.mount_yaw_rad if estimate.yaw_rad is None else estimate.yaw_rad
    return replace(camera, mount_pitch_rad=estimate.pitch_rad, mount_roll_rad=estimate.roll_rad, mount_yaw_rad=yaw)


class MountCalibrator:
    """Collects frames on the flight and solves for the mount once a second."""

    def __init__(self, config: MountConfig) -> None:
        self._config = config
        self._imu_samples: deque[tuple[float, Vector3, Vector3]] = deque(maxlen=200)
        self._frames: deque[Float[np.ndarray, " 16"]] = deque(maxlen=config.memory_frames)
        self._standing = False
        self._solved_s = -math.inf
        self._estimate: MountEstimate | None = None
        self.dropped_count = 0
        self.rejection: str | None = None
        """Reason for which the newest frame was dropped; None if it was kept."""

    def step(self, signal: StairAxes | ImuSample | TrackReading) -> MountEstimate | None:
        """Take one signal; return the latest estimate, or None before the first.

        Belt readings exclude frames of a standing chair, which repeat the same nosings. Without a ``TrackReading`` the chair is
        assumed to move.
        """
        match signal:
            case ImuSample():
                self._update(signal)
            case TrackReading():
                self._standing = max(abs(signal.left_m_s), abs(signal.right_m_s)) < STANDING_M_S
            case StairAxes():
                self._add_frame(signal)
        return self._estimate

    def _update(self, sample: ImuSample) -> None:
        finite = all(map(math.isfinite, (*sample.orientation, *sample.angular_velocity_rad_s)))
        newer = not self._imu_samples or sample.t_s > self._imu_samples[-1][0]
        orientation = np.array(sample.orientation)
        length = float(np.linalg.norm(orientation))
        if not (finite and math.isfinite(sample.t_s) and newer and abs(length - 1.0) < UNIT):
            return
        self._imu_samples.append((sample.t_s, -rotation_of(orientation / length)[2], np.array(sample.angular_velocity_rad_s)))

    def _add_frame(self, axes: StairAxes) -> None:
        gravity_B = self._gravity_at(axes.t_s)
        self.rejection = self._reject_reason(axes, gravity_B)
        if gravity_B is None or self.rejection is not None:
            self.dropped_count += 1
            return
        sigmas = (axes.edge_sigma_rad, axes.down_sigma_rad, axes.normal_sigma_rad)
        self._frames.append(np.array([axes.t_s, *axes.edge_C, *axes.down_C, *axes.normal_C, *gravity_B, *sigmas]))
        if axes.t_s - self._solved_s >= self._config.every_s:
            self._solved_s = axes.t_s
            self._estimate = _solve_mount(np.array(self._frames), self._config)

    def _gravity_at(self, t_s: float) -> Vector3 | None:
        """Return the down direction in B at the time of a frame; None without IMU samples or while the chair is rocking."""
        if not math.isfinite(t_s):
            return None
        near = [(abs(sample[0] - t_s), sample[1], sample[2]) for sample in self._imu_samples if abs(sample[0] - t_s) <= AVERAGED_S]
        if not near or min(near, key=lambda sample: sample[0])[0] > PAIRED_S:
            return None
        rates = np.array([rate for _, _, rate in near])
        if np.linalg.norm(rates[:, :2].mean(axis=0)) > self._config.rocking_rad_s:
            return None
        down = np.array([gravity for _, gravity, _ in near]).mean(axis=0)
        return np.asarray(down / np.linalg.norm(down))

    def _reject_reason(self, axes: StairAxes, gravity_B: Vector3 | None) -> str | None:
        """Return why a frame is not used; None if the chair drives on the visible stair, and its directions are known.

        The slopes by vision and IMU agree for any mount.
        """
        config = self._config
        if self._standing:
            return "the chair is at rest"
        if gravity_B is None:
            return f"no IMU attitude within {PAIRED_S:g} s of the frame, or the chair rocks"
        if not _is_frame(axes, config) or (self._frames and axes.t_s <= self._frames[-1][0]):
            return "the stair's directions are too uncertain, or the stamp is not newer"
        seen = math.acos(_cosine(-float(axes.normal_C @ axes.down_C)))
        imu_slope = math.acos(_cosine(-float(gravity_B[2])))
        if math.acos(_cosine(float((config.camera.R_BC @ axes.normal_C)[2]))) > config.mount_gate_rad:
            return f"the nosing plane is more than {config.mount_gate_rad / DEG:.0f}° from its direction with the nominal mount"
        if abs(seen - imu_slope) > config.slope_gate_rad:
            return f"the slope by vision is more than {config.slope_gate_rad / DEG:.0f}° from the IMU's: not on the visible flight"
        return f"the slope is below {config.least_slope_rad / DEG:.0f}°" if seen < config.least_slope_rad else None


def _solve_mount(frames: Float[np.ndarray, "k 16"], config: MountConfig) -> MountEstimate | None:
    """Return the mount with the best fit to the frames, or None for too few frames.

    Gauss–Newton on four residuals per frame, weighted by Tukey's bisquare of their scale. The covariance is estimated from the
    scores of time blocks, which includes the correlation between neighbouring frames, plus the priors of the constants.

    Args:
        frames: One row per frame: time, edge, down and normal in C, down in B, sigma of edge, down and normal.
        config: Priors and limits.
    """
    blocks = np.unique((frames[:, 0] // config.block_s).astype(np.int64), return_inverse=True)[1]
    count = int(blocks.max()) + 1
    if count < config.least_blocks:
        return None
    centre, prior = _prior(config)
    x = centre.copy()
    sigmas = _sigmas(frames, config)
    for iteration in range(ITERATIONS):
        residuals = _residuals(x, frames) / sigmas
        jacobian = _jacobian(x, frames) / sigmas[:, :, None]
        scale = np.maximum(1.4826 * np.median(np.abs(residuals - np.median(residuals, axis=0)), axis=0), 0.1)
        centred = residuals - np.median(residuals, axis=0) if iteration < FIRST else residuals
        weights = _bisquare(centred / scale) / scale**2
        H = np.einsum("kri,kr,krj->ij", jacobian, weights, jacobian) + prior
        step = np.linalg.solve(H, np.einsum("kri,kr,kr->i", jacobian, weights, residuals) + prior @ (x - centre))
        x = x - step
        if iteration > FIRST and np.abs(step).max() < DONE_RAD:
            break
    scores = np.zeros((count, x.size))
    np.add.at(scores, blocks, np.einsum("kri,kr,kr->ki", jacobian, weights, residuals))
    # Neighbouring blocks are correlated at their border. The fitted unknowns remove five blocks of freedom, and the covariance of
    # a few blocks is itself uncertain: variance of Student's distribution with two thirds of the rest as degrees of freedom.
    shared = scores[1:].T @ scores[:-1]
    freedom = max((count - 5.0) / 1.5, 3.0)
    score_covariance = (scores.T @ scores + shared + shared.T) * (count / (count - 5.0)) * (freedom / (freedom - 2.0)) + prior
    P = np.linalg.solve(H, np.linalg.solve(H, score_covariance).T)
    sigma = np.sqrt(np.maximum(np.diag(P), np.diag(np.linalg.inv(H))))
    pitch, roll, yaw, tilt_x, tilt_y, *_ = x.tolist()
    pitch_sigma, roll_sigma, yaw_sigma, *_ = sigma.tolist()
    yaw_known = yaw_sigma <= config.yaw_known_rad
    return MountEstimate(
        t_s=float(frames[-1, 0]),
        pitch_rad=pitch,
        roll_rad=roll,
        pitch_sigma_rad=pitch_sigma,
        roll_sigma_rad=roll_sigma,
        yaw_rad=yaw if yaw_known else None,
        yaw_sigma_rad=yaw_sigma if yaw_known else None,
        imu_tilt_rad=(tilt_x, tilt_y),
        frame_count=int(np.count_nonzero(weights.min(axis=1) > 0.0)),
    )


def _prior(config: MountConfig) -> tuple[Float[np.ndarray, " 8"], Float[np.ndarray, "8 8"]]:
    camera = config.camera
    centre = np.zeros(8)
    centre[:3] = camera.mount_pitch_rad, camera.mount_roll_rad, camera.mount_yaw_rad
    mount, tilt, belts = config.mount_sigma_rad, config.tilt_sigma_rad, config.belts_sigma_rad
    sigma = np.array([mount, mount, mount, tilt, tilt, belts, belts, config.treads_sigma_rad])
    return centre, np.diag(sigma**-2)


def _residuals(x: Float[np.ndarray, " 8"], frames: Float[np.ndarray, "k 16"]) -> Float[np.ndarray, "k 4"]:
    """Return the residuals [rad].

    The unknowns are the mount's pitch, roll and yaw, the IMU's tilt about x_B and y_B, the components of the nosing plane's normal
    along x_B and y_B, and the slope of the treads.

    The normal relative to z_B, about the edge and across it; the edge relative to horizontal; the treads' down direction relative
    to the IMU's.
    """
    pitch, roll, yaw, tilt_x, tilt_y, belts_x, belts_y, treads = x
    R_BC = rotation_z(yaw) @ rotation_y(pitch) @ rotation_x(roll) @ CAMERA_AXES_IN_CHAIR
    edge, down, normal = (frames[:, at : at + 3] @ R_BC.T for at in (1, 4, 7))
    gravity = frames[:, 10:13]
    gravity = gravity + np.cross(np.array([tilt_x, tilt_y, 0.0]), gravity)
    level = edge[:, :2] / np.linalg.norm(edge[:, :2], axis=1, keepdims=True)
    off = normal[:, :2] - np.array([belts_x, belts_y])
    return np.column_stack(
        [
            off[:, 1] * level[:, 0] - off[:, 0] * level[:, 1],
            off[:, 0] * level[:, 0] + off[:, 1] * level[:, 1],
            np.einsum("ki,ki->k", edge, gravity),
            np.einsum("ki,ki->k", edge, np.cross(down, gravity)) - treads,
        ]
    )


def _jacobian(x: Float[np.ndarray, " 8"], frames: Float[np.ndarray, "k 16"]) -> Float[np.ndarray, "k 4 8"]:
    steps = STEP_RAD * np.eye(x.size)
    return np.stack([(_residuals(x + step, frames) - _residuals(x - step, frames)) / (2.0 * STEP_RAD) for step in steps], axis=2)


def _sigmas(frames: Float[np.ndarray, "k 16"], config: MountConfig) -> Float[np.ndarray, "k 4"]:
    edge, down, normal = frames[:, 13:16].T
    # No sigma is given for the edge's error out of the plane; it is assumed equal to the in-plane sigma.
    return np.column_stack(
        [normal, edge, np.hypot(edge, config.gravity_sigma_rad), np.hypot(down, config.gravity_sigma_rad)],
    )


def _bisquare(residuals: Float[np.ndarray, "k 4"]) -> Float[np.ndarray, "k 4"]:
    return np.square(np.maximum(1.0 - np.square(residuals / BISQUARE), 0.0))


def _is_frame(axes: StairAxes, config: MountConfig) -> bool:
    """Whether the axes are unit vectors with the edge perpendicular to both others, and accurate enough."""
    vectors = np.stack([axes.edge_C, axes.down_C, axes.normal_C])
    sigmas = (axes.edge_sigma_rad, axes.down_sigma_rad, axes.normal_sigma_rad)
    if not (np.isfinite(vectors).all() and all(0.0 < sigma <= config.axis_sigma_rad for sigma in sigmas)):
        return False
    products = vectors @ vectors.T
    flags: Bool[np.ndarray, " 5"] = np.abs([*(np.diag(products) - 1.0), products[0, 1], products[0, 2]]) < SQUARE
    return bool(flags.all())


def _cosine(value: float) -> float:
    return min(max(value, -1.0), 1.0)
