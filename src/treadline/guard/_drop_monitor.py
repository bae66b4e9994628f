"""Monitor of the ground on floors and landings: the chair stops before a drop, and drives only over ground that was seen or driven.

``FreeGround, StairMap, pitch, travel -> cause``. Places are distances along the way of the belts, as ``AheadMonitor`` keeps
them. An edge is driven over if the planner enters it and the guard's own maps show a falling flight's nosing there.
"""

import math

from treadline.core.angles import DEG
from treadline.core.signals import FreeGround, MotionPlan, Phase, StairMap
from treadline.guard._guard_config import FLIGHT, SAME_M, GuardConfig
from treadline.guard._obstacle_monitor import NEAR_M, OBSTACLE_MAPS

FLAT_RAD = 5.0 * DEG
"""Largest pitch of a chair on a floor, a landing or a ramp [rad]: ramps for wheelchairs rise by 1:12, 4.8°, and no flight is
flatter than 5° (``scenario.stair``)."""
ENTERS: tuple[Phase, ...] = ("approach", "edge")
"""Phases that lead over an edge."""


class DropMonitor:
    """Known ground in both directions, and the end of the ground in the viewing direction."""

    def __init__(self, config: GuardConfig) -> None:
        self._config = config
        self._pulley_m = 0.5 * config.track_span_m
        self._way = 1.0
        """Viewing direction of the last frame: 1 forwards, -1 backwards. Places in a direction are its sign times the travel."""
        self._known_m = {1.0: -math.inf, -1.0: -math.inf}
        """Place up to which the ground is known, by direction."""
        self._seen_m = -math.inf
        self._end_m = self._nosing_m = math.inf
        """Nearest possible place of the end, and place of the uppermost nosing of a falling flight."""
        self._end_count = self._nosing_count = 0
        self._flat_s: float | None = None
        """Time since which the chair has been on flat ground; None on a flight."""
        self._heading_rad = math.inf
        """Heading for which the known ground holds."""

    def update_motion(self, t_s: float, pitch_rad: float) -> None:
        """Update with the pitch of one IMU sample."""
        if abs(pitch_rad) > FLAT_RAD:
            self._flat_s = None
        elif self._flat_s is None:
            self._flat_s = t_s

    def look(self, ground: FreeGround, travel_m: float) -> None:
        """Update with the ground of one frame and the belt travel at its exposure."""
        way = 1.0 if ground.view == "front" else -1.0
        if way != self._way:
            self._way, self._seen_m = way, -math.inf
            self._forget_end()
        place_m = way * travel_m
        # Ground on the same level behind a strip below the image: a chair bridges a gap as long as its reach from mid-track.
        strip_m, reach_m = place_m + ground.blind_m - self._known_m[way], self._config.front_m if way > 0.0 else self._config.rear_m
        if strip_m <= reach_m and ground.seen_m > ground.blind_m:
            self._seen_m = place_m + min(ground.seen_m, NEAR_M)
            self._known_m[way] = max(self._known_m[way], self._seen_m)
        if ground.end_m is not None:
            self._end_m = place_m + ground.end_m - (ground.end_sigma_m or 0.0)
            self._end_count += 1
        elif place_m + ground.blind_m < self._end_m < place_m + ground.seen_m - SAME_M:
            self._forget_end()

    def look_on_stair(self, stair: StairMap, travel_m: float) -> None:
        """Update with the nosings of one map and the belt travel at its exposure."""
        ahead_m = [-x for x, _, _ in stair.nosings_B]
        if stair.direction == "down" and len(ahead_m) > 1 and abs(ahead_m[0] - travel_m - self._end_m) < SAME_M:
            self._nosing_m = ahead_m[0] - travel_m
            self._nosing_count += 1

    def cause(self, t_s: float, travel_m: float, speed_m_s: float, plan: MotionPlan | None, heading_rad: float) -> str | None:
        """Return why the chair may not go on over flat ground; None if it may, or if it is on a flight.

        Args:
            t_s: Time of the tick.
            travel_m: Belt travel, negative backwards.
            speed_m_s: Commanded mean belt speed.
            plan: Latest plan, if any.
            heading_rad: Heading; infinite if unknown.
        """
        self._drive(travel_m, heading_rad)
        phase = None if plan is None else plan.phase
        way, on_flight = math.copysign(1.0, speed_m_s), self._flat_s is None and phase in (*FLIGHT, "edge")
        if speed_m_s == 0.0 or on_flight or (way == self._way and phase in ENTERS and self._is_confirmed):
            return None
        pulley_m, stopping_m = way * travel_m + self._pulley_m, abs(speed_m_s) * self._config.stopping_s
        ends_m, known_m = self._end_m - pulley_m, self._known_m[way] - pulley_m
        if way == self._way and self._end_count >= OBSTACLE_MAPS and ends_m < self._config.obstacle_clear_m + stopping_m:
            return f"the ground ends {ends_m:.2f} m from the belts' leading pulley"
        # A chair that has just come down onto flat ground has not seen it yet.
        if self._flat_s is not None and known_m < stopping_m and t_s - self._flat_s > self._config.silence_s:
            side = "ahead of" if way > 0.0 else "behind"
            return f"the ground {max(known_m, 0.0):.2f} m {side} the belts was neither seen nor driven over"
        return None

    @property
    def _is_confirmed(self) -> bool:
        """Whether the guard's own maps show a falling flight's nosing at the end of the ground."""
        return self._nosing_count >= OBSTACLE_MAPS and abs(self._nosing_m - self._end_m) < SAME_M

    def _drive(self, travel_m: float, heading_rad: float) -> None:
        """Add the ground under the belts to the known ground; a chair that has turned knows no other ground behind it.

        An edge is past once the chair has tipped over it onto a flight.
        """
        turned = not abs(heading_rad - self._heading_rad) <= self._config.square_rad
        for way in self._known_m:
            under_m = way * travel_m + self._pulley_m
            self._known_m[way] = under_m if turned else max(self._known_m[way], under_m)
        if turned:
            self._heading_rad = heading_rad
            self._known_m[self._way] = max(self._known_m[self._way], self._seen_m)
        if self._flat_s is None and self._way * travel_m + self._pulley_m > self._end_m:
            self._forget_end()

    def _forget_end(self) -> None:
        self._end_m = self._nosing_m = math.inf
        self._end_count = self._nosing_count = 0
