"""How the camera really sits on the chair, learned from a minute of driving on a flight.

``StairAxes | ImuSample | TrackReading -> MountEstimate``. On the flight the belts lie on the nosing plane, so the plane's normal is
the chair's own z axis wherever the chair heads: pitch and roll follow from the camera alone. Gravity, which the treads show to the
camera and the IMU tells the chair, adds the mount's yaw; an IMU that errs by a constant tilt looks the same as long as the chair
keeps one heading, so yaw (and that tilt) come with turns, and are told only once they are known.

The axes must come from frames looked at without gravity (``StairDetector.look(frame)``): a detector that is told gravity through
the mount as believed leans its edges towards it, and the mount would then confirm itself.
"""

import math
from collections import deque
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from treadline.angles import DEG, rotation_of, rotation_x, rotation_y, rotation_z
from treadline.signals import CAMERA_AXES_IN_CHAIR, ImuSample, PinholeCamera, StairAxes, TrackReading

PITCH, ROLL, YAW = 0, 1, 2
TILT = slice(3, 5)
BELTS = slice(5, 7)
TREADS = 7
"""Unknowns: the mount's angles, the IMU's tilt about x_B and y_B, the nosings' normal along x_B and y_B, the treads' slope."""
STEP_RAD = 1e-6
"""For derivatives: far above rounding, far below any curvature."""
BISQUARE = 4.685
"""Tukey's constant: 95 % efficient on normal errors, deaf to what lies further out (in sigma)."""
ITERATIONS = 12
FIRST = 3
"""Iterations that have the whole mount error to go: an outlier is then what lies far from the median."""
DONE_RAD = 1e-7
STANDING_M_S = 0.01
PAIRED_S = 0.05
"""An IMU sample further than this from a frame in time does not belong to it."""
AVERAGED_S = 0.1
"""To either side of a frame, over which the IMU's samples are averaged."""
UNIT = 1e-3
SQUARE = 0.02
"""Cosine of what still counts as square: a degree."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MountConfig:
    """What is believed beforehand, and what a frame must be like to count."""

    camera: PinholeCamera
    """Its calibration, with the mount as it was meant."""
    mount_sigma_rad: float = 5.0 * DEG
    """Of each of the mount's angles."""
    tilt_sigma_rad: float = 0.35 * DEG
    """Of the IMU's constant tilt about each axis: half a degree in all."""
    belts_sigma_rad: float = 0.06 * DEG
    """Of the angle between z_B and the nosing plane's normal that no driving averages out: soft rubber under an uneven load,
    and what the camera's depth does to planes."""
    treads_sigma_rad: float = 0.1 * DEG
    """Of the treads' constant slope: stairs are built to shed water."""
    gravity_sigma_rad: float = 0.05 * DEG
    """Of the IMU's tilt from moment to moment."""
    slope_gate_rad: float = 3.0 * DEG
    """Between the slope seen and the slope felt: beyond it the chair is not on the flight it sees. Half a degree of tilt and a
    nosing 20 mm too high stay inside."""
    least_slope_rad: float = 10.0 * DEG
    rocking_rad_s: float = 5.0 * DEG
    """Pitch and roll rate, mean of 0.2 s, beyond which the chair is mounting, cresting or falling from one nosing to the next."""
    mount_gate_rad: float = 15.0 * DEG
    """Between the normal seen and the one meant: beyond it, it is not the stair's."""
    axis_sigma_rad: float = 3.0 * DEG
    """Axes less sure than this say nothing."""
    block_s: float = 3.0
    """Errors of frames further apart than two blocks are strangers: at 0.2 m/s the chair has passed three nosings."""
    least_blocks: int = 8
    every_s: float = 1.0
    """Between two solutions."""
    memory_frames: int = 1800
    """Three minutes at 10 Hz."""
    yaw_known_rad: float = 0.5 * DEG
    """Yaw is told when its sigma is below this."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MountEstimate:
    """The mount's angles as ``PinholeCamera`` counts them, each with its sigma."""

    t_s: float
    pitch_rad: float
    roll_rad: float
    pitch_sigma_rad: float
    roll_sigma_rad: float
    yaw_rad: float | None
    """None while the chair has not turned enough to tell it from the IMU's tilt."""
    yaw_sigma_rad: float | None
    imu_tilt_rad: tuple[float, float]
    """Rotation about x_B and y_B that takes the IMU's idea of down to the true one."""
    imu_tilt_sigma_rad: tuple[float, float]
    frame_count: int
    """Frames that count."""


