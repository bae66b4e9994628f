"""``treadline check``: whether a chair may climb a stair, judged by mechanics before any motion.

``Scenario, ChairDescription, MissionConfig -> CheckReport``. What a map or a data sheet excludes is refused at once; else the
mission's planner walks the whole ground (``run.walker``), and a scenario is ``go`` exactly where that walk is quiet. Each refusal
states its number and a remedy; a remedy against an unquiet walk has been walked.
"""

import itertools
import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from treadline.core.angles import DEG, radians_hint
from treadline.core.errors import MechanicsError, SettingsError
from treadline.core.printing import Printable
from treadline.core.step_sizes import RISE_M, RUN_M, SINGLE_RISE_M, TURN_CLEAR_M
from treadline.mission.entry_check import beyond_rating
from treadline.mission.mission_config import MissionConfig
from treadline.run.walker import walk
from treadline.scenario.chair import ChairDescription, Faces, Tracks
from treadline.scenario.scenario import SEAT_SHIFT_M, Chair, Scenario, Stair
from treadline.vehicle.bodies import centre_of_mass, oversized_lugs
from treadline.vehicle.climb import Climb, climb_of
from treadline.vehicle.landing_turn import OFF_PLAN_M, least_landing_m, way_over
from treadline.vehicle.linkage import SeatLinkage
from treadline.vehicle.loading import Loading
from treadline.vehicle.rest_poses import nosings_of, rest_chair
from treadline.vehicle.staircase import as_designed
from treadline.vehicle.start_checks import HEADROOM_M, checked_start, crossing_flights, outline_of
from treadline.vehicle.start_pose import length_m
from treadline.vehicle.tip_over_margin import MARGIN_LIMIT_RAD, UNKNOWN_RAD, Margins, sideways_margins
from treadline.vehicle.tracks import minimum_track_length, nosings_touched, track_on_stair_m
from treadline.vehicle.traction import friction_needed, friction_use, shortage
from treadline.vehicle.walk import QUIET_RAD_S, Stride, Walk
from treadline.vehicle.way import QUIET_M_S, find_way

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SEAT_RESERVE_RAD = 3.0 * DEG
"""Required range of the seat beyond the slope [rad]: the chair rocks over nosings."""
BRAKE_RESERVE = 1.5
"""Required ratio of a belt's brake force to half of the downhill force: an off-centre payload loads one belt by an eighth more, and
a stop from cruise speed needs another sixth."""
TURNED_RAD = 2.0 * DEG
"""Largest difference in direction of neighbouring nosings [rad]: over the gauge of 0.65 m one side lies 23 mm further, twice
the deviation of a run."""
LEAST_RAD = MARGIN_LIMIT_RAD - UNKNOWN_RAD
"""Least tip-over margin on the way [rad]."""
SHIFTS_M = (0.02, -0.02, 0.05, -0.05, 0.1, -0.1)
"""Shifts of the seat that are tried as a remedy, and applied before a traversal [m]."""
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
    faces: Faces = "up"
    """Where the passenger looks on the stair."""
    flipper_torque_n_m: float | None = None
    """Largest torque that the flipper's motor bears on the way [N m]; None without a flipper or a walk."""
    walk: Walk | None = None
    """The planner's way over the whole ground, for plots; None where the scenario is refused without it."""

    def __bool__(self) -> bool:
        """Return whether the scenario may be driven."""
        return self.verdict == "go"

    def plot(self) -> "Figure":
        """Return the figure of the walk: the chair at five places, and angles, margins, pitch rate and torque along the way.

        Raises:
            SettingsError: If the scenario is refused for a reason that needs no walk.
        """
        if self.walk is None:
            raise SettingsError(f"there is nothing to draw: {self.reasons[0]}")
        return self.walk.plot()

    def printed(self) -> tuple[str, list[tuple[str, str]]]:
        """Return the verdict, the margins and the reasons."""
        margins = ", ".join(f"{side} {angle:.1f}°" for side, angle in self.stability_margin_deg.items())
        longer_m = self.track_length_margin_m
        count = self.nosings_in_contact
        seat = (
            "no seat linkage" if (held := self.seat_range_deg) is None else f"level from {held[0]:.0f}° to {held[1]:.0f}° of pitch"
        )
        bears = f"{count} nosing{'' if count == 1 else 's'} in contact"
        rows = [
            *([] if longer_m is None else [("track length", f"{longer_m:+.3f} m over 2√(h²+w²), {bears}")]),
            (
                "friction",
                f"{self.friction_needed_with_reserve:.2f} needed ({self.friction_needed:.2f} to stand, and a reserve for jolts), "
                f"{self.friction_available:.2f} available",
            ),
            ("tip-over margins", margins),
            ("seat", seat),
            *([] if self.flipper_torque_n_m is None else [("flipper", f"{self.flipper_torque_n_m:.0f} N m at most")]),
            *([("passenger", "looks down the stair: up rear first, down front first")] if self.faces == "down" else []),
            *([] if self.nosings_in_view is None else [("camera", f"nosings in view from the start: {self.nosings_in_view}")]),
            *(("reason", reason) for reason in self.reasons),
            *(("warning", warning) for warning in self.warnings),
        ]
        return self.verdict, rows


