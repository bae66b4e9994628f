"""Feasibility of entering the measured stair with the entered payload, checked before the chair touches a nosing.

``treadline check`` evaluates a description, this module the stair map. Slopes are measured to about 0.3° (RMSE). The limits are one
degree wider than those of ``check``, so that noise does not reject what ``check`` accepts.
"""

import math

from treadline.core.angles import DEG
from treadline.core.step_sizes import RISE_M, RUN_M
from treadline.estimation.known_nosings import SIGMAS
from treadline.scenario.chair import ChairDescription
from treadline.vehicle.linkage import SeatLinkage
from treadline.vehicle.rest_poses import rest_chair
from treadline.vehicle.tip_over_margin import MARGIN_LIMIT_RAD, UNKNOWN_RAD
from treadline.vehicle.tracks import minimum_track_length, track_on_stair_m

MEASURED_RAD = 1.0 * DEG
"""Reserve for the error of the measured slope [rad]: three standard deviations."""
MEASURED_M = 0.01
"""Reserve for the error of the measured nosing distance [m]."""
ELLIPSE = tuple((math.cos(turn), math.sin(turn)) for turn in (k * math.tau / 16 for k in range(16)))
"""Directions to points of the ellipse of rise and run that may be true. Its half axes of ``SIGMAS`` hold 98.9 % in two dimensions,
and 89 % with the tracker's mean squared error of 2 for the rise on approach. A refusal from afar is for good; right before the
flight the measured values count."""


def certain_reject_reason(
    chair: ChairDescription, payload_kg: float, rise_m: float, run_m: float, sigmas_m: tuple[float, float]
) -> str | None:
    """Return ``reject_reason`` of the measured stair if no stair that may be the true one can be entered, or None.

    Args:
        chair: Chair.
        payload_kg: Weight of the passenger as entered by the operator.
        rise_m: Measured rise.
        run_m: Measured run.
        sigmas_m: Standard deviations of rise and run, taken as independent; infinite before they are measured. What may be true is
            limited to the range of steps that the detector knows.
    """
    reason = reject_reason(chair, payload_kg, rise_m, run_m, math.atan2(rise_m, run_m))
    if reason is None or not all(map(math.isfinite, sigmas_m)):
        return None
    for along_rise, along_run in ELLIPSE:
        rise = min(max(rise_m + SIGMAS * along_rise * sigmas_m[0], RISE_M[0]), RISE_M[1])
        run = min(max(run_m + SIGMAS * along_run * sigmas_m[1], RUN_M[0]), RUN_M[1])
        if reject_reason(chair, payload_kg, rise, run, math.atan2(rise, run)) is None:
            return None
    return reason


def reject_reason(chair: ChairDescription, payload_kg: float, rise_m: float, run_m: float, slope_rad: float) -> str | None:
    """Return the reason why the chair must not enter, with the number and the remedy; None if it may."""
    steepness = f"the stair is {slope_rad / DEG:.1f}° steep"
    rated = beyond_rating(chair, slope_rad - MEASURED_RAD, payload_kg, steepness)
    if rated is not None:
        return rated
    lacking_m = minimum_track_length(rise_m, run_m) - track_on_stair_m(chair)
    if lacking_m > MEASURED_M:
        return f"the track is {lacking_m:.3f} m too short for steps of {rise_m:.3f} by {run_m:.3f} m; use a longer track"
    reach = math.inf if chair.seat is None else SeatLinkage(chair.seat).angle_range[1]
    if reach < slope_rad - MEASURED_RAD:
        return f"{steepness}, the seat stays level to {reach / DEG:.0f}°; lengthen its stroke"
    margin_rad = min(rest_chair(chair, payload_kg).least_margins(rise_m, run_m, (0.0,)))
    if margin_rad < MARGIN_LIMIT_RAD - UNKNOWN_RAD:
        least = MARGIN_LIMIT_RAD / DEG
        remedy = "take less payload" if chair.seat is None else "shift the seat or take less payload"
        return f"the tipping margin would be {margin_rad / DEG:.1f}°, below {least:g}°; {remedy}"
    return None


def beyond_rating(chair: ChairDescription, slope_rad: float, payload_kg: float, steepness: str) -> str | None:
    """Return why slope or payload are beyond the maker's limits, None if they are not.

    Args:
        chair: Chair.
        slope_rad: Slope that is at least there.
        payload_kg: Weight of the passenger.
        steepness: Clause that states the slope.
    """
    rating = chair.rating
    if rating is None:
        return None
    if rating.slope_deg is not None and slope_rad > rating.slope_deg * DEG + 1e-9:
        return f"{steepness}, chair '{chair.name}' is rated for {rating.slope_deg:g}°; take another way"
    if payload_kg > rating.payload_kg:
        return f"a payload of {payload_kg:g} kg; chair '{chair.name}' is rated for {rating.payload_kg:g} kg"
    return None
