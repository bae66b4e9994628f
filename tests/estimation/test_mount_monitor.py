"""Mount monitor: errors of the mount and of the IMU's axes from streams of stair axes, with intervals that hold."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from world import belts, imu, imu_at

from treadline.core.angles import DEG
from treadline.core.camera_images import PinholeCamera, StairAxes
from treadline.core.rotations import rotation_x, rotation_y, rotation_z
from treadline.core.signals import Event
from treadline.estimation import MountMonitor
from treadline.estimation._mount_monitor import BlockMeans, mount_angles

NOMINAL = PinholeCamera(width_px=320, height_px=240, fx_px=287.5, fy_px=287.5, cx_px=159.5, cy_px=119.5, mount_pitch_rad=40.0 * DEG)
SLOPE_RAD = 28.0 * DEG
FRAME_S = 0.1


class Drive:
    """A chair on the flight, or on the floor before it, whose camera and IMU are off by given rotations."""

    def __init__(self, seed: int, *, roll_deg: float = 0.0, pitch_deg: float = 0.0, imu: np.ndarray | None = None) -> None:
        self._rng = np.random.default_rng(seed)
        self._true = replace(
            NOMINAL,
            mount_pitch_rad=NOMINAL.mount_pitch_rad + pitch_deg * DEG,
            mount_roll_rad=NOMINAL.mount_roll_rad + roll_deg * DEG,
        )
        direction = self._rng.uniform(-math.pi, math.pi)
        # Half a degree of constant IMU tilt, the monitor's prior.
        tilt = rotation_x(0.5 * DEG * math.cos(direction)) @ rotation_y(0.5 * DEG * math.sin(direction))
        self._imu = tilt if imu is None else imu
        self._rock = np.zeros(2)
        self.monitor = MountMonitor()
        self.events: list[Event] = []
        self.agrees: list[bool] = []

    def run(self, seconds: float, *, floor: bool = False, standing: bool = False, nominal: PinholeCamera = NOMINAL) -> "Drive":
        """Process frames of a drive."""
        rng = self._rng
        self.monitor.update(belts(0.0, 0.2 * (not standing), 0.2 * (not standing)))
        for k in range(round(seconds / FRAME_S)):
            # 3 mm of rise jitter rock a chair by 0.38° in pitch and 0.12° in roll, for about 0.8 s (measured on the plant).
            keep = math.exp(-FRAME_S / 0.8)
            self._rock = keep * self._rock + math.sqrt(1.0 - keep**2) * DEG * rng.normal(size=2) * [0.12, 0.38]
            R_SB = rotation_z(8.0 * DEG * math.sin(0.1 * k / 6.0)) @ rotation_x(self._rock[0]) @ rotation_y(self._rock[1])
            if floor:
                R_SB = rotation_y(SLOPE_RAD) @ rotation_z(0.1)
            sample = imu_at(FRAME_S * k, rotation_z(1.0) @ rotation_y(-SLOPE_RAD) @ R_SB @ self._imu)
            R_CS = self._true.R_BC.T @ R_SB.T @ rotation_x(0.1 * DEG * rng.normal()) @ rotation_y(0.2 * DEG * rng.normal())
            agrees, events = self.monitor.step(axes_of(FRAME_S * k, R_CS), sample, nominal)
            self.agrees.append(agrees)
            self.events += events
        return self

    def named(self, name: str) -> list[Event]:
        """Return the events of one kind."""
        return [event for event in self.events if event.name == name]

    def left_rad(self) -> tuple[float, float]:
        """Return the errors of mount pitch and roll after correction."""
        camera = self.monitor.corrected(NOMINAL)
        return camera.mount_pitch_rad - self._true.mount_pitch_rad, camera.mount_roll_rad - self._true.mount_roll_rad


def axes_of(t_s: float, R_CS: np.ndarray) -> StairAxes:
    return StairAxes(
        t_s=t_s,
        edge_C=-R_CS[:, 1],
        down_C=R_CS @ np.array([-math.sin(SLOPE_RAD), 0.0, -math.cos(SLOPE_RAD)]),
        normal_C=R_CS[:, 2],
        down_sigma_rad=0.1 * DEG,
    )


@pytest.mark.parametrize("seed", range(6))
def test_a_sound_mount_and_imu_cause_no_event_and_no_change(seed: int) -> None:
    for floor in (False, True):
        drive = Drive(seed).run(40.0, floor=floor)
        assert drive.events == []
        assert all(drive.agrees)
        assert drive.monitor.corrected(NOMINAL) is NOMINAL
        assert drive.monitor.heading_sigma_rad == 0.0


@pytest.mark.parametrize("roll_deg", [3.0, -5.0])
@pytest.mark.parametrize("seed", range(3))
def test_a_rolled_mount_on_the_flight_is_reported_once_and_corrected(seed: int, roll_deg: float) -> None:
    drive = Drive(seed, roll_deg=roll_deg, pitch_deg=1.5).run(40.0)
    (event,) = drive.named("camera_mount")
    # Four blocks of 3 s, and the frame that ends the last.
    assert event.t_s == pytest.approx(12.0, abs=2.0 * FRAME_S)
    assert (
        f"rolled by {roll_deg:+.0f}" in event.cause
        or f"rolled by {math.copysign(abs(roll_deg) - 0.1, roll_deg):+.1f}" in event.cause
    )
    pitch_rad, roll_rad = drive.left_rad()
    # Rocking of 0.38° and 0.12°, correlated over 0.8 s, in 12 s: sigma 0.14° and 0.04°, the roll by 1/cos 40° more; three sigma.
    assert abs(pitch_rad) < 0.45 * DEG
    assert abs(roll_rad) < 0.25 * DEG
    assert abs(math.sin(40.0 * DEG) * roll_rad) < 3.0 * drive.monitor.heading_sigma_rad


@pytest.mark.parametrize("seed", range(5))
def test_on_the_floor_treads_and_gravity_correct_the_mount_within_their_interval(seed: int) -> None:
    drive = Drive(seed, roll_deg=5.0).run(10.0, floor=True)
    (event,) = drive.named("camera_mount")
    assert event.t_s <= 2.1
    # The IMU's tilt of half a degree, seen under the mount's pitch: 0.5° / cos 40° = 0.65°, and 0.1° of noise.
    assert abs(drive.left_rad()[1]) < 0.8 * DEG
    assert abs(math.sin(40.0 * DEG) * drive.left_rad()[1]) < 1.96 * drive.monitor.heading_sigma_rad


def test_before_the_chair_moves_on_the_flight_a_doubtful_mount_counts_in_the_sigma() -> None:
    """Mount or IMU may be tilted: nothing is corrected, and the heading's sigma covers the error of a rolled mount."""
    drive = Drive(0, roll_deg=3.0).run(10.0, standing=True)
    assert [event.name for event in drive.events] == ["imu_tilt"]
    assert drive.monitor.corrected(NOMINAL) is NOMINAL
    assert 1.96 * drive.monitor.heading_sigma_rad > math.sin(40.0 * DEG) * 3.0 * DEG * 0.8


