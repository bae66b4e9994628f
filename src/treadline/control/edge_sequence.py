"""Descending over the edge rearwards with a flipper: the flipper stands on the landing and first lifts the chair's front.

The crest sequence in reverse (``control/crest_sequence.py``); the sequence is our own, see docs/decisions/0013-flipper.md.
``ImuSample, FlipperReading, TrackReading -> EdgeCommand``.

Without a flipper a chair whose centre of mass passes the edge falls onto the flight. With a flipper there are five stages:
back to the edge; stand still and press the tip on the landing; lift the front to the slope of the uppermost nosings, with the
centre of mass before the edge by the tip-over margin wanted; back on until the belts lie; stow the flipper while backing on,
once it would touch the edge: a chair that stood without it would tip forward onto a low edge. The tip load
measures the position of the centre of mass: the belts keep it where the flipper can still lower the chair onto the landing.
"""

import math
from typing import Literal

from treadline.control.flipper import (
    FLIPPER_PER_S,
    GENTLY_RAD_S,
    LIFTED_RAD,
    OFF_RAD,
    OVER_BELTS_RAD,
    PATIENCE_S,
    SLOW_M_S,
    STOW_RAD_S,
    THERE_RAD,
    TURN_RAD_S,
    TURN_RAD_S2,
    PitchCommand,
    Sequencer,
    load_share,
)
from treadline.core.angles import DEG
from treadline.core.signals import FlipperReading
from treadline.estimation.known_nosings import KnownNosings
from treadline.vehicle.loading import Loading, before_for_margin, plumb
from treadline.vehicle.tip_over_margin import MARGIN_LIMIT_RAD

Stage = Literal["approach", "press", "lift", "settle", "leave", "done", "lower", "barred"]


BEARS_SHARE, GIVES_RAD_S = 0.1, 40.0 * DEG
"""Share of the motor's torque above which the flipper yields to a chair whose belts lie, and its rate at full torque [rad/s]. With
a lower share, a chair whose centre of mass passes a high nosing falls to its rear; with a higher share, the tip drags the
chair down a flight with low friction; yielding as a riding flipper does costs 1° of margin on a single step."""
CLOSE_RAD = 0.5 * DEG
"""Pitch error at which the lift is complete [rad]: at 1° the rest of the fall gives the passenger 1.8 m/s² instead of 1.5."""
EARLY_M = 0.25
"""Margin before the last position from which the chair can be lifted completely [m]: covers 15 cm of delay and 10 cm of error of
the centre of mass."""
LEAST_RAD = 5.0 * DEG
"""Tip-over margin below which the chair is not lifted over the edge [rad]; ``MARGIN_LIMIT_RAD`` is kept where the flipper's range
allows it."""
KEEP_PER_S, LIFT_M_S = 1.0, 0.08
"""Belt speed per deviation of the centre of mass from its place before the edge [1/s], and its limit [m/s]."""
YIELD_PER_S = 6.0
"""Flipper rate per pitch lead over the reference [1/s]: slipping belts let the flipper prop the chair up. At 2/s a chair
with split friction falls with 1.8 m/s² at the passenger instead of 1.1."""
RANGE_SPARE_M, SPARE_RAD = 0.02, 3.0 * DEG
"""Error of the centre of mass's place by the tip's load for which the flipper's range must suffice [m], 3 % of error of weight and
reach at 0.6 m of reach; and margin to the end of that range [rad]."""
LEAVE_M = 0.06
"""Distance before the place where the flipper would touch the edge at which it is stowed [m]: until then the tip stabilises the
chair on uneven nosings."""
SETTLE_M_S = 0.05
"""Belt speed while the chair backs onto the nosings [m/s]."""

EdgeCommand = PitchCommand[Stage]
"""Belt speed and flipper rate commanded by the edge sequence."""


