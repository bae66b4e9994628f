"""What one traversal knows at a tick: readings, tracked stair, conditions of both directions, steering and flipper on the flight.

``ascent_states`` and ``descent_states`` add their behaviours and tables of states; see docs/decisions/0019.
"""

import math
from dataclasses import dataclass, replace
from typing import Literal

from treadline.control.flipper import SLOW_M_S
from treadline.core.angles import DEG
from treadline.core.signals import (
    FlipperCommand,
    FlipperReading,
    HeadingEstimate,
    ImuSample,
    MotionPlan,
    OperatorInput,
    Phase,
    StairMap,
    TrackReading,
)
from treadline.core.step_sizes import ON_A_FLIGHT_RAD
from treadline.estimation.known_nosings import KnownNosings
from treadline.estimation.stair_tracker import SLIP_VALID_S, Side, StairTracker
from treadline.mission._flat_ground_steering import SQUARE_RAD, LevelSteering
from treadline.mission._flipper_planner import FlipperPlanner, turning_share
from treadline.mission._skid_monitor import SkidMonitor
from treadline.mission._tip_over import TipOverFeedforward
from treadline.mission.entry_check import certain_reject_reason, reject_reason
from treadline.mission.mission_config import LowEdge, MissionConfig
from treadline.mission.planner import PlannerInput
from treadline.vehicle.loading import Loading, plumb
from treadline.vehicle.traction import dead_zone_rad

LEVEL_RAD = 2.0 * DEG
"""Absolute pitch below which the chair is horizontal [rad]."""
FURTHER_M = 0.1
"""Distance along the flight by which a chair has come further [m]: three standard deviations of the tracker's place on approach."""
NARROW_MAPS, ASIDE_M = 10, 0.05
"""Number of consecutive maps in which a wall is nearer than half the chair's width less ``SIDE_M``, and lateral shift proposed in
excess of that width [m]. Measured walls err by 5 cm for half a second. In a stair 1.2 m wide a chair that started with 30° of
heading error, 0.15 m off the middle, drove onto the wall's end and rolled by 21°."""
SIDE_M = 0.02
"""Largest error of a measured side, wall or drop [m] (``tests/perception/test_form.py``)."""
LOOK_M = 2.5
"""Travel over a landing to find the next flight [m]: from further away only its first step is in view, or its edge hides it."""
ENTER_FROM_M = 0.25
"""Distance of a pulley before a nosing from which it counts as being reached [m]: the first one of the flight, the last one in any
map, and the one at which the flipper of a chair that leaves is lifted."""
KEEPS_M = 0.5
"""Distance that a chair keeps from a missing step, at which it has slowed down before the foot of a flight, and which it goes away
from a flight [m]."""


def beside(before_m: float) -> str:
    """Return a distance in words: before a pulley if positive, behind the pulley if negative."""
    return f"{before_m:.2f} m before" if before_m > 0.0 else f"{-before_m:.2f} m behind"


def on_the_tip(load_n: float) -> str:
    """Return the load on the flipper's tip in words."""
    return f"{max(load_n, 0.0):.0f} N on the flipper's tip"


def _is_within(ahead_m: float, front_m: float, rear_m: float) -> bool:
    """Return whether a place is between two places on the chair, or nearly so."""
    return -rear_m - ENTER_FROM_M < ahead_m < front_m + ENTER_FROM_M


@dataclass(frozen=True, slots=True)
class Way:
    """Direction of a traversal."""

    direction: Literal["up", "down"]
    """Direction of the flights in view of the camera in use; maps of the other direction are ignored."""
    sign: float
    """Sign of the speed: 1 climbing, -1 backing down."""
    rides_rad: float
    """Angle of a riding flipper relative to the belts [rad]; nosings push the flipper up, as a spring and damper."""


