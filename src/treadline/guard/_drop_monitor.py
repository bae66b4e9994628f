"""Monitor of the ground on floors and landings: the chair stops before a drop, and drives only over ground that was seen or driven.

``FreeGround, StairMap, pitch, travel -> cause``. Places are distances along the way of the belts, as ``AheadMonitor`` keeps
them. An edge is driven over if the planner enters it and the guard's own maps show a falling flight's nosing there. The chair keeps
the same distance from ground that goes out of sight within the camera's range, before a deep drop or a black floor, as from an end.
"""

import math
from typing import Any

from treadline.core.angles import DEG
from treadline.core.signals import FreeGround, ImuSample, Phase, StairMap
from treadline.core.step_sizes import GAP_SEEN_M
from treadline.guard._guard_config import FLIGHT, SAME_M, GuardConfig
from treadline.guard._known import Known, Monitor
from treadline.guard._obstacle_monitor import OBSTACLE_COUNT
from treadline.guard._sightings import Sightings

FLAT_RAD = 5.0 * DEG
"""Largest pitch of a chair on a floor, a landing or a ramp [rad]: ramps for wheelchairs rise by 1:12, 4.8°, and no flight is
flatter than 5° (``scenario.stair``)."""
EDGE_MAPS = 2
"""Number of maps that must show a falling flight's nosing at the end of the ground for the chair to enter it."""
ENTERS: tuple[Phase, ...] = ("approach", "edge")
"""Phases that lead over an edge."""


