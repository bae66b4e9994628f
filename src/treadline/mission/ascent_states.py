"""Planner of a traversal up: find the stair, turn square, approach, mount, test the traction, climb, cross the crest, land.

Paper: Section II.A (the track on the stair, the variable angle of attack); the phases are not in the paper (docs/decisions/0019).
``ImuSample, TrackReading, FlipperReading, StairMap, HeadingEstimate -> MotionPlan``. Measurements of camera, IMU, belts and
flipper end each phase; the plan carries the reason, which the mission logs as an event.
"""

import math
from dataclasses import dataclass, field, replace

from treadline.control.belt_allocation import inner_speed_ratio
from treadline.control.crest_sequence import Crest, CrestCommand, CrestConfig
from treadline.control.flipper import OVER_BELTS_RAD
from treadline.core.angles import DEG
from treadline.core.signals import HeadingEstimate, ImuSample, MotionPlan, Phase, TrackReading
from treadline.core.step_sizes import ON_A_FLIGHT_RAD
from treadline.mission._traction_test import TractionConfig, TractionTest
from treadline.mission._traversal_base import LEVEL_RAD, Traversal, TraversalConfig, on_the_tip
from treadline.mission.planner import PlannerInput

CREST_SPARE_RAD, CREST_KEEP_M_S_RAD = 1.7 * DEG, 3.0
"""Heading error that is not corrected over the crest [rad], and half the belt speed difference per heading error beyond it
[m/s per rad]. Only the gyro measures the heading there. A gyro drift of 1 °/s for six seconds caused a heading error of 5.0° with
this dead band and 6.3° without; with a sound gyro the error was at most 2.9° with and 2.1° without (28 and 30°, six runs)."""
LOSES_GRIP_M_S = 0.012
"""Slip speed above which the flipper no longer follows a fall on this flight [m/s]. A flipper lowered for a fall meets the next
nosing as a step: with friction of 1.1·tan β, 15 of 59 chairs slid."""
BACKED_RAD = 0.7 * DEG
"""Pitch below which no part of the chair lies on the first nosing [rad]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class AscentConfig(TraversalConfig):
    """Distances, angles and speeds of a traversal up; distances along the belts unless stated otherwise."""

    slow_from_m: float = 0.35
    """Distance of the front pulley before the first nosing at which the chair slows down [m]: the flipper meets the nosing up to
    0.2 m earlier than the pulley."""
    idle_rad: float = 6.0 * DEG
    """Flipper angle error that counts as a fault while the belts are on the floor [rad]. A traversal up does not begin with a
    flipper that could not lower the chair over the crest."""
    mount_from_m: float = 0.22
    """Distance of the front pulley before the first nosing at which mounting begins [m]."""
    touched_rad: float = 4.0 * DEG
    """Pitch at which the belts have touched the first nosing [rad], whatever the stair map shows."""
    mounted_rad: float = 4.0 * DEG
    """Pitch below the slope at which the belts lie on two nosings [rad]."""
    test_before_m: float = 0.0
    """Travel before the rear pulley lifts off the floor at which the traction test begins [m]. At lift-off the nosings carry nearly
    the whole weight."""
    pulses: int = 2
    """Number of lost traction tests after which the chair backs off. One may be lost by chance: a belt that meets a step during the
    pulse loses a quarter of its speed."""
    crest_from_m: float = 1.2
    """Distance of the front pulley before the last nosing at which the crest sequence takes over [m]; it slows the chair down."""
    unseen_end_m: float = 0.10
    """Distance of the front pulley before the last mapped nosing at which the flight counts as ended [m], even if no map showed its
    end. Earlier frames would have shown a further nosing."""
    landed_m: float = 0.3
    """Travel on the landing, beyond the flat run of the belts, after which the chair has landed even if the landing is not
    horizontal [m]."""
    mount_m: float = 1.6
    """Belt travel while mounting above which the belts are slipping on the first nosing [m]."""
    back_off_m: float = 0.5
    """Distance to back off from the stair before the refusal [m]."""
    wall_m: float = 0.50
    """Distance of the chair's middle from a wall below which the chair steers away [m]."""
    aside_rad_m: float = 10.0 * DEG
    """Heading set point per metre of missing distance [rad/m]."""
    aside_limit_rad: float = 2.0 * DEG
    """Largest such heading set point [rad]."""
    traction: TractionConfig = field(default_factory=TractionConfig)


