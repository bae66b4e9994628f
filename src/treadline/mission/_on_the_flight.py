"""States on a flight: traction, climb, back_off, descend, and a chair that descends and turns by climbing.

``Situation -> observation that ends the state``, ``-> MotionPlan``.
"""

import math
from dataclasses import replace

from treadline.control.belt_allocation import GENTLE_M_S2, inner_speed_ratio
from treadline.control.flipper import GENTLY_RAD_S, LIES_RAD, SLOW_M_S, THERE_RAD
from treadline.core.angles import DEG
from treadline.core.signals import MotionPlan
from treadline.mission._flat_ground_steering import SQUARE_RAD
from treadline.mission._flipper_planner import PRESSES_RAD, lies_rad, ride, stepping_rad, turn_to
from treadline.mission._motions import Motions, aside_rad, driving
from treadline.mission._situation import ENTER_FROM_M, KEEPS_M, Situation, beside
from treadline.mission._traction_test import TractionTest
from treadline.vehicle.traction import friction_needed

PULSES = 2
"""Number of lost traction tests after which the chair backs off. One may be lost by chance: a belt that meets a step during the
pulse loses a quarter of its speed."""
OFF_HEADING_RAD = 4.0 * DEG
"""Heading error on the flight above which the chair turns by climbing [rad]: belts that back down and turn diverge."""


# --- traction


def try_the_traction(now: Situation, motions: Motions) -> MotionPlan:
    """Accelerates with slightly more friction demand than the flight needs; a lost pulse is made again once."""
    test = motions.traction or TractionTest(now.stair.slope_rad)
    if test.over:
        motions.traction = TractionTest(now.stair.slope_rad, test.pulse + 1)
        return now.still
    motions.traction = test
    # In line with the belts the flipper carries nothing yet, and is already near its riding angle for the first fall.
    return replace(now.still, speed_m_s=test.speed_m_s, flipper=turn_to(now, 0.0))


def holds(now: Situation) -> str | None:
    """The belts held in the traction test."""
    test = now.traction
    return f"enough friction: {_slip_of(test)}" if test is not None and test.over and test.holds else None


def slips(now: Situation) -> str | None:
    """The belts slipped in the last pulse of the traction test."""
    test = now.traction
    if test is None or not test.over or test.holds or test.pulse < PULSES:
        return None
    wanted = friction_needed(now.stair.slope_rad)
    return f"too little friction: {_slip_of(test)}, so it is below {wanted:.2f}; dry or roughen the nosings"


def _slip_of(test: TractionTest) -> str:
    return f"the belts slipped by {100.0 * max(test.slip, 0.0):.0f} % of a short test drive"


# --- up the flight, and back off it


def climb(now: Situation, motions: Motions) -> MotionPlan:
    """Climbs, steered by the heading controller; slowly before the crest. Belts that slip stop."""
    command = now.crossing.command
    if now.presses:
        return driving(now, 0.0, 0.0, turn_to(now, PRESSES_RAD))
    if command is not None and (command.leads or command.is_slow):
        speed, flipper = (command.speed_m_s, command.flipper) if command.leads else (SLOW_M_S, ride(now))
        plan = driving(now, speed, motions.steering(now, blind=True), flipper)
        allowed = command.is_unloaded or not command.leads
        return replace(plan, pitch_feedforward_m_s=motions.pitch_feedforward(now, allowed=allowed))
    aim_rad, estimate = aside_rad(now), now.estimate
    return replace(
        now.still,
        speed_m_s=now.config.climb_speed_m_s,
        turn_m_s=motions.steering(now, aim_rad),
        heading_rad=aim_rad,
        min_inner_speed_ratio=None if estimate is None else inner_speed_ratio(estimate.heading_rad - aim_rad),
        pitch_feedforward_m_s=motions.pitch_feedforward(now, aim_rad),
        flipper=ride(now, aim_rad),
    )


def loses_grip(now: Situation) -> str | None:
    """The belts slip under a square chair, which has stopped and pressed its flipper down; a re-arm goes on up.

    All tracks slip that turn: a chair that starts on the flight, at any heading, is left to the guard.
    """
    return None if now.waits else f"the belts slip on the flight; {way_out(now, slips=True)}"


def way_out(now: Situation, *, slips: bool) -> str:
    """Return what a person can do for a chair that is held on its way up, where its belts slip or for another reason."""
    back = "send the chair back down, or " if now.has_entered else ""
    return f"{back}{'have the steps dried and ' if slips else ''}re-arm it to go on up"


