"""Camera block: ``ImuSample, TrackReading, RgbdFrame -> FrameQuality, HeadingMeasurement, StairMap, Event``."""

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from treadline.core.angles import wrap
from treadline.core.errors import ImageError
from treadline.core.images import PinholeCamera, RgbdFrame, StairAxes
from treadline.core.signals import Event, FrameQuality, HeadingMeasurement, ImuSample, StairMap, TrackReading
from treadline.estimation import MountMonitor
from treadline.mission.frame_gravity import GravityAtExposure, gravity_in
from treadline.perception import StairDetector
from treadline.perception.detector import FrameResult
from treadline.perception.flat_ground import SWEPT_HALF_M
from treadline.perception.frame_quality import quality_of

LOOK_AGAIN_S = 1.0
"""Interval between two looks without gravity at frames without a stair [s]: at 8 ms a look, 1 % of a core."""


@runtime_checkable
class Detection(Protocol):
    """Result of a stair detector for one frame."""

    @property
    def measurement(self) -> HeadingMeasurement | None:
        """Measured heading, None where no stair is detected."""

    @property
    def stair_map(self) -> StairMap | None:
        """Stair ahead, None where no stair is detected.

        In a map without ``left_seen_m`` and ``right_seen_m`` the width of the flight is not checked before the chair enters it.
        """


@runtime_checkable
class Detector(Protocol):
    """Stair detector: a frame and the direction of gravity in, heading and stair map out."""

    def see(self, frame: RgbdFrame, gravity_C: Float[np.ndarray, " 3"] | None = None) -> Detection:
        """Return the detection in one frame."""


class CameraBlock:
    """Frame quality, then stair detection, by the gravity of the frame's exposure and with the monitored mount.

    Args:
        detector: Stair detector.
        swept_half_m: Half of the width that the chair sweeps [m].
    """

    def __init__(self, detector: Detector, swept_half_m: float = SWEPT_HALF_M) -> None:
        self._detector = detector
        self._swept_half_m = swept_half_m
        self._gravity = GravityAtExposure()
        self._mount = MountMonitor()
        self._looked_s = -math.inf
        self._gravity_agrees = False
        """Whether a frame with a stair has agreed with gravity: the IMU's axes are right."""

    def update(self, reading: ImuSample | TrackReading) -> None:
        """Remember an attitude, or whether the chair moves."""
        if isinstance(reading, ImuSample):
            self._gravity.update(reading)
        else:
            self._mount.update(reading)

    def step(
        self, frame: RgbdFrame, admit: Callable[[FrameQuality], bool]
    ) -> Iterator[FrameQuality | HeadingMeasurement | StairMap | Event]:
        """Yield the quality of a frame and, if ``admit`` accepts the quality, the detected heading and stair map.

        Events report errors of the camera's mount and of the IMU's axes. A frame whose treads contradict gravity has no heading.
        """
        nominal = frame.camera
        frame = self._corrected(frame, nominal)
        exposed = self._gravity.exposed(frame.t_s)
        gravity_C = None if exposed is None else gravity_in(exposed, frame.camera)
        quality = quality_of(frame, gravity_C, self._swept_half_m)
        yield quality
        if not admit(quality):
            return
        detection = self._detector.see(frame, gravity_C)
        agrees, events = self._check_mount(frame, nominal, exposed, detection)
        corrected = self._corrected(frame, nominal)
        before = detection.measurement
        if exposed is not None and corrected is not frame:
            # The mount error was declared, or declared anew, by this frame.
            detection = self._detector.see(corrected, gravity_in(exposed, corrected.camera))
        if agrees:
            measurement = detection.measurement
            if measurement is not None:
                yield self._with_mount(measurement if corrected is frame else _with_correction(measurement, before))
            stair_map = detection.stair_map  # made when it is asked for, after the heading has been used
            if stair_map is not None:
                yield stair_map
        yield from events

    def _corrected(self, frame: RgbdFrame, nominal: PinholeCamera) -> RgbdFrame:
        """Return the frame with the corrected mount, the same object where nothing changes."""
        camera = self._mount.corrected(nominal)
        return frame if camera is frame.camera else replace(frame, camera=camera)

    def _with_mount(self, measurement: HeadingMeasurement) -> HeadingMeasurement:
        """Return a heading with the mount's uncertainty included, unchanged for a mount without a known error."""
        sigma_rad = self._mount.heading_sigma_rad
        if sigma_rad == 0.0:
            return measurement
        return replace(measurement, sigma_rad=math.hypot(measurement.sigma_rad, sigma_rad))

    def _check_mount(
        self, frame: RgbdFrame, nominal: PinholeCamera, exposed: ImuSample | None, detection: Detection
    ) -> tuple[bool, list[Event]]:
        """Update the monitor; return whether the treads agree with gravity, and events."""
        if exposed is None or not isinstance(detection, FrameResult):
            return True, []
        if detection.measurement is None:
            axes = self._axes_without_gravity(frame)
        else:
            axes = None if detection.sight is None else detection.sight.axes
        if axes is None:
            return True, []
        agrees, events = self._mount.step(axes, exposed, nominal)
        self._gravity_agrees |= agrees
        return agrees, events

    def _axes_without_gravity(self, frame: RgbdFrame) -> StairAxes | None:
        """Return the axes of a stair that is only found without gravity, at intervals; None once gravity has been confirmed."""
        due = not 0.0 <= frame.t_s - self._looked_s < LOOK_AGAIN_S
        if self._gravity_agrees or not due or not isinstance(self._detector, StairDetector):
            return None
        self._looked_s = frame.t_s
        try:
            return self._detector.look(frame).axes
        except ImageError:
            return None


def _with_correction(measurement: HeadingMeasurement, before: HeadingMeasurement | None) -> HeadingMeasurement:
    """Return a heading by a mount that is corrected with this frame, with its difference from the heading by the mount before."""
    if before is None:
        return measurement
    return replace(measurement, correction_rad=wrap(measurement.heading_rad - before.heading_rad))
