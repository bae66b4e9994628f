"""A traversal up: find the stair, turn square, approach, mount, test the traction, climb, cross the crest, land.

Paper: Section II.A (the track on the stair, the variable angle of attack); the phases are ours. Each phase ends by what the
camera, the IMU, the belts and the flipper's motor tell; its cause is in the plan and so in the log.
"""

import math
from dataclasses import dataclass, field, replace

from treadline.angles import DEG
from treadline.control.allocate import inner_speed_ratio
from treadline.control.crest import Crest, CrestCommand, CrestConfig
from treadline.control.flipper import OVER_BELTS_RAD
from treadline.mission.entry import reject_reason
from treadline.mission.planner import PlannerInput
from treadline.mission.traction import TractionConfig, TractionTest
from treadline.mission.traversal import LEVEL_RAD, ON_THE_FLIGHT_RAD, Traversal, TraversalConfig, missing_step, on_the_tip
from treadline.signals import HeadingEstimate, ImuSample, MotionPlan, Phase, TrackReading

CREST_SPARE_RAD, CREST_KEEP_M_S_RAD = 1.7 * DEG, 3.0
"""Heading left alone over the crest, and half the belts' difference per heading beyond. Nothing but the gyro tells it there, and
one that drifts by 1 °/s would lead the chair along; yet on a single nosing the chair swings round by itself. Six seconds of drift
cost 6.3° with nothing left alone, 5.0° so; with a sound gyro it is askew by 2.9° at most instead of 2.1° (28, 30°; six runs)."""
LOSES_GRIP_M_S = 0.012
"""Of slip, from which on the flipper goes after a fall no more: so low, its tip meets the next nosing as a step. With
friction of 1.1·tan β 15 of 59 chairs slid for it."""
BACKED_RAD = 0.7 * DEG
"""Pitch below which no part of the chair lies on the first nosing any more."""


@dataclass(frozen=True, slots=True, kw_only=True)
class AscentConfig(TraversalConfig):
    """Where and how a way up goes."""

    slow_from_m: float = 0.35
    """Of the front pulley before the first nosing: the sloping section meets it up to 0.2 m before."""
    idle_rad: float = 6.0 * DEG
    """Of the flipper off what is asked of it before the belts touch the stair: no way up begins that could not end over the
    crest."""
    mount_from_m: float = 0.22
    touched_rad: float = 4.0 * DEG
    """Pitch that belts on the first nosing cause, whatever the map said."""
    mounted_rad: float = 4.0 * DEG
    """Below the slope, from which on the belts lie on two nosings."""
    test_before_m: float = 0.0
    """Before the rear leaves the floor the traction is tested, by this way: the nosings carry nearly all there."""
    pulses: int = 2
    """Of the traction test, to be lost before the chair backs off: a step that is met in the middle of one costs it its speed."""
    crest_from_m: float = 1.2
    """Of the last nosing ahead of the front pulley when the crest's sequencer takes over: it slows down in time by itself."""
    unseen_end_m: float = 0.10
    """Of the front pulley before the last nosing ever seen: were there another, frames would have shown it long ago."""
    landed_m: float = 0.3
    """To drive on over a landing that is not level before the chair counts as landed all the same."""
    mount_m: float = 1.6
    """Of the belts while mounting, from which on they slip on the first nosing."""
    back_off_m: float = 0.5
    wall_m: float = 0.50
    """Free width to a wall below which the chair steers away."""
    aside_rad_m: float = 10.0 * DEG
    """Heading per metre of missing width."""
    aside_limit_rad: float = 2.0 * DEG
    traction: TractionConfig = field(default_factory=TractionConfig)


