"""Stair tracker: positions of the nosings around the chair, from stair maps, with odometry between frames.

``ImuSample, TrackReading, StairMap -> StairTracker``. Positions are in a frame fixed to the stair, x horizontal and up the flight,
z up. Nosings are at rest in this frame, and odometry moves the chair. Maps correct the slip of the odometry while a nosing is in
view. A nosing that the chair has passed leaves the filter and keeps its last position, so that the cost of a map does not depend
on the length of the flight. A flight seen across a landing has a tracker of its own.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import Literal, NamedTuple

import numpy as np

from treadline.core.signals import Direction, ImuSample, Recent, SideKind, StairMap, TrackReading
from treadline.core.step_sizes import ON_A_FLIGHT_RAD
from treadline.estimation._nosing_filter import CORRELATED_M, FlightShape, NosingFilter
from treadline.estimation.known_nosings import KnownNosing, KnownNosings

SAME = 0.5
"""Distance, as a ratio of the pitch, within which a detection belongs to the nearest nosing or to none: half-way to the next."""
MISSING = 1.6
"""Distance of neighbouring nosings, as a ratio of the pitch of the stair, above which a nosing is missing between them."""
LANDING_RUNS = 2.5
"""Distance to the next nosing, as a ratio of the run, above which a landing lies between: one or two missing steps make a shorter
gap, a landing that a chair stands on a longer one."""
LANDING_SLOPE = 0.6
"""Slope to that nosing, as a ratio of the flight's slope, below which a landing lies between: a landing is one rise high whatever
its length, while missing steps keep to the slope."""
OFF_BELTS_M = 0.4
"""Height of the first nosing off the belts' line, on the side of a landing, above which it is not of the flight under the chair
[m]."""
NEXT_MAPS, NEXT_S, NEXT_M = 5, 1.0, 4.5
"""Number of maps that must have shown the next flight, time without a map after which its tracker starts again [s], and largest
distance of its nearest nosing [m]."""
MISSED_SHARE = 2.0
"""Ratio of maps without a nosing to maps with it, from which the nosing is a false detection and is forgotten."""
PASSED_M = 2.0 * CORRELATED_M
"""Distance behind mid-track from which a nosing is passed [m]: the camera looks the other way, and of the error that its detections
had in common with the next one of a chair that rolls back, e⁻² is left."""
KNOWN_AFTER = 2
"""Number of maps that must show a nosing, or the end of the flight, before it counts."""
GAP_KNOWN_AFTER = 6
"""Number of maps that must show both nosings at a gap before it counts; by then two of them would have shown a nosing between."""
SLIP_VALID_S = 0.35
"""Time after a map for which the measured slip is valid, with odometry alone [s]."""
SLIP_LAG_S = 0.3
"""Time constant of the slip speed [s]: a frame error of 2 mm makes 3 mm/s."""
SAME_SIDE_M = 0.08
"""Distance within which two frames show the same side [m]: errors of a side are below 2 cm, and the chair shifts as it turns."""

Side = Literal["left", "right"]
"""Side of a flight, in the chair's view."""


@dataclass(slots=True, eq=False)
class _Nosing:
    """One nosing in the frame of the tracker."""

    x_m: float
    z_m: float
    count: int
    missed: int = 0
    """Number of maps that showed nearer and further nosings, but not this one."""
    end_count: int = 0
    turn_count: int = 0
    turn_rad: float = 0.0
    """Turn of the step that follows this nosing, as the last of ``turn_count`` maps showed it [rad]."""

    @property
    def known(self) -> bool:
        """Whether enough maps have shown the nosing."""
        return self.count >= KNOWN_AFTER


@dataclass(slots=True)
class _Side:
    """What is known of one side of the flight, as lateral distances outward from the tracker's origin."""

    seen_m: tuple[float, float] = (-math.inf, -math.inf)
    """Distances to which nosings have been in view, the furthest of all maps and the second [m]; a single map proves nothing."""
    measured: bool = False
    """Whether a map has measured how far nosings are in view."""
    edge_m: float | None = None
    kind: SideKind | None = None
    count: int = 0
    """Number of consecutive maps with the side that showed it at the same place."""


class _Pose(NamedTuple):
    """Pose of the chair by odometry alone, in the frame of the tracker."""

    x_m: float
    y_m: float
    z_m: float
    pitch_rad: float
    heading_rad: float


