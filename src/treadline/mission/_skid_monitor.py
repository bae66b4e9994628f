"""Skid monitor: suspends steering while different belt speeds do not turn the chair. ``TrackReading, HeadingEstimate -> bool``.

Belts that steer on nosings skid. With little friction, or after one belt has lost friction, a chair that steers slides and turns
against its belts, faster the more it steers. Once both belts run faster than the chair, each pulls with its full friction whatever
its speed: the chair keeps sliding and does not turn. Belts at equal speeds grip again (docs/decisions/0022).
"""

import math
from collections import deque

from treadline.control.heading_controller import usable
from treadline.core.angles import DEG
from treadline.core.signals import HeadingEstimate, TrackReading

WINDOW_S = 0.2
"""Window over which turn and belt speed difference are averaged [s]."""
SLID_M = 0.03
"""Roll-back above which a chair with a heading error counts as sliding [m]."""
APART_M_S, AWAY_RAD = 0.01, 0.15 * DEG
"""Thresholds of a turn against the belts: mean belt speed difference towards square [m/s] and turn away from square [rad], both
over ``WINDOW_S``. A slipping chair that turns towards square as fast is still steered."""
SQUARE_RAD, LOST_RAD = 2.0 * DEG, 8.0 * DEG
"""Heading errors below which a chair has been square, and above which it is lost [rad]. A turn against the belts suspends steering
only of a chair that has been square and not lost since; otherwise the heading error must be corrected, however much the belts skid.
Slip never suspends steering of a lost chair."""
SUSPENDED_S = 5.0
"""Duration of a suspension [s]: three nosings at cruise speed."""
SLIPS_M_S, GRIPS_M_S = 0.04, 0.02
"""Slip-speed hysteresis [m/s]: steering is suspended above ``SLIPS_M_S`` and resumed below ``GRIPS_M_S``. With a heading error
above ``SQUARE_RAD`` this applies only after a roll-back of ``SLID_M``."""


class SkidMonitor:
    """Detects a chair that turns against its belts, or slips without turning. Call ``steering_allowed`` at each tick."""

    def __init__(self) -> None:
        self._until_s = -math.inf
        self._was_square = False
        self._turned_rad = 0.0
        self._window: deque[tuple[float, float, float]] = deque()
        self._slips = False

    def steering_allowed(
        self,
        t_s: float,
        tracks: TrackReading | None,
        estimate: HeadingEstimate | None,
        square_rad: float = 0.0,
        slip_m_s: float = 0.0,
        roll_back_m: float = 0.0,
    ) -> bool:
        """Return whether the chair may steer at this tick.

        Args:
            t_s: Mission time.
            tracks: Latest belt reading, if any.
            estimate: Latest heading estimate, if any.
            square_rad: Heading set point.
            slip_m_s: Belt speed minus chair speed up the flight; all tracks slip that turn while climbing.
            roll_back_m: Distance slid down the flight.
        """
        if tracks is None or estimate is None or not usable(estimate):
            self._window.clear()
            return t_s >= self._until_s and not self._slips
        off_rad = estimate.heading_rad - square_rad
        if abs(off_rad) > LOST_RAD:
            self._was_square, self._until_s = False, -math.inf
        self._was_square |= abs(off_rad) < SQUARE_RAD
        # The yaw rate is integrated, because a correction of the heading or of the set point is not a turn.
        self._turned_rad += estimate.heading_rate_rad_s * (t_s - self._window[-1][0] if self._window else 0.0)
        self._window.append((t_s, self._turned_rad, tracks.right_m_s - tracks.left_m_s))
        while t_s - self._window[0][0] > WINDOW_S:
            self._window.popleft()
        side = math.copysign(1.0, off_rad)
        against_m_s = -side * sum([apart for _, _, apart in self._window]) / len(self._window)
        away_rad = side * (self._turned_rad - self._window[0][1])
        if t_s >= self._until_s and self._was_square and away_rad > AWAY_RAD and against_m_s > APART_M_S:
            self._until_s = t_s + SUSPENDED_S
        returns = -away_rad * WINDOW_S >= AWAY_RAD * (t_s - self._window[0][0])
        self._note_slip(slip_m_s, abs(off_rad), returns=returns, has_slid=roll_back_m >= SLID_M)
        return t_s >= self._until_s and not self._slips

    def _note_slip(self, slip_m_s: float, off_rad: float, *, returns: bool, has_slid: bool) -> None:
        is_square = off_rad < SQUARE_RAD
        if off_rad > LOST_RAD or slip_m_s < GRIPS_M_S or not (is_square or has_slid):
            self._slips = False
        elif slip_m_s > SLIPS_M_S and (is_square or not returns):
            self._slips = True
