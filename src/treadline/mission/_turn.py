"""State over a landing between two flights: fold the flipper, turn on a planned way, unfold; the turner that it commands.

``Situation, FreeGround -> TurnCommand``, ``-> observation that ends the state``, ``-> MotionPlan``. The way is searched for the
centre of turns (``vehicle.landing_turn``), which follows it; it is searched again where the chair is off it, or, because the centre
moves, has no room.
"""

import math
from collections.abc import Iterator
from dataclasses import replace
from itertools import chain

import numpy as np
from jaxtyping import Float

from treadline.control.flipper import SLOW_M_S, THERE_RAD
from treadline.core.angles import DEG, wrap
from treadline.core.rotations import Vector3, rotation_z
from treadline.core.signals import TICK_S, FreeGround, MotionPlan
from treadline.core.step_sizes import TURN_CLEAR_M
from treadline.estimation.stair_tracker import Side
from treadline.mission._flipper_planner import rest_rad, turn_to
from treadline.mission._landing_place import LandingPlace
from treadline.mission._motions import Motions, bound_m, driving
from treadline.mission._over_the_end import is_clear
from treadline.mission._situation import Situation, TurnCommand
from treadline.mission.mission_config import KnownLandings
from treadline.vehicle.flight_plan import FlightPlan
from treadline.vehicle.landing_turn import OFF_PLAN_M, has_room, ways_over
from treadline.vehicle.landing_turn_kernels import DRIVE_M, HEADING_RAD, Outline
from treadline.vehicle.loading import plumb

TURN_RAD_S = 15.0 * DEG
"""Largest turn rate on a landing [rad/s]: below 20 °/s, which is comfortable for a passenger."""
NEXT_POSES, LEAST_S = 3, 0.33
"""Number of poses ahead on the way to which the chair drives and turns at the same time, and least time in which it would be there
[s], the time constant of its stop: twice that of the belts. Half of it overshoots by 5°, half as much again takes 4 s longer."""
AT_END_RAD = 1.0 * DEG
"""Angle from the last pose of the way at which the chair has turned [rad]: that of a chair square to a flight."""
REPLANS_S = 1.0
"""Least time between two searches [s]."""
NO_WAY = np.empty((0, 3))
SIDES: tuple[Side, Side] = ("left", "right")
AGREES_RAD = 5.0 * DEG
"""Difference of the measured heading from that on the landing within which the camera sees the next flight [rad]."""


class Turner:
    """Turn on one landing: place, way, and flipper.

    Args:
        known: Landings of the stair; None if it turns on none.
    """

    def __init__(self, known: KnownLandings | None) -> None:
        if known is not None:
            self._outline, self._width_m = known.outline, known.width_m
        self._place: LandingPlace | None = None
        self._frames: list[FreeGround] = []
        self._way: Float[np.ndarray, "n 3"] = NO_WAY
        self._at = 0
        """Pose of the way that the chair has reached."""
        self._search: Iterator[Float[np.ndarray, "n 3"] | None] | None = None
        """Search that goes on, by a portion a tick."""
        self._searched_s = -math.inf
        """Time of the latest search."""
        self._is_folded, self._barred = False, ""
        self._since_s = self._worst_m = 0.0
        """Time at which the turn began or ended, and largest distance from the way."""

    def update(self, ground: FreeGround) -> None:
        """Take the ground of one frame."""
        self._frames.append(ground)

    def step(self, now: Situation) -> Situation:
        """Return the situation with the command of a tick."""
        landing, frames, self._frames = now.landing, self._frames, []
        if now.phase != "turn" or landing is None or now.estimate is None or now.tracks is None or now.flipper is None:
            return replace(now, turn=None)
        place = self._place
        if place is None:
            place = self._place = LandingPlace(
                landing, self._width_m, pose_on(now, landing, self._width_m), plumb(now.loading, 0.0)
            )
            self._since_s = now.t_s
        speed_m_s = 0.5 * (now.tracks.left_m_s + now.tracks.right_m_s)
        place.move(now.t_s, TICK_S, speed_m_s, now.estimate.heading_rate_rad_s)
        for ground in frames:
            place.look(ground)
        return replace(now, turn=self._command(now, landing, place))

    def _command(self, now: Situation, landing: FlightPlan, place: LandingPlace) -> TurnCommand:
        """Return the command: fold, follow the way, unfold."""
        flipper, tracks = now.config.chair.flipper, now.tracks
        folded_rad = rest_rad(now) if flipper is None else flipper.range_deg[1] * DEG
        command = TurnCommand(speed_m_s=0.0, rate_rad_s=0.0, flipper_rad=folded_rad)
        if tracks is not None and tracks.brake_on:  # a person who re-arms the chair allows another try
            self._searched_s, self._search, self._way, self._barred = -math.inf, None, NO_WAY, ""
            return command
        is_there = len(self._way) > 0 and self._at == len(self._way) - 1
        if not self._barred and not is_there:
            self._barred = self._plan(now, landing, place) or ""
        if self._barred:
            return replace(command, barred=self._barred)
        self._is_folded = self._is_folded or (now.flipper is not None and now.flipper.angle_rad > folded_rad - THERE_RAD)
        if not self._is_folded or self._search is not None:  # a chair without a way stands
            return command
        if is_there:
            goal_rad = landing.turn_rad if now.is_up else 0.0
            return self._at_the_end(now, replace(command, flipper_rad=rest_rad(now)), wrap(place.centre[2] - goal_rad))
        self._advance(place.centre)
        x, y, heading = self._way[min(self._at + NEXT_POSES, len(self._way) - 1)] - place.centre
        along_m = x * math.cos(place.centre[2]) + y * math.sin(place.centre[2])
        within_s = max(abs(along_m) / SLOW_M_S, abs(heading) / TURN_RAD_S, LEAST_S)
        return replace(command, speed_m_s=along_m / within_s, rate_rad_s=heading / within_s)

    def _at_the_end(self, now: Situation, command: TurnCommand, off_rad: float) -> TurnCommand:
        """Return the command of a chair that has turned: the next flight must come into view."""
        estimate = now.estimate
        is_seen = estimate is not None and estimate.source == "vision" and abs(wrap(estimate.heading_rad - off_rad)) < AGREES_RAD
        is_rested = now.flipper is not None and abs(now.flipper.angle_rad - command.flipper_rad) < THERE_RAD
        return replace(command, is_done=is_seen and is_rested, took_s=now.t_s - self._since_s, worst_m=self._worst_m)

    def _plan(self, now: Situation, landing: FlightPlan, place: LandingPlace) -> str | None:
        """Search the way anew where the chair is off it, or what is left of it has no room; return why there is none."""
        off_m = float(np.hypot(*(self._way[:, :2] - place.centre[:2]).T).min()) if len(self._way) else math.inf
        if self._at:
            self._worst_m = max(self._worst_m, off_m)
        outline = self._outline.about(place.centre_m)
        if self._search is None and now.t_s - self._searched_s >= REPLANS_S:
            left = self._way[self._at :]
            if off_m > OFF_PLAN_M or not has_room(landing, self._width_m, outline.wider(TURN_CLEAR_M), left):
                down_m = None if now.is_up else now.config.chair.reach_m
                # With the distance by which the chair may be off its way, or else without.
                around = (outline.wider(by_m) for by_m in (TURN_CLEAR_M + OFF_PLAN_M, TURN_CLEAR_M))
                ways = (ways_over(landing, self._width_m, each, place.centre, off_m=down_m) for each in around)
                self._search = (way for way in chain.from_iterable(ways) if way is None or len(way))
        way = None if self._search is None else next(self._search, NO_WAY)
        if way is None:
            return None
        self._search, self._searched_s, self._way, self._at = None, now.t_s, way, 0
        return None if len(way) else _no_room(landing, outline)

    def _advance(self, centre: Vector3) -> None:
        """Pass the poses of the way to which the chair is not nearer than to the next one."""
        off = (self._way - centre) / (DRIVE_M, DRIVE_M, HEADING_RAD)
        apart = np.linalg.norm(off, axis=1)
        while self._at < len(apart) - 2 and apart[self._at + 1] <= apart[self._at]:
            self._at += 1
        if self._at == len(apart) - 2 and abs(off[-1, 2]) * HEADING_RAD < AT_END_RAD:
            self._at += 1


