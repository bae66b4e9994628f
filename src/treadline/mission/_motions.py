"""Motions of a traversal that need memory: steering, tip-over feed-forward, traction test, known low edges.

``Situation -> MotionPlan``.
``Motions.watch`` adds to a situation what these have found at its tick.
"""

import math
from dataclasses import replace

from treadline.control.flipper import SLOW_M_S
from treadline.core.angles import DEG
from treadline.core.signals import FlipperCommand, ImuSample, MotionPlan, TrackReading
from treadline.core.step_sizes import SINGLE_RISE_M
from treadline.estimation.stair_tracker import SLIP_VALID_S, Side
from treadline.mission._flat_ground_steering import SQUARE_RAD, LevelSteering
from treadline.mission._flipper_planner import Deadline, awaited_rad, turn_to, turning_share
from treadline.mission._situation import ASIDE_M, ENTER_FROM_M, KEEPS_M, Situation
from treadline.mission._skid_monitor import SkidMonitor
from treadline.mission._tip_over import TipOverFeedforward
from treadline.mission._traction_test import TractionTest
from treadline.mission.mission_config import KnownSill, MissionConfig
from treadline.mission.planner import PlannerInput
from treadline.vehicle.traction import NORMAL_SLIP, dead_zone_rad

ASIDE_RAD_M, ASIDE_RAD = 10.0 * DEG, 2.0 * DEG
"""Heading set point per metre of missing distance to a side [rad/m], and the largest such set point [rad]."""


class Motions:
    """Devices with memory that the behaviours of the states use.

    Args:
        config: Mission, of which chair, payload and known low edges count.
    """

    def __init__(self, config: MissionConfig) -> None:
        self._gauge_m = config.chair.tracks.gauge_m
        self._dead_zone_rad = dead_zone_rad(config.chair, config.payload_kg)
        self._imu_s: float | None = None
        self._turned_rad = 0.0
        self._sills_m: dict[KnownSill, float] = {}
        """Belt travel at which mid-track is at the end of the flight next to each known sill [m]."""
        self.tip_over = TipOverFeedforward()
        self.deadline = Deadline()
        self.traction: TractionTest | None = None
        self.face_flight(0.0)

    def face_flight(self, travel_m: float) -> None:
        """Begin with a flight; low edges of earlier flights stay known.

        Args:
            travel_m: Belt travel on the flight before, which the tracker of this one does not count.
        """
        self._sills_m = {sill: at_m - travel_m for sill, at_m in self._sills_m.items()}
        self.level = LevelSteering(self._gauge_m)
        self._skid = SkidMonitor()
        self.deadline.forget()

    def update(self, signal: PlannerInput) -> None:
        """Update with one signal."""
        if isinstance(signal, ImuSample):
            self._turned_rad += (0.0 if self._imu_s is None else signal.t_s - self._imu_s) * signal.angular_velocity_rad_s[2]
            self._imu_s = signal.t_s
            self.tip_over.update(signal)
        if isinstance(signal, TrackReading) and signal.brake_on:  # held: belts and flipper do not follow commands
            self.level.rest()
            self.deadline.forget()
        if self.traction is not None and isinstance(signal, ImuSample | TrackReading):
            self.traction.update(signal)

    def watch(self, now: Situation) -> Situation:
        """Return the situation with what steering, traction test and flipper have found; call once as a state acts or begins."""
        if now.phase != "traction":
            self.traction = None
        if now.phase == "align":  # on the approach the flipper begins anew
            self.deadline.forget()
        climbs = now.phase == "climb" and now.has_entered and now.is_up and now.missing(KEEPS_M) is None
        is_square = (climbs or now.phase == "align") and now.estimate is not None and self.level.is_square(now.estimate, now.t_s)
        if climbs and is_square and (now.crossing.command is None or now.crossing.command.place == "ride"):
            slips = now.stair.slip_m_s(now.t_s) > NORMAL_SLIP * now.config.climb_speed_m_s
            now = replace(now, presses=True) if slips else now
        looks = now.phase == "search" and not now.is_on_a_flight and not now.flights_done
        has_swept = looks and self.level.has_swept()
        awaited = awaited_rad(now)
        is_late = awaited is not None and self.deadline.is_over(now.t_s, awaited)
        return replace(now, is_square=is_square, has_swept=has_swept, traction=self.traction, awaited_rad=awaited, is_late=is_late)

    def sweep(self, now: Situation) -> float:
        """Return the turn of the search to both sides [m/s]."""
        turned, self._turned_rad = self._turned_rad, 0.0
        return self.level.sweep(now.t_s, turned)

    def pitch_feedforward(self, now: Situation, square_rad: float = 0.0, *, allowed: bool = True) -> float:
        """Return the tip-over feed-forward [m/s]; no speed is added while the chair turns."""
        return self.tip_over.step(now.t_s, allowed=allowed and turning_share(now, square_rad) < 1.0)

    def steering(self, now: Situation, square_rad: float = 0.0, *, blind: bool = False) -> float | None:
        """Return the turn on the flight: None for the heading controller to steer, 0 while steering is suspended.

        Args:
            now: Situation.
            square_rad: Heading set point.
            blind: Whether no stair need be in view. A chair that is square is not steered then. Without a map it is not steered in
                the dead zone: belts that follow a drifting gyro turn it where there is more friction than the traction test has
                shown, and turn nothing where there is not, which the guard cannot distinguish.
        """
        stair, estimate = now.stair, now.estimate
        # Uphill, belts that slip grip again at equal speeds.
        slip_m_s = stair.slip_m_s(now.t_s) if now.is_up else 0.0
        roll_back_m = (stair.roll_back_m(now.t_s) or 0.0) if now.is_up else 0.0
        spare_rad = SQUARE_RAD if blind else 0.0
        if now.t_s - stair.map_s > SLIP_VALID_S:
            spare_rad = self._dead_zone_rad
        spared = estimate is not None and abs(estimate.heading_rad - square_rad) < spare_rad
        steers = self._skid.steering_allowed(now.t_s, now.tracks, estimate, square_rad, slip_m_s, roll_back_m)
        return None if steers and not spared else 0.0

    def over_low_edges(self, now: Situation, plan: MotionPlan) -> MotionPlan:
        """Return the plan, slowed down where a known low edge is under the belts or near them, and easing the chair over it."""
        front_m, pivot_m, tracks = now.config.chair.reach_m, now.pivot_m, now.config.chair.tracks
        near = [(ahead_m, up_m) for ahead_m, up_m in self._low_edges(now) if _is_within(ahead_m, front_m, pivot_m)]
        if not near or not plan.speed_m_s:  # a chair that stands stows its flipper
            return plan
        plan = replace(plan, speed_m_s=min(max(plan.speed_m_s, -SLOW_M_S), SLOW_M_S))
        if plan.phase in ("search", "mount") or (plan.phase == "approach" and plan.speed_m_s > 0.0):
            plan = replace(plan, pitch_feedforward_m_s=self.pitch_feedforward(now))
        under = [(ahead_m, up_m) for ahead_m, up_m in near if _is_within(ahead_m, pivot_m, 0.0)]
        # The chair must be off the flight now, and as its weight passes the edge.
        moves_m = (0.0, *(max(ahead_m, 0.0) for ahead_m, _ in under))
        places_m = [nosing_m - moved_m for nosing_m in now.stair.ahead_m() for moved_m in moves_m]
        follows = now.crossing.command is not None and now.crossing.command.leads
        if not under or follows or any(-pivot_m < place_m < front_m for place_m in places_m):
            return plan
        # As the weight passes the edge with the rear on lower ground, the tip stands on that ground too: the chair does not fall.
        self.deadline.forget()
        below_m = max(up_m for _, up_m in under) * (2.0 + tracks.approach_m / pivot_m)
        return replace(plan, flipper=turn_to(now, -math.asin(min(below_m / tracks.approach_m, 1.0))))

    def _low_edges(self, now: Situation) -> list[tuple[float, float]]:
        """Return distance ahead of mid-track and height of the known low edges [m]; those of an earlier flight stay known."""
        stair = now.stair
        for sill in now.sills:
            end_m = stair.first_ahead_m() if sill.end == "foot" else stair.top_ahead_m()
            if end_m is not None:
                self._sills_m[sill] = stair.travel_m + end_m
        edges: list[tuple[float, float]] = []
        for sill, at_m in self._sills_m.items():
            sign, highest_m = (-1.0 if sill.end == "foot" else 1.0), max(abs(z_m) for _, z_m in sill.outline)
            places_m = {at_m - stair.travel_m + sign * out_m for out_m, _ in sill.outline}
            edges += [(ahead_m, min(highest_m, SINGLE_RISE_M[0])) for ahead_m in sorted(places_m)]
        return edges


