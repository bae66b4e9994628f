"""Belts that do what they are told: as fast as asked (rows 13 and 14), and as far as the nosings show (row 14)."""

import math
from collections import deque
from collections.abc import Sequence

from treadline.mission.guard.belt_travel import BeltTravel
from treadline.mission.guard.config import GuardConfig
from treadline.signals import TrackCommand, TrackReading

BRAKE_M_S2 = 10.0
"""Deceleration of a belt when the brake falls in; the guard's own number, not the plant's: it judges the drives."""
ROUNDING_S = 1e-6


class BeltMonitor:
    """Compares each belt with what its drive should make of the command: a lag within an acceleration limit."""

    def __init__(self, config: GuardConfig) -> None:
        self._config = config
        self._asked = TrackCommand.stop(0.0)
        self._t_s = 0.0
        self.travel = BeltTravel()
        self._expected = [0.0, 0.0]
        self._since_s: list[float | None] = [None, None]
        self._braked_s: float | None = None
        self.cause: str | None = None
        """Which belt does not obey, or that the brake does not."""

    @property
    def expected_m_s(self) -> tuple[float, float]:
        """Belt speeds that the drives should have reached, left and right, within the belts' limit."""
        limit = self._config.belt_limit_m_s
        left, right = (min(max(speed, -limit), limit) for speed in self._expected)
        return left, right

    @property
    def travel_m(self) -> float:
        """Distance driven by the belts, backwards negative [m]."""
        return self.travel.travel_m

    def ask(self, command: TrackCommand) -> None:
        """Note what the belts are told."""
        self._asked = command

    def update(self, reading: TrackReading) -> None:
        """Take what the drives report."""
        dt_s = self.travel.update(reading)
        self._t_s = reading.t_s
        belts = (reading.left_m_s, reading.right_m_s)
        if dt_s is None:
            self._expected = list(belts)
            self._since_s = [None, None]
            self._braked_s = None
            return
        self._note_brake(on=reading.brake_on)
        for side, asked in enumerate((self._asked.left_m_s, self._asked.right_m_s)):
            self._expected[side] = self._driven(self._expected[side], asked, dt_s)
            self._compare(side, belts[side])

    def forget(self) -> None:
        """Take the next reading as it is."""
        self.travel.forget()
        self.cause = None

    def _note_brake(self, *, on: bool) -> None:
        """Tell a brake that nobody asked for: power is cut, or orders do not arrive, even where the belts are to stand."""
        if not on or self._asked.brake:
            self._braked_s = None
        elif self._braked_s is None:
            self._braked_s = self._t_s
        elif self._t_s - self._braked_s >= self._config.mismatch_s - ROUNDING_S:
            self.cause = "the brake is on, and nobody asked for it: no power, or no orders arrive"

    def _driven(self, speed: float, asked: float, dt_s: float) -> float:
        if self._asked.brake:
            step = BRAKE_M_S2 * dt_s
            return speed - min(max(speed, -step), step)
        step = self._config.drive_acceleration_m_s2 * dt_s
        change = (1.0 - math.exp(-dt_s / self._config.drive_lag_s)) * (asked - speed)
        return speed + min(max(change, -step), step)

    def _compare(self, side: int, speed: float) -> None:
        limits, expected, since_s = self._config, self._expected[side], self._since_s[side]
        if abs(speed - expected) <= limits.mismatch * abs(expected) + limits.mismatch_spare_m_s:
            self._since_s[side] = None
        elif since_s is None:
            self._since_s[side] = self._t_s
        elif self._t_s - since_s >= limits.mismatch_s - ROUNDING_S:
            name, runs_away = ("left", "right")[side], abs(speed) > abs(expected)
            fault = "runs away" if runs_away else "is stalled"
            self.cause = f"{name} track {fault}: {speed:.2f} m/s where {expected:.2f} is expected"


MATCH_M = 0.14
"""Between a nosing and where it was expected: less than half of the shortest pitch."""
MATCH_S = 0.35
"""Between two maps whose nosings are compared."""
DRIVEN_LEAST_M, SLID_LEAST_M = 0.03, 0.015
"""Of travel in a window: below, noise of the nosings' places would be slip."""
FALLING = 0.6
"""Share of the way slid in a window, with which a wait began; below it the chair catches up. A steady one is noisy by less than a
fifth."""


