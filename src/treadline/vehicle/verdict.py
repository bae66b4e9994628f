"""``treadline check``: whether a chair may climb a stair, judged by mechanics before any motion.

Each refusal states its number and a remedy.
"""

import itertools
import math
from dataclasses import dataclass, field

from treadline.core.angles import DEG, radians_hint
from treadline.core.printing import Printable
from treadline.core.step_sizes import RISE_M, RUN_M, SINGLE_RISE_M
from treadline.scenario.chair import ChairDescription, Tracks
from treadline.scenario.scenario import SEAT_SHIFT_M, Chair, Scenario, Stair
from treadline.vehicle._start_checks import checked_start
from treadline.vehicle.bodies import centre_of_mass, oversized_lugs
from treadline.vehicle.climb import Climb, climb_of, widest_spacing_m
from treadline.vehicle.linkage import SeatLinkage
from treadline.vehicle.loading import Loading
from treadline.vehicle.staircase import as_designed
from treadline.vehicle.start_pose import length_m
from treadline.vehicle.tip_over_margin import MARGIN_LIMIT_RAD, Margins, tipping_margins, worst_support
from treadline.vehicle.tracks import (
    friction_use,
    largest_heading_rad,
    minimum_track_length,
    nosings_touched,
    track_on_stair_m,
)

TRACTION_RESERVE = 1.05
"""Required ratio of friction to tan β, a reserve for jolts at the nosings."""
SEAT_RESERVE_RAD = 3.0 * DEG
"""Required range of the seat beyond the slope [rad]: the chair rocks over nosings."""
BRAKE_RESERVE = 1.5
"""Required ratio of a belt's brake force to half of the downhill force: an off-centre payload loads one belt by an eighth more, and
a stop from cruise speed needs another sixth."""
TURNED_RAD = 2.0 * DEG
"""Largest difference in direction of neighbouring nosings [rad]: over the gauge of 0.65 m one side lies 23 mm further, twice
the deviation of a run."""
SIDES = ("uphill", "downhill", "left", "right")
"""Directions of tipping."""
SHIFT_STEP_M, SHIFT_LIMIT_M = 0.01, 0.20
"""Step and limit of the search for a seat shift [m]."""
END_CLEAR_M = 0.40
"""Distance of the belts from a drop at a landing's far end [m]: the guard keeps 0.34 m and the stopping distance at 0.1 m/s."""
LANDING_SPARE_M = 0.60
"""Required depth of a landing between two flights beyond the length of the chair [m]: nearer than 0.45 m the next edge is hidden
below the camera."""


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class CheckReport(Printable):
    """Result of the mechanical check, with the keys of the JSON output."""

    verdict: str
    """Verdict: ``go`` or ``refuse``."""
    reasons: list[str]
    track_length_margin_m: float | None
    """Track in the nosing plane, a flipper in line with the belts included, beyond 2√(h² + w²) [m]; None over a single nosing."""
    nosings_in_contact: int
    """Number of nosings under the track at the worst phase of the nosing cycle."""
    friction_needed: float
    """Friction required to stand: tan β; over a single nosing that of the pitch at which the belts' middle passes."""
    friction_needed_with_reserve: float
    """Friction required by the check, with reserve."""
    friction_available: float
    friction_use_at_start: float
    """Used fraction of the friction ellipse at the start heading; the chair slides at 1."""
    stability_margin_deg: dict[str, float]
    seat_range_deg: tuple[float, float] | None
    """Range of the seat's angle; None without a seat linkage."""
    proposed_seat_shift_m: float | None = field(default=None)
    """Seat shift that would reach the required margin [m]; None if there is none."""
    warnings: list[str] = field(default_factory=list)
    """Questions about values that are possible and improbable, which leave the verdict as it is."""
    nosings_in_view: int | None = None
    """Number of nosings in view of the camera from the start, 0 where fewer than two are; None in open loop, which uses no camera,
    and where the chair cannot stand there."""

    def printed(self) -> tuple[str, list[tuple[str, str]]]:
        """Return the verdict, the margins and the reasons."""
        margins = ", ".join(f"{side} {angle:.1f}°" for side, angle in self.stability_margin_deg.items())
        longer = [] if self.track_length_margin_m is None else [self.track_length_margin_m]
        count = self.nosings_in_contact
        seat = (
            "no seat linkage" if (held := self.seat_range_deg) is None else f"level from {held[0]:.0f}° to {held[1]:.0f}° of pitch"
        )
        bears = f"{count} nosing{'' if count == 1 else 's'} in contact"
        rows = [
            *(("track length", f"{more_m:+.3f} m over 2√(h²+w²), {bears}") for more_m in longer),
            (
                "friction",
                f"{self.friction_needed_with_reserve:.2f} needed ({self.friction_needed:.2f} to stand, and a reserve for jolts), "
                f"{self.friction_available:.2f} available",
            ),
            ("tip-over margins", margins),
            ("seat", seat),
            *([] if self.nosings_in_view is None else [("camera", f"nosings in view from the start: {self.nosings_in_view}")]),
            *(("reason", reason) for reason in self.reasons),
            *(("warning", warning) for warning in self.warnings),
        ]
        return self.verdict, rows


