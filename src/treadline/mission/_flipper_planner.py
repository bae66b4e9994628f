"""Flipper commands on floor and flight: move to an angle, ride on the nosings, and detect a flipper that does not follow.

``FlipperReading -> FlipperCommand``. Over crest and edge other sequences command the flipper (``control/crest_sequence.py``,
``control/edge_sequence.py``). The riding flipper acts as a spring and damper on the nosings as they are: docs/decisions/0013.
"""

import math

from treadline.control.flipper import FLIPPER_PER_S, FLIPPER_RAD_S, OVER_BELTS_RAD, YIELDS_RAD_S, load_share
from treadline.core.angles import DEG
from treadline.core.signals import FlipperCommand, FlipperReading
from treadline.mission._flat_ground_steering import SQUARE_RAD
from treadline.scenario.chair import ChairDescription

CLEAR_M = 0.05
"""Clearance of the flipper's tip above a step while only the flipper passes over nosings [m]. From its rest, at 40°, belts with
friction 0.45 neither mount nor stay on the nosings while leaving; at this clearance they do."""
YIELDS_SHARE = 0.5
"""Share of the motor's torque above which a flipper that moves to an angle yields."""
LATE_S = 0.8
"""Time beyond the expected duration of a movement after which the motor counts as dead or stuck [s]."""


def turning_share(off_rad: float) -> float:
    """Return how far the flipper is lifted for the chair to turn: 0 riding on the nosings, 1 fully lifted above them.

    Riding lengthens the track by half, so that the chair hardly rocks, but turns 2.5 times less. At the heading error of a square
    chair the flipper is half lifted.

    Args:
        off_rad: Heading error [rad].
    """
    return min(max(abs(off_rad) / SQUARE_RAD - 0.5, 0.0), 1.0)


class FlipperPlanner:
    """Computes flipper commands from readings; angles are above the belts' line [rad].

    Args:
        chair: Chair with or without a flipper.
        rides_rad: Angle at which the flipper rides on the nosings, ``Way.rides_rad``.
    """

    def __init__(self, chair: ChairDescription, rides_rad: float) -> None:
        self.rest_rad = chair.tracks.approach_angle_deg * DEG
        self.reading: FlipperReading | None = None
        self._rides_rad = rides_rad
        self._flipper_m = chair.tracks.approach_m
        self._most_n_m = math.inf if chair.flipper is None else chair.flipper.torque_n_m
        self._fastest_rad_s = FLIPPER_RAD_S if chair.flipper is None else chair.flipper.max_rate_deg_s * DEG
        self._there_by_s = math.inf
        """Deadline for a flipper that is off its commanded angle [s]; infinite while it is not."""

    def update(self, reading: FlipperReading) -> None:
        """Update with one reading."""
        self.reading = reading

    def clears(self, rise_m: float) -> float:
        """Return the flipper angle at which the tip clears a step by ``CLEAR_M`` [rad]."""
        return min(math.asin(min((rise_m + CLEAR_M) / self._flipper_m, 1.0)), self.rest_rad)

    def spans(self, step_m: float) -> bool:
        """Return whether the flipper reaches from nosing to nosing; ``step_m`` is 0 while no stair is known."""
        return 0.0 < step_m < self._flipper_m

    def ride(self, t_s: float, step_m: float, share: float, lies_rad: float = 0.0) -> FlipperCommand | None:
        """Return the command that rides on the nosings, or lifts the flipper for a turn; None without a flipper.

        Args:
            t_s: Mission time.
            step_m: Distance from nosing to nosing.
            share: Lift for a turn, 0 to 1 (``turning_share``).
            lies_rad: Angle at which the flipper lies on the nosings as they are; 0 on the belts' line.
        """
        if not self.spans(step_m):  # it would drop off each nosing
            return self.to(t_s, self._rides_at(share))
        if self.reading is None:
            return None
        off = lies_rad + self._rides_at(share) - self.reading.angle_rad
        rate = max(FLIPPER_PER_S * off + YIELDS_RAD_S * self._load, -FLIPPER_RAD_S)
        # Upwards at the motor's full rate: at 15 °/s a chair ran against the nosing that was to lift its flipper (3.9 m/s²).
        return FlipperCommand(t_s=t_s, rate_rad_s=min(max(rate, -self._fastest_rad_s), self._fastest_rad_s))

    def _rides_at(self, share: float) -> float:
        return self._rides_rad + share * (OVER_BELTS_RAD - self._rides_rad)

    def is_laid(self, t_s: float, step_m: float, share: float) -> bool:
        """Return whether a chair that starts on a flight may drive: the flipper rides on the nosings, or is late.

        With the flipper at its rest a chair falls from the first high nosing with up to 4.2 m/s² at the passenger. A fully lifted
        flipper, or one too short to ride, would not catch the fall, so the chair does not wait for it.

        Args:
            t_s: Mission time.
            step_m: Distance from nosing to nosing.
            share: Lift for a turn, 0 to 1 (``turning_share``).
        """
        above_rad = 0.0
        if self.reading is not None and self.spans(step_m) and share < 1.0:
            above_rad = max(self.reading.angle_rad - max(self._rides_at(share), 0.0) - OVER_BELTS_RAD, 0.0)
        return self.is_late(t_s, above_rad) or above_rad <= 0.0

    def to(self, t_s: float, angle_rad: float, *, lifts_rad_s: float = FLIPPER_RAD_S) -> FlipperCommand | None:
        """Return the command that moves the flipper to an angle and yields to its load; None without a flipper."""
        if self.reading is None:
            return None
        yields = YIELDS_RAD_S * max(self._load - YIELDS_SHARE, 0.0)
        rate = min(FLIPPER_PER_S * (angle_rad - self.reading.angle_rad), lifts_rad_s) + yields
        return FlipperCommand(t_s=t_s, rate_rad_s=min(max(rate, -FLIPPER_RAD_S), FLIPPER_RAD_S))

    @property
    def _load(self) -> float:
        """Load of the flipper as a share of its motor's torque."""
        return 0.0 if self.reading is None else load_share(self.reading, self._most_n_m)

    def is_late(self, t_s: float, off_rad: float, gently_s: float = 0.0) -> bool:
        """Return whether the flipper has exceeded the time that its movement needs; after True the time starts again.

        Call at each tick, also without an angle error.

        Args:
            t_s: Mission time.
            off_rad: Angle to the commanded position; 0 if there is none.
            gently_s: Additional time for a slow part of the movement.
        """
        there_s = t_s + off_rad / FLIPPER_RAD_S + gently_s + LATE_S
        self._there_by_s = min(self._there_by_s, there_s) if off_rad > 0.0 else math.inf
        if t_s < self._there_by_s:
            return False
        self._there_by_s = there_s
        return True

    def forget(self) -> None:
        """Clear the deadline of a movement."""
        self._there_by_s = math.inf
