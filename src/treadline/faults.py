"""The faults a scenario may inject, and what the size of each means.

A fault lasts from ``at_s`` for ``for_s`` seconds. ``value = 0`` stands for the size in ``EXTENTS``; where a kind has choices,
zero is the first. Physics that a fault has changed stays changed (a chair that slid has slid); all else is afterwards as it was.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from enum import IntEnum
from typing import Annotated, Literal

from pydantic import Field, field_validator, model_validator

from treadline.settings import Settings

FaultKind = Literal[
    "camera_lost", "camera_frozen", "camera_dark", "depth_holes", "false_edges", "imu_nan", "imu_stuck", "imu_bias",
    "imu_lost", "clock_back", "late_tick", "track_stalled", "track_slip", "low_friction", "operator_stop",
    "link_lost", "seat_stuck", "process_killed", "power_cut", "obstacle", "flipper_lost", "flipper_stuck",
    "readings_lost", "gyro_ramp", "wrong_stamp",
]  # fmt: skip
"""New kinds come last: a kind's place chooses its stream of random numbers."""

RENAMED_KINDS = {"arm_lost": "flipper_lost", "arm_stuck": "flipper_stuck"}
"""Kinds of the previous release and their present names; both are accepted for one release."""

SAME_TIME_S = 1e-6
"""Times closer than this are one tick, whatever their last bits say."""


class Process(IntEnum):
    """What ``process_killed`` kills."""

    MISSION = 0
    """All of it: no order reaches the chair."""
    PERCEPTION = 1
    """No frame, heading or map reaches the mission."""
    CONTROLLER = 2
    """No proposal reaches the guard. A plant cannot do that: who builds the mission asks ``is_killed``."""
    SEAT = 3
    """No order reaches the seat's actuator, which goes on with its last until its watchdog stops it."""


WRONG_STAMP_S = 1e6
"""Stamp of a message under ``wrong_stamp``: eleven days ahead."""


class Message(IntEnum):
    """Which message to the guard ``wrong_stamp`` stamps."""

    MAP = 0
    PLAN = 1
    HEALTH = 2


@dataclass(frozen=True, slots=True, kw_only=True)
class Extent:
    """What ``value`` says of one kind of fault."""

    means: str
    default: float = 0.0
    low: float = 0.0
    high: float = 0.0
    is_choice: bool = False
    """Whether only whole numbers mean something."""


EXTENTS: dict[FaultKind, Extent] = {
    "camera_lost": Extent(means="nothing: no frame, heading or map arrives"),
    "camera_frozen": Extent(means="nothing: the last frame, heading and map arrive again and again, with new stamps"),
    "camera_dark": Extent(
        means="the light's factor, below 1 dark and above 1 glare; negative: the depth image is empty as well",
        default=0.02,
        low=-50.0,
        high=50.0,
    ),
    "depth_holes": Extent(means="the share of the depth image lost in blotches", default=0.4, high=0.98),
    "false_edges": Extent(means="degrees by which a bar on the nosings lies askew (in images)", default=15.0, low=-45.0, high=45.0),
    "imu_nan": Extent(means="nothing: every number is NaN"),
    "imu_stuck": Extent(means="nothing: the last numbers arrive again and again, with new stamps"),
    "imu_bias": Extent(
        means="below 5 a bias of the gyro about the chair's z [°/s], from 5 a jump of the heading within 0.1 s [°]",
        default=1.0,
        low=-180.0,
        high=180.0,
    ),
    "imu_lost": Extent(means="nothing: no sample arrives"),
    "clock_back": Extent(means="seconds by which all stamps leap back; every reading comes twice", default=0.5, high=10.0),
    "late_tick": Extent(means="seconds by which orders are late, and readings come in bursts", default=0.5, high=10.0),
    "track_stalled": Extent(means="the belt that stands: 0 left, 1 right", high=1.0, is_choice=True),
    "track_slip": Extent(means="the share of friction that a belt keeps; negative: the right one", default=0.2, low=-1.0, high=1.0),
    "low_friction": Extent(means="the share of their friction that both belts keep", default=0.5, high=1.0),
    "operator_stop": Extent(means="what the person does: 0 presses stop, 1 lets go of the dead-man", high=1.0, is_choice=True),
    "link_lost": Extent(means="nothing: the person's heartbeat does not arrive"),
    "seat_stuck": Extent(means="nothing: the seat's actuator stands"),
    "process_killed": Extent(means="the process: 0 mission, 1 perception, 2 controller, 3 seat", high=3.0, is_choice=True),
    "power_cut": Extent(means="nothing: brakes fall in; flipper and seat are held by their gears"),
    "obstacle": Extent(means="metres from the chair's leading end to the box that stands in its way", default=1.2, high=5.0),
    "flipper_lost": Extent(means="nothing: the flipper's motor is dead, its shorted windings damp one way"),
    "flipper_stuck": Extent(means="nothing: the flipper's motor holds"),
    "readings_lost": Extent(means="nothing: belts, seat and flipper report nothing"),
    "gyro_ramp": Extent(
        means="the bias of the gyro about the chair's z [°/s] at the end of the fault; it grows evenly from zero",
        default=0.6,
        low=-10.0,
        high=10.0,
    ),
    "wrong_stamp": Extent(
        means="the message to the guard that is stamped 1e6 s: 0 stair map, 1 plan, 2 health of the heading filter",
        high=2.0,
        is_choice=True,
    ),
}  # fmt: skip


class Fault(Settings):
    """One fault: from ``at_s``, for ``for_s`` seconds, of size ``value`` (its unit depends on the kind)."""

    kind: FaultKind
    """What breaks."""
    at_s: Annotated[float, Field(ge=0.0)] = 10.0
    """When it begins."""
    for_s: Annotated[float, Field(gt=0.0)] = 3.0
    """How long it lasts."""
    value: float = 0.0
    """Its size: for each kind another thing, with a default of its own for 0."""

    @field_validator("kind", mode="before")
    @classmethod
    def _present_name(cls, kind: object) -> object:
        return RENAMED_KINDS.get(kind, kind) if isinstance(kind, str) else kind

    @model_validator(mode="after")
    def _value_means_something(self) -> "Fault":
        extent = EXTENTS[self.kind]
        if extent.low <= self.value <= extent.high and not (extent.is_choice and self.value % 1.0):
            return self
        if extent.low == extent.high:
            raise ValueError(f"value is {self.value:g}, but {self.kind} has none; remove it")
        wanted = "a whole number from" if extent.is_choice else "from"
        raise ValueError(
            f"value is {self.value:g}; for {self.kind} it must be {wanted} {extent.low:g} to {extent.high:g} ({extent.means})"
        )

    @property
    def size(self) -> float:
        """``value``, or what its kind has for zero."""
        return self.value or EXTENTS[self.kind].default

    def active(self, t_s: float) -> bool:
        """Say whether the fault is on at ``t_s``."""
        return self.at_s <= t_s + SAME_TIME_S < self.at_s + self.for_s


def is_killed(faults: Iterable[Fault], process: Process, t_s: float) -> bool:
    """Say whether a process is dead at ``t_s``."""
    return any(fault.kind == "process_killed" and fault.size == process and fault.active(t_s) for fault in faults)


def stamp_of(faults: Iterable[Fault], message: Message, t_s: float) -> float:
    """Return the stamp of a message that was made at ``t_s``."""
    wrong = any(fault.kind == "wrong_stamp" and fault.size == message and fault.active(t_s) for fault in faults)
    return WRONG_STAMP_S if wrong else t_s
