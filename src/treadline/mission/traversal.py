"""What a way up and a way down have in common: what is felt, the search, the next flight, the plan.

``ascent`` and ``descent`` add the phases of their own; see docs/decisions/0019.
"""

import math
from dataclasses import dataclass
from typing import ClassVar, Literal

from treadline.angles import DEG
from treadline.mechanics.chair import ChairDescription
from treadline.mission.flipper_planner import LIFTED_HEADING_RAD, FlipperPlanner, turning_share
from treadline.mission.grip import SkidMonitor
from treadline.mission.level import LevelConfig, LevelSteering
from treadline.mission.planner import PlannerInput
from treadline.mission.stair_tracker import StairTracker
from treadline.mission.tip_over import TipOverFeedforward
from treadline.signals import FlipperCommand, FlipperReading, HeadingEstimate, ImuSample, MotionPlan, Phase, StairMap, TrackReading

ON_THE_FLIGHT_RAD = 10.0 * DEG
"""Pitch from which a chair that wakes up stands on a flight."""
LEVEL_RAD = 2.0 * DEG
STUCK_SHARE, STUCK_M = 1.5, 0.5
"""Of the way that was to go, and further, run by the belts of a chair that has not got there: something holds it."""
NARROW_MAPS, NARROW_M, ASIDE_M = 10, 0.02, 0.05
"""Maps in a row in which a wall stands nearer than half the chair's width less so much (they err by 5 cm for half a second), before
its first nosing: it would drive onto the wall's end. In a stair 1.2 m wide, askew by 30° and 0.15 m off the middle, it did, and
rolled by 21°. Past the wall it is to be set aside by so much more."""
BLIND_RAD = 1.0 * DEG
"""Heading left alone on the flight where no stair is in view: belts that follow a gyro that drifts turn the chair, and where one
has lost grip they run apart and turn nothing, which the guard takes for the former."""


def beside(before_m: float) -> str:
    """Say how far something is before a pulley, or behind it."""
    return f"{before_m:.2f} m before" if before_m > 0.0 else f"{-before_m:.2f} m behind"


def on_the_tip(load_n: float) -> str:
    """Say what the flipper's tip carries."""
    return f"{max(load_n, 0.0):.0f} N on the flipper's tip"


def missing_step(gap: tuple[float, float], pulley: str) -> str:
    """Say that a step is missing, by the nosings before a pulley; negative where the pulley has passed."""
    near_m, far_m = gap
    return f"a step is missing: {far_m - near_m:.2f} m from nosing to nosing, the first {beside(near_m)} the {pulley} pulley"


@dataclass(frozen=True, slots=True, kw_only=True)
class TraversalConfig:
    """The chair, what its user entered, and the pace."""

    chair: ChairDescription
    payload_kg: float
    cruise_m_s: float = 0.2
    flights: int | None = None
    """To be driven; None goes on as long as another flight is seen from the one before."""
    look_m: float = 2.5
    """To drive on over a landing to see the next flight: from far away its first step alone is in view, or its edge hides it."""
    slow_m_s: float = 0.1
    """Onto the stair and off it."""
    gap_m: float = 0.45
    """Of the leading pulley before the nosing in front of a missing step, where the chair stops for good."""