def pose_on(now: Situation, landing: FlightPlan, width_m: float) -> Vector3:
    """Return the pose in which the chair has come onto the landing, by the nosing that it has left."""
    heading, half_m = 0.0 if now.estimate is None else now.estimate.heading_rad, 0.5 * width_m
    left_m, right_m = (bound_m(now, side) for side in SIDES)
    asides_m = (None if left_m is None else half_m - left_m, None if right_m is None else right_m - half_m)
    # The landing may be wider than the flight: a bound of its own would put the chair aside of the flight that it has left.
    aside_m = min((place_m for place_m in asides_m if place_m is not None), key=abs, default=0.0)
    if now.is_up:
        return np.array([-(now.stair.top_ahead_m() or 0.0), aside_m, heading])
    place = rotation_z(landing.turn_rad)[:2, :2] @ (-(now.stair.bottom_ahead_m() or 0.0), aside_m)
    return np.array([*(landing.foot(width_m).mean(axis=0) + place), landing.turn_rad + heading])


def _no_room(landing: FlightPlan, outline: Outline) -> str:
    size = f"{landing.left_m - landing.right_m:.2f} m wide and {landing.depth_m:.2f} m deep"
    chair = f"{outline.rear_m + outline.front_m:.2f} m long"
    return f"the landing is {size}, and a chair {chair} finds no way to turn by {landing.turn_rad / DEG:.0f}° from here"


# --- behaviour and ends


def turn(now: Situation, motions: Motions) -> MotionPlan:
    """Folds the flipper, turns on its way over the landing, unfolds the flipper."""
    command = now.turn
    if command is None:
        return replace(now.still, needs_stair=False)
    return driving(now, command.speed_m_s, motions.level.turn(command.rate_rad_s), turn_to(now, command.flipper_rad))


def must_turn(now: Situation) -> str | None:
    """The chair is clear of the last nosing, and the stair turns on the landing."""
    landing = now.landing
    if landing is None or not is_clear(now):
        return None
    return f"on a landing, the stair turns by {now.way.sign * landing.turn_rad / DEG:+.0f}°"


def has_turned(now: Situation) -> str | None:
    """The chair has turned, its flipper is unfolded, and the next flight is in view."""
    command = now.turn
    if command is None or not command.is_done:
        return None
    return f"turned in {command.took_s:.1f} s, at most {100.0 * command.worst_m:.0f} cm off its plan; the next flight is in view"


def cannot_turn(now: Situation) -> str | None:
    """No way over the landing is left."""
    return None if now.turn is None else now.turn.barred or None
