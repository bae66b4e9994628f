"""Moments of a run that its log does not name: ``Recording -> Findings``.

The crossing of the flight's ends by the pitch, injected faults, slipping, spans without camera frames or without a perceived stair,
holds with the events that led to them, and the least tip-over margin with its direction. The player page draws them; a live view
can call the same functions on what it has recorded so far.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float

from treadline.core.angles import DEG
from treadline.core.rotations import Rotation, Vector3, rotation_of
from treadline.core.signals import ROUNDING_S, Event
from treadline.guard import SILENCE_S
from treadline.playback._nosings import FrameNosings, perceived_nosings
from treadline.playback._recording import GUARD, Recording
from treadline.scenario.chair import ChairDescription
from treadline.scenario.faults import EXTENTS, Fault, payload_shift_m
from treadline.vehicle.bodies import centre_of_mass
from treadline.vehicle.stair_solids import bearing_edges, ground_m, stair_surfaces
from treadline.vehicle.staircase import Staircase
from treadline.vehicle.tip_over_margin import ROCKING, Margins, Support, tipping_margins
from treadline.vehicle.tracks import sections

SETTLED_RAD = 1.0 * DEG
"""Pitch within which a chassis counts as level, or as parallel to the flight [rad]: above the noise and the gravity error of an
IMU, and above the wobble on steps with 4 mm of jitter. Half and twice the value move the crest's moments by at most 0.23 s on two
climbs of 28°."""
TURNED_SHARE = 0.9
"""Share of the slope that the median pitch on a flight exceeds; jitter of the steps changes the slope by less than a tenth."""
CONTACT_M = 0.002
"""Largest gap of a contact between pulley and ground, or between nosing and flipper [m]. From 0.5 mm to 8 mm the share of samples
whose margin agrees with the simulator's within 2° changes by at most three hundredths."""

Kind = Literal["event", "motion", "fault", "perception"]
Direction = Literal["forward", "backward", "left", "right"]
DIRECTIONS: dict[Direction, str] = {"forward": "uphill", "backward": "downhill", "left": "left", "right": "right"}
"""Directions of tipping over, as seen from the chair, and the margin of each in ``Margins``, which is named on an ascent."""


END_NAMES: dict[tuple[str, bool], tuple[str, str]] = {
    ("foot", True): ("front lifts onto the first nosing", "parallel to the flight"),
    ("top", False): ("tips over the top edge", "level on the landing"),
    ("top", True): ("tips over the top edge", "parallel to the flight"),
    ("foot", False): ("lower end on the floor", "level on the floor"),
}
"""Names of the beginning and the end of a transition, by the end of the flight, and by whether the chassis turns to its slope."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Moment:
    """Instant or span of a run."""

    t_s: float
    name: str
    cause: str
    kind: Kind = "event"
    """Origin: event of the log, motion of the chassis, injected fault, or perception."""
    end_s: float | None = None
    """End of a span [s]; None for an instant."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Hold:
    """Span in which the guard holds the chair."""

    start_s: float
    end_s: float
    cause: str
    """Cause with measurement and limit, as far as they are logged."""
    chain: tuple[Moment, ...]
    """Fault, slip and guard events that preceded the hold in the same phase, in order of time."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Findings:
    """Everything that the functions of this module say about a run."""

    moments: tuple[Moment, ...]
    """Events of the log and all other moments, in order of time."""
    holds: tuple[Hold, ...]
    nosings: tuple[FrameNosings, ...] | None
    """Nosings of each frame with a perceived stair; None if the stair or the chair's place is unknown."""
    margin: tuple[float, float, Direction | None] | None
    """Least tip-over margin, see ``least_margin``."""

    @property
    def margin_text(self) -> str:
        """Least tip-over margin with its direction and time; empty without margins."""
        if self.margin is None:
            return ""
        t_s, margin_rad, direction = self.margin
        return f"least tip-over margin {margin_rad / DEG:.1f}°{f' {direction}' if direction else ''} at {t_s:.2f} s"


