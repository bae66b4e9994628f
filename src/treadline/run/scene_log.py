"""Scene of a run for its log: what RViz, Foxglove and PlotJuggler need to show it, derived from the run's signals.

``signals, ground truth -> /tf, /tf_static, /odom, /joint_states, /robot_description, /chair, /stair/true, /stair/seen, /plan``, and
with images ``/camera/overlay/compressed``. Frames: ``world`` (W) holds ``odom``, whose place is corrected by the ground truth, and
``odom`` holds ``base_link`` (B) by dead reckoning, as a localisation would do it (REP 105). Without ground truth ``odom`` is the
root. Everything is a function of the signals: the same signals give the same bytes.
"""

import math
import time
from array import array
from collections.abc import Callable
from types import TracebackType

import numpy as np

from treadline.core.angles import DEG
from treadline.core.camera_images import RgbdFrame
from treadline.core.ports import Truth
from treadline.core.processes import deferred
from treadline.core.rotations import Rotation, Vector3, attitude_of, quaternion_of, rotation_of
from treadline.core.signals import (
    PERIOD_ROUNDING_S,
    TICK_S,
    FlipperReading,
    HeadingMeasurement,
    ImuSample,
    MotionPlan,
    SeatReading,
    StairMap,
    TrackReading,
)
from treadline.io.mcap_log import RunLog
from treadline.io.messages import camera_name, joints, optical_frame
from treadline.io.scene_messages import (
    BASE,
    FramePose,
    camera_frames,
    compressed_message,
    frames_message,
    marker_of,
    markers_message,
    odometry_message,
    text_message,
)
from treadline.io.stair_markers import nosings_marker
from treadline.mission import Detection, Detector
from treadline.mission.loop import Signal
from treadline.mission.odometry import DeadReckoning, Odometry
from treadline.perception.detector import FrameResult
from treadline.perception.overlay import as_jpeg, overlay
from treadline.scenario.chair import ChairDescription
from treadline.scenario.scenario import Belts, Chair
from treadline.vehicle.appearance import LINKAGE_BODIES, chair_parts, resting_lugs, stair_parts
from treadline.vehicle.bodies import Vehicle, flipper_turns, vehicle
from treadline.vehicle.linkage import SeatLinkage
from treadline.vehicle.staircase import Staircase
from treadline.vehicle.urdf import urdf

SCENE_TICKS = 5
"""Ticks between two transforms: 20 Hz, as the nodes publish odometry. The chair moves 10 mm in between."""
BATCH = 500
"""Signals that are written together: those of half a second, 1 MB of messages at most."""
PLAN_TICKS = 10
"""Ticks between two plans of an unchanged phase: 10 Hz."""


