"""End of a run and its verdict, by ground truth if the plant has any: arrival, hold, fall, slide down the flight, time limit.

A slide is a retreat that the belts did not drive. An arrival or a hold that was too rough for a passenger has its own verdict.
"""

import math

from treadline.core.angles import DEG
from treadline.core.ports import Truth
from treadline.core.signals import TICK_S, MotionPlan
from treadline.run.run_scores import LEVEL_RAD, Scores
from treadline.scenario.chair import ChairDescription
from treadline.scenario.operator_actions import rearms_until_s
from treadline.scenario.scenario import Scenario
from treadline.vehicle.climb import climb_of
from treadline.vehicle.staircase import as_designed

FALLEN_RAD = 25.0 * DEG
"""Tilt beyond which the chair counts as fallen: pitch above the stair's slope, pitch below horizontal, or roll [rad]."""
FALLEN_SLIDE_M = 0.5
"""Roll-back beyond which the chair counts as fallen [m]: one and a half steps."""
ROUGH_M_S2, ROUGH_DEG_S, ROUGH_MARGIN_DEG = 4.0, 25.0, 0.0
"""Passenger acceleration [m/s²] and pitch rate [°/s] above which, and tip-over margin below which [°], a run is rough: beyond
4 m/s² a person who is not held slides on a seat, with an assumed friction of 0.4 between clothes and cover; at 25 °/s the chair
falls, because every motion that is planned stays below 15 °/s; below 0° the chair was tipping over."""


class Ending:
    """End of a run and its verdict, judged by ground truth; without ground truth by the reports of planner and guard."""

    def __init__(self, scenario: Scenario, chair: ChairDescription, *, attended: bool = False) -> None:
        self._slope_rad = climb_of(scenario, chair).slope_rad
        self._duration_s = scenario.drive.duration_s
        staircase = as_designed(scenario.stair, scenario.step, scenario.sill)
        self.last_x_m = staircase.last_nosing_m
        """Place of the last nosing along the stair [m]."""
        end_m = staircase.flights[0][-1].nosing_F - staircase.p_WS
        self.end_x_m = float(staircase.R_WS[:, 0] @ end_m) - 0.5 * chair.tracks.flat_run_m
        """Place at which a run of a flight alone ends [m]: it is the first, with the front pulley at its last nosing."""
        self._is_up = scenario.drive.direction == "up"
        self.is_on_flight = scenario.start.place == "flight" and self._is_up
        """Whether a flight alone is driven, to its last nosing."""
        self.restart()
        self._rearms_until_s = math.inf if attended else rearms_until_s(scenario.operator)

    def restart(self) -> None:
        """Begin a further run of the same scenario."""
        self._slide = SlideWatch(upward=self._is_up)

    def fall(self, truth: Truth) -> tuple[str, str] | None:
        """Return the verdict ``fell`` and its cause, or None. Call in order of time: the slide is integrated."""
        above = max(truth.pitch_rad - self._slope_rad, -truth.pitch_rad, abs(truth.roll_rad))
        if above > FALLEN_RAD:
            return "fell", f"tilted {above / DEG:.0f}° beyond the stair at {truth.t_s:.2f} s"
        roll_back_m = self._slide.update(truth)
        return ("fell", f"slid {roll_back_m:.2f} m down the flight by {truth.t_s:.2f} s") if roll_back_m > FALLEN_SLIDE_M else None

    def way_m(self, x_m: float) -> float:
        """Return the distance along the stair from a place to the end of a traversal, or of a flight alone [m]."""
        return abs((self.end_x_m if self.is_on_flight else self.last_x_m if self._is_up else 0.0) - x_m)

    def is_beyond(self, truth: Truth) -> bool:
        """Return whether the chair stands level, with mid-track beyond the last nosing of its way."""
        beyond_m = truth.x_m - self.last_x_m if self._is_up else -truth.x_m
        return abs(truth.pitch_rad) < LEVEL_RAD and beyond_m > 0.0

    def verdict(self, truth: Truth | None, plan: MotionPlan, holding: str | None) -> tuple[str, str | None] | None:
        """Return the verdict and its cause, or None while the run goes on.

        Args:
            truth: Ground truth of the tick; None for a plant without it.
            plan: Plan of the tick.
            holding: Cause of the guard's hold, if it holds.
        """
        fallen = None if truth is None else self.fall(truth)
        if fallen is not None:
            return fallen
        if holding is not None and plan.t_s >= self._rearms_until_s:
            return "held", holding
        if plan.phase == "arrived":
            if truth is None:
                return "arrived", None
            if self.is_beyond(truth):
                return "arrived", None
            return "held", f"reported arrival at {plan.t_s:.2f} s, and has not arrived"
        if plan.phase == "refused":
            return "refused", plan.cause
        if plan.phase == "drive" and self._is_up and truth is not None and truth.x_m >= self.end_x_m:
            return "end_of_flight", None
        if plan.t_s >= self._duration_s - 0.5 * TICK_S:
            return "time_up", None
        return None


def rough_cause(scores: Scores) -> str | None:
    """Return why a run was too rough for a passenger, or None."""
    causes = []
    if scores.passenger_max_m_s2 > ROUGH_M_S2:
        causes.append(f"passenger at {scores.passenger_max_m_s2:.1f} m/s², above {ROUGH_M_S2:g}")
    if scores.max_pitch_rate_deg_s > ROUGH_DEG_S:
        causes.append(f"pitch rate {scores.max_pitch_rate_deg_s:.0f} °/s, above {ROUGH_DEG_S:g}")
    if scores.min_stability_margin_deg < ROUGH_MARGIN_DEG:
        causes.append(f"tip-over margin {scores.min_stability_margin_deg:.1f}°, below {ROUGH_MARGIN_DEG:g}")
    return "; ".join(causes) or None


class SlideWatch:
    """Slide since the furthest point reached on the flight, against the direction of travel.

    A chair that backs away under power does not slide: only the retreat beyond the belts' own reverse travel counts.
    """

    def __init__(self, *, upward: bool) -> None:
        self._sign = 1.0 if upward else -1.0
        self._before: Truth | None = None
        self.roll_back_m = 0.0

    def update(self, truth: Truth) -> float:
        """Take the truth of one tick, or of one of several; return the slide so far."""
        before, self._before = self._before, truth
        if before is None or abs(truth.pitch_rad) <= LEVEL_RAD:
            self.roll_back_m = 0.0
            return self.roll_back_m
        since_s = truth.t_s - before.t_s
        driven_m = self._sign * 0.5 * (truth.left_m_s + truth.right_m_s) * math.cos(truth.heading_rad) * since_s
        advance_m = self._sign * (truth.x_m - before.x_m) - min(driven_m, 0.0)
        self.roll_back_m = max(self.roll_back_m - advance_m, 0.0)
        return self.roll_back_m