class Ascent(Traversal):
    """Planner of one traversal up: state machine of the phases in docs/decisions/0019."""

    DIRECTION = "up"
    WAY = 1.0
    ROLLING = frozenset({"mount", "climb", "approach"})
    CATCHES = True
    RIDES_RAD = -0.75 * DEG
    """Flipper angle while riding, relative to the belts [rad]. A lower tip meets the next nosing as a step, which takes friction
    that the chair may not have to spare."""

    _config: AscentConfig

    def __init__(self, config: AscentConfig) -> None:
        super().__init__(config)
        self._end = ""
        self._traction: TractionTest | None = None
        self._pulses = 0
        self._refusal = ""

    def _face_flight(self) -> None:
        super()._face_flight()
        self._crest: Crest | None = None
        self._is_climbing = True
        """Whether the crest sequence has not lowered the flipper yet."""
        self._slipped = False
        """Whether the slip speed of a chair that does not turn has exceeded ``LOSES_GRIP_M_S`` on this flight."""

    def update(self, signal: PlannerInput) -> None:
        """Update the planner, and a running traction test, with one signal."""
        super().update(signal)
        if self._traction is not None and isinstance(signal, ImuSample | TrackReading):
            self._traction.update(signal)

    def step(self, t_s: float, estimate: HeadingEstimate | None) -> MotionPlan:
        """Return the plan of this tick."""
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
        if where.pitch_rad > ON_A_FLIGHT_RAD:
            if estimate is not None and where.map_count:
                if not self._is_laid(t_s, estimate):
                    return self._plan(t_s, 0.0, turn_m_s=0.0, flipper=self._lie(t_s, estimate))
                self._begin(t_s, "climb", self._on_a_flight)
                return self._climb(t_s, estimate)
            return self._stand(t_s)
        if estimate is not None and where.known:
            return self._begin(t_s, "align", f"stair in view, heading {estimate.heading_rad / DEG:+.1f}°")
        if self._flights_done:
            return self._look_on(t_s, estimate, self._config.touched_rad)
        return self._sweep(t_s, "no stair in view, to neither side")

    def _align(self, t_s: float, estimate: HeadingEstimate | None) -> MotionPlan:
        if estimate is None:
            return self._stand(t_s)
        if self._level.is_square(estimate, t_s):
            where = self._where
            if (refusal := self._infeasible(enters=False)) is not None:
                return self._begin(t_s, "refused", refusal)
            shape = f"rise {where.rise_m:.3f} m, run {where.run_m:.3f} m, {where.slope_rad / DEG:.1f}°"
            to_go_m = (where.first_ahead_m() or math.inf) - self._pivot_m
            cause = f"square to the stair within {abs(estimate.heading_rad) / DEG:.1f}°; {shape}"
            self._flipper_planner.forget()
            return self._begin(t_s, "approach", cause, to_go_m)
        return self._plan(t_s, 0.0, turn_m_s=self._level.towards(estimate))

    def _go_at_the_stair(self, t_s: float, estimate: HeadingEstimate | None) -> MotionPlan:
        config, where = self._config, self._where
        if (stops := self._missing(config.gap_m) or self._stuck() or self._narrow() or self._idle(t_s)) is not None:
            return self._stand(t_s, stops)
        first = where.first_ahead_m()
        before = math.inf if first is None else first - self._pivot_m
        ahead = where.ahead_m()
        enters = before < config.mount_from_m or where.pitch_rad > config.touched_rad
        if self._phase == "approach" and (side := self._open_side(enters=enters)) is not None:
            return self._stand(t_s, side)
        if self._phase == "approach" and (refusal := self._infeasible(enters=enters)) is not None:
            return self._begin(t_s, "refused", refusal)
        if self._phase == "approach" and enters:
            return self._begin(t_s, "mount", f"first step {before:.2f} m ahead of the belts' front pulley")
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
            return self._begin(t_s, "traction", f"the belts lie on two nosings, pitch {where.pitch_rad / DEG:.1f}°")
        speed = config.slow_m_s if before < config.slow_from_m else config.cruise_m_s
        turn = self._level.keep(estimate, self._aside())
        return self._plan(t_s, speed, turn_m_s=turn, flipper=self._flipper_planner.to(t_s, self._mounting_rad))

    def _idle(self, t_s: float) -> str | None:
        """Return the fault of a flipper off its commanded angle with the belts on the floor; each re-arm allows another try."""
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
        """Flipper angle at which the tip clears the next step [rad]: it decreases as the pitch increases."""
        left = 1.0 - self._where.pitch_rad / max(self._where.slope_rad, LEVEL_RAD)
        return max(self._stepping_rad * min(left, 1.0), OVER_BELTS_RAD)

    def _lift_off_m(self) -> float:
        """Return the distance of the first nosing ahead of mid-track at which belts on two nosings lift the rear pulley [m]."""
        slope, radius = self._where.slope_rad, self._config.chair.tracks.pulley_radius_m
        return self._where.rise_m / math.sin(slope) - radius * math.tan(0.5 * slope) - self._pivot_m

    def _test_traction(self, t_s: float, test: TractionTest) -> MotionPlan:
        if not test.over:
            # In line with the belts the flipper carries nothing yet, and is already near its riding angle for the first fall.
            return self._plan(t_s, test.speed_m_s, turn_m_s=0.0, flipper=self._flipper_planner.to(t_s, 0.0))
        if not test.holds and self._pulses < self._config.pulses:
            self._traction = TractionTest(self._config.traction, self._where.slope_rad)
            self._pulses += 1
            return self._stand(t_s)
        self._traction = None
        slip = f"the belts slipped by {100.0 * max(test.slip, 0.0):.0f} % of a short test drive"
        if test.holds:
            plan = self._begin(t_s, "climb", f"enough friction: {slip}")
            return replace(plan, speed_m_s=min(plan.speed_m_s, self._config.cruise_m_s))
        wanted = (1.0 + self._config.traction.wanted) * math.tan(self._where.slope_rad)
        self._refusal = f"too little friction: {slip}, so it is below {wanted:.2f}; dry or roughen the nosings"
        return self._begin(t_s, "back_off", self._refusal)

    def _climb(self, t_s: float, estimate: HeadingEstimate | None) -> MotionPlan:
        config, where = self._config, self._where
        if (missing := self._missing(config.gap_m)) is not None:
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
            self._crest = None  # a further nosing came into view
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
                turn, feedforward = self._steering(t_s, estimate, climbs=True, blind=True), self._pitch_feedforward(t_s, estimate)
                flipper = self._lie(t_s, estimate)
                return self._plan(
                    t_s, command.speed_m_s, turn_m_s=turn, pitch_feedforward_m_s=feedforward, flipper=flipper, needs_stair=False
                )
            case "land" | "done":
                phase: Phase = "land"
            case _:
                phase = "crest"
        if phase != self._phase:
            pitch = self._where.pitch_rad / DEG
            seen = self._end if phase == "crest" else "the front has come down on the landing"
            self._begin(t_s, phase, f"{seen}; pitch {pitch:.1f}°, {on_the_tip(command.tip_n)}")
        is_level = abs(self._where.pitch_rad) < LEVEL_RAD
        if command.stage == "done" and (is_level or self._where.travel_m - self._from_m > self._landing_m):
            if self._goes_on:
                return self._begin_next(t_s)
            return self._begin(
                t_s, "arrived", f"on the landing, pitch {self._where.pitch_rad / DEG:.1f}°, clear of the last nosing"
            )
        barred = f"{command.cause}: the chair stands before the crest" if command.stage == "barred" else None
        turn = self._level.keep(estimate, spare_rad=CREST_SPARE_RAD, keep_m_s_rad=CREST_KEEP_M_S_RAD)
        # Until the flipper's tip carries load, only the belts can soften the rocking of a chair that stops on its nosings.
        speed = command.speed_m_s + self._pitch_feedforward(t_s, estimate, allowed=command.stage == "reach")
        return self._plan(t_s, speed, turn_m_s=turn, flipper=command.flipper, needs_stair=False, hold=barred)

    @property
    def _landing_m(self) -> float:
        """Travel from the first contact with the landing until the chair is clear of the last nosing, plus ``landed_m`` [m]."""
        return 2.0 * self._pivot_m + self._config.landed_m

    def _back_off(self, t_s: float, estimate: HeadingEstimate | None) -> MotionPlan:
        config, where = self._config, self._where
        if where.pitch_rad < BACKED_RAD and self._from_m - where.travel_m > config.back_off_m:
            return self._begin(t_s, "refused", self._refusal)
        flipper = self._flipper_planner.to(t_s, self._stepping_rad)
        return self._plan(t_s, -config.slow_m_s, turn_m_s=self._level.keep(estimate), flipper=flipper, needs_stair=False)

    def _aside(self) -> float:
        """Return the heading set point away from a near wall, or towards the middle between two walls [rad]."""
        config, where = self._config, self._where
        left, right = where.left_wall_m, where.right_wall_m
        if left is not None and right is not None:
            lacking = 0.5 * (right - left)
        elif left is not None:
            lacking = max(config.wall_m - left, 0.0)
        else:
            lacking = 0.0 if right is None else -max(config.wall_m - right, 0.0)
        # A negative heading leads to the right, away from a wall on the left.
        return -min(max(config.aside_rad_m * lacking, -config.aside_limit_rad), config.aside_limit_rad)
