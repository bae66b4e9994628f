"""Fusion of frames: errors agree with their declared variances, and a map outlives refused and wrong frames."""

import json
import math
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from importlib import resources
from types import FrameType

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from jaxtyping import Float
from world import RISE_M, RUN_M, belts, imu, stair

from treadline.core.signals import StairMap
from treadline.estimation._nosing_filter import COMMON, NosingFilter
from treadline.estimation.stair_tracker import StairTracker

# Literals, so that a changed value in the code is detected here.
CORRELATED_M = 0.49
FAR_1_M = 0.0008
GATE = 16.0
OWN_M = 0.0008
OWN_SHARE = 0.08
SLIP_RATIO = 0.2

STEPS, HALF_M, FRAME_M, FRAME_S = 10, 0.475, 0.02, 0.1
FOOT_M = -RUN_M
"""Place where the nosing line meets the floor; the first nosing is at x = 0."""
VIEW_M = {"up": (0.5, 5.0), "down": (0.5, 3.0)}
"""Range of distances in which nosings are in view [m]."""


@dataclass
class Drive:
    """A chair whose frames have the errors of the filter's model, and whose belts slip by the filter's ratio."""

    rng: np.random.Generator
    up: bool = True
    slip: float = SLIP_RATIO
    noise: float = 1.0
    """Scale of the camera's errors."""
    count: int = STEPS
    frame_m: float = FRAME_M
    top_m: float = 0.0
    """Additional height of the last nosing."""
    x_m: float = 0.0
    z_m: float = 0.0
    pitch_rad: float = 0.0
    t_s: float = 0.0
    tracker: StairTracker = field(default_factory=StairTracker)

    def __post_init__(self) -> None:
        self.steps = np.column_stack([RUN_M * np.arange(self.count), RISE_M * np.arange(1, self.count + 1)])
        self.steps[-1, 1] += self.top_m
        self._common, self._own = self.rng.standard_normal(2), self.rng.standard_normal((self.count, 2))

    def to(self, end_m: float, refused: float = 0.0) -> Iterator[StairMap | None]:
        """Drive to a place and yield the map of each frame, None for a refused one."""
        way = math.copysign(1.0, end_m - self.x_m)
        while way * (end_m - self.x_m) > 0.0:
            self._move(way * self.frame_m)
            seen = None if self.rng.random() < refused else self.look()
            if seen is not None:
                self.tracker.update(seen)
            yield seen

    def on(self, end_m: float) -> None:
        """Drive to a place."""
        list(self.to(end_m))

    def start_at(self, x_m: float) -> None:
        """Place the chair."""
        self.x_m = x_m
        self.z_m, self.pitch_rad = self._pose()
        self._report(0.0)

    def look(self) -> StairMap | None:
        """Return the map of the nosings in view, None with fewer than two."""
        way, (near_m, far_m) = 1.0 if self.up else -1.0, VIEW_M["up" if self.up else "down"]
        away = way * (self.steps[:, 0] - self.x_m)
        number = np.flatnonzero((away > near_m) & (away < far_m))
        if len(number) < 2:
            return None
        number = number if self.up else number[::-1]
        kept = math.sqrt(1.0 - OWN_SHARE)
        correlated = kept * FAR_1_M * away[number, None] ** 2
        error = correlated * (np.sqrt(COMMON) * self._common + np.sqrt(1.0 - COMMON) * self._own[number])
        own = np.sqrt(OWN_M**2 + OWN_SHARE * (FAR_1_M * away[number, None] ** 2) ** 2) * self.rng.standard_normal((len(number), 2))
        x, z = (self.steps[number] - [self.x_m, self.z_m] + self.noise * (error + own)).T
        c, s = math.cos(self.pitch_rad), math.sin(self.pitch_rad)
        ends = bool(number[-1] == (self.count - 1 if self.up else 0) and away[number[-1]] < 2.0)
        places = np.column_stack([x * c + z * s, 0.0 * x, z * c - x * s])
        return stair(self.t_s, list(places), direction="up" if self.up else "down", ends=ends)

    def errors(self) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
        """Return error and declared standard deviation of the distance of each known nosing [m]."""
        truth = (self.steps - [self.x_m, self.z_m]) @ [math.cos(self.pitch_rad), math.sin(self.pitch_rad)]
        ahead = np.array(self.tracker.ahead_m())
        error = ahead - truth[np.abs(ahead[:, None] - truth).argmin(axis=1)]
        return error, np.array(self.tracker.ahead_sigma_m())

    def _move(self, way_m: float) -> None:
        before = np.array([self.x_m, self.z_m])
        self.x_m += way_m
        self.z_m, self.pitch_rad = self._pose()
        moved = float(np.linalg.norm([self.x_m, self.z_m] - before))
        kept = math.exp(-moved / CORRELATED_M)
        fresh = math.sqrt(1.0 - kept**2)
        self._common = kept * self._common + fresh * self.rng.standard_normal(2)
        self._own = kept * self._own + fresh * self.rng.standard_normal((self.count, 2))
        self.t_s += FRAME_S
        self._report(math.copysign(moved, way_m) * (1.0 + self.slip * float(self.rng.standard_normal())) / FRAME_S)

    def _report(self, speed_m_s: float) -> None:
        self.tracker.update(imu(self.t_s, self.pitch_rad))
        self.tracker.update(belts(self.t_s, speed_m_s, speed_m_s))

    def _pose(self) -> tuple[float, float]:
        """Return height and pitch of a chair whose ends lie on the floor, on the nosing line or on the landing."""
        top_m = float(self.steps[-1, 1])
        rear, front = (min(max((self.x_m + end_m - FOOT_M) * RISE_M / RUN_M, 0.0), top_m) for end_m in (-HALF_M, HALF_M))
        return 0.5 * (rear + front), math.atan2(front - rear, 2.0 * HALF_M)