def findings_of(recording: Recording) -> Findings:
    """Return all moments, holds and perceived nosings of a run."""
    found = [Moment(t_s=event.t_s, name=event.name, cause=event.cause) for event in recording.events]
    if len(recording.t_s):
        found += crossings(recording)
        found += fault_moments(recording)
        found += slipping(recording)
        found += silences(recording)
    return Findings(
        moments=tuple(sorted(found, key=lambda moment: moment.t_s)),
        holds=holds_of(recording),
        nosings=perceived_nosings(recording),
        margin=least_margin(recording),
    )


# ---- ends of the flight ----


def on_flight(recording: Recording) -> Bool[np.ndarray, " T"]:
    """Return at which samples the chassis is on a flight: above 0.6 of its slope, and until the pitch is below 0.4 of it."""
    share = np.nan_to_num(np.abs(recording.pitch_rad)) / _slope_rad(recording)
    decided = (share > 0.6) | (share < 0.4)
    last = np.maximum.accumulate(np.where(decided, np.arange(len(share)), -1))
    return np.asarray(np.where(last >= 0, share[last] > 0.5, share > 0.5))


def _slope_rad(recording: Recording) -> float:
    """Return the slope of the flight: of the stair, or the largest pitch that half of the steep samples exceed."""
    if recording.scenario is not None:
        return recording.scenario.stair.slope_rad
    pitch = np.abs(recording.pitch_rad[np.isfinite(recording.pitch_rad)])
    steep = pitch[pitch > 0.5 * pitch.max(initial=0.0)]
    return max(float(np.median(steep)) if len(steep) else 0.0, 4.0 * SETTLED_RAD)


def crossings(recording: Recording) -> tuple[Moment, ...]:
    """Return when the chassis leaves and reaches the slope of a flight, and when it becomes level, from the pitch alone.

    Each transition between level and flight passes half the slope (``on_flight``). The moments are the last sample within
    ``SETTLED_RAD`` of the attitude before, and the first within ``SETTLED_RAD`` of the attitude after it.

    A flight to whose slope the chassis never turned has no moments.
    """
    t_s, pitch = recording.t_s, np.nan_to_num(np.abs(recording.pitch_rad))
    steep = on_flight(recording)
    turns = np.flatnonzero(np.diff(steep.astype(int)))
    found: list[Moment] = []
    for number, k in enumerate(turns):
        rises = bool(steep[k + 1])
        before = turns[number - 1] + 1 if number else 0
        after = turns[number + 1] + 1 if number + 1 < len(turns) else len(t_s)
        flight = slice(k + 1, after) if rises else slice(before, k + 1)
        plateau = float(np.median(pitch[flight]))
        if plateau < TURNED_SHARE * _slope_rad(recording):
            continue
        is_level, is_parallel = pitch <= SETTLED_RAD, pitch >= plateau - SETTLED_RAD
        left = np.flatnonzero((is_level if rises else is_parallel)[before : k + 1])
        reached = np.flatnonzero((is_parallel if rises else is_level)[k + 1 : after])
        names = END_NAMES["top" if _is_top(recording, int(k), flight, rises=rises) else "foot", rises]
        slope, within = f"the slope of {plateau / DEG:.1f}°", f"{SETTLED_RAD / DEG:g}°"
        was, becomes = ("level", slope) if rises else (slope, "level")
        causes = f"the pitch departs from {was} by {within}", f"the pitch is within {within} of {becomes}"
        if left.size:
            found.append(Moment(t_s=float(t_s[before + left[-1]]), name=names[0], cause=causes[0], kind="motion"))
        if reached.size:
            found.append(Moment(t_s=float(t_s[k + 1 + reached[0]]), name=names[1], cause=causes[1], kind="motion"))
    return tuple(found)


