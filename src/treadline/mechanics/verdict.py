"""``treadline check``: may this chair climb this stair? Mechanics only, before anything moves.

Each refusal comes with its number and with what would help.
"""

import math
from dataclasses import dataclass, field

from treadline.angles import DEG
from treadline.mechanics.chair import ChairDescription
from treadline.mechanics.linkage import SeatLinkage
from treadline.mechanics.stability import Margins, static_margins
from treadline.mechanics.tracks import minimum_track_length
from treadline.mechanics.traction import friction_use
from treadline.scenario import Chair, Scenario

TRACTION_RESERVE = 1.05
"""Friction wanted over tan β: nosings jolt."""
MARGIN_LIMIT_RAD = 7.0 * DEG
"""The figure of ISO 7176-24; no claim to the standard is made."""
SEAT_RESERVE_RAD = 3.0 * DEG
"""Range the seat keeps beyond the slope: the chair rocks over nosings."""
SHIFT_STEP_M, SHIFT_LIMIT_M = 0.01, 0.20


@dataclass(frozen=True, slots=True, kw_only=True)
class CheckReport:
    """What mechanics say, under the contract's keys."""

    verdict: str
    """``go`` or ``refuse``."""
    reasons: list[str]
    track_length_margin_m: float
    friction_needed: float
    friction_available: float
    friction_use_at_start: float
    """Share of the friction ellipse at the start heading; 1 slides."""
    stability_margin_deg: dict[str, float]
    seat_range_deg: tuple[float, float]
    proposed_seat_shift_m: float | None = field(default=None)
    """What would reach the margin, where a shift of the seat can."""


def check(scenario: Scenario, chair: ChairDescription) -> CheckReport:
    """Return the verdict on a scenario."""
    stair, loading = scenario.stair, scenario.chair
    slope, heading = stair.slope_rad, scenario.start.heading_deg * DEG
    pitch = math.hypot(stair.rise_m, stair.run_m)
    margins = static_margins(chair, loading, slope, pitch, heading)
    linkage_range = SeatLinkage(chair.seat).angle_range
    length_margin = chair.tracks.flat_run_m - minimum_track_length(stair.rise_m, stair.run_m)
    use = friction_use(slope, heading, stair.friction)

    reasons = []
    shift = None
    if length_margin <= 0.0:
        reasons.append(f"the track is {-length_margin:.3f} m too short for two nosings of {pitch:.3f} m pitch; use a longer track")
    if stair.friction[0] < TRACTION_RESERVE * math.tan(slope):
        reasons.append(
            f"friction {stair.friction[0]:.2f} is below {TRACTION_RESERVE:g} × tan β = "
            f"{TRACTION_RESERVE * math.tan(slope):.2f}; roughen the nosings or take a stair below "
            f"{math.degrees(math.atan(stair.friction[0] / TRACTION_RESERVE)):.1f}°"
        )
    elif use >= 1.0:
        reasons.append(f"at a heading of {heading / DEG:.0f}° the chair slides (friction use {use:.2f}); start squarer")
    if margins.worst < MARGIN_LIMIT_RAD:
        shift = _shift_that_helps(chair, loading, slope, pitch, heading)
        reasons.append(_too_unstable(margins, loading, shift))
    if linkage_range[1] < slope + SEAT_RESERVE_RAD:
        reasons.append(
            f"the seat reaches {linkage_range[1] / DEG:.0f}°, the stair needs {(slope + SEAT_RESERVE_RAD) / DEG:.0f}°; "
            "lengthen its stroke"
        )
    gap = _longest_gap(stair.missing_steps) * pitch
    if gap and chair.tracks.flat_run_m <= 2.0 * pitch + gap:
        reasons.append(
            f"missing steps leave {gap + pitch:.2f} m between nosings; the track spans {chair.tracks.flat_run_m:.2f} m, "
            f"needs {2.0 * pitch + gap:.2f} m"
        )
    return CheckReport(
        verdict="refuse" if reasons else "go",
        reasons=reasons,
        track_length_margin_m=length_margin,
        friction_needed=math.tan(slope),
        friction_available=stair.friction[0],
        friction_use_at_start=use,
        stability_margin_deg={side: getattr(margins, side) / DEG for side in ("uphill", "downhill", "left", "right")},
        seat_range_deg=(linkage_range[0] / DEG, linkage_range[1] / DEG),
        proposed_seat_shift_m=shift,
    )


def _too_unstable(margins: Margins, loading: Chair, shift_m: float | None) -> str:
    side = min(("uphill", "downhill", "left", "right"), key=lambda name: float(getattr(margins, name)))
    text = f"the tipping margin {side} is {margins.worst / DEG:.1f}°, below {MARGIN_LIMIT_RAD / DEG:g}°; "
    if shift_m is None:
        return text + "take less payload, or sit lower"
    change = shift_m - loading.seat_shift_m
    return text + f"shift the seat {abs(change) * 1000.0:.0f} mm {'uphill' if change > 0.0 else 'downhill'}"


def _shift_that_helps(
    chair: ChairDescription, loading: Chair, slope_rad: float, pitch_m: float, heading_rad: float
) -> float | None:
    """Return the smallest seat shift that reaches the margin, or None."""
    for k in range(1, round(SHIFT_LIMIT_M / SHIFT_STEP_M) + 1):
        for sign in (1.0, -1.0):
            shift = round(loading.seat_shift_m + sign * k * SHIFT_STEP_M, 4)
            moved = loading.model_copy(update={"seat_shift_m": shift})
            if static_margins(chair, moved, slope_rad, pitch_m, heading_rad).worst >= MARGIN_LIMIT_RAD:
                return shift
    return None


def _longest_gap(missing: tuple[int, ...]) -> int:
    """Return the largest number of neighbouring steps that are missing."""
    longest = run = 0
    previous = None
    for index in sorted(set(missing)):
        run = run + 1 if previous is not None and index == previous + 1 else 1
        longest, previous = max(longest, run), index
    return longest