def begun(drive: Drive, from_m: float = 5.0) -> Drive:
    """Return the drive at its start: before the flight, or on the landing with the edge in view."""
    drive.start_at(-from_m if drive.up else RUN_M * (STEPS - 1) + 1.0)
    return drive


@pytest.mark.parametrize("up", [True, False])
def test_squared_errors_agree_with_their_declared_variance(*, up: bool) -> None:
    """Test: eight drives onto the flight, up and down. Expected result: squared errors of nosings within 2 m are 0.5 to 1.6 of the
    declared variance on average. Errors of one drive are correlated: 16 moments of about two independent errors give ±0.25."""
    squares = []
    for seed in range(8):
        drive = begun(Drive(np.random.default_rng([seed, 30]), up=up), from_m=2.5)
        for end_m in (-0.7, 0.3) if up else (RUN_M * (STEPS - 1) + 0.7, RUN_M * (STEPS - 1) - 0.6):
            drive.on(end_m)
            error, sigma = drive.errors()
            near = (np.abs(drive.tracker.ahead_m()) < 2.0) & np.isfinite(sigma)
            squares.append(float(np.mean((error[near] / sigma[near]) ** 2)))
    assert 0.5 < np.mean(squares) < 1.6


@pytest.mark.parametrize("up", [True, False])
def test_nine_frames_of_ten_refused_keep_the_map_and_widen_it_in_between(*, up: bool) -> None:
    """Test: a drive with 3 % of slip and 90 % of the frames refused. Expected result: no known nosing is lost, the deviation grows
    in each refused frame once the chair is on the flight, and 95 % of the errors stay within three deviations."""
    drive, inside, count = begun(Drive(np.random.default_rng([7, 30]), up=up, slip=0.03)), [], 0
    before: list[float] = []
    for seen in drive.to(1.0 if up else 1.5, refused=0.9):
        error, sigma = drive.errors()
        assert len(error) >= count
        if seen is None and len(before) == len(sigma):
            assert np.all(sigma >= np.array(before) - 1e-4)  # a chair that pitches changes the direction in which sigma is taken
        count, before = len(error), sigma.tolist()
        inside += (np.abs(error) < 3.0 * sigma).tolist()
    assert count > 4
    assert np.mean(inside) > 0.95