def _is_top(recording: Recording, k: int, flight: slice, *, rises: bool) -> bool:
    """Return whether a transition is at the upper end of a flight: by height, or without poses by the direction of the belts."""
    if recording.has_poses:
        return bool(recording.p_WB[k, 2] > np.median(recording.p_WB[flight, 2]))
    travel_m = np.nan_to_num(recording.belt_m_s[flight]).mean(axis=1)
    climbs = float((travel_m * np.sign(np.nan_to_num(recording.pitch_rad[flight]))).sum()) >= 0.0
    return climbs != rises


# ---- faults, slip, camera ----


def fault_moments(recording: Recording) -> tuple[Moment, ...]:
    """Return the injected faults that begin within the run."""
    end_s = recording.duration_s
    return tuple(
        Moment(
            t_s=fault.at_s,
            name="fault",
            cause=f"{described(fault)}, until {fault.at_s + fault.for_s:.1f} s",
            kind="fault",
            end_s=min(fault.at_s + fault.for_s, end_s),
        )
        for fault in (() if recording.scenario is None else recording.scenario.fault)
        if fault.at_s <= end_s + ROUNDING_S
    )


def described(fault: Fault) -> str:
    """Return kind, magnitude and meaning of a fault."""
    extent = EXTENTS[fault.kind]
    kind = fault.kind.replace("_", " ")
    if extent.low == extent.high:
        return f"{kind} injected: {extent.means.removeprefix('unused: ')}"
    return f"{kind} injected: {extent.means} = {fault.size:g}"


def slipping(recording: Recording) -> tuple[Moment, ...]:
    """Return the spans in which the friction cannot carry the chair on the flight, by ground truth.

    Pauses shorter than the window of the slip ratio are part of a span.
    """
    use = np.nan_to_num(recording.friction_use)
    slides = np.r_[False, (use >= 1.0) & on_flight(recording), False]
    edges = np.flatnonzero(np.diff(slides.astype(int)))
    apart = np.ones(len(edges), dtype=bool)
    pauses = np.flatnonzero(recording.t_s[edges[2::2]] - recording.t_s[edges[1:-1:2] - 1] < GUARD["lasting_s"])
    apart[2 * pauses + 1] = apart[2 * pauses + 2] = False
    return tuple(
        Moment(
            t_s=float(recording.t_s[first]),
            name="slip",
            cause=f"the flight needs {use[first:last].max():.0%} of the friction there is: the belts slide",
            kind="motion",
            end_s=float(recording.t_s[last - 1]),
        )
        for first, last in edges[apart].reshape(-1, 2)
    )


def silences(recording: Recording) -> tuple[Moment, ...]:
    """Return the spans without a camera frame, and those in which no frame shows a stair."""
    exposures_s, start_s, end_s = recording.exposures_s, float(recording.t_s[0]), recording.duration_s
    found = []
    for a, b in _gaps(exposures_s, start_s, end_s) if exposures_s is not None else ():
        found.append(Moment(t_s=a, name="no camera frame", cause=f"from {a:.2f} s to {b:.2f} s", kind="perception", end_s=b))
    if recording.maps or (exposures_s is not None and len(exposures_s)):
        for a, b in _gaps(np.array([seen.t_s for seen in recording.maps]), start_s, end_s):
            span = f"from {a:.2f} s to {b:.2f} s"
            if exposures_s is None:
                cause = f"{span}; the log does not say whether there were frames"
            else:
                frames = int(((exposures_s > a + ROUNDING_S) & (exposures_s < b - ROUNDING_S)).sum())
                if not frames:
                    continue  # the camera is silent
                cause = f"{span}: {frames} frames, none with a stair"
            found.append(Moment(t_s=a, name="no stair perceived", cause=cause, kind="perception", end_s=b))
    return tuple(found)


