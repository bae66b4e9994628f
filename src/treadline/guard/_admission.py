"""Admission of readings: which of them may be used (rows 2, 3, 4, 6 and 10).

``Reading | FrameQuality -> bool``. The guard composes it; each node that uses readings has an admission of its own and, from the
same readings, comes to the same answers. Frames that are frozen, without depth, dark or glaring are rejected (rows 2, 3 and 4).
"""

import math

from treadline.core.ports import Reading
from treadline.core.signals import (
    FlipperReading,
    FrameQuality,
    HeadingMeasurement,
    ImuSample,
    OperatorInput,
    SeatReading,
    StairMap,
    TrackReading,
)
from treadline.guard._belt_monitor import BeltTravel
from treadline.guard._guard_config import GuardConfig
from treadline.guard._sensor_timeouts import Timestamps
from treadline.guard._speed_limits import finite


class FrameMonitor:
    """Judges frames by their quality, and measurements of a camera without images by whether they change."""

    def __init__(self, config: GuardConfig) -> None:
        self._config = config
        self._fingerprint: int | None = None
        self._values: dict[str, tuple[object, float]] = {}
        self._blind = False
        self.refused = ""
        """Why the last frame was rejected; empty if it was accepted."""
        self.is_alive = False
        """Whether the camera delivers new images, even if too poor to detect a stair."""
        self.is_dark = False
        """Whether the last frame was too dark, glaring or flat for its colours to be used."""

    def accept_frame(self, quality: FrameQuality) -> bool:
        """Return whether a stair can be detected in a frame."""
        before, self._fingerprint = self._fingerprint, quality.fingerprint
        frozen = quality.fingerprint == before
        self.refused = self._fault(quality, frozen=frozen)
        # Across a landing and out into a wide room a frame has no depth at all, but it has colours.
        self.is_alive = not frozen and (quality.valid_share >= self._config.alive_least or not self.is_dark)
        self._blind = bool(self.refused)
        return not self._blind

    def accept_measurement(self, kind: str, value: object, travel_m: float) -> bool:
        """Return whether a measurement has changed, or the chair has hardly moved since; False after a rejected frame."""
        if self._blind:
            return False
        before, since_m = self._values.get(kind, (None, 0.0))
        if value != before:
            self._values[kind] = (value, travel_m)
            since_m = travel_m
        frozen = abs(travel_m - since_m) > self._config.frozen_travel_m
        self.refused = "is frozen" if frozen else ""
        return not frozen

    def _fault(self, quality: FrameQuality, *, frozen: bool) -> str:
        limits = self._config
        if not all(math.isfinite(value) for value in (quality.brightness, quality.contrast, quality.valid_share)):
            self.is_dark = True
            return "is no image"
        self.is_dark = abs(quality.brightness - 0.5) > 0.5 - limits.dark or quality.contrast < limits.contrast_least
        if frozen:
            return "is frozen"
        if quality.valid_share < limits.valid_least:
            return f"has {quality.valid_share:.0%} of its depth"
        if self.is_dark and quality.valid_share < limits.valid_least_dark:
            return f"is dark or glaring and has {quality.valid_share:.0%} of its depth"
        return ""


class ReadingAdmission:
    """Accepts readings that are new, finite, from a sensor that is not frozen, and from frames of sufficient quality."""

    def __init__(self, config: GuardConfig) -> None:
        self.timestamps = Timestamps(config.ahead_s, config.clock_jump_s)
        self.frames = FrameMonitor(config)
        self._travel = BeltTravel()

    def advance(self, t_s: float) -> None:
        """Set the clock that stamps are compared with."""
        self.timestamps.advance(t_s)

    def admit(self, signal: Reading | FrameQuality) -> bool:
        """Return whether a reading may be used; each reading is asked for once."""
        return self.is_new(signal) and self.is_sound(signal)

    def is_new(self, signal: Reading | FrameQuality) -> bool:
        """Return whether the stamp of a reading is acceptable."""
        kind = "operator" if isinstance(signal, OperatorInput) else type(signal).__name__
        return self.timestamps.accept_reading(kind, signal.t_s)

    def is_sound(self, signal: Reading | FrameQuality) -> bool:
        """Return whether the content of a new reading is acceptable."""
        match signal:
            case ImuSample():
                return finite(*signal.orientation, *signal.angular_velocity_rad_s, *signal.linear_acceleration_m_s2)
            case TrackReading():
                usable = finite(signal.left_m_s, signal.right_m_s)
                if usable:
                    self._travel.update(signal)
                return usable
            case SeatReading():
                return finite(signal.pitch_rad, signal.stroke_m)
            case FlipperReading():
                return finite(signal.angle_rad, signal.torque_n_m)
            case FrameQuality():
                return self.frames.accept_frame(signal)
            case HeadingMeasurement():
                heading = (signal.heading_rad, signal.sigma_rad)
                sound = finite(signal.heading_rad, signal.correction_rad) and signal.sigma_rad > 0.0
                return sound and self.frames.accept_measurement("heading", heading, self._travel.travel_m)
            case StairMap():
                if not is_finite_map(signal):
                    return False
                value = (*signal.nosings_B, signal.obstacle_m)
                # Two maps without any nosing are equal although the camera is not frozen.
                return self.frames.accept_measurement("map", value if len(value) > 1 else signal.t_s, self._travel.travel_m)
            case _:
                return True  # images are judged by their FrameQuality; every operator input is valid


def is_finite_map(stair: StairMap) -> bool:
    """Return whether every number of a map is finite."""
    maybe = (
        stair.obstacle_m,
        stair.left_wall_m,
        stair.right_wall_m,
        stair.left_edge_m,
        stair.right_edge_m,
        stair.left_seen_m,
        stair.right_seen_m,
    )
    return finite(
        stair.rise_m,
        stair.run_m,
        stair.slope_rad,
        *(value for place in stair.nosings_B for value in place),
        *(value for value in maybe if value is not None),
    )
