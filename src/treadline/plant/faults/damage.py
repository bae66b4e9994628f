"""Damage of the chair and obstacles in its path: faults simulated by the physics.

``Faults, t -> Damage``; each value replaces the previous one, so that ended faults are repaired.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from treadline.core.angles import DEG
from treadline.core.ports import TruthPlant
from treadline.scenario.faults import Conditions, Fault, FaultKind, payload_shift_m

PHYSICAL: tuple[FaultKind, ...] = (
    "track_stalled", "track_slip", "low_friction", "seat_stuck", "power_cut", "obstacle", "false_edges", "flipper_lost",
"flipper_stuck", "payload_forward", "payload_left", "payload_up" )  # fmt: skip
"""Kinds of faults simulated by the physics."""
LEFT, RIGHT = 0, 1
UNCHANGED = Conditions()


@dataclass(frozen=True, slots=True, kw_only=True)
class Damage:
    """Damage of the chair and obstacles in its path at one instant; the default is no damage."""

    stalled: tuple[bool, bool] = (False, False)
    """Whether the left and the right belt are blocked."""
    grip: tuple[float, float] = (1.0, 1.0)
    """Factor on the friction of each belt, along and across."""
    power_cut: bool = False
    seat_stuck: bool = False
    flipper_lost: bool = False
    flipper_stuck: bool = False
    obstacle_m: float | None = None
    """Initial distance from the leading end to a box in the path [m]."""
    bar_rad: float | None = None
    """Angle of a bar across the nosings in view [rad], at its initial position."""
    payload_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Shift of the passenger's centre of mass in the seat [m]: forward, left, up."""


@runtime_checkable
class Breakable(TruthPlant, Protocol):
    """Simulated chair with support for damage."""

    def set_damage(self, damage: Damage) -> None:
        """Replace the present damage of the chair."""


def damage_of(faults: Iterable[Fault], t_s: float, conditions: Conditions = UNCHANGED) -> Damage:
    """Return the damage by all faults active at ``t_s``; of several obstacles or bars the first is used.

    Args:
        conditions: Friction, multiplied with that of the faults, and shift of the payload, added to theirs.
    """
    on = [fault for fault in faults if fault.active(t_s)]
    kinds = {fault.kind for fault in on}
    stalled = {int(fault.size) for fault in on if fault.kind == "track_stalled"}
    (x, y, z), (dx, dy, dz) = conditions.payload_m, payload_shift_m(on, t_s)
    return Damage(
        stalled=(LEFT in stalled, RIGHT in stalled),
        grip=(conditions.friction[LEFT] * _grip(on, LEFT), conditions.friction[RIGHT] * _grip(on, RIGHT)),
        power_cut="power_cut" in kinds,
        seat_stuck="seat_stuck" in kinds,
        flipper_lost="flipper_lost" in kinds,
        flipper_stuck="flipper_stuck" in kinds,
        obstacle_m=next((fault.size for fault in on if fault.kind == "obstacle"), None),
        bar_rad=next((fault.size * DEG for fault in on if fault.kind == "false_edges"), None),
        payload_m=(x + dx, y + dy, z + dz),
    )


def _grip(on: list[Fault], side: int) -> float:
    share = 1.0
    for fault in on:
        if fault.kind == "low_friction" or (fault.kind == "track_slip" and (fault.size < 0.0) == (side == RIGHT)):
            share *= abs(fault.size)
    return share
