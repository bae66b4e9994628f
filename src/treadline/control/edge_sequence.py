"""Descending over the edge rearwards with a flipper: the flipper stands on the landing and first lifts the chair's front.

The crest sequence in reverse (``control/crest_sequence.py``); the sequence is our own, see docs/decisions/0013-flipper.md.
``ImuSample, FlipperReading, TrackReading -> EdgeCommand``.

Without a flipper a chair whose centre of mass passes the edge falls onto the flight. With a flipper there are five stages:
back to the edge; stand still and press the tip on the landing; lift the front until the belts are parallel to the flight,
with the centre of mass still on the landing's side of the nosing; back on until the belts lie; stow the flipper. The tip
load measures the position of the centre of mass: the belts keep it where the flipper can still lower the chair onto the
landing.
"""

import math
from dataclasses import dataclass
from typing import Literal

from treadline.control.flipper import LIFTED_RAD, OVER_BELTS_RAD, UNLOADED_N, PitchCommand, SequenceConfig, Sequencer, flipper_of
from treadline.core.angles import DEG
from treadline.core.signals import FlipperReading
from treadline.vehicle.loading import plumb

Stage = Literal["approach", "press", "lift", "settle", "leave", "done", "lower", "barred"]

CLOSE_RAD = 0.5 * DEG
"""Pitch error at which the lift is complete [rad]."""
SUNK_RAD = 4.0 * DEG
"""Pitch below the lifted pitch at which the flipper has yielded [rad]."""
PROPPED_RAD = 3.0 * DEG
"""Pitch above the lifted pitch at which the flipper props the chair up instead of folding [rad]."""
BEARS_SHARE, GIVES_RAD_S = 0.1, 40.0 * DEG
"""Share of the motor's torque above which the flipper yields to a chair whose belts lie, and its rate at full torque [rad/s]. With
a lower share, a chair whose centre of mass passes a high nosing falls to its rear; with a higher share, the tip drags the
chair down a flight with low friction."""
STOWED_RAD = 5.0 * DEG
"""Angle error at which the flipper counts as stowed [rad]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class EdgeConfig(SequenceConfig):
    """Chair, assumed load and speeds of the edge sequence."""

    edge_m_s: float = 0.1
    early_m: float = 0.25
    """Margin before the last position from which the chair can be lifted completely [m]: covers 15 cm of delay and 10 cm of error
    of the centre of mass."""
    keep_m: float = 0.05
    """Distance of the centre of mass on the landing's side of the nosing after the lift [m]."""
    keep_per_s: float = 1.0
    """Belt speed per deviation of the centre of mass from ``keep_m`` [1/s]."""
    lift_m_s: float = 0.08
    reach_rad_s: float = 12.0 * DEG
    lift_rad_s: float = 9.0 * DEG
    lift_rad_s2: float = 20.0 * DEG
    """Angular acceleration at the start of the lift [rad/s²]."""
    soften_per_s: float = 2.0
    """Rate of the reference per remaining angle [1/s]."""
    yield_per_s: float = 6.0
    """Flipper rate per pitch lead over the reference [1/s]: slipping belts let the flipper prop the chair up."""
    behind_rad: float = 1.0 * DEG
    """Largest lead of the reference over the pitch [rad]."""
    steeper_rad: float = 1.5 * DEG
    """Lift above the slope [rad]: a chair lifted too little falls the remaining angle, with 3 m/s² from 2.5°."""
    near_rad: float = 3.0 * DEG
    """Pitch below the slope from which the belts may touch the next nosing [rad]."""
    touched_m: float = 0.12
    """Increase of the centre of mass's distance from the nosing, measured by the tip load, at which the chair pivots about the next
    nosing [m]."""
    touched_s: float = 0.1
    spare_rad: float = 3.0 * DEG
    """Margin to the end of the flipper's range [rad]."""
    settle_m_s: float = 0.05
    seek_rad_s: float = 4.0 * DEG
    """Rate at which an unloaded tip is lowered onto the landing [rad/s]."""
    leave_m: float = 0.06
    """Distance of the front pulley before the nosing at which the flipper is stowed [m]: until then the tip stabilises the chair on
    uneven nosings; shortly after, the flipper would touch the first of them."""
    stow_rad_s: float = 25.0 * DEG


EdgeCommand = PitchCommand[Stage]
"""Belt speed and flipper rate commanded by the edge sequence."""