def check(scenario: Scenario, chair: ChairDescription) -> CheckReport:
    """Return the verdict on a scenario."""
    stair, loading = scenario.stair, scenario.chair.entered
    start_problems, nosings_in_view = checked_start(scenario, chair)
    # On floor and landing the chair turns square before it enters.
    heading = scenario.start.heading_deg * DEG if scenario.start.place == "flight" else 0.0
    climb = climb_of(scenario, chair)
    slope = climb.slope_rad
    margins = static_margins(chair, loading, slope, climb.spacing_m, heading)
    needs_shift = chair.seat is not None and margins.worst < MARGIN_LIMIT_RAD
    shift = _shift_that_helps(chair, loading, climb, heading) if needs_shift else None
    seat_range = None if chair.seat is None else SeatLinkage(chair.seat).angle_range
    length_m = track_on_stair_m(chair)
    is_flight = climb.spacing_m is not None
    reasons = (
        _beyond_rating(chair, climb, loading.payload_kg),
        _too_short(stair, length_m) if is_flight else _beyond_the_flipper(chair, climb),
        _too_slippery(stair, climb, heading),
        _too_far_apart(chair, loading, climb, margins, heading) or _too_unstable(margins, chair, loading, shift),
        _too_heavy_for_the_brakes(chair, loading.payload_kg, climb),
        None if seat_range is None else _too_steep_for_the_seat(seat_range[1], climb),
        _no_seat_to_shift(scenario.chair, chair),
        _too_wide_a_gap(scenario, chair.tracks),
        _too_short_a_landing(stair, chair.tracks),
        _too_short_to_arrive(scenario, chair),
        _undetectable_steps(scenario, climb),
        _turning_flights(stair),
        _winders(stair),
        _turned_nosings(scenario),
        *start_problems,
        oversized_lugs(scenario.belts, chair.tracks),
    )
    return CheckReport(
        verdict="refuse" if any(reasons) else "go",
        reasons=[reason for reason in reasons if reason],
        track_length_margin_m=length_m - minimum_track_length(stair.rise_m, stair.run_m) if is_flight else None,
        nosings_in_contact=nosings_touched(length_m, climb.pitch_m, climb.pitch_m) if is_flight else 1,
        friction_needed=math.tan(slope),
        friction_needed_with_reserve=TRACTION_RESERVE * math.tan(slope),
        friction_available=stair.mean_friction[0],
        friction_use_at_start=friction_use(slope, heading, stair.mean_friction),
        stability_margin_deg={side: getattr(margins, side) / DEG for side in SIDES},
        seat_range_deg=None if seat_range is None else (seat_range[0] / DEG, seat_range[1] / DEG),
        proposed_seat_shift_m=shift,
        warnings=_unit_warnings(scenario, chair),
        nosings_in_view=nosings_in_view,
    )


def static_margins(chair: ChairDescription, loading: Chair, slope_rad: float, pitch_m: float | None, heading_rad: float) -> Margins:
    """Return the tip-over margins of a chair at rest on a stair, with the seat, if it has a linkage, levelled against the pitch.

    A square chair lays its flipper along the flight, where it supports the front; a turned chair lifts it to turn.

    Args:
        pitch_m: Largest distance between neighbouring nosings [m]; None for a single one: floor and landing bear the belts' ends.
    """
    up = (math.sin(slope_rad) * math.cos(heading_rad), -math.sin(slope_rad) * math.sin(heading_rad), math.cos(slope_rad))
    pitch = math.asin(up[0])
    com = centre_of_mass(chair, loading, pitch)
    lifted = heading_rad != 0.0 or pitch_m is None
    weight_n = None if lifted else Loading(chair=chair, payload_kg=loading.payload_kg).weight_n
    return tipping_margins(com, up, worst_support(chair, pitch_m or 0.0, weight_n))