class StairTracker:
    """Nosings around the chair, shape of the stair, walls, pitch and travel.

    Distances ahead are negative behind mid-track.
    """

    def __init__(self) -> None:
        self.heading_rad = 0.0
        """Heading estimate of the mission [rad], set by the planner."""
        self.pitch_rad = 0.0
        self.travel_m = 0.0
        """Belt travel since the start [m], negative backwards."""
        self.speed_m_s = 0.0
        self.rise_m = self.run_m = self.slope_rad = 0.0
        """Rise [m], run [m] and slope [rad] of the flight; zero before the first map."""
        self.left_wall_m: float | None = None
        self.right_wall_m: float | None = None
        self.map_count = 0
        self.map_s = -math.inf
        self._filter, self._shape = NosingFilter(), FlightShape()
        self._odometry_x_m = self._odometry_y_m = self._odometry_z_m = 0.0
        """Position by belts, pitch and heading alone [m], y to the left; maps do not correct it, so that differences are travel."""
        self._poses: Recent[_Pose] = Recent()
        self._highest_m = -math.inf
        self._slip_m_s = 0.0
        self._sides: dict[Side, _Side] = {"left": _Side(), "right": _Side()}
        self._tracks_s: float | None = None
        self._nosings: list[_Nosing] = []
        """Nosings around the chair, in the order of the filter."""
        self._passed: list[_Nosing] = []
        """Nosings behind the chair and out of view, the last one passed at the end."""
        self._known: list[_Nosing] = []
        """Nosings with enough detections, passed ones included, at the last map, the lowest of the flight first."""
        self._gaps: list[tuple[_Nosing, _Nosing]] = []
        """Nosings around the chair between which steps are missing, at the last map."""
        self._next: StairTracker | None = None
        """Tracker of the next flight, across a landing."""

    def update(self, signal: ImuSample | TrackReading | StairMap) -> None:
        """Update with one signal."""
        match signal:
            case TrackReading():
                self._drive(signal)
            case ImuSample():
                self._filter.drive(0.0, 0.0, signal.pitch_rad - self.pitch_rad, self.pitch_rad, 0.0)
                self.pitch_rad = signal.pitch_rad
                self._poses.add(signal.t_s, self._pose())
            case StairMap() if len(signal.nosings_B):
                if self._is_across(signal):
                    self._see_across(signal)
                else:
                    self._see(signal)
        if self._next is not None and not isinstance(signal, StairMap):
            self._next.heading_rad = self.heading_rad
            self._next.update(signal)

    def forget_poses(self) -> None:
        """Forget the chair's recent poses, which held no heading: frames exposed then are placed by the next pose."""
        self._poses = Recent()
        if self._next is not None:
            self._next.forget_poses()

    @property
    def shows_another(self) -> bool:
        """Whether maps have shown another flight nearby, across a landing."""
        beyond = self._next
        if beyond is None or beyond.map_count < NEXT_MAPS:
            return False
        return any(abs(nosing.x_m - beyond.x_m) < NEXT_M for nosing in beyond._known)  # noqa: SLF001 - of this class

    @property
    def known(self) -> bool:
        """Whether more than one map has shown the stair."""
        return self.map_count >= KNOWN_AFTER

    def ahead_m(self) -> list[float]:
        """Return the distance of each known nosing ahead of mid-track along the belts [m], the lowest of the flight first."""
        return [self._ahead_m(nosing) for nosing in self._known]

    def ahead_sigma_m(self) -> list[float]:
        """Return the standard deviation of each of ``ahead_m`` [m]; it grows with travel since the last map.

        Infinite for a nosing that the chair has passed: its distance is that of odometry.
        """
        along = np.array([math.cos(self.pitch_rad) / math.cos(self.heading_rad), math.sin(self.pitch_rad)])
        return [
            math.sqrt(float(along @ self._filter.ahead_covariance(self._nosings.index(nosing), self.pitch_rad) @ along))
            if nosing in self._nosings
            else math.inf
            for nosing in self._known
        ]

    def around(self, half_m: float) -> KnownNosings | None:
        """Return the known nosings relative to a chair whose flat run reaches ``half_m`` to either side; None without nosings."""
        known = [low for low, high in itertools.pairwise(self._known) if high.x_m - low.x_m > SAME * self.run_m] + self._known[-1:]
        places = [(self._ahead_m(nosing), self._above_m(nosing)) for nosing in known]
        under = [k for k, (ahead_m, _) in enumerate(places) if abs(ahead_m) <= half_m]
        bears = max(under, key=lambda k: places[k][1], default=None)
        zero_m, bearing = (0.0, None) if bears is None else (places[bears][1], known[bears])
        sigmas_m = self._height_sigmas_m(bearing)
        nosings = [
            KnownNosing(ahead_m, above_m - zero_m, sigmas_m.get(id(nosing), math.inf))
            for nosing, (ahead_m, above_m) in zip(known, places, strict=True)
        ]
        return KnownNosings(self.pitch_rad, tuple(nosings), self.rise_m) if nosings else None

    @property
    def rise_sigma_m(self) -> float:
        """Standard deviation of the rise [m]; infinite before the first map."""
        return math.sqrt(self._shape.variance_m2[1])

    @property
    def run_sigma_m(self) -> float:
        """Standard deviation of the run [m]; infinite before the first map."""
        return math.sqrt(self._shape.variance_m2[0])

    def first_ahead_m(self) -> float | None:
        """Return the horizontal distance of the lowest known nosing ahead of mid-track [m]; None without nosings."""
        return self._known[0].x_m - self.x_m if self._known else None

    def top_ahead_m(self) -> float | None:
        """Return the distance of the highest known nosing ahead of mid-track along the belts [m]; None without nosings."""
        return self._ahead_m(self._known[-1]) if self._known else None

    def top_above_m(self) -> float | None:
        """Return the height of the highest known nosing above mid-track [m]; None without nosings."""
        return self._known[-1].z_m - self._z_m if self._known else None

    def bottom_ahead_m(self) -> float | None:
        """Return the distance of the lowest known nosing ahead of mid-track along the belts [m]; None without nosings."""
        return self._ahead_m(self._known[0]) if self._known else None

    def roll_back_m(self, t_s: float) -> float | None:
        """Return the distance from the highest position on the flight back to the present one [m]; None without a recent map."""
        return self._highest_m - self.up_m if t_s - self.map_s <= SLIP_VALID_S else None

    def slip_m_s(self, t_s: float) -> float:
        """Return belt speed minus chair speed, both up the flight [m/s]; 0 without a recent map."""
        return self._slip_m_s if t_s - self.map_s <= SLIP_VALID_S else 0.0

    def side_m(self, side: Side) -> tuple[float | None, float | None]:
        """Return the distances from the chair's middle to which nosings have been in view on a side, and to the open side [m].

        Returns:
            None if no map has measured the first, minus infinity if a single map has; None unless the side is known to be open.
        """
        of, moved_m = self._sides[side], self._odometry_y_m if side == "left" else -self._odometry_y_m
        is_open = of.kind == "open" and of.count >= KNOWN_AFTER
        return of.seen_m[1] - moved_m if of.measured else None, of.edge_m - moved_m if is_open and of.edge_m is not None else None

    @property
    def x_m(self) -> float:
        """Horizontal place of mid-track up the flight [m], in the frame of the tracker."""
        return self._odometry_x_m + self._filter.shift_m[0]

    @property
    def _z_m(self) -> float:
        return self._odometry_z_m + self._filter.shift_m[1]

    @property
    def up_m(self) -> float:
        """Place up the flight [m]: along its slope, horizontal before the first map."""
        return self.x_m * math.cos(self.slope_rad) + self._z_m * math.sin(self.slope_rad)

    @property
    def top_ends(self) -> bool:
        """Whether maps have shown the end of the flight at the highest known nosing."""
        return self._end_at(self._known[::-1])

    @property
    def bottom_ends(self) -> bool:
        """Whether maps have shown the end of the flight at the lowest known nosing."""
        return self._end_at(self._known)

    def declare_end(self, direction: Direction) -> None:
        """Take the last known nosing in a direction as the end of the flight, by the word of a person."""
        if self._known:
            self._known[-1 if direction == "up" else 0].end_count = KNOWN_AFTER

    def gaps_ahead_m(self) -> list[tuple[float, float]]:
        """Return the gaps with missing steps: distances of the nosings below and above ahead of mid-track along the belts [m]."""
        return [(self._ahead_m(low), self._ahead_m(high)) for low, high in self._gaps]

    def turn_ahead(self) -> tuple[float, float] | None:
        """Return the distance of the last nosing before a turn ahead of mid-track [m], and the turn to the left [rad], or None."""
        turned = [nosing for nosing in self._known if nosing.turn_count >= KNOWN_AFTER]
        return (self._ahead_m(turned[0]), turned[0].turn_rad) if turned else None

    def _ahead_m(self, nosing: _Nosing) -> float:
        along = math.cos(self.pitch_rad) / math.cos(self.heading_rad)
        return (nosing.x_m - self.x_m) * along + (nosing.z_m - self._z_m) * math.sin(self.pitch_rad)

    def _above_m(self, nosing: _Nosing) -> float:
        return (nosing.z_m - self._z_m) * math.cos(self.pitch_rad) - (nosing.x_m - self.x_m) * math.sin(self.pitch_rad)

    def _height_sigmas_m(self, bearing: _Nosing | None) -> dict[int, float]:
        """Return the standard deviations of the tracked nosings' heights above the belts' line, by the nosings' identity [m]."""
        if bearing is not None and bearing not in self._nosings:
            return {}
        against = None if bearing is None else self._nosings.index(bearing)
        variances = self._filter.height_variances(self.pitch_rad, against)
        return {id(nosing): math.sqrt(variance) for nosing, variance in zip(self._nosings, variances, strict=True)}

    def _end_at(self, nosings: Sequence[_Nosing]) -> bool:
        """Return whether maps have shown the end at the first nosing, or at its duplicate after motion without a stair in view."""
        near = itertools.takewhile(lambda nosing: abs(nosing.x_m - nosings[0].x_m) < SAME * self.run_m, nosings)
        return any(nosing.end_count >= KNOWN_AFTER for nosing in near)

    def _drive(self, reading: TrackReading) -> None:
        dt_s = 0.0 if self._tracks_s is None else min(max(reading.t_s - self._tracks_s, 0.0), 0.1)
        self._tracks_s = reading.t_s
        self.speed_m_s = 0.5 * (reading.left_m_s + reading.right_m_s)
        moved = self.speed_m_s * dt_s
        self.travel_m += moved
        ran_m = 0.5 * (abs(reading.left_m_s) + abs(reading.right_m_s)) * dt_s
        self._filter.drive(moved, ran_m, 0.0, self.pitch_rad, dt_s)
        moved_x_m, moved_z_m = moved * math.cos(self.pitch_rad) * math.cos(self.heading_rad), moved * math.sin(self.pitch_rad)
        self._odometry_x_m += moved_x_m
        self._odometry_y_m += moved * math.sin(self.heading_rad)
        self._odometry_z_m += moved_z_m
        self._poses.add(reading.t_s, self._pose())
        self._highest_m = max(self._highest_m, self.up_m)

    def _is_across(self, seen: StairMap) -> bool:
        """Return whether a map shows another flight, across a landing."""
        way = 1.0 if seen.direction == "up" else -1.0
        if not self._known:
            return self.pitch_rad > ON_A_FLIGHT_RAD and -way * seen.nosings_B[0][2] > OFF_BELTS_M
        edge, (x_m, z_m), shift_m = self._known[-1 if way > 0.0 else 0], self._places(seen)[0], self._filter.shift_m
        far_m, up_m = way * (x_m + shift_m[0] - edge.x_m), way * (z_m + shift_m[1] - edge.z_m)
        return far_m > LANDING_RUNS * self.run_m and up_m < LANDING_SLOPE * self.rise_m / self.run_m * far_m

    def _see_across(self, seen: StairMap) -> None:
        """Update with a map of the next flight, which also shows the end of this one; after ``NEXT_S`` its tracker starts again."""
        if self._next is None or seen.t_s - self._next.map_s > NEXT_S:
            self._next = StairTracker()
            self._next._odometry_x_m, self._next._odometry_z_m = self._odometry_x_m, self._odometry_z_m  # noqa: SLF001
            self._next._poses = self._poses.copy()  # noqa: SLF001 - of this class, as above
        self._next.heading_rad, self._next.pitch_rad = self.heading_rad, self.pitch_rad
        self._next._see(seen)  # noqa: SLF001 - of this class
        if self._known:
            self._known[-1 if seen.direction == "up" else 0].end_count += 1

    def _see(self, seen: StairMap) -> None:
        self.map_count += 1
        since_s, self.map_s = seen.t_s - self.map_s, seen.t_s
        distances_m = [abs(x) for x, _, _ in seen.nosings_B]
        self._shape.update((seen.run_m, seen.rise_m), distances_m, self._filter.ran_m)
        self.left_wall_m, self.right_wall_m = seen.left_wall_m, seen.right_wall_m
        if self.map_count == 1:
            self._fit_shape()
        up_m = self.up_m
        way = 1.0 if seen.direction == "up" else -1.0
        self._take_back(way)
        places = self._places(seen)
        shown = self._match([*self._hidden_edge(places[0]), *places])
        self._note_slip(since_s, self.up_m - up_m)
        self._note_missed(shown, seen)
        self._note_passed(shown, way)
        self._fit_shape()
        if shown:
            self._note_end(shown[-1], seen)
        self._note_sides(seen)

    def _fit_shape(self) -> None:
        """Update run, rise, slope and gaps from the known nosings around the chair, and the list of all known ones."""
        tracked = [(nosing, number) for number, nosing in enumerate(self._nosings) if nosing.known]
        tracked.sort(key=lambda item: item[0].x_m)
        places_m = [(nosing.x_m, nosing.z_m) for nosing, _ in tracked]
        self._shape.combine(places_m, lambda: self._filter.covariance_of([number for _, number in tracked]))
        self.run_m, self.rise_m = self._shape.mean_m.tolist()
        self.slope_rad = math.atan2(self.rise_m, self.run_m)
        far_m = MISSING * math.hypot(self.rise_m, self.run_m)
        self._gaps = [
            (low, high)
            for (low, _), (high, _) in itertools.pairwise(tracked)
            if math.hypot(high.x_m - low.x_m, high.z_m - low.z_m) > far_m and min(low.count, high.count) >= GAP_KNOWN_AFTER
        ]
        self._known = sorted([*self._passed, *(nosing for nosing, _ in tracked)], key=attrgetter("x_m"))

    def _places(self, seen: StairMap) -> list[tuple[float, float]]:
        """Return the nosings (x, z) of a map by odometry alone [m], by the chair's pose at the exposure, nearest first."""
        exposed = self._poses.at(seen.t_s) or self._pose()
        c, s, across = math.cos(exposed.pitch_rad), math.sin(exposed.pitch_rad), math.cos(exposed.heading_rad)
        return [(exposed.x_m + (x * c - z * s) * across, exposed.z_m + x * s + z * c) for x, _, z in seen.nosings_B]

    def _pose(self) -> _Pose:
        return _Pose(self._odometry_x_m, self._odometry_y_m, self._odometry_z_m, self.pitch_rad, self.heading_rad)

    def _match(self, places: list[tuple[float, float]]) -> list[_Nosing]:
        """Update the filter with the detections of a map, and return their nosings in the map's order."""
        self._filter.begin_frame(self.pitch_rad)
        earlier, shown, (shift_x_m, shift_z_m) = len(self._nosings), [], self._filter.shift_m
        for place in places:
            number = self._nearest(place)
            if number is None:
                nosing = _Nosing(place[0] + shift_x_m, place[1] + shift_z_m, count=0)
                number = self._filter.add((nosing.x_m, nosing.z_m))
                self._nosings.append(nosing)
            shown.append((number, place))
        detections = [(number, place, abs(self._nosings[number].x_m - self.x_m)) for number, place in shown]
        self._filter.update(detections, new=[number >= earlier for number, _ in shown])
        for nosing, (x_m, z_m) in zip(self._nosings, self._filter.places_m.tolist(), strict=True):
            nosing.x_m, nosing.z_m = x_m, z_m
        for number, _ in shown:
            self._nosings[number].count += 1
        return [self._nosings[number] for number, _ in shown]

    def _hidden_edge(self, first: tuple[float, float]) -> list[tuple[float, float]]:
        """Return the place of the landing's edge by odometry, if it is not known and the highest nosing in view is the next below.

        The edge is as high as the belts of the chair that stands on the landing, and one run before that nosing.
        """
        edge = first[0] + self.run_m, self._odometry_z_m
        is_next = abs(edge[1] - first[1] - self.rise_m) < SAME * self.rise_m
        number = self._nearest(edge)
        is_known = number is not None and self._nosings[number].known
        return [edge] if is_next and not is_known and self.pitch_rad < ON_A_FLIGHT_RAD else []

    def _is_passed(self, nosing: _Nosing, way: float) -> bool:
        return way * (self.x_m - nosing.x_m) > PASSED_M

    def _take_back(self, way: float) -> None:
        """Return passed nosings to which the chair has rolled back to the filter, which knows of their places no more."""
        while self._passed and not self._is_passed(self._passed[-1], way):
            nosing = self._passed.pop()
            self._nosings.append(nosing)
            self._filter.add((nosing.x_m, nosing.z_m))

    def _note_passed(self, shown: list[_Nosing], way: float) -> None:
        """Remove the nosings that the chair has passed from the filter; known ones keep their places."""
        behind = [nosing for nosing in self._nosings if self._is_passed(nosing, way) and nosing not in shown]
        for nosing in sorted(behind, key=lambda nosing: way * nosing.x_m):
            self._drop(nosing)
            if nosing.known:
                self._passed.append(nosing)

    def _drop(self, nosing: _Nosing) -> None:
        number = self._nosings.index(nosing)
        self._filter.remove(number)
        del self._nosings[number]

    def _nearest(self, place: tuple[float, float]) -> int | None:
        """Return the number of the nosing within half a pitch of a place by odometry, or None."""
        shift_x_m, shift_z_m = self._filter.shift_m
        apart = [math.hypot(nosing.x_m - place[0] - shift_x_m, nosing.z_m - place[1] - shift_z_m) for nosing in self._nosings]
        least = min(range(len(apart)), key=apart.__getitem__, default=None)
        return None if least is None or apart[least] > SAME * math.hypot(self.run_m, self.rise_m) else least

    def _note_slip(self, since_s: float, moved_up_m: float) -> None:
        if not 0.0 < since_s <= SLIP_VALID_S:
            self._slip_m_s = 0.0
            return
        slip_m_s = -moved_up_m / since_s
        self._slip_m_s += (1.0 - math.exp(-since_s / SLIP_LAG_S)) * (slip_m_s - self._slip_m_s)

    def _note_sides(self, seen: StairMap) -> None:
        """Keep how far nosings were in view and where the flight's sides are, from the chair's place at the exposure."""
        moved_m = (self._poses.at(seen.t_s) or self._pose()).y_m
        for side, outward_m, seen_m, edge_m, kind in (
            (self._sides["left"], moved_m, seen.left_seen_m, seen.left_edge_m, seen.left_side),
            (self._sides["right"], -moved_m, seen.right_seen_m, seen.right_edge_m, seen.right_side),
        ):
            if seen_m is not None:
                first, second, _ = sorted((*side.seen_m, seen_m + outward_m), reverse=True)
                side.seen_m, side.measured = (first, second), True
            if edge_m is not None:
                same = side.edge_m is not None and side.kind == kind and abs(side.edge_m - edge_m - outward_m) < SAME_SIDE_M
                side.count = side.count + 1 if same else 1
                side.edge_m, side.kind = edge_m + outward_m, kind

    def _note_missed(self, shown: list[_Nosing], seen: StairMap) -> None:
        """Count a miss for each nosing between the nearest and the furthest of a map, or beyond its end, that it does not show."""
        if len(shown) < KNOWN_AFTER:
            return
        low, high = min(nosing.x_m for nosing in shown), max(nosing.x_m for nosing in shown)
        if seen.ends:
            low, high = (low, math.inf) if seen.direction == "up" else (-math.inf, high)
        for nosing in self._nosings:
            if low < nosing.x_m < high and not any(nosing is other for other in shown):
                nosing.missed += 1
        for nosing in [nosing for nosing in self._nosings if nosing.missed >= MISSED_SHARE * nosing.count]:
            self._drop(nosing)

    def _note_end(self, last: _Nosing, seen: StairMap) -> None:
        """Count the maps that show the flight's end, or its turn, at a nosing; a known nosing beyond resets the count."""
        if seen.ends:
            last.end_count += 1
        if seen.turn_rad is not None:
            last.turn_count, last.turn_rad = last.turn_count + 1, seen.turn_rad
        if not last.known:
            return
        upward = seen.direction == "up"
        for nosing in self._nosings:
            before = nosing.x_m < last.x_m if upward else nosing.x_m > last.x_m
            if nosing is not last and before:
                nosing.end_count = nosing.turn_count = 0
