"""Acceptance of a flight that was found: it is refused by its size, its form, its width or the error of its heading.

How much evidence makes a stair is decided before (``EVIDENCE``); each rule here names one cause, in a sentence with its figures. A
rule is a function of the finding; the first one that answers names the refusal.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from treadline.core.angles import DEG, to_side
from treadline.core.step_sizes import RISE_M, RUN_M
from treadline.perception._edge_fit import LEFT_OUT, EdgeFit
from treadline.perception._form import Side
from treadline.perception._lattice import EVIDENCE
from treadline.perception._stair_shape import StairShape
from treadline.perception._step_parts import Flight

HEADING_LIMIT = 45.0 * DEG
"""Largest accepted heading [rad]."""
SLOPE_LIMIT = 45.0 * DEG
"""Largest accepted slope [rad]."""
AGREEING = 0.7
"""Least fraction of consistent nosings: winders are not parallel."""
SIGMA_LIMIT = 1.5 * DEG
"""Largest accepted standard deviation of the heading [rad]: (4° - 1°) / 1.96. By such a frame a chair that is square to within 1°
is less than 4° off with 95 %, the largest heading error at which it drives down a flight. Noise falls as the chair approaches."""
FORM_LIMIT = 1.0 * DEG
"""Largest accepted rotation of a winding flight's edges between those in view and the chair, and largest accepted rotation of
bowed ones [rad]: the heading error of a chair that counts as square. It does not decrease as the chair
approaches."""
UNSEEN_MIDDLE_M = 0.30
"""Assumed distance of the visible part of a bowed flight from its middle [m]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Finding:
    """A flight with its measured heading and form."""

    flight: Flight
    fit: EdgeFit
    shape: StairShape
    bow_1_m: float
    """Curvature of the edges in the horizontal plane [1/m]; 0 for straight ones."""
    sides: tuple[Side | None, Side | None]
    """Left and right side of the flight in the camera's view."""
    heading_rad: float
    sigma_rad: float
    swept_half_m: float | None
    """Half width of the volume swept by the chair [m]; None if no chair is known."""
    least_levels: int
    """Least number of evenly spaced treads."""


def refusal_of(finding: Finding) -> str | None:
    """Return the cause of the refusal of a flight, or None if the chair may drive on it."""
    return next((cause for rule in RULES if (cause := rule(finding)) is not None), None)


def lacking_evidence(flight: Flight) -> str:
    """Return which evidence is lacking for a stair."""
    shown = np.floor(10.0 * flight.evidence) / 10.0  # never rounded up to what is needed
    return f"too little shows a stair: {_steps(flight.rise_m, flight.run_m)}, evidence {shown:.1f} of {EVIDENCE:.1f} needed"


def _steps(rise_m: float, run_m: float) -> str:
    return f"steps of {1e3 * rise_m:.0f} by {1e3 * run_m:.0f} mm"


def _unfit_size(finding: Finding) -> str | None:
    shape = finding.shape
    if finding.flight.is_single:
        return None
    if min(shape.rise_m, shape.run_m) <= 0.0:
        return f"what repeats is no flight: it has no {'run' if shape.rise_m > 0.0 else 'rise'}"
    steps = _steps(shape.rise_m, shape.run_m)
    for size_m, (least_m, most_m), small, large in (
        (shape.rise_m, RISE_M, "low", "high"),
        (shape.run_m, RUN_M, "short", "long"),
    ):
        if not least_m <= size_m <= most_m:
            wrong = large if size_m > most_m else small
            return (
                f"the steps are too {wrong} for a flight that a chair climbs: {steps}, {1e3 * least_m:.0f} to {1e3 * most_m:.0f} mm"
            )
    if shape.slope_rad > SLOPE_LIMIT:
        return f"the flight is too steep: {shape.slope_rad / DEG:.0f}°, at most {SLOPE_LIMIT / DEG:.0f}°; {steps}"
    return None


def _unlevelled(finding: Finding) -> str | None:
    levels, least = finding.flight.levels, finding.least_levels
    if levels < least:
        return f"gravity is not known: {levels} evenly spaced level(s) in view, {least} needed in its place"
    # Furniture seen from the front looks like a falling flight seen from straight above.
    if least and finding.flight.direction == "down":
        return "gravity is not known: what may be a falling flight may be furniture seen from the front"
    return None


def _turned_away(finding: Finding) -> str | None:
    if abs(finding.heading_rad) <= HEADING_LIMIT:
        return None
    return f"the flight is too far aside: heading {finding.heading_rad / DEG:.0f}°, at most ±{HEADING_LIMIT / DEG:.0f}°"


def _winding(finding: Finding) -> str | None:
    flight, fit = finding.flight, finding.fit
    turned_rad = fit.turn_per_step_rad * float(np.mean([nosing.ahead_m for nosing in flight.nosings])) / flight.run_m
    if fit.winding > 1.0 - LEFT_OUT and abs(turned_rad) > FORM_LIMIT:
        return f"the flight winds by {to_side(fit.turn_per_step_rad, fit.turn_sigma_rad, unit='° per step')}"
    if sum(fit.agrees) < AGREEING * sum(nosing.has_direction for nosing in flight.nosings):
        return f"the flight is not straight: nosings turned by up to {fit.widest_rad / DEG:.1f}° against each other"
    if fit.directed < 2 and not flight.is_single:
        return "too little is in view: one edge has a direction, and a straight flight is not distinguished from winders"
    return None


def _bowed(finding: Finding) -> str | None:
    turned_rad = abs(finding.bow_1_m) * UNSEEN_MIDDLE_M
    if turned_rad <= FORM_LIMIT:
        return None
    off = f"the heading may be off by {turned_rad / DEG:.1f}°, at most {FORM_LIMIT / DEG:.1f}°"
    return f"the edges are bowed by {abs(finding.bow_1_m):.2f} per metre: {off}"


def _uncertain(finding: Finding) -> str | None:
    if finding.sigma_rad <= SIGMA_LIMIT:
        return None
    cause = "the flight is too far away, or too little of it is in view"
    if finding.fit.winding > LEFT_OUT and abs(finding.fit.turn_per_step_rad) > 1.96 * finding.fit.turn_sigma_rad:
        cause = f"the flight may wind by {to_side(finding.fit.turn_per_step_rad, finding.fit.turn_sigma_rad, unit='° per step')}"
    return f"{cause}: heading known to ±{1.96 * finding.sigma_rad / DEG:.1f}°, ±{1.96 * SIGMA_LIMIT / DEG:.1f}° needed"


def _too_narrow(finding: Finding) -> str | None:
    left, right = finding.sides
    swept_m = 2.0 * (finding.swept_half_m or 0.0)
    if left is None or right is None or right.aside_m - left.aside_m >= swept_m:
        return None
    width_m = right.aside_m - left.aside_m
    between = f"between {left.kind} and {right.kind} side"
    return f"the flight is too narrow: {width_m:.2f} m wide {between}; the chair sweeps {swept_m:.2f} m"


RULES: tuple[Callable[[Finding], str | None], ...] = (
    _unlevelled,
    _winding,
    _unfit_size,
    _turned_away,
    _bowed,
    _uncertain,
    _too_narrow,
)
"""Rules of acceptance, in the order in which they are asked."""