class SceneLog:
    """Run log that also holds the scene: takes signals as ``RunLog`` does, and writes the scene's messages in between.

    Signals wait for each other: written in batches they take half the time, because the code of a run does not fit into the
    processor's first caches. The end of the context writes those that still wait.

    Args:
        log: Log to write.
        chair: Chair without a shift of the seat.
        loading: Payload, with the seat's shift.
        belts: Lug profile; None: smooth belts.
        staircase: Staircase of a simulated run; None for a recording of an unknown stair.
    """

    def __init__(
        self,
        log: RunLog,
        chair: ChairDescription,
        loading: Chair,
        *,
        belts: Belts | None = None,
        staircase: Staircase | None = None,
    ) -> None:
        self._log = log
        self._linkage = None if chair.seat is None else SeatLinkage(chair.seat)
        self._chair, self._vehicle = chair, vehicle(chair, loading)
        self._turning = self._vehicle.turning
        self._has_truth = staircase is not None
        self._placed_s: float | None = None
        self._reckoning = DeadReckoning()
        self._odometry: Odometry | None = None
        self._stroke_m: float | None = None
        self._flipper_rad = chair.tracks.approach_angle_deg * DEG
        self._measured: HeadingMeasurement | None = None
        self._phase: tuple[str, str | None] = ("", None)
        self._waiting: list[tuple[Signal | Truth, float | None]] = []
        with deferred():
            self._begin(chair, loading, belts, staircase)

    def __enter__(self) -> "SceneLog":
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._flush()

    def __call__(self, signal: Signal | Truth, taken_s: float | None = None) -> None:
        """Take one signal; a frame is written at once, because its images may be rendered as they are read."""
        self._waiting.append((signal, taken_s))
        if len(self._waiting) >= BATCH or isinstance(signal, RgbdFrame):
            self._flush()

    def plan(self, plan: MotionPlan) -> None:
        """Take the plan of a tick; it is written where its phase or hold is new, and at 10 Hz."""
        phase = (plan.phase, plan.hold)
        if phase != self._phase or _is_due(plan.t_s, PLAN_TICKS):
            self._phase = phase
            self._waiting.append((plan, plan.t_s))

    def _flush(self) -> None:
        with deferred():
            waiting, self._waiting = self._waiting, []
            for signal, taken_s in waiting:
                self._write(signal, taken_s)

    def _write(self, signal: Signal | Truth, taken_s: float | None) -> None:
        """Write one signal, and the messages of the scene that follow from it."""
        self._log.add(self._log.messages(signal), signal.t_s, taken_s)
        match signal:
            case ImuSample():
                self._reckoning.update(signal)
            case TrackReading():
                odometry = self._reckoning.step(signal)
                self._odometry = self._odometry if odometry is None else odometry
                if not self._has_truth:
                    self._place_by_odometry(signal.t_s, taken_s)
            case SeatReading():
                self._stroke_m = signal.stroke_m
            case FlipperReading():
                self._flipper_rad = signal.angle_rad
            case HeadingMeasurement():
                self._measured = signal
            case StairMap():
                measured = self._measured
                heading_rad = 0.0 if measured is None or measured.t_s != signal.t_s else measured.heading_rad
                seen = nosings_marker(signal, heading_rad)
                self._log.add([markers_message("/stair/seen", signal.t_s, [seen])], signal.t_s, taken_s)
            case Truth():
                self._has_truth = True
                if _is_due(signal.t_s, SCENE_TICKS):
                    self._place(signal.t_s, taken_s, signal)

    def saw(self, frame: RgbdFrame, seen: object) -> None:
        """Write the image with the detection of a frame whose images are kept."""
        self._flush()
        if frame.t_s == self._log.kept_frame_s and isinstance(seen, FrameResult) and seen.sight is not None:
            image, optical = as_jpeg(overlay(frame, seen.sight)), optical_frame(camera_name(frame.camera))
            with deferred():
                self._log.add([compressed_message("/camera/overlay/compressed", frame.t_s, optical, image)], frame.t_s)

    def _begin(self, chair: ChairDescription, loading: Chair, belts: Belts | None, staircase: Staircase | None) -> None:
        """Write what does not change: description, fixed frames, and meshes of chair and stair."""
        cameras = [chair.camera_at(), *([] if chair.rear_camera is None else [chair.camera_at(rear=True)])]
        fixed = [*_fixed_frames(self._vehicle), *(frame for camera in cameras for frame in camera_frames(camera))]
        drawn = (*chair_parts(chair, loading, belts), *resting_lugs(chair, belts))
        messages = [
            text_message("/robot_description", urdf(chair, loading)),
            markers_message("/chair", 0.0, [marker_of(part, part.body) for part in drawn if part.body not in LINKAGE_BODIES]),
        ]
        if staircase is not None:
            fixed.append(
                FramePose(
                    parent="world", child="stair", place_m=tuple(staircase.p_WS.tolist()), quaternion=quaternion_of(staircase.R_WS)
                )
            )
            messages.append(markers_message("/stair/true", 0.0, [marker_of(part, "world") for part in stair_parts(staircase)]))
        self._log.add([frames_message("/tf_static", 0.0, fixed), *messages], 0.0)

    def _place(self, t_s: float, taken_s: float | None, truth: Truth | None) -> None:
        """Write frames, joint angles and odometry of one instant."""
        odometry = self._odometry
        q_OB, p_OB = ((1.0, 0.0, 0.0, 0.0), np.zeros(3)) if odometry is None else (odometry.orientation, odometry.p_OB)
        moved = FramePose(parent="odom", child=BASE, place_m=tuple(p_OB.tolist()), quaternion=q_OB)
        poses = [moved]
        if truth is not None and not math.isnan(truth.chassis_x_m):
            poses.insert(0, _corrected(truth, rotation_of(q_OB), p_OB))
        seat_rad = 0.0 if self._linkage is None or self._stroke_m is None else self._linkage.nearest_angle(self._stroke_m)
        turns = {"seat": seat_rad, **flipper_turns(self._chair, self._flipper_rad)}
        for body, _ in self._turning:
            half = 0.5 * turns[body.name]
            quaternion = np.array([math.cos(half), 0.0, math.sin(half), 0.0])
            poses.append(FramePose(parent="chair", child=body.name, place_m=body.origin_m, quaternion=quaternion))
        messages = [frames_message("/tf", t_s, poses)]
        if self._turning:
            names = tuple(f"{body.name}_joint" for body, _ in self._turning)
            turned = tuple(turns[body.name] * hinge.axis[1] for body, hinge in self._turning)
            messages.append(joints("/joint_states", t_s, names, turned, (), "chair"))
        if odometry is not None:
            messages.append(odometry_message("/odom", t_s, moved, odometry.speed_m_s, odometry.angular_velocity_rad_s))
        self._log.add(messages, t_s, taken_s)

    def _place_by_odometry(self, t_s: float, taken_s: float | None) -> None:
        """Place the chair without ground truth at 20 Hz: a recording's readings are not on the ticks.

        The first reading is too early: the first ground truth follows it.
        """
        if self._placed_s is None:
            self._placed_s = t_s
        elif t_s - self._placed_s >= SCENE_TICKS * TICK_S - PERIOD_ROUNDING_S:
            self._placed_s = t_s
            self._place(t_s, taken_s, None)


