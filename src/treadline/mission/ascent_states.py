"""Planner of a traversal up: find the stair, turn square, approach, mount, test the traction, climb, cross the crest, land.

Paper: Section II.A (the track on the stair, the variable angle of attack); the phases are not in the paper (docs/decisions/0019).
``ImuSample, TrackReading, FlipperReading, StairMap, HeadingEstimate -> MotionPlan``. Measurements of camera, IMU, belts and
flipper end each phase; the plan carries the reason, which the mission logs as an event.
"""

import math
from dataclasses import replace

from treadline.control.belt_allocation import inner_speed_ratio
from treadline.control.crest_sequence import Crest, CrestCommand
from treadline.control.flipper import GENTLY_RAD_S, LIES_RAD, OFF_RAD, OVER_BELTS_RAD, PATIENCE_S, SLOW_M_S, THERE_RAD
from treadline.core.angles import DEG
from treadline.core.signals import HeadingEstimate, ImuSample, MotionPlan, TrackReading
from treadline.estimation.stair_tracker import NEAR_M, Side
from treadline.mission._automaton import Automaton, Exits, State
from treadline.mission._situation import (
    ASIDE_M,
    ENTER_FROM_M,
    KEEPS_M,
    LEVEL_RAD,
    FlightSituation,
    Way,
    on_the_tip,
)
from treadline.mission._traction_test import TractionTest
from treadline.mission.mission_config import MissionConfig
from treadline.mission.planner import PlannerInput
from treadline.vehicle.traction import NORMAL_SLIP, friction_needed

CREST_SPARE_RAD = 1.7 * DEG
"""Heading error that is not corrected over the crest [rad]. Only the gyro measures the heading there. A gyro drift of 1 °/s for six
seconds caused a heading error of 5.0° with this dead band and 6.3° without; with a sound gyro the error was at most 2.9° with and
2.1° without (28 and 30°, six runs, at twice the present gain)."""


UP = Way(direction="up", sign=1.0, rides_rad=-0.75 * DEG)
"""Way up. A lower tip of the riding flipper meets the next nosing as a step, which takes friction that the chair may not have to
spare."""


PRESSES_RAD = -7.0 * DEG
"""Flipper angle of a chair whose belts slip on the flight [rad]: the flipper takes a part of the weight onto the next nosings, the
rear pulley another. On three steps of friction 0.36 the chair then rolls back by 0.05 m at most instead of 0.25 m; twice as low it
catches a nosing with 7 m/s²."""
PULSES = 2
"""Number of lost traction tests after which the chair backs off. One may be lost by chance: a belt that meets a step during the
pulse loses a quarter of its speed."""
ASIDE_RAD_M, ASIDE_RAD = 10.0 * DEG, 2.0 * DEG
"""Heading set point per metre of missing distance to a side [rad/m], and the largest such set point [rad]."""