def _is_within(ahead_m: float, front_m: float, rear_m: float) -> bool:
    """Return whether a place is between two places on the chair, or nearly so."""
    return -rear_m - ENTER_FROM_M < ahead_m < front_m + ENTER_FROM_M


def driving(now: Situation, speed_m_s: float, turn_m_s: float | None, flipper: FlipperCommand | None = None) -> MotionPlan:
    """Return the plan of a tick that drives off the flight, where no stair need be in view."""
    return replace(now.still, speed_m_s=speed_m_s, turn_m_s=turn_m_s, flipper=flipper, needs_stair=False)


def aside_rad(now: Situation) -> float:
    """Return the heading set point away from a near side, or towards the middle between two: walls or drops [rad]."""
    clear_m = now.needs_m + ASIDE_M
    left, right = bound_m(now, "left"), bound_m(now, "right")
    if left is not None and right is not None:
        lacking = 0.5 * (right - left)
    elif left is not None:
        lacking = max(clear_m - left, 0.0)
    else:
        lacking = 0.0 if right is None else -max(clear_m - right, 0.0)
    # A negative heading leads to the right, away from a wall on the left.
    return -min(max(ASIDE_RAD_M * lacking, -ASIDE_RAD), ASIDE_RAD)


def bound_m(now: Situation, side: Side) -> float | None:
    """Return the distance from the chair's middle to the wall or the drop on a side [m]; None without one in view."""
    wall = now.stair.left_wall_m if side == "left" else now.stair.right_wall_m
    return min((bound for bound in (wall, now.stair.side_m(side)[1]) if bound is not None), default=None)
