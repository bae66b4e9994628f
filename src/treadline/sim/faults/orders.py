"""The way of orders from the mission to the actuators: late, lost, and watched over at its end.

``Order -> Order | None``. A timeout in the computer does not help when the computer or its line dies, so the last watchdog
is the actuators' own (hazards 11 and 22). It belongs to the faulty chair and not to every simulated one: experiments and tests
write once and let time pass, and a mission without faults writes a hundred times a second.
"""

from collections.abc import Sequence
from typing import NamedTuple

from treadline.faults import SAME_TIME_S, Fault, Process, is_killed
from treadline.signals import FlipperCommand, SeatCommand, TrackCommand

SILENCE_S = 0.3
"""Without an order before the actuators brake: more than a control period of 0.25 s, and what is left of hazard 11's 0.8 s
once the belts have stopped."""

RATE_SILENCE_S = 0.05
"""Without an order before seat and flipper stand: a rate is for the moment, and they are told one a hundred times a second."""


class Order(NamedTuple):
    """One write."""

    tracks: TrackCommand
    seat: SeatCommand
    flipper: FlipperCommand | None

    @classmethod
    def stop(cls, t_s: float) -> "Order":
        """Return the order that the actuators give themselves."""
        return cls(TrackCommand.stop(t_s), SeatCommand(t_s=t_s, rate_m_s=0.0), None)


class Line:
    """Carries orders, as late as its faults say."""

    def __init__(self, faults: Sequence[Fault]) -> None:
        self._faults = faults
        self._under_way: list[tuple[float, Order]] = []
        self._seat = SeatCommand(t_s=0.0, rate_m_s=0.0)
        self._seat_s = 0.0

    def send(self, t_s: float, order: Order) -> None:
        """Take an order on its way; it overtakes those that would arrive after it."""
        if is_killed(self._faults, Process.MISSION, t_s):
            return
        late_s = max((fault.size for fault in self._faults if fault.kind == "late_tick" and fault.active(t_s)), default=0.0)
        due_s = t_s + late_s
        self._under_way = [(due, earlier) for due, earlier in self._under_way if due < due_s]
        self._under_way.append((due_s, order._replace(seat=self._seat_order(t_s, order.seat))))

    def arrived(self, t_s: float) -> Order | None:
        """Return the newest order that has arrived since the last call, if any."""
        arrived = [order for due_s, order in self._under_way if due_s <= t_s + SAME_TIME_S]
        self._under_way = self._under_way[len(arrived) :]
        return arrived[-1] if arrived else None

    def _seat_order(self, t_s: float, order: SeatCommand) -> SeatCommand:
        """Return what the seat's actuator goes by: its own process may be dead."""
        if not is_killed(self._faults, Process.SEAT, t_s):
            self._seat, self._seat_s = order, t_s
        elif t_s - self._seat_s > SILENCE_S + SAME_TIME_S:
            self._seat = SeatCommand(t_s=t_s, rate_m_s=0.0)
        return self._seat


class Watchdog:
    """The actuators' own: brakes in silence or without power, and lets go once it was asked to stand still."""

    def __init__(self) -> None:
        self._heard_s: float | None = None
        self._last: Order | None = None
        self._latched = False

    def step(self, t_s: float, order: Order | None, *, powered: bool) -> Order | None:
        """Return what the actuators do with an order, or with its absence; None to go on as before."""
        was_latched = self._latched
        silent = order is None and self._heard_s is not None and t_s - self._heard_s > SILENCE_S + SAME_TIME_S
        self._latched = was_latched or silent or not powered
        if order is None:
            return Order.stop(t_s) if self._latched and not was_latched else self._stilled(t_s)
        self._heard_s, self._last = t_s, order
        if powered and order.tracks.left_m_s == 0.0 and order.tracks.right_m_s == 0.0:
            self._latched = False
        return order._replace(tracks=TrackCommand.stop(t_s)) if self._latched else order

    def _stilled(self, t_s: float) -> Order | None:
        """Return the last order with seat and flipper at rest, once it is too old for them; None before, and after."""
        if self._last is None or self._heard_s is None or self._latched or t_s - self._heard_s <= RATE_SILENCE_S + SAME_TIME_S:
            return None
        flipper = None if self._last.flipper is None else FlipperCommand(t_s=t_s, rate_rad_s=0.0)
        stilled, self._last = self._last._replace(seat=SeatCommand(t_s=t_s, rate_m_s=0.0), flipper=flipper), None
        return stilled