class FlightSituation:
    """Readings, tracked stair and state of one traversal at a tick, and what both directions conclude from them.

    Args:
        config: Mission, of which chair, payload, speed and number of flights count.
        way: Direction.
    """

    def __init__(self, config: MissionConfig, way: Way) -> None:
        chair = config.chair
        self._config = config
        self._way = way
        self._flipper_planner = FlipperPlanner(chair, way.rides_rad)
        self._tip_over = TipOverFeedforward()
        self._loading = Loading(chair=chair, payload_kg=config.payload_kg)
        self._dead_zone_rad = dead_zone_rad(chair, config.payload_kg)
        self._pivot_m = 0.5 * chair.tracks.flat_run_m
        self._half_width_m = chair.half_width_m
        self._needs_m = chair.swept_half_m + SIDE_M
        """Half width that the flight must have on either side of the chair's middle [m]."""
        self.phase: Phase = "search"
        self.cause = "start of the run"
        self.t_s = 0.0
        self.stalled_s = 0.0
        """Time with released brakes since the state began, or since the chair last came further [s]."""
        self._goes, self._furthest_m = way.sign, -math.inf
        """Sign of the state's motion up the flight, and furthest place of the chair in that direction since it began [m]."""
        self._estimate: HeadingEstimate | None = None
        self._around: KnownNosings | None = None
        """Known nosings relative to the chair at this tick."""
        self._flights_done = 0
        self._from_m = 0.0
        """Travel at which the phase began [m]."""
        self._imu: ImuSample | None = None
        self._tracks: TrackReading | None = None
        self._turned_rad = 0.0
        self._edges_m: dict[LowEdge, float] = {}
        """Belt travel at which mid-track is at each known low edge [m]."""
        self.face_flight()

    def face_flight(self) -> None:
        """Reset everything that belongs to one flight."""
        self._where = StairTracker()
        self._level = LevelSteering(self._config.chair.tracks.gauge_m)
        self._skid = SkidMonitor()
        self._waiting: StairMap | None = None
        self._narrow_maps = 0
        self._goes_back = False
        """Whether the operator has sent the chair back."""
        self._judged: tuple[int, bool, str | None] = (0, False, None)
        """Number of maps when the stair was last judged, whether the chair was about to enter, and the judgement."""
        self._flipper_planner.forget()

    def update(self, signal: PlannerInput) -> None:
        """Update with one signal."""
        match signal:
            case ImuSample():
                dt_s = 0.0 if self._imu is None else signal.t_s - self._imu.t_s
                self._turned_rad += dt_s * signal.angular_velocity_rad_s[2]
                self._imu = signal
                self._tip_over.update(signal)
                self._where.update(signal)
            case TrackReading():
                self._tracks = signal
                if signal.brake_on:  # held: belts and flipper do not follow commands
                    self._level.rest()
                    self._flipper_planner.forget()
                self._where.update(signal)
            case StairMap():
                # Without a heading the distances of a map along the chair are not those up the flight: it waits for one.
                if signal.direction == self._way.direction:
                    self._waiting = signal
                    self._place_map()
            case FlipperReading():
                self._flipper_planner.update(signal)
            case OperatorInput():
                self._goes_back |= signal.go_back
                if signal.flight_ends:
                    self._where.declare_end(self._way.direction)

    def begin_tick(self, t_s: float, estimate: HeadingEstimate | None) -> None:
        """Take time and heading of a tick."""
        is_held = self._tracks is not None and self._tracks.brake_on
        self.stalled_s += 0.0 if is_held else max(t_s - self.t_s, 0.0)
        if estimate is not None and self._estimate is None:
            self._where.forget_poses()
        self.t_s, self._estimate = t_s, estimate
        if estimate is not None:
            self._where.heading_rad = estimate.heading_rad
        self._place_map()
        self._around = self._where.around(self._pivot_m)
        here_m = self._goes * self._where.up_m
        if here_m > self._furthest_m + FURTHER_M:
            self._furthest_m, self.stalled_s = here_m, 0.0

    def _place_map(self) -> None:
        """Give the newest map to the tracker once a heading is known."""
        if self._waiting is None or self._estimate is None:
            return
        self._where.update(self._waiting)
        self._waiting = None
        self._narrow_maps = self._narrow_maps + 1 if self._free_m() < self._half_width_m - SIDE_M else 0

    def enter(self, phase: Phase, cause: str, *, back: bool) -> None:
        """Begin a state that goes along the traversal, or against it."""
        self.phase, self.cause, self._from_m = phase, cause, self._where.travel_m
        self._goes = -self._way.sign if back else self._way.sign
        self.try_again()

    def try_again(self) -> None:
        """Restart the time of the state: a person who re-arms the chair allows another try."""
        self.stalled_s, self._furthest_m = 0.0, self._goes * self._where.up_m

    # --- conditions of both directions

    def sees_the_stair(self) -> str | None:
        """More than one frame shows the flight, and the heading is known."""
        if self._estimate is None or not self._where.known or self._lies_on_a_flight:
            return None
        view = "stair in view" if self._way.sign > 0.0 else "flight in view behind"
        return f"{view}, heading {self._estimate.heading_rad / DEG:+.1f}°"

    def found_nothing(self) -> str | None:
        """The search to both sides has ended without a flight, or the landing without another one."""
        behind = "" if self._way.sign > 0.0 else " behind"
        if self._lies_on_a_flight:
            return None
        if not self._flights_done:
            return f"no stair in view{behind}, to neither side" if self._level.has_swept() else None
        gone_m = self._way.sign * self._where.travel_m
        if gone_m <= LOOK_M and self._where.pitch_rad <= 2.0 * LEVEL_RAD:
            return None
        return f"no flight in view{behind} within {gone_m:.1f} m on the landing"

    def is_sent_back(self) -> str | None:
        """The operator has pressed "go back"."""
        return "the operator sent the chair back" if self._goes_back else None

    def is_barred_by_a_gap(self) -> str | None:
        """A step is missing before the leading pulley."""
        return self._missing(KEEPS_M)

    def is_too_narrow(self) -> str | None:
        """A wall stands where the chair, square to the flight, would pass; the hold names the remedy."""
        if self._narrow_maps < NARROW_MAPS:
            return None
        free_m, needs_m = self._free_m(), self._half_width_m
        wall, other = ("left", "right") if free_m == self._where.left_wall_m else ("right", "left")
        remedy = f"set the chair {needs_m + ASIDE_M - free_m:.2f} m further to the {other}"
        return f"the {wall} wall is {free_m:.2f} m from the chair's middle, which needs {needs_m:.2f} m: {remedy}"

    def has_an_open_side(self) -> str | None:
        """A side of the flight does not bear the chair, or was not seen to; a side that no map has measured is not checked."""
        sides: tuple[Side, Side] = ("left", "right")
        for side, other in zip(sides, sides[::-1], strict=True):
            seen_m, open_m = self._where.side_m(side)
            needs = f"the chair's middle, which needs {self._needs_m:.2f} m"
            if open_m is not None and open_m < self._needs_m:
                remedy = f"set the chair {self._needs_m - open_m:.2f} m further to the {other}, or take another way"
                return f"the flight's {side} side is open {open_m:.2f} m from {needs}: {remedy}"
            if self.enters and open_m is None and seen_m is not None and seen_m < self._needs_m:
                shown = f"was in view up to {max(seen_m, 0.0):.2f} m from" if math.isfinite(seen_m) else "was not in view from"
                return f"the flight's {side} side {shown} {needs}: start further away, or take another way"
        return None

    def must_not_enter(self) -> str | None:
        """The measured steps exceed a limit of the chair.

        Before the chair enters, the measured rise and run count as they are. Further away a stair is refused only if none that may
        be the true one can be entered, because the measurement improves on the way. Each map is judged once. At a single step the
        chair is pitched no more than with its rear on the floor, whatever run the map names.
        """
        config, where, around = self._config, self._where, self._around
        if not config.check:
            return None
        if self._judged[:2] != (where.map_count, self.enters):
            if around is not None and (self.enters or (len(around.nosings) == 1 and where.top_ends)):
                slope_rad = min(where.slope_rad, around.lies(self._pivot_m, 0.0, config.chair.tracks.pulley_radius_m)[0])
                reason = reject_reason(config.chair, config.payload_kg, where.rise_m, where.run_m, slope_rad)
            else:
                sigmas_m = (where.rise_sigma_m, where.run_sigma_m)
                reason = certain_reject_reason(config.chair, config.payload_kg, where.rise_m, where.run_m, sigmas_m)
            self._judged = (where.map_count, self.enters, reason)
        return self._judged[2]

    def is_unfit(self) -> str | None:
        """Square to the flight, and every stair that may be the measured one exceeds a limit of the chair."""
        return self.must_not_enter() if self._is_square() else None

    def is_on_a_landing_between(self) -> str | None:
        """The chair is clear of the last nosing, and another flight follows."""
        if not self._is_clear() or not self._goes_on:
            return None
        seen = "seen" if self._where.shows_another else "not yet seen"
        return f"on a landing, flight {self._flights_done + 2}{'' if self._way.sign > 0.0 else ' on the way down'} {seen}"

    @property
    def to_go_m(self) -> float | None:
        """Distance along the belts from mid-track to the last nosing of the flight [m]; None while its end is not known."""
        where = self._where
        if self._way.sign > 0.0:
            ends, ahead_m = where.top_ends, where.top_ahead_m()
        else:
            ends, ahead_m = where.bottom_ends, where.bottom_ahead_m()
        return max(self._way.sign * ahead_m, 0.0) if ends and ahead_m is not None else None

    @property
    def enters(self) -> bool:
        """Whether the chair is about to drive onto the flight: a side that was not in view does not count as wide enough."""
        return False

    # --- motions of both directions

    def over_low_edges(self, plan: MotionPlan) -> MotionPlan:
        """Return the plan, slowed down where a known low edge is under the belts or near them, and easing the chair over it."""
        front_m, tracks = self._config.chair.reach_m, self._config.chair.tracks
        near = [(ahead_m, up_m) for ahead_m, up_m in self._low_edges() if _is_within(ahead_m, front_m, self._pivot_m)]
        if not near or not plan.speed_m_s:  # a chair that stands stows its flipper
            return plan
        plan = replace(plan, speed_m_s=min(max(plan.speed_m_s, -SLOW_M_S), SLOW_M_S))
        if plan.phase in ("search", "mount") or (plan.phase == "approach" and plan.speed_m_s > 0.0):
            plan = replace(plan, pitch_feedforward_m_s=self._pitch_feedforward())
        under = [(ahead_m, up_m) for ahead_m, up_m in near if _is_within(ahead_m, self._pivot_m, 0.0)]
        # The chair must be off the flight now, and as its weight passes the edge.
        moves_m = (0.0, *(max(ahead_m, 0.0) for ahead_m, _ in under))
        places_m = [nosing_m - moved_m for nosing_m in self._where.ahead_m() for moved_m in moves_m]
        if not under or plan.phase == "edge" or any(-self._pivot_m < place_m < front_m for place_m in places_m):
            return plan
        # As the weight passes the edge with the rear on lower ground, the tip stands on that ground too: the chair does not fall.
        self._flipper_planner.forget()
        below_m = max(up_m for _, up_m in under) * (2.0 + tracks.approach_m / self._pivot_m)
        return replace(plan, flipper=self._flipper_planner.to(self.t_s, -math.asin(min(below_m / tracks.approach_m, 1.0))))

    def _low_edges(self) -> list[tuple[float, float]]:
        """Return distance ahead of mid-track and height of the known low edges [m]; those of an earlier flight stay known."""
        where, is_up = self._where, self._way.sign > 0.0
        flight = self._flights_done if is_up else (self._config.flights or 1) - 1 - self._flights_done
        ends = {"foot": (where.first_ahead_m(), -1.0), "top": (where.top_ahead_m(), 1.0)}
        for edge in self._config.low_edges:
            end_m, sign = ends[edge.end]
            if edge.flight == flight and end_m is not None:
                self._edges_m[edge] = where.travel_m + end_m + sign * edge.out_m
        return [(at_m - where.travel_m, edge.height_m) for edge, at_m in self._edges_m.items()]

    @property
    def still(self) -> MotionPlan:
        """Plan of this tick that stops the belts."""
        return MotionPlan(t_s=self.t_s, phase=self.phase, speed_m_s=0.0, turn_m_s=0.0, cause=self.cause)

    def driving(self, speed_m_s: float, turn_m_s: float | None, flipper: FlipperCommand | None = None) -> MotionPlan:
        """Return the plan of this tick that drives off the flight, where no stair need be in view."""
        return replace(self.still, speed_m_s=speed_m_s, turn_m_s=turn_m_s, flipper=flipper, needs_stair=False)

    def look(self) -> MotionPlan:
        """Looks for a flight: lays the flipper on a flight, drives on over a landing, turns to both sides on the floor."""
        if self._lies_on_a_flight:
            ready = self._estimate is not None and self._where.map_count
            return replace(self.still, flipper=self._lie()) if ready else self.still
        if self._flights_done:
            return self.driving(self._way.sign * SLOW_M_S, self._level.keep(self._estimate))
        turned, self._turned_rad = self._turned_rad, 0.0
        return self.driving(0.0, self._level.sweep(self.t_s, turned))

    def turn_square(self) -> MotionPlan:
        """Turns on the spot until it is square to the flight."""
        return self.still if self._estimate is None else replace(self.still, turn_m_s=self._level.towards(self._estimate))

    def stand(self) -> MotionPlan:
        """Stands for good."""
        return self.driving(0.0, 0.0)

    # --- what both directions conclude

    @property
    def _lies_on_a_flight(self) -> bool:
        return self._where.pitch_rad > ON_A_FLIGHT_RAD

    def _free_m(self) -> float:
        """Return the distance from the chair's middle to the nearer wall [m]; infinite without a wall in view."""
        return min((wall for wall in (self._where.left_wall_m, self._where.right_wall_m) if wall is not None), default=math.inf)

    def _missing(self, within_m: float) -> str | None:
        """Return the missing step within ``within_m`` of the leading pulley, as a reason to stop; None if there is none."""
        sign, pivot_m = self._way.sign, self._pivot_m
        sides = [(sign * low - pivot_m, sign * high - pivot_m) for low, high in self._where.gaps_ahead_m()]
        gap = min(((min(pair), max(pair)) for pair in sides if max(pair) > 0.0), default=None)
        if gap is None or gap[0] > within_m:
            return None
        (near_m, far_m), leading = gap, "front" if sign > 0.0 else "rear"
        return f"a step is missing: {far_m - near_m:.2f} m from nosing to nosing, the first {beside(near_m)} the {leading} pulley"

    def _is_clear(self) -> bool:
        """Return whether the chair has left the flight; each direction says when."""
        raise NotImplementedError

    def _is_square(self) -> bool:
        return self._estimate is not None and self._level.is_square(self._estimate, self.t_s)

    @property
    def _goes_on(self) -> bool:
        """Whether another flight follows the landing."""
        flights = self._config.flights
        return self._where.shows_another if flights is None else self._flights_done + 1 < flights

    def face_next_flight(self) -> None:
        """Begin with the flight across the landing."""
        self._edges_m = {edge: at_m - self._where.travel_m for edge, at_m in self._edges_m.items()}
        self.face_flight()
        self._flights_done += 1

    @property
    def _flipper(self) -> FlipperReading | None:
        return self._flipper_planner.reading

    @property
    def _step_m(self) -> float:
        """Distance from nosing to nosing [m]; 0 while no stair is known."""
        return math.hypot(self._where.rise_m, self._where.run_m)

    @property
    def _stepping_rad(self) -> float:
        """Flipper angle at which the tip clears a step [rad]."""
        return self._flipper_planner.clears(self._where.rise_m)

    # --- on the flight

    def _lie(self, square_rad: float = 0.0) -> FlipperCommand | None:
        """Return the flipper command on the flight: riding on the nosings while the chair is square, lifted above them to turn."""
        return self._flipper_planner.ride(self.t_s, self._step_m, self._turning_share(square_rad), self._lies_rad())

    def _lies_rad(self) -> float:
        """Return the flipper's angle to the belts on the nosings ahead [rad].

        Downhill they reach it from the belts. There it raises the front by the angle by which the chair would else fall onto its
        rear.
        """
        if self._around is None:
            return 0.0
        if self._way.sign > 0.0:
            return self._around.flipper_rad(self._pivot_m, self._config.chair.tracks.approach_m)
        return -self._around.falls_rad(plumb(self._loading, self._where.pitch_rad))

    def _pitch_feedforward(self, square_rad: float = 0.0, *, allowed: bool = True) -> float:
        """Return the tip-over feed-forward [m/s]; no speed is added while the chair turns."""
        follows = allowed and self._turning_share(square_rad) < 1.0
        return self._tip_over.step(self.t_s, allowed=follows)

    def _turning_share(self, square_rad: float) -> float:
        return 1.0 if self._estimate is None else turning_share(self._estimate.heading_rad - square_rad)

    def is_laid(self) -> str | None:
        """The chair lies on a flight that is in view, its flipper laid or late; a held chair cannot move its flipper."""
        held = self._tracks is not None and self._tracks.brake_on
        if not self._lies_on_a_flight or self._estimate is None or not self._where.map_count or held:
            return None
        if not self._flipper_planner.is_laid(self.t_s, self._step_m, turning_share(self._estimate.heading_rad)):
            return None
        flipper = "" if self._flipper is None else f", flipper {self._flipper.angle_rad / DEG:+.0f}° off the belts"
        return f"on a flight, pitched by {self._where.pitch_rad / DEG:.1f}°{flipper}, the stair in view"

    def _steering(self, square_rad: float = 0.0, *, blind: bool = False) -> float | None:
        """Return the turn on the flight: None for the heading controller to steer, 0 while steering is suspended.

        Args:
            square_rad: Heading set point.
            blind: Whether no stair need be in view. A chair that is square is not steered then. Without a map it is not steered in
                the dead zone: belts that follow a drifting gyro turn it where there is more friction than the traction test has
                shown, and turn nothing where there is not, which the guard cannot distinguish.
        """
        slides = self._way.sign > 0.0  # uphill, belts that slip grip again at equal speeds
        slip_m_s = self._where.slip_m_s(self.t_s) if slides else 0.0
        roll_back_m = (self._where.roll_back_m(self.t_s) or 0.0) if slides else 0.0
        spare_rad = SQUARE_RAD if blind else 0.0
        if self.t_s - self._where.map_s > SLIP_VALID_S:
            spare_rad = self._dead_zone_rad
        spared = self._estimate is not None and abs(self._estimate.heading_rad - square_rad) < spare_rad
        steers = self._skid.steering_allowed(self.t_s, self._tracks, self._estimate, square_rad, slip_m_s, roll_back_m)
        return None if steers and not spared else 0.0