class Traversal:
    """Senses, phase and plan of one traversal."""

    DIRECTION: ClassVar[Literal["up", "down"]]
    """Of the flights that the camera sees; maps of others are not for this planner."""
    ROLLING: ClassVar[frozenset[Phase]]
    """Phases that begin without a stop."""
    CATCHES: ClassVar[bool]
    """Whether the section goes down under a chair that falls onto it."""
    RIDES_RAD: ClassVar[float]
    """Where a flipper that rides on the nosings is asked to be: they push it up, and the chair rocks on a spring."""

    def __init__(self, chair: ChairDescription, flights: int | None) -> None:
        tracks = chair.tracks
        self._flipper_planner = FlipperPlanner(chair, self.RIDES_RAD)
        self._tip_over = TipOverFeedforward()
        self._gauge_m = tracks.gauge_m
        self._flights = flights
        self._pivot_m = 0.5 * tracks.flat_run_m
        self._half_width_m = chair.half_width_m
        self._face_flight()
        self._phase: Phase = "search"
        self._cause = "woken up"
        self._flights_done = 0
        self._from_m = 0.0
        """Travel at which the phase began."""
        self._ran_m = 0.0
        """Of the belts since then, whatever the camera says of the way made."""
        self._to_go_m = math.inf
        """Of belts, when the phase began."""
        self._imu: ImuSample | None = None
        self._tracks: TrackReading | None = None
        self._turned_rad = 0.0

    def _face_flight(self) -> None:
        """Know nothing yet of the flight ahead."""
        self._where = StairTracker()
        self._level = LevelSteering(LevelConfig(gauge_m=self._gauge_m))
        self._skid = SkidMonitor()
        self._narrow_maps = 0
        self._flipper_planner.forget()

    def update(self, signal: PlannerInput) -> None:
        """Take one signal."""
        match signal:
            case ImuSample():
                dt_s = 0.0 if self._imu is None else signal.t_s - self._imu.t_s
                self._turned_rad += dt_s * float(signal.angular_velocity_rad_s[2])
                self._imu = signal
                self._tip_over.update(signal)
                self._where.update(signal)
            case TrackReading():
                dt_s = 0.0 if self._tracks is None else signal.t_s - self._tracks.t_s
                self._ran_m += 0.5 * dt_s * abs(signal.left_m_s + signal.right_m_s)
                self._tracks = signal
                if signal.brake_on:  # held: neither belts nor flipper do as they are told
                    self._level.rest()
                    self._flipper_planner.forget()
                self._where.update(signal)
            case StairMap():
                if signal.direction == self.DIRECTION:
                    self._where.update(signal)
                    self._narrow_maps = self._narrow_maps + 1 if self._free_m() < self._half_width_m - NARROW_M else 0
            case FlipperReading():
                self._flipper_planner.update(signal)

    def _free_m(self) -> float:
        """Return the way from the chair's middle to the nearer wall, infinite where none is in view."""
        return min((wall for wall in (self._where.left_wall_m, self._where.right_wall_m) if wall is not None), default=math.inf)

    def _narrow(self) -> str | None:
        """Return that the chair, square to the stair, does not fit past a wall, and what would help; None where it does."""
        if self._narrow_maps < NARROW_MAPS:
            return None
        free_m, needs_m = self._free_m(), self._half_width_m
        wall, other = ("left", "right") if free_m == self._where.left_wall_m else ("right", "left")
        helps = f"set the chair {needs_m + ASIDE_M - free_m:.2f} m further to the {other}"
        return f"the {wall} wall is {free_m:.2f} m from the chair's middle, which needs {needs_m:.2f} m: {helps}"

    def _gap(self, way: float) -> tuple[float, float] | None:
        """Return the next gap that the leading pulley has not passed: its nearer and its further nosing before that pulley.

        Args:
            way: 1 for a chair that goes up, -1 for one that backs down.
        """
        sides = [(way * low - self._pivot_m, way * high - self._pivot_m) for low, high in self._where.gaps_ahead_m()]
        return min(((min(pair), max(pair)) for pair in sides if max(pair) > 0.0), default=None)

    def _sweep(self, t_s: float, nowhere: str) -> MotionPlan:
        """Turn to either side to find the stair; hold if it is nowhere."""
        turned, self._turned_rad = self._turned_rad, 0.0
        turn = self._level.sweep(t_s, turned)
        return self._plan(t_s, 0.0, turn_m_s=turn or 0.0, needs_stair=False, hold=nowhere if turn is None else None)

    @property
    def _goes_on(self) -> bool:
        """Whether another flight follows the landing."""
        return self._where.shows_another if self._flights is None else self._flights_done + 1 < self._flights

    def _begin_next(self, t_s: float, on_the_way: str = "") -> MotionPlan:
        """Begin anew with the flight across the landing."""
        seen = "seen" if self._where.shows_another else "not yet seen"
        self._face_flight()
        self._flights_done += 1
        return self._begin(t_s, "search", f"on a landing, flight {self._flights_done + 1}{on_the_way} {seen}")

    @property
    def _flipper(self) -> FlipperReading | None:
        return self._flipper_planner.reading

    @property
    def _step_m(self) -> float:
        """From nosing to nosing; 0 as long as no stair is known."""
        return math.hypot(self._where.rise_m, self._where.run_m)

    @property
    def _stepping_rad(self) -> float:
        """The flipper's angle at which its tip just clears a step."""
        return self._flipper_planner.clears(self._where.rise_m)

    def _lie(self, t_s: float, estimate: HeadingEstimate | None, square_rad: float = 0.0) -> FlipperCommand | None:
        """Return what lays the flipper along the flight: carrying while the chair is square, above the nosings for it to turn."""
        share = self._turning_share(estimate, square_rad)
        catches = self.CATCHES and self._may_follow(t_s, share)
        return self._flipper_planner.ride(t_s, self._step_m, share, falls_rad_s=self._tip_over.rate_rad_s if catches else 0.0)

    def _pitch_feedforward(
        self, t_s: float, estimate: HeadingEstimate | None, square_rad: float = 0.0, *, allowed: bool = True
    ) -> float:
        """Return what both belts add to go with a chair that falls over a nosing, square to the stair and gripping."""
        return self._tip_over.step(t_s, allowed=allowed and self._may_follow(t_s, self._turning_share(estimate, square_rad)))

    def _may_follow(self, t_s: float, share: float) -> bool:
        """Return whether section and belts may go after a fall: not of a chair that turns, nor of one that has lost grip."""
        return share < 1.0 and self._has_grip(t_s)

    def _turning_share(self, estimate: HeadingEstimate | None, square_rad: float) -> float:
        off_rad = LIFTED_HEADING_RAD if estimate is None else abs(estimate.heading_rad - square_rad)
        return turning_share(off_rad, 0.0 if self._tracks is None else abs(self._tracks.right_m_s - self._tracks.left_m_s))

    def _has_grip(self, t_s: float) -> bool:
        """Return whether the belts have lost no grip on this flight."""
        del t_s
        return True

    def _is_laid(self, t_s: float, estimate: HeadingEstimate) -> bool:
        """Return whether a chair that wakes up on a flight may drive; while it is held, its flipper is not expected to move."""
        if self._tracks is not None and self._tracks.brake_on:
            return False
        return self._flipper_planner.is_laid(t_s, self._step_m, turning_share(abs(estimate.heading_rad), 0.0))

    @property
    def _on_a_flight(self) -> str:
        """What a chair that wakes up on a flight sees and feels."""
        flipper = "" if self._flipper is None else f", flipper {self._flipper.angle_rad / DEG:+.0f}° off the belts"
        return f"on a flight, pitched by {self._where.pitch_rad / DEG:.1f}°{flipper}, the stair in view"

    def _steering(
        self, t_s: float, estimate: HeadingEstimate | None, square_rad: float = 0.0, *, climbs: bool = False, blind: bool = False
    ) -> float | None:
        """Return the turn on the flight: None for the controller to steer; 0 where the chair is let alone.

        Args:
            t_s: Now.
            estimate: Where the chair heads.
            square_rad: The heading that the chair steers to.
            climbs: Whether belts that outrun the chair are made to run alike, so that they grip again.
            blind: Whether no stair is in view.
        """
        slip_m_s, roll_back_m = (self._where.slip_m_s(t_s), self._where.roll_back_m(t_s) or 0.0) if climbs else (0.0, 0.0)
        spared = blind and estimate is not None and abs(estimate.heading_rad - square_rad) < BLIND_RAD
        return (
            None
            if self._skid.steering_allowed(t_s, self._tracks, estimate, square_rad, slip_m_s, roll_back_m) and not spared
            else 0.0
        )

    def _stuck(self) -> str | None:
        """Return why the chair must stop, if it does not get where it drives to; a person who re-arms gives it another try."""
        ran_m, to_go_m = self._ran_m, self._to_go_m
        if ran_m < STUCK_SHARE * to_go_m + STUCK_M:
            return None
        self._ran_m = 0.0
        return f"the belts ran {ran_m:.1f} m for the {to_go_m:.1f} m to go: something is in the chair's way"

    def _stand(self, t_s: float, hold: str | None = None, *, needs_stair: bool = True) -> MotionPlan:
        """Let the belts stand."""
        return self._plan(t_s, 0.0, turn_m_s=0.0, needs_stair=needs_stair, hold=hold)

    def _begin(self, t_s: float, phase: Phase, cause: str, to_go_m: float = math.inf) -> MotionPlan:
        """Enter a phase; for this one tick the belts go on as they are, or stand."""
        self._phase, self._cause, self._from_m = phase, cause, self._where.travel_m
        self._ran_m, self._to_go_m = 0.0, to_go_m
        return self._plan(t_s, self._where.speed_m_s if phase in self.ROLLING else 0.0, turn_m_s=0.0)

    def _plan(
        self,
        t_s: float,
        speed_m_s: float,
        *,
        turn_m_s: float | None = None,
        heading_rad: float = 0.0,
        min_inner_speed_ratio: float | None = None,
        pitch_feedforward_m_s: float = 0.0,
        flipper: FlipperCommand | None = None,
        needs_stair: bool = True,
        hold: str | None = None,
    ) -> MotionPlan:
        """Return what to do now; ``hold`` is said anew at each tick: after a person has re-armed it counts if it is still so."""
        return MotionPlan(
            t_s=t_s,
            phase=self._phase,
            speed_m_s=speed_m_s,
            turn_m_s=turn_m_s,
            heading_rad=heading_rad,
            min_inner_speed_ratio=min_inner_speed_ratio,
            pitch_feedforward_m_s=pitch_feedforward_m_s,
            flipper=flipper,
            needs_stair=needs_stair,
            cause=self._cause,
            hold=hold,
        )