class _Ground:
    """Ground in one viewing direction. Places are distances along it: the belt travel, plus the distance from mid-track."""

    def __init__(self) -> None:
        self.known_m = self._seen_m = -math.inf
        """Places up to which the ground is known, and up to which the latest frame shows it."""
        self._heading_rad = self._seen_rad = self._known_rad = self._nosing_rad = math.inf
        """Headings of the latest tick, of the latest frame and of the latest map, and for which the known ground holds."""
        self._driven_m, self._under_m = -math.inf, math.nan
        """Places up to which the chair has driven at this heading, and where it is."""
        self._strips: list[tuple[float, float, float]] = []
        """Ground driven before a turn: its heading, its end, and how far aside of it the chair has driven since."""
        self.rise_m = self._rising_m = math.inf
        """Nearest place of a rising flight's nosing in two maps that agree, since the chair came onto flat ground, and in the
        latest. What ends beyond it is not this ground: below open risers the floor is in view between the treads."""
        self.blind_m = -math.inf
        """Place from which on the latest frame could show ground."""
        self._forget_end()

    def _forget_end(self) -> None:
        self._ends = Sightings(*OBSTACLE_COUNT)
        self.end_m = self._shown_m = self._nosing_m = math.inf
        """Nearest possible places of the end by the count of frames and in the latest that showed one, and of the nosing there."""
        self.is_drop = False
        """Whether a frame or the maps have shown a drop at the end, not only that ground goes out of sight there."""
        self._is_hidden = True
        """Whether the end is below the image of every frame, so that the maps alone show it."""
        self._nosing_count = 0

    def look(self, ground: FreeGround, place_m: float, reach_m: float) -> None:
        """Update with the ground of one frame, and the place of mid-track at its exposure.

        Ground on the same level behind a strip below the image is known: a chair bridges a gap as long as its reach from mid-track.
        Beyond a falling flight's edge below the image a frame shows treads, not this ground.
        """
        self.blind_m = place_m + ground.blind_m
        if self.is_confirmed and self.end_m < self.blind_m and not self.is_crossed(reach_m):
            return
        bridges = place_m + ground.blind_m - self.known_m <= reach_m and ground.seen_m > ground.blind_m
        self._seen_m, self._seen_rad = place_m + min(ground.seen_m, GAP_SEEN_M) if bridges else -math.inf, self._heading_rad
        self.known_m = max(self.known_m, self._seen_m)
        shown_m: float | None = None
        if ground.end_m is not None or ground.blind_m < ground.seen_m < GAP_SEEN_M:
            shown_m = place_m + (ground.seen_m if ground.end_m is None else ground.end_m - (ground.end_sigma_m or 0.0))
            self.is_drop = ground.end_m is not None or (abs(shown_m - self._shown_m) < SAME_M and self.is_drop)
            self._shown_m, self._is_hidden = shown_m, False
        if self.is_crossed(reach_m):
            self._ends.forget(self.end_m + SAME_M)
        self._ends.look(shown_m, self.blind_m, place_m + ground.seen_m - SAME_M)
        if (end_m := self._ends.nearest_m()) is not None:
            self.end_m = end_m
        elif self._ends.is_empty and not self._is_hidden:
            self._forget_end()

    def look_on_stair(self, nosing_m: float, reach_m: float, *, is_level: bool) -> None:
        """Update with the place of a falling flight's uppermost nosing in one map.

        A nosing on the chair's level is the end of the ground that the chair stands on, also where the ground before it is below
        the image: two maps that agree show the end, and ground up to it is known as a chair bridges the strip.

        Args:
            nosing_m: Place of the nosing.
            reach_m: Reach of the chair from mid-track.
            is_level: Whether the nosing is on the chair's level.
        """
        if is_level and nosing_m - self.known_m <= reach_m:
            self.known_m = max(self.known_m, nosing_m)
            if self._is_hidden:
                if abs(nosing_m - self._nosing_m) < SAME_M:
                    self.end_m, self._shown_m, self.is_drop = nosing_m, nosing_m, True
                self._nosing_m = nosing_m
        if abs(nosing_m - self._shown_m) < SAME_M:
            self._nosing_m, self._nosing_rad = nosing_m, self._heading_rad
            self._nosing_count += 1

    def look_up_stair(self, nosing_m: float) -> None:
        """Update with the place of a rising flight's nearest nosing in one map."""
        if abs(nosing_m - self._rising_m) < SAME_M:
            self.rise_m = min(self.rise_m, nosing_m)
        self._rising_m = nosing_m

    def drive(self, under_m: float, length_m: float, heading_rad: float, square_rad: float, *, on_flight: bool) -> None:
        """Add the ground under the belts; after a turn only that is known, and the latest frame if it was taken since.

        A chair that has turned back, and not driven aside meanwhile, knows again what it had driven over.

        An edge is past once the chair has tipped over it onto a flight, or lies beyond it: a low kerb hardly tips it. While the
        heading is unknown, an end is kept, and so is the straight edge of a flight that the maps have confirmed: a chair within 45°
        of the heading of the last map still crosses it.
        """
        turn_rad, self._heading_rad = abs(heading_rad - self._known_rad), heading_rad
        if not turn_rad <= square_rad:
            lies_aside = square_rad < abs(heading_rad - self._seen_rad) < math.inf
            self._keep(self._known_rad, min(self._driven_m, self.end_m), square_rad)
            self.known_m, self._known_rad = -math.inf if lies_aside else self._seen_m, heading_rad
            self._driven_m = under_m
        crosses = self.is_confirmed and abs(heading_rad - self._nosing_rad) < 0.25 * math.pi
        if (square_rad < turn_rad < math.inf and not crosses) or under_m > self.end_m + (0.0 if on_flight else length_m):
            self._forget_end()
        self._driven_m = max(self._driven_m, under_m)
        self.known_m = max(self.known_m, self._driven_m, *self._recall(under_m, heading_rad, square_rad))

    def _keep(self, rad: float, end_m: float, square_rad: float) -> None:
        """Keep what was driven over at a heading, in place of less of it at nearly the same one."""
        self._strips = [strip for strip in self._strips if abs(strip[0] - rad) > square_rad or strip[1] > end_m]
        self._strips.append((rad, end_m, 0.0))

    def _recall(self, under_m: float, heading_rad: float, square_rad: float) -> list[float]:
        """Return the ends of what was driven over at about this heading before turns; an unknown heading forgets all.

        Driven at an angle, belts come less far along a strip, and aside of it.
        """
        moved_m, self._under_m = abs(under_m - self._under_m), under_m
        turned = [(rad, end_m, aside_m, abs(heading_rad - rad)) for rad, end_m, aside_m in self._strips]
        strips = [(rad, end_m - moved_m * turn**2, aside_m + moved_m * turn) for rad, end_m, aside_m, turn in turned]
        self._strips = [strip for strip in strips if strip[2] < SAME_M]
        return [end_m for rad, end_m, _ in self._strips if abs(heading_rad - rad) <= square_rad]

    def is_crossed(self, reach_m: float) -> bool:
        """Return whether the chair's middle has passed an edge that the guard's own maps show."""
        return self.is_confirmed and self._driven_m > self.end_m + reach_m

    @property
    def is_confirmed(self) -> bool:
        """Whether the guard's own maps show a falling flight's nosing at the end of the ground."""
        return self._nosing_count >= EDGE_MAPS and abs(self._nosing_m - self.end_m) < SAME_M