def answered(now: Situation) -> Situation:
    """Return the situation after the chair has been held for a "go back" that it cannot follow."""
    return replace(now, goes_back=False)


def cannot_go_back(now: Situation) -> str | None:
    """The operator has pressed "go back" where the chair cannot; a re-arm goes on."""
    if not now.goes_back:
        return None
    where, on = ("down from here", "up") if now.is_up else ("up without a view of the landing", "down")
    return f"the chair cannot go back {where}; re-arm it to go on {on}"


def back_off(now: Situation, motions: Motions) -> MotionPlan:
    """Backs down and off the flight: the flipper rides on the nosings, and is lifted before the rear reaches the floor.

    A flipper on which the chair leans, over the crest or where its belts slipped, is first lifted slowly.
    """
    if now.before_m >= -now.bears_m - now.step_m:
        return driving(now, -SLOW_M_S, motions.level.keep(now.estimate), turn_to(now, stepping_rad(now)))
    lies = lies_rad(now)
    if now.flipper is not None and now.flipper.angle_rad < lies - THERE_RAD:
        return driving(now, 0.0, 0.0, turn_to(now, lies, lifts_rad_s=GENTLY_RAD_S))
    return driving(now, -SLOW_M_S, motions.steering(now), ride(now))


def is_backed_off(now: Situation) -> str | None:
    """The chair stands on the floor, half a metre from the flight: it is refused for the reason for which it backed off."""
    return now.cause if now.stair.pitch_rad < LIES_RAD and -now.gone_m > KEEPS_M else None


# --- down the flight


def descend(now: Situation, motions: Motions) -> MotionPlan:
    """Backs down, slower near the last nosing, with the flipper riding; over the last nosing it follows the way."""
    is_near, command = now.before_m < KEEPS_M, now.crossing.command
    if command is not None and command.leads:
        return driving(now, command.speed_m_s, motions.steering(now, blind=True), command.flipper)
    speed = math.sqrt(SLOW_M_S**2 + 2.0 * GENTLE_M_S2 * max(now.before_m - KEEPS_M, 0.0))
    plan = driving(now, -min(speed, now.config.climb_speed_m_s), motions.steering(now, blind=is_near), ride(now))
    return replace(plan, pitch_feedforward_m_s=motions.pitch_feedforward(now), needs_stair=not is_near)


def has_a_heading_error(now: Situation) -> str | None:
    """The chair lies on a flight that is in view, with a heading error that backing down would enlarge."""
    if not now.is_on_a_flight or not now.stair.map_count or now.estimate is None:
        return None
    off = now.estimate.heading_rad
    is_large = abs(off) > OFF_HEADING_RAD
    return f"on a flight, heading error {off / DEG:+.1f}°: it turns by climbing" if is_large else None


def slides_off_heading(now: Situation) -> str | None:
    """The heading error has grown beyond what backing down corrects; a re-arm lets the chair turn by climbing."""
    if now.is_off_heading or has_a_heading_error(now) is None or now.estimate is None:
        return None
    remedy = "have the chair steadied, or re-arm it to turn by climbing"
    return f"heading error {now.estimate.heading_rad / DEG:+.1f}° on the flight: one belt slides, or the gyro errs; {remedy}"


def noted(now: Situation) -> Situation:
    """Return the situation after the chair has been held for its heading error."""
    return replace(now, is_off_heading=True)


def turn_by_climbing(now: Situation, _: Motions) -> MotionPlan:
    """Climbs, steered by the heading controller: belts that back down and turn diverge."""
    return replace(now.still, speed_m_s=now.config.climb_speed_m_s, turn_m_s=None, flipper=ride(now))


def has_turned(now: Situation) -> str | None:
    """The heading error is small."""
    if now.estimate is None or abs(now.estimate.heading_rad) > SQUARE_RAD:
        return None
    return f"square within {abs(now.estimate.heading_rad) / DEG:.1f}°"


def saw_no_floor(now: Situation) -> str | None:
    """The rear pulley is near the last nosing in any map, and no map showed the floor beyond."""
    if now.stair.bottom_ends or not (now.tips or now.before_m < ENTER_FROM_M):
        return None
    return f"nothing was seen beyond the last nosing, {beside(now.before_m)} the rear pulley"


def tips_onto_the_floor(now: Situation) -> str | None:
    """The rear pulley has passed the last nosing, or the chair is level near it."""
    return f"last nosing {beside(now.before_m)} the rear pulley, the floor beyond it seen" if now.tips else None
