"""Planner of a traversal down, rearwards: find the flight behind, turn square, back to the edge, tip over, descend, leave.

``ImuSample, TrackReading, FlipperReading, StairMap, HeadingEstimate -> MotionPlan``. The chair faces uphill, and the rear camera
sees the edge, the flight below and the floor at its foot. Driving down forwards is not supported: without a rear flipper the chair
would pitch onto its front (docs/decisions/0013).
"""

import math
from dataclasses import dataclass

from treadline.control.edge_sequence import Edge, EdgeCommand, EdgeConfig
from treadline.core.angles import DEG
from treadline.core.signals import FlipperCommand, FlipperReading, HeadingEstimate, MotionPlan
from treadline.core.step_sizes import ON_A_FLIGHT_RAD
from treadline.estimation.stair_tracker import NEAR_M
from treadline.mission._flipper_planner import FLIPPER_RAD_S
from treadline.mission._traversal_base import (
    LEVEL_RAD,
    Traversal,
    TraversalConfig,
    beside,
    on_the_tip,
)

LETS_DOWN_RAD_S = 3.0 * DEG
"""Rate at which the flipper is lifted out of the belts' line [rad/s], slow enough that a chair leaning on it follows."""
RESTS = ("settle", "leave")
"""Stages of the edge sequence with the chair on nosings and little load on the tip: the tip-over feed-forward acts there."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DescentConfig(TraversalConfig):
    """Distances, angles and speeds of a traversal down; distances along the belts unless stated otherwise."""

    lower: float = 0.6
    """Depth of the highest nosing in view below the belts, as a ratio of the rise, above which that nosing is not the edge of the
    landing that the chair stands on."""
    enter_from_m: float = 0.22
    """Distance of the rear pulley before the edge from which the chair may drive onto the flight [m], as going up."""
    max_heading_error_rad: float = 4.0 * DEG
    """Heading error on the flight above which the chair first turns by climbing [rad]: belts that back down and turn diverge."""
    square_rad: float = 1.0 * DEG
    """Heading error below which the turn by climbing ends [rad]."""
    past_m: float = 0.1
    """Largest distance of the front pulley past the edge when the chair lies on the flight [m]."""
    stowed_rad: float = 5.0 * DEG
    """Largest angle between the flipper and its rest at which it counts as stowed, after the chair was lowered back onto the
    landing [rad]."""
    stow_s: float = 8.0
    """Time allowed to stow the flipper [s]."""
    slow_from_m: float = 0.5
    """Distance of the rear pulley before the last nosing at which the chair has slowed down [m]."""
    slows_m: float = 0.1
    """Travel over which the chair slows down [m]: belts that brake at once downhill tip the chair backwards."""
    lift_from_m: float = 0.28
    """Distance of the front pulley before the last nosing but one at which the flipper is lifted [m]. The rear is about to reach
    the floor, so that the flipper no longer has to carry."""
    lifted_m: float = 0.03
    """Distance of the front pulley before that nosing at which the flipper must have been lifted [m]."""
    short_rad: float = 8.0 * DEG
    """Largest angle below step clearance at which the flipper counts as lifted [rad]. A lower flipper would lie on the last nosing
    and drop off it as the chair leaves."""
    unseen_m: float = 0.25
    """Distance of the rear pulley before the last mapped nosing at which the chair stops [m] if no map showed the floor beyond."""
    left_m: float = 0.45
    """Distance of the front pulley past the last nosing at which the chair and its flipper have left the stair [m]."""


class Descent(Traversal):
    """Planner of one traversal down: state machine of the phases in docs/decisions/0019."""

    DIRECTION = "down"
    WAY = -1.0
    ROLLING = frozenset({"descend"})
    CATCHES = False
    RIDES_RAD = -2.5 * DEG
    """Flipper angle while riding, relative to the belts [rad]. Descending, nosings reach the flipper from the belts and leave it at
    its tip, so that they lift even a low flipper smoothly."""

    _config: DescentConfig

    def __init__(self, config: DescentConfig) -> None:
        super().__init__(config)

    def _face_flight(self) -> None:
        super()._face_flight()
        self._edge: Edge | None = None
        self._turned_back_for = ""
        """Reason for lowering the chair back onto the landing; empty if there is none."""
        self._barred_s = math.inf

    def step(self, t_s: float, estimate: HeadingEstimate | None) -> MotionPlan:
        """Return the plan of this tick."""
        if estimate is not None:
            self._where.heading_rad = estimate.heading_rad
        match self._phase:
            case "search":
                return self._search(t_s, estimate)
            case "align":
                return self._align(t_s, estimate)
            case "approach" | "edge":
                return self._over_the_edge(t_s, estimate)
            case "climb":
                return self._turn_by_climbing(t_s, estimate)
            case "descend" | "leave":
                return self._down(t_s, estimate)
            case "arrived":
                flipper = self._flipper_planner.to(t_s, self._flipper_planner.rest_rad)
                return self._plan(t_s, 0.0, turn_m_s=0.0, flipper=flipper, needs_stair=False)
            case _:
                return self._stand(t_s, needs_stair=False)

    def _search(self, t_s: float, estimate: HeadingEstimate | None) -> MotionPlan:
        where = self._where
        if where.pitch_rad > ON_A_FLIGHT_RAD:
            if not where.map_count:
                return self._stand(t_s)
            if estimate is not None and abs(estimate.heading_rad) > self._config.max_heading_error_rad:
                return self._begin(
                    t_s, "climb", f"on a flight, heading error {estimate.heading_rad / DEG:+.1f}°: it turns by climbing"
                )
            if estimate is not None and not self._is_laid(t_s, estimate):
                return self._plan(t_s, 0.0, turn_m_s=0.0, flipper=self._lie(t_s, estimate))
            if estimate is not None:
                return self._begin(t_s, "descend", self._on_a_flight)
            return self._stand(t_s)
        if estimate is not None and where.known:
            return self._begin(t_s, "align", f"flight in view behind, heading {estimate.heading_rad / DEG:+.1f}°")
        if self._flights_done:
            return self._look_on(t_s, estimate, LEVEL_RAD)
        return self._sweep(t_s, "no stair in view behind, to neither side")

    def _align(self, t_s: float, estimate: HeadingEstimate | None) -> MotionPlan:
        if estimate is None:
            return self._stand(t_s)
        if not self._level.is_square(estimate, t_s):
            return self._plan(t_s, 0.0, turn_m_s=self._level.towards(estimate))
        config, where = self._config, self._where
        if (refusal := self._infeasible(enters=False)) is not None:
            return self._begin(t_s, "refused", refusal)
        edge = where.top_ahead_m()
        if edge is None or edge > -self._pivot_m:
            return self._stand(t_s, "square to the flight, and its edge is not behind the chair")
        below_m = -(where.top_above_m() or 0.0)
        if below_m > config.lower * where.rise_m:
            hidden = "the edge is nearer, hidden under the camera"
            return self._stand(t_s, f"the highest nosing in view is {below_m:.2f} m below the belts: {hidden}")
        edge_config = EdgeConfig(chair=config.chair, payload_kg=config.payload_kg, cruise_m_s=config.slow_m_s)
        self._edge = Edge(edge_config, -edge, where.slope_rad)
        to_go_m = -edge - self._pivot_m
        cause = f"square within {abs(estimate.heading_rad) / DEG:.1f}°; edge {to_go_m:.2f} m behind"
        return self._begin(t_s, "approach", cause, to_go_m)

    def _over_the_edge(self, t_s: float, estimate: HeadingEstimate | None) -> MotionPlan:
        if self._edge is None or self._imu is None or self._flipper is None or self._tracks is None:
            return self._stand(t_s)
        edge = self._where.top_ahead_m()
        enters = edge is None or -edge - self._pivot_m < self._config.enter_from_m
        if self._phase == "approach" and (stops := self._stuck() or self._narrow() or self._open_side(enters=enters)) is not None:
            return self._stand(t_s, stops)
        if self._phase == "approach" and (refusal := self._infeasible(enters=enters)) is not None:
            return self._begin(t_s, "refused", refusal)
        whole_to_m = -math.inf if edge is None else self._whole_below_edge_m - edge
        missing = self._missing(self._checked_to_m(whole_to_m) - self._pivot_m)
        if missing is not None and (self._phase == "approach" or not self._edge.turn_back()):
            return self._stand(t_s, missing)
        if missing is None and self._unseen(whole_to_m) and self._edge.turn_back():
            missing = "no more of the flight is in view than the chair needs to lie on, nor its end"
        self._turned_back_for = missing or self._turned_back_for
        if edge is not None:
            self._edge.nosing_seen(-edge)
        command = self._edge.step(self._imu, self._flipper, self._tracks)
        if command.stage == "done":
            return self._begin(t_s, "descend", f"the belts lie on the flight, pitch {self._where.pitch_rad / DEG:.1f}°")
        self._note(command)
        turn = self._level.keep(estimate)
        barred = self._barred(t_s, self._flipper) if command.stage == "barred" else None
        speed = command.speed_m_s + self._pitch_feedforward(t_s, estimate, allowed=command.stage in RESTS)
        return self._plan(t_s, speed, turn_m_s=turn, flipper=command.flipper, needs_stair=False, hold=barred)

    def _barred(self, t_s: float, flipper: FlipperReading) -> str | None:
        """Return the reason for the permanent stop before the edge; None while a horizontal chair still stows its flipper."""
        config, pitch = self._config, self._where.pitch_rad
        self._barred_s = min(self._barred_s, t_s)
        is_level = abs(pitch) < LEVEL_RAD
        off_rad = abs(flipper.angle_rad - self._flipper_planner.rest_rad)
        if is_level and off_rad > config.stowed_rad and t_s - self._barred_s < config.stow_s:
            return None
        why = self._turned_back_for or "the flipper could not let the chair down over the edge"
        return f"{why}; it " + ("stands on the landing again" if is_level else f"stands at {pitch / DEG:.0f}°")

    @property
    def _whole_below_edge_m(self) -> float:
        """Distance below the edge over which the flight must be complete [m]: length of the chair on it, and stopping distance."""
        return 2.0 * self._pivot_m + self._config.past_m + self._config.gap_m

    def _checked_to_m(self, whole_to_m: float) -> float:
        """Return the distance from mid-track up to which a gap counts [m]; further away a detector may miss a single nosing."""
        if self._phase != "approach":
            return whole_to_m
        return min(whole_to_m, NEAR_M - self._step_m)

    def _unseen(self, whole_to_m: float) -> bool:
        """Return whether the chair is lifted although maps have shown too little of the flight below."""
        where = self._where
        bottom = where.bottom_ahead_m()
        lifted = where.pitch_rad > where.slope_rad - LEVEL_RAD
        return lifted and not where.bottom_ends and (bottom is None or -bottom < whole_to_m)

    def _note(self, command: EdgeCommand) -> None:
        if self._phase == "approach" and command.stage != "approach":
            self._phase = "edge"
            self._cause = f"{command.stage}: {on_the_tip(command.tip_n)}"

    def _turn_by_climbing(self, t_s: float, estimate: HeadingEstimate | None) -> MotionPlan:
        if estimate is not None and abs(estimate.heading_rad) < self._config.square_rad:
            return self._begin(t_s, "descend", f"square within {abs(estimate.heading_rad) / DEG:.1f}°")
        return self._plan(t_s, self._config.cruise_m_s, flipper=self._lie(t_s, estimate))

    def _down(self, t_s: float, estimate: HeadingEstimate | None) -> MotionPlan:
        config, where = self._config, self._where
        if (missing := self._missing(config.gap_m)) is not None:
            return self._stand(t_s, missing)
        foot = where.bottom_ahead_m()
        before = math.inf if foot is None else -foot - self._pivot_m
        tips = before < 0.0 or (before < config.slow_from_m and where.pitch_rad < LEVEL_RAD)
        if self._phase == "descend" and not where.bottom_ends and (tips or before < config.unseen_m):
            return self._stand(t_s, f"nothing was seen beyond the last nosing, {beside(before)} the rear pulley")
        if self._phase == "descend" and tips:
            self._phase, self._cause = "leave", f"last nosing {beside(before)} the rear pulley, the floor beyond it seen"
        if self._phase == "leave" and abs(where.pitch_rad) < LEVEL_RAD and before < -2.0 * self._pivot_m - config.left_m:
            if self._goes_on:
                return self._begin_next(t_s, " on the way down")
            return self._begin(t_s, "arrived", f"on the floor, pitch {where.pitch_rad / DEG:.1f}°, clear of the first nosing")
        last_step_m = before + 2.0 * self._pivot_m - self._step_m  # front pulley to the last nosing but one
        low_rad = self._low_rad if last_step_m < config.lifted_m else 0.0
        is_late = self._flipper_planner.is_late(t_s, low_rad, self._gently_s)
        if low_rad > 0.0:
            return self._raise(t_s, is_late=is_late)
        slow = before < config.slow_from_m
        hasty = 0.0 if self._phase == "leave" else min(max((before - config.slow_from_m) / config.slows_m, 0.0), 1.0)
        speed = -(config.slow_m_s + hasty * (config.cruise_m_s - config.slow_m_s))
        flipper = self._lift(t_s) if last_step_m < config.lift_from_m else self._lie(t_s, estimate)
        if self._phase == "leave":
            return self._plan(t_s, speed, turn_m_s=self._level.keep(estimate), flipper=flipper, needs_stair=False)
        turn, feedforward = self._steering(t_s, estimate, blind=slow), self._pitch_feedforward(t_s, estimate)
        return self._plan(t_s, speed, turn_m_s=turn, pitch_feedforward_m_s=feedforward, flipper=flipper, needs_stair=not slow)

    def _lift(self, t_s: float) -> FlipperCommand | None:
        """Return the command that lifts the flipper: slowly while the chair may lean on it."""
        leans = self._flipper is not None and self._flipper.angle_rad < 0.0
        return self._flipper_planner.to(t_s, self._stepping_rad, lifts_rad_s=LETS_DOWN_RAD_S if leans else FLIPPER_RAD_S)

    @property
    def _low_rad(self) -> float:
        """Angle by which the flipper still has to be lifted to clear a step [rad]; zero without a flipper."""
        return 0.0 if self._flipper is None else max(self._stepping_rad - self._config.short_rad - self._flipper.angle_rad, 0.0)

    @property
    def _gently_s(self) -> float:
        """Time that the flipper needs to reach the belts' line [s]."""
        return 0.0 if self._flipper is None else max(-self._flipper.angle_rad, 0.0) / LETS_DOWN_RAD_S

    def _raise(self, t_s: float, *, is_late: bool) -> MotionPlan:
        """Return the plan that waits for the flipper, with a hold if the flipper is late; each re-arm allows another try."""
        stays = "the flipper does not rise: as the chair left the stair, it would drop off the last nosing"
        flipper = self._lift(t_s)
        return self._plan(t_s, 0.0, turn_m_s=0.0, flipper=flipper, needs_stair=False, hold=stays if is_late else None)