class Edge(Sequencer[Stage]):
    """State machine for one descent over the edge, facing up.

    Args:
        config: Chair, load and speeds.
        nosing_behind_m: Distance of the landing's nosing behind mid-track along the belts, at the first step; from the stair map.
        slope_rad: Slope of the flight [rad]; from the stair map.
    """

    UNTOUCHED = frozenset({"approach"})

    def __init__(self, config: EdgeConfig, nosing_behind_m: float, slope_rad: float) -> None:
        super().__init__(config, "approach", -nosing_behind_m)
        self._config = config
        flipper = flipper_of(config.chair)
        self._max_rate_rad_s = flipper.max_rate_deg_s * DEG
        self._most_n_m = flipper.torque_n_m
        self._lowest_rad = flipper.range_deg[0] * DEG
        self._slope_rad = slope_rad
        self._press_from_m = config.early_m - plumb(config, slope_rad)
        self._level_rad = 0.0
        self._highest_rad = self._waited_s = 0.0
        self._turns_back = False
        self._lifted_rad = slope_rad + config.steeper_rad
        self._least_m, self._touched_s = math.inf, 0.0

    def nosing_seen(self, behind_m: float) -> None:
        """Update the position of the nosing, as long as no contact has measured it."""
        self._see(-behind_m)

    def turn_back(self) -> bool:
        """Lower the chair onto the landing again, if the flipper still can; return whether it can."""
        on_the_landing = self._stage == "settle" and self._com_beyond(self._slope_rad) > 0.0
        self._turns_back |= on_the_landing or self._stage in ("press", "lift", "lower")
        return self._turns_back

    @property
    def _behind_m(self) -> float:
        return -self._ahead_m

    def _begin(self, stage: Stage, pitch: float) -> None:
        """Begin to turn the chair from the current pitch."""
        self._stage = stage
        self._lead_from(pitch)
        self._highest_rad, self._waited_s = pitch, 0.0
        self._lifted_rad = self._slope_rad + self._config.steeper_rad
        self._least_m, self._touched_s = math.inf, 0.0

    def _sequence(self, pitch: float, flipper: FlipperReading, dt_s: float) -> None:
        config = self._config
        match self._stage:
            case "approach" if self._behind_m < self._press_from_m:
                self._begin("press", pitch)
                self._level_rad = pitch
            case "press" if self._tip.carries or pitch > self._level_rad + LIFTED_RAD:
                self._begin("lift", pitch)
            case "lift" if not self._turns_back and (self._touches(pitch, dt_s) or pitch > self._lifted_rad - CLOSE_RAD):
                self._stage = "settle"
            case "press" | "lift" | "settle" if self._gives_up():
                self._begin("lower", pitch)
            case "settle" | "leave" if pitch > self._lifted_rad + PROPPED_RAD:
                self._stage = "barred"
            case "settle" if pitch < self._lifted_rad - SUNK_RAD:
                self._begin("lift", pitch)
            case "lower" if pitch < self._level_rad + LIFTED_RAD or self._waited_s > 2.0 * config.patience_s:
                self._stage = "barred"
            case "settle" if self._past_m < config.leave_m:
                self._begin("leave", pitch)
            case "leave" if self._past_m < 0.0 and self._is_up(flipper, OVER_BELTS_RAD - STOWED_RAD):
                self._stage = "done"
            case _:
                pass

    def _gives_up(self) -> bool:
        """Whether the chair is to be lowered again: on request, or because the flipper makes no progress."""
        return self._turns_back or (self._stage != "settle" and self._waited_s > self._config.patience_s)

    def _act(self, pitch: float, flipper: FlipperReading, speed: float, dt_s: float) -> tuple[float, float]:
        config = self._config
        match self._stage:
            case "approach":
                is_near = self._behind_m < self._press_from_m + config.slow_within_m
                if not is_near:
                    return -config.cruise_m_s, 0.0
                return -config.edge_m_s, self._towards(OVER_BELTS_RAD, flipper)
            case "press":
                self._watch(pitch, dt_s)
                return 0.0, -config.reach_rad_s
            case "lift":
                return self._balance(pitch), self._turn(self._lifted_rad, pitch, flipper, speed, dt_s)
            case "settle":
                return -config.settle_m_s, self._settle(pitch, flipper, speed, dt_s)
            case "lower":
                return max(self._balance(pitch), 0.0), self._lower(pitch, flipper, speed, dt_s)
            case "barred":
                return 0.0, self._stow(self._rest_rad, flipper)
            case _:
                self._watch(pitch, dt_s)
                return (-config.edge_m_s if self._is_up(flipper, 0.0) else 0.0), self._stow(OVER_BELTS_RAD, flipper)

    def _com_margin(self, pitch: float) -> float:
        """Return the distance of the centre of mass before the nosing after the complete lift, estimated from the tip load."""
        config = self._config
        reach = self._geometry.reach(pitch, self._past_m)
        before = self._tip.load_n * reach / (config.weight_n * math.cos(pitch))
        return before + plumb(config, self._slope_rad) - plumb(config, pitch)

    def _settle(self, pitch: float, flipper: FlipperReading, speed: float, dt_s: float) -> float:
        """Return the flipper rate that keeps the front on the tip while the chair backs onto the nosings; yields under load."""
        share = max(-flipper.torque_n_m / self._most_n_m, 0.0)
        rate = self._turn(self._lifted_rad, pitch, flipper, speed, dt_s)
        return rate + GIVES_RAD_S * max(share - BEARS_SHARE, 0.0)

    def _touches(self, pitch: float, dt_s: float) -> bool:
        """Whether the belts have touched the next nosing: lifted further, the chair would pivot about that nosing."""
        config = self._config
        if pitch < self._slope_rad - config.near_rad:
            return False
        margin = self._com_margin(pitch)
        self._least_m = min(self._least_m, margin)
        self._touched_s = self._touched_s + dt_s if margin > self._least_m + config.touched_m else 0.0
        if self._touched_s < config.touched_s:
            return False
        self._lifted_rad = max(pitch, self._slope_rad)
        return True

    def _balance(self, pitch: float) -> float:
        """Return the belt speed that keeps the centre of mass at its distance before the nosing after the complete lift."""
        config = self._config
        speed = config.keep_per_s * (config.keep_m - self._com_margin(pitch))
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
        _, per_metre = self._geometry.rates(pitch, self._past_m)
        return per_metre * speed - self._config.seek_rad_s

    def _turn(self, target: float, pitch: float, flipper: FlipperReading, speed: float, dt_s: float) -> float:
        """Return the flipper rate that moves the pitch to a target, tip on the landing."""
        config = self._config
        self._refine(pitch, flipper, dt_s)
        self._watch(pitch, dt_s)
        per_pitch, per_metre = self._geometry.rates(pitch, self._past_m)
        to_go = target - self._lead_rad
        fastest = min(config.lift_rad_s, config.soften_per_s * abs(to_go), 0.9 * self._max_rate_rad_s / -per_pitch)
        has_range = pitch + self._geometry.depression(pitch, self._past_m) < -self._lowest_rad - config.spare_rad
        if to_go > 0.0 and not has_range:
            fastest = 0.0
        self._lead_rad_s = min(self._lead_rad_s + config.lift_rad_s2 * dt_s, fastest)
        lead_rad_s = math.copysign(self._lead_rad_s, to_go)
        lead_rad = self._lead_rad + lead_rad_s * dt_s
        self._lead_rad = min(max(lead_rad, pitch - config.behind_rad), pitch + config.behind_rad)
        behind = self._lead_rad - pitch
        trim = (config.trim_per_s if behind > 0.0 else config.yield_per_s) * behind
        return per_pitch * (lead_rad_s + trim) + per_metre * speed

    def _watch(self, pitch: float, dt_s: float) -> None:
        """Update the time since the pitch last grew by a degree."""
        self._waited_s += dt_s
        if pitch > self._highest_rad + LIFTED_RAD:
            self._highest_rad, self._waited_s = pitch, 0.0

    def _is_up(self, flipper: FlipperReading, angle_rad: float) -> bool:
        """Whether the flipper is raised far enough, or dead: a dead flipper is dragged over the nosing and rises slowly."""
        return flipper.angle_rad > angle_rad or self._waited_s > self._config.patience_s

    def _stow(self, angle_rad: float, flipper: FlipperReading) -> float:
        fastest = self._config.stow_rad_s if self._tip.load_n < UNLOADED_N else self._config.lift_rad_s
        return min(self._towards(angle_rad, flipper), fastest)