class Ascent(FlightSituation):
    """Planner of one traversal up.

    Args:
        config: Mission, of which chair, payload, speed and number of flights count.
    """

    def __init__(self, config: MissionConfig) -> None:
        super().__init__(config, UP)
        self._automaton = Automaton(STATES_UP)
        self._end = ""
        self._traction: TractionTest | None = None
        self._pulses = 0

    def face_flight(self) -> None:
        """Reset everything that belongs to one flight."""
        super().face_flight()
        self._crest: Crest | None = None
        self._command: CrestCommand | None = None
        """Command of the crest sequence at this tick."""
        self._is_climbing = True
        """Whether the crest sequence has not lowered the flipper yet."""
        self._knows_the_foot = False
        """Whether the chair came onto this flight from the floor."""
        self._presses = False
        """Whether the chair stands and presses its flipper onto the nosings, because its belts slip."""

    def update(self, signal: PlannerInput) -> None:
        """Update the planner, and a running traction test, with one signal."""
        super().update(signal)
        if self._traction is not None and isinstance(signal, ImuSample | TrackReading):
            self._traction.update(signal)
        if isinstance(signal, TrackReading) and signal.brake_on:
            self._presses = False

    def step(self, t_s: float, estimate: HeadingEstimate | None) -> MotionPlan:
        """Return the plan of this tick."""
        self.begin_tick(t_s, estimate)
        if self.phase in ("crest", "land") or (self.phase == "climb" and self.is_barred_by_a_gap() is None):
            self._cross()
        return self._automaton.step(self)

    # --- before the flight

    @property
    def enters(self) -> bool:
        """Whether the chair is about to drive onto the flight: a side that was not in view does not count as wide enough."""
        where = self._where
        return self.phase != "align" and (self._before_m < ENTER_FROM_M or where.pitch_rad > OFF_RAD)

    def is_square(self) -> str | None:
        """Square to the flight for half a second."""
        if not self._is_square() or self._estimate is None:
            return None
        where = self._where
        shape = f"rise {where.rise_m:.3f} m, run {where.run_m:.3f} m, {where.slope_rad / DEG:.1f}°"
        return f"square to the stair within {abs(self._estimate.heading_rad) / DEG:.1f}°; {shape}"

    def has_an_idle_flipper(self) -> str | None:
        """The flipper stands off its commanded angle with the belts on the floor; each re-arm allows another try."""
        if self._flipper is None or self._where.pitch_rad > OFF_RAD:
            return None
        stands, asked = self._flipper.angle_rad, self._mounting_rad
        off_rad = abs(stands - asked)
        if not self._flipper_planner.is_late(self.t_s, off_rad if off_rad > THERE_RAD else 0.0):
            return None
        seen = f"stands at {stands / DEG:.0f}° above the belts where {asked / DEG:.0f}° are asked"
        return f"the flipper {seen}: it would not carry the chair"

    def reaches_the_first_step(self) -> str | None:
        """The front pulley is near the first nosing, or the chair's pitch shows that it has touched."""
        return f"first step {self._before_m:.2f} m ahead of the belts' front pulley" if self.enters else None

    def gets_no_hold(self) -> str | None:
        """The belts run on the first nosings and the chair does not come further."""
        if self.stalled_s < PATIENCE_S:
            return None
        slope = self._where.slope_rad / DEG
        return f"the belts ran {PATIENCE_S:g} s on the first nosings of a {slope:.0f}° stair without getting up"

    def mounts_the_crest(self) -> str | None:
        """The front pulley stands on the last nosing before the belts lie on two: one step, or two low ones."""
        around = self._around
        if around is None or not self._where.top_ends or around.top.ahead_m > self._pivot_m:
            return None
        return f"the front has reached the last nosing, pitch {self._where.pitch_rad / DEG:.1f}°"

    def lies_on_two_nosings(self) -> str | None:
        """The belts lie on two nosings, the rear still on the floor."""
        ahead, where = self._where.ahead_m(), self._where
        if len(ahead) < 2 or ahead[0] >= self._lift_off_m() or where.pitch_rad <= where.slope_rad - OFF_RAD:
            return None
        return f"the belts lie on two nosings, pitch {where.pitch_rad / DEG:.1f}°"

    def go_at_the_stair(self) -> MotionPlan:
        """Drives at the first step, slower near it, with the flipper lowered to clear the next step."""
        config = self._config
        nose_m = config.chair.reach_m - self._pivot_m  # the flipper meets the nosing before the pulley
        speed = SLOW_M_S if self._before_m < nose_m else config.climb_speed_m_s
        turn = self._level.keep(self._estimate, self._aside())
        flipper = self._flipper_planner.to(self.t_s, self._mounting_rad)
        return replace(self.still, speed_m_s=speed, turn_m_s=turn, flipper=flipper)

    @property
    def _before_m(self) -> float:
        """Distance of the front pulley before the first nosing [m]; infinite without one."""
        first = self._where.first_ahead_m()
        return math.inf if first is None else first - self._pivot_m

    @property
    def _mounting_rad(self) -> float:
        """Flipper angle at which the tip clears the next step [rad]: it decreases as the pitch increases."""
        left = 1.0 - self._where.pitch_rad / max(self._where.slope_rad, LEVEL_RAD)
        return max(self._stepping_rad * min(left, 1.0), OVER_BELTS_RAD)

    def _lift_off_m(self) -> float:
        """Return the distance of the first nosing ahead of mid-track at which belts on two nosings lift the rear pulley [m]."""
        slope, radius = self._where.slope_rad, self._config.chair.tracks.pulley_radius_m
        return self._where.rise_m / math.sin(slope) - radius * math.tan(0.5 * slope) - self._pivot_m

    def begin_approach(self) -> None:
        """Remember that the chair comes from the floor, and let the flipper begin anew."""
        self._knows_the_foot = True
        self._flipper_planner.forget()

    # --- traction

    def begin_traction_test(self) -> None:
        """Prepare the first pulse of the traction test."""
        self._traction, self._pulses = TractionTest(self._where.slope_rad), 1

    def test_traction(self) -> MotionPlan:
        """Accelerates with slightly more friction demand than the flight needs; a lost pulse is made again once."""
        test = self._traction
        if test is None or test.over:
            self._traction = TractionTest(self._where.slope_rad)
            self._pulses += 1
            return self.still
        # In line with the belts the flipper carries nothing yet, and is already near its riding angle for the first fall.
        return replace(self.still, speed_m_s=test.speed_m_s, flipper=self._flipper_planner.to(self.t_s, 0.0))

    def holds(self) -> str | None:
        """The belts held in the traction test."""
        test = self._traction
        return f"enough friction: {self._slip_of(test)}" if test is not None and test.over and test.holds else None

    def slips(self) -> str | None:
        """The belts slipped in the last pulse of the traction test."""
        test = self._traction
        if test is None or not test.over or test.holds or self._pulses < PULSES:
            return None
        wanted = friction_needed(self._where.slope_rad)
        return f"too little friction: {self._slip_of(test)}, so it is below {wanted:.2f}; dry or roughen the nosings"

    @staticmethod
    def _slip_of(test: TractionTest) -> str:
        return f"the belts slipped by {100.0 * max(test.slip, 0.0):.0f} % of a short test drive"

    def forget_traction_test(self) -> None:
        """End the traction test."""
        self._traction = None

    def back_off(self) -> MotionPlan:
        """Backs down and off the flight: the flipper rides on the nosings, and is lifted before the rear reaches the floor.

        A flipper on which the chair leans, over the crest or where its belts slipped, is first lifted slowly.
        """
        if self._before_m < -2.0 * self._pivot_m - self._step_m:
            leans = self._flipper is not None and self._flipper.angle_rad < self._lies_rad() - THERE_RAD
            if leans:
                return self.driving(0.0, 0.0, self._flipper_planner.to(self.t_s, self._lies_rad(), lifts_rad_s=GENTLY_RAD_S))
            return self.driving(-SLOW_M_S, self._steering(), self._lie())
        flipper = self._flipper_planner.to(self.t_s, self._stepping_rad)
        return self.driving(-SLOW_M_S, self._level.keep(self._estimate), flipper)

    def is_backed_off(self) -> str | None:
        """The chair stands on the floor, half a metre from the flight: it is refused for the reason for which it backed off."""
        backed = self._where.pitch_rad < LIES_RAD and self._from_m - self._where.travel_m > KEEPS_M
        return self.cause if backed else None

    def is_sent_back(self) -> str | None:
        """The operator has pressed "go back", and the foot of the flight is known."""
        return super().is_sent_back() if self._knows_the_foot else None

    def cannot_go_back(self) -> str | None:
        """The operator has pressed "go back" over the crest, or where the foot is not known; a re-arm goes on up."""
        sent_back, self._goes_back = self._goes_back, False
        return "the chair cannot go back down from here; re-arm it to go on up" if sent_back else None

    # --- on the flight

    def loses_grip(self) -> str | None:
        """The belts slip under a square chair, which has stopped and pressed its flipper down; a re-arm goes on up.

        All tracks slip that turn: a chair that starts on the flight, at any heading, is left to the guard.
        """
        is_straight = self._knows_the_foot and self._is_square() and self._command is None
        self._presses |= is_straight and self._where.slip_m_s(self.t_s) > NORMAL_SLIP * self._config.climb_speed_m_s
        if not self._presses:
            return None
        above_rad = 0.0 if self._flipper is None else max(self._flipper.angle_rad - PRESSES_RAD - THERE_RAD, 0.0)
        if above_rad > 0.0 and not self._flipper_planner.is_late(self.t_s, above_rad):
            return None
        return f"the belts slip on the flight; {self._way_out}"

    @property
    def _way_out(self) -> str:
        back = "send the chair back down, or " if self._knows_the_foot else ""
        return f"{back}have the steps dried and re-arm it to go on up"

    def climb(self) -> MotionPlan:
        """Climbs, steered by the heading controller; slowly before the crest. Belts that slip stop."""
        command = self._command
        if self._presses:
            return self.driving(0.0, 0.0, self._flipper_planner.to(self.t_s, PRESSES_RAD))
        if command is not None and command.stage == "slow":
            plan = self.driving(command.speed_m_s, self._steering(blind=True), self._lie())
            return replace(plan, pitch_feedforward_m_s=self._pitch_feedforward())
        aim_rad, estimate = self._aside(), self._estimate
        return replace(
            self.still,
            speed_m_s=self._config.climb_speed_m_s,
            turn_m_s=self._steering(aim_rad),
            heading_rad=aim_rad,
            min_inner_speed_ratio=None if estimate is None else inner_speed_ratio(estimate.heading_rad - aim_rad),
            pitch_feedforward_m_s=self._pitch_feedforward(aim_rad),
            flipper=self._lie(aim_rad),
            needs_stair=command is None,
        )

    def _aside(self) -> float:
        """Return the heading set point away from a near side, or towards the middle between two: walls or drops [rad]."""
        clear_m = self._needs_m + ASIDE_M
        left, right = self._bound_m("left"), self._bound_m("right")
        if left is not None and right is not None:
            lacking = 0.5 * (right - left)
        elif left is not None:
            lacking = max(clear_m - left, 0.0)
        else:
            lacking = 0.0 if right is None else -max(clear_m - right, 0.0)
        # A negative heading leads to the right, away from a wall on the left.
        return -min(max(ASIDE_RAD_M * lacking, -ASIDE_RAD), ASIDE_RAD)

    def _bound_m(self, side: Side) -> float | None:
        """Return the distance from the chair's middle to the wall or the drop on a side [m]; None without one in view."""
        wall = self._where.left_wall_m if side == "left" else self._where.right_wall_m
        return min((bound for bound in (wall, self._where.side_m(side)[1]) if bound is not None), default=None)

    # --- over the crest

    def _cross(self) -> None:
        """Begin the crest sequence near the end of the flight, end it when a further nosing comes into view, and step it."""
        where, around = self._where, self._around
        top_m = math.inf if around is None else around.top.ahead_m
        unseen = top_m - self._pivot_m < ENTER_FROM_M  # earlier frames would have shown a further nosing
        if self._crest is None and around is not None and ((where.top_ends and top_m < NEAR_M) or unseen):
            self._crest = Crest(self._loading, self._config.climb_speed_m_s, around)
            seen = "seen" if where.top_ends else "no nosing seen beyond"
            self._end = f"end of the flight, {seen}"
        elif self._crest is not None and self._is_climbing and not (where.top_ends or unseen):
            self._crest = None
        if self._crest is None or around is None or self._imu is None or self._flipper is None or self._tracks is None:
            self._command = None
            return
        self._command = self._crest.step(self._imu, self._flipper, self._tracks, around)
        self._is_climbing = self._is_climbing and self._command.stage in ("climb", "slow")

    def _stage_in(self, *stages: str) -> CrestCommand | None:
        return self._command if self._command is not None and self._command.stage in stages else None

    def reaches_down(self) -> str | None:
        """The flipper reaches down for the landing."""
        command = self._stage_in("reach", "carry", "lead", "barred", "land", "done")
        return None if command is None else self._with_load(self._end, command)

    def rides_again(self) -> str | None:
        """The flipper stood on a nosing, and the chair drives on before it reaches down again."""
        command = self._stage_in("climb", "slow")
        return None if command is None else command.cause

    def is_barred(self) -> str | None:
        """The crossing cannot succeed."""
        command = self._stage_in("barred")
        return None if command is None else f"{command.cause}: the chair stands before the crest; {self._way_out}"

    def turns_back(self) -> str | None:
        """The crossing cannot succeed, the foot is known, and the flipper's motor works, for its tip carries load."""
        command = self._stage_in("barred")
        if command is None or not self._knows_the_foot or command.is_unloaded:
            return None
        return f"{command.cause}: the chair goes back down; have the last step dried, or take another way"

    def lands(self) -> str | None:
        """The front has come down on the landing."""
        command = self._stage_in("land", "done")
        return None if command is None else self._with_load("the front has come down on the landing", command)

    def _with_load(self, seen: str, command: CrestCommand) -> str:
        return f"{seen}; pitch {self._where.pitch_rad / DEG:.1f}°, {on_the_tip(command.tip_n)}"

    def cross(self) -> MotionPlan:
        """Follows the crest sequence, and corrects large heading errors alone."""
        command = self._command
        if command is None:
            return self.still
        turn = self._level.keep(self._estimate, spare_rad=CREST_SPARE_RAD)
        # Until the flipper's tip carries load, only the belts can soften the rocking of a chair that stops on its nosings.
        feedforward = self._pitch_feedforward(allowed=command.stage == "reach")
        return self.driving(command.speed_m_s + feedforward, turn, command.flipper)

    def is_on_the_landing(self) -> str | None:
        """The chair is clear of the last nosing, and level or further on."""
        return f"on the landing, pitch {self._where.pitch_rad / DEG:.1f}°, clear of the last nosing" if self._is_clear() else None

    def _is_clear(self) -> bool:
        beyond_m = 2.0 * self._pivot_m + KEEPS_M
        is_level = abs(self._where.pitch_rad) < LEVEL_RAD
        return self._stage_in("done") is not None and (is_level or self._where.travel_m - self._from_m > beyond_m)


