"""Down over the edge, rearwards, on a flipper: the flipper stands on the landing and lifts the chair's front first.

The crest run backwards (``control/crest.py``); sequence and figures are ours, see
docs/decisions/0013-flipper.md. ``ImuSample, FlipperReading, TrackReading -> EdgeCommand``.

Without a flipper a chair whose centre of mass is backed over the edge falls onto the flight. With it, five stages: back to
the edge; stand still and press the tip on the landing; lift the front until the belts point down the flight, centre of
mass still on the landing's side of the nosing; back on until the belts lie; stow the flipper. What the tip carries tells
where the centre of mass is: the belts keep it where the flipper can still lower the chair onto the landing again.
"""

import math
from dataclasses import dataclass
from typing import Literal

from treadline.angles import DEG
from treadline.control.flipper import LIFTED_RAD, OVER_BELTS_RAD, UNLOADED_N, flipper_of
from treadline.control.sequencer import PitchCommand, Sequencer
from treadline.mechanics.loading import Loading, plumb
from treadline.signals import FlipperReading

Stage = Literal["approach", "press", "lift", "settle", "leave", "done", "lower", "barred"]

CLOSE_RAD = 0.5 * DEG
"""To the pitch it is lifted to."""
SUNK_RAD = 4.0 * DEG
"""Below the pitch it was lifted to: the flipper has given way."""
PROPPED_RAD = 3.0 * DEG
"""Above that pitch: the flipper stands where it is to fold, and props the chair up as it backs."""
BEARS_SHARE, GIVES_RAD_S = 0.1, 40.0 * DEG
"""Of the motor's torque, beyond which the flipper gives way to a chair whose belts lie, and how fast at all of it. With less, a
chair whose centre of mass passes a high nosing falls to its rear; with more, the tip drags one on little friction down the
flight."""
STOWED_RAD = 5.0 * DEG
"""To where the flipper is to be."""


@dataclass(frozen=True, slots=True, kw_only=True)
class EdgeConfig(Loading):
    """The chair, what is believed of its load, and the pace."""

    cruise_m_s: float = 0.2
    edge_m_s: float = 0.1
    slow_within_m: float = 0.5
    """Of the place where the tip is pressed down."""
    early_m: float = 0.25
    """Before the chair stands where it can be lifted all the way: 15 cm too late and 10 cm of centre of mass are borne."""
    keep_m: float = 0.05
    """Of the centre of mass on the landing's side of the nosing, once the front is lifted."""
    keep_per_s: float = 1.0
    """Belt speed per metre by which the centre of mass is off ``keep_m``."""
    lift_m_s: float = 0.08
    reach_rad_s: float = 12.0 * DEG
    lift_rad_s: float = 9.0 * DEG
    lift_rad_s2: float = 20.0 * DEG
    """How fast the lift begins."""
    soften_per_s: float = 2.0
    """Lead per angle that is left."""
    trim_per_s: float = 2.0
    """Flipper rate per angle by which the pitch is behind its lead."""
    yield_per_s: float = 6.0
    """The same where the pitch is above it: belts that slip back over the nosing prop the chair up by its flipper."""
    behind_rad: float = 1.0 * DEG
    """A lead never runs further ahead of the pitch."""
    steeper_rad: float = 1.5 * DEG
    """Than the slope the front is lifted: a chair lifted too little falls the rest, and that is 3 m/s² from 2.5° on."""
    near_rad: float = 3.0 * DEG
    """Below the slope, from where on the belts may meet the next nosing."""
    touched_m: float = 0.12
    """Of the centre of mass further from the nosing than it was, as the tip's load tells: the chair turns about the next one."""
    touched_s: float = 0.1
    patience_s: float = 8.0
    """For one more degree, and for the flipper to be stowed: a motor that is too weak, or dead, gets no further."""
    spare_rad: float = 3.0 * DEG
    """Of the flipper's range."""
    settle_m_s: float = 0.05
    seek_rad_s: float = 4.0 * DEG
    """At which a tip that does not carry is lowered onto the landing."""
    leave_m: float = 0.06
    """Of the front pulley before the nosing, where the flipper is stowed: until then the tip steadies the chair on uneven nosings,
    and soon the flipper lies on the first of them."""
    stow_rad_s: float = 25.0 * DEG


EdgeCommand = PitchCommand[Stage]
"""What the edge asks of belts and flipper."""