def check(scenario: Scenario, chair: ChairDescription, mission: MissionConfig) -> CheckReport:
    """Return the verdict on a scenario.

    Args:
        mission: The mission, with what the operator would enter.

    Raises:
        MechanicsError: If flights cross, or the chair cannot stand where it starts.
    """
    stair, loading = scenario.stair, scenario.chair.entered
    crossed = crossing_flights(as_designed(stair))
    if crossed is not None:
        raise MechanicsError(f"flights {crossed[0]} and {crossed[1]} cross, less than {HEADROOM_M:g} m above each other; turn one")
    start_problems, nosings_in_view = checked_start(scenario, chair)
    # On floor and landing the chair turns square before it enters.
    heading = scenario.start.heading_deg * DEG if scenario.start.place == "flight" else 0.0
    climb = climb_of(scenario, chair)
    slope = climb.slope_rad
    seat_range = None if chair.seat is None else SeatLinkage(chair.seat).angle_range
    length_m = track_on_stair_m(chair)
    is_flight = climb.is_flight
    possible = (
        beyond_rating(chair, slope, loading.payload_kg, climb.steepness),
        shortage(slope, heading, stair.mean_friction, climb.below),
        _too_heavy_for_the_brakes(chair, loading.payload_kg, climb),
        None if seat_range is None else _too_steep_for_the_seat(seat_range[1], climb),
        _no_seat_to_shift(scenario.chair, chair),
        _too_short_to_arrive(scenario, chair),
        _undetectable_steps(scenario, climb),
        _landings(scenario, chair),
        _winders(stair, chair.tracks),
        _turned_nosings(scenario),
        *start_problems,
        oversized_lugs(scenario.belts, chair),
    )
    reasons = [reason for reason in possible if reason is not None]
    walked = None if reasons else walk(scenario, chair, mission)
    margins = least_margins(chair, loading, climb, heading, walked)
    shift = None
    if walked is not None:
        unquiet, shift = _unquiet(scenario, chair, mission, walked)
        reasons += [reason for reason in (unquiet, _leans(margins)) if reason is not None]
    return CheckReport(
        verdict="refuse" if reasons else "go",
        reasons=reasons,
        track_length_margin_m=length_m - max(minimum_track_length(*size_m) for size_m in stair.sizes_m) if is_flight else None,
        nosings_in_contact=nosings_touched(length_m, climb.pitch_m, climb.pitch_m) if is_flight else 1,
        friction_needed=math.tan(slope),
        friction_needed_with_reserve=friction_needed(slope),
        friction_available=stair.mean_friction[0],
        friction_use_at_start=friction_use(slope, heading, stair.mean_friction),
        stability_margin_deg={side: margin_rad / DEG for side, margin_rad in asdict(margins).items()},
        seat_range_deg=None if seat_range is None else (seat_range[0] / DEG, seat_range[1] / DEG),
        proposed_seat_shift_m=shift,
        warnings=_unit_warnings(scenario, chair),
        nosings_in_view=nosings_in_view,
        faces=chair.faces,
        flipper_torque_n_m=None if walked is None or chair.flipper is None else max(walked.hardest.pose.torques_n_m),
        walk=walked,
    )


