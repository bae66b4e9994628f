"""What lies ahead: something in the way (row 25), and steps too far apart for the track (row 17)."""

import itertools
import math
from collections.abc import Sequence

from treadline.mission.guard.config import GuardConfig
from treadline.mission.guard.phases import FLIGHT, OVER
from treadline.signals import MotionPlan, StairMap

OBSTACLE_MAPS, GAP_MAPS = 2, 5
"""That must show a thing in a row, or a gap more often than not: a nosing that a detector loses is lost for three or four maps."""
SAME_M = 0.15
"""Half a nosing pitch: within it, two findings are of one gap."""
NEAR_M = 1.9
"""Of a gap from mid-track, as the planner's (``mission.stair_tracker``), of which the guard must not know."""
OUT_OF_VIEW_M = 1.2
"""From mid-track: nearer the camera sees a thing's upper part at best."""


class ObstacleMonitor:
    """Remembers where something stands, and says how far the chair's leading end is from it."""

    def __init__(self) -> None:
        self._count = 0
        self._place_m = 0.0

    def look(self, obstacle_m: float | None, travel_m: float) -> None:
        """Take one map's answer: a distance from mid-track towards where the camera looks."""
        self._count = 0 if obstacle_m is None else self._count + 1
        self._place_m = travel_m + (obstacle_m or 0.0)

    def distance_m(self, travel_m: float) -> float:
        """Return the distance from mid-track, or infinity."""
        return self._place_m - travel_m if self._count >= OBSTACLE_MAPS else math.inf


class FlatGroundMonitor(ObstacleMonitor):
    """The same for the level beyond the stair: what has come too near to be in view is still there."""

    def look(self, obstacle_m: float | None, travel_m: float) -> None:
        """Take one frame's answer."""
        if obstacle_m is not None or self._place_m - travel_m > OUT_OF_VIEW_M:
            super().look(obstacle_m, travel_m)


class GapMonitor:
    """Remembers where the track would rest on one nosing: the nosing before the gap, by the belts' travel."""

    def __init__(self, span_m: float) -> None:
        self._span_m = span_m
        self._count = 0
        self._place_m = 0.0
        self.width_m = 0.0

    def look(self, nosings: Sequence[Sequence[float]], travel_m: float) -> None:
        """Take the nosings (distance from mid-track, height) of one map, the nearest first."""
        gap = self._gap(nosings)
        if gap is None or gap[0] > NEAR_M:
            # One that is no longer in view is not gone; it is while the nosing before it is, give or take.
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
        """Return the distance from mid-track, or infinity."""
        return self._place_m - travel_m if self._count >= GAP_MAPS else math.inf

    def _gap(self, nosings: Sequence[Sequence[float]]) -> tuple[float, float] | None:
        """Return where the first gap begins, and the span of the three nosings, or of two, that make it."""
        apart = [math.dist(near, far) for near, far in itertools.pairwise(nosings)]
        for k, width in enumerate(apart):
            if width > self._span_m:
                return nosings[k][0], width
            if k and apart[k - 1] + width > self._span_m:
                return nosings[k - (apart[k - 1] >= width)][0], apart[k - 1] + width
        return None


class AheadMonitor:
    """Both, on the side that the camera looks to."""

    def __init__(self, config: GuardConfig) -> None:
        self._config = config
        self._sign = 1.0
        self._obstacle = ObstacleMonitor()
        self._level = FlatGroundMonitor()
        self._gap = GapMonitor(config.track_span_m)

    def look(self, stair: StairMap, places: Sequence[Sequence[float]], travel_m: float) -> None:
        """Take one map, its nosings as distance from mid-track and height, and the belts' travel towards them."""
        self._sign = 1.0 if stair.direction == "up" else -1.0
        self._obstacle.look(stair.obstacle_m, travel_m)
        self._gap.look(places, travel_m)

    def look_on(self, obstacle_m: float | None, plan: MotionPlan | None, travel_m: float) -> None:
        """Take what one frame shows on the level where the camera looks; at a stair's foot that is its first step."""
        if plan is None or plan.needs_stair or plan.phase not in FLIGHT + OVER:
            self._level = FlatGroundMonitor()
        else:
            self._level.look(obstacle_m, self._sign * travel_m)

    def cause(self, travel_m: float, speed_m_s: float) -> str | None:
        """Return what the chair would come too near to, driving on; None if nothing.

        Args:
            travel_m: Of the belts, backwards negative.
            speed_m_s: Asked of the belts.
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
        """Return that a gap is known ahead, or None."""
        gap_m = self._gap_m(travel_m)
        return None if gap_m is None else f"{self._gap.width_m:.2f} m from nosing to nosing {gap_m:.2f} m ahead"

    @property
    def _lead_m(self) -> float:
        return self._config.front_m if self._sign > 0.0 else self._config.rear_m

    def _gap_m(self, travel_m: float) -> float | None:
        """Return the distance from the chair's leading end to a gap, unless the chair is over it."""
        distance_m = self._gap.distance_m(self._sign * travel_m) - self._lead_m
        return distance_m if -self._config.track_span_m < distance_m < math.inf else None
