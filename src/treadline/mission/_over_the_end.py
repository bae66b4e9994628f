"""States over the ends of a flight: approach, crest and land, edge, leave, arrived; the follower that they command.

``Situation -> Crossing``, ``-> observation that ends the state``, ``-> MotionPlan``.
"""

import math
from dataclasses import replace

from treadline.control.flipper import LIES_RAD, OFF_RAD, SLOW_M_S
from treadline.core.angles import DEG
from treadline.core.signals import MotionPlan
from treadline.core.step_sizes import GAP_SEEN_M
from treadline.mission._before_the_flight import go_at_the_stair
from treadline.mission._flipper_planner import rest_rad, turn_to
from treadline.mission._motions import Motions, driving
from treadline.mission._on_the_flight import way_out
from treadline.mission._situation import ENTER_FROM_M, KEEPS_M, LEVEL_RAD, Crossing, Situation, on_the_tip
from treadline.mission.follow import CLEARS_M, FollowCommand, Follower, Place, Terrain, terrain_of
from treadline.vehicle.loading import plumb
from treadline.vehicle.way import FLIPPER_RAD_S

CREST_SPARE_RAD = 1.7 * DEG
"""Heading error that is not corrected over the ends of a flight [rad]. Only the gyro measures the heading there. A gyro drift of
1 °/s for six seconds caused a heading error of 5.0° with this dead band and 6.3° without; with a sound gyro the error was at most
2.9° with and 2.1° without (28 and 30°, six runs, at twice the present gain)."""
STILL_RAD_S = FLIPPER_RAD_S / 16.0
"""Flipper rate above which its tip slides [rad/s]: a sixteenth of that by which ways are timed, 8 mm/s at the wheelchair's tip. Not
varied yet."""
FOLLOWS = ("approach", "mount", "climb", "crest", "land", "edge", "descend", "leave")
"""States in which the follower commands the chair near the ends of a flight."""


class Crosser:
    """The follower over one flight's ends, and the reasons not to go on over its edge."""

    def __init__(self) -> None:
        self._follower: Follower | None = None

    def step(self, now: Situation) -> Situation:
        """Step the follower, and return the situation with its course."""
        crossing = replace(now.crossing, command=None)
        if now.phase not in FOLLOWS or None in (now.around, now.imu, now.flipper, now.tracks):
            return replace(now, crossing=crossing)
        follower = self._follower = self._follower or Follower(now.loading, now.way.sign)
        if now.phase in ("approach", "edge") and not now.is_up:
            crossing = _checked(now, crossing)
            if crossing.gap is not None and now.phase == "approach":
                return replace(now, crossing=crossing)
            if crossing.turned_back_for:
                follower.turn_back()
        terrain = _terrain(now)
        if terrain is not None and now.imu and now.flipper and now.tracks:
            crossing = replace(crossing, command=follower.step(now.imu, now.flipper, now.tracks, terrain))
        return replace(now, crossing=crossing)


def _checked(now: Situation, crossing: Crossing) -> Crossing:
    """Return the course with the reasons not to go on over the edge."""
    if now.around is None:
        return crossing
    # The flight must be complete over the length of the chair on it, and the stopping distance.
    whole_to_m = now.bears_m + KEEPS_M - now.around.top.ahead_m
    # On the approach a gap further away does not count: there a detector may miss a single nosing.
    checked_to_m = min(whole_to_m, GAP_SEEN_M - now.step_m) if now.phase == "approach" else whole_to_m
    gap = now.missing(checked_to_m - now.pivot_m)
    against = gap or ("the operator sent the chair back" if now.goes_back else None)
    if against is None and _shows_too_little(now, whole_to_m):
        against = "no more of the flight is in view than the chair needs to lie on, nor its end"
    # Beyond the edge the flipper cannot set the chair back on the landing any more.
    bears = now.phase == "edge" and plumb(now.loading, now.stair.pitch_rad) > now.around.top.ahead_m
    turned_back_for = crossing.turned_back_for or (against if against is not None and bears else "")
    return replace(crossing, gap=gap, turned_back_for=turned_back_for)


