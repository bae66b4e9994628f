"""Limits of pitch, roll and pitch rate of the chair (row 18), and of the pitch of its seat (row 19)."""

import math
from collections.abc import Sequence
from typing import Any

from treadline.core.angles import DEG, tilt_of
from treadline.core.signals import ROUNDING_S, ImuSample, SeatReading
from treadline.guard._guard_config import GuardConfig
from treadline.guard._half_cosine_stop import Stop
from treadline.guard._known import Known, Lasting, Monitor


class TiltMonitor(Monitor):
    """Pitch beyond +40° or −15°, roll beyond 20°, pitch rate beyond 25 °/s.

    Time: 50 ms; if it flickers, and is beyond for a share p > 1/2 of the time, divided by 2p − 1.
    Not covered: a fall that no brake stops.
    """

    rows, hears, needs = "18", (ImuSample,), ("watches_motion", "needs_heading")

    def __init__(self, config: GuardConfig) -> None:
        super().__init__(config)
        self._lasting = Lasting(config.imu_timeout_s, config.ahead_s)

    def hear(self, message: Any, known: Known) -> None:
        """Update with one IMU sample."""
        fault = self._fault(message.orientation, -message.angular_velocity_rad_s[1])
        if self._lasting.update(message.t_s, beyond=fault is not None):
            self._cause = fault

    def restart(self, known: Known) -> None:
        """Start again."""
        super().restart(known)
        self._lasting.forget(math.inf)

    def _fault(self, orientation: Sequence[float], pitch_rate_rad_s: float) -> str | None:
        limits = self._config
        pitch, roll = tilt_of(orientation)
        if abs(pitch_rate_rad_s) > limits.pitch_rate_rad_s:
            return f"pitch rate {pitch_rate_rad_s / DEG:.0f} °/s, pitch {pitch / DEG:.0f}°"
        if not -limits.front_down_rad <= pitch <= limits.front_up_rad:
            return f"pitch {pitch / DEG:.0f}°"
        if abs(roll) > limits.roll_rad:
            return f"roll {roll / DEG:.0f}°"
        return None


class SeatMonitor(Monitor):
    """Seat 5° off level without improvement; the seat is frozen.

    Time: 1 s.

    A decrease of the error by ``level_rad`` starts the time again, as the seat is being levelled. An increase holds at once: the
    seat moves with the chassis, 11° in a second over a crest.
    """

    rows, stop, hears, needs = "19", Stop.RAMP, (SeatReading,), ("watches_motion",)

    def __init__(self, config: GuardConfig) -> None:
        super().__init__(config)
        self._since: tuple[float, float] | None = None

    def hear(self, message: Any, known: Known) -> None:
        """Update with one reading of the seat; a pitch of zero is horizontal."""
        t_s, error = message.t_s, abs(message.pitch_rad)
        if error <= self._config.seat_rad:
            self._since = None
        elif self._since is None or error < self._since[1] - self._config.level_rad:
            self._since = (t_s, error)
        elif error > self._since[1] + self._config.level_rad or t_s - self._since[0] >= self._config.seat_s - ROUNDING_S:
            self._cause = f"seat is {message.pitch_rad / DEG:.1f}° off level for {t_s - self._since[0]:.1f} s"

    def restart(self, known: Known) -> None:
        """Start again."""
        super().restart(known)
        self._since = None
