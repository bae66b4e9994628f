"""Over the crest on a flipper: the front track section reaches the landing first and lets the chair down onto it.

Paper: Section II.A, Fig. 3(b) ("variable angle of attack"); sequence and figures are ours, see
docs/decisions/0013-flipper.md. ``ImuSample, FlipperReading, TrackReading -> CrestCommand``.

Without a flipper a chair whose centre of mass passes the last nosing falls freely onto its front. With it, five stages:
climb; slow down and lay the flipper in line with the belts; stand still and reach down until the tip carries; drive on, the
flipper keeping its hold, until the centre of mass has passed; lead the pitch down. The tip's load is told by motor torque,
and by the pitch where the flipper lifts the chair.
"""

from dataclasses import dataclass
from typing import Literal

from treadline.angles import DEG
from treadline.control.flipper import LIFTED_RAD, OVER_BELTS_RAD, PRESS_SHARE, SMALL_RAD, UNLOADED_N
from treadline.control.sequencer import PitchCommand, Sequencer
from treadline.mechanics.loading import Loading, plumb
from treadline.signals import FlipperReading

Stage = Literal["climb", "slow", "reach", "carry", "lead", "land", "done", "barred"]

LATER_M = 0.03
"""Of the centre of mass past the nosing before the lead; as much further before the next try, if the chair did not follow."""
NEAR_M = 0.06
"""Of the centre of mass before the nosing: no further while the tip is unloaded."""
PROPPED_RAD = 4.0 * DEG
"""Above the pitch at which it began to reach: the flipper stands on something else than the landing, and lifts the chair."""
EARLY_RAD, EARLY_M = 12.0 * DEG, 0.05
"""Above where the landing is expected: a tip that stands there stands on the nosing, which is then so far ahead of the front
pulley, for belts that slip outrun the chair."""
CARRIED_M = 1.2
"""Run by the belts while the tip was to carry, from which on they slip: 0.8 m are enough with all errors at once."""
NOT_FOLLOWED_RAD = 0.4 * DEG
"""Of pitch behind the lead, nothing under the tip. The load alone does not tell: a tip that is thrust forward over ground that
grips hangs by its friction, and the motor holds next to nothing (36 to 45° below the level, friction 0.7 to 1)."""
LAGS_RAD, WAITS_RAD_S = 0.25 * DEG, 3.0 * DEG
"""Of pitch behind the lead, from which on a chair that does not lean on the tip is led slowly: it would fall after a faster
flipper, and onto it with 2.6 to 2.8 m/s² at its passenger."""
LIES_S = 1.0
"""Nearly level for so long, nothing under the tip: the belts lie on the landing, though gravity's error hides the level."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CrestConfig(Loading):
    """The chair, what is believed of its load, and the pace."""

    cruise_m_s: float = 0.2
    crest_m_s: float = 0.1
    lead_m_s: float = 0.03
    """While the pitch goes down: the further the chair goes, the more the flipper has to carry."""
    slow_within_m: float = 0.5
    """Of the centre of mass before the nosing."""
    reach_from_m: float = 0.08
    """Of the front pulley past the nosing, before the chair can fall from a high nosing behind it onto the last: 0.16 m at the
    soonest, where nothing would meet its tip. A tip that reaches down 15 cm too early stands on the nosing, and goes on."""
    reach_rad_s: float = 16.0 * DEG
    meet_rad_s: float = 8.0 * DEG
    """At which the tip meets the landing where it is expected: at 16 °/s it struck it with 3 m/s² under a light chair."""
    lead_rad_s: float = 10.0 * DEG
    slide_m_s: float = 0.06
    """Of the tip over the landing as the chair goes down: belts turn all alike, so it slides there. Reaching far down it is thrust
    into a ground that grips (36° and friction 1), sticks and springs free: at 0.13 m/s with 19 °/s and 4 m/s² at the seat."""
    lead_rad_s2: float = 30.0 * DEG
    """How fast the lead begins: half a metre from the nosing this is 0.3 m/s² at the passenger."""
    soften_per_s: float = 2.5
    """Lead per angle that is left: the last 4° go slower."""
    touch_rad_s: float = 4.0 * DEG
    """At which the belts touch the landing: 5 cm/s at the seat."""
    press_n: float = 130.0
    """Load that the tip keeps while the chair drives on."""
    press_rad_s_n: float = 0.1 * DEG
    """Flipper rate per newton that is missing."""
    trim_per_s: float = 2.0
    """Flipper rate per angle by which the pitch is behind its lead."""
    behind_rad: float = 2.0 * DEG
    """A lead never runs further ahead of the pitch."""
    level_rad: float = 0.7 * DEG
    patience_s: float = 8.0
    """For a tip that carries: a motor that is dead, or a landing that is not there, gets no further."""
    stow_rad_s: float = 12.0 * DEG


CrestCommand = PitchCommand[Stage]
"""What the crest asks of belts and flipper."""


class Crest(Sequencer[Stage]):
    """Sequencer of one crossing.

    Args:
        nosing_ahead_m: Of the last nosing ahead of mid-track along the belts, at the first step; from the stair map.
    """

    UNTOUCHED = frozenset({"climb", "slow"})

    def __init__(self, config: CrestConfig, nosing_ahead_m: float) -> None:
        super().__init__(config, "climb", nosing_ahead_m)
        self._config = config
        self._press_n = min(config.press_n, PRESS_SHARE * config.weight_n)
        self._waited_s = self._reached_rad = 0.0
        self._carried_m = 0.0
        """Run by the belts while the tip was to carry."""
        self._tries = 0
        """How often the tip has stood on the nosing, in place of the landing."""
        self._lead_from_m = LATER_M

    def nosing_seen(self, ahead_m: float) -> None:
        """Take a better place of the last nosing, as long as no contact tells it."""
        if self._tries == 0:
            self._see(ahead_m)

    def _sequence(self, pitch: float, flipper: FlipperReading, dt_s: float) -> None:
        config = self._config
        waits = self._stage in ("reach", "carry") and self._tip.load_n < UNLOADED_N and pitch > SMALL_RAD
        self._waited_s = self._waited_s + dt_s if waits else 0.0
        beyond = self._com_beyond(pitch)
        match self._stage:
            case "reach" | "carry" if cause := self._gets_no_further(pitch):
                self._stage, self._cause = "barred", cause
            case "climb" if beyond > -config.slow_within_m or self._past_m > -self._geometry.arm_m:
                self._stage = "slow"
            case "slow" if self._past_m > config.reach_from_m:
                self._stage, self._reached_rad = "reach", pitch
            case "reach" if self._tip.carries or self._is_lifted(pitch):
                self._meet(pitch, flipper)
            case "carry" if self._tip.carries and beyond > self._lead_from_m:
                self._stage = "lead"
                self._lead_from(pitch)
            case "lead" if self._tip.load_n < UNLOADED_N and pitch > max(SMALL_RAD, self._lead_rad + NOT_FOLLOWED_RAD):
                # The chair has not followed: its centre of mass is further back than believed. Reach for the landing again.
                self._stage = "carry"
                self._lead_from_m = beyond + LATER_M
            case "carry" | "lead" if pitch < config.level_rad:
                self._stage = "land"
            case "lead" if pitch < SMALL_RAD and self._tip.unloaded_s > LIES_S:
                self._stage = "land"
            case "land" if self._ahead_m < -self._geometry.pivot_m:
                self._stage = "done"
            case _:
                pass

    def _gets_no_further(self, pitch: float) -> str:
        """Return why the chair would not get over, as far as is felt; nothing where it may."""
        config = self._config
        if self._waited_s > config.patience_s:
            return f"nothing carried the flipper in {config.patience_s:.0f} s: its motor is dead, or the landing is not there"
        if (lifted := pitch - self._reached_rad) > PROPPED_RAD:
            return f"the flipper lifted the chair by {lifted / DEG:.1f}°, and stands on something else than the landing"
        if self._carried_m > CARRIED_M:
            return f"the belts ran {self._carried_m:.1f} m under a chair that stays: they slip on the last nosing"
        return ""

    def _meet(self, pitch: float, flipper: FlipperReading) -> None:
        """Tell by where the tip stands on what it stands."""
        if self._to_go(pitch, flipper) <= EARLY_RAD:
            self._stage = "carry"
            self._ahead_m = self._by_the_flipper(pitch, flipper)
            return
        self._stage = "slow" if self._may_go_on else "barred"
        self._tries += 1
        self._ahead_m = self._geometry.pivot_m + EARLY_M
        self._cause = f"the flipper stood on the last nosing, try {self._tries}: the belts slip, or it was believed too near"

    @property
    def _may_go_on(self) -> bool:
        """Say whether one more try leaves the centre of mass behind the nosing, had its place been right from the first."""
        goes_m = self._config.reach_from_m + (self._tries + 1) * (EARLY_M + self._config.reach_from_m)
        return plumb(self._loading, self._reached_rad) < self._geometry.pivot_m - goes_m

    def _act(self, pitch: float, flipper: FlipperReading, speed: float, dt_s: float) -> tuple[float, float]:
        config = self._config
        match self._stage:
            case "climb":
                return config.cruise_m_s, 0.0
            case "slow":
                return config.crest_m_s, self._towards(OVER_BELTS_RAD, flipper)
            case "reach":
                return 0.0, self._reach(pitch, flipper)
            case "carry":
                return self._carry(pitch, flipper, speed, dt_s)
            case "barred":
                return 0.0, 0.0
            case "lead":
                return config.lead_m_s, self._lead(pitch, flipper, speed, dt_s)
            case _:
                return config.crest_m_s, min(self._towards(self._rest_rad, flipper), config.stow_rad_s)

    def _reach(self, pitch: float, flipper: FlipperReading) -> float:
        config = self._config
        return -min(max(config.soften_per_s * self._to_go(pitch, flipper), config.meet_rad_s), config.reach_rad_s)

    def _to_go(self, pitch: float, flipper: FlipperReading) -> float:
        """Return how far the flipper is above where its tip is expected to meet the landing."""
        return flipper.angle_rad + pitch + self._geometry.depression(pitch, self._past_m)

    def _is_lifted(self, pitch: float) -> bool:
        """Return whether the flipper has pitched the chair up: a light one is lifted before it weighs on its tip as it should."""
        return pitch > self._reached_rad + LIFTED_RAD

    def _carry(self, pitch: float, flipper: FlipperReading, speed: float, dt_s: float) -> tuple[float, float]:
        self._refine(pitch, flipper, dt_s)
        self._carried_m += abs(speed) * dt_s
        config = self._config
        _, per_metre = self._geometry.rates(pitch, self._past_m)
        missing = 0.0 if self._is_lifted(pitch) else max(self._press_n - self._tip.load_n, 0.0)
        rate = (per_metre * speed if missing > 0.0 else 0.0) - config.press_rad_s_n * missing
        waits = self._tip.load_n < UNLOADED_N and self._com_beyond(pitch) > -NEAR_M
        return (0.0 if waits else config.crest_m_s), rate

    def _lead(self, pitch: float, flipper: FlipperReading, speed: float, dt_s: float) -> float:
        config = self._config
        self._refine(pitch, flipper, dt_s)
        softly = max(config.soften_per_s * pitch, config.touch_rad_s)
        slides_m = max(self._geometry.slide(max(pitch, 0.0), self._past_m), self._geometry.radius_m)  # a wrong place is no division
        smoothly = config.slide_m_s / slides_m
        lags = self._tip.load_n < UNLOADED_N and pitch > self._lead_rad + LAGS_RAD
        fastest = WAITS_RAD_S if lags else config.lead_rad_s
        self._lead_rad_s = min(self._lead_rad_s + config.lead_rad_s2 * dt_s, fastest, softly, smoothly)
        self._lead_rad = max(self._lead_rad - self._lead_rad_s * dt_s, pitch - config.behind_rad)
        per_pitch, per_metre = self._geometry.rates(pitch, self._past_m)
        trim = config.trim_per_s * (self._lead_rad - pitch)
        if self._tip.load_n < UNLOADED_N:
            trim = max(trim, 0.0)  # no gap grows under a chair that does not follow
        return per_pitch * (trim - self._lead_rad_s) + per_metre * speed
