"""Monitors of the way ahead: obstacles (row 25), and nosings too far apart for the track (row 17). ``StairMap -> cause``."""

import itertools
import math
from collections.abc import Sequence
from typing import Any

from treadline.core.signals import FrameQuality, FreeGround, StairMap
from treadline.core.step_sizes import GAP_SEEN_M
from treadline.guard._guard_config import SAME_M, GuardConfig
from treadline.guard._known import Known, Monitor
from treadline.guard._sightings import Sightings
from treadline.guard._swept_outline import clipped

OBSTACLE_COUNT, GAP_COUNT = (3, 4, 12), (1, 5, 10)
"""Gain, least and largest count (``Sightings``) of an obstacle and of a gap. An obstacle in every third frame is there, one in a
single frame of forty is not, and what was there is remembered for a second; a nosing that a detector misses is missed in three or
four maps."""
MOST_STEPS = 2.5
"""Largest distance of three neighbouring nosings, in steps of their flight [-]: halfway between a whole flight and one that lacks a
step. Where the flight is so wide, the flipper bears with the flat run."""
OUT_OF_VIEW_M = 1.2
"""Distance from mid-track below which the camera sees only the upper part of an obstacle, if any [m]."""


def gap_between(nosings: Sequence[Sequence[float]], span_m: float) -> tuple[float, float] | None:
    """Return the distance of the first gap on which the track would rest alone, and its width [m]; None without one.

    Args:
        nosings: Nosings, the nearest first: distance from mid-track and height [m].
        span_m: Distance within which three neighbouring nosings must be.
    """
    apart = [math.dist(near, far) for near, far in itertools.pairwise(nosings)]
    for k, width in enumerate(apart):
        if width > span_m:
            return nosings[k][0], width
        if k and apart[k - 1] + width > span_m:
            return nosings[k - (apart[k - 1] >= width)][0], apart[k - 1] + width
    return None


