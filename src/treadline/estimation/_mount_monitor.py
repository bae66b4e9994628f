"""Mount monitor: errors of camera mount and IMU axes, detected and corrected while the chair drives.

``StairAxes, ImuSample, TrackReading -> Event``, and the corrected ``PinholeCamera``. Three comparisons accumulate over frames:

* nosing plane against the chair's z axis, while the chair rides the flight: mount pitch and roll, independent of the IMU;
* treads against gravity while the IMU reads horizontal: mount pitch and roll on the floor, less accurate by the IMU's tilt;
* treads against gravity elsewhere: a remainder that the mount does not explain is an IMU tilt or a mount yaw, reported only.

The directions of the stair are fixed in C, so a correction already applied does not change the estimate. The yaw of the mount is
not estimated: at a constant heading it cannot be distinguished from a constant IMU tilt.

Pitch and roll are means over blocks of time, with a 95 % interval from the variance between blocks.
"""

import math
from dataclasses import dataclass, replace
from statistics import median

import numpy as np

from treadline.core.angles import DEG
from treadline.core.arrays import NORMAL_95
from treadline.core.camera_images import PinholeCamera, StairAxes
from treadline.core.rotations import Vector3, rotation_of
from treadline.core.signals import Event, ImuSample, TrackReading
from treadline.core.step_sizes import ON_A_FLIGHT_RAD

REPORTED_RAD = 1.0 * DEG
"""Mount error above which the error is reported and corrected [rad]: the largest that is accepted silently. A roll of 1° turns the
heading by sin(40°), 0.64°, with the shipped mount."""
STANDING_M_S = 0.01
"""Belt speed below which the chair stands, and shows the same nosings in each frame [m/s]."""
RIDING_BLOCK_S = 3.0
"""Block length of the comparison on the flight [s]; errors of frames more than two blocks apart are independent: at 0.2 m/s the
chair has passed three nosings."""
LEAST_BLOCKS = 4
"""Least number of block means of an estimate: with fewer, the variance of Student's distribution is infinite."""


@dataclass(frozen=True, slots=True, kw_only=True)
class AngleEstimate:
    """Two angles with 95 % intervals."""

    pitch_rad: float
    roll_rad: float
    pitch_half_rad: float
    """Half width of the 95 % interval of the pitch [rad]."""
    roll_half_rad: float
    """Half width of the 95 % interval of the roll [rad]."""

    @property
    def exceeds(self) -> bool:
        """Whether an angle exceeds ``REPORTED_RAD`` at 95 %."""
        pitch, roll = abs(self.pitch_rad) - self.pitch_half_rad, abs(self.roll_rad) - self.roll_half_rad
        return max(pitch, roll) > REPORTED_RAD

    def replaces(self, declared: "AngleEstimate") -> bool:
        """Whether this estimate lies outside the declared interval, or halves that of the roll, which turns headings."""
        return (
            abs(self.pitch_rad - declared.pitch_rad) > declared.pitch_half_rad
            or abs(self.roll_rad - declared.roll_rad) > declared.roll_half_rad
            or self.roll_half_rad < 0.5 * declared.roll_half_rad
        )

    def __str__(self) -> str:
        """Return the angles in degrees."""
        return (
            f"rolled by {self.roll_rad / DEG:+.1f}° ± {self.roll_half_rad / DEG:.1f}° and pitched by "
            f"{self.pitch_rad / DEG:+.1f}° ± {self.pitch_half_rad / DEG:.1f}°"
        )