def least_margins(chair: ChairDescription, loading: Chair, climb: Climb, heading_rad: float, walked: Walk | None) -> Margins:
    """Return the least tip-over margins on the way; without a walk, those of a long flight with such steps.

    A front margin is ``uphill`` and a rear margin is ``downhill``: the flipper is uphill in both directions. Sideways the chair
    stands on its belts' outer edges.
    """
    slope_rad = climb.slope_rad
    up = (math.sin(slope_rad) * math.cos(heading_rad), -math.sin(slope_rad) * math.sin(heading_rad), math.cos(slope_rad))
    left, right = sideways_margins(chair.tracks, centre_of_mass(chair, loading, math.asin(up[0])), up)
    if walked is not None:
        front, rear = walked.least_front.pose.front_margin_rad, walked.least_rear.pose.rear_margin_rad
    else:
        offset_m = chair.in_chair(loading.payload_offset_m)
        loaded = rest_chair(chair, loading.payload_kg, offset_m=offset_m, seat_shift_m=loading.seat_shift_m)
        front, rear = loaded.least_margins(climb.rise_m, math.sqrt(climb.pitch_m**2 - climb.rise_m**2), (0.0,))
    return Margins(uphill=front, downhill=rear, left=left, right=right)


def _unquiet(scenario: Scenario, chair: ChairDescription, mission: MissionConfig, walked: Walk) -> tuple[str | None, float | None]:
    """Return why a walk is not quiet, with the first remedy that makes it so, and the seat shift if that is the remedy."""
    why = _fault_of(walked)
    if why is None:
        return None, None
    for remedy, changed, other, tuned, shift_m in _remedies(scenario, chair, mission):
        if _fault_of(walk(changed, other, tuned, until_rad_s=QUIET_RAD_S)) is None:
            return f"{why}; {remedy}", shift_m
    return f"{why}; {_by_another_motion(walked, chair)}take another way", None


def _by_another_motion(walked: Walk, chair: ChairDescription) -> str:
    """Return that another motion of the flipper would be quiet, with the torque it needs; empty if none would."""
    if chair.flipper is None:
        return ""
    low_deg, high_deg = chair.flipper.range_deg
    start, nosings = walked.strides[0].pose, nosings_of(walked.ground)[:, 0]
    end_m = float(nosings[-1 if start.x_m < nosings[0] else 0]) + math.copysign(chair.reach_m, nosings.mean() - start.x_m)
    way = find_way(walked.chair, walked.ground, start, end_m, (low_deg * DEG, high_deg * DEG))
    if way is None or way.margin_rad < LEAST_RAD or way.fall_m_s > QUIET_M_S:
        return ""
    return f"the planner's flipper is at fault, for a motion with {way.torque_n_m:.0f} N m would be quiet; "


def _fault_of(walked: Walk) -> str | None:
    """Return the worst moment of a walk that does not end well, or not quietly, in words."""
    last, fastest = walked.strides[-1], walked.fastest
    if fastest.rate_rad_s >= QUIET_RAD_S:
        why = f"{_where(walked, fastest)} the chair would turn at {fastest.rate_rad_s / DEG:.0f}°/s, above {QUIET_RAD_S / DEG:g}"
        fallen_deg = 0.0 if fastest.fall is None else fastest.fall.angle_rad / DEG
        return f"{why}, in a fall of {fallen_deg:.0f}°" if fallen_deg >= 1.0 else why
    front, rear = walked.least_front, walked.least_rear
    side, least, margin_rad = min(
        ("front", front, front.pose.front_margin_rad), ("rear", rear, rear.pose.rear_margin_rad), key=lambda item: item[2]
    )
    if margin_rad < LEAST_RAD:
        return f"{_where(walked, least)} {margin_rad / DEG:.1f}° are left to tipping over the {side}, below {LEAST_RAD / DEG:g}°"
    if walked.end in ("held", "refused", "tipped"):
        return f"{_where(walked, last)}: {walked.cause.removesuffix('; take another way')}"
    return None


