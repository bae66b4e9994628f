"""States before a flight: search, align, approach, mount. ``Situation -> observation that ends the state``, ``-> MotionPlan``."""

import math
from dataclasses import replace

from treadline.control.flipper import OFF_RAD, PATIENCE_S, SLOW_M_S
from treadline.core.angles import DEG
from treadline.core.signals import MotionPlan
from treadline.estimation.stair_tracker import Side
from treadline.mission._flipper_planner import ride
from treadline.mission._motions import Motions, aside_rad, driving
from treadline.mission._situation import ASIDE_M, KEEPS_M, LEVEL_RAD, Situation
from treadline.mission.follow import PLACE_SIGMA_M

LOOK_M = 2.5
"""Travel over a landing to find the next flight [m]: from further away only its first step is in view, or its edge hides it."""


# --- search


def look(now: Situation, motions: Motions) -> MotionPlan:
    """Looks for a flight: lays the flipper on a flight, drives on over a landing until one is in view, turns aside on the floor."""
    if now.is_on_a_flight:
        return replace(now.still, flipper=ride(now)) if now.estimate is not None and now.stair.map_count else now.still
    if now.flights_done:
        sees = now.stair.map_count and now.estimate is not None and now.estimate.source == "vision"
        return now.still if sees else driving(now, now.way.sign * SLOW_M_S, motions.level.keep(now.estimate))
    return driving(now, 0.0, motions.sweep(now))


def starts_on_the_flight(now: Situation) -> str | None:
    """The chair lies on a flight that is in view, its flipper laid or late; a held chair cannot move its flipper."""
    if now.waits:
        return None
    flipper = "" if now.flipper is None else f", flipper {now.flipper.angle_rad / DEG:+.0f}° off the belts"
    return f"on a flight, pitched by {now.stair.pitch_rad / DEG:.1f}°{flipper}, the stair in view"


def sees_the_stair(now: Situation) -> str | None:
    """More than one frame shows the flight, and the heading is known."""
    if now.estimate is None or not now.stair.known or now.is_on_a_flight:
        return None
    view = "stair in view" if now.is_up else "flight in view behind"
    return f"{view}, heading {now.estimate.heading_rad / DEG:+.1f}°"


def found_nothing(now: Situation) -> str | None:
    """The search to both sides has ended without a flight, or the landing without another one."""
    behind = "" if now.is_up else " behind"
    if now.is_on_a_flight:
        return None
    if not now.flights_done:
        return f"no stair in view{behind}, to neither side" if now.has_swept else None
    gone_m = now.way.sign * now.stair.travel_m
    if gone_m <= LOOK_M and now.stair.pitch_rad <= 2.0 * LEVEL_RAD:
        return None
    return f"no flight in view{behind} within {gone_m:.1f} m on the landing"


# --- align


def turn_square(now: Situation, motions: Motions) -> MotionPlan:
    """Turns on the spot until it is square to the flight."""
    return now.still if now.estimate is None else replace(now.still, turn_m_s=motions.level.towards(now.estimate))


def is_unfit(now: Situation) -> str | None:
    """Square to the flight, and every stair that may be the measured one exceeds a limit of the chair."""
    return now.refusal if now.is_square else None


def is_past_the_edge(now: Situation) -> str | None:
    """Square to the flight, and its edge is not behind the chair."""
    edge = now.stair.top_ahead_m()
    is_past = now.is_square and (edge is None or edge > -now.config.chair.rear_m)
    return "square to the flight, and its edge is not behind the chair" if is_past else None


def hides_the_edge(now: Situation) -> str | None:
    """Square to the flight, and its edge is hidden under the camera: the highest nosing in view is below the belts."""
    stair = now.stair
    top, below_m = stair.top_ahead_m(), -(stair.top_above_m() or 0.0)
    if not now.is_square or top is None or below_m <= 0.5 * stair.rise_m:
        return None
    edge_m = -top - round(below_m / stair.rise_m) * stair.run_m
    camera = now.config.chair.camera_at(rear=True)
    lowest_rad = camera.mount_pitch_rad + math.atan((camera.height_px - 1 - camera.cy_px) / camera.fy_px)
    shown_m = abs(camera.mount_m[0]) + camera.mount_m[2] / math.tan(lowest_rad)
    there = f"the edge is hidden under the camera, about {edge_m - now.pivot_m:.2f} m behind the belts"
    return f"{there}; set the chair {max(shown_m - edge_m, 0.0) + ASIDE_M:.2f} m further from it"


def is_square(now: Situation) -> str | None:
    """Square to the flight for half a second; going down, its edge behind the chair."""
    stair, edge = now.stair, now.stair.top_ahead_m()
    if not now.is_square or now.estimate is None:
        return None
    within = f"within {abs(now.estimate.heading_rad) / DEG:.1f}°"
    if now.is_up:
        return f"square to the stair {within}; rise {stair.rise_m:.3f} m, run {stair.run_m:.3f} m, {stair.slope_rad / DEG:.1f}°"
    return None if edge is None else f"square {within}; edge {-edge - now.config.chair.rear_m:.2f} m behind"