class Edge(Sequencer[Stage]):
    """Sequencer of one way down over the edge, facing up.

    Args:
        nosing_behind_m: Of the landing's nosing behind mid-track along the belts, at the first step; from the stair map.
        slope_rad: Of the flight; from the stair map.
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
        """Take a better place of the nosing, as long as no contact tells it."""
        self._see(-behind_m)

    def turn_back(self) -> bool:
        """Let the chair down on the landing again, as long as the flipper can; say whether it can."""
        on_the_landing = self._stage == "settle" and self._com_beyond(self._slope_rad) > 0.0
        self._turns_back |= on_the_landing or self._stage in ("press", "lift", "lower")
        return self._turns_back

    @property
    def _behind_m(self) -> float:
        return -self._ahead_m

    def _begin(self, stage: Stage, pitch: float) -> None:
        """Begin to turn the chair, from where it is."""
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
        """Tell whether the chair is to be let down again: it was told to, or the flipper gets no further."""
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

    def _left_over(self, pitch: float) -> float:
        """Return how far before the nosing the whole lift leaves the centre of mass, by what the tip carries now."""
        config = self._config
        reach = self._geometry.reach(pitch, self._past_m)
        before = self._tip.load_n * reach / (config.weight_n * math.cos(pitch))
        return before + plumb(config, self._slope_rad) - plumb(config, pitch)

    def _settle(self, pitch: float, flipper: FlipperReading, speed: float, dt_s: float) -> float:
        """Return the flipper rate that keeps the front on its tip while the chair backs onto the nosings; it yields to load."""
        share = max(-flipper.torque_n_m / self._most_n_m, 0.0)
        rate = self._turn(self._lifted_rad, pitch, flipper, speed, dt_s)
        return rate + GIVES_RAD_S * max(share - BEARS_SHARE, 0.0)

    def _touches(self, pitch: float, dt_s: float) -> bool:
        """Say whether the belts have met the next nosing: lifted on, the chair would turn about that one and lean on its tip."""
        config = self._config
        if pitch < self._slope_rad - config.near_rad:
            return False
        left_over = self._left_over(pitch)
        self._least_m = min(self._least_m, left_over)
        self._touched_s = self._touched_s + dt_s if left_over > self._least_m + config.touched_m else 0.0
        if self._touched_s < config.touched_s:
            return False
        self._lifted_rad = max(pitch, self._slope_rad)
        return True

    def _balance(self, pitch: float) -> float:
        """Return the belt speed that keeps the centre of mass where the whole lift leaves it before the nosing."""
        config = self._config
        speed = config.keep_per_s * (config.keep_m - self._left_over(pitch))
        highest = config.lift_m_s if self._behind_m < self._press_from_m else 0.0
        return min(max(speed, -config.lift_m_s), highest)

    def _lower(self, pitch: float, flipper: FlipperReading, speed: float, dt_s: float) -> float:
        """Return the flipper rate that lets the chair down on the landing, as long as it leans on the tip.

        A chair that lies on the flight does not follow a flipper that is raised, and would fall onto it as it drives back over the
        nosing: the tip seeks the landing until it carries.
        """
        if self._tip.load_n >= UNLOADED_N:
            return self._turn(self._level_rad - LIFTED_RAD, pitch, flipper, speed, dt_s)
        self._lead_from(pitch)
        self._watch(pitch, dt_s)
        _, per_metre = self._geometry.rates(pitch, self._past_m)
        return per_metre * speed - self._config.seek_rad_s

    def _turn(self, target: float, pitch: float, flipper: FlipperReading, speed: float, dt_s: float) -> float:
        """Return the flipper rate that leads the pitch to a target, tip on the landing."""
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
        """Count how long the pitch has not grown by a degree."""
        self._waited_s += dt_s
        if pitch > self._highest_rad + LIFTED_RAD:
            self._highest_rad, self._waited_s = pitch, 0.0

    def _is_up(self, flipper: FlipperReading, angle_rad: float) -> bool:
        """Tell whether the flipper is up so far, or dead: then it trails over the nosing, for its brake lets it rise slowly."""
        return flipper.angle_rad > angle_rad or self._waited_s > self._config.patience_s

    def _stow(self, angle_rad: float, flipper: FlipperReading) -> float:
        fastest = self._config.stow_rad_s if self._tip.load_n < UNLOADED_N else self._config.lift_rad_s
        return min(self._towards(angle_rad, flipper), fastest)