class DropMonitor(Monitor):
    """The ground ends, or was neither seen nor driven over, and no plan enters an edge whose nosing the guard's own maps show.

    Time: 0.34 m and the deviation before an end, from the leading pulley; before the pulley leaves known ground.
    Not covered: turning on the spot next to a drop; the state `turn` (row 29: a landing may be narrower); own plants that do
    not declare frames or the ground (`drop_unwatched` says so); edges nearer than the image begins, 0.8 m from mid-track, unless
    seen before; drops below 4 cm, at 2 m below 5.5 cm; travel is that of the belts, slip included.

    A re-arm forgets no ground.
    """

    rows, hears, needs, declared = "27", (ImuSample, FreeGround, StairMap), ("watches_motion",), "awaits_ground"
    unwatched = ("drop_unwatched", "the camera does not report where the ground ends: no stop before a drop")

    def __init__(self, config: GuardConfig) -> None:
        super().__init__(config)
        self._pulley_m = 0.5 * config.track_span_m
        self._ground = {1.0: _Ground(), -1.0: _Ground()}
        """By viewing direction: 1 forwards, -1 backwards."""
        self._flat_s: float | None = None
        """Time since which the chair has been on flat ground; None on a flight."""

    def hear(self, message: Any, known: Known) -> None:
        """Update with an IMU sample, the ground of one frame or a map."""
        match message:
            case ImuSample():
                if abs(message.pitch_rad) > FLAT_RAD:
                    self._flat_s = None
                elif self._flat_s is None:
                    self._flat_s, self._ground[1.0].rise_m = message.t_s, math.inf
            case FreeGround():
                way, reach_m = (1.0, self._config.front_m) if message.view == "front" else (-1.0, self._config.rear_m)
                self._ground[way].look(message, way * known.travel.at(message.t_s)[0], reach_m)
            case _:
                self._look_on_stair(message, known.travel.at(message.t_s)[0])

    def _look_on_stair(self, stair: StairMap, travel_m: float) -> None:
        """Update with the nosings of one map and the belt travel at its exposure.

        Rising flights are seen forwards, falling ones backwards; a map that says otherwise of its nosings shows none. One nosing
        counts if the floor beyond it was seen, as down a kerb. The edge of a landing is one run before a nosing that is one rise
        below the chair, if that is below the image.
        """
        if len(stair.nosings_B) < (1 if stair.ends else 2):
            return
        x_m, _, z_m = stair.nosings_B[0]
        if stair.direction == "up" and x_m > 0.0:
            self._ground[1.0].look_up_stair(x_m + travel_m)
        elif stair.direction == "down" and x_m < 0.0:
            behind, next_m, inner_m = self._ground[-1.0], -x_m - travel_m, -x_m - stair.run_m - travel_m
            is_hidden = abs(z_m + stair.rise_m) < 0.5 * stair.rise_m and inner_m < behind.blind_m
            is_level = self._flat_s is not None and (is_hidden or abs(z_m) < 0.5 * stair.rise_m)
            behind.look_on_stair(inner_m if is_hidden else next_m, self._config.rear_m, is_level=is_level)

    def cause(self, known: Known) -> str | None:
        """Return why the chair may not go on over flat ground; None if it may, or if it is on a flight."""
        travel_m, speed_m_s, plan, heading_rad = known.travel.travel_m, known.mean_m_s, known.followed, known.heading_rad
        for way, ground in self._ground.items():
            under_m, length_m, square_rad = way * travel_m + self._pulley_m, 2.0 * self._pulley_m, self._config.square_rad
            ground.drive(under_m, length_m, heading_rad, square_rad, on_flight=self._flat_s is None)
        phase = None if plan is None else plan.phase
        way, on_flight = math.copysign(1.0, speed_m_s), self._flat_s is None and phase in (*FLIGHT, "edge")
        ground = self._ground[way]
        crosses = ground.is_confirmed if phase in ENTERS else ground.is_crossed(self._config.rear_m)
        if speed_m_s == 0.0 or on_flight or crosses or phase == "turn":
            return None
        pulley_m, stopping_m = way * travel_m + self._pulley_m, abs(speed_m_s) * self._config.stopping_s
        ends_m, known_m = ground.end_m - pulley_m, ground.known_m - pulley_m
        # Where the planner enters a flight, or the chair pitches, ground out of sight is usual.
        counts = ground.is_drop or (phase not in ENTERS and self._flat_s is not None)
        if counts and ground.end_m < ground.rise_m and ends_m < self._config.obstacle_clear_m + stopping_m:
            ends = "the ground ends" if ground.is_drop else "no ground is seen beyond"
            return f"{ends} {ends_m:.2f} m from the belts' leading pulley"
        # A chair that has just come down onto flat ground has not seen it yet.
        if self._flat_s is not None and known_m < stopping_m and known.t_s - self._flat_s > self._config.silence_s:
            side = "ahead of" if way > 0.0 else "behind"
            return f"the ground {max(known_m, 0.0):.2f} m {side} the belts was neither seen nor driven over"
        return None
