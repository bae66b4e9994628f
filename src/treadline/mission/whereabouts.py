"""Where the nosings lie about the chair: stair maps, carried on by belts and pitch between frames.

``ImuSample, TrackReading, StairMap -> Whereabouts``. Everything is kept in a level frame that the odometry moves through, x
up the flight and level, z up: a nosing stands still in it while the chair turns and pitches. Maps correct the odometry's
slip as long as a nosing is in view; one that the chair has passed stays where it was last seen.
"""

import math
from dataclasses import dataclass

from treadline.control.arm import pitch_of
from treadline.signals import ImuSample, StairMap, TrackReading

SAME = 0.45
"""Of a run: nosings nearer than this are one."""
SAME_RISE_M = 0.08
KNOWN_AFTER = 2
"""Maps that must show a nosing, or the flight's end, before it counts."""
MAPS_MAX = 50
"""Weight of the mean shape: five seconds of frames."""
BLEND_LEAST = 0.15
"""Share of a new sight in a nosing's place: frames share errors, and belts slip."""


@dataclass(slots=True)
class _Nosing:
    """One nosing in the level frame."""

    x_m: float
    z_m: float
    count: int = 1
    end_count: int = 0


class Whereabouts:
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
        self.direction: str | None = None
        self.map_count = 0
        self.map_s = -math.inf
        self._x_m = self._z_m = 0.0
        self._tracks_s: float | None = None
        self._nosings: list[_Nosing] = []

    def feel(self, signal: ImuSample | TrackReading | StairMap) -> None:
        """Take one signal."""
        match signal:
            case TrackReading():
                self._drive(signal)
            case ImuSample():
                self.pitch_rad = pitch_of(signal)
            case StairMap():
                self._see(signal)

    @property
    def known(self) -> bool:
        """Whether the stair has been seen more than once."""
        return self.map_count >= KNOWN_AFTER

    def ahead_m(self) -> list[float]:
        """Return how far along the belts each known nosing is ahead of mid-track, the lowest of the flight first."""
        c, s = math.cos(self.pitch_rad), math.sin(self.pitch_rad)
        c /= math.cos(self.heading_rad)
        return [(n.x_m - self._x_m) * c + (n.z_m - self._z_m) * s for n in self._nosings if n.count >= KNOWN_AFTER]

    def first_ahead_m(self) -> float | None:
        """Return how far the flight's lowest known nosing is ahead of mid-track, level."""
        known = [n.x_m for n in self._nosings if n.count >= KNOWN_AFTER]
        return known[0] - self._x_m if known else None

    def top_ahead_m(self) -> float | None:
        """Return how far the highest known nosing is ahead of mid-track, along the belts."""
        ahead = self.ahead_m()
        return ahead[-1] if ahead else None

    def bottom_ahead_m(self) -> float | None:
        """Return how far the lowest known nosing is ahead of mid-track, along the belts; negative once the chair is above it."""
        ahead = self.ahead_m()
        return ahead[0] if ahead else None

    @property
    def top_ends(self) -> bool:
        """Whether frames have shown that nothing follows the highest known nosing."""
        return self._ends(-1)

    @property
    def bottom_ends(self) -> bool:
        """Whether frames have shown that nothing follows the lowest known nosing."""
        return self._ends(0)

    def _ends(self, index: int) -> bool:
        known = [n for n in self._nosings if n.count >= KNOWN_AFTER]
        return bool(known) and known[index].end_count >= KNOWN_AFTER

    def _drive(self, reading: TrackReading) -> None:
        dt_s = 0.0 if self._tracks_s is None else min(max(reading.t_s - self._tracks_s, 0.0), 0.1)
        self._tracks_s = reading.t_s
        self.speed_m_s = 0.5 * (reading.left_m_s + reading.right_m_s)
        moved = self.speed_m_s * dt_s
        self.travel_m += moved
        self._x_m += moved * math.cos(self.pitch_rad) * math.cos(self.heading_rad)
        self._z_m += moved * math.sin(self.pitch_rad)

    def _see(self, seen: StairMap) -> None:
        self.map_count += 1
        self.map_s = seen.t_s
        self.direction = seen.direction
        share = 1.0 / min(self.map_count, MAPS_MAX)
        self.rise_m += (seen.rise_m - self.rise_m) * share
        self.run_m += (seen.run_m - self.run_m) * share
        self.slope_rad += (seen.slope_rad - self.slope_rad) * share
        self.left_wall_m, self.right_wall_m = seen.left_wall_m, seen.right_wall_m
        c, s = math.cos(self.pitch_rad), math.sin(self.pitch_rad)
        last: _Nosing | None = None
        across = math.cos(self.heading_rad)
        for x, _, z in seen.nosings_B.tolist():
            last = self._place(self._x_m + (x * c - z * s) * across, self._z_m + x * s + z * c)
        self._nosings.sort(key=lambda nosing: nosing.x_m)
        if last is not None:
            self._note_end(last, seen)

    def _place(self, x_m: float, z_m: float) -> _Nosing:
        """Return the nosing that was seen at a place, new or bettered."""
        for nosing in self._nosings:
            if abs(nosing.x_m - x_m) < SAME * self.run_m and abs(nosing.z_m - z_m) < SAME_RISE_M:
                nosing.count += 1
                share = max(1.0 / nosing.count, BLEND_LEAST)
                nosing.x_m += (x_m - nosing.x_m) * share
                nosing.z_m += (z_m - nosing.z_m) * share
                return nosing
        nosing = _Nosing(x_m, z_m)
        self._nosings.append(nosing)
        return nosing

    def _note_end(self, last: _Nosing, seen: StairMap) -> None:
        """Count the frames that show the flight's end at a nosing; one that shows another beyond takes all back."""
        if seen.ends:
            last.end_count += 1
        upward = seen.direction == "up"
        for nosing in self._nosings:
            before = nosing.x_m < last.x_m if upward else nosing.x_m > last.x_m
            if nosing is not last and before:
                nosing.end_count = 0
