"""Monitors of the way ahead: obstacles (row 25), and nosings too far apart for the track (row 17). ``StairMap -> cause``."""

import itertools
import math
from collections.abc import Sequence

from treadline.core.signals import MotionPlan, StairMap
from treadline.guard._guard_config import FLIGHT, OVER, SAME_M, GuardConfig

OBSTACLE_MAPS, GAP_MAPS = 2, 5
"""Number of consecutive maps that must show an obstacle, and net number of maps that must show a gap: a nosing that a detector
misses is missed in three or four maps."""
NEAR_M = 1.9
"""Largest distance from mid-track of a gap, and of ground that counts as seen [m]; equal to the planner's limit for gaps in
``estimation.stair_tracker``, on which the guard does not depend."""
OUT_OF_VIEW_M = 1.2
"""Distance from mid-track below which the camera sees only the upper part of an obstacle, if any [m]."""


class ObstacleMonitor:
    """Position of an obstacle, kept by belt travel between maps."""

    def __init__(self) -> None:
        self._count = 0
        self._place_m = 0.0

    def look(self, obstacle_m: float | None, travel_m: float) -> None:
        """Update with the obstacle of one map: its distance from mid-track in the direction of the camera [m], or None."""
        self._count = 0 if obstacle_m is None else self._count + 1
        self._place_m = travel_m + (obstacle_m or 0.0)

    def distance_m(self, travel_m: float) -> float:
        """Return the distance from mid-track [m]; infinite if nothing is known."""
        return self._place_m - travel_m if self._count >= OBSTACLE_MAPS else math.inf


class FlatGroundMonitor(ObstacleMonitor):
    """Position of an obstacle on flat ground beyond the stair; it is kept when it is too near to be in view."""

    def look(self, obstacle_m: float | None, travel_m: float) -> None:
        """Update with the obstacle of one frame: its distance from mid-track [m], or None."""
        if obstacle_m is not None or self._place_m - travel_m > OUT_OF_VIEW_M:
            super().look(obstacle_m, travel_m)


class GapMonitor:
    """Position of the nosing before a gap on which the track would rest alone, kept by belt travel between maps.

    Args:
        span_m: Flat run of the belts [m].
    """

    def __init__(self, span_m: float) -> None:
        self._span_m = span_m
        self._count = 0
        self._place_m = 0.0
        self.width_m = 0.0
        """Distance between the nosings at the gap [m]."""

    def look(self, nosings: Sequence[Sequence[float]], travel_m: float) -> None:
        """Update with the nosings of one map, the nearest first: distance from mid-track and height [m]."""
        gap = self._gap(nosings)
        if gap is None or gap[0] > NEAR_M:
            # A gap that is out of view is kept; a gap counts as in view while the nosing before it is, within ``SAME_M``.
            in_view = bool(nosings) and nosings[0][0] - SAME_M < self._place_m - travel_m < nosings[-1][0] - SAME_M
            self._count = max(self._count - in_view, 0)
            return
        place_m = travel_m + gap[0]
        if self._count and abs(place_m - self._place_m) > SAME_M:
            self._count -= 1
            return
        self._count = min(self._count + 1, 2 * GAP_MAPS)
        self._place_m, self.width_m = place_m, gap[1]

    def distance_m(self, travel_m: float) -> float:
        """Return the distance from mid-track [m]; infinite if nothing is known."""
        return self._place_m - travel_m if self._count >= GAP_MAPS else math.inf

    def _gap(self, nosings: Sequence[Sequence[float]]) -> tuple[float, float] | None:
        """Return the distance of the first gap, and the span of the three, or two, nosings that form it [m]; None without a gap."""
        apart = [math.dist(near, far) for near, far in itertools.pairwise(nosings)]
        for k, width in enumerate(apart):
            if width > self._span_m:
                return nosings[k][0], width
            if k and apart[k - 1] + width > self._span_m:
                return nosings[k - (apart[k - 1] >= width)][0], apart[k - 1] + width
        return None


class AheadMonitor:
    """Obstacles and gaps in the direction of the camera."""

    def __init__(self, config: GuardConfig) -> None:
        self._config = config
        self._sign = 1.0
        self._obstacle = ObstacleMonitor()
        self._level = FlatGroundMonitor()
        self._gap = GapMonitor(config.track_span_m)
        self._flight_m = -math.inf
        """Place of the farthest nosing of the latest map [m]; flat ground beyond the stair begins there."""

    def look(self, stair: StairMap, places: Sequence[Sequence[float]], travel_m: float) -> None:
        """Update with one map.

        Args:
            stair: The map.
            places: Its nosings: distance from mid-track in the direction of the camera, and height [m].
            travel_m: Belt travel in the direction of the camera.
        """
        self._sign = 1.0 if stair.direction == "up" else -1.0
        self._obstacle.look(stair.obstacle_m, travel_m)
        self._gap.look(places, travel_m)
        self._flight_m = travel_m + places[-1][0] if places else -math.inf

    def look_on(self, obstacle_m: float | None, plan: MotionPlan | None, travel_m: float) -> None:
        """Update with the obstacle of one frame on flat ground; a step is none, at a stair's foot or before its last nosing."""
        if plan is None or plan.needs_stair or plan.phase not in FLIGHT + OVER:
            self._level = FlatGroundMonitor()
            return
        travel_m *= self._sign
        on_flight = plan.phase in FLIGHT  # over its end the map may show the next one
        is_step = on_flight and obstacle_m is not None and travel_m + obstacle_m < self._flight_m - SAME_M
        self._level.look(None if is_step else obstacle_m, travel_m)

    def cause(self, travel_m: float, speed_m_s: float) -> str | None:
        """Return the obstacle or gap from which the chair would not keep its distance at this speed; None if there is none.

        Args:
            travel_m: Belt travel, negative backwards.
            speed_m_s: Commanded mean belt speed.
        """
        limits, speed = self._config, self._sign * speed_m_s
        if speed <= 0.0:
            return None
        stopping_m = speed * limits.stopping_s
        obstacle_m = min(watch.distance_m(self._sign * travel_m) for watch in (self._obstacle, self._level)) - self._lead_m
        if obstacle_m < limits.obstacle_clear_m + stopping_m:
            return f"obstacle {obstacle_m:.2f} m ahead"
        gap_m = self._gap_m(travel_m)
        if gap_m is not None and gap_m < limits.gap_clear_m + stopping_m:
            return f"{self._gap.width_m:.2f} m from nosing to nosing {gap_m:.2f} m ahead, too long for the track"
        return None

    def speed_restriction(self, travel_m: float) -> str | None:
        """Return the reason of a speed restriction, a gap ahead; None if there is none."""
        gap_m = self._gap_m(travel_m)
        return None if gap_m is None else f"{self._gap.width_m:.2f} m from nosing to nosing {gap_m:.2f} m ahead"

    @property
    def _lead_m(self) -> float:
        return self._config.front_m if self._sign > 0.0 else self._config.rear_m

    def _gap_m(self, travel_m: float) -> float | None:
        """Return the distance from the chair's leading end to a gap, unless the chair is over it."""
        distance_m = self._gap.distance_m(self._sign * travel_m) - self._lead_m
        return distance_m if -self._config.track_span_m < distance_m < math.inf else None