class BlockMeans:
    """Mean of two angles from the medians of time blocks, with the variance between blocks.

    Args:
        block_s: Block length [s]; errors of different blocks are independent.
    """

    def __init__(self, block_s: float) -> None:
        self._block_s = block_s
        self._block = -1
        self._open: list[tuple[float, float]] = []
        self._count = 0
        self._mean = [0.0, 0.0]
        self._squares = [0.0, 0.0]

    def add(self, t_s: float, pitch_rad: float, roll_rad: float) -> bool:
        """Add the angles of one frame; return whether a block is complete."""
        block = int(t_s // self._block_s)
        complete = bool(self._open) and block != self._block
        if complete:
            self._close()
        self._block = block
        self._open.append((pitch_rad, roll_rad))
        return complete

    def _close(self) -> None:
        self._count += 1
        for k in range(2):
            value = median([pair[k] for pair in self._open])
            before = value - self._mean[k]
            self._mean[k] += before / self._count
            self._squares[k] += before * (value - self._mean[k])
        self._open.clear()

    def estimate(self, pitch_sigma_rad: float, roll_sigma_rad: float) -> AngleEstimate | None:
        """Return the estimate with the sigmas of constant errors, which blocks do not average; None for too few blocks."""
        if self._count < LEAST_BLOCKS:
            return None
        freedom = self._count - 1
        # The variance of Student's distribution replaces its quantile: within 7 % for four blocks and more.
        factor = freedom / (freedom - 2.0) / freedom / self._count
        halves = [
            NORMAL_95 * math.hypot(sigma, math.sqrt(self._squares[k] * factor))
            for k, sigma in enumerate((pitch_sigma_rad, roll_sigma_rad))
        ]
        return AngleEstimate(pitch_rad=self._mean[0], roll_rad=self._mean[1], pitch_half_rad=halves[0], roll_half_rad=halves[1])


def more_accurate(one: AngleEstimate | None, other: AngleEstimate | None) -> AngleEstimate | None:
    """Return each angle from the estimate with the smaller interval."""
    if one is None or other is None:
        return one or other
    pitch = min(one, other, key=lambda item: item.pitch_half_rad)
    roll = min(one, other, key=lambda item: item.roll_half_rad)
    return replace(pitch, roll_rad=roll.roll_rad, roll_half_rad=roll.roll_half_rad)


def difference(one: AngleEstimate, other: AngleEstimate) -> AngleEstimate:
    """Return the difference of two independent estimates."""
    return AngleEstimate(
        pitch_rad=one.pitch_rad - other.pitch_rad,
        roll_rad=one.roll_rad - other.roll_rad,
        pitch_half_rad=math.hypot(one.pitch_half_rad, other.pitch_half_rad),
        roll_half_rad=math.hypot(one.roll_half_rad, other.roll_half_rad),
    )


FRAME_BLOCK_S = 0.5
"""Block length of a comparison between treads and gravity [s]: depth noise of frames is independent, rocking moves both. With 0.25,
0.5, 1 and 2 s a mount rolled by 3 to 5° is reported after 1, 2, 4 and 8 s, each time to ±0.9 to 1.1°, and headings end with
the same errors (rendered climbs with a wrong mount, as in ``tests/mission/test_mount_in_the_loop.py``)."""
LEVEL_RAD = 1.5 * DEG
"""Largest IMU tilt of a chair on the floor [rad]: drainage slope of 2 % (1.1°), and three sigma of the IMU's tilt (1.05°), added as
squares."""
TREADS_SIGMA_RAD = 0.25 * DEG
"""Largest sigma of the treads' direction [rad]: half the sigma of gravity in the detector, so that treads have three quarters of
the weight in the direction. With 0.18 and 0.35° events and headings of these climbs are the same."""

TILT_SIGMA_RAD = 0.35 * DEG
"""Prior sigma of the IMU's constant tilt about each axis [rad]: half a degree in all."""
TREADS_SLOPE_SIGMA_RAD = 0.1 * DEG
"""Sigma of the treads' constant slope [rad]: treads are built with a slope for drainage."""
GRAVITY_SIGMA_RAD = math.hypot(TILT_SIGMA_RAD, TREADS_SLOPE_SIGMA_RAD)
"""Sigma of the constant angle between treads and gravity [rad]; not reduced by averaging."""
BELTS_SIGMA_RAD = 0.06 * DEG
"""Sigma of the constant angle between z_B and the nosing plane's normal [rad]: soft rubber under an uneven load, and distortion of
planes in the depth image; not reduced by averaging."""
MOUNT_GATE_RAD = 15.0 * DEG
"""Largest angle between a measured direction and its direction with the nominal mount [rad]; beyond it the IMU's axes are wrong, or
the plane is not the stair's."""
SLOPE_GATE_RAD = 3.0 * DEG
"""Largest difference between the slope by vision and by the IMU [rad]; beyond it the chair is not on the visible flight. Half a
degree of tilt and a nosing 20 mm too high stay within the gate."""
ROCKING_RAD_S = 5.0 * DEG
"""Pitch and roll rate above which the chair is mounting, cresting or tipping between nosings [rad/s]."""


def mount_angles(seen_C: Vector3, known_B: tuple[float, float, float], yaw_rad: float) -> tuple[float, float] | None:
    """Return mount pitch and roll that rotate a direction seen in C into its known direction in B; None if none do."""
    x, y, z = seen_C.tolist()
    x, y, z = z, -x, -y  # CAMERA_AXES_IN_CHAIR
    cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
    to_x, to_y, to_z = cos * known_B[0] + sin * known_B[1], cos * known_B[1] - sin * known_B[0], known_B[2]
    across = math.hypot(y, z)
    if not across > abs(to_y):
        return None
    roll = math.atan2(y, z) - math.asin(to_y / across)
    pitch = math.atan2(to_x, to_z) - math.atan2(x, math.sqrt(across**2 - to_y**2))
    return math.remainder(pitch, math.tau), math.remainder(roll, math.tau)


class MountMonitor:
    """Errors of the mount and of the IMU's axes, accumulated over accepted frames."""

    def __init__(self) -> None:
        self._standing = False
        self._camera: PinholeCamera | None = None
        self._declared: AngleEstimate | None = None

    def _restart(self, camera: PinholeCamera) -> None:
        self._camera, self._corrected = camera, camera
        self._riding = BlockMeans(RIDING_BLOCK_S)
        self._on_floor = BlockMeans(FRAME_BLOCK_S)
        self._elsewhere = BlockMeans(FRAME_BLOCK_S)
        self._far_off = BlockMeans(FRAME_BLOCK_S)
        self._declared = None
        self._mount: AngleEstimate | None = None
        self._axes_reported = False
        self._suspected: set[str] = set()
        """Explanations of an unexplained tilt that have been reported."""
        self._possible_roll_rad = 0.0
        """Largest possible roll of the mount by single frames [rad]; zero while none exceeds ``REPORTED_RAD`` at 95 %."""
        # The normal of a level surface is seen under the mount's pitch; an angle across it counts as more roll.
        self._roll_per_angle = 1.0 / max(abs(math.cos(camera.mount_pitch_rad)), math.sin(REPORTED_RAD))

    def update(self, reading: TrackReading) -> None:
        """Record whether the chair moves: a standing chair shows the same nosings in each frame."""
        self._standing = max(abs(reading.left_m_s), abs(reading.right_m_s)) < STANDING_M_S

    def corrected(self, camera: PinholeCamera) -> PinholeCamera:
        """Return the camera with the declared mount error removed; the same object without one."""
        return self._corrected if self._declared is not None and camera == self._camera else camera

    @property
    def heading_sigma_rad(self) -> float:
        """Sigma of the heading from the mount [rad]; zero until an error is declared.

        A rotation about the optical axis turns an edge in the chair's xy plane by its component about z_B, the sine of the mount's
        pitch; a rotation about the pitch axis does not. An error that may be the mount's or the IMU's is not corrected and counts
        in full.
        """
        if self._camera is None:
            return 0.0
        roll_rad = 0.0
        if self._declared is not None:
            roll_rad = self._declared.roll_half_rad
        elif self._mount is None:
            roll_rad = self._possible_roll_rad
        return abs(math.sin(self._camera.mount_pitch_rad)) * roll_rad / NORMAL_95

    def step(self, axes: StairAxes, sample: ImuSample, camera: PinholeCamera) -> tuple[bool, list[Event]]:
        """Compare one frame; return whether its treads agree with gravity, and events.

        Args:
            axes: Directions of the stair.
            sample: IMU sample at the exposure of the frame.
            camera: Camera with its nominal mount.
        """
        if self._camera is None or camera != self._camera:
            self._restart(camera)
        x, y, z = rotation_of(sample.orientation)[2].tolist()
        up_B = (x, y, z)
        if not (math.isfinite(axes.t_s) and math.isfinite(x + y + z)):
            return True, []
        off_rad = math.acos(min(max(-float(axes.down_C @ (camera.R_BC.T @ np.array(up_B))), -1.0), 1.0))
        if off_rad > MOUNT_GATE_RAD:
            return False, self._report_axes(axes.t_s, off_rad)
        by_gravity = mount_angles(-axes.down_C, up_B, camera.mount_yaw_rad)
        if by_gravity is None:
            return True, []
        found = (by_gravity[0] - camera.mount_pitch_rad, by_gravity[1] - camera.mount_roll_rad)
        self._bound_roll(found[1], axes.down_sigma_rad)
        if not axes.down_sigma_rad <= TREADS_SIGMA_RAD:
            return True, []
        complete = self._add(axes, camera, found, up_B, np.array(sample.angular_velocity_rad_s))
        return True, self._report(axes.t_s, camera) if complete else []

    def _bound_roll(self, roll_rad: float, down_sigma_rad: float) -> None:
        """Update the possible roll of the mount from one frame; the mean of several frames clears it."""
        half_rad = NORMAL_95 * self._roll_per_angle * math.hypot(GRAVITY_SIGMA_RAD, down_sigma_rad)
        if abs(roll_rad) - half_rad > REPORTED_RAD:
            # A sigma that varied between frames would look like independent errors to the heading filter.
            self._possible_roll_rad = max(self._possible_roll_rad, abs(roll_rad) + half_rad)

    def _add(
        self,
        axes: StairAxes,
        camera: PinholeCamera,
        by_gravity: tuple[float, float],
        up_B: tuple[float, float, float],
        rate_B: Vector3,
    ) -> bool:
        """Add a frame to the comparisons that it belongs to; return whether a block is complete."""
        tilt_rad = math.acos(min(max(up_B[2], -1.0), 1.0))
        means = self._on_floor if tilt_rad <= LEVEL_RAD else self._elsewhere
        complete = means.add(axes.t_s, *by_gravity)
        seen_rad = math.acos(min(max(-float(axes.normal_C @ axes.down_C), -1.0), 1.0))
        if (
            self._standing
            or seen_rad < ON_A_FLIGHT_RAD
            or abs(seen_rad - tilt_rad) > SLOPE_GATE_RAD
            or math.hypot(rate_B[0], rate_B[1]) > ROCKING_RAD_S
        ):
            return complete
        pair = mount_angles(axes.normal_C, (0.0, 0.0, 1.0), camera.mount_yaw_rad)
        if pair is None:
            return complete
        pitch_rad, roll_rad = pair[0] - camera.mount_pitch_rad, pair[1] - camera.mount_roll_rad
        if math.hypot(pitch_rad, roll_rad) > MOUNT_GATE_RAD:
            return complete
        return self._riding.add(axes.t_s, pitch_rad, roll_rad) or complete

    def _report_axes(self, t_s: float, off_rad: float) -> list[Event]:
        self._far_off.add(t_s, off_rad, 0.0)
        found = self._far_off.estimate(0.0, 0.0)
        if self._axes_reported or found is None or found.pitch_rad - found.pitch_half_rad <= MOUNT_GATE_RAD:
            return []
        self._axes_reported = True
        cause = f"treads are {found.pitch_rad / DEG:.0f}° ± {found.pitch_half_rad / DEG:.0f}° off gravity: IMU axes?"
        return [Event(t_s=t_s, name="imu_axes", cause=cause)]

    def _report(self, t_s: float, camera: PinholeCamera) -> list[Event]:
        events = []
        found = self._mount = more_accurate(
            self._riding.estimate(BELTS_SIGMA_RAD, self._roll_per_angle * BELTS_SIGMA_RAD),
            self._on_floor.estimate(GRAVITY_SIGMA_RAD, self._roll_per_angle * GRAVITY_SIGMA_RAD),
        )
        if found is not None and (found.exceeds if self._declared is None else found.replaces(self._declared)):
            self._declared = found
            self._corrected = replace(
                camera,
                mount_pitch_rad=camera.mount_pitch_rad + found.pitch_rad,
                mount_roll_rad=camera.mount_roll_rad + found.roll_rad,
            )
            cause = f"camera mount is {found} (95 %) off its calibration; headings are corrected"
            events.append(Event(t_s=t_s, name="camera_mount", cause=cause))
        rest = self._elsewhere.estimate(GRAVITY_SIGMA_RAD, self._roll_per_angle * GRAVITY_SIGMA_RAD)
        if rest is None:
            return events
        suspects = "IMU or camera mount tilted?"
        if found is not None:
            rest = difference(rest, found)
            suspects = "beyond the camera mount's pitch and roll: IMU tilted, or camera yawed?"
        if not rest.exceeds:
            self._possible_roll_rad = 0.0
        if rest.exceeds and suspects not in self._suspected:
            self._suspected.add(suspects)
            events.append(Event(t_s=t_s, name="imu_tilt", cause=f"treads are {rest} (95 %) off gravity, {suspects}"))
        return events