class Edge(Sequencer[Stage]):
    """State machine for one descent over the edge, facing up.

    Args:
        loading: Chair and assumed load.
        around: Nosings around the chair; the uppermost is the edge.
        wanted_rad: Tip-over margin of the lifted chair before the edge, where the flipper's range allows it.
        least_rad: Tip-over margin below which the chair is not lifted over the edge.
    """

    def __init__(
        self, loading: Loading, around: KnownNosings, wanted_rad: float = MARGIN_LIMIT_RAD, least_rad: float = LEAST_RAD
    ) -> None:
        super().__init__(loading, "approach", around)
        self._wanted_rad, self._least_rad = wanted_rad, least_rad
        self._level_rad = 0.0
        self._highest_rad = self._waited_s = 0.0
        self._turns_back = False
        self._slope_rad, self._target_rad, self._keep_m = 0.0, 0.0, 0.0
        """Slope below the edge and pitch of the complete lift [rad], and the centre of mass's distance before the edge then [m]."""
        self._lifted_rad = self._bore_rad = 0.0
        """Pitch of the complete lift here, and the flipper's angle when it stopped bearing [rad]."""
        self._aim()

    def refusal(self, around: KnownNosings, sigmas: float) -> str:
        """Return why the chair cannot be let down over this edge, or an empty string.

        Args:
            around: Nosings around the chair.
            sigmas: Standard deviations by which the uppermost nosings may be less steep than measured.
        """
        slope, sigma = around.lies(self._geometry.pivot_m, 0.0, self._geometry.radius_m)
        if self._lift(slope - (sigmas * sigma if sigmas else 0.0)) is not None:
            return ""
        lowest, least = self._lowest_rad / DEG, self._least_rad / DEG
        why = f"to lift the chair to them with {least:.0f}° to tipping, the flipper would have to turn below its {lowest:.0f}°"
        return f"the uppermost nosings are {slope / DEG:.1f}° steep: {why}; take another way"

    def _aim(self) -> None:
        """Set pitch and place of the lift by the slope of the uppermost nosings."""
        self._slope_rad = self._lies()[0]
        self._target_rad, self._keep_m = self._lift(self._slope_rad) or (
            self._slope_rad,
            before_for_margin(self._loading, self._slope_rad, self._least_rad),
        )
        self._press_from_m = EARLY_M - plumb(self._loading, self._slope_rad)

    def _lift(self, slope_rad: float) -> tuple[float, float] | None:
        """Return pitch and distance of the centre of mass before the edge for a complete lift; None if the flipper cannot do it.

        A chair that lacks a degree of the slope falls by it.
        """
        for pitch in (slope_rad, slope_rad - LIFTED_RAD):
            most_m = self._most_before_m(pitch) - RANGE_SPARE_M
            if most_m >= before_for_margin(self._loading, pitch, self._least_rad):
                return pitch, min(before_for_margin(self._loading, pitch, self._wanted_rad), most_m)
        return None

    def turn_back(self) -> bool:
        """Lower the chair onto the landing again, if the flipper still can; return whether it can."""
        on_the_landing = self._stage == "settle" and self._com_beyond(self._slope_rad) > 0.0
        self._turns_back |= on_the_landing or self._stage in ("press", "lift", "lower")
        return self._turns_back

    @property
    def _behind_m(self) -> float:
        """Distance of the edge behind mid-track [m]."""
        return self._edge_past_m - self._geometry.pivot_m

    def _begin(self, stage: Stage, pitch: float) -> None:
        """Begin to turn the chair from the current pitch."""
        self._stage = stage
        self._lead_from(pitch)
        self._highest_rad, self._waited_s = pitch, 0.0
        self._lifted_rad = self._target_rad

    def _sequence(self, pitch: float, flipper: FlipperReading, dt_s: float) -> None:
        del dt_s
        match self._stage:
            case "approach" if self._is_near():
                self._begin("press", pitch)
                self._level_rad = pitch
            case "press" if self._tip.carries or pitch > self._level_rad + LIFTED_RAD:
                self._begin("lift", pitch)
            case "lift" if not self._turns_back and pitch > self._lifted_rad - CLOSE_RAD:
                self._stage = "settle"
            case "press" | "lift" | "settle" if self._gives_up():
                self._begin("lower", pitch)
            case "settle" | "leave" if pitch > self._lifted_rad + OFF_RAD:
                self._stage = "barred"
            case "settle" if pitch < self._lifted_rad - OFF_RAD:
                self._begin("lift", pitch)
            case "lower" if pitch < self._level_rad + LIFTED_RAD or self._waited_s > 2.0 * PATIENCE_S:
                self._stage = "barred"
            case "settle" if self._edge_past_m < LEAVE_M - self._clears_m(flipper):
                self._begin("leave", pitch)
                self._bore_rad = flipper.angle_rad
            case "leave" if self._edge_past_m < 0.0 and self._is_up(flipper, OVER_BELTS_RAD - THERE_RAD):
                self._stage = "done"
            case _:
                pass

    def _clears_m(self, flipper: FlipperReading) -> float:
        """Return how far beyond its axis the flipper clears an edge below the belts' line [m], at most half of its length."""
        clears_m = max(-self._around.top.above_m, 0.0) / math.tan(max(-flipper.angle_rad, OVER_BELTS_RAD))
        return min(clears_m, 0.5 * self._geometry.length_m)

    def _is_near(self) -> bool:
        """Return whether the chair is where the tip is pressed down; the map shows ever better how far it is to be lifted."""
        self._aim()
        return self._behind_m < self._press_from_m

    def _gives_up(self) -> bool:
        """Whether the chair is to be lowered again: on request, or because the flipper makes no progress."""
        return self._turns_back or (self._stage != "settle" and self._waited_s > PATIENCE_S)

    def _act(self, pitch: float, flipper: FlipperReading, speed: float, dt_s: float) -> tuple[float, float]:
        match self._stage:
            case "approach":
                return -SLOW_M_S, self._towards(OVER_BELTS_RAD, flipper)
            case "press":
                self._watch(pitch, dt_s)
                return 0.0, self._reach(pitch, flipper)
            case "lift":
                if self._behind_m < 0.0:  # the edge has passed mid-track
                    self._follow_the_rear()
                return self._balance(pitch), self._turn(self._lifted_rad, pitch, flipper, speed, dt_s)
            case "settle":
                return -SETTLE_M_S, self._settle(pitch, flipper, speed, dt_s)
            case "lower":
                return max(self._balance(pitch), 0.0), self._lower(pitch, flipper, speed, dt_s)
            case "barred":
                return 0.0, self._stow(self._rest_rad, flipper)
            case _:
                self._watch(pitch, dt_s)
                return -self._leaving_m_s(flipper), self._stow(OVER_BELTS_RAD, flipper)

    def _com_margin(self, pitch: float) -> float:
        """Return the distance of the centre of mass before the nosing after the complete lift, estimated from the tip load."""
        reach = self._geometry.reach(pitch, *self._place)
        before = self._tip.load_n * reach / (self._loading.weight_n * math.cos(pitch))
        return before + plumb(self._loading, self._target_rad) - plumb(self._loading, pitch)

    def _settle(self, pitch: float, flipper: FlipperReading, speed: float, dt_s: float) -> float:
        """Return the flipper rate that keeps the front on the tip while the chair backs onto the nosings; yields under load."""
        self._follow_the_rear()
        gives = GIVES_RAD_S * max(load_share(flipper, self._flipper.torque_n_m) - BEARS_SHARE, 0.0)
        return self._turn(self._lifted_rad, pitch, flipper, speed, dt_s) + gives

    def _follow_the_rear(self) -> None:
        """Lower the lifted pitch: the further the rear moves away on the floor, the less the chair is pitched."""
        self._lifted_rad = min(self._lifted_rad, self._lies(-self._behind_m)[0])

    def _balance(self, pitch: float) -> float:
        """Return the belt speed that keeps the centre of mass at its distance before the nosing after the complete lift."""
        speed = KEEP_PER_S * (self._keep_m - self._com_margin(pitch))
        highest = LIFT_M_S if self._behind_m < self._press_from_m else 0.0
        return min(max(speed, -LIFT_M_S), highest)

    def _lower(self, pitch: float, flipper: FlipperReading, speed: float, dt_s: float) -> float:
        """Return the flipper rate that lowers the chair onto the landing, as long as the chair leans on the tip.

        A chair that lies on the flight does not follow a rising flipper, and would fall onto it when driving back over the nosing;
        an unloaded tip is therefore lowered until it carries load.
        """
        if not self._tip.is_unloaded:
            return self._turn(self._level_rad - LIFTED_RAD, pitch, flipper, speed, dt_s)
        self._lead_from(pitch)
        self._watch(pitch, dt_s)
        _, per_metre = self._geometry.rates(pitch, *self._place)
        return per_metre * speed - GENTLY_RAD_S

    def _turn(self, target: float, pitch: float, flipper: FlipperReading, speed: float, dt_s: float) -> float:
        """Return the flipper rate that moves the pitch to a target, tip on the landing."""
        self._refine(pitch, flipper, dt_s)
        self._watch(pitch, dt_s)
        per_pitch, per_metre = self._geometry.rates(pitch, *self._place)
        to_go = target - self._lead_rad
        fastest = min(TURN_RAD_S, FLIPPER_PER_S * abs(to_go), 0.9 * self._flipper.max_rate_deg_s * DEG / -per_pitch)
        has_range = pitch + self._geometry.depression(pitch, *self._place) < -self._lowest_rad - SPARE_RAD
        if to_go > 0.0 and not has_range:
            fastest = 0.0
        self._lead_rad_s = min(self._lead_rad_s + TURN_RAD_S2 * dt_s, fastest)
        lead_rad_s = math.copysign(self._lead_rad_s, to_go)
        lead_rad = self._lead_rad + lead_rad_s * dt_s
        self._lead_rad = min(max(lead_rad, pitch - LIFTED_RAD), pitch + LIFTED_RAD)
        behind = self._lead_rad - pitch
        trim = (FLIPPER_PER_S if behind > 0.0 else YIELD_PER_S) * behind
        if self._tip.is_unloaded:  # the chair may fall back onto it; from a degree on the reference follows the chair
            trim = max(trim, 0.0)
        return per_pitch * (lead_rad_s + trim) + per_metre * speed

    def _watch(self, pitch: float, dt_s: float) -> None:
        """Update the time since the pitch last grew by a degree."""
        self._waited_s += dt_s
        if pitch > self._highest_rad + LIFTED_RAD:
            self._highest_rad, self._waited_s = pitch, 0.0

    def _leaving_m_s(self, flipper: FlipperReading) -> float:
        """Return the speed of backing on, gentle while the flipper rises; on one slower than half its rate the chair stands."""
        if self._is_up(flipper, 0.0):
            return SLOW_M_S
        rises = flipper.angle_rad > self._bore_rad + 0.5 * TURN_RAD_S * self._waited_s - LIFTED_RAD
        return SETTLE_M_S if rises else 0.0

    def _is_up(self, flipper: FlipperReading, angle_rad: float) -> bool:
        """Whether the flipper is raised far enough, or dead: a dead flipper is dragged over the nosing and rises slowly."""
        return flipper.angle_rad > angle_rad or self._waited_s > PATIENCE_S

    def _stow(self, angle_rad: float, flipper: FlipperReading) -> float:
        fastest = STOW_RAD_S if self._tip.is_unloaded else TURN_RAD_S
        return min(self._towards(angle_rad, flipper), fastest)
