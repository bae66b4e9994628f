"""Steering on flat ground: search for the stair, turn square to it, keep square while approaching. ``HeadingEstimate -> turn``.

Tracks that turn on the spot skid. The ratio of turn to belt travel is not constant, so the heading closes the loop. Turns are
given as half the belt speed difference, right minus left [m/s].
"""

import math

from treadline.control.belt_allocation import GENTLE_M_S2
from treadline.control.flipper import SLOW_M_S
from treadline.core.angles import DEG
from treadline.core.signals import TICK_S, HeadingEstimate

SQUARE_RAD, SQUARE_S = 1.0 * DEG, 0.5
"""Heading error below which the chair counts as square to the stair [rad], and time, five frames, before it is square or
looks for the stair elsewhere [s]."""
TURN_PER_S = 1.5
"""Turn rate per heading error on the spot [1/s]."""
TURN_RAD_S = 10.0 * DEG
"""Largest turn rate on the spot [rad/s]: the camera sees the stair turn by a degree from frame to frame. From 30° the chair is
square after 4.4 s, with 0.01 m/s² at the passenger (friction 1.0/1.0, 75 kg)."""
SKID = 1.27
"""Ratio of belt speed to that of a turn without skidding: the belts drag each other sideways. Statics of the wheelchair's road
wheels with Table I's friction (docs/decisions/0013); 1.16 to 1.40 with other friction, which the heading loop makes up for."""
KEEP_M_S_RAD = 1.5
"""Half the belt speed difference per heading error while the belts stand on several heights [m/s per rad]."""
SWEEP_RAD = 40.0 * DEG
"""Search angle to each side [rad]."""


class LevelSteering:
    """Heading loop on flat ground. The search for a stair uses the gyro instead of the heading estimate.

    Args:
        gauge_m: Distance between the belts' centre lines [m].
    """

    def __init__(self, gauge_m: float) -> None:
        self._gauge_m = gauge_m
        self._square_since_s: float | None = None
        self._looked_since_s: float | None = None
        self._swept_rad = 0.0
        self._half_m_s = 0.0
        self._legs = [SWEEP_RAD, -SWEEP_RAD, 0.0]

    def towards(self, estimate: HeadingEstimate) -> float:
        """Return the turn on the spot that makes the chair square [m/s]."""
        return self.turn(min(max(-TURN_PER_S * estimate.heading_rad, -TURN_RAD_S), TURN_RAD_S))

    def keep(self, estimate: HeadingEstimate | None, target_rad: float = 0.0, *, spare_rad: float = 0.0) -> float:
        """Return the turn that keeps a heading while the chair drives or pitches [m/s]; 0 without an estimate.

        Args:
            estimate: Latest heading estimate, if any.
            target_rad: Heading set point.
            spare_rad: Dead band of the heading error.
        """
        if estimate is None:
            return 0.0
        off = target_rad - estimate.heading_rad
        half = KEEP_M_S_RAD * math.copysign(max(abs(off) - spare_rad, 0.0), off)
        return min(max(half, -SLOW_M_S), SLOW_M_S)  # so that a slow chair turns about its inner belt

    def is_square(self, estimate: HeadingEstimate, t_s: float) -> bool:
        """Return whether the chair has been square to the stair for ``SQUARE_S``."""
        if abs(estimate.heading_rad) > SQUARE_RAD:
            self._square_since_s = None
            return False
        if self._square_since_s is None:
            self._square_since_s = t_s
        return t_s - self._square_since_s >= SQUARE_S

    def sweep(self, t_s: float, turned_rad: float) -> float:
        """Return the turn of a search to both sides [m/s].

        Args:
            t_s: Mission time.
            turned_rad: Turn since the last call, by the gyro.
        """
        if self._looked_since_s is None:
            self._looked_since_s = t_s
        if t_s - self._looked_since_s < SQUARE_S:
            return 0.0
        self._swept_rad += turned_rad
        if self._legs and abs(self._legs[0] - self._swept_rad) < 2.0 * DEG:
            self._legs.pop(0)
        return self.turn(math.copysign(TURN_RAD_S, self._legs[0] - self._swept_rad)) if self._legs else 0.0

    def has_swept(self) -> bool:
        """Return whether the search has ended; it starts again then, because a person may re-arm the chair."""
        ended = not self._legs
        if ended:
            self._legs = [SWEEP_RAD, -SWEEP_RAD, 0.0]
        return ended

    def rest(self) -> None:
        """Start the next turn from rest, because the belts are braked."""
        self._half_m_s = 0.0

    def turn(self, rate_rad_s: float) -> float:
        """Return half the belt speed difference for a turn rate; call at each tick of a turn."""
        wanted = 0.5 * self._gauge_m * SKID * rate_rad_s
        change = GENTLE_M_S2 * TICK_S
        self._half_m_s = min(max(wanted, self._half_m_s - change), self._half_m_s + change)
        return self._half_m_s
