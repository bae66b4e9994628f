"""Slip of the belts: their travel against that of the nosings (row 14). ``nosing distances, belt travel -> cause``."""

import math
from collections import deque
from collections.abc import Sequence
from typing import Any

from treadline.core.signals import ROUNDING_S, MotionPlan, StairMap
from treadline.core.slip import DRIVEN_LEAST_M, slip_ratio
from treadline.guard._guard_config import FLIGHT, SAME_M, GuardConfig
from treadline.guard._known import Known, Monitor

MATCH_S = 0.35
"""Longest time between two maps whose nosings are compared [s]."""
SLID_LEAST_M = 0.015
"""Smallest slip in a window that is judged [m]; below, noise of the nosings would count as slip."""
FALLING = 0.6
"""Ratio to the slip at the start of a wait below which the chair catches up with its belts and the wait starts again; the noise of
a constant slip is below a fifth."""


class SlipMonitor(Monitor):
    """Slip above 0.3 against the nosings; roll-back of 0.25 m.

    Time: slow, hold after 0.5 s; at once.
    Not covered: slip while no nosing is in view.

    Each nosing is matched with the nearest expected one. A chair whose belts differ travels as far as one of them or anything
    between: only what lies outside is slip. A chair that turns on nosings skids, by at most a gauge for each radian, which is no
    slip either. Slip is judged only while the chair is square, roll-back always. When the nosings go out of view, the slip
    measurement starts again and the roll-back is kept: unobserved forward travel does not reduce it, and unobserved sliding counts
    as far as the nosings can still be matched.

    A decreasing slip distance belongs to a chair that catches up with its belts, for example after a turn. Each decrease below
    ``FALLING`` restarts the wait, at most four times between a standing chair with belts at 0.2 m/s and the smallest slip. The
    criterion is the slip distance and not the slip ratio, which stays constant when the guard slows the belts down.
    """

    rows, hears, needs = "14", (StairMap, MotionPlan), ("watches_motion", "watches_slip")

    def __init__(self, config: GuardConfig) -> None:
        super().__init__(config)
        self._source = "driver"
        self._t_s = -math.inf
        self._travel_m = self._ahead_m = 0.0
        self._places: Sequence[float] = ()
        self._roll_back_m = self._back_m = self._since_slid_m = 0.0
        self._window: deque[tuple[float, float, float, float]] = deque()
        self._since_s: float | None = None
        self.slip = 0.0
        """Slip ratio if it exceeds the limit, otherwise 0."""

    def hear(self, message: Any, known: Known) -> None:
        """Update with one map; a plan off the flight, and another source of commands, begin anew."""
        leaves = isinstance(message, MotionPlan) and message.phase not in FLIGHT and known.source == "driver"
        if leaves or known.source != self._source:
            self.begin()
        self._source = known.source
        if isinstance(message, StairMap):
            self._hear_map(message, known)

    def _hear_map(self, stair: StairMap, known: Known) -> None:
        """Compare a map's nosings with the belts, on the flight.

        In other phases the chair pitches, or is on flat ground, and nosings do not pass at belt speed. A chair that climbs to turn
        square, with its camera on the flight below, does not roll back.
        """
        plan = known.followed
        on_flight = plan is None or (plan.phase in FLIGHT and (stair.direction == "up") == (plan.speed_m_s >= 0.0))
        if not on_flight or math.isinf(known.heading_rad):
            self.restart(known)
            return
        sign, across = 1.0 if self._config.view == "front" else -1.0, math.cos(known.heading_rad)
        travel_m, slow_m = known.travel.at(stair.t_s)
        there_m = [sign * x_m * across for x_m, _, _ in stair.nosings_B]
        self.look(stair.t_s, there_m, sign * slow_m, known.heading_rad, 2.0 * sign * (travel_m - slow_m))

    def restriction(self, known: Known) -> tuple[str, str] | None:
        """Return the slip, if it exceeds the limit."""
        return ("slip", f"slip {self.slip:.2f}") if self.slip > 0.0 else None

    def look(self, t_s: float, places_m: Sequence[float], travel_m: float, heading_rad: float, ahead_m: float = 0.0) -> None:
        """Update with the nosings of one map.

        Args:
            t_s: Time of the exposure.
            places_m: Distances of the nosings from mid-track, perpendicular to them.
            travel_m: Travel of the slower belt towards the nosings.
            heading_rad: Heading estimate.
            ahead_m: Travel of the faster belt beyond that of the slower one.
        """
        if not places_m:
            self._lose()
            return
        driven_m = travel_m - self._travel_m if self._places else 0.0
        roll_back_m = self._slid(places_m, driven_m, ahead_m - self._ahead_m)
        came_m = driven_m - (roll_back_m or 0.0)
        if roll_back_m is None or not self._window or t_s - self._t_s > MATCH_S:
            self._lose()
            came_m = came_m if came_m < DRIVEN_LEAST_M else 0.0
        else:
            self._roll_back_m += roll_back_m
        self._t_s, self._places, self._travel_m, self._ahead_m = t_s, places_m, travel_m, ahead_m
        self._window.append((t_s, travel_m, self._roll_back_m, heading_rad))
        self._judge(t_s)
        self._back_m = max(self._back_m - came_m, 0.0)
        if self._back_m > self._config.roll_back_m:
            self._cause = f"rolled back {self._back_m:.2f} m"

    def begin(self) -> None:
        """Reset the roll-back."""
        self._back_m = 0.0
        self._places = ()

    def restart(self, known: Known) -> None:
        """Start again: reset slip and roll-back."""
        self.begin()
        self._lose()

    def _lose(self) -> None:
        """Reset the slip, because the nosings are not in view."""
        self._window.clear()
        self._since_s = self._cause = None
        self.slip = 0.0

    def _slid(self, places_m: Sequence[float], driven_m: float, ahead_m: float) -> float | None:
        """Return belt travel minus travel of the nosings since the last map [m]; None if the nosings cannot be matched.

        Args:
            ahead_m: Travel of the faster belt beyond that of the slower one: what lies between them is no slip.
        """
        expected = [place - driven_m for place in self._places]
        if not expected:
            return None
        apart = sorted(min((place - there for there in expected), key=abs) for place in places_m)
        middle = apart[len(apart) // 2]
        return middle - min(max(middle, min(-ahead_m, 0.0)), max(-ahead_m, 0.0)) if abs(middle) <= SAME_M else None

    def _judge(self, t_s: float) -> None:
        limits, window_s = self._config, self._config.lasting_s - ROUNDING_S
        while len(self._window) > 1 and t_s - self._window[1][0] >= window_s:
            self._window.popleft()
        then_s, travel_m, roll_back_m, _ = self._window[0]
        driven, slid = abs(self._travel_m - travel_m), abs(self._roll_back_m - roll_back_m)
        headings = [heading for *_, heading in self._window]
        turned_rad = max(headings) - min(headings)
        if turned_rad > limits.slip_turn_rad:  # a chair that turns about a point up to a gauge aside skids by as much
            slid = max(slid - limits.gauge_m * turned_rad, 0.0)
        square = max(abs(heading) for heading in headings) <= limits.square_rad
        judged = square and t_s - then_s >= window_s and driven >= DRIVEN_LEAST_M
        self.slip = slip_ratio(slid, driven) if judged and slid > max(limits.normal_slip * driven, SLID_LEAST_M) else 0.0
        if self.slip == 0.0:
            self._since_s = None
        elif self._since_s is None or slid < FALLING * self._since_slid_m:
            self._since_s, self._since_slid_m = t_s, slid
        elif t_s - self._since_s >= window_s:
            self._cause = f"slip {self.slip:.2f}: the chair is {slid:.2f} m off its belts in {t_s - then_s:.1f} s"
