"""Planner of a traversal down, rearwards: find the flight behind, turn square, back to the edge, tip over, descend, leave.

``ImuSample, TrackReading, FlipperReading, StairMap, HeadingEstimate -> MotionPlan``. The chair faces uphill, and the rear camera
sees the edge, the flight below and the floor at its foot. Driving down forwards is not supported: without a rear flipper the chair
would pitch onto its front (docs/decisions/0013).
"""

import math
from dataclasses import replace

from treadline.control.belt_allocation import GENTLE_M_S2
from treadline.control.edge_sequence import Edge, EdgeCommand
from treadline.control.flipper import FLIPPER_RAD_S, GENTLY_RAD_S, PLACE_M, SLOW_M_S, THERE_RAD
from treadline.core.angles import DEG
from treadline.core.signals import FlipperCommand, HeadingEstimate, MotionPlan
from treadline.estimation.known_nosings import SIGMAS
from treadline.estimation.stair_tracker import NEAR_M
from treadline.mission._automaton import Automaton, State
from treadline.mission._situation import (
    ASIDE_M,
    ENTER_FROM_M,
    KEEPS_M,
    LEVEL_RAD,
    FlightSituation,
    Way,
    beside,
    on_the_tip,
)
from treadline.mission.mission_config import MissionConfig

RESTS = ("settle", "leave")
"""Stages of the edge sequence with the chair on nosings and little load on the tip: the tip-over feed-forward acts there."""


DOWN = Way(direction="down", sign=-1.0, rides_rad=-2.5 * DEG)
"""Way down. Descending, nosings reach the flipper from the belts and leave it at its tip, so that they lift even a low flipper
smoothly."""


OFF_HEADING_RAD = 4.0 * DEG
"""Heading error on the flight above which the chair turns by climbing [rad]: belts that back down and turn diverge."""


