"""Kalman filter of the nosings of one flight and of the odometry's error. ``places by odometry -> places, position, covariance``.

State: error of the odometry's position, place (x, z) of each nosing, and the correlated error of the camera on each of them. Two
thirds of the variance of a nosing's error stay the same over 0.2 m of travel, so that frames are no independent measurements: the
error is a state that decorrelates with travel (docs/decisions/0011).

Rise and run of the flight come from all frames: ``shapes of frames, nosings -> run, rise, variances``. Frames and tracked nosings
determine them in two ways. The detector's fit of one frame also uses treads and their normals, and averages over frames; tracked
nosings combine the near and precise part of many frames, but lean by the error of the IMU's gravity. Both come from the same
images with unknown correlation, so that each of rise and run is that of the smaller variance, which is covariance intersection for
a scalar.
"""

import math
import statistics
from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float, Int

from treadline.core.angles import DEG
from treadline.core.step_sizes import ON_A_FLIGHT_RAD

OWN_M, FAR_1_M = 0.8e-3, 0.8e-3
"""Standard deviation of a nosing's error that is new in each frame [m], and ratio of the correlated error to the square of the
distance [1/m]; depth by triangulation errs with the square. Together they are the RMS errors of the tables ``along`` and ``height``
in ``data/cameras/statistical.json``: 0.7 to 1.2 mm below 1 m, 2.0 to 2.6 mm at 1.75 m, 5.1 to 6.8 mm at 2.75 m."""
CORRELATED_M = 0.49
"""Travel over which the correlated error decays by 1/e [m]: ``nosing along`` and ``nosing height`` there."""
COMMON = np.array([0.396, 0.281])
"""Share of the correlated variance that all nosings of a frame have in common, along and in height: ``common`` there."""
OWN_SHARE = 0.08
"""Share of that variance which is new in each frame: 1 less ``nosing along`` and ``nosing height``, 0.926 and 0.935 there."""
SLIP_RATIO = 0.2
"""Standard deviation of the odometry's error along the belts as a ratio of travel between two frames. On the flight belts slip by 1
to 3 % of travel, mounting by 4 %, over the edge by 20 % (ground truth of up-28 and down-28, seeds 0 to 2)."""
DIRECTION_RATIO = 0.5
"""Standard deviation of the direction of motion as a ratio of the pitch: the middle of a chair with its ends on different surfaces
moves between horizontal and the belts' line. Mounting at 4° to 24°, it moves 0.13 rad RMS off that line (the same runs)."""
PIVOT_M = 0.37
"""Height that the middle gains per radian of pitch without travel [m]: largest of the same runs, less than half of the flat run."""
SLIDE_M_S = 0.3
"""Standard deviation of the speed of a chair that slides down a flight [m/s]: the largest speed of the belts."""
DIFFUSE_M = 1.0
"""Standard deviation of the place of a nosing before its first detection [m]."""
GATE = 16.0
"""Squared Mahalanobis distance of a detection from its nosing, beyond which the detection is an outlier: two degrees of freedom,
3.4e-4 of Gaussian errors are beyond."""


NosingDetection = tuple[int, tuple[float, float], float]
"""Number of a nosing, place (x, z) of its detection by odometry alone [m], and horizontal distance of the nosing from the chair's
middle [m]: the estimated distance, because a measured one would correlate with the error that it scales."""