def calibrated(camera: PinholeCamera, estimate: MountEstimate) -> PinholeCamera:
    """Return the camera with the mount as estimated; yaw stays as it was while it is unknown."""
    yaw = camera.mount_yaw_rad if estimate.yaw_rad is None else estimate.yaw_rad
    return replace(camera, mount_pitch_rad=estimate.pitch_rad, mount_roll_rad=estimate.roll_rad, mount_yaw_rad=yaw)


class MountCalibrator:
    """Collects frames on the flight, and solves for the mount once a second."""

    def __init__(self, config: MountConfig) -> None:
        self._config = config
        self._felt: deque[tuple[float, Float[np.ndarray, " 3"], Float[np.ndarray, " 3"]]] = deque(maxlen=200)
        self._frames: deque[Float[np.ndarray, " 16"]] = deque(maxlen=config.memory_frames)
        self._standing = False
        self._solved_s = -math.inf
        self._estimate: MountEstimate | None = None
        self.dropped_count = 0

    def step(self, signal: StairAxes | ImuSample | TrackReading) -> MountEstimate | None:
        """Take one signal; return the newest estimate, or None while there is none.

        Belts are asked for one thing: a chair that stands sees the same nosings in every frame, and learns nothing from
        repeating it. Without a ``TrackReading`` it is taken to drive.
        """
        match signal:
            case ImuSample():
                self._update(signal)
            case TrackReading():
                self._standing = max(abs(signal.left_m_s), abs(signal.right_m_s)) < STANDING_M_S
            case StairAxes():
                self._see(signal)
        return self._estimate

    def _update(self, sample: ImuSample) -> None:
        finite = np.isfinite(sample.orientation).all() and np.isfinite(sample.angular_velocity_rad_s).all()
        newer = not self._felt or sample.t_s > self._felt[-1][0]
        length = float(np.linalg.norm(sample.orientation))
        if not (finite and math.isfinite(sample.t_s) and newer and abs(length - 1.0) < UNIT):
            return
        self._felt.append((sample.t_s, -rotation_of(sample.orientation / length)[2], sample.angular_velocity_rad_s))

    def _see(self, axes: StairAxes) -> None:
        gravity_B = self._gravity_at(axes.t_s)
        newer = not self._frames or axes.t_s > self._frames[-1][0]
        if (
            self._standing
            or gravity_B is None
            or not (newer and _is_frame(axes, self._config) and self._on_flight(axes, gravity_B))
        ):
            self.dropped_count += 1
            return
        sigmas = (axes.edge_sigma_rad, axes.down_sigma_rad, axes.normal_sigma_rad)
        self._frames.append(np.array([axes.t_s, *axes.edge_C, *axes.down_C, *axes.normal_C, *gravity_B, *sigmas]))
        if axes.t_s - self._solved_s >= self._config.every_s:
            self._solved_s = axes.t_s
            self._estimate = solve_mount(np.array(self._frames), self._config)

    def _gravity_at(self, t_s: float) -> Float[np.ndarray, " 3"] | None:
        """Return down in B when a frame was taken; None if the IMU does not know, or the chair was rocking."""
        if not math.isfinite(t_s):
            return None
        near = [(abs(felt[0] - t_s), felt[1], felt[2]) for felt in self._felt if abs(felt[0] - t_s) <= AVERAGED_S]
        if not near or min(near, key=lambda felt: felt[0])[0] > PAIRED_S:
            return None
        rates = np.array([rate for _, _, rate in near])
        if np.linalg.norm(rates[:, :2].mean(axis=0)) > self._config.rocking_rad_s:
            return None
        down = np.array([gravity for _, gravity, _ in near]).mean(axis=0)
        return np.asarray(down / np.linalg.norm(down))

    def _on_flight(self, axes: StairAxes, gravity_B: Float[np.ndarray, " 3"]) -> bool:
        """Say whether the chair lies on the stair that it sees; whatever the mount, both slopes then agree."""
        config = self._config
        seen = math.acos(_cosine(-float(axes.normal_C @ axes.down_C)))
        felt = math.acos(_cosine(-float(gravity_B[2])))
        meant = math.acos(_cosine(float((config.camera.R_BC @ axes.normal_C)[2])))
        return abs(seen - felt) <= config.slope_gate_rad and seen >= config.least_slope_rad and meant <= config.mount_gate_rad


