"""What is broken of a chair, or stands in its way: the faults that only the physics can play.

``Faults, t -> Damage``; the simulated chair takes it as it is now, and mends what is no longer in it.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from treadline.angles import DEG
from treadline.faults import Fault, FaultKind
from treadline.ports import TruthPlant

PHYSICAL: tuple[FaultKind, ...] = (
    "track_stalled", "track_slip", "low_friction", "seat_stuck", "power_cut", "obstacle", "false_edges", "flipper_lost",
"flipper_stuck" )  # fmt: skip
LEFT, RIGHT = 0, 1


@dataclass(frozen=True, slots=True, kw_only=True)
class Damage:
    """The state of a chair and its way at one instant; as it stands here, nothing is wrong."""

    stalled: tuple[bool, bool] = (False, False)
    """Whether the left and the right belt stand, whatever is asked."""
    grip: tuple[float, float] = (1.0, 1.0)
    """Share of its friction that each belt has left, along and across."""
    power_cut: bool = False
    seat_stuck: bool = False
    flipper_lost: bool = False
    flipper_stuck: bool = False
    obstacle_m: float | None = None
    """From the leading end to a box in the way, at the moment it comes to stand there."""
    bar_rad: float | None = None
    """By how much a bar lies askew on the nosings in view, from the moment it comes to lie there."""


@runtime_checkable
class Breakable(TruthPlant, Protocol):
    """A simulated chair that can be broken."""

    def suffer(self, damage: Damage) -> None:
        """Be as broken as this from now on, and no more."""


def damage_of(faults: Iterable[Fault], t_s: float) -> Damage:
    """Return what the faults that are on at ``t_s`` do to the chair; of two obstacles or bars the first one stands."""
    on = [fault for fault in faults if fault.active(t_s)]
    kinds = {fault.kind for fault in on}
    stalled = {int(fault.size) for fault in on if fault.kind == "track_stalled"}
    return Damage(
        stalled=(LEFT in stalled, RIGHT in stalled),
        grip=(_grip(on, LEFT), _grip(on, RIGHT)),
        power_cut="power_cut" in kinds,
        seat_stuck="seat_stuck" in kinds,
        flipper_lost="flipper_lost" in kinds,
        flipper_stuck="flipper_stuck" in kinds,
        obstacle_m=next((fault.size for fault in on if fault.kind == "obstacle"), None),
        bar_rad=next((fault.size * DEG for fault in on if fault.kind == "false_edges"), None),
    )


def _grip(on: list[Fault], side: int) -> float:
    share = 1.0
    for fault in on:
        if fault.kind == "low_friction" or (fault.kind == "track_slip" and (fault.size < 0.0) == (side == RIGHT)):
            share *= abs(fault.size)
    return share