@pytest.mark.parametrize(("dx_m", "dz_m"), [(0.06, 0.0), (0.0, 0.05), (-0.05, -0.05)])
def test_a_wrong_frame_moves_the_map_of_a_chair_that_stands_by_less_than_a_sound_one_errs(dx_m: float, dz_m: float) -> None:
    drive = begun(Drive(np.random.default_rng([8, 30])))
    drive.on(-1.5)
    seen = drive.look()
    before = np.array(drive.tracker.ahead_m())
    drive.tracker.update(replace(seen, nosings_B=[(x + dx_m, y, z + dz_m) for x, y, z in seen.nosings_B]))
    near = before < 3.0
    np.testing.assert_allclose(np.array(drive.tracker.ahead_m())[near], before[near], atol=5e-3)


def test_a_last_riser_30_mm_higher_stays_one_and_hardly_moves_the_shape() -> None:
    """Test: the last of ten nosings is 30 mm too high. Expected result: its height within 3 mm, and the rise within 5 mm: an end of
    the lattice that is 30 mm off turns the line through the nosings around it by a few millimetres a step."""
    drive = begun(Drive(np.random.default_rng([9, 30]), top_m=0.03, slip=0.02))
    drive.on(RUN_M * (STEPS - 1) - 0.7)
    assert drive.tracker.top_ends
    assert drive.tracker.top_above_m() == pytest.approx(drive.steps[-1, 1] - drive.z_m, abs=3e-3)
    assert drive.tracker.rise_m == pytest.approx(RISE_M, abs=5e-3)


def test_a_flight_is_tracked_from_five_metres_to_the_landing() -> None:
    """Test: from 5 m before the flight until no two nosings are in view. Expected result: known at the second frame that shows
    two nosings, all ten of them in the end, no gap, and the distance to the last within three deviations."""
    drive = begun(Drive(np.random.default_rng([10, 30]), slip=0.03))
    shown = 0
    for seen in drive.to(RUN_M * (STEPS - 1) + 0.2):
        shown += seen is not None
        assert (drive.tracker.first_ahead_m() is not None) == (shown > 1)
        assert not drive.tracker.gaps_ahead_m()
    error, sigma = drive.errors()
    assert len(error) == STEPS
    assert abs(error[-1]) < 3.0 * sigma[-1]


def test_a_noisier_camera_is_followed() -> None:
    """Test: errors three times those of the model, from 2.5 m. Expected result: the same ten nosings, none twice."""
    drive = begun(Drive(np.random.default_rng([11, 30]), noise=3.0, slip=0.03), from_m=2.5)
    drive.on(RUN_M * (STEPS - 1) - 0.5)
    ahead = drive.tracker.ahead_m()
    assert len(ahead) == STEPS
    assert min(np.diff(ahead)) > 0.7 * RUN_M


def test_the_cost_of_a_map_does_not_grow_with_the_nosings_passed() -> None:
    """Test: up a flight of 300 steps. Expected result: the filter holds the nosings in view and one metre behind, no more, a map
    takes as many calls at nosing 280 as at nosing 30, and the tracker keeps the places of all that were passed."""
    drive, calls = begun(Drive(np.random.default_rng([14, 30]), slip=0.02, count=300, frame_m=0.1), from_m=2.5), {}

    def counted(frame: FrameType, event: str, argument: object) -> None:
        del frame, argument
        calls[at] += event in ("call", "c_call")

    for at in (30, 280):
        drive.on(at * RUN_M)
        error, sigma = drive.errors()
        assert np.isfinite(sigma).sum() <= (VIEW_M["up"][1] + 1.0) / RUN_M + 1
        seen, calls[at] = drive.look(), 0
        sys.setprofile(counted)
        drive.tracker.update(seen)
        sys.setprofile(None)
        assert len(error) > at + 10
    assert calls[280] < 1.1 * calls[30]


def test_a_chair_that_rolls_back_finds_the_nosings_that_it_had_passed() -> None:
    """Test: 2.4 m up a flight and 2.1 m back. Expected result: no nosing twice, and errors within three deviations."""
    drive = begun(Drive(np.random.default_rng([15, 30]), slip=0.02, count=20), from_m=2.5)
    drive.on(2.4)
    before, sigma = drive.errors()
    assert np.isinf(sigma).sum() == 5  # those more than 0.98 m below mid-track, 0.3 m apart
    drive.on(0.3)
    error, sigma = drive.errors()
    assert len(error) == len(before)
    assert np.isinf(sigma).sum() == 0
    assert np.all(np.abs(error) < 3.0 * sigma)


