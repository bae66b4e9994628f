"""Descending over the edge rearwards with a flipper: the flipper stands on the landing and first lifts the chair's front.

The crest sequence in reverse (``control/crest_sequence.py``); the sequence is our own, see docs/decisions/0013-flipper.md.
``ImuSample, FlipperReading, TrackReading -> EdgeCommand``.

Without a flipper a chair whose centre of mass passes the edge falls onto the flight. With a flipper there are five stages:
back to the edge; stand still and press the tip on the landing; lift the front to the slope of the uppermost nosings, with the
centre of mass before the edge by the tip-over margin wanted; back on until the belts lie; stow the flipper. The tip load
measures the position of the centre of mass: the belts keep it where the flipper can still lower the chair onto the landing.
"""

import math
from dataclasses import dataclass
from typing import Literal

from treadline.control.flipper import (
    FLIPPER_PER_S,
    LIFTED_RAD,
    OFF_RAD,
    OVER_BELTS_RAD,
    PATIENCE_S,
    UNLOADED_N,
    PitchCommand,
    SequenceConfig,
    Sequencer,
    flipper_of,
)
from treadline.core.angles import DEG
from treadline.core.signals import FlipperReading
from treadline.estimation.known_nosings import KnownNosings
from treadline.vehicle.loading import before_for_margin, plumb
from treadline.vehicle.tip_over_margin import MARGIN_LIMIT_RAD

Stage = Literal["approach", "press", "lift", "settle", "leave", "done", "lower", "barred"]

CLOSE_RAD = 0.5 * DEG
"""Pitch error at which the lift is complete [rad]."""
BEARS_SHARE, GIVES_RAD_S = 0.1, 40.0 * DEG
"""Share of the motor's torque above which the flipper yields to a chair whose belts lie, and its rate at full torque [rad/s]. With
a lower share, a chair whose centre of mass passes a high nosing falls to its rear; with a higher share, the tip drags the
chair down a flight with low friction."""
RANGE_SPARE_M = 0.02
"""Error of the centre of mass's place by the tip's load for which the flipper's range must suffice [m]: 3 % of error of weight and
reach at 0.6 m of reach."""
STOWED_RAD = 5.0 * DEG
"""Angle error at which the flipper counts as stowed [rad]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class EdgeConfig(SequenceConfig):
    """Chair, assumed load and speeds of the edge sequence."""

    slow_within_m: float = 0.5
    """Distance before the place where the tip is pressed down, at which the chair slows down [m]."""
    early_m: float = 0.25
    """Margin before the last position from which the chair can be lifted completely [m]: covers 15 cm of delay and 10 cm of error
    of the centre of mass."""
    wanted_rad: float = MARGIN_LIMIT_RAD
    """Tip-over margin of the lifted chair before the edge [rad], where the flipper's range allows it."""
    least_rad: float = 5.0 * DEG
    """Tip-over margin below which the chair is not lifted over the edge [rad]."""
    keep_per_s: float = 1.0
    """Belt speed per deviation of the centre of mass from its place before the edge [1/s]."""
    lift_m_s: float = 0.08
    yield_per_s: float = 6.0
    """Flipper rate per pitch lead over the reference [1/s]: slipping belts let the flipper prop the chair up."""
    spare_rad: float = 3.0 * DEG
    """Margin to the end of the flipper's range [rad]."""
    settle_m_s: float = 0.05
    seek_rad_s: float = 4.0 * DEG
    """Rate at which an unloaded tip is lowered onto the landing [rad/s]."""
    leave_m: float = 0.06
    """Distance of the front pulley before the nosing at which the flipper is stowed [m]: until then the tip stabilises the chair on
    uneven nosings; shortly after, the flipper would touch the first of them."""


EdgeCommand = PitchCommand[Stage]
"""Belt speed and flipper rate commanded by the edge sequence."""