def _where(walked: Walk, stride: Stride) -> str:
    """Return the place of an instant in words."""
    ends = nosings_of(walked.ground)[:, 0]
    nearest = int(np.argmin(np.abs(ends - stride.pose.com_m[0]))) if ends.size else 0
    named = "the last nosing" if nearest == ends.size - 1 else f"nosing {nearest}"
    return f"at {named}, {stride.t_s:.0f} s after the start ({stride.phase})"


def _remedies(
    scenario: Scenario, chair: ChairDescription, mission: MissionConfig
) -> Iterator[tuple[str, Scenario, ChairDescription, MissionConfig, float | None]]:
    """Yield what may make a walk quiet: words, and the scenario, chair and mission with it; and the seat shift, if it is one."""
    at_m, load_kg = scenario.chair.seat_shift_m, scenario.chair.payload_kg
    for by_m in SHIFTS_M if chair.seat is not None else ():
        shift_m = round(at_m + by_m, 3)
        if SEAT_SHIFT_M[0] <= shift_m <= SEAT_SHIFT_M[1]:
            words = f"shift the seat {abs(by_m) * 1000.0:.0f} mm {'uphill' if by_m > 0.0 else 'downhill'}"
            moved = replace(mission, chair=chair.with_seat_shifted(shift_m))
            yield words, scenario.changed(chair={"seat_shift_m": shift_m}), chair, moved, shift_m
    for share in (0.75, 0.5):
        lighter_kg = float(round(share * load_kg))
        words = f"take {lighter_kg:.0f} kg at most"
        yield words, scenario.changed(chair={"payload_kg": lighter_kg}), chair, replace(mission, payload_kg=lighter_kg), None
    if chair.flipper is not None:
        for words, change in (
            (f"a flipper with {1.5 * chair.flipper.torque_n_m:.0f} N m would do", {"torque_n_m": 1.5 * chair.flipper.torque_n_m}),
            ("a flipper that turns down to -90° would do", {"range_deg": (-90.0, chair.flipper.range_deg[1])}),
        ):
            other = chair.changed(flipper=change)
            yield words, scenario, other, replace(mission, chair=mission.chair.changed(flipper=change)), None


def _leans(margins: Margins) -> str | None:
    """Return to which side the chair leans too much."""
    margin_rad, side = min((margins.left, "left"), (margins.right, "right"))
    if margin_rad >= MARGIN_LIMIT_RAD:
        return None
    text = f"the tipping margin {side} is {margin_rad / DEG:.1f}°, below {MARGIN_LIMIT_RAD / DEG:g}°; "
    return text + f"move the payload to the {'right' if side == 'left' else 'left'}, or start squarer"


def _unit_warnings(scenario: Scenario, chair: ChairDescription) -> list[str]:
    """Return the angles of the files that may be in radians."""
    angles = {
        "start.heading_deg": scenario.start.heading_deg,
        "tracks.approach_angle_deg": chair.tracks.approach_angle_deg,
        "camera.pitch_deg": chair.camera.pitch_deg,
        "rear_camera.pitch_deg": 0.0 if chair.rear_camera is None else chair.rear_camera.pitch_deg,
    }
    return [hint for name, angle_deg in angles.items() if (hint := radians_hint(name, angle_deg)) is not None]


def _no_seat_to_shift(loading: Chair, chair: ChairDescription) -> str | None:
    if chair.seat is not None or loading.seat_shift_m == 0.0:
        return None
    return (
        f"chair.seat_shift_m is {loading.seat_shift_m:g}, and chair '{chair.name}' has no seat linkage; leave it out, and give the "
        "payload's place in chair.payload_offset_m"
    )