def _unit_warnings(scenario: Scenario, chair: ChairDescription) -> list[str]:
    """Return the angles of the files that may be in radians."""
    angles = {
        "start.heading_deg": scenario.start.heading_deg,
        "tracks.approach_angle_deg": chair.tracks.approach_angle_deg,
        "camera.pitch_deg": chair.camera.pitch_deg,
        "rear_camera.pitch_deg": 0.0 if chair.rear_camera is None else chair.rear_camera.pitch_deg,
    }
    return [hint for name, angle_deg in angles.items() if (hint := radians_hint(name, angle_deg)) is not None]


def _beyond_rating(chair: ChairDescription, climb: Climb, payload_kg: float) -> str | None:
    rating = chair.rating
    if rating is None:
        return None
    if climb.slope_rad > rating.slope_deg * DEG + 1e-9:
        return f"{climb.steepness}, chair '{chair.name}' is rated for {rating.slope_deg:g}°; take another way"
    is_steep = climb.slope_rad > rating.steep_deg * DEG
    most_kg = rating.steep_payload_kg if is_steep else rating.payload_kg
    if payload_kg <= most_kg:
        return None
    where = f" on flights above {rating.steep_deg:g}°" if is_steep else ""
    return f"a payload of {payload_kg:g} kg; chair '{chair.name}' is rated for {most_kg:g} kg{where}"


def _no_seat_to_shift(loading: Chair, chair: ChairDescription) -> str | None:
    if chair.seat is not None or loading.seat_shift_m == 0.0:
        return None
    return (
        f"chair.seat_shift_m is {loading.seat_shift_m:g}, and chair '{chair.name}' has no seat linkage; leave it out, and give the "
        "payload's place in chair.payload_offset_m"
    )


def _turned_nosings(scenario: Scenario) -> str | None:
    """Return which nosing is turned so far against its neighbour that one belt leaves it before the other."""
    for steps in as_designed(scenario.stair, scenario.step).straight_parts:
        for low, high in itertools.pairwise(steps):
            turned_rad = abs(high.yaw_rad - low.yaw_rad)
            if turned_rad > TURNED_RAD:
                turned = f"the nosings of steps {low.index} and {high.index} differ in direction by {turned_rad / DEG:.1f}°"
                return f"{turned}, above {TURNED_RAD / DEG:g}°: the chair would drop from one belt to the other; take another way"
    return None


def _too_short(stair: Stair, length_m: float) -> str | None:
    lacking_m = minimum_track_length(stair.rise_m, stair.run_m) - length_m
    if lacking_m < 0.0:
        return None
    pitch = math.hypot(stair.rise_m, stair.run_m)
    return f"the track is {lacking_m:.3f} m too short for two nosings of {pitch:.3f} m pitch; use a longer track"


def _beyond_the_flipper(chair: ChairDescription, climb: Climb) -> str | None:
    """Return why the front cannot get over a single nosing, or not down from it.

    With the middle of the belts on the nosing, the flipper stands on the landing a kerb's height below its axis.
    """
    flipper, length_m = chair.flipper, chair.tracks.approach_m
    if flipper is None:
        highest_m = float(chair.nose_m[2])
    else:
        low_rad = -flipper.range_deg[0] * DEG
        heights = (0.001 * mm for mm in range(1, round(1e3 * min(length_m, climb.half_run_m))))
        reached = (h for h in heights if math.asin(h / climb.half_run_m) + math.asin(h / length_m) <= low_rad)
        highest_m = max(reached, default=0.0)
    if climb.rise_m <= highest_m:
        return None
    part = "nose" if flipper is None else "flipper"
    return f"the kerb is {climb.rise_m:.2f} m high, the {part} of chair '{chair.name}' reaches {highest_m:.2f} m; take another way"


