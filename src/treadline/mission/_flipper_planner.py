"""Flipper commands on floor and flight: move to an angle, ride on the nosings, and detect a flipper that does not follow.

``Situation -> FlipperCommand``. Over the ends of a flight ``follow`` commands it. The riding flipper acts as a spring and damper on
the nosings as they are: docs/decisions/0013. Angles are above the belts' line.
"""

import math

from treadline.control.flipper import (
    FLIPPER_PER_S,
    FLIPPER_RAD_S,
    OVER_BELTS_RAD,
    THERE_RAD,
    YIELDS_RAD_S,
    load_share,
)
from treadline.core.angles import DEG
from treadline.core.signals import FlipperCommand
from treadline.mission._flat_ground_steering import SQUARE_RAD
from treadline.mission._situation import Situation
from treadline.vehicle.loading import plumb

CLEAR_M = 0.05
"""Clearance of the flipper's tip above a step while only the flipper passes over nosings [m]. From its rest, at 40°, belts with
friction 0.45 neither mount nor stay on the nosings while leaving; at this clearance they do."""
YIELDS_SHARE = 0.5
"""Share of the motor's torque above which a flipper that moves to an angle yields."""
LATE_S = 0.8
"""Time beyond the expected duration of a movement after which the motor counts as dead or stuck [s]."""
PRESSES_RAD = -7.0 * DEG
"""Flipper angle of a chair whose belts slip on the flight [rad]: the flipper takes a part of the weight onto the next nosings, the
rear pulley another. On three steps of friction 0.36 the chair then rolls back by 0.05 m at most instead of 0.25 m; twice as low it
catches a nosing with 7 m/s²."""


class Deadline:
    """Time by which the flipper must have moved."""

    def __init__(self) -> None:
        self._there_by_s = math.inf

    def is_over(self, t_s: float, off_rad: float) -> bool:
        """Return whether the flipper has exceeded the time that its movement needs; after True the time starts again.

        Call at each tick, also without an angle error.

        Args:
            t_s: Mission time.
            off_rad: Angle to the commanded position; 0 if there is none.
        """
        there_s = t_s + off_rad / FLIPPER_RAD_S + LATE_S
        self._there_by_s = min(self._there_by_s, there_s) if off_rad > 0.0 else math.inf
        if t_s < self._there_by_s:
            return False
        self._there_by_s = there_s
        return True

    def forget(self) -> None:
        """Clear the deadline."""
        self._there_by_s = math.inf


def awaited_rad(now: Situation) -> float | None:
    """Return the angle by which the flipper must still turn for the chair to go on [rad]; None where it does not wait for it."""
    stands = math.nan if now.flipper is None else now.flipper.angle_rad
    off_rad = 0.0
    match now.phase:
        case "search" if now.is_on_a_flight and now.estimate is not None and now.stair.map_count and not now.is_held:
            share = turning_share(now)
            if _spans(now) and share < 1.0:
                off_rad = max(stands - max(_rides_rad(now, share), 0.0) - OVER_BELTS_RAD, 0.0)
        case "climb" if now.presses:
            off_rad = max(stands - PRESSES_RAD - THERE_RAD, 0.0)
        case _:
            return None
    return 0.0 if now.flipper is None else off_rad


# --- angles


def rest_rad(now: Situation) -> float:
    """Return the angle of the stowed flipper [rad]."""
    return now.config.chair.tracks.approach_angle_deg * DEG


def stepping_rad(now: Situation) -> float:
    """Return the flipper angle at which the tip clears a step by ``CLEAR_M`` [rad]."""
    return min(math.asin(min((now.stair.rise_m + CLEAR_M) / now.config.chair.tracks.approach_m, 1.0)), rest_rad(now))


def lies_rad(now: Situation) -> float:
    """Return the flipper's angle on the nosings ahead [rad].

    Downhill they reach it from the belts. There it raises the front by the angle by which the chair would else fall onto its rear.
    """
    if now.around is None:
        return 0.0
    if now.is_up:
        return now.around.flipper_rad(now.pivot_m, now.config.chair.tracks.approach_m)
    return -now.around.falls_rad(plumb(now.loading, now.stair.pitch_rad))


def turning_share(now: Situation, square_rad: float = 0.0) -> float:
    """Return how far the flipper is lifted for the chair to turn: 0 riding on the nosings, 1 fully lifted above them.

    Riding lengthens the track by half, so that the chair hardly rocks, but turns 2.5 times less. At the heading error of a square
    chair the flipper is half lifted.

    Args:
        now: Situation.
        square_rad: Heading set point [rad].
    """
    if now.estimate is None:
        return 1.0
    return min(max(abs(now.estimate.heading_rad - square_rad) / SQUARE_RAD - 0.5, 0.0), 1.0)


def _rides_rad(now: Situation, share: float) -> float:
    """Return the angle at which the flipper rides on even nosings, lifted by a share to turn [rad]."""
    return now.way.rides_rad + share * (OVER_BELTS_RAD - now.way.rides_rad)


def _spans(now: Situation) -> bool:
    """Return whether the flipper reaches from nosing to nosing."""
    return 0.0 < now.step_m < now.config.chair.tracks.approach_m


# --- commands


def turn_to(now: Situation, angle_rad: float, *, lifts_rad_s: float = FLIPPER_RAD_S) -> FlipperCommand | None:
    """Return the command that moves the flipper to an angle and yields to its load; None without a flipper."""
    if now.flipper is None:
        return None
    yields = YIELDS_RAD_S * max(_load(now) - YIELDS_SHARE, 0.0)
    rate = min(FLIPPER_PER_S * (angle_rad - now.flipper.angle_rad), lifts_rad_s) + yields
    return FlipperCommand(t_s=now.t_s, rate_rad_s=min(max(rate, -FLIPPER_RAD_S), FLIPPER_RAD_S))


def ride(now: Situation, square_rad: float = 0.0) -> FlipperCommand | None:
    """Return the command on the flight: riding on the nosings while the chair is square, lifted above them to turn."""
    rides = _rides_rad(now, turning_share(now, square_rad))
    if not _spans(now):  # it would drop off each nosing
        return turn_to(now, rides)
    if now.flipper is None:
        return None
    off = lies_rad(now) + rides - now.flipper.angle_rad
    rate = max(FLIPPER_PER_S * off + YIELDS_RAD_S * _load(now), -FLIPPER_RAD_S)
    # Upwards at the motor's full rate: at 15 °/s a chair ran against the nosing that was to lift its flipper (3.9 m/s²).
    flipper = now.config.chair.flipper
    fastest_rad_s = FLIPPER_RAD_S if flipper is None else flipper.max_rate_deg_s * DEG
    return FlipperCommand(t_s=now.t_s, rate_rad_s=min(max(rate, -fastest_rad_s), fastest_rad_s))


def _load(now: Situation) -> float:
    """Return the load of the flipper as a share of its motor's torque."""
    motor = now.config.chair.flipper
    return 0.0 if now.flipper is None else load_share(now.flipper, math.inf if motor is None else motor.torque_n_m)