def _turned_nosings(scenario: Scenario) -> str | None:
    """Return which nosing is turned so far against its neighbour that one belt leaves it before the other."""
    for steps in as_designed(scenario.stair, scenario.step, scenario.sill).straight_parts:
        for low, high in itertools.pairwise(steps):
            turned_rad = abs(high.yaw_rad - low.yaw_rad)
            if turned_rad > TURNED_RAD:
                turned = f"the nosings of steps {low.index} and {high.index} differ in direction by {turned_rad / DEG:.1f}°"
                return f"{turned}, above {TURNED_RAD / DEG:g}°: the chair would drop from one belt to the other; take another way"
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


def _undetectable_steps(scenario: Scenario, climb: Climb) -> str | None:
    """Return a refusal of steps outside the detector's range, of which it accepts no frame, or frames of half steps."""
    control, detects = scenario.control, scenario.sensors.camera_model != "statistical"
    is_low = not climb.is_flight and climb.rise_m < SINGLE_RISE_M[0]
    if is_low and detects and control.loop == "closed" and control.vision == "robust":
        seen = f"the detector sees single steps from {SINGLE_RISE_M[0]:g} m on"
        return f"a threshold of {climb.rise_m:.3f} m is ground: {seen}; drive over it by hand"
    (least_rise, most_rise), (least_run, most_run) = RISE_M, RUN_M
    outside = [
        (rise_m, run_m)
        for rise_m, run_m in scenario.stair.sizes_m
        if not (least_rise <= rise_m <= most_rise and least_run <= run_m <= most_run)
    ]
    if not outside or not climb.is_flight or control.loop == "open" or control.vision != "robust":
        return None
    return (
        f"steps of {outside[0][0]:.3f} by {outside[0][1]:.3f} m, and the detector accepts rises of {least_rise:g} to "
        f"{most_rise:g} m and runs of {least_run:g} to {most_run:g} m; take another way"
    )


def _winders(stair: Stair, tracks: Tracks) -> str | None:
    """Refuse winders: at their nosings the two belts do not climb alike, and the mission drives straight on."""
    plan = as_designed(stair).winders
    if plan is None:
        return None
    inner_m, newel_m, outer_m = plan.walking_radius_m - 0.5 * tracks.gauge_m, plan.newel_m, plan.outer_radius_m
    # On the next nosing, the belt at the newel lies on a slope of rise to inner depth; the other belt's nosing is further away.
    hangs = f", where the other belt would hang {stair.rise_m * tracks.gauge_m / inner_m:.2f} m over it" if inner_m > 0.0 else ""
    return (
        f"{plan.count} winders from step {plan.first} on turn the flight by {stair.winder_turn_deg:g}° to the {stair.winder_to}, "
        f"{plan.going_m(newel_m):.2f} m deep at the newel and {plan.going_m(outer_m):.2f} m at the outer side: the belt on the "
        f"newel's side meets each nosing first and rolls the chair{hangs}; take another way"
    )


def _landings(scenario: Scenario, chair: ChairDescription) -> str | None:
    """Return which landing is too small for the chair, or has sides that the camera does not measure."""
    staircase, off_m = as_designed(scenario.stair), None if scenario.drive.direction == "up" else chair.reach_m
    if staircase.winders is not None:
        return None
    outline = outline_of(chair).wider(TURN_CLEAR_M + OFF_PLAN_M)
    for plan, steps in zip(staircase.plans[:-1], staircase.flights, strict=False):
        where, own_m = f"the landing at step {steps[-1].index}", min(plan.depth_m, plan.left_m - plan.right_m)
        if not plan.turn_rad:
            needed_m = chair.tracks.flat_run_m + chair.tracks.approach_m + LANDING_SPARE_M
            if plan.depth_m < needed_m:
                between = f"the landing between two flights is {plan.depth_m:.2f} m deep"
                return f"{between}, the chair needs {needed_m:.2f} m; take another way"
            continue
        by = f"by {abs(plan.turn_rad) / DEG:.0f}°"
        if not len(way_over(plan, staircase.width_m, outline, off_m=off_m)):
            needed_m = 0.01 * math.ceil(100.0 * least_landing_m(plan, staircase.width_m, outline, off_m))
            return f"{where} is {own_m:.2f} m, this chair needs {needed_m:.2f} m to turn {by}; take another way"
    return None


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
