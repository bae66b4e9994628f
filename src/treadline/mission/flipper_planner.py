"""The flipper on floor and flight: brought to an angle, riding on the nosings, told late where its motor does not follow.

``FlipperReading -> FlipperCommand``. Over crest and edge sequencers of their own drive it (``control/crest.py``,
``control/edge.py``). How it came to be a spring, and why it goes after a chair that falls, is in docs/decisions/0019.
"""

import math

from treadline.angles import DEG
from treadline.control.flipper import FLIPPER_PER_S, OVER_BELTS_RAD
from treadline.mechanics.chair import ChairDescription
from treadline.mission.tip_over import FALL_RATE_RAD_S
from treadline.signals import FlipperCommand, FlipperReading

CLEAR_M = 0.05
"""Of the flipper's tip above a step while the flipper passes over nosings alone: it meets them at its own angle plus the
pitch. From its rest, at 40°, belts with friction 0.45 do not get up there, and slide off on the way down; so low they do not."""
RIDING_HEADING_RAD, LIFTED_HEADING_RAD = 0.5 * DEG, 1.5 * DEG
"""Heading up to which the flipper carries on the nosings, and from which on it lies above them: what lengthens the track by
half, so that the chair hardly rocks, turns it 2.5 times less."""
RIDING_DIFFERENCE_M_S, LIFTED_DIFFERENCE_M_S = 0.02, 0.06
"""Of one belt ahead of the other: the same for a chair that is about to turn. A long one skids instead, and slides."""
SPANS, IN_LINE_RAD = 1.1, -0.5 * DEG
"""Of the way from nosing to nosing, that a flipper must be long to ride on them; a shorter one drops off each, and is held in
line with the belts."""
RIDES_RAD_S = 20.0 * DEG
"""At which a flipper that rides on the nosings gives way to a load of all its motor's torque: with 200 N·m a spring of 1150 N·m/rad
and a damper of 570 N·m·s/rad, which lets a chair down that passes a high nosing. Twice as fast, its servo's stiffness rings."""
LAID_RAD = 1.0 * DEG
"""Above the belts, or above where it is lifted to: as good as there, and the last degree would take half a second more."""
CATCHES = 4.0
"""How much faster than the chair falls, beyond where a fall begins, the section goes down to meet the nosing under it: belts are no
spring, so a chair falls from a nosing 2 mm high by up to 1°, onto the next with 2.5 to 3.6 m/s² at its passenger."""
MEETS_SHARE = 0.05
"""Of the motor's torque, from which on the section has met it: from there it is a spring and a damper again."""
YIELDS_SHARE, YIELDS_RAD_S = 0.5, 10.0 * DEG
"""Of its motor's torque, from which on any other flipper gives way, and how fast at all of it: there it would all at once."""
FLIPPER_RAD_S = 15.0 * DEG
"""Of a flipper that is brought to an angle …"""
LATE_S = 0.8
"""… and how much longer than that it may take before its motor is dead, or stuck."""


def turning_share(off_rad: float, apart_m_s: float) -> float:
    """Return how much of the way up from the nosings the section goes for the chair to turn, 0 to 1.

    Args:
        off_rad: Of the chair's heading from square, positive.
        apart_m_s: Of one belt ahead of the other, positive.
    """
    by_heading = (off_rad - RIDING_HEADING_RAD) / (LIFTED_HEADING_RAD - RIDING_HEADING_RAD)
    return min(max(by_heading, (apart_m_s - RIDING_DIFFERENCE_M_S) / (LIFTED_DIFFERENCE_M_S - RIDING_DIFFERENCE_M_S), 0.0), 1.0)