def _too_slippery(stair: Stair, climb: Climb, heading_rad: float) -> str | None:
    friction, needed = stair.mean_friction[0], TRACTION_RESERVE * math.tan(climb.slope_rad)
    if friction < needed:
        return (
            f"friction {friction:.2f} is below {TRACTION_RESERVE:g} × tan β = {needed:.2f}; roughen the nosings or take "
            f"{climb.below(math.atan(friction / TRACTION_RESERVE))}"
        )
    use = friction_use(climb.slope_rad, heading_rad, stair.mean_friction)
    if use < 1.0:
        return None
    return (
        f"at a heading of {heading_rad / DEG:.0f}° the chair slides (friction use {use:.2f}); start squarer than "
        f"{largest_heading_rad(climb.slope_rad, stair.mean_friction) / DEG:.0f}°"
    )


def _too_far_apart(chair: ChairDescription, loading: Chair, climb: Climb, margins: Margins, heading_rad: float) -> str | None:
    """Return the tip-over margin where the usual steps of the flight would leave enough, and missing or long ones do not."""
    if margins.worst >= MARGIN_LIMIT_RAD or climb.spacing_m is None:
        return None
    if static_margins(chair, loading, climb.slope_rad, climb.pitch_m, heading_rad).worst < MARGIN_LIMIT_RAD:
        return None
    return (
        f"the tipping margin is {margins.worst / DEG:.1f}°, below {MARGIN_LIMIT_RAD / DEG:g}°, where two nosings are "
        f"{climb.spacing_m:.2f} m apart; mend the steps or take another way"
    )


def _too_unstable(margins: Margins, chair: ChairDescription, loading: Chair, shift_m: float | None) -> str | None:
    if margins.worst >= MARGIN_LIMIT_RAD:
        return None
    side = min(SIDES, key=lambda name: float(getattr(margins, name)))
    text = f"the tipping margin {side} is {margins.worst / DEG:.1f}°, below {MARGIN_LIMIT_RAD / DEG:g}°; "
    if shift_m is None and side in ("left", "right"):
        return text + f"move the payload to the {'right' if side == 'left' else 'left'}, or start squarer"
    if shift_m is None:
        if chair.seat is None:
            return text + "take less payload, a less steep stair, or masses lower or further from that side"
        return text + "take less payload, or sit lower"
    change = shift_m - loading.seat_shift_m
    return text + f"shift the seat {abs(change) * 1000.0:.0f} mm {'uphill' if change > 0.0 else 'downhill'}"


def _shift_that_helps(chair: ChairDescription, loading: Chair, climb: Climb, heading_rad: float) -> float | None:
    """Return the smallest seat shift that reaches the margin, or None."""
    for k in range(1, round(SHIFT_LIMIT_M / SHIFT_STEP_M) + 1):
        for sign in (1.0, -1.0):
            shift = round(loading.seat_shift_m + sign * k * SHIFT_STEP_M, 4)
            if not SEAT_SHIFT_M[0] <= shift <= SEAT_SHIFT_M[1]:
                continue
            moved = loading.model_copy(update={"seat_shift_m": shift})
            if static_margins(chair, moved, climb.slope_rad, climb.spacing_m, heading_rad).worst >= MARGIN_LIMIT_RAD:
                return shift
    return None


def _too_heavy_for_the_brakes(chair: ChairDescription, payload_kg: float, climb: Climb) -> str | None:
    """Return the missing brake force of a belt on the flight, or None."""
    holds_n = chair.drives.brake_hold_n
    upright_n = BRAKE_RESERVE * 0.5 * Loading(chair=chair, payload_kg=payload_kg).weight_n
    needed_n = upright_n * math.sin(climb.slope_rad)
    if holds_n >= needed_n:
        return None
    return (
        f"each belt's brake holds {holds_n:.0f} N and needs {needed_n:.0f} N with {payload_kg:g} kg on "
        f"{climb.slope_rad / DEG:.1f}°; take less payload, or {climb.below(math.asin(holds_n / upright_n))}"
    )


def _too_steep_for_the_seat(reach_rad: float, climb: Climb) -> str | None:
    needed = climb.slope_rad + SEAT_RESERVE_RAD
    if reach_rad >= needed:
        return None
    return f"the seat reaches {reach_rad / DEG:.0f}°, the {climb.name} needs {needed / DEG:.0f}°; lengthen its stroke"


