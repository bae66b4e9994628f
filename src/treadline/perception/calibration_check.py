"""Calibration checks over the frames of one camera: what a wrong focal length, mount, image or depth scale does to many detections.

A focal length that is k times too long shrinks x and y of all points to 1/k. Unit normals (n_xy, n_z) become (k·n_xy, n_z), so that
horizontal treads and vertical risers, n_t·n_r = 0, are seen with n'_t,xy · n'_r,xy + k² n'_t,z n'_r,z = 0: each frame gives k, best
at a camera pitch of 45°. A depth scale leaves all angles; the height of the camera above the floor shows it. Gravity shows a mount
that does not fit, and an image that is turned.
"""

import math
from collections import Counter
from collections.abc import Sequence

import numpy as np

from treadline.core.angles import DEG
from treadline.core.camera_images import PinholeCamera
from treadline.core.rotations import Vector3
from treadline.perception._plane_segmentation import Surface
from treadline.perception.detection import StairDetection

LEAST_FRAMES = 5
"""Fewest frames of a finding: the median of five has two outliers to spare."""
SIGNIFICANT = 3.0
"""Number of standard deviations of a finding."""
SURFACES_SIGMA = 0.6 * DEG
"""Standard deviation of the angle between treads and risers, and of treads from gravity, that no number of frames reduces [rad]: on
23 lifelike frames, each with another stair and camera, the median deviation was 0.4°."""
HEIGHT_SIGMA_M = 0.03
"""Standard deviation of the camera's height that no number of frames reduces [m]: a mount measured by hand, and 0.5° at 1.5 m."""
UPRIGHT_LEAST = 0.5
"""Least part of gravity in the image plane by which a turned image is seen: cameras look at most 60° down."""
LEVEL = 3.0 * DEG
"""Largest angle between gravity and that of a level chair, below which the camera's height above the floor is its mount's [rad]."""
TURNED = {1: ("left", "90°"), 2: ("up", "180°"), 3: ("right", "90°")}
"""Direction of gravity in an image turned by quarter turns, and the angle."""


class CalibrationCheck:
    """Accumulates frames of one camera; ``findings`` names what does not fit, with its figure."""

    def __init__(self) -> None:
        self._meet_rad: list[float] = []
        self._focal: list[float] = []
        self._pitch_rad: list[float] = []
        self._roll_rad: list[float] = []
        self._below_m: list[float] = []
        self._quarters = Counter[int]()
        self._height_m = 0.0

    def add(self, camera: PinholeCamera, sight: StairDetection, gravity_C: Vector3 | None) -> None:
        """Add a frame, accepted or not."""
        level_C = camera.R_BC.T @ np.array([0.0, 0.0, -1.0])
        if gravity_C is not None and min(math.hypot(*gravity_C[:2]), math.hypot(*level_C[:2])) >= UPRIGHT_LEAST:
            turned = math.atan2(gravity_C[1], gravity_C[0]) - math.atan2(level_C[1], level_C[0])
            self._quarters[round(turned / (0.5 * math.pi)) % 4] += 1
        if not sight.accepted or sight.parts is None or sight.axes is None or sight.shape is None:
            return
        down, edge = sight.axes.down_C, sight.axes.edge_C
        treads, risers = _normal(sight.parts.treads, down), _normal(sight.parts.risers, np.cross(edge, down))
        across, along = float(treads[:2] @ risers[:2]), float(treads[2] * risers[2])
        if across * along < 0.0:  # both are in view
            self._focal.append(math.sqrt(-across / along))
            self._meet_rad.append(math.acos(float(treads @ risers)))
        if gravity_C is None or not treads.any():
            return
        self._pitch_rad.append(float(np.cross(gravity_C, treads) @ edge))
        self._roll_rad.append(float((treads - gravity_C) @ edge))
        if float(gravity_C @ level_C) > math.cos(LEVEL) and sight.shape.direction == "up" and camera.mount_m[2] > 0.0:
            self._height_m = camera.mount_m[2]
            below_m, rise_m = max(float(tread.centre @ down) for tread in sight.parts.treads), sight.shape.rise_m
            # The floor itself may be hidden below the camera: then it lies whole rises below the lowest tread in view.
            self._below_m.append(below_m + max(0, round((self._height_m - below_m) / rise_m)) * rise_m)

    @property
    def findings(self) -> list[str]:
        """What does not fit, one sentence each."""
        (quarter, count), *_ = [*self._quarters.most_common(1), (0, 0)]
        if quarter and count >= LEAST_FRAMES:
            points, turn = TURNED[quarter]
            return [f"turned camera: gravity points {points} in {count} frames; turn the images by {turn}, or set mount_roll_deg"]
        # A wrong focal length tilts treads as well.
        return [*(self._focal_length() or self._mount()), *self._depth_scale()]

    def _focal_length(self) -> list[str]:
        meet, sigma, differs = _median(self._meet_rad, 0.5 * math.pi, SURFACES_SIGMA)
        focal = float(np.median(self._focal)) if differs else 1.0
        angle = f"{meet / DEG:.1f} ± {1.96 * sigma / DEG:.1f}°"
        return differs * [
            f"treads and risers meet at {angle} over {len(self._meet_rad)} frames: the focal length seems {abs(focal - 1.0):.0%} "
            f"too {'long' if focal > 1.0 else 'short'}, or the risers lean; is the camera file of another resolution?"
        ]

    def _mount(self) -> list[str]:
        pitch, sigma, is_pitched = _median(self._pitch_rad, 0.0, SURFACES_SIGMA)
        roll, _, is_rolled = _median(self._roll_rad, 0.0, SURFACES_SIGMA)
        return (is_pitched or is_rolled) * [
            f"treads lie {pitch / DEG:+.1f}° about the edges and {roll / DEG:+.1f}° along them off gravity, "
            f"± {1.96 * sigma / DEG:.1f}° over {len(self._pitch_rad)} frames: correct mount_pitch_deg "
            "and mount_roll_deg in the camera file"
        ]

    def _depth_scale(self) -> list[str]:
        below_m, sigma_m, differs = _median(self._below_m, self._height_m, HEIGHT_SIGMA_M)
        return differs * [
            f"the floor lies {below_m:.2f} ± {1.96 * sigma_m:.2f} m below the camera over {len(self._below_m)} frames, mount_m "
            f"says {self._height_m:.2f} m: is the depth scale right?"
        ]


def _median(values: Sequence[float], expected: float, common: float) -> tuple[float, float, bool]:
    """Return the median, its standard deviation from scatter and what values have in common, and whether it is no other value."""
    if len(values) < LEAST_FRAMES:
        return expected, math.inf, False
    middle = float(np.median(values))
    scatter = 1.4826 * float(np.median(np.abs(np.array(values) - middle)))
    sigma = math.hypot(1.2533 * scatter / math.sqrt(len(values)), common)
    return middle, sigma, abs(middle - expected) > SIGNIFICANT * sigma


def _normal(surfaces: Sequence[Surface], towards: Vector3) -> Vector3:
    """Return the mean unit normal of surfaces by their size, towards a direction; zero without any."""
    total = sum((len(one.blocks) * np.copysign(1.0, one.unit @ towards) * one.unit for one in surfaces), np.zeros(3))
    return np.asarray(total / max(float(np.linalg.norm(total)), 1e-12))