def test_an_error_of_half_a_degree_is_not_reported() -> None:
    assert Drive(1, roll_deg=0.5).run(60.0).events == []


@pytest.mark.parametrize(
    ("turned", "off_deg"), [(rotation_x(math.pi / 2), 76), (rotation_y(math.pi / 2), 90), (rotation_x(math.pi), 124)]
)
def test_wrong_imu_axes_are_reported_once_with_the_angle_and_no_frame_agrees(turned: np.ndarray, off_deg: int) -> None:
    drive = Drive(2, imu=turned).run(10.0)
    (event,) = drive.events
    assert event.name == "imu_axes"
    found = float(event.cause.split()[2].removesuffix("°"))
    # The chair's pitch of 28° decides the angle; rocking of 0.4° and rounding to a degree.
    assert found == pytest.approx(off_deg, abs=2.0)
    assert event.cause.endswith("off gravity: IMU axes?")
    assert not any(drive.agrees)


def test_the_nosing_plane_separates_an_imu_tilt_from_a_mount_error() -> None:
    drive = Drive(3, imu=rotation_x(5.0 * DEG)).run(40.0)
    assert drive.named("camera_mount") == []
    assert [event.cause.split("gravity, ")[1][:10] for event in drive.named("imu_tilt")] == ["IMU or cam", "beyond the"]
    assert drive.monitor.heading_sigma_rad == 0.0


@pytest.mark.parametrize("spoil", [lambda axes: replace(axes, t_s=math.nan), lambda axes: replace(axes, down_sigma_rad=0.5 * DEG)])
def test_frames_without_time_or_with_hardly_a_tread_do_not_count(spoil: Callable[[StairAxes], StairAxes]) -> None:
    monitor = MountMonitor()
    level = imu(0.0, SLOPE_RAD)
    rolled = replace(NOMINAL, mount_roll_rad=5.0 * DEG)
    for k in range(400):
        assert monitor.step(spoil(axes_of(FRAME_S * k, rolled.R_BC.T)), level, NOMINAL) == (True, [])


def test_another_camera_starts_the_estimate_again() -> None:
    drive = Drive(4, roll_deg=3.0).run(20.0)
    assert drive.monitor.corrected(NOMINAL) is not NOMINAL
    known = replace(NOMINAL, mount_roll_rad=3.0 * DEG)
    drive.events.clear()
    drive.run(20.0, nominal=known)
    assert drive.events == []
    assert drive.monitor.corrected(known) is known


@pytest.mark.parametrize("yaw_rad", [0.0, 0.3, math.pi])
def test_mount_angles_are_those_of_the_camera(yaw_rad: float) -> None:
    camera = replace(NOMINAL, mount_pitch_rad=0.5, mount_roll_rad=-0.1, mount_yaw_rad=yaw_rad)
    known = np.array([0.3, -0.1, 0.9]) / math.sqrt(0.91)
    found = mount_angles(camera.R_BC.T @ known, (known[0], known[1], known[2]), yaw_rad)
    # Closed form: rounding only.
    assert found == pytest.approx((0.5, -0.1), abs=1e-12)


def test_the_interval_of_block_means_covers_19_of_20() -> None:
    rng, inside = np.random.default_rng(5), 0
    for _ in range(1000):
        means = BlockMeans(1.0)
        for k in range(6):
            means.add(float(k), *(rng.normal(size=2) * DEG))
        found = means.estimate(0.0, 0.0)
        inside += abs(found.roll_rad) <= found.roll_half_rad
    # Five blocks: the factor sqrt 2 · 1.96 = 2.77 against Student's 2.776; three sigma of a binomial share.
    assert 0.93 <= inside / 1000 <= 0.97