class Edge(Sequencer[Stage]):
    """State machine for one descent over the edge, facing up.

    Args:
        config: Chair, load and speeds.
        around: Nosings around the chair; the uppermost is the edge.
    """

    _config: EdgeConfig

    def __init__(self, config: EdgeConfig, around: KnownNosings) -> None:
        super().__init__(config, "approach", around)
        flipper = flipper_of(config.chair)
        self._max_rate_rad_s = flipper.max_rate_deg_s * DEG
        self._most_n_m = flipper.torque_n_m
        self._level_rad = 0.0
        self._highest_rad = self._waited_s = 0.0
        self._turns_back = False
        self._slope_rad, self._target_rad, self._keep_m = 0.0, 0.0, 0.0
        """Slope below the edge and pitch of the complete lift [rad], and the centre of mass's distance before the edge then [m]."""
        self._lifted_rad = 0.0
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
        lowest, least = self._lowest_rad / DEG, self._config.least_rad / DEG
        why = f"to lift the chair to them with {least:.0f}° to tipping, the flipper would have to turn below its {lowest:.0f}°"
        return f"the uppermost nosings are {slope / DEG:.1f}° steep: {why}; take another way"

    def _aim(self) -> None:
        """Set pitch and place of the lift by the slope of the uppermost nosings."""
        self._slope_rad = self._lies[0]
        self._target_rad, self._keep_m = self._lift(self._slope_rad) or (
            self._slope_rad,
            before_for_margin(self._config, self._slope_rad, self._config.least_rad),
        )
        self._press_from_m = self._config.early_m - plumb(self._config, self._slope_rad)

    def _lift(self, slope_rad: float) -> tuple[float, float] | None:
        """Return pitch and distance of the centre of mass before the edge for a complete lift; None if the flipper cannot do it.

        A chair that lacks a degree of the slope falls by it.
        """
        config = self._config
        for pitch in (slope_rad, slope_rad - LIFTED_RAD):
            most_m = self._most_before_m(pitch) - RANGE_SPARE_M
            if most_m >= before_for_margin(config, pitch, config.least_rad):
                return pitch, min(before_for_margin(config, pitch, config.wanted_rad), most_m)
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
        config = self._config
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
            case "settle" if self._edge_past_m < config.leave_m:
                self._begin("leave", pitch)
            case "leave" if self._edge_past_m < 0.0 and self._is_up(flipper, OVER_BELTS_RAD - STOWED_RAD):
                self._stage = "done"
            case _:
                pass

    def _is_near(self) -> bool:
        """Return whether the chair is where the tip is pressed down; the map shows ever better how far it is to be lifted."""
        self._aim()
        return self._behind_m < self._press_from_m

    def _gives_up(self) -> bool:
        """Whether the chair is to be lowered again: on request, or because the flipper makes no progress."""
        return self._turns_back or (self._stage != "settle" and self._waited_s > PATIENCE_S)

    def _act(self, pitch: float, flipper: FlipperReading, speed: float, dt_s: float) -> tuple[float, float]:
        config = self._config
        match self._stage:
            case "approach":
                is_near = self._behind_m < self._press_from_m + config.slow_within_m
                if not is_near:
                    return -config.cruise_m_s, 0.0
                return -config.slow_m_s, self._towards(OVER_BELTS_RAD, flipper)
            case "press":
                self._watch(pitch, dt_s)
                return 0.0, self._reach(pitch, flipper)
            case "lift":
                if self._behind_m < 0.0:  # the edge has passed mid-track
                    self._follow_the_rear()
                return self._balance(pitch), self._turn(self._lifted_rad, pitch, flipper, speed, dt_s)
            case "settle":
                return -config.settle_m_s, self._settle(pitch, flipper, speed, dt_s)
            case "lower":
                return max(self._balance(pitch), 0.0), self._lower(pitch, flipper, speed, dt_s)
            case "barred":
                return 0.0, self._stow(self._rest_rad, flipper)
            case _:
                self._watch(pitch, dt_s)
                return (-config.slow_m_s if self._is_up(flipper, 0.0) else 0.0), self._stow(OVER_BELTS_RAD, flipper)

    def _com_margin(self, pitch: float) -> float:
        """Return the distance of the centre of mass before the nosing after the complete lift, estimated from the tip load."""
        config = self._config
        reach = self._geometry.reach(pitch, *self._place)
        before = self._tip.load_n * reach / (config.weight_n * math.cos(pitch))
        return before + plumb(config, self._target_rad) - plumb(config, pitch)

    def _settle(self, pitch: float, flipper: FlipperReading, speed: float, dt_s: float) -> float:
        """Return the flipper rate that keeps the front on the tip while the chair backs onto the nosings; yields under load."""
        share = max(-flipper.torque_n_m / self._most_n_m, 0.0)
        self._follow_the_rear()
        rate = self._turn(self._lifted_rad, pitch, flipper, speed, dt_s)
        return rate + GIVES_RAD_S * max(share - BEARS_SHARE, 0.0)

    def _follow_the_rear(self) -> None:
        """Lower the lifted pitch: the further the rear moves away on the floor, the less the chair is pitched."""
        self._lifted_rad = min(self._lifted_rad, self._lies_at(-self._behind_m)[0])

    def _balance(self, pitch: float) -> float:
        """Return the belt speed that keeps the centre of mass at its distance before the nosing after the complete lift."""
        config = self._config
        speed = config.keep_per_s * (self._keep_m - self._com_margin(pitch))
        highest = config.lift_m_s if self._behind_m < self._press_from_m else 0.0
        return min(max(speed, -config.lift_m_s), highest)

    def _lower(self, pitch: float, flipper: FlipperReading, speed: float, dt_s: float) -> float:
        """Return the flipper rate that lowers the chair onto the landing, as long as the chair leans on the tip.

        A chair that lies on the flight does not follow a rising flipper, and would fall onto it when driving back over the nosing;
        an unloaded tip is therefore lowered until it carries load.
        """
        if self._tip.load_n >= UNLOADED_N:
            return self._turn(self._level_rad - LIFTED_RAD, pitch, flipper, speed, dt_s)
        self._lead_from(pitch)
        self._watch(pitch, dt_s)
        _, per_metre = self._geometry.rates(pitch, *self._place)
        return per_metre * speed - self._config.seek_rad_s

    def _turn(self, target: float, pitch: float, flipper: FlipperReading, speed: float, dt_s: float) -> float:
        """Return the flipper rate that moves the pitch to a target, tip on the landing."""
        config = self._config
        self._refine(pitch, flipper, dt_s)
        self._watch(pitch, dt_s)
        per_pitch, per_metre = self._geometry.rates(pitch, *self._place)
        to_go = target - self._lead_rad
        fastest = min(config.turn_rad_s, FLIPPER_PER_S * abs(to_go), 0.9 * self._max_rate_rad_s / -per_pitch)
        has_range = pitch + self._geometry.depression(pitch, *self._place) < -self._lowest_rad - config.spare_rad
        if to_go > 0.0 and not has_range:
            fastest = 0.0
        self._lead_rad_s = min(self._lead_rad_s + config.turn_rad_s2 * dt_s, fastest)
        lead_rad_s = math.copysign(self._lead_rad_s, to_go)
        lead_rad = self._lead_rad + lead_rad_s * dt_s
        self._lead_rad = min(max(lead_rad, pitch - config.behind_rad), pitch + config.behind_rad)
        behind = self._lead_rad - pitch
        trim = (FLIPPER_PER_S if behind > 0.0 else config.yield_per_s) * behind
        return per_pitch * (lead_rad_s + trim) + per_metre * speed

    def _watch(self, pitch: float, dt_s: float) -> None:
        """Update the time since the pitch last grew by a degree."""
        self._waited_s += dt_s
        if pitch > self._highest_rad + LIFTED_RAD:
            self._highest_rad, self._waited_s = pitch, 0.0

    def _is_up(self, flipper: FlipperReading, angle_rad: float) -> bool:
        """Whether the flipper is raised far enough, or dead: a dead flipper is dragged over the nosing and rises slowly."""
        return flipper.angle_rad > angle_rad or self._waited_s > PATIENCE_S

    def _stow(self, angle_rad: float, flipper: FlipperReading) -> float:
        fastest = self._config.stow_rad_s if self._tip.load_n < UNLOADED_N else self._config.turn_rad_s
        return min(self._towards(angle_rad, flipper), fastest)
