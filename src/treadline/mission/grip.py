"""Whether belts that run apart still turn the chair.

Belts that steer on nosings skid, and what skids grips less. Where grip is short, or one belt has lost some, a chair that steers
slides, and turns against its belts: the more it steers, the faster. Once both belts outrun the chair they pull it up alike, however
far apart they run: it slides on, and does not turn. Belts that run alike grip again. docs/decisions/0022.
"""

import math
from collections import deque

from treadline.angles import DEG
from treadline.control.heading import usable
from treadline.signals import HeadingEstimate, TrackReading

WINDOW_S = 0.2
SLID_M = 0.03
"""Roll-back beyond which a chair off its heading counts as sliding."""
APART_M_S, AWAY_RAD = 0.01, 0.15 * DEG
"""Of the belts in the mean of this window, and of a chair that has turned away from square against them in it."""
SQUARE_RAD, LOST_RAD = 2.0 * DEG, 8.0 * DEG
"""Within which a chair has been, and beyond which it has not come since, that may be let alone: one that is further askew must be
turned back, however much it skids."""
SUSPENDED_S, MAX_SUSPENDED_S = 5.0, 10.0
"""For which it is let alone, three nosings at cruise; twice as long if it turns away anew …"""
REPEAT_S = 5.0
"""… within so long."""
SLIPS_M_S, GRIPS_M_S = 0.04, 0.02
"""By which belts outrun a chair that is let alone for it, and up to which it grips again. One that is more than nearly square is
not, unless it has slid back, …"""
TURNS_RAD_S = 0.5 * DEG
"""… nor while it comes back to its aim as fast as this, nor if it is lost."""


class SkidMonitor:
    """Says when a chair does not turn as it steers, and is better let alone."""

    def __init__(self) -> None:
        self._until_s = -math.inf
        self._suspended_s = SUSPENDED_S
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
        """Return whether to steer on.

        Args:
            t_s: Now.
            tracks: What the belts do.
            estimate: Where the chair heads.
            square_rad: The heading that the chair steers to.
            slip_m_s: By which the belts outrun the chair up the flight: those of all tracks do that turn as they climb.
            roll_back_m: How far it has come back along the flight.
        """
        if tracks is None or estimate is None or not usable(estimate):
            self._window.clear()
            return t_s >= self._until_s and not self._slips
        off_rad = estimate.heading_rad - square_rad
        if abs(off_rad) > LOST_RAD:
            self._was_square, self._until_s = False, -math.inf
        self._was_square |= abs(off_rad) < SQUARE_RAD
        # By its rate: neither a better heading nor another aim is a turn.
        self._turned_rad += estimate.heading_rate_rad_s * (t_s - self._window[-1][0] if self._window else 0.0)
        self._window.append((t_s, self._turned_rad, tracks.right_m_s - tracks.left_m_s))
        while t_s - self._window[0][0] > WINDOW_S:
            self._window.popleft()
        side = math.copysign(1.0, off_rad)
        against_m_s = -side * sum(apart for *_, apart in self._window) / len(self._window)
        away_rad = side * (self._turned_rad - self._window[0][1])
        if t_s >= self._until_s and self._was_square and away_rad > AWAY_RAD and against_m_s > APART_M_S:
            again = t_s < self._until_s + REPEAT_S
            self._suspended_s = min(2.0 * self._suspended_s, MAX_SUSPENDED_S) if again else SUSPENDED_S
            self._until_s = t_s + self._suspended_s
        returns = -away_rad >= TURNS_RAD_S * (t_s - self._window[0][0])
        self._note_slip(slip_m_s, abs(off_rad), returns=returns, has_slid=roll_back_m >= SLID_M)
        return t_s >= self._until_s and not self._slips

    def _note_slip(self, slip_m_s: float, off_rad: float, *, returns: bool, has_slid: bool) -> None:
        is_square = off_rad < SQUARE_RAD
        if off_rad > LOST_RAD or slip_m_s < GRIPS_M_S or not (is_square or has_slid):
            self._slips = False
        elif slip_m_s > SLIPS_M_S and (is_square or not returns):
            self._slips = True