_BEFORE_THE_FLIGHT: Exits[Ascent] = {
    Ascent.is_barred_by_a_gap: "hold",
    Ascent.is_too_narrow: "hold",
    Ascent.has_an_idle_flipper: "hold",
}
STATES_UP: tuple[State[Ascent], ...] = (
    State(
        "search",
        Ascent.look,
        limit_s=40.0,
        exits={Ascent.is_laid: "climb", Ascent.sees_the_stair: "align", Ascent.found_nothing: "hold"},
        begins=Ascent.face_next_flight,
    ),
    State("align", Ascent.turn_square, limit_s=30.0, exits={Ascent.is_unfit: "refused", Ascent.is_square: "approach"}),
    State(
        "approach",
        Ascent.go_at_the_stair,
        limit_s=10.0,
        exits={
            Ascent.is_sent_back: "back_off",
            **_BEFORE_THE_FLIGHT,
            Ascent.has_an_open_side: "hold",
            Ascent.must_not_enter: "refused",
            Ascent.reaches_the_first_step: "mount",
        },
        begins=Ascent.begin_approach,
    ),
    State(
        "mount",
        Ascent.go_at_the_stair,
        limit_s=20.0,
        exits={
            Ascent.is_sent_back: "back_off",
            **_BEFORE_THE_FLIGHT,
            Ascent.gets_no_hold: "back_off",
            Ascent.mounts_the_crest: "climb",
            Ascent.lies_on_two_nosings: "traction",
        },
    ),
    State(
        "traction",
        Ascent.test_traction,
        limit_s=20.0,
        exits={Ascent.is_sent_back: "back_off", Ascent.holds: "climb", Ascent.slips: "back_off"},
        begins=Ascent.begin_traction_test,
    ),
    State(
        "climb",
        Ascent.climb,
        limit_s=20.0,
        exits={
            Ascent.is_sent_back: "back_off",
            Ascent.cannot_go_back: "hold",
            Ascent.is_barred_by_a_gap: "hold",
            Ascent.loses_grip: "hold",
            Ascent.reaches_down: "crest",
        },
        begins=Ascent.forget_traction_test,
    ),
    State(
        "crest",
        Ascent.cross,
        limit_s=40.0,
        exits={
            Ascent.cannot_go_back: "hold",
            Ascent.turns_back: "back_off",
            Ascent.is_barred: "hold",
            Ascent.rides_again: "climb",
            Ascent.lands: "land",
        },
    ),
    State(
        "land",
        Ascent.cross,
        limit_s=20.0,
        exits={Ascent.cannot_go_back: "hold", Ascent.is_on_a_landing_between: "search", Ascent.is_on_the_landing: "arrived"},
    ),
    State(
        "back_off",
        Ascent.back_off,
        limit_s=30.0,
        exits={Ascent.is_backed_off: "refused"},
        begins=Ascent.forget_traction_test,
        back=True,
    ),
    State("arrived", Ascent.stand, limit_s=math.inf),
    State("refused", Ascent.stand, limit_s=math.inf),
)
"""States of a traversal up: what the chair does, how long without coming further, and what ends it (docs/decisions/0019).

Each limit is longer than the longest way of its state: 160° at 10 °/s or 2.5 m at 0.1 m/s in the search, half a turn in ``align``,
0.1 m at 0.1 m/s where the belts drive, and the stages of the crest sequence, each with a patience of 8 s.
"""
