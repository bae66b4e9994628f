"""Crossing the crest with a flipper: the flipper reaches the landing first and lowers the chair onto it.

Paper: Section II.A, Fig. 3(b) ("variable angle of attack"); the sequence is our own, see docs/decisions/0013-flipper.md.
``ImuSample, FlipperReading, TrackReading -> CrestCommand``.

Without a flipper a chair whose centre of mass passes the last nosing falls onto its front. With a flipper there are five
stages: climb; slow down and align the flipper with the belts; stand still and reach down until the tip carries load; drive
on with the flipper holding until the centre of mass has passed; lower the pitch. The flipper reaches down as soon as its axis is
over the landing's edge: above a low last step the chair tips about the nosing before, and nothing else would bear it. The tip load
is measured by motor torque, and by the pitch when the flipper lifts the chair.
"""

import math
from typing import Literal

from treadline.control.flipper import (
    FLIPPER_PER_S,
    GENTLY_RAD_S,
    LIES_RAD,
    LIFTED_RAD,
    OFF_RAD,
    OVER_BELTS_RAD,
    PATIENCE_S,
    PLACE_M,
    SLOW_M_S,
    SMALL_RAD,
    STOW_RAD_S,
    TURN_RAD_S,
    TURN_RAD_S2,
    PitchCommand,
    Sequencer,
)
from treadline.core.angles import DEG
from treadline.core.signals import FlipperReading
from treadline.estimation.known_nosings import SIGMAS, KnownNosings
from treadline.vehicle.loading import Loading, plumb

Stage = Literal["climb", "slow", "reach", "carry", "lead", "land", "done", "barred"]

PRESS = 1.5
"""Tip load maintained while the chair drives on, as a ratio of the load of a tip that stands."""
EARLY_RAD, EARLY_M = 12.0 * DEG, 0.05
"""Angle above the expected landing at which the tip stands on the nosing instead [rad], and the nosing's distance ahead of the
front pulley in that case [m]; slipping belts overestimate the progress."""
LAGS_RAD = 0.25 * DEG
"""Pitch lag above which a chair that does not lean on the tip is lowered gently [rad]: it would fall after a faster flipper and
land on it with 2.6 to 2.8 m/s² at the passenger. At twice the lag its centre of mass is further back than assumed. The load alone
does not show that: a tip pushed forward over ground with high friction stands by friction, with almost no motor torque (36 to 45°
below horizontal, friction 0.7 to 1)."""
LIES_S = 1.0
"""Time nearly horizontal, at a kerb at half of its own pitch, with an unloaded tip after which the belts lie on the landing [s],
despite the error of gravity."""


LEAD_M_S = 0.03
"""Speed while the pitch is lowered [m/s]: the further the chair moves, the more load the flipper carries."""
SLIDE_M_S = 0.06
"""Sliding speed of the tip over the landing while the chair is lowered [m/s]. A tip reaching far down onto ground with high
friction (36° and friction 1) sticks and springs free: at 0.13 m/s with 19 °/s and 4 m/s² at the seat."""
PRESS_RAD_S_N = 0.1 * DEG
"""Flipper rate per missing load [rad/s/N]."""

CrestCommand = PitchCommand[Stage]
"""Belt speed and flipper rate commanded by the crest sequence."""


