"""Stair detector: a frame in, a heading or nothing out.

``RgbdFrame -> HeadingMeasurement | None``; ``see`` also returns the map of the stair, ``look`` the full result with the reason of a
rejection.
"""

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from treadline.core.arrays import shaped
from treadline.core.camera_images import RgbdFrame
from treadline.core.errors import ImageError
from treadline.core.rotations import Vector3
from treadline.core.signals import HeadingMeasurement, StairMap
from treadline.perception._lattice_kernels import SIGMAS
from treadline.perception._stair_shape import StairShape
from treadline.perception.detection import StairDetection, ThresholdRule

CONFIRMED_FOR_S = 10.0
"""Time for which a confirmed flight supports frames with two steps [s]: a chair at 0.1 m/s passes two steps in 7 s."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DetectorConfig:
    """Settings of the stair detector."""

    method: Literal["paper", "robust"] = "robust"
    threshold: ThresholdRule = "median"
    """Rule for Canny's thresholds in Algorithm 1."""
    swept_half_m: float | None = None
    """Half width of the volume swept by the chair [m]: objects inside are obstacles, a narrower flight is rejected, and a single
    step (a kerb) as wide as the chair is accepted. None: no chair, no flight is too narrow, and one step is no stair."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FrameResult:
    """Result of one frame for a mission."""

    measurement: HeadingMeasurement | None
    sight: StairDetection | None
    """Full result; None for a frame that cannot be evaluated."""

    @property
    def stair_map(self) -> StairMap | None:
        """Map of the stair in the viewing direction, computed on first access; None without a heading."""
        return None if self.sight is None or not self.sight.accepted else self.sight.stair_map


class StairDetector:
    """Detector for single frames; ``see`` and ``step`` remember the last flight that a frame confirmed.

    A frame with the evidence of two steps alone, or of a third that fits badly, is unconfirmed: furniture in front of a wall can
    look the same. It counts for ``CONFIRMED_FOR_S`` after a frame that showed more, with the same rise and run.
    """

    def __init__(self, config: DetectorConfig | None = None) -> None:
        self._config = config or DetectorConfig()
        self._confirmed: tuple[float, StairShape] | None = None

    def step(self, frame: RgbdFrame, gravity_C: Vector3 | None = None) -> HeadingMeasurement | None:
        """Return the heading in a frame, or None; ``look`` gives the reason.

        Args:
            gravity_C: Vector pointing down, in the camera frame; without it the robust method estimates gravity from the treads.

        Raises:
            RecordError: If gravity is not three numbers.
        """
        return self.see(frame, gravity_C).measurement

    def see(self, frame: RgbdFrame, gravity_C: Vector3 | None = None) -> FrameResult:
        """Return heading and map of one frame.

        Raises:
            RecordError: If gravity is not three numbers.
        """
        try:
            sight = self.look(frame, gravity_C)
        except ImageError:
            return FrameResult(measurement=None, sight=None)  # the guard detects the missing measurements
        sight = self._confirmed_by_memory(frame.t_s, sight)
        return FrameResult(measurement=_measured(frame.t_s, sight), sight=sight)

    def _confirmed_by_memory(self, t_s: float, sight: StairDetection) -> StairDetection:
        """Return the detection as accepted if it is unconfirmed and continues a confirmed flight."""
        if sight.accepted and sight.shape is not None:
            self._confirmed = (t_s, sight.shape)
        if not sight.unconfirmed or sight.shape is None or self._confirmed is None:
            return sight
        since_s, known = self._confirmed
        if not 0.0 <= t_s - since_s <= CONFIRMED_FOR_S or not _same_flight(known, sight.shape):
            return sight
        return replace(sight, accepted=True, unconfirmed=False, reason=None)

    def look(self, frame: RgbdFrame, gravity_C: Vector3 | None = None, *, stages: bool = False) -> StairDetection:
        """Return the full result of a frame; ``stages`` adds the intermediate images of the paper's method.

        Raises:
            ImageError: If the image size differs from the frame's calibration.
            RecordError: If gravity is not three numbers.
        """
        if gravity_C is not None:
            gravity_C = shaped("gravity_C", gravity_C, (3,), "three numbers x, y, z")
        size = (frame.camera.height_px, frame.camera.width_px)
        for name, image in (("depth", frame.depth_m), ("colour", frame.rgb) if self._config.method == "paper" else ("", None)):
            if image is not None:
                _check_size(name, image, size)
        # Each method is loaded when it is used: a plan needs none, and a mission warms up before it moves.
        if self._config.method == "robust":
            from treadline.perception._robust_method import detect_stair

            return detect_stair(frame, gravity_C, self._config.swept_half_m)
        from treadline.perception.paper.algorithm import look_as_printed

        return look_as_printed(frame, self._config.threshold, stages=stages)


def _same_flight(known: StairShape, seen: StairShape) -> bool:
    rise_sigma_m = math.hypot(known.rise_sigma_m, seen.rise_sigma_m)
    run_sigma_m = math.hypot(known.run_sigma_m, seen.run_sigma_m)
    return (
        known.direction == seen.direction
        and abs(known.rise_m - seen.rise_m) < SIGMAS * rise_sigma_m
        and abs(known.run_m - seen.run_m) < SIGMAS * run_sigma_m
    )


def _check_size(name: str, image: np.ndarray, size: tuple[int, int]) -> None:
    if not isinstance(image, np.ndarray) or image.ndim < 2:
        kind = f"an array of shape {image.shape}" if isinstance(image, np.ndarray) else f"a {type(image).__name__}"
        raise ImageError(f"{name} is no image but {kind}; its calibration is for {size[1]}×{size[0]} pixels")
    if 0 in size:
        raise ImageError(f"{name} has no pixels: {size[1]}×{size[0]}")
    if image.shape[:2] != size:
        raise ImageError(
            f"{name} is {image.shape[1]}×{image.shape[0]} pixels, its calibration is for {size[1]}×{size[0]}; scale fx, "
            "fy, cx and cy with the image"
        )


def _measured(t_s: float, sight: StairDetection) -> HeadingMeasurement | None:
    if not sight.accepted or sight.heading_rad is None or sight.sigma_rad is None:
        return None
    return HeadingMeasurement(t_s=t_s, heading_rad=sight.heading_rad, sigma_rad=sight.sigma_rad, edge_count=sight.edge_count)