def _gaps(times_s: Float[np.ndarray, " n"], start_s: float, end_s: float) -> list[tuple[float, float]]:
    inside = times_s[(times_s >= start_s) & (times_s <= end_s)]
    edges = np.concatenate([[start_s], inside, [end_s]])
    return [(float(a), float(b)) for a, b in pairwise(edges) if b - a > SILENCE_S + ROUNDING_S]


# ---- holds ----


def holding_at(events: Iterable[Event], t_s: float) -> Event | None:
    """Return the event of the hold that lasts at a time; None if the guard does not hold."""
    changes = [event for event in events if event.t_s <= t_s + ROUNDING_S and event.name in ("hold", "rearmed")]
    return changes[-1] if changes and changes[-1].name == "hold" else None


def holds_of(recording: Recording) -> tuple[Hold, ...]:
    """Return each hold with its cause in full and with what preceded it."""
    found = []
    events = recording.events
    reasons = (*fault_moments(recording), *slipping(recording)) if len(recording.t_s) else ()
    for k, event in enumerate(events):
        if event.name != "hold":
            continue
        end_s = next((later.t_s for later in events[k + 1 :] if later.name == "rearmed"), recording.duration_s)
        found.append(
            Hold(
                start_s=event.t_s,
                end_s=max(end_s, event.t_s),
                cause=full_cause(event, recording),
                chain=_chain(event, recording, reasons),
            )
        )
    return tuple(found)


def full_cause(hold: Event, recording: Recording) -> str:
    """Return the cause of a hold; for a roll-back with the guard's limit and the ground truth, as far as both are known."""
    if not hold.cause.startswith("rolled back"):
        return hold.cause
    limit_m = recording.limits.roll_back_m
    parts = [f"{hold.cause} as the guard measured it from the nosings"]
    if limit_m is not None:
        parts.append(f"limit {limit_m:.2f} m")
    climbs = recording.scenario is not None and recording.scenario.drive.direction == "up"
    if climbs and (true_m := roll_back_m(recording, hold.t_s)) is not None:
        parts.append(f"ground truth {true_m:.2f} m")
    return ", ".join(parts)


def roll_back_m(recording: Recording, t_s: float) -> float | None:
    """Return the distance that the chair has moved down from its highest place on the flight until a time [m], by ground truth."""
    up = recording.place_S[: recording.index_at(t_s) + 1, 0]
    return float(np.max(up) - up[-1]) if len(up) and np.isfinite(up).all() else None


def _chain(hold: Event, recording: Recording, reasons: Iterable[Moment]) -> tuple[Moment, ...]:
    """Return faults and slip in the phase of the hold, and the guard's interventions since the first of them.

    Args:
        reasons: All faults and all slip of the run.
    """
    phase = recording.phase_at(hold.t_s)
    since_s = recording.t_s[0] if phase is None else phase.start_s
    before = [
        moment for moment in reasons if moment.t_s <= hold.t_s + ROUNDING_S and (moment.end_s is None or moment.end_s >= since_s)
    ]
    since_s = min((moment.t_s for moment in before), default=since_s)
    slowed = [
        Moment(t_s=event.t_s, name=event.name, cause=event.cause)
        for event in recording.events
        if event.name == "slow" and since_s <= event.t_s <= hold.t_s
    ]
    return tuple(sorted([*before, *slowed], key=lambda moment: moment.t_s))


# ---- tip-over margin ----


def least_margin(recording: Recording) -> tuple[float, float, Direction | None] | None:
    """Return time [s], least tip-over margin [rad] and its direction, None where it is ambiguous; None without margins."""
    if not np.isfinite(recording.margin_rad).any():
        return None
    k = int(np.nanargmin(recording.margin_rad))
    return float(recording.t_s[k]), float(recording.margin_rad[k]), tipping_direction(recording, k)