class Crest(Sequencer[Stage]):
    """State machine for one crossing of the crest.

    Args:
        loading: Chair and assumed load.
        cruise_m_s: Belt speed before the sequence slows down.
        around: Nosings around the chair; the uppermost is the landing's edge.
    """

    def __init__(self, loading: Loading, cruise_m_s: float, around: KnownNosings) -> None:
        super().__init__(loading, "climb", around)
        self._cruise_m_s = cruise_m_s
        self._waited_s, self._least_m = 0.0, math.inf
        """Time since the landing's edge last came nearer by ``PLACE_M`` [s], and its distance then [m]."""
        self._tries = 0
        """Number of attempts in which the tip stood on the nosing instead of the landing."""
        self._lead_from_m = PLACE_M

    def _sequence(self, pitch: float, flipper: FlipperReading, dt_s: float) -> None:
        beyond = self._com_beyond(pitch)
        match self._stage:
            case "climb" | "slow" | "reach" | "carry" if cause := self._gets_no_further(pitch, dt_s):
                self._stage, self._cause = "barred", cause
            case "climb" if self._edge_past_m > -self._geometry.length_m:
                self._stage = "slow"
            case "slow" if self._edge_past_m > 0.0:
                self._stage, self._waited_s, self._least_m = "reach", 0.0, math.inf
            case "reach" if self._tip.carries or self._is_lifted(pitch):
                self._meet(pitch, flipper)
            case "carry" if self._tip.carries and beyond > self._lead_from_m:
                self._stage = "lead"
                self._lead_from(pitch)
            case "lead" if beyond < 0.0 or self._is_left_behind(pitch):
                self._stage = "carry"
                self._lead_from_m = max(beyond, 0.0) + PLACE_M
            case "carry" | "lead" if pitch < LIES_RAD:
                self._stage = "land"
            case "lead" if pitch < min(SMALL_RAD, 0.5 * self._lies()[0]) and self._tip.unloaded_s > LIES_S:
                self._stage = "land"
            case "land" if self._edge_past_m > 2.0 * self._geometry.pivot_m:
                self._stage = "done"
            case _:
                pass

    def _cannot_reach(self) -> str:
        """Return the reason why the flipper cannot stand on the landing as the centre of mass passes, or an empty string."""
        slope, sigma = self._lies()
        least_rad = slope - SIGMAS * sigma - LIFTED_RAD
        if self._most_before_m(least_rad) > -PLACE_M:
            return ""
        return f"a flipper that turns to {self._lowest_rad / DEG:.0f}° is too short for last nosings of {slope / DEG:.1f}°"

    def _gets_no_further(self, pitch: float, dt_s: float) -> str:
        """Return the reason why the crossing cannot succeed by current measurements, or an empty string."""
        if self._stage in ("climb", "slow"):
            return self._cannot_reach()
        self._waited_s += dt_s
        ahead_m = self._geometry.pivot_m - self._edge_past_m
        if ahead_m < self._least_m - PLACE_M:
            self._waited_s, self._least_m = 0.0, ahead_m
        if self._is_lifted(pitch) and pitch > self._lies()[0] + OFF_RAD:
            lifted = (pitch - self._lies()[0]) / DEG
            return f"the flipper lifted the chair by {lifted:.1f}°, and stands on something else than the landing"
        if self._waited_s < PATIENCE_S:
            return ""
        if self._tip.is_unloaded:
            return f"nothing carried the flipper in {PATIENCE_S:.0f} s: its motor is dead, or the landing is not there"
        return f"the chair stayed for {PATIENCE_S:.0f} s while the belts ran: they slip on the last nosing"

    def _is_left_behind(self, pitch: float) -> bool:
        """Return whether the chair has not followed an unloaded tip: its centre of mass is further back than assumed."""
        return self._tip.is_unloaded and pitch > max(SMALL_RAD, self._lead_rad + 2.0 * LAGS_RAD)

    def _meet(self, pitch: float, flipper: FlipperReading) -> None:
        """Classify the contact of the tip by its position: landing or nosing."""
        if self._to_go(pitch, flipper) <= EARLY_RAD:
            self._stage = "carry"
            self._offset_m = self._by_the_flipper(pitch, flipper)
            return
        self._stage = "slow" if self._may_go_on(pitch) else "barred"
        self._tries += 1
        self._offset_m = self._geometry.pivot_m + EARLY_M - self._around.top.ahead_m
        self._cause = f"the flipper stood on the last nosing, try {self._tries}: the belts slip, or its position was wrong"

    def _may_go_on(self, pitch: float) -> bool:
        """Return whether another attempt leaves the centre of mass behind the nosing, even if its first position was correct."""
        return plumb(self._loading, pitch) < self._geometry.pivot_m - (self._tries + 1) * EARLY_M - PLACE_M

    def _act(self, pitch: float, flipper: FlipperReading, speed: float, dt_s: float) -> tuple[float, float]:
        match self._stage:
            case "climb":
                return self._cruise_m_s, 0.0
            case "slow":
                return SLOW_M_S, self._towards(OVER_BELTS_RAD, flipper)
            case "reach":
                return 0.0, self._reach(pitch, flipper)
            case "carry":
                return self._carry(pitch, flipper, speed, dt_s)
            case "barred":
                return 0.0, 0.0
            case "lead":
                return LEAD_M_S, self._lead(pitch, flipper, speed, dt_s)
            case _:
                return SLOW_M_S, min(self._towards(self._rest_rad, flipper), STOW_RAD_S)

    def _is_lifted(self, pitch: float) -> bool:
        """Return whether a loaded tip holds the chair above its nosings: a light chair is lifted before the tip carries."""
        return not self._tip.is_unloaded and pitch > self._lies()[0] + LIFTED_RAD

    def _carry(self, pitch: float, flipper: FlipperReading, speed: float, dt_s: float) -> tuple[float, float]:
        self._refine(pitch, flipper, dt_s)
        _, per_metre = self._geometry.rates(pitch, *self._place)
        missing = 0.0 if self._is_lifted(pitch) else max(PRESS * self._tip.carries_n - self._tip.load_n, 0.0)
        rate = (per_metre * speed if missing > 0.0 else 0.0) - PRESS_RAD_S_N * missing
        waits = self._tip.is_unloaded and self._com_beyond(pitch) > -PLACE_M
        return (0.0 if waits else SLOW_M_S), rate

    def _lead(self, pitch: float, flipper: FlipperReading, speed: float, dt_s: float) -> float:
        self._refine(pitch, flipper, dt_s)
        softly = max(FLIPPER_PER_S * pitch, GENTLY_RAD_S)
        slides_m = max(self._geometry.slide(max(pitch, 0.0), *self._place), self._geometry.radius_m)  # avoids division by zero
        smoothly = SLIDE_M_S / slides_m
        lags = self._tip.is_unloaded and pitch > self._lead_rad + LAGS_RAD
        fastest = GENTLY_RAD_S if lags else TURN_RAD_S
        self._lead_rad_s = min(self._lead_rad_s + TURN_RAD_S2 * dt_s, fastest, softly, smoothly)
        self._lead_rad = max(self._lead_rad - self._lead_rad_s * dt_s, pitch - LIFTED_RAD)
        per_pitch, per_metre = self._geometry.rates(pitch, *self._place)
        trim = FLIPPER_PER_S * (self._lead_rad - pitch)
        if self._tip.is_unloaded:
            trim = max(trim, 0.0)  # the flipper must not move away from a chair that does not follow
        return per_pitch * (trim - self._lead_rad_s) + per_metre * speed