class FlipperPlanner:
    """What is felt of the flipper, and what is asked of it. Its angles are above the belts' line.

    Args:
        rides_rad: ``Traversal.RIDES_RAD``.
    """

    def __init__(self, chair: ChairDescription, rides_rad: float) -> None:
        self.rest_rad = chair.tracks.approach_angle_deg * DEG
        self.reading: FlipperReading | None = None
        self._rides_rad = rides_rad
        self._flipper_m = chair.tracks.approach_m
        self._most_n_m = math.inf if chair.flipper is None else chair.flipper.torque_n_m
        self._fastest_rad_s = FLIPPER_RAD_S if chair.flipper is None else chair.flipper.max_rate_deg_s * DEG
        self._there_by_s = math.inf
        """By when a flipper that is off where it is asked must be there."""

    def update(self, reading: FlipperReading) -> None:
        """Take one reading."""
        self.reading = reading

    def clears(self, rise_m: float) -> float:
        """Return the flipper's angle at which its tip just clears a step."""
        return min(math.asin(min((rise_m + CLEAR_M) / self._flipper_m, 1.0)), self.rest_rad)

    def spans(self, step_m: float) -> bool:
        """Return whether it reaches from nosing to nosing; ``step_m`` is 0 as long as no stair is known."""
        return 0.0 < SPANS * step_m < self._flipper_m

    def ride(self, t_s: float, step_m: float, share: float, *, falls_rad_s: float) -> FlipperCommand | None:
        """Return what lays it along the flight, or above the nosings for the chair to turn; None without a flipper.

        Args:
            t_s: Now.
            step_m: From nosing to nosing.
            share: How much of the way up it goes (``turning_share``).
            falls_rad_s: Of the chair's pitch going down, for it to go after; 0 where it is not to.
        """
        if not self.spans(step_m):
            return self.to(t_s, IN_LINE_RAD + share * (OVER_BELTS_RAD - IN_LINE_RAD))
        if self.reading is None:
            return None
        off = self._rides_at(share) - self.reading.angle_rad
        rate = max(FLIPPER_PER_S * off + RIDES_RAD_S * self._load, -FLIPPER_RAD_S)
        if self._load <= MEETS_SHARE:
            rate -= CATCHES * max(falls_rad_s - FALL_RATE_RAD_S, 0.0)
        # A nosing that comes under its tip lifts it as fast as it can: held to 15 °/s the chair ran against it, with 3.9 m/s².
        return FlipperCommand(t_s=t_s, rate_rad_s=min(max(rate, -self._fastest_rad_s), self._fastest_rad_s))

    def _rides_at(self, share: float) -> float:
        return self._rides_rad + share * (OVER_BELTS_RAD - self._rides_rad)

    def is_laid(self, t_s: float, step_m: float, share: float) -> bool:
        """Return whether a chair that wakes up on a flight may drive: the flipper lies where it rides, or is late.

        With the flipper at its rest a chair falls from the first high nosing with up to 4.2 m/s² at its passenger. Where it is to
        be lifted all the way, or is too short to ride, it would catch none: there nothing is waited for.

        Args:
            t_s: Now.
            step_m: From nosing to nosing.
            share: How much of the way up it goes (``turning_share``).
        """
        above_rad = 0.0
        if self.reading is not None and self.spans(step_m) and share < 1.0:
            above_rad = max(self.reading.angle_rad - max(self._rides_at(share), 0.0) - LAID_RAD, 0.0)
        return self.is_late(t_s, above_rad) or above_rad <= 0.0

    def to(self, t_s: float, angle_rad: float, *, lifts_rad_s: float = FLIPPER_RAD_S) -> FlipperCommand | None:
        """Return the command that brings the flipper to an angle and yields to its load; None without a flipper."""
        if self.reading is None:
            return None
        over = max(self._load - YIELDS_SHARE, 0.0) / (1.0 - YIELDS_SHARE)
        rate = min(FLIPPER_PER_S * (angle_rad - self.reading.angle_rad), lifts_rad_s) + YIELDS_RAD_S * over
        return FlipperCommand(t_s=t_s, rate_rad_s=min(max(rate, -FLIPPER_RAD_S), FLIPPER_RAD_S))

    @property
    def _load(self) -> float:
        """What the flipper carries, as a share of its motor's torque."""
        return 0.0 if self.reading is None else max(-self.reading.torque_n_m / self._most_n_m, 0.0)

    def is_late(self, t_s: float, off_rad: float, gently_s: float = 0.0) -> bool:
        """Return whether the flipper, off by so much, has had the time that its way needs; once told it has as long again.

        To be asked at each tick, also where nothing is off.
        """
        there_s = t_s + off_rad / FLIPPER_RAD_S + gently_s + LATE_S
        self._there_by_s = min(self._there_by_s, there_s) if off_rad > 0.0 else math.inf
        if t_s < self._there_by_s:
            return False
        self._there_by_s = there_s
        return True

    def forget(self) -> None:
        """Know of no way that the flipper has to go."""
        self._there_by_s = math.inf
