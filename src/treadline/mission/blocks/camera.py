"""Camera block: ``ImuSample, RgbdFrame -> FrameQuality, HeadingMeasurement, StairMap``."""

from collections.abc import Callable, Iterator
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from treadline.mission.gravity import GravityAtExposure
from treadline.perception.detection import SWEPT_HALF_M
from treadline.perception.quality import quality_of
from treadline.signals import FrameQuality, HeadingMeasurement, ImuSample, RgbdFrame, StairMap


@runtime_checkable
class Detection(Protocol):
    """Result of a stair detector for one frame."""

    @property
    def measurement(self) -> HeadingMeasurement | None:
        """Measured heading, None where no stair is detected."""

    @property
    def stair_map(self) -> StairMap | None:
        """Stair ahead, None where no stair is detected."""


@runtime_checkable
class Detector(Protocol):
    """Stair detector: a frame and the direction of gravity in, heading and stair map out."""

    def see(self, frame: RgbdFrame, gravity_C: Float[np.ndarray, " 3"] | None = None) -> Detection:
        """Return the detection in one frame."""


class CameraBlock:
    """Frame quality, then stair detection, by the gravity of the frame's exposure.

    Args:
        detector: Stair detector.
        swept_half_m: Half of the width that the chair sweeps [m].
    """

    def __init__(self, detector: Detector, swept_half_m: float = SWEPT_HALF_M) -> None:
        self._detector = detector
        self._swept_half_m = swept_half_m
        self._gravity = GravityAtExposure()

    def update(self, sample: ImuSample) -> None:
        """Remember an attitude."""
        self._gravity.update(sample)

    def step(
        self, frame: RgbdFrame, admit: Callable[[FrameQuality], bool]
    ) -> Iterator[FrameQuality | HeadingMeasurement | StairMap]:
        """Yield the quality of a frame and, if ``admit`` accepts the quality, the detected heading and stair map."""
        gravity_C = self._gravity.gravity_C(frame)
        quality = quality_of(frame, gravity_C, self._swept_half_m)
        yield quality
        if not admit(quality):
            return
        detection = self._detector.see(frame, gravity_C)
        if detection.measurement is not None:
            yield detection.measurement
        stair_map = detection.stair_map  # made when it is asked for, after the heading has been used
        if stair_map is not None:
            yield stair_map
