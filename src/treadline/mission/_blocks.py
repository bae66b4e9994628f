"""The blocks of Fig. 2 as handlers of one signal: signals in, signals out.

The in-process loop (``mission.loop``) wires the blocks by calls, the nodes (``treadline.ros``) wire the same blocks by channels.

* Camera block: ``ImuSample, TrackReading, RgbdFrame -> FrameQuality, FreeGround, HeadingMeasurement, StairMap, Event``.
* Driver block: ``ImuSample, TrackReading, FlipperReading, StairMap, OperatorInput, HeadingEstimate -> MotionPlan, TrackCommand``.
* Seat block: ``ImuSample, SeatReading -> SeatCommand``.

Rates of the blocks: 100 Hz base, 4 Hz control (Table I).
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Protocol, runtime_checkable

import numpy as np

from treadline.core.angles import wrap
from treadline.core.camera_images import PinholeCamera, RgbdFrame, StairAxes
from treadline.core.errors import ImageError
from treadline.core.rotations import Vector3, rotation_of
from treadline.core.signals import (
    TICK_S,
    Event,
    FrameQuality,
    FreeGround,
    HeadingEstimate,
    HeadingMeasurement,
    ImuSample,
    MotionPlan,
    Recent,
    SeatCommand,
    SeatReading,
    StairMap,
    TrackCommand,
    TrackReading,
    on_the_tick,
)
from treadline.estimation import MountMonitor
from treadline.mission.belt_controllers import Driver, Proposals
from treadline.mission.planner import Planner, PlannerInput
from treadline.perception import StairDetector
from treadline.perception.calibration_gate import FRAMES, CalibrationEvidence, CalibrationFault, calibration_evidence
from treadline.perception.detector import FrameResult
from treadline.perception.frame_quality import quality_of
from treadline.perception.free_ground import SWEPT_HALF_M, ground_ahead


class GravityAtExposure:
    """Attitude history of the chair. A frame arrives late, and a chair that rocks has turned since its exposure."""

    def __init__(self) -> None:
        self._attitudes: Recent[ImuSample] = Recent()

    def update(self, sample: ImuSample) -> None:
        """Remember an attitude."""
        self._attitudes.add(sample.t_s, sample)

    def exposed(self, t_s: float) -> ImuSample | None:
        """Return the IMU sample at the exposure of a frame; None before the first attitude."""
        return self._attitudes.at(t_s)

    def gravity_C(self, frame: RgbdFrame) -> Vector3 | None:
        """Return the unit vector of gravity in the camera's axes when the frame was exposed; None before the first attitude."""
        exposed = self.exposed(frame.t_s)
        return None if exposed is None else gravity_in(exposed, frame.camera)


def gravity_in(exposed: ImuSample, camera: PinholeCamera) -> Vector3:
    """Return the unit vector of gravity in the axes of a camera on the chair."""
    return np.asarray(camera.R_BC.T @ (rotation_of(exposed.orientation).T @ np.array([0.0, 0.0, -1.0])))


class Rate:
    """Period of a slower block, in whole ticks.

    Args:
        period_s: The period [s].

    Raises:
        ValueError: If the period is not a multiple of the tick.
    """

    def __init__(self, period_s: float) -> None:
        if not on_the_tick(period_s):
            raise ValueError(f"a period of {period_s} s is no multiple of the tick, {TICK_S} s")
        self._every = round(period_s / TICK_S)
        self._slot = -1

    def due(self, t_s: float) -> bool:
        """Return whether a period has begun since the last call; a lost tick delays the block, and loses no period."""
        slot = round(t_s / TICK_S) // self._every
        begun, self._slot = slot != self._slot, slot
        return begun


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

    def see(self, frame: RgbdFrame, gravity_C: Vector3 | None = None) -> Detection:
        """Return the detection in one frame."""