def _too_wide_a_gap(scenario: Scenario, tracks: Tracks) -> str | None:
    """Return where missing or long steps leave a track on one nosing: a track must span any three neighbouring nosings.

    The flat run alone counts: a flipper yields to its load, and bridges no gap.
    """
    needed_m = widest_spacing_m(scenario, 2)
    if not (scenario.stair.missing_steps or scenario.step) or tracks.flat_run_m > needed_m:
        return None
    what = "missing steps" if scenario.stair.missing_steps else "steps of their own"
    return (
        f"{what} leave three neighbouring nosings {needed_m:.2f} m apart, and the track spans "
        f"{tracks.flat_run_m:.2f} m; mend the steps or use a longer track"
    )


def _undetectable_steps(scenario: Scenario, climb: Climb) -> str | None:
    """Return a refusal of steps outside the detector's range, of which it accepts no frame, or frames of half steps."""
    stair, control, detects = scenario.stair, scenario.control, scenario.sensors.camera_model != "statistical"
    is_low = stair.steps == 1 and climb.rise_m < SINGLE_RISE_M[0]
    if is_low and detects and control.loop == "closed" and control.vision == "robust":
        seen = f"the detector sees single steps from {SINGLE_RISE_M[0]:g} m on"
        return f"a threshold of {climb.rise_m:.3f} m is ground: {seen}; drive over it by hand"
    (least_rise, most_rise), (least_run, most_run) = RISE_M, RUN_M
    is_detectable = least_rise <= stair.rise_m <= most_rise and least_run <= stair.run_m <= most_run
    if is_detectable or stair.steps == 1 or control.loop == "open" or control.vision != "robust":
        return None
    return (
        f"steps of {stair.rise_m:.3f} by {stair.run_m:.3f} m, and the detector accepts rises of {least_rise:g} to {most_rise:g} m "
        f"and runs of {least_run:g} to {most_run:g} m; take another way"
    )


def _turning_flights(stair: Stair) -> str | None:
    """Return a refusal of turning flights: the mission drives straight over a landing, and would leave its far end."""
    if stair.turn == "none":
        return None
    where = f"{stair.flights} flights turn {stair.turn} at their landings"
    return f"{where}, and the chair drives straight on over a landing; take another way"


def _winders(stair: Stair) -> str | None:
    """Refuse winders: at their nosings the two belts do not climb alike, and the mission drives straight on."""
    plan = as_designed(stair).winders
    if plan is None:
        return None
    inner_m, outer_m = plan.going_m(plan.newel_m), plan.going_m(plan.outer_radius_m)
    return (
        f"{plan.count} winders from step {plan.first} on turn the flight by {stair.winder_turn_deg:g}° to the {stair.winder_to}, "
        f"{inner_m:.2f} m deep at the newel and {outer_m:.2f} m at the outer side: the belt on the newel's side meets each nosing "
        "first and rolls the chair, which drives straight on; take another way"
    )


def _too_short_a_landing(stair: Stair, tracks: Tracks) -> str | None:
    """Return the required depth of a landing between flights: room for the whole chair and a view of the next flight."""
    needed_m = tracks.flat_run_m + tracks.approach_m + LANDING_SPARE_M
    if stair.flights == 1 or stair.between_m >= needed_m:
        return None
    return f"the landing between two flights is {stair.between_m:.2f} m deep, the chair needs {needed_m:.2f} m; take another way"


def _too_short_to_arrive(scenario: Scenario, chair: ChairDescription) -> str | None:
    """Return the depth of the uppermost landing that a chair going up needs: its belts, and what follows them."""
    stair, tracks = scenario.stair, chair.tracks
    if scenario.drive.direction == "down" or scenario.control.loop == "open" or scenario.start.place == "flight":
        return None
    needed_m, what = length_m(stair, tracks), "the flipper before the wall at its end"
    if not stair.end_wall:
        needed_m, what = needed_m + END_CLEAR_M, f"{END_CLEAR_M:.2f} m to the drop at its end"
    if (depth_m := max(stair.landing_m, stair.run_m)) >= needed_m:
        return None
    return (
        f"the landing is {depth_m:.2f} m deep, a chair that goes up needs {needed_m:.2f} m: its belts, and {what}; take another "
        "way, or give stair.landing_m with the floor that follows"
    )