class AheadMonitor(Monitor):
    """An obstacle in a third of maps or frames, and no step that maps have shown; three nosings too far apart for the track.

    Time: in every phase, 0.34 m before an obstacle, 0.2 m before a gap, for messages up to 3 s late.
    Not covered: what the camera does not see; in the state `turn`, walls, from which row 29 keeps the chair.

    A re-arm forgets nothing that lies ahead.
    """

    rows, hears = "17, 25", (StairMap, FrameQuality, FreeGround)

    def __init__(self, config: GuardConfig) -> None:
        super().__init__(config)
        self._sign, self._lead_m = (1.0, config.front_m) if config.view == "front" else (-1.0, config.rear_m)
        self._in_maps, self._in_frames, self._gaps = Sightings(*OBSTACLE_COUNT), Sightings(*OBSTACLE_COUNT), Sightings(*GAP_COUNT)
        self._width_m = 0.0
        """Distance between the nosings at the gap that was seen last [m]."""
        self._turns, self._side_m = False, math.inf
        """Whether the chair turns on a landing, and the nearest place of a side there over the width of the chair."""
        self._steps_m = (math.inf, -math.inf)
        """Places of the first nosing that maps have shown of the flight, also of one passed since, and of the latest map's last."""

    def hear(self, message: Any, known: Known) -> None:
        """Update with one map, or with one frame that may be used."""
        travel_m = self._sign * known.travel.at(message.t_s)[0]
        turns = known.followed is not None and known.followed.phase == "turn"
        if turns != self._turns:  # places along the way before a turn are none after it
            self._turns, self._side_m = turns, math.inf
            for seen in (self._in_maps, self._in_frames, self._gaps):
                seen.forget(math.inf)
        match message:
            case FreeGround() if turns and self._config.turn_outline_m is not None:
                self._side_m = travel_m + _nearest_m(message, self._sign, self._config.turn_outline_m[2])
            case StairMap() if not turns:
                _show(self._in_maps, message.obstacle_m, travel_m)
                places = [(self._sign * x_m, z_m) for x_m, _, z_m in message.nosings_B]
                self._look_at(places, travel_m, self._span_m(math.hypot(message.rise_m, message.run_m)))
            case FrameQuality() if not known.frames.refused:
                # A step of the flight is no obstacle, nor is a landing's side in a turn.
                first_m, last_m = self._steps_m
                obstacle_m = message.obstacle_m
                place_m = math.inf if obstacle_m is None else travel_m + obstacle_m
                is_known = abs(place_m - self._side_m) < SAME_M if turns else first_m - SAME_M < place_m < last_m + SAME_M
                _show(self._in_frames, None if is_known else obstacle_m, travel_m)

    def _span_m(self, pitch_m: float) -> float:
        """Return the distance within which three nosings of a flight must be, by its distance from nosing to nosing [m]."""
        return max(self._config.track_span_m, min(MOST_STEPS * pitch_m, self._config.track_on_stair_m))

    def _look_at(self, places: Sequence[tuple[float, float]], travel_m: float, span_m: float) -> None:
        """Update with the nosings of one map, the travel towards them at its exposure, and how far apart three may be."""
        gap = gap_between(places, span_m)
        if gap is not None and gap[0] > GAP_SEEN_M:
            gap = None
        # A gap that is out of view is kept; it is in view while the nosing before it is.
        from_m, to_m = (travel_m + places[k][0] - SAME_M for k in (0, -1)) if places else (math.inf, -math.inf)
        self._gaps.forget(travel_m + self._lead_m - self._config.track_span_m)
        self._gaps.look(None if gap is None else travel_m + gap[0], from_m, to_m)
        if gap is not None:
            self._width_m = gap[1]
        if places:
            first_m, last_m = travel_m + places[0][0], travel_m + places[-1][0]
            is_same_flight = first_m < self._steps_m[1] + SAME_M and self._steps_m[0] < last_m + SAME_M
            self._steps_m = min(first_m, self._steps_m[0]) if is_same_flight else first_m, last_m

    def cause(self, known: Known) -> str | None:
        """Return the obstacle or gap from which the chair would not keep its distance at this speed; None if there is none."""
        limits, speed, travel_m = self._config, self._sign * known.mean_m_s, known.travel.travel_m
        if speed <= 0.0:
            return None
        stopping_m = speed * limits.stopping_s
        places_m = [place_m for seen in (self._in_maps, self._in_frames) if (place_m := seen.nearest_m()) is not None]
        obstacle_m = min(places_m, default=math.inf) - self._sign * travel_m - self._lead_m
        if obstacle_m < limits.obstacle_clear_m + stopping_m:
            return f"obstacle {obstacle_m:.2f} m ahead"
        gap_m = self._gap_m(travel_m)
        if gap_m is not None and gap_m < limits.gap_clear_m + stopping_m:
            return f"{self._width_m:.2f} m from nosing to nosing {gap_m:.2f} m ahead, too long for the track"
        return None

    def restriction(self, known: Known) -> tuple[str, str] | None:
        """Return a gap ahead."""
        gap_m = self._gap_m(known.travel.travel_m)
        return None if gap_m is None else ("gap", f"{self._width_m:.2f} m from nosing to nosing {gap_m:.2f} m ahead")

    def _gap_m(self, travel_m: float) -> float | None:
        """Return the distance from the chair's leading end to a gap, unless the chair is over it."""
        place_m = self._gaps.nearest_m()
        distance_m = math.inf if place_m is None else place_m - self._sign * travel_m - self._lead_m
        return distance_m if -self._config.track_span_m < distance_m < math.inf else None


def _nearest_m(ground: FreeGround, sign: float, half_m: float) -> float:
    """Return the distance from mid-track to the nearest side over the width of the chair [m]; infinite without one."""
    ends = [(sign * x, y) for x, y, _ in ground.sides_B]
    near_m = math.inf
    for start, end in zip(ends[::2], ends[1::2], strict=True):
        shares = clipped((start, end), (-math.inf, math.inf), (-half_m, half_m))
        if shares[0] < shares[1]:
            near_m = min(near_m, *(start[0] + share * (end[0] - start[0]) for share in shares))
    return near_m


def _show(sightings: Sightings, obstacle_m: float | None, travel_m: float) -> None:
    """Show the nearest obstacle of a frame or map, which may hide others; what is too near to be in view is kept."""
    sightings.forget(travel_m)
    place_m = None if obstacle_m is None else travel_m + obstacle_m
    sightings.look(place_m, travel_m + OUT_OF_VIEW_M, math.inf if place_m is None else place_m)