def solve_mount(frames: Float[np.ndarray, "k 16"], config: MountConfig) -> MountEstimate | None:
    """Return the mount that explains the frames best, or None if they are too few.

    Gauss–Newton on four residuals a frame, weighed by Tukey's bisquare over their own spread. Sigma comes from the scores of whole
    blocks of time, so that errors which neighbours share count as they are, plus the constants that no block can show.

    Args:
        frames: A row each: time, edge, down and normal in C, down in B, sigma of edge, down and normal.
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
    # Neighbouring blocks share what happened at their border. The unknowns fitted take five blocks' worth of freedom, and a spread
    # told by few is itself unsure: the variance of Student's law with two thirds of the rest as degrees of freedom.
    shared = scores[1:].T @ scores[:-1]
    freedom = max((count - 5.0) / 1.5, 3.0)
    spread = (scores.T @ scores + shared + shared.T) * (count / (count - 5.0)) * (freedom / (freedom - 2.0)) + prior
    P = np.linalg.solve(H, np.linalg.solve(H, spread).T)
    sigma = np.sqrt(np.maximum(np.diag(P), np.diag(np.linalg.inv(H))))
    told = bool(sigma[YAW] <= config.yaw_known_rad)
    return MountEstimate(
        t_s=float(frames[-1, 0]),
        pitch_rad=float(x[PITCH]),
        roll_rad=float(x[ROLL]),
        pitch_sigma_rad=float(sigma[PITCH]),
        roll_sigma_rad=float(sigma[ROLL]),
        yaw_rad=float(x[YAW]) if told else None,
        yaw_sigma_rad=float(sigma[YAW]) if told else None,
        imu_tilt_rad=(float(x[TILT][0]), float(x[TILT][1])),
        imu_tilt_sigma_rad=(float(sigma[TILT][0]), float(sigma[TILT][1])),
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
    """Return what the unknowns leave unexplained [rad].

    The normal against z_B, about the edge and across it; the edge against the level; the treads' down against the IMU's.
    """
    R_BC = rotation_z(x[YAW]) @ rotation_y(x[PITCH]) @ rotation_x(x[ROLL]) @ CAMERA_AXES_IN_CHAIR
    edge, down, normal = (frames[:, at : at + 3] @ R_BC.T for at in (1, 4, 7))
    gravity = frames[:, 10:13]
    gravity = gravity + np.cross(np.array([x[TILT][0], x[TILT][1], 0.0]), gravity)
    level = edge[:, :2] / np.linalg.norm(edge[:, :2], axis=1, keepdims=True)
    off = normal[:, :2] - x[BELTS]
    return np.column_stack(
        [
            off[:, 1] * level[:, 0] - off[:, 0] * level[:, 1],
            off[:, 0] * level[:, 0] + off[:, 1] * level[:, 1],
            np.einsum("ki,ki->k", edge, gravity),
            np.einsum("ki,ki->k", edge, np.cross(down, gravity)) - x[TREADS],
        ]
    )


def _jacobian(x: Float[np.ndarray, " 8"], frames: Float[np.ndarray, "k 16"]) -> Float[np.ndarray, "k 4 8"]:
    steps = STEP_RAD * np.eye(x.size)
    return np.stack([(_residuals(x + step, frames) - _residuals(x - step, frames)) / (2.0 * STEP_RAD) for step in steps], axis=2)


def _sigmas(frames: Float[np.ndarray, "k 16"], config: MountConfig) -> Float[np.ndarray, "k 4"]:
    edge, down, normal = frames[:, 13:16].T
    # The edge's error out of the plane is not told: taken for as large as that in it, so any direction has the same.
    return np.column_stack(
        [normal, edge, np.hypot(edge, config.gravity_sigma_rad), np.hypot(down, config.gravity_sigma_rad)],
    )


def _bisquare(residuals: Float[np.ndarray, "k 4"]) -> Float[np.ndarray, "k 4"]:
    return np.square(np.maximum(1.0 - np.square(residuals / BISQUARE), 0.0))


def _is_frame(axes: StairAxes, config: MountConfig) -> bool:
    """Say whether the axes are three unit vectors with an edge square to both others, and sure enough to count."""
    vectors = np.stack([axes.edge_C, axes.down_C, axes.normal_C])
    sigmas = (axes.edge_sigma_rad, axes.down_sigma_rad, axes.normal_sigma_rad)
    if not (np.isfinite(vectors).all() and all(0.0 < sigma <= config.axis_sigma_rad for sigma in sigmas)):
        return False
    products = vectors @ vectors.T
    flags: Bool[np.ndarray, " 5"] = np.abs([*(np.diag(products) - 1.0), products[0, 1], products[0, 2]]) < SQUARE
    return bool(flags.all())


def _cosine(value: float) -> float:
    return min(max(value, -1.0), 1.0)