# --- approach and mount


def go_at_the_stair(now: Situation, motions: Motions) -> MotionPlan:
    """Drives at the first step, slower near it, and follows the way onto it."""
    command, turn = now.crossing.command, motions.level.keep(now.estimate, aside_rad(now))
    if command is not None and command.leads:
        return replace(now.still, speed_m_s=command.speed_m_s, turn_m_s=turn, flipper=command.flipper)
    nose_m = now.config.chair.reach_m - now.pivot_m  # the flipper meets the nosing before the pulley
    speed = SLOW_M_S if now.before_m < nose_m else now.config.climb_speed_m_s
    return replace(now.still, speed_m_s=speed, turn_m_s=turn)


def is_sent_back(now: Situation) -> str | None:
    """The operator has pressed "go back", and the chair came onto the flight from its end."""
    return "the operator sent the chair back" if now.goes_back and now.has_entered else None


def is_barred_by_a_gap(now: Situation) -> str | None:
    """A step is missing before the leading pulley, or the stair turns on winders."""
    return now.missing(KEEPS_M) or now.turns(KEEPS_M)


def is_too_narrow(now: Situation) -> str | None:
    """A wall stands where the chair, square to the flight, would pass; the hold names the remedy."""
    if not now.is_narrow:
        return None
    free_m, needs_m = now.free_m, now.config.chair.half_width_m
    wall, other = ("left", "right") if free_m == now.stair.left_wall_m else ("right", "left")
    remedy = f"set the chair {needs_m + ASIDE_M - free_m:.2f} m further to the {other}"
    return f"the {wall} wall is {free_m:.2f} m from the chair's middle, which needs {needs_m:.2f} m: {remedy}"


def has_an_open_side(now: Situation) -> str | None:
    """A side of the flight does not bear the chair, or was not seen to; a side that no map has measured is not checked."""
    sides: tuple[Side, Side] = ("left", "right")
    needs = f"the chair's middle, which needs {now.needs_m:.2f} m"
    for side, other in zip(sides, sides[::-1], strict=True):
        seen_m, open_m = now.stair.side_m(side)
        if open_m is not None and open_m < now.needs_m:
            remedy = f"set the chair {now.needs_m - open_m:.2f} m further to the {other}, or take another way"
            return f"the flight's {side} side is open {open_m:.2f} m from {needs}: {remedy}"
        if now.enters and open_m is None and seen_m is not None and seen_m < now.needs_m:
            shown = f"was in view up to {max(seen_m, 0.0):.2f} m from" if math.isfinite(seen_m) else "was not in view from"
            return f"the flight's {side} side {shown} {needs}: start further away, or take another way"
    return None


def must_not_enter(now: Situation) -> str | None:
    """The measured steps exceed a limit of the chair, or the stair turns on winders."""
    return now.refusal or now.turns(math.inf)


def reaches_the_first_step(now: Situation) -> str | None:
    """The front pulley is near the first nosing, or the chair's pitch shows that it has touched."""
    return f"first step {now.before_m:.2f} m ahead of the belts' front pulley" if now.enters else None


def gets_no_hold(now: Situation) -> str | None:
    """The belts run on the first nosings and the chair does not come further."""
    if now.stalled_s < PATIENCE_S:
        return None
    slope = now.stair.slope_rad / DEG
    return f"the belts ran {PATIENCE_S:g} s on the first nosings of a {slope:.0f}° stair without getting up"


def mounts_the_crest(now: Situation) -> str | None:
    """The front pulley stands on the last nosing before the belts lie on two: one step, or two low ones."""
    if now.around is None or not now.stair.top_ends or now.around.top.ahead_m > now.pivot_m:
        return None
    return f"the front has reached the last nosing, pitch {now.stair.pitch_rad / DEG:.1f}°"


def lies_on_two_nosings(now: Situation) -> str | None:
    """The belts lie on two nosings, the rear just off the floor."""
    around, stair = now.around, now.stair
    if around is None or len(around.nosings) < 2 or stair.pitch_rad <= stair.slope_rad - OFF_RAD:
        return None
    # Belts on two nosings lift the rear pulley here. Before, the traction test would speed up over a change of contact.
    slope, radius = stair.slope_rad, now.config.chair.tracks.pulley_radius_m
    lifts_m = around.rise_m / math.sin(slope) - radius * math.tan(0.5 * slope) - now.pivot_m
    if around.nosings[0].ahead_m >= lifts_m - PLACE_SIGMA_M:
        return None
    return f"the belts lie on two nosings, pitch {stair.pitch_rad / DEG:.1f}°"