class SlipMonitor:
    """Compares the travel of the belts with that of the nosings, modulo their pitch: each is matched with its nearest.

    A chair that turns on nosings skids, and keeps little of its belts' travel: slip is judged only where it is square and does not
    turn, rolling back wherever it does. Nosings out of view start the slip anew, but not what was rolled back: what the chair came
    forward unseen does not make good for it, and what it slid back meanwhile counts as far as a nosing is told from its neighbour.
    Slip that falls belongs to a chair that catches up with its belts, as where they slow down after a turn: the wait begins anew
    with each fall, at most four times from belts at 0.2 m/s and a chair that stands to the least that is called slip. It is the way
    slid that must fall, not its share of the belts' way: belts that are slowed down for it would keep that up.
    """

    def __init__(self, config: GuardConfig) -> None:
        self._config = config
        self._t_s = -math.inf
        self._travel_m = 0.0
        self._places: Sequence[float] = ()
        self._roll_back_m = 0.0
        self._back_m = 0.0
        self._window: deque[tuple[float, float, float, float]] = deque()
        self._since_s: float | None = None
        self._since_slid_m = 0.0
        self.slip = 0.0
        """Share of the belts' travel, if it is too much; else zero."""
        self.cause: str | None = None

    def look(self, t_s: float, places_m: Sequence[float], travel_m: float, heading_rad: float) -> None:
        """Take one map.

        Args:
            places_m: Of the nosings from mid-track, square to them.
            travel_m: Of the belts towards them.
        """
        if not places_m:
            self._lose()
            return
        driven_m = travel_m - self._travel_m if self._places else 0.0
        roll_back_m = self._slid(places_m, driven_m)
        came_m = driven_m - (roll_back_m or 0.0)
        if roll_back_m is None or not self._window or t_s - self._t_s > MATCH_S:
            self._lose()
            came_m = came_m if came_m < DRIVEN_LEAST_M else 0.0
        else:
            self._roll_back_m += roll_back_m
        self._t_s, self._places, self._travel_m = t_s, places_m, travel_m
        self._window.append((t_s, travel_m, self._roll_back_m, heading_rad))
        self._judge(t_s)
        self._roll(came_m)

    def begin(self) -> None:
        """Count from here on what is rolled back."""
        self._back_m = 0.0
        self._places = ()

    def forget(self) -> None:
        """Start anew."""
        self.begin()
        self._lose()

    def _lose(self) -> None:
        """Start the slip anew: the nosings are not in view."""
        self._window.clear()
        self._since_s = self.cause = None
        self.slip = 0.0

    def _slid(self, places_m: Sequence[float], driven_m: float) -> float | None:
        """Return what the nosings do not show of the belts' travel since the last map; None where these are other nosings."""
        expected = [place - driven_m for place in self._places]
        if not expected:
            return None
        apart = sorted(min((place - there for there in expected), key=abs) for place in places_m)
        middle = apart[len(apart) // 2]
        return middle if abs(middle) <= MATCH_M else None

    def _judge(self, t_s: float) -> None:
        limits, window_s = self._config, self._config.slip_s - ROUNDING_S
        while len(self._window) > 1 and t_s - self._window[1][0] >= window_s:
            self._window.popleft()
        then_s, travel_m, roll_back_m, _ = self._window[0]
        driven, slid = abs(self._travel_m - travel_m), abs(self._roll_back_m - roll_back_m)
        headings = [heading for *_, heading in self._window]
        square = max(abs(heading) for heading in headings) <= limits.turning_rad
        straight = square and max(headings) - min(headings) <= limits.slip_turn_rad
        judged = straight and t_s - then_s >= window_s and driven >= DRIVEN_LEAST_M
        self.slip = slid / driven if judged and slid > max(limits.slip * driven, SLID_LEAST_M) else 0.0
        if self.slip == 0.0:
            self._since_s = None
        elif self._since_s is None or slid < FALLING * self._since_slid_m:
            self._since_s, self._since_slid_m = t_s, slid
        elif t_s - self._since_s >= window_s:
            self.cause = f"slip {self.slip:.2f}: the chair is {slid:.2f} m off its belts in {t_s - then_s:.1f} s"

    def _roll(self, came_m: float) -> None:
        """Note how far the chair has come by the nosings since the last map."""
        self._back_m = max(self._back_m - came_m, 0.0)
        if self._back_m > self._config.roll_back_m:
            self.cause = f"rolled back {self._back_m:.2f} m"