class NosingFilter:
    """Joint estimate of the places of the nosings around the chair and of the chair's position error.

    Each nosing has four states: x, z, and the two correlated errors in units of their standard deviation. ``remove`` marginalises
    a nosing out, so that the size is that of the nosings in view and under the chair, however long the flight.
    """

    def __init__(self) -> None:
        self.mean = np.zeros(4)
        """Error of the odometry (x, z) [m], common correlated errors (x, z), then four states of each nosing."""
        self.covariance = np.diag([0.0, 0.0, 1.0, 1.0])
        self.shift_m = (0.0, 0.0)
        """Correction of the odometry's position (x, z) [m]."""
        self._along_m = self._climbed_m = self._time_s = 0.0
        self._turned_rad = 0.0
        self._slide = np.zeros((2, 2))

    @property
    def ran_m(self) -> float:
        """Travel of the belts since the last frame, without sign [m]."""
        return self._along_m

    @property
    def places_m(self) -> Float[np.ndarray, "n 2"]:
        """Place (x, z) of each nosing [m]."""
        return self.mean[4:].reshape(-1, 4)[:, :2]

    def covariance_of(self, numbers: Sequence[int]) -> Float[np.ndarray, "k k"]:
        """Return the covariance of the places of nosings [m²], in this order and x before z."""
        rows = np.ravel([(4 + 4 * number, 5 + 4 * number) for number in numbers]).astype(int)
        return np.asarray(self.covariance[np.ix_(rows, rows)])

    def ahead_covariance(self, number: int, pitch_rad: float) -> Float[np.ndarray, "2 2"]:
        """Return the covariance of a nosing's place relative to the chair [m²], with the odometry's error since the last frame."""
        row = 4 + 4 * number
        both = np.array([0, 1, row, row + 1])
        away = np.hstack([-np.eye(2), np.eye(2)])
        return away @ self.covariance[np.ix_(both, both)] @ away.T + self._drift(pitch_rad, slides=False)

    def height_variances(self, pitch_rad: float, against: int | None) -> list[float]:
        """Return the variance of each nosing's height across the belts' line [m²].

        Args:
            pitch_rad: Pitch of that line.
            against: Number of the nosing through which the line passes; None: through the chair by odometry.
        """
        s, c = -math.sin(pitch_rad), math.cos(pitch_rad)
        places = s * self.covariance[:, 4::4] + c * self.covariance[:, 5::4]
        own = s * places[4::4] + c * places[5::4]
        if against is None:
            chair, drift = self.covariance[:2, :2] + self._drift(pitch_rad, slides=False), s * places[0] + c * places[1]
            line, common = s * s * chair[0, 0] + 2.0 * s * c * chair[0, 1] + c * c * chair[1, 1], drift
        else:
            line, common = own[against, against], own[against]
        variances: list[float] = np.maximum(own.diagonal() + line - 2.0 * common, 0.0).tolist()
        return variances

    def drive(self, moved_m: float, ran_m: float, turned_rad: float, pitch_rad: float, dt_s: float) -> None:
        """Add the uncertainty of one interval of odometry.

        Args:
            moved_m: Signed travel of the chair's middle by the belts.
            ran_m: Travel of the belts, without sign: that of a turn on the spot is positive.
            turned_rad: Change of pitch.
            pitch_rad: Pitch.
            dt_s: Duration.
        """
        self._along_m += ran_m
        self._climbed_m += moved_m * math.sin(pitch_rad)
        self._turned_rad += turned_rad
        self._time_s += dt_s

    def begin_frame(self, pitch_rad: float) -> None:
        """Move the estimate to the time of a frame."""
        kept = math.exp(-self._along_m / CORRELATED_M)
        # Each four states are two places, which stay, and two correlated errors, which decay.
        factor = np.tile([1.0, 1.0, kept, kept], len(self.mean) // 4)
        self.mean = self.mean * factor
        self.covariance = self.covariance * factor * factor[:, None]
        self.covariance[np.diag_indices_from(self.covariance)] += 1.0 - factor**2
        grips, slides = self._drift(pitch_rad, slides=False), self._drift(pitch_rad, slides=True)
        self.covariance[:2, :2] += grips
        self._slide = slides - grips
        self._along_m = self._climbed_m = self._time_s = self._turned_rad = 0.0

    def add(self, place_m: tuple[float, float]) -> int:
        """Return the number of a new nosing near a place, which its first update determines."""
        number = (len(self.mean) - 4) // 4
        self.mean = np.concatenate([self.mean, [*place_m, 0.0, 0.0]])
        size = len(self.mean)
        covariance = np.zeros((size, size))
        covariance[:-4, :-4] = self.covariance
        covariance[range(size - 4, size), range(size - 4, size)] = [DIFFUSE_M**2, DIFFUSE_M**2, 1.0, 1.0]
        self.covariance = covariance
        return number

    def remove(self, number: int) -> None:
        """Remove a nosing; the numbers of those after it decrease by one."""
        kept = np.delete(np.arange(len(self.mean)), np.arange(4 + 4 * number, 8 + 4 * number))
        self.mean, self.covariance = self.mean[kept], self.covariance[np.ix_(kept, kept)]

    def update(self, detections: Sequence[NosingDetection], new: Sequence[bool] = ()) -> None:
        """Update with the detections of one frame.

        If most detections of earlier nosings are beyond the gate, the chair slides on a flight or its belts run on the spot, and
        the odometry's uncertainty is that of a slide. A detection beyond the gate is not dropped, because a camera may be noisier
        than the one of the tables: its noise is increased until it is at the gate, which bounds its influence.

        Args:
            detections: Detections.
            new: Whether each is the first of its nosing; no slide is considered where this is left out.
        """
        if not detections:
            return
        columns, observed, noise_m2, value = self._equations(detections)
        noise = np.diag(noise_m2)
        projected = self.covariance[:, columns] @ observed.T
        total = observed @ projected[columns] + noise
        off = value - observed @ self.mean[columns]
        distances2 = _distances2(off, total)
        earlier = [distance2 for distance2, is_new in zip(distances2.tolist(), new, strict=False) if not is_new]
        if earlier and statistics.median(earlier) > GATE:
            self.covariance[:2, :2] += self._slide
            self.update(detections)
            return
        for k in np.flatnonzero(distances2 > GATE).tolist():
            own = slice(2 * k, 2 * k + 2)
            added = (distances2[k] / GATE - 1.0) * total[own, own]
            noise[own, own] += added
            total[own, own] += added
        gain = np.linalg.solve(total, projected.T).T
        self.mean = self.mean + gain @ off
        # Joseph's form, (I - KH) P (I - KH)' + K R K', stays positive definite; H has the observed columns alone.
        half = self.covariance - gain @ projected.T
        self.covariance = half + (gain @ noise - half[:, columns] @ observed.T) @ gain.T
        self.shift_m = (float(self.mean[0]), float(self.mean[1]))

    def _drift(self, pitch_rad: float, *, slides: bool) -> Float[np.ndarray, "2 2"]:
        """Return the covariance of the odometry's error since the last frame [m²].

        Args:
            pitch_rad: Pitch.
            slides: Whether the chair may have lost its grip since.
        """
        slide_m = SLIDE_M_S * self._time_s if abs(pitch_rad) > ON_A_FLIGHT_RAD else 0.0
        along_m = math.hypot(self._along_m, slide_m) if slides else SLIP_RATIO * self._along_m
        across_m = math.hypot(DIRECTION_RATIO * self._climbed_m, PIVOT_M * self._turned_rad)
        c, s = math.cos(pitch_rad), math.sin(pitch_rad)
        axes = np.array([[c * along_m, -s * across_m], [s * along_m, c * across_m]])
        return axes @ axes.T

    def _equations(
        self, detections: Sequence[NosingDetection]
    ) -> tuple[Int[np.ndarray, " c"], Float[np.ndarray, "m c"], Float[np.ndarray, " m"], Float[np.ndarray, " m"]]:
        """Return observed columns, observation matrix of these columns, variances of the noise [m²] and values [m].

        Place by odometry = nosing - error of odometry + error of the camera.
        """
        numbers, places_m, distances_m = zip(*detections, strict=True)
        own = list(dict.fromkeys(numbers))  # two detections of one frame may belong to one nosing
        columns = np.concatenate([np.arange(4), np.add.outer(4 + 4 * np.array(own), np.arange(4)).ravel()])
        far_m = FAR_1_M * np.square(distances_m)
        own_m2 = OWN_M**2 + OWN_SHARE * far_m**2
        far_m = math.sqrt(1.0 - OWN_SHARE) * far_m
        rows = np.arange(len(numbers))
        first = 4 + 4 * np.array([own.index(number) for number in numbers])
        observed = np.zeros((len(numbers), 2, len(columns)))
        for axis in range(2):
            observed[:, axis, axis] = -1.0
            observed[:, axis, 2 + axis] = math.sqrt(COMMON[axis]) * far_m
            observed[rows, axis, first + axis] = 1.0
            observed[rows, axis, first + axis + 2] = math.sqrt(1.0 - COMMON[axis]) * far_m
        return columns, observed.reshape(2 * len(numbers), -1), np.repeat(own_m2, 2), np.ravel(places_m)


def _distances2(off: Float[np.ndarray, " m"], total: Float[np.ndarray, "m m"]) -> Float[np.ndarray, " k"]:
    """Return the squared Mahalanobis distance of each innovation (x, z) alone."""
    (x, z), (xx, zz), xz = off.reshape(-1, 2).T, np.diagonal(total).reshape(-1, 2).T, np.diagonal(total, 1)[::2]
    return np.asarray((zz * x**2 - 2.0 * xz * x * z + xx * z**2) / (xx * zz - xz**2))


IRREGULAR_M = np.array([0.008, 0.006])
"""Standard deviation of a nosing from the lattice, along and in height [m]: that of the detector (docs/decisions/0024)."""
FRAME_M = (0.0015, 0.0017)
"""Standard deviation of run and rise in a frame with nosings near the chair [m]: ``slope`` (0.31°) and ``pitch`` (1.35 mm) for four
nosings in ``data/cameras/statistical.json``, on a flight of 28°."""
GRAVITY_RAD = 0.5 * DEG
"""Standard deviation of the IMU's tilt at rest [rad], as in ``benchmarks/statistical.py``."""
SHAPE_DIFFUSE_M = 0.1
"""Standard deviation of run and rise before the first frame [m]."""


class FlightShape:
    """Run and rise with their variances, each a Kalman filter with a correlated error."""

    def __init__(self) -> None:
        self.mean_m = np.zeros(2)
        """Run and rise [m]; zero before the first frame."""
        self.variance_m2 = np.full(2, math.inf)
        self._frames: tuple[_CorrelatedMean, _CorrelatedMean] | None = None
        """Run and rise by frames alone."""

    def update(self, frame_m: tuple[float, float], distances_m: Sequence[float], travel_m: float) -> None:
        """Update with the run and rise of one frame.

        Args:
            frame_m: Run and rise.
            distances_m: Horizontal distances of the frame's nosings from the chair's middle.
            travel_m: Travel of the belts since the frame before, without sign.
        """
        if self._frames is None:
            self._frames = (_CorrelatedMean(frame_m[0]), _CorrelatedMean(frame_m[1]))
        kept = math.exp(-travel_m / CORRELATED_M)
        for frame, value_m, own_m, irregular_m in zip(self._frames, frame_m, FRAME_M, IRREGULAR_M.tolist(), strict=True):
            frame.update(value_m, own_m**2 + _slope_variance(distances_m, irregular_m), kept)
        self.mean_m = np.array([frame.value for frame in self._frames])
        self.variance_m2 = np.array([frame.variance for frame in self._frames])

    def combine(self, places_m: Sequence[tuple[float, float]], covariance_m2: Callable[[], Float[np.ndarray, "k k"]]) -> None:
        """Replace run or rise by that of the tracked nosings if its variance is smaller.

        Args:
            places_m: Places (x, z) of the nosings, the lowest first.
            covariance_m2: Returns the covariance of the places in this order, x before z.
        """
        leaning_m2 = (GRAVITY_RAD * self.mean_m[::-1]) ** 2
        if len(places_m) < 2 or np.all(leaning_m2 >= self.variance_m2):
            return
        places = np.asarray(places_m)
        apart = np.maximum(np.rint(np.diff(places, axis=0) @ self.mean_m / (self.mean_m @ self.mean_m)), 1.0)
        found, variance_m2 = _lattice(places, covariance_m2(), np.concatenate([[0.0], np.cumsum(apart)]))
        variance_m2 = variance_m2 + leaning_m2
        better = variance_m2 < self.variance_m2
        self.mean_m = np.where(better, found, self.mean_m)
        self.variance_m2 = np.where(better, variance_m2, self.variance_m2)


class _CorrelatedMean:
    """Kalman filter of a constant whose measurements share an error that decays with travel.

    States: the constant, and the correlated error in units of its standard deviation.
    """

    def __init__(self, value: float) -> None:
        self.value = value
        self.variance = SHAPE_DIFFUSE_M**2
        self._error, self._error_variance, self._covariance = 0.0, 1.0, 0.0

    def update(self, measured: float, variance: float, kept: float) -> None:
        """Update with one measurement; ``kept`` is the share of the correlated error that is left since the one before."""
        self._error *= kept
        self._covariance *= kept
        self._error_variance = 1.0 + (self._error_variance - 1.0) * kept**2
        sigma = math.sqrt((1.0 - OWN_SHARE) * variance)
        with_value = self.variance + sigma * self._covariance
        with_error = self._covariance + sigma * self._error_variance
        total = with_value + sigma * with_error + OWN_SHARE * variance
        off = measured - self.value - sigma * self._error
        self.value += with_value / total * off
        self._error += with_error / total * off
        self.variance -= with_value**2 / total
        self._covariance -= with_value * with_error / total
        self._error_variance -= with_error**2 / total


def _slope_variance(distances_m: Sequence[float], irregular_m: float) -> float:
    """Return the variance of run or rise from the nosings of one frame [m²]: the slope of the weighted line through them."""
    if len(distances_m) < 2:
        return SHAPE_DIFFUSE_M**2
    variances = [OWN_M**2 + (FAR_1_M * distance_m**2) ** 2 for distance_m in distances_m]
    weights = [1.0 / (variance + irregular_m**2) for variance in variances]
    middle = sum(k * weight for k, weight in enumerate(weights)) / sum(weights)
    leverage = [weight * (k - middle) for k, weight in enumerate(weights)]
    scale = sum(k * share for k, share in enumerate(leverage))
    return sum(share**2 * variance for share, variance in zip(leverage, variances, strict=True)) / scale**2


def _lattice(
    places: Float[np.ndarray, "n 2"], covariance_m2: Float[np.ndarray, "k k"], numbers: Float[np.ndarray, " n"]
) -> tuple[Float[np.ndarray, " 2"], Float[np.ndarray, " 2"]]:
    """Return run and rise of numbered nosings by generalised least squares, and the variances of their errors.

    Irregularity weighs the nosings, and is no error: run and rise are the means of the flight as built.
    """
    design = np.hstack([np.kron(np.ones((len(places), 1)), np.eye(2)), np.kron(np.reshape(numbers, (-1, 1)), np.eye(2))])
    weighted = np.linalg.solve(covariance_m2 + np.diag(np.tile(IRREGULAR_M**2, len(places))), design)
    gain = np.linalg.solve(design.T @ weighted, weighted.T)[2:]
    return gain @ places.ravel(), np.diag(gain @ covariance_m2 @ gain.T)