@given(seed=st.integers(0, 2**32 - 1), count=st.integers(1, 6))
@settings(max_examples=50, deadline=None)
def test_an_update_is_that_of_a_dense_kalman_filter(seed: int, count: int) -> None:
    """Test: random detections of six nosings, some far beyond the gate. Expected result: the textbook's equations."""
    rng = np.random.default_rng(seed)
    nosings = NosingFilter()
    for k in range(6):
        nosings.add((0.3 * k + 1.0, 0.16 * k))
    for _ in range(4):
        nosings.drive(0.02, 0.02, 0.01, 0.3, 0.1)
        nosings.begin_frame(0.3)
        shown = sorted(rng.choice(6, count, replace=False).tolist())
        errors = rng.normal(0.0, 0.004, (count, 2)) + 0.1 * (rng.random((count, 1)) < 0.2)
        detections = [
            (k, (0.3 * k + 1.0 + dx, 0.16 * k + dz), 1.0 + 0.3 * k) for k, (dx, dz) in zip(shown, errors.tolist(), strict=True)
        ]
        mean, covariance = dense_update(nosings.mean, nosings.covariance, detections)
        nosings.update(detections)
        np.testing.assert_allclose(nosings.mean, mean, atol=1e-9)
        np.testing.assert_allclose(nosings.covariance, covariance, atol=1e-9)


def dense_update(
    mean: Float[np.ndarray, " s"], covariance: Float[np.ndarray, "s s"], detections: list[tuple[int, tuple[float, float], float]]
) -> tuple[Float[np.ndarray, " s"], Float[np.ndarray, "s s"]]:
    """Return mean and covariance after one frame, with matrices over all states and the inverse of the innovation's covariance."""
    H, R, z = np.zeros((2 * len(detections), len(mean))), np.zeros((2 * len(detections), 2 * len(detections))), []
    for i, (number, place, distance_m) in enumerate(detections):
        far_m = FAR_1_M * distance_m**2
        for axis in range(2):
            row, place_column = 2 * i + axis, 4 + 4 * number + axis
            H[row, [axis, place_column]] = -1.0, 1.0
            H[row, 2 + axis] = math.sqrt(COMMON[axis] * (1.0 - OWN_SHARE)) * far_m
            H[row, place_column + 2] = math.sqrt((1.0 - COMMON[axis]) * (1.0 - OWN_SHARE)) * far_m
            R[row, row] = OWN_M**2 + OWN_SHARE * far_m**2
            z.append(place[axis])
    off, S = np.array(z) - H @ mean, H @ covariance @ H.T + R
    for k in range(0, len(z), 2):
        own = slice(k, k + 2)
        distance2 = off[own] @ np.linalg.inv(S[own, own]) @ off[own]
        R[own, own] += max(distance2 / GATE - 1.0, 0.0) * S[own, own]
    K = covariance @ H.T @ np.linalg.inv(H @ covariance @ H.T + R)
    kept = np.eye(len(mean)) - K @ H
    return mean + K @ off, kept @ covariance @ kept.T + K @ R @ K.T


def test_the_noise_model_is_that_of_the_statistical_camera_and_of_the_detector() -> None:
    """Test: constants next to the fit and the detector that they stand for. Expected: equal up to the digits of the docstrings."""
    from treadline.estimation import _nosing_filter as nosing_filter
    from treadline.perception._gravity_direction import GRAVITY_SIGMA
    from treadline.perception._lattice_kernels import RISE_IRREGULAR_M, RUN_IRREGULAR_M

    camera = json.loads((resources.files("treadline") / "data/cameras/statistical.json").read_text(encoding="utf-8"))["kinect1"]
    for axis, name in enumerate(("along", "height")):
        frozen, decaying, length_m = camera["shared"][f"nosing {name}"]
        assert nosing_filter.COMMON[axis] == camera["common"][name]
        assert pytest.approx(length_m, abs=0.01) == nosing_filter.CORRELATED_M
        assert pytest.approx(1.0 - frozen - decaying, abs=0.02) == nosing_filter.OWN_SHARE
    assert tuple(nosing_filter.IRREGULAR_M) == (RUN_IRREGULAR_M, RISE_IRREGULAR_M)
    assert nosing_filter.GRAVITY_RAD == GRAVITY_SIGMA
