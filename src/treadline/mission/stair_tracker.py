"""Where the nosings lie about the chair: stair maps, carried on by belts and pitch between frames.

``ImuSample, TrackReading, StairMap -> StairTracker``. Everything is kept in a level frame that the odometry moves through, x
up the flight and level, z up: a nosing stands still in it while the chair turns and pitches. Maps correct the odometry's
slip as long as a nosing is in view; one that the chair has passed stays where it was last seen. A flight seen across a landing
is kept apart, in whereabouts of its own.
"""

import itertools
import math
from dataclasses import dataclass

from treadline.angles import DEG
from treadline.mission.recent import DEPTH, Recent
from treadline.signals import ImuSample, StairMap, TrackReading

SAME = 0.45
"""Of a run: nosings nearer than this are one."""
SAME_RISE_M = 0.08
MISSING = 1.6
"""Pitches between neighbouring nosings from which on one is missing between them."""
LANDING_RUNS = 2.5
"""Between neighbouring nosings that a landing lies between: a chair that stands on one needs more, a missing step or two less …"""
LANDING_SLOPE = 0.6
"""… of the flight's slope at most, for a landing is one rise high however long; missing steps keep to the slope."""
OFF_BELTS_M = 0.4
"""Off the belts' line, and on a landing's side of it: no nosing of the flight on which the chair lies."""
PITCHED_RAD = 10.0 * DEG
"""From which on the chair lies on a flight."""
NEXT_MAPS, NEXT_S, NEXT_M = 5, 1.0, 4.5
"""Maps that must have shown the next flight, the time without one after which it is looked at anew, and how near it must be."""
MISSED_SHARE = 2.0
"""Maps that pass over a nosing, per map that shows it, from which on it was never there."""
MISSED_MOST = 20
"""Of those maps that count: one that is missed as long as the chair stands, and seen at each frame as it comes nearer, is known
again within a second."""
KNOWN_AFTER = 2
"""Maps that must show a nosing, or the flight's end, before it counts."""
NEAR_M = 1.9
"""From mid-track: further away a nosing is missed too often to be called missing, and a metre is enough to stop in."""
GAP_KNOWN_AFTER = 6
"""Maps that must show both nosings at a gap: by then two of them would have shown one between."""
MAPS_MAX = 50
"""Weight of the mean shape: five seconds of frames."""
BLEND_LEAST = 0.02
"""Share of a new sight in a nosing's place, at least."""
SLIP_VALID_S = 0.35
"""After a map, for which belts alone carry on what it told about slip."""
SLIP_SHARE = 0.5
"""Share of a frame in where the chair is against the nosings: belts slip by a few per cent, a frame errs by millimetres."""
SLIP_LAG_S = 0.3
"""Of the speed at which the belts slip: a frame that errs by 2 mm makes 3 mm/s of it."""


@dataclass(slots=True)
class _Nosing:
    """One nosing in the level frame."""

    x_m: float
    z_m: float
    count: int = 1
    missed: int = 0
    """Maps that showed nosings nearer and further, and not this one."""
    end_count: int = 0

    @property
    def known(self) -> bool:
        """Whether it has been seen often enough to be believed."""
        return self.count >= KNOWN_AFTER and self.missed < MISSED_SHARE * self.count


@dataclass(frozen=True, slots=True)
class _Pose:
    """Pose of the chair by odometry alone, in the level frame."""

    x_m: float
    z_m: float
    pitch_rad: float
    heading_rad: float