class Ascent(Traversal):
    """Planner of one traversal up."""

    DIRECTION = "up"
    ROLLING = frozenset({"mount", "climb", "approach"})
    CATCHES = True
    RIDES_RAD = -0.75 * DEG
    """Lower, its tip meets the next nosing as a step: what lifts it there is what little grip a chair has to spare."""

    def __init__(self, config: AscentConfig) -> None:
        super().__init__(config.chair, config.flights)
        self._config = config
        self._end = ""
        self._traction: TractionTest | None = None
        self._pulses = 0
        self._refusal = ""

    def _face_flight(self) -> None:
        super()._face_flight()
        self._crest: Crest | None = None
        self._is_climbing = True
        """Whether the crest's sequencer has never yet lowered its flipper."""
        self._slipped = False
        """Whether the belts have, on this flight, under a chair that did not turn."""

    def update(self, signal: PlannerInput) -> None:
        """Take one signal."""
        super().update(signal)
        if self._traction is not None and isinstance(signal, ImuSample | TrackReading):
            self._traction.update(signal)

    def step(self, t_s: float, estimate: HeadingEstimate | None) -> MotionPlan:
        """Return what to do now."""
        if estimate is not None:
            self._where.heading_rad = estimate.heading_rad
        match self._phase:
            case "search":
                return self._search(t_s, estimate)
            case "align":
                return self._align(t_s, estimate)
            case "approach" | "mount":
                return self._go_at_the_stair(t_s, estimate)
            case "traction" if self._traction is not None:
                return self._test_traction(t_s, self._traction)
            case "climb" | "crest" | "land":
                return self._climb(t_s, estimate)
            case "back_off":
                return self._back_off(t_s, estimate)
            case _:
                return self._stand(t_s, needs_stair=False)

    def _search(self, t_s: float, estimate: HeadingEstimate | None) -> MotionPlan:
        where = self._where
        if where.pitch_rad > ON_THE_FLIGHT_RAD:
            if estimate is not None and where.map_count:
                if not self._is_laid(t_s, estimate):
                    return self._plan(t_s, 0.0, turn_m_s=0.0, flipper=self._lie(t_s, estimate))
                self._begin(t_s, "climb", self._on_a_flight)
                return self._climb(t_s, estimate)
            return self._stand(t_s)
        if estimate is not None and where.known:
            return self._begin(t_s, "align", f"stair in view, heading {estimate.heading_rad / DEG:+.1f}°")
        if self._flights_done:
            return self._look_on(t_s, estimate)
        return self._sweep(t_s, "no stair in view, to neither side")

    def _align(self, t_s: float, estimate: HeadingEstimate | None) -> MotionPlan:
        if estimate is None:
            return self._stand(t_s)
        if self._level.is_square(estimate, t_s):
            where = self._where
            chair, payload_kg = self._config.chair, self._config.payload_kg
            refusal = reject_reason(chair, payload_kg, where.rise_m, where.run_m, where.slope_rad)
            if refusal is not None:
                return self._begin(t_s, "refused", refusal)
            shape = f"rise {where.rise_m:.3f} m, run {where.run_m:.3f} m, {where.slope_rad / DEG:.1f}°"
            to_go_m = (where.first_ahead_m() or math.inf) - self._pivot_m
            cause = f"square to the stair within {estimate.heading_rad / DEG:+.1f}°; {shape}"
            self._flipper_planner.forget()
            return self._begin(t_s, "approach", cause, to_go_m)
        return self._plan(t_s, 0.0, turn_m_s=self._level.towards(estimate))

    def _go_at_the_stair(self, t_s: float, estimate: HeadingEstimate | None) -> MotionPlan:
        config, where = self._config, self._where
        if (stops := self._missing() or self._stuck() or self._narrow() or self._idle(t_s)) is not None:
            return self._stand(t_s, stops)
        first = where.first_ahead_m()
        before = math.inf if first is None else first - self._pivot_m
        ahead = where.ahead_m()
        if self._phase == "approach" and (before < config.mount_from_m or where.pitch_rad > config.touched_rad):
            return self._begin(t_s, "mount", f"first nosing {before:.2f} m before the front pulley")
        if self._phase == "mount" and where.travel_m - self._from_m > config.mount_m:
            slope = where.slope_rad / DEG
            self._refusal = f"the belts ran {config.mount_m:g} m on the first nosings of a {slope:.0f}° stair without getting up"
            return self._begin(t_s, "back_off", self._refusal)
        if (
            self._phase == "mount"
            and len(ahead) > 1
            and ahead[0] < self._lift_off_m() + config.test_before_m
            and where.pitch_rad > where.slope_rad - config.mounted_rad
        ):
            self._traction, self._pulses = TractionTest(config.traction, where.slope_rad), 1
            return self._begin(t_s, "traction", f"on two nosings, pitched by {where.pitch_rad / DEG:.1f}°")
        speed = config.slow_m_s if before < config.slow_from_m else config.cruise_m_s
        turn = self._level.keep(estimate, self._aside())
        return self._plan(t_s, speed, turn_m_s=turn, flipper=self._flipper_planner.to(t_s, self._mounting_rad))

    def _idle(self, t_s: float) -> str | None:
        """Return that the flipper, the belts on the floor, is not where it is asked; re-armed, it has another try."""
        if self._flipper is None or self._where.pitch_rad > self._config.touched_rad:
            return None
        stands, asked = self._flipper.angle_rad, self._mounting_rad
        off_rad = abs(stands - asked)
        if not self._flipper_planner.is_late(t_s, off_rad if off_rad > self._config.idle_rad else 0.0):
            return None
        seen = f"stands at {stands / DEG:.0f}° above the belts where {asked / DEG:.0f}° are asked"
        return f"the flipper {seen}: it would not carry the chair"

    @property
    def _mounting_rad(self) -> float:
        """The flipper's angle at which its tip clears the next step: the more the chair is pitched, the less is left to clear."""
        left = 1.0 - self._where.pitch_rad / max(self._where.slope_rad, LEVEL_RAD)
        return max(self._stepping_rad * min(left, 1.0), OVER_BELTS_RAD)

    def _lift_off_m(self) -> float:
        """Return how far ahead of mid-track the first nosing is when belts on two nosings lift the rear pulley off the floor."""
        slope, radius = self._where.slope_rad, self._config.chair.tracks.pulley_radius_m
        return self._where.rise_m / math.sin(slope) - radius * math.tan(0.5 * slope) - self._pivot_m

    def _test_traction(self, t_s: float, test: TractionTest) -> MotionPlan:
        if not test.over:
            # In line with the belts: it carries nothing yet, and is where it rides before the first fall from a high nosing.
            return self._plan(t_s, test.speed_m_s, turn_m_s=0.0, flipper=self._flipper_planner.to(t_s, 0.0))
        if not test.holds and self._pulses < self._config.pulses:
            self._traction = TractionTest(self._config.traction, self._where.slope_rad)
            self._pulses += 1
            return self._stand(t_s)
        self._traction = None
        slip = f"{max(test.slip, 0.0):.0%} of the belts' test pulse slipped"
        if test.holds:
            plan = self._begin(t_s, "climb", slip)
            return replace(plan, speed_m_s=min(plan.speed_m_s, self._config.cruise_m_s))
        wanted = (1.0 + self._config.traction.wanted) * math.tan(self._where.slope_rad)
        self._refusal = f"too little friction: {slip}, so it is below {wanted:.2f}; dry or roughen the nosings"
        return self._begin(t_s, "back_off", self._refusal)

    def _missing(self) -> str | None:
        """Return that a missing step is so near that the chair must stop, or None."""
        gap = self._gap(1.0)
        return None if gap is None or gap[0] > self._config.gap_m else missing_step(gap, "front")

    def _climb(self, t_s: float, estimate: HeadingEstimate | None) -> MotionPlan:
        config, where = self._config, self._where
        if (missing := self._missing()) is not None:
            return self._stand(t_s, missing)
        top = where.top_ahead_m()
        unseen = top is not None and top - self._pivot_m < config.unseen_end_m
        near = top is not None and top - self._pivot_m < config.crest_from_m
        if self._crest is None and top is not None and ((where.top_ends and near) or unseen):
            crest_config = CrestConfig(chair=config.chair, payload_kg=config.payload_kg, cruise_m_s=config.cruise_m_s)
            self._crest = Crest(crest_config, top)
            seen = "seen" if where.top_ends else "no nosing seen beyond"
            self._end = f"end of the flight, {seen}"
        elif self._crest is not None and top is not None and self._is_climbing and not (where.top_ends or unseen):
            self._crest = None  # a nosing came into view beyond what was taken for the last
        if self._crest is None or self._imu is None or self._flipper is None or self._tracks is None:
            return self._on_the_flight(t_s, estimate)
        if top is not None and where.top_ends:
            self._crest.nosing_seen(top)
        command = self._crest.step(self._imu, self._flipper, self._tracks)
        return self._follow(t_s, command, estimate)

    def _on_the_flight(self, t_s: float, estimate: HeadingEstimate | None, *, needs_stair: bool = True) -> MotionPlan:
        aim_rad = self._aside()
        return self._plan(
            t_s,
            self._config.cruise_m_s,
            turn_m_s=self._steering(t_s, estimate, aim_rad, climbs=True),
            heading_rad=aim_rad,
            min_inner_speed_ratio=None if estimate is None else inner_speed_ratio(estimate.heading_rad - aim_rad),
            pitch_feedforward_m_s=self._pitch_feedforward(t_s, estimate, aim_rad),
            flipper=self._lie(t_s, estimate, aim_rad),
            needs_stair=needs_stair,
        )

    def _has_grip(self, t_s: float) -> bool:
        self._slipped |= self._where.slip_m_s(t_s) > LOSES_GRIP_M_S
        return not self._slipped

    def _follow(self, t_s: float, command: CrestCommand, estimate: HeadingEstimate | None) -> MotionPlan:
        self._is_climbing = self._is_climbing and command.stage in ("climb", "slow")
        match command.stage:
            case "climb":
                return self._on_the_flight(t_s, estimate, needs_stair=False)
            case "slow":
                if self._phase == "crest":
                    self._begin(t_s, "climb", command.cause)
                turn, easing = self._steering(t_s, estimate, climbs=True, blind=True), self._pitch_feedforward(t_s, estimate)
                flipper = self._lie(t_s, estimate)
                return self._plan(
                    t_s, command.speed_m_s, turn_m_s=turn, pitch_feedforward_m_s=easing, flipper=flipper, needs_stair=False
                )
            case "land" | "done":
                phase: Phase = "land"
            case _:
                phase = "crest"
        if phase != self._phase:
            pitch = self._where.pitch_rad / DEG
            seen = f"{self._end}; " if phase == "crest" else ""
            self._begin(t_s, phase, f"{seen}pitch {pitch:.1f}°, {on_the_tip(command.tip_n)}")
        is_level = abs(self._where.pitch_rad) < LEVEL_RAD
        if command.stage == "done" and (is_level or self._where.travel_m - self._from_m > self._landing_m):
            if self._goes_on:
                return self._begin_next(t_s)
            return self._begin(
                t_s, "arrived", f"on the landing, pitch {self._where.pitch_rad / DEG:.1f}°, clear of the last nosing"
            )
        barred = f"{command.cause}: the chair stands before the crest" if command.stage == "barred" else None
        turn = self._level.keep(estimate, spare_rad=CREST_SPARE_RAD, keep_m_s_rad=CREST_KEEP_M_S_RAD)
        # Until the tip carries, nothing but the belts eases the fall of a chair that rocks on its nosings as it stops.
        speed = command.speed_m_s + self._pitch_feedforward(t_s, estimate, allowed=command.stage == "reach")
        return self._plan(t_s, speed, turn_m_s=turn, flipper=command.flipper, needs_stair=False, hold=barred)

    def _look_on(self, t_s: float, estimate: HeadingEstimate | None) -> MotionPlan:
        """Drive on over a landing until the next flight is in view."""
        config, where = self._config, self._where
        if where.travel_m > config.look_m or where.pitch_rad > config.touched_rad:
            return self._stand(t_s, f"no flight in view within {where.travel_m:.1f} m on the landing", needs_stair=False)
        return self._plan(t_s, config.slow_m_s, turn_m_s=self._level.keep(estimate), needs_stair=False)

    @property
    def _landing_m(self) -> float:
        """Travel from the landing's first contact to where the chair is clear of the last nosing, and a little more."""
        return 2.0 * self._pivot_m + self._config.landed_m

    def _back_off(self, t_s: float, estimate: HeadingEstimate | None) -> MotionPlan:
        config, where = self._config, self._where
        if where.pitch_rad < BACKED_RAD and self._from_m - where.travel_m > config.back_off_m:
            return self._begin(t_s, "refused", self._refusal)
        flipper = self._flipper_planner.to(t_s, self._stepping_rad)
        return self._plan(t_s, -config.slow_m_s, turn_m_s=self._level.keep(estimate), flipper=flipper, needs_stair=False)

    def _aside(self) -> float:
        """Return the heading that takes the chair off a wall that is near, or to the middle between two."""
        config, where = self._config, self._where
        left, right = where.left_wall_m, where.right_wall_m
        if left is not None and right is not None:
            lacking = 0.5 * (right - left)
        elif left is not None:
            lacking = max(config.wall_m - left, 0.0)
        else:
            lacking = 0.0 if right is None else -max(config.wall_m - right, 0.0)
        # To the right, away from a wall at the left, is a negative heading.
        return -min(max(config.aside_rad_m * lacking, -config.aside_limit_rad), config.aside_limit_rad)