def tipping_direction(recording: Recording, k: int) -> Direction | None:
    """Return the direction in which the chair would tip first at a sample.

    The margins of the four directions follow from pose, stair and load. The direction is given only if its margin deviates less
    from the logged one than the margin of any other direction does.
    """
    margins, logged = margins_at(recording, k), float(recording.margin_rad[k])
    if margins is None or not math.isfinite(logged):
        return None
    values = {direction: getattr(margins, name) for direction, name in DIRECTIONS.items()}
    least, second = sorted(values, key=lambda direction: values[direction])[:2]
    return least if abs(values[least] - logged) < abs(values[second] - logged) else None


def margins_at(recording: Recording, k: int) -> Margins | None:
    """Return the four tip-over margins at a sample, from pose, stair and load; None if one of them is unknown or nothing supports.

    A front margin is ``uphill`` and a rear margin is ``downhill``, as on an ascent.
    """
    scenario, staircase = recording.scenario, recording.staircase
    if scenario is None or staircase is None or not np.isfinite(recording.p_WB[k]).all():
        return None
    R_WB, p_WB, flipper_rad = rotation_of(recording.quat_WB[k]), recording.p_WB[k], float(recording.flipper_rad[k])
    support = support_at(recording.chair, staircase, R_WB, p_WB, flipper_rad)
    if support is None:
        return None
    chair, t_s = scenario.chair, float(recording.t_s[k])
    loading = chair.leaning(chair.sway_at(t_s)).moved(payload_shift_m(scenario.fault, t_s))
    com = centre_of_mass(recording.chair, loading, float(recording.seat_rad[k]), flipper_rad)
    up_x, up_y, up_z = R_WB[2].tolist()
    return tipping_margins(com, (up_x, up_y, up_z), support)


def support_at(chair: ChairDescription, staircase: Staircase, R_WB: Rotation, p_WB: Vector3, flipper_rad: float) -> Support | None:
    """Return the support by nosings under the belts, by ground under the pulleys, and by the flipper's tip; None without any.

    The outline of a section of the belts has the distance of its pulleys' radii from the line through their axes.
    """
    rounded = bearing_edges(staircase)
    edges, radii_m = ((rounded[:, :3] - p_WB) @ R_WB)[:, [0, 2]], rounded[:, 3]
    edge_gaps, under_m, under_gaps = np.full(len(edges), np.inf), [edges[:, 0]], []
    surfaces = stair_surfaces(staircase)
    for section in sections(chair):
        axes = np.array([section.start_m, section.end_m(flipper_rad)])
        along = axes[1] - axes[0]
        share = np.clip((edges - axes[0]) @ along / section.length_m**2, 0.0, 1.0)
        outline_m = section.radii_m[0] + share * (section.radii_m[1] - section.radii_m[0])
        off_m = np.linalg.norm(edges - axes[0] - share[:, None] * along, axis=1)
        edge_gaps = np.minimum(edge_gaps, off_m - outline_m - radii_m)
        ends_W = p_WB + np.array([[x, side * 0.5 * section.gauge_m, z] for x, z in axes for side in (-1.0, 1.0)]) @ R_WB.T
        under_gaps.append((ends_W[:, 2] - ground_m(surfaces, ends_W)).reshape(-1, 2).min(axis=1) - section.radii_m)
        under_m.append(axes[:, 0] - np.array(section.radii_m) * R_WB[2, 0])  # a pulley's lowest point is below its axis in W
    places, gaps = np.concatenate(under_m), np.concatenate([edge_gaps, *under_gaps])
    side_m = 0.5 * (chair.tracks.gauge_m + chair.tracks.belt_width_m)
    touching = places[gaps <= CONTACT_M]
    if not touching.size:
        return None
    away = np.maximum(places - touching.max(), touching.min() - places)
    reach = places[(gaps <= CONTACT_M) | (gaps <= ROCKING * away)]
    return Support(front_m=float(reach.max()), rear_m=-float(reach.min()), left_m=side_m, right_m=side_m)