class CameraBlock:
    """Frame quality, the ground ahead, then stair detection, by the gravity of the frame's exposure and with the monitored mount.

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
        self._evidence: CalibrationEvidence | None = None
        self._fault: CalibrationFault | None = None

    def update(self, reading: ImuSample | TrackReading) -> None:
        """Remember an attitude, or whether the chair moves."""
        if isinstance(reading, ImuSample):
            self._gravity.update(reading)
        else:
            self._mount.update(reading)

    def step(
        self, frame: RgbdFrame, admit: Callable[[FrameQuality], bool]
    ) -> Iterator[FrameQuality | FreeGround | HeadingMeasurement | StairMap | Event]:
        """Yield the quality of a frame and, if ``admit`` accepts the quality, the ground ahead, heading and stair map.

        Events report errors of the camera's calibration and mount and of the IMU's axes. A frame whose treads contradict gravity
        has no heading, and no frame has one while the calibration has a fault.
        """
        nominal = frame.camera
        frame = self._corrected(frame, nominal)
        exposed = self._gravity.exposed(frame.t_s)
        gravity_C = None if exposed is None else gravity_in(exposed, frame.camera)
        ground = None if gravity_C is None else ground_ahead(frame, gravity_C, self._swept_half_m)
        quality = quality_of(frame, None if ground is None else ground.obstacle_m)
        yield quality
        if not admit(quality):
            return
        if ground is not None:
            yield ground.free
        detection = self._detector.see(frame, gravity_C)
        faults = self._check_calibration(frame.t_s, nominal, exposed, detection)
        agrees, events = self._check_mount(frame, nominal, exposed, detection)
        corrected = self._corrected(frame, nominal)
        before = detection.measurement
        if exposed is not None and corrected is not frame:
            # The mount error was declared, or declared anew, by this frame.
            detection = self._detector.see(corrected, gravity_in(exposed, corrected.camera))
        if agrees and self._fault is None:
            measurement = detection.measurement
            if measurement is not None:
                yield self._with_mount(measurement if corrected is frame else _with_correction(measurement, before))
            stair_map = detection.stair_map  # made when it is asked for, after the heading has been used
            if stair_map is not None:
                yield stair_map
        yield from (*faults, *events)

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

    def _check_calibration(
        self, t_s: float, nominal: PinholeCamera, exposed: ImuSample | None, detection: Detection
    ) -> list[Event]:
        """Add the first frames to the evidence of the calibration; return an event of a fault that the monitor does not correct."""
        known = self._evidence if self._evidence is not None and self._evidence.camera == nominal else None
        if exposed is None or not isinstance(detection, FrameResult) or detection.sight is None:
            return []
        if known is not None and known.frames >= FRAMES and self._fault is None:
            return []
        new = calibration_evidence(detection.sight, nominal, gravity_in(exposed, nominal))
        if new is None:
            return []
        before, self._evidence = self._fault, new if known is None else known + new
        fault = self._evidence.fault
        self._fault = None if fault is None or fault.cause == "mount" else fault
        if self._fault is None or before is not None:
            return []
        return [Event(t_s=t_s, name="camera_calibration", cause=f"{self._fault.text}; no headings")]

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


class DriverBlock:
    """Planner at each tick, belt controller at its own period."""

    def __init__(self, planner: Planner, driver: Driver) -> None:
        self._planner = planner
        self._proposals = Proposals(driver)
        self._rate = Rate(driver.period_s)
        self.is_due = False
        """Whether a control period began at the last call of ``propose``."""

    def update(self, signal: PlannerInput) -> None:
        """Update the planner with a reading or a stair map."""
        self._planner.update(signal)

    def plan(self, t_s: float, estimate: HeadingEstimate | None) -> MotionPlan:
        """Return the plan of a tick."""
        return self._planner.step(t_s, estimate)

    @property
    def to_go_m(self) -> float | None:
        """Distance along the belts to the last nosing of the flight [m]; None while it is not known."""
        return self._planner.to_go_m

    def propose(self, plan: MotionPlan, estimate: HeadingEstimate | None, *, held: bool) -> TrackCommand | None:
        """Return the proposed belt speeds of a tick; None leaves the last proposal in force.

        Args:
            plan: The plan of this tick.
            estimate: The newest heading.
            held: Whether the guard holds the chair.
        """
        self.is_due = self._rate.due(plan.t_s)
        return self._proposals.step(plan, estimate, held=held, due=self.is_due)


@runtime_checkable
class SeatLeveller(Protocol):
    """Control loop of the seat."""

    def step(self, reading: SeatReading, imu: ImuSample | None) -> SeatCommand:
        """Return the rate of the seat actuator."""


class SeatBlock:
    """Levels the seat by its own reading and the last sample of the chassis' IMU."""

    def __init__(self, leveller: SeatLeveller) -> None:
        self._leveller = leveller
        self._imu: ImuSample | None = None

    def update(self, sample: ImuSample) -> None:
        """Remember an IMU sample."""
        self._imu = sample

    def step(self, reading: SeatReading) -> SeatCommand:
        """Return the command that answers a reading."""
        return self._leveller.step(reading, self._imu)