class StairTracker:
    """Nosings about the chair, the stair's shape, walls, pitch and distance driven."""

    def __init__(self) -> None:
        self.heading_rad = 0.0
        """As the mission believes it; whoever turns the planner sets it."""
        self.pitch_rad = 0.0
        self.travel_m = 0.0
        """Along the belts since the start, backing down negative."""
        self.speed_m_s = 0.0
        self.rise_m = self.run_m = self.slope_rad = 0.0
        """Of the flight, mean of the maps; zero before the first."""
        self.left_wall_m: float | None = None
        self.right_wall_m: float | None = None
        self.map_count = 0
        self.map_s = -math.inf
        self._x_m = self._z_m = 0.0
        self._odometry_x_m = self._odometry_z_m = 0.0
        """Distance by belts and pitch alone: no map corrects it, so that a difference is travel."""
        self._poses: Recent[_Pose] = Recent(2 * DEPTH)  # one entry per IMU sample and one per belt reading
        self._highest_m = -math.inf
        self._slip_m_s = 0.0
        self._tracks_s: float | None = None
        self._nosings: list[_Nosing] = []
        self._known: list[_Nosing] = []
        """Those that are believed, since the last map, the lowest of the flight first."""
        self._next: StairTracker | None = None
        """The next flight, across a landing."""

    def update(self, signal: ImuSample | TrackReading | StairMap) -> None:
        """Take one signal."""
        match signal:
            case TrackReading():
                self._drive(signal)
            case ImuSample():
                self.pitch_rad = signal.pitch_rad
                self._poses.add(signal.t_s, self._pose())
            case StairMap() if len(signal.nosings_B):
                if self._is_across(signal):
                    self._see_across(signal)
                else:
                    self._see(signal)
            case _:
                pass
        if self._next is not None and not isinstance(signal, StairMap):
            self._next.heading_rad = self.heading_rad
            self._next.update(signal)

    @property
    def shows_another(self) -> bool:
        """Whether frames have shown another flight near, across a landing."""
        beyond = self._next
        if beyond is None or beyond.map_count < NEXT_MAPS:
            return False
        return any(abs(nosing.x_m - beyond._x_m) < NEXT_M for nosing in beyond._known)  # noqa: SLF001 - of this class

    @property
    def known(self) -> bool:
        """Whether the stair has been seen more than once."""
        return self.map_count >= KNOWN_AFTER

    def ahead_m(self) -> list[float]:
        """Return how far along the belts each known nosing is ahead of mid-track, the lowest of the flight first."""
        return [self._ahead_m(nosing) for nosing in self._known]

    def first_ahead_m(self) -> float | None:
        """Return how far the flight's lowest known nosing is ahead of mid-track, level."""
        return self._known[0].x_m - self._x_m if self._known else None

    def top_ahead_m(self) -> float | None:
        """Return how far the highest known nosing is ahead of mid-track, along the belts."""
        ahead = self.ahead_m()
        return ahead[-1] if ahead else None

    def top_above_m(self) -> float | None:
        """Return how far the highest known nosing is above mid-track, level."""
        return self._known[-1].z_m - self._z_m if self._known else None

    def bottom_ahead_m(self) -> float | None:
        """Return how far the lowest known nosing is ahead of mid-track, along the belts; negative once the chair is above it."""
        ahead = self.ahead_m()
        return ahead[0] if ahead else None

    def roll_back_m(self, t_s: float) -> float | None:
        """Return how far the chair has come back along the flight from where it was furthest up; None where no nosings tell."""
        return self._highest_m - self._up_m if t_s - self.map_s <= SLIP_VALID_S else None

    def slip_m_s(self, t_s: float) -> float:
        """Return how much faster the belts run up the flight than the chair; backing down, how much faster the chair comes down."""
        return self._slip_m_s if t_s - self.map_s <= SLIP_VALID_S else 0.0

    @property
    def _up_m(self) -> float:
        return self._x_m * math.cos(self.slope_rad) + self._z_m * math.sin(self.slope_rad)

    @property
    def top_ends(self) -> bool:
        """Whether frames have shown that nothing follows the highest known nosing."""
        return self._ends(-1)

    @property
    def bottom_ends(self) -> bool:
        """Whether frames have shown that nothing follows the lowest known nosing."""
        return self._ends(0)

    def gaps_ahead_m(self) -> list[tuple[float, float]]:
        """Return where steps are missing: nosings below and above each, ahead of mid-track along the belts, the lowest first."""
        far_m = MISSING * math.hypot(self.rise_m, self.run_m)
        gaps = [
            (low, high)
            for low, high in itertools.pairwise(self._known)
            if math.hypot(high.x_m - low.x_m, high.z_m - low.z_m) > far_m and min(low.count, high.count) >= GAP_KNOWN_AFTER
        ]
        return [(self._ahead_m(low), self._ahead_m(high)) for low, high in gaps]

    def _ahead_m(self, nosing: _Nosing) -> float:
        along = math.cos(self.pitch_rad) / math.cos(self.heading_rad)
        return (nosing.x_m - self._x_m) * along + (nosing.z_m - self._z_m) * math.sin(self.pitch_rad)

    def _ends(self, index: int) -> bool:
        """Say whether frames have shown the flight's end at a nosing or its double: after a blind lift it may be there twice."""
        if not self._known:
            return False
        place_m, same_m = self._known[index].x_m, SAME * self.run_m
        return any(nosing.end_count >= KNOWN_AFTER and abs(nosing.x_m - place_m) < same_m for nosing in self._known)

    def _drive(self, reading: TrackReading) -> None:
        dt_s = 0.0 if self._tracks_s is None else min(max(reading.t_s - self._tracks_s, 0.0), 0.1)
        self._tracks_s = reading.t_s
        self.speed_m_s = 0.5 * (reading.left_m_s + reading.right_m_s)
        moved = self.speed_m_s * dt_s
        self.travel_m += moved
        moved_x_m, moved_z_m = moved * math.cos(self.pitch_rad) * math.cos(self.heading_rad), moved * math.sin(self.pitch_rad)
        self._x_m += moved_x_m
        self._z_m += moved_z_m
        self._odometry_x_m += moved_x_m
        self._odometry_z_m += moved_z_m
        self._poses.add(reading.t_s, self._pose())
        self._highest_m = max(self._highest_m, self._up_m)

    def _is_across(self, seen: StairMap) -> bool:
        """Say whether a map shows another flight than this one, across a landing."""
        way = 1.0 if seen.direction == "up" else -1.0
        if not self._known:
            return self.pitch_rad > PITCHED_RAD and -way * float(seen.nosings_B[0, 2]) > OFF_BELTS_M
        edge, (x_m, z_m) = self._known[-1 if way > 0.0 else 0], self._places(seen)[0]
        far_m, up_m = way * (x_m - edge.x_m), way * (z_m - edge.z_m)
        return far_m > LANDING_RUNS * self.run_m and up_m < LANDING_SLOPE * self.rise_m / self.run_m * far_m

    def _see_across(self, seen: StairMap) -> None:
        """Take a map of the next flight: this one ends there. What is old is forgotten, for the chair may have tipped meanwhile."""
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
        share = 1.0 / min(self.map_count, MAPS_MAX)
        self.rise_m += (seen.rise_m - self.rise_m) * share
        self.run_m += (seen.run_m - self.run_m) * share
        self.slope_rad += (seen.slope_rad - self.slope_rad) * share
        self.left_wall_m, self.right_wall_m = seen.left_wall_m, seen.right_wall_m
        places = self._places(seen)
        matched = [(nosing, place) for place in places if (nosing := self._find(*place)) is not None]
        self._note_slip(since_s, self._move_onto(matched))
        shown = [self._place(x_m, z_m) for x_m, z_m in self._places(seen)]
        self._note_missed(shown)
        last = shown[-1] if shown else None
        self._nosings.sort(key=lambda nosing: nosing.x_m)
        self._known = [nosing for nosing in self._nosings if nosing.known]
        if last is not None:
            self._note_end(last, seen)

    def _places(self, seen: StairMap) -> list[tuple[float, float]]:
        """Return the nosings of a map in the level frame, the nearest first, by the chair's pose at the exposure."""
        exposed = self._poses.at(seen.t_s) or self._pose()
        c, s, across = math.cos(exposed.pitch_rad), math.sin(exposed.pitch_rad), math.cos(exposed.heading_rad)
        x_m = self._x_m - (self._odometry_x_m - exposed.x_m)
        z_m = self._z_m - (self._odometry_z_m - exposed.z_m)
        return [(x_m + (x * c - z * s) * across, z_m + x * s + z * c) for x, _, z in seen.nosings_B.tolist()]

    def _pose(self) -> _Pose:
        return _Pose(self._odometry_x_m, self._odometry_z_m, self.pitch_rad, self.heading_rad)

    def _move_onto(self, matched: list[tuple[_Nosing, tuple[float, float]]]) -> float:
        """Let the nosings seen again tell how far the belts have slipped: all that is known moves on together.

        Returns:
            By how much it was moved up the flight.
        """
        known = [(nosing, place) for nosing, place in matched if nosing.known]
        if not known:
            return 0.0
        up_m = self._up_m
        self._x_m -= SLIP_SHARE * sum(place[0] - nosing.x_m for nosing, place in known) / len(known)
        self._z_m -= SLIP_SHARE * sum(place[1] - nosing.z_m for nosing, place in known) / len(known)
        return self._up_m - up_m

    def _note_slip(self, since_s: float, moved_up_m: float) -> None:
        if not 0.0 < since_s <= SLIP_VALID_S:
            self._slip_m_s = 0.0
            return
        slip_m_s = -moved_up_m / since_s
        self._slip_m_s += (1.0 - math.exp(-since_s / SLIP_LAG_S)) * (slip_m_s - self._slip_m_s)

    def _find(self, x_m: float, z_m: float) -> _Nosing | None:
        """Return the nosing that stands at a place, or None."""
        for nosing in self._nosings:
            if abs(nosing.x_m - x_m) < SAME * self.run_m and abs(nosing.z_m - z_m) < SAME_RISE_M:
                return nosing
        return None

    def _place(self, x_m: float, z_m: float) -> _Nosing:
        """Return the nosing that was seen at a place, new or bettered."""
        nosing = self._find(x_m, z_m)
        if nosing is None:
            nosing = _Nosing(x_m, z_m)
            self._nosings.append(nosing)
            return nosing
        nosing.count += 1
        share = max(1.0 / nosing.count, BLEND_LEAST)
        nosing.x_m += (x_m - nosing.x_m) * share
        nosing.z_m += (z_m - nosing.z_m) * share
        return nosing

    def _note_missed(self, shown: list[_Nosing]) -> None:
        """Count against nosings that a map passes over: nearer and further ones are in it."""
        if len(shown) < KNOWN_AFTER:
            return
        low, high = min(nosing.x_m for nosing in shown), max(nosing.x_m for nosing in shown)
        for nosing in self._nosings:
            if low < nosing.x_m < high and not any(nosing is other for other in shown):
                nosing.missed = min(nosing.missed + 1, MISSED_MOST)

    def _note_end(self, last: _Nosing, seen: StairMap) -> None:
        """Count the frames that show the flight's end at a nosing; another that is known beyond takes all back."""
        if seen.ends:
            last.end_count += 1
        if not last.known:
            return
        upward = seen.direction == "up"
        for nosing in self._nosings:
            before = nosing.x_m < last.x_m if upward else nosing.x_m > last.x_m
            if nosing is not last and before:
                nosing.end_count = 0
