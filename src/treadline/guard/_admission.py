"""Admission of readings: which of them may be used (rows 2, 3, 4, 6 and 10). ``reading -> bool``.

The guard composes it; each node that uses readings has an admission of its own and, from the same readings, comes to the same
answers.
"""

from treadline.core.signals import FrameQuality, FreeGround, HeadingMeasurement, StairMap, TrackReading
from treadline.guard._belt_travel import BeltTravel
from treadline.guard._bounds import fault_of
from treadline.guard._frame_monitor import FrameMonitor
from treadline.guard._guard_config import GuardConfig
from treadline.guard._stamps import Stamped, Stamps


class ReadingAdmission:
    """Accepts readings with an acceptable stamp and physical content, from a sensor that is not frozen."""

    def __init__(self, config: GuardConfig) -> None:
        self._config = config
        self.stamps = Stamps(config)
        self.frames = FrameMonitor(config)
        self.travel = BeltTravel(config.silence_s)
        """Travel by the accepted readings of the belts."""
        self.fault = ""
        """Fault of the last message's content; empty if it has none."""

    def advance(self, t_s: float) -> None:
        """Set the clock that stamps are compared with."""
        self.stamps.advance(t_s)

    def admit(self, reading: Stamped) -> bool:
        """Return whether a reading may be used; each reading is asked for once."""
        return self.accept(reading) and self.is_sound(reading)

    def accept(self, message: Stamped, by: str = "") -> bool:
        """Return whether stamp and content of a message are acceptable; one that is not is counted as rejected."""
        self.fault = fault_of(message, self._config)
        accepted = self.stamps.accept(message, by, self.fault)
        if self.fault and isinstance(message, FrameQuality):
            self.frames.reject_frame(self.fault)
        return accepted

    def is_sound(self, reading: Stamped) -> bool:
        """Return whether an accepted reading comes from a sensor that is not frozen, dark or empty."""
        match reading:
            case TrackReading():
                self.travel.update(reading)
            case FrameQuality():
                return self.frames.accept_frame(reading)
            case HeadingMeasurement():
                heading = (reading.heading_rad, reading.sigma_rad)
                return self.frames.accept_measurement("heading", reading.t_s, heading, self.travel.travel_m)
            case FreeGround():
                # Equal ground is no sign of a frozen camera: its range limits what is seen.
                return self.frames.accept_measurement("ground", reading.t_s, reading.t_s, self.travel.travel_m)
            case StairMap():
                # Two maps without any nosing or obstacle are equal although the camera is not frozen.
                seen = (reading.nosings_B, reading.obstacle_m)
                value = reading.t_s if seen == ((), None) else seen
                return self.frames.accept_measurement("map", reading.t_s, value, self.travel.travel_m)
        return True
