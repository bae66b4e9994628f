"""Rules by which a flight that was found is accepted as a stair that can be driven on, or rejected with a reason."""

import math

import numpy as np

from treadline.core.angles import DEG
from treadline.perception._edge_fit import EdgeFit
from treadline.perception._form import Bow, Side
from treadline.perception._stair_shape import StairShape
from treadline.perception._step_parts import Flight

EVIDENCE, UNCONFIRMED = 5.0, 3.4
"""Least log-evidence of a stair, and of an unconfirmed one [nats]: two levels and two fronts reach at most 3.92, a third level that
fits 6.3. The 90 % quantile of its misfit (χ² of one degree of freedom, 2.7) leaves 5.0. Between 4.2 and 5.0 were 11 of 21 false
detections and 3 of 2050 true ones."""
HEADING_LIMIT = 45.0 * DEG
"""Largest accepted heading [rad]."""
SLOPE_LIMIT = 45.0 * DEG
"""Largest accepted slope [rad]."""
AGREEING = 0.7
"""Least fraction of consistent nosings: winders are not parallel."""
STRAIGHT_LEAST = 2
"""Least number of nosings with a direction, which are parallel on a straight flight."""
SIGMA_LIMIT = 1.5 * DEG
"""Largest accepted standard deviation of the heading [rad]: (4° - 1°) / 1.96. By such a frame a chair that is square to within 1°
is less than 4° off with 95 %, the largest heading error at which it drives down a flight. Noise decreases as the chair approaches.
With 3°, flights of 6 m radius are accepted with errors of 7°."""
FORM_LIMIT = 1.0 * DEG
"""Largest accepted rotation of a curved flight's edges between those in view and the chair, and largest accepted standard deviation
of the heading on bowed edges [rad]: the heading error of a chair that counts as square. It does not decrease as the chair
approaches."""
NARROWER_M = 0.3
"""Largest width by which a step may be narrower than those above it [m]: treads of gratings, which are seen through, reach 0.29 m,
footstools before a sofa 0.40 to 0.56 m."""
CURVED = 0.5
"""Probability above which a flight is called curved."""
DISAGREEMENT, DISAGREEMENT_SIGMAS = 2.0 * DEG, 4.0
"""Angle between risers and nosings [rad], and number of standard deviations, above which one of them does not belong to the
stair."""


def lacking_evidence(flight: Flight) -> str:
    """Return which evidence is lacking for a stair."""
    shown = math.floor(10.0 * flight.evidence) / 10.0  # never rounded up to what is needed
    return (
        f"steps of {1e3 * flight.rise_m:.0f} by {1e3 * flight.run_m:.0f} mm would explain what is seen, evidence "
        f"{shown:.1f} of {EVIDENCE:.1f} needed"
    )


def rejection_reason(
    heading_rad: float,
    sigma_rad: float,
    flight: Flight,
    fit: EdgeFit,
    shape: StairShape,
    bow: Bow,
    sides: tuple[Side | None, Side | None],
    *,
    narrower_m: float,
    swept_half_m: float,
    least_levels: int,
) -> str | None:
    """Return the reason for rejection as a stair, or None.

    Args:
        sides: Left and right side of the flight.
        narrower_m: Largest width by which a step is narrower than those above it.
        swept_half_m: Half width of the volume swept by the chair.
        least_levels: Least number of evenly spaced treads.
    """
    if shape.slope_rad > SLOPE_LIMIT:
        return f"a slope of {shape.slope_rad / DEG:.0f}° is too steep to drive on"
    if flight.levels < least_levels:
        return f"no gravity, and {flight.levels} evenly spaced level(s) to replace it; {least_levels} needed"
    if abs(heading_rad) > HEADING_LIMIT:
        return f"heading {heading_rad / DEG:.0f}° is beyond ±{HEADING_LIMIT / DEG:.0f}°"
    if narrower_m > NARROWER_M:
        return f"a step is {narrower_m:.2f} m narrower than the steps above it: no flight"
    return _not_straight(flight, fit) or _uncertain(sigma_rad, bow) or _too_narrow(sides, swept_half_m)


def _not_straight(flight: Flight, fit: EdgeFit) -> str | None:
    if sum(nosing.has_direction for nosing in flight.nosings) < STRAIGHT_LEAST:
        return "one edge in view has a direction: a straight flight is not distinguished from winders"
    if fit.agreeing < AGREEING or fit.agreeing * len(flight.nosings) < 1.5:
        return f"nosings turned by up to {fit.widest_rad / DEG:.1f}° against each other: no straight flight"
    turned = fit.curvature_1_m * float(np.mean([nosing.ahead_m for nosing in flight.nosings]))
    if fit.curved > CURVED and abs(turned) > FORM_LIMIT:
        return f"edges turn by {fit.curvature_1_m * flight.run_m / DEG:+.1f}° at each step: no straight flight"
    apart = fit.planes_against_lines_rad
    if apart is not None and abs(apart[0]) > max(DISAGREEMENT, DISAGREEMENT_SIGMAS * apart[1]):
        return f"risers and nosings disagree by {abs(apart[0]) / DEG:.1f}°"
    return None


def _uncertain(sigma_rad: float, bow: Bow) -> str | None:
    limit_rad = FORM_LIMIT if bow.is_bowed else SIGMA_LIMIT
    if sigma_rad <= limit_rad:
        return None
    known = f"the heading is known to ±{1.96 * sigma_rad / DEG:.1f}° only, {1.96 * limit_rad / DEG:.1f}° needed"
    return f"edges bowed by {abs(bow.curvature_1_m):.2f} per metre: {known}" if bow.is_bowed else known


def _too_narrow(sides: tuple[Side | None, Side | None], swept_half_m: float) -> str | None:
    left, right = sides
    if left is None or right is None or right.aside_m - left.aside_m >= 2.0 * swept_half_m:
        return None
    return (
        f"the flight is {right.aside_m - left.aside_m:.2f} m wide between {left.kind} and {right.kind} side; the chair sweeps "
        f"{2.0 * swept_half_m:.2f} m"
    )