class Descent(FlightSituation):
    """Planner of one traversal down.

    Args:
        config: Mission, of which chair, payload, speed and number of flights count.
    """

    def __init__(self, config: MissionConfig) -> None:
        super().__init__(config, DOWN)
        self._automaton = Automaton(STATES_DOWN)

    def face_flight(self) -> None:
        """Reset everything that belongs to one flight."""
        super().face_flight()
        self._edge: Edge | None = None
        self._command: EdgeCommand | None = None
        """Command of the edge sequence at this tick."""
        self._gap: str | None = None
        """Missing step of the flight below the edge."""
        self._turned_back_for = ""
        """Reason for lowering the chair back onto the landing; empty if there is none."""
        self._is_late = False
        """Whether the flipper has not been lifted in time off the last nosings."""
        self._is_off_heading = False
        """Whether the chair has been held for its heading error on the flight."""

    def step(self, t_s: float, estimate: HeadingEstimate | None) -> MotionPlan:
        """Return the plan of this tick."""
        self.begin_tick(t_s, estimate)
        if self.phase in ("approach", "edge"):
            self._go_over()
        elif self.phase == "leave":
            self._is_late = self._flipper_planner.is_late(t_s, self._low_rad, self._gently_s)
        return self._automaton.step(self)

    # --- before the edge

    @property
    def enters(self) -> bool:
        """Whether the chair is about to drive onto the flight: a side that was not in view does not count as wide enough."""
        edge = self._where.top_ahead_m()
        return self.phase != "align" and (edge is None or -edge - self._pivot_m < ENTER_FROM_M)

    def has_a_heading_error(self) -> str | None:
        """The chair lies on a flight that is in view, with a heading error that backing down would enlarge."""
        estimate = self._estimate
        if not self._lies_on_a_flight or not self._where.map_count or estimate is None:
            return None
        off = estimate.heading_rad
        is_large = abs(off) > OFF_HEADING_RAD
        return f"on a flight, heading error {off / DEG:+.1f}°: it turns by climbing" if is_large else None

    def is_past_the_edge(self) -> str | None:
        """Square to the flight, and its edge is not behind the chair."""
        edge = self._where.top_ahead_m()
        is_past = self._is_square() and (edge is None or edge > -self._pivot_m)
        return "square to the flight, and its edge is not behind the chair" if is_past else None

    def hides_the_edge(self) -> str | None:
        """Square to the flight, and its edge is hidden under the camera: the highest nosing in view is below the belts."""
        where = self._where
        top, below_m = where.top_ahead_m(), -(where.top_above_m() or 0.0)
        if not self._is_square() or top is None or below_m <= 0.5 * where.rise_m:
            return None
        edge_m = -top - round(below_m / where.rise_m) * where.run_m
        camera = self._config.chair.camera_at(rear=True)
        lowest_rad = camera.mount_pitch_rad + math.atan((camera.height_px - 1 - camera.cy_px) / camera.fy_px)
        shown_m = abs(camera.mount_m[0]) + camera.mount_m[2] / math.tan(lowest_rad)
        there = f"the edge is hidden under the camera, about {edge_m - self._pivot_m:.2f} m behind the belts"
        return f"{there}; set the chair {max(shown_m - edge_m, 0.0) + ASIDE_M:.2f} m further from it"

    def is_square(self) -> str | None:
        """Square to the flight for half a second, its edge behind the chair."""
        edge = self._where.top_ahead_m()
        if not self._is_square() or self._estimate is None or edge is None:
            return None
        return f"square within {abs(self._estimate.heading_rad) / DEG:.1f}°; edge {-edge - self._pivot_m:.2f} m behind"

    def begin_edge(self) -> None:
        """Prepare the edge sequence."""
        self._edge = None if self._around is None else Edge(self._loading, self._around)

    def cannot_be_let_down(self) -> str | None:
        """The flipper's range does not suffice to lift the chair to the uppermost nosings."""
        if self._edge is None or self._around is None or not self._config.check:
            return None
        return self._edge.refusal(self._around, 0.0 if self.enters else SIGMAS) or None

    # --- over the edge

    def _go_over(self) -> None:
        """Check the flight below the edge, and step the edge sequence."""
        around = self._around
        if self._edge is None or around is None or self._imu is None or self._flipper is None or self._tracks is None:
            self._command = None
            return
        # The flight must be complete over the length of the chair on it, and the stopping distance.
        whole_to_m = 2.0 * self._pivot_m + KEEPS_M - around.top.ahead_m
        self._gap = self._missing(self._checked_to_m(whole_to_m) - self._pivot_m)
        if self._gap is not None and self.phase == "approach":
            return
        against = self._gap or self.is_sent_back()
        if against is None and self._unseen(whole_to_m):
            against = "no more of the flight is in view than the chair needs to lie on, nor its end"
        if against is not None and self._edge.turn_back():
            self._turned_back_for = against
        self._command = self._edge.step(self._imu, self._flipper, self._tracks, around)

    def lacks_a_step(self) -> str | None:
        """A step is missing below the edge, where the chair would lie, and it cannot be set back on the landing."""
        return None if self._turned_back_for else self._gap

    def presses(self) -> str | None:
        """The flipper presses on the landing."""
        command = self._command
        return None if command is None or command.stage == "approach" else f"{command.stage}: {on_the_tip(command.tip_n)}"

    def lies_on_the_flight(self) -> str | None:
        """The belts lie on the flight."""
        is_down = self._command is not None and self._command.stage == "done"
        return f"the belts lie on the flight, pitch {self._where.pitch_rad / DEG:.1f}°" if is_down else None

    def is_barred(self) -> str | None:
        """The chair could not be let down; a chair that is level again stows its flipper first."""
        if self._command is None or self._command.stage != "barred" or self._flipper is None:
            return None
        pitch = self._where.pitch_rad
        is_level = abs(pitch) < LEVEL_RAD
        off_rad = abs(self._flipper.angle_rad - self._flipper_planner.rest_rad)
        off_rad = off_rad if is_level and off_rad > THERE_RAD else 0.0
        if not self._flipper_planner.is_late(self.t_s, off_rad) and off_rad > 0.0:
            return None
        why = self._turned_back_for or "the flipper could not let the chair down over the edge"
        return f"{why}; it " + ("stands on the landing again" if is_level else f"stands at {pitch / DEG:.0f}°")

    def go_over(self) -> MotionPlan:
        """Follows the edge sequence."""
        command = self._command
        if command is None:
            return self.still
        feedforward = self._pitch_feedforward(allowed=command.stage in RESTS)
        return self.driving(command.speed_m_s + feedforward, self._level.keep(self._estimate), command.flipper)

    def _checked_to_m(self, whole_to_m: float) -> float:
        """Return the distance from mid-track up to which a gap counts [m]; further away a detector may miss a single nosing."""
        if self.phase != "approach":
            return whole_to_m
        return min(whole_to_m, NEAR_M - self._step_m)

    def _unseen(self, whole_to_m: float) -> bool:
        """Return whether the chair is lifted although maps have shown too little of the flight below."""
        where = self._where
        bottom = where.bottom_ahead_m()
        lifted = where.pitch_rad > where.slope_rad - LEVEL_RAD
        return lifted and not where.bottom_ends and (bottom is None or -bottom < whole_to_m)

    # --- on the flight

    def turn_by_climbing(self) -> MotionPlan:
        """Climbs, steered by the heading controller: belts that back down and turn diverge."""
        return replace(self.still, speed_m_s=self._config.climb_speed_m_s, turn_m_s=None, flipper=self._lie())

    def slides_off_heading(self) -> str | None:
        """The heading error has grown beyond what backing down corrects; a re-arm lets the chair turn by climbing."""
        if self._is_off_heading or self.has_a_heading_error() is None or self._estimate is None:
            return None
        self._is_off_heading, off = True, self._estimate.heading_rad / DEG
        remedy = "have the chair steadied, or re-arm it to turn by climbing"
        return f"heading error {off:+.1f}° on the flight: one belt slides, or the gyro errs; {remedy}"

    def has_turned(self) -> str | None:
        """The heading error is small."""
        estimate = self._estimate
        if estimate is None or not self._level.within(estimate):
            return None
        self._is_off_heading = False
        return f"square within {abs(estimate.heading_rad) / DEG:.1f}°"

    def saw_no_floor(self) -> str | None:
        """The rear pulley is near the last nosing in any map, and no map showed the floor beyond."""
        before = self._before_m
        is_there = self._tips or before < ENTER_FROM_M
        if self._where.bottom_ends or not is_there:
            return None
        return f"nothing was seen beyond the last nosing, {beside(before)} the rear pulley"

    def cannot_go_back(self) -> str | None:
        """The operator has pressed "go back" on the flight, where no camera faces the landing; a re-arm goes on down."""
        sent_back, self._goes_back = self._goes_back, False
        return "the chair cannot go back up without a view of the landing; re-arm it to go on down" if sent_back else None

    def tips_onto_the_floor(self) -> str | None:
        """The rear pulley has passed the last nosing, or the chair is level near it."""
        return f"last nosing {beside(self._before_m)} the rear pulley, the floor beyond it seen" if self._tips else None

    def keeps_its_flipper_low(self) -> str | None:
        """The flipper is not lifted in time; each re-arm allows another try."""
        stays = "the flipper does not rise: as the chair left the stair, it would drop off the last nosing"
        return stays if self._is_late else None

    def is_on_the_floor(self) -> str | None:
        """The chair is level and clear of the last nosing."""
        return f"on the floor, pitch {self._where.pitch_rad / DEG:.1f}°, clear of the first nosing" if self._is_clear() else None

    def _is_clear(self) -> bool:
        return abs(self._where.pitch_rad) < LEVEL_RAD and self._is_off

    @property
    def _is_off(self) -> bool:
        """Whether the flipper's tip has left the last nosing."""
        return self._before_m < -2.0 * self._pivot_m - self._config.chair.tracks.approach_m

    @property
    def _before_m(self) -> float:
        """Distance of the rear pulley before the last nosing [m]; infinite without one."""
        foot = self._where.bottom_ahead_m()
        return math.inf if foot is None else -foot - self._pivot_m

    @property
    def _tips(self) -> bool:
        before = self._before_m
        return before < 0.0 or (before < KEEPS_M and self._where.pitch_rad < LEVEL_RAD)

    def descend(self) -> MotionPlan:
        """Backs down, slower near the last nosing, the flipper riding until the last nosings."""
        before = self._before_m
        is_near = before < KEEPS_M
        speed = -min(math.sqrt(SLOW_M_S**2 + 2.0 * GENTLE_M_S2 * max(before - KEEPS_M, 0.0)), self._config.climb_speed_m_s)
        plan = self.driving(speed, self._steering(blind=is_near), self._lie_or_lift())
        return replace(plan, pitch_feedforward_m_s=self._pitch_feedforward(), needs_stair=not is_near)

    def leave(self) -> MotionPlan:
        """Backs off the last nosings; the flipper rides, and is lifted off the last but one."""
        is_low = self._low_rad > 0.0
        speed, turn = (0.0, 0.0) if is_low else (-SLOW_M_S, self._level.keep(self._estimate))
        return self.driving(speed, turn, self._lie_or_lift())

    def stow(self) -> MotionPlan:
        """Stands for good, and stows the flipper."""
        return self.driving(0.0, 0.0, self._flipper_planner.to(self.t_s, self._flipper_planner.rest_rad))

    @property
    def _last_step_m(self) -> float:
        """Distance of the front pulley before the last nosing but one [m]."""
        return self._before_m + 2.0 * self._pivot_m - self._step_m

    def _lie_or_lift(self) -> FlipperCommand | None:
        """Return the command of a flipper that rides on the nosings until the last ones.

        It is lifted off those, slowly while the chair may lean on it.
        """
        if self._last_step_m >= ENTER_FROM_M:
            return self._lie()
        leans = self._flipper is not None and self._flipper.angle_rad < 0.0
        return self._flipper_planner.to(self.t_s, self._stepping_rad, lifts_rad_s=GENTLY_RAD_S if leans else FLIPPER_RAD_S)

    @property
    def _low_rad(self) -> float:
        """Angle by which the flipper still has to be lifted to clear a step near the last nosings [rad]; 0 without a flipper.

        It must have been lifted where the front pulley may have come to the last nosing but one, by the error of its place.
        """
        if self._flipper is None or self._last_step_m >= PLACE_M or self._is_off:
            return 0.0
        return max(self._stepping_rad - THERE_RAD - self._flipper.angle_rad, 0.0)

    @property
    def _gently_s(self) -> float:
        """Time that the flipper needs to reach the belts' line [s]."""
        return 0.0 if self._flipper is None else max(-self._flipper.angle_rad, 0.0) / GENTLY_RAD_S


