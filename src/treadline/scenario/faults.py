"""Fault injection: kinds of faults, their magnitudes and their duration.

A fault is active from ``at_s`` for ``for_s`` seconds. ``value = 0`` selects the default magnitude (``data/faults.toml``); for kinds
with numbered choices, zero is the first choice. After the fault all settings are as before, but its physical effects remain (a
chair that rolled back stays there).
"""

import tomllib
from collections.abc import Iterable
from dataclasses import dataclass
from enum import IntEnum
from typing import Annotated, Literal, cast

from pydantic import Field, model_validator

from treadline.core.files import DATA
from treadline.core.settings import Settings
from treadline.core.signals import ROUNDING_S

FaultKind = Literal[
    "camera_lost", "camera_frozen", "camera_dark", "depth_holes", "false_edges", "imu_nan", "imu_stuck", "imu_bias",
    "imu_lost", "clock_back", "late_tick", "track_stalled", "track_slip", "low_friction", "operator_stop",
    "link_lost", "seat_stuck", "process_killed", "power_cut", "obstacle", "flipper_lost", "flipper_stuck",
    "readings_lost", "gyro_ramp", "wrong_stamp", "payload_forward", "payload_left", "payload_up",
]  # fmt: skip
"""Kinds of faults. New kinds are appended: the position of a kind selects its stream of random numbers."""
Process = IntEnum("Process", "MISSION PERCEPTION CONTROLLER SEAT", start=0)
"""Process stopped by ``process_killed``: the whole mission, so that the chair receives no commands; the camera pipeline, so that
the mission receives no frame, heading or map; the controller, so that the guard receives no proposal (implemented by the builder of
the mission through ``is_killed``, because a plant cannot suppress proposals); or the seat controller, so that the seat actuator
continues with its last command until its watchdog stops it."""
WRONG_STAMP_S = 1e6
"""Stamp of a message under ``wrong_stamp`` [s]: eleven days in the future."""
Message = IntEnum("Message", "MAP PLAN HEALTH", start=0)
"""Message to the guard with a false stamp under ``wrong_stamp``."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Extent:
    """Meaning, default and range of ``value`` for one kind of fault."""

    means: str
    default: float = 0.0
    low: float = 0.0
    high: float = 0.0
    is_choice: bool = False
    """Whether ``value`` must be a whole number."""


_TABLES = tomllib.loads((DATA / "faults.toml").read_text(encoding="utf-8"))
EXTENTS = cast("dict[FaultKind, Extent]", {kind: Extent(**table) for kind, table in _TABLES.items()})


class Fault(Settings):
    """One fault: from ``at_s``, for ``for_s`` seconds, with the magnitude ``value`` (unit depends on the kind)."""

    kind: FaultKind
    """Kind of fault."""
    at_s: Annotated[float, Field(ge=0.0)] = 10.0
    """Start time of the fault."""
    for_s: Annotated[float, Field(gt=0.0)] = 3.0
    """Duration of the fault."""
    value: float = 0.0
    """Magnitude of the fault; the unit depends on the kind, and 0 selects the default of the kind."""

    @model_validator(mode="after")
    def _value_means_something(self) -> "Fault":
        extent = EXTENTS[self.kind]
        if extent.low <= self.value <= extent.high and not (extent.is_choice and self.value % 1.0):
            return self
        if extent.low == extent.high:
            raise ValueError(f"value is {self.value:g}, but {self.kind} takes no value; remove the key")
        wanted = "a whole number from" if extent.is_choice else "from"
        raise ValueError(
            f"value is {self.value:g}; for {self.kind} it must be {wanted} {extent.low:g} to {extent.high:g} ({extent.means})"
        )

    @property
    def size(self) -> float:
        """Magnitude: ``value``, or the default of the kind if ``value`` is zero."""
        return self.value or EXTENTS[self.kind].default

    def active(self, t_s: float) -> bool:
        """Return whether the fault is active at ``t_s``."""
        return self.at_s <= t_s + ROUNDING_S < self.at_s + self.for_s


@dataclass(frozen=True, slots=True, kw_only=True)
class Conditions:
    """Adjustable conditions of a simulated run; the default changes nothing. Faults add to them."""

    friction: tuple[float, float] = (1.0, 1.0)
    """Factor on the friction of the left and the right belt, along and across."""
    payload_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Shift of the passenger's centre of mass in the seat [m]: forward, left, up."""


def payload_shift_m(faults: Iterable[Fault], t_s: float) -> tuple[float, float, float]:
    """Return the shift of the passenger's centre of mass at ``t_s`` [m]: forward, left, up, each the sum of its faults."""
    on = [fault for fault in faults if fault.active(t_s)]
    x, y, z = (
        sum((fault.size for fault in on if fault.kind == kind), 0.0) for kind in ("payload_forward", "payload_left", "payload_up")
    )
    return x, y, z


def is_killed(faults: Iterable[Fault], process: Process, t_s: float) -> bool:
    """Return whether a process is stopped at ``t_s``."""
    return any(fault.kind == "process_killed" and fault.size == process and fault.active(t_s) for fault in faults)


def stamp_of(faults: Iterable[Fault], message: Message, t_s: float) -> float:
    """Return the stamp of a message created at ``t_s``, false under ``wrong_stamp``."""
    wrong = any(fault.kind == "wrong_stamp" and fault.size == message and fault.active(t_s) for fault in faults)
    return WRONG_STAMP_S if wrong else t_s
