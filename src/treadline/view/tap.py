"""Tap of a running mission: signals and detections in, rows and notes for the tape out. The mission is not affected.

``Signal | Truth -> row``, ``RgbdFrame, Detection -> Look``.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from jaxtyping import Float

from treadline.core.angles import attitude_of
from treadline.core.images import PinholeCamera, RgbdFrame
from treadline.core.ports import Truth
from treadline.core.signals import TICK_S, Event, FlipperReading, HeadingEstimate, TrackCommand
from treadline.mission.blocks import Detection, Detector
from treadline.perception.detection import StairDetection
from treadline.perception.overlay import BAND_PX, as_jpeg, overlay
from treadline.perception.plane_segmentation import Surface
from treadline.playback.builder import seat_angle_of
from treadline.view.tape import COLUMNS, DEPTH_STEP, Look

PICTURE_PX = 480
"""Width of the camera image in the panel [px]."""


@dataclass(slots=True, kw_only=True)
class Tap:
    """Collector of the rows, events and camera frames since the last ``take``.

    Args:
        fixed_flipper_rad: Angle of the approach section of a chair without a driven flipper [rad].
        payload_shift_m: Returns the present shift of the passenger's centre of mass in the seat [m]: forward, left, up.
    """

    fixed_flipper_rad: float
    payload_shift_m: Callable[[], tuple[float, float, float]]
    rows: list[list[float]] = field(default_factory=list)
    events: list[Event] = field(default_factory=list)
    looks: list[Look] = field(default_factory=list)
    now_s: float = 0.0
    """Time of the newest row [s]."""
    _flipper_rad: float | None = None
    _estimate: HeadingEstimate | None = None
    _command: TrackCommand | None = None
    _travel_m: list[float] = field(default_factory=lambda: [0.0, 0.0])

    def sink(self, signal: Any) -> None:
        """Take one signal of the run, as a log does."""
        match signal:
            case Truth():
                self.rows.append(self._row(signal))
                self.now_s = signal.t_s
            case HeadingEstimate():
                self._estimate = signal
            case TrackCommand():
                self._command = signal
            case FlipperReading():
                self._flipper_rad = signal.angle_rad
            case Event():
                self.events.append(signal)
            case _:
                pass

    def _row(self, truth: Truth) -> list[float]:
        quaternion = attitude_of(np.array(truth.yaw_rad), np.array(truth.pitch_rad), np.array(truth.roll_rad))
        if self.rows or truth.t_s > 0.0:
            self._travel_m[0] += truth.left_m_s * TICK_S
            self._travel_m[1] += truth.right_m_s * TICK_S
        place = (truth.chassis_x_m, truth.chassis_y_m, truth.chassis_z_m)
        estimate, command = self._estimate, self._command
        return [
            truth.t_s,
            *place,
            *quaternion.tolist(),
            float(seat_angle_of(*(np.array([angle]) for angle in (truth.pitch_rad, truth.roll_rad, truth.seat_pitch_rad)))[0]),
            self.fixed_flipper_rad if self._flipper_rad is None else self._flipper_rad,
            truth.left_m_s,
            truth.right_m_s,
            *self._travel_m,
            truth.heading_rad,
            math.nan if estimate is None else estimate.heading_rad,
            math.nan if estimate is None else estimate.sigma_rad,
            truth.pitch_rad,
            truth.pitch_rate_rad_s,
            truth.seat_pitch_rad,
            truth.stability_margin_rad,
            math.nan if command is None else command.left_m_s,
            math.nan if command is None else command.right_m_s,
            0.0 if command is None else float(command.brake),
            math.nan,  # the tape computes the slip ratio
            truth.friction_use,
            truth.contact_force_share,
            truth.left_force_n,
            truth.right_force_n,
            *self.payload_shift_m(),
        ]

    def take(self) -> tuple[Float[np.ndarray, "n c"], list[Event], list[Look]]:
        """Return what was collected since the last call."""
        rows = np.array(self.rows).reshape(len(self.rows), len(COLUMNS))
        taken = rows, self.events, self.looks
        self.rows, self.events, self.looks = [], [], []
        return taken


class TappedDetector:
    """Detector that shows each of its frames to ``note`` and returns the same detections.

    Args:
        detector: Detector of the mission.
        note: Receives frame and detection.
    """

    def __init__(self, detector: Detector, note: Callable[[RgbdFrame, Detection], None]) -> None:
        self._detector, self._note = detector, note

    def see(self, frame: RgbdFrame, gravity_C: Float[np.ndarray, " 3"] | None = None) -> Detection:
        """Return the detection in one frame."""
        detection = self._detector.see(frame, gravity_C)
        self._note(frame, detection)
        return detection

    def __getattr__(self, name: str) -> Any:
        return getattr(self._detector, name)


def look_of(frame: RgbdFrame, detection: Detection, taken_s: float, *, with_picture: bool) -> Look:
    """Return the note of a frame and its detection.

    Args:
        taken_s: Time at which the mission received the frame [s].
        with_picture: Whether the image with its overlay is drawn: 10 ms.
    """
    sight = getattr(detection, "sight", None)
    measurement, stair = detection.measurement, detection.stair_map
    if isinstance(sight, StairDetection):
        reason = sight.reason
        line, rows = sight.printed()
        summary = "; ".join([line, *(f"{key} {value}" for key, value in rows)])
    else:
        reason = None if measurement is not None else "no heading in this frame"
        summary = reason or f"heading from {measurement.edge_count} nosings" if measurement is not None else str(reason)
    return Look(
        t_s=frame.t_s,
        taken_s=taken_s,
        reason=reason,
        heading_rad=None if measurement is None else measurement.heading_rad,
        sigma_rad=None if measurement is None else measurement.sigma_rad,
        edge_count=0 if measurement is None else measurement.edge_count,
        nosings_B=np.zeros((0, 3)) if stair is None else stair.nosings_B,
        summary=summary,
        treads_B=_planes(frame, sight, "treads"),
        risers_B=_planes(frame, sight, "risers"),
        picture=picture_of(frame, sight) if with_picture else None,
        depth_m=frame.depth_m[::DEPTH_STEP, ::DEPTH_STEP].astype(np.float32) if with_picture else None,
    )


def _planes(frame: RgbdFrame, sight: object, name: Literal["treads", "risers"]) -> Float[np.ndarray, "n 4 3"]:
    """Return the corners of the detected treads or risers in B; none without the robust detector."""
    if not isinstance(sight, StairDetection) or sight.parts is None:
        return np.zeros((0, 4, 3))
    camera = frame.camera
    corners_C = np.array([corners_of(surface, camera) for surface in getattr(sight.parts, name)]).reshape(-1, 4, 3)
    return np.asarray(corners_C @ camera.R_BC.T + np.array(camera.mount_m))


def corners_of(surface: Surface, camera: PinholeCamera) -> Float[np.ndarray, "4 3"]:
    """Return the corners of a surface in C [m]: upper left, upper right, lower right, lower left.

    Its upper and its lower edge in the image are replaced by straight lines, and their ends lie on the plane.
    """
    columns = surface.upper.columns.astype(float)
    ends = np.array([columns.min(), columns.max()])
    edges = [np.polyval(np.polyfit(columns, rows, min(len(np.unique(columns)) - 1, 1)), ends) for rows in _rows_of(surface)]
    u, v = np.array([ends[0], ends[1], ends[1], ends[0]]), np.concatenate([edges[0], edges[1][::-1]])
    rays = camera.pixel_to_point(u, v)
    return np.asarray(rays / (rays @ surface.normal)[:, None])


def _rows_of(surface: Surface) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, " k"]]:
    return np.asarray(surface.upper.rows, dtype=float), np.asarray(surface.lower.rows, dtype=float)


def picture_of(frame: RgbdFrame, sight: object) -> bytes:
    """Return the image of a frame with the detected objects as JPEG."""
    return as_jpeg(overlay(frame, sight)[:-BAND_PX] if isinstance(sight, StairDetection) else frame.rgb, PICTURE_PX)