STATES_DOWN: tuple[State[Descent], ...] = (
    State(
        "search",
        Descent.look,
        limit_s=40.0,
        exits={
            Descent.has_a_heading_error: "climb",
            Descent.is_laid: "descend",
            Descent.sees_the_stair: "align",
            Descent.found_nothing: "hold",
        },
        begins=Descent.face_next_flight,
    ),
    State(
        "align",
        Descent.turn_square,
        limit_s=30.0,
        exits={
            Descent.is_unfit: "refused",
            Descent.is_past_the_edge: "hold",
            Descent.hides_the_edge: "hold",
            Descent.is_square: "approach",
        },
    ),
    State(
        "approach",
        Descent.go_over,
        limit_s=10.0,
        exits={
            Descent.is_sent_back: "refused",
            Descent.is_too_narrow: "hold",
            Descent.has_an_open_side: "hold",
            Descent.must_not_enter: "refused",
            Descent.cannot_be_let_down: "refused",
            Descent.lacks_a_step: "hold",
            Descent.presses: "edge",
        },
        begins=Descent.begin_edge,
    ),
    State(
        "edge",
        Descent.go_over,
        limit_s=60.0,
        exits={Descent.lacks_a_step: "hold", Descent.is_barred: "hold", Descent.lies_on_the_flight: "descend"},
    ),
    State(
        "climb",
        Descent.turn_by_climbing,
        limit_s=60.0,
        exits={Descent.cannot_go_back: "hold", Descent.has_turned: "descend"},
        back=True,
    ),
    State(
        "descend",
        Descent.descend,
        limit_s=20.0,
        exits={
            Descent.cannot_go_back: "hold",
            Descent.slides_off_heading: "hold",
            Descent.has_a_heading_error: "climb",
            Descent.is_barred_by_a_gap: "hold",
            Descent.saw_no_floor: "hold",
            Descent.tips_onto_the_floor: "leave",
        },
    ),
    State(
        "leave",
        Descent.leave,
        limit_s=20.0,
        exits={
            Descent.is_on_a_landing_between: "search",
            Descent.is_on_the_floor: "arrived",
            Descent.keeps_its_flipper_low: "hold",
        },
    ),
    State("arrived", Descent.stow, limit_s=math.inf),
    State("refused", Descent.stand, limit_s=math.inf),
)
"""States of a traversal down: what the chair does, how long without coming further, and what ends it (docs/decisions/0019).

The limits are those of ``STATES_UP``; over the edge the chair may also be lifted and let down again.
"""