class WatchedDetector:
    """Stair detector that hands each frame and its result to a log or a viewer.

    Args:
        detector: Detector in use.
        saw: Receives frame and result.
    """

    def __init__(self, detector: Detector, saw: Callable[[RgbdFrame, Detection], None]) -> None:
        self._detector, self._saw = detector, saw
        self.spent_s = array("d")
        """Time of the detector in each frame [s]."""

    def see(self, frame: RgbdFrame, gravity_C: Vector3 | None = None) -> Detection:
        """Return what the detector returns for a frame."""
        started = time.perf_counter()
        seen = self._detector.see(frame, gravity_C)
        self.spent_s.append(time.perf_counter() - started)
        self._saw(frame, seen)
        return seen


def _is_due(t_s: float, ticks: int) -> bool:
    return round(t_s / TICK_S) % ticks == 0


def _corrected(truth: Truth, R_OB: Rotation, p_OB: Vector3) -> FramePose:
    """Return the pose of the odometry's frame in W with which the chair is where it is."""
    R_WB = rotation_of(attitude_of(np.array(truth.yaw_rad), np.array(truth.pitch_rad), np.array(truth.roll_rad)))
    R_WO = R_WB @ R_OB.T
    p_WO = np.array([truth.chassis_x_m, truth.chassis_y_m, truth.chassis_z_m]) - R_WO @ p_OB
    return FramePose(parent="world", child="odom", place_m=tuple(p_WO.tolist()), quaternion=quaternion_of(R_WO))


def _fixed_frames(whole: Vehicle) -> list[FramePose]:
    """Return the frames of the URDF's fixed links and of the IMU, which is read in the chair's axes."""
    frames = [FramePose(parent=BASE, child=name, place_m=(0.0, 0.0, 0.0)) for name in ("chair", "imu")]
    for body in whole.bodies:
        if body.parent is not None and body.hinge is None:
            frames.append(FramePose(parent=body.parent, child=body.name, place_m=body.origin_m))
        frames += [
            FramePose(parent=body.name, child=f"{shape.name}_pulley", place_m=shape.centre_m)
            for shape in body.shapes
            if shape.kind == "cylinder"
        ]
    return frames