def _terrain(now: Situation) -> Terrain | None:
    """Return the ground of a chair that follows a way; None without nosings, or where a missing step is in the way."""
    stair, around = now.stair, now.around
    if around is None or (now.is_up and now.phase == "climb" and now.missing(math.inf) is not None):
        return None
    # Earlier frames would have shown a nosing beyond the one that the front pulley reaches.
    is_last = stair.top_ends or around.top.ahead_m - now.pivot_m < ENTER_FROM_M
    ends = (now.has_entered, is_last) if now.is_up else (stair.bottom_ends, now.has_entered)
    sills = {sill.end: sill.outline for sill in now.sills}
    return terrain_of(around, stair.x_m, ends, foot=sills.get("foot", ()), top=sills.get("top", ()))


def _shows_too_little(now: Situation, whole_to_m: float) -> bool:
    """Return whether the chair is lifted although maps have shown too little of the flight below."""
    bottom = now.stair.bottom_ahead_m()
    lifted = now.stair.pitch_rad > now.stair.slope_rad - LEVEL_RAD
    return lifted and not now.stair.bottom_ends and (bottom is None or -bottom < whole_to_m)


# --- behaviour


def approach(now: Situation, motions: Motions) -> MotionPlan:
    """Drives at the first step, or backs to the edge."""
    return go_at_the_stair(now, motions) if now.is_up else go_over(now, motions)


def go_over(now: Situation, motions: Motions) -> MotionPlan:
    """Follows the way over the end of the flight; only large heading errors are corrected there."""
    command = now.crossing.command
    if command is None:
        return now.still
    spare_rad = 0.0 if now.phase == "approach" else CREST_SPARE_RAD
    turn = motions.level.keep(now.estimate, spare_rad=spare_rad) if _drives(command) else 0.0
    decaying_m_s = motions.pitch_feedforward(now, allowed=False)  # the way is the one controller of the pitch there
    return driving(now, command.speed_m_s + decaying_m_s, turn, command.flipper)


def _drives(command: FollowCommand) -> bool:
    """Return whether belts or flipper move: a chair that waits is not turned on the spot over a nosing.

    A chair whose tip slides along the landing is pushed at the tip and held at the nosing, by one belt once it is not square: it
    turns away from square faster than friction brakes it, also while its belts stand.
    """
    return abs(command.speed_m_s) > 0.5 * SLOW_M_S or abs(command.flipper.rate_rad_s) > STILL_RAD_S


# --- over the crest


def reaches_down(now: Situation) -> str | None:
    """The belts are about to pass the landing's edge."""
    seen = "end of the flight, " + ("seen" if now.stair.top_ends else "no nosing seen beyond")
    command = _at(now, "top", "past")
    return None if command is None else f"{_with_load(now, seen)}; {command.way}"


def rides_again(now: Situation) -> str | None:
    """A further nosing has come into view."""
    return None if _at(now, "ride", "foot") is None else "a further nosing has come into view"


def is_barred(now: Situation) -> str | None:
    """The flipper does not follow, or the chair not its way; each re-arm allows another try."""
    command, barred = now.crossing.command, _barred(now)
    if command is None or not barred or not (now.is_up and now.is_on_a_flight):
        return barred or None
    return f"{barred}; {way_out(now, slips=command.slips)}"


def turns_back(now: Situation) -> str | None:
    """The belts slip on the last nosing, over which the chair has not tipped, and the foot is known."""
    command, has_tipped = now.crossing.command, now.stair.pitch_rad < now.stair.slope_rad - OFF_RAD
    if command is None or not command.slips or has_tipped or not now.has_entered:
        return None
    return f"{command.barred}: the chair goes back down; have the last step dried, or take another way"


def lands(now: Situation) -> str | None:
    """The front has come down on the landing."""
    is_down = now.around is not None and now.around.top.ahead_m < 0.0 and now.stair.pitch_rad < LIES_RAD
    is_there = _at(now, "past") is not None or (is_down and _at(now, "top") is not None)
    return _with_load(now, "the front has come down on the landing") if is_there else None


def _barred(now: Situation) -> str:
    return "" if now.crossing.command is None else now.crossing.command.barred


def _with_load(now: Situation, seen: str) -> str:
    load_n = 0.0 if now.crossing.command is None else now.crossing.command.tip_n
    return f"{seen}; pitch {now.stair.pitch_rad / DEG:.1f}°, {on_the_tip(load_n)}"


def _at(now: Situation, *places: Place) -> FollowCommand | None:
    """Return the command of the follower if the chair is at one of these places."""
    command = now.crossing.command
    return command if command is not None and command.place in places else None


# --- over the edge


def lacks_a_step(now: Situation) -> str | None:
    """A step is missing below the edge, where the chair would lie, and it cannot be set back on the landing."""
    return None if now.crossing.turned_back_for else now.crossing.gap


def presses(now: Situation) -> str | None:
    """The flipper is about to press on the landing."""
    command = _at(now, "top")
    return None if command is None or not now.enters else f"the edge is near: {command.way}"


def lies_on_the_flight(now: Situation) -> str | None:
    """The belts lie on the flight; the tip is still over the landing or on it."""
    is_there = not now.crossing.turned_back_for and now.around is not None and now.around.top.ahead_m > now.pivot_m + CLEARS_M
    return f"the belts lie on the flight, pitch {now.stair.pitch_rad / DEG:.1f}°" if is_there else None


def is_not_let_down(now: Situation) -> str | None:
    """The chair could not be let down; a chair that is set back on the landing stows its flipper first."""
    pitch, is_off = now.stair.pitch_rad, _at(now, "before") is not None
    why = now.crossing.turned_back_for or _barred(now)
    if not why or not (is_off or _barred(now)):
        return None
    return f"{why}; it " + ("stands on the landing again" if abs(pitch) < LEVEL_RAD else f"stands at {pitch / DEG:.0f}°")


# --- away from the flight


def leave(now: Situation, motions: Motions) -> MotionPlan:
    """Follows the way off the last nosings."""
    command = _at(now, "foot", "top")
    if command is None:
        return driving(now, -SLOW_M_S, motions.level.keep(now.estimate))
    turn = motions.level.keep(now.estimate, spare_rad=CREST_SPARE_RAD) if _drives(command) else 0.0
    return driving(now, command.speed_m_s, turn, command.flipper)


def is_on_a_landing_between(now: Situation) -> str | None:
    """The chair is clear of the last nosing, and another flight follows."""
    flights, is_seen = now.config.flights, now.stair.shows_another
    goes_on = is_seen if flights is None else now.flights_done + 1 < flights
    if not is_clear(now) or not goes_on:
        return None
    down, seen = "" if now.is_up else " on the way down", "seen" if is_seen else "not yet seen"
    return f"on a landing, flight {now.flights_done + 2}{down} {seen}"


def has_arrived(now: Situation) -> str | None:
    """The chair is clear of the last nosing: level, or on the landing further on."""
    if not is_clear(now):
        return None
    place, nosing = ("landing", "last") if now.is_up else ("floor", "first")
    return f"on the {place}, pitch {now.stair.pitch_rad / DEG:.1f}°, clear of the {nosing} nosing"


def is_clear(now: Situation) -> bool:
    """Return whether the chair is clear of the last nosing."""
    is_level = abs(now.stair.pitch_rad) < LEVEL_RAD
    if now.is_up:
        return _at(now, "past") is not None and (is_level or now.gone_m > now.bears_m + KEEPS_M)
    return is_level and now.is_off


def stand(now: Situation, _: Motions) -> MotionPlan:
    """Stands for good; after a descent it stows the flipper."""
    stows = now.phase == "arrived" and not now.is_up
    return driving(now, 0.0, 0.0, turn_to(now, rest_rad(now)) if stows else None)
