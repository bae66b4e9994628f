"""Faults of an emulated chair: on its line, in its box and in its wiring.

A fault is written ``KIND``, ``KIND@START`` or ``KIND@START=VALUE``, times on the emulator's clock [s], for example ``late@3=0.15``.
"""

import math
import random
import re
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

from treadline.core.errors import SettingsError, closest

KINDS = {
    "unplugged": "the line carries nothing in either direction, for VALUE seconds; for good without a value",
    "late": "each frame to the box arrives VALUE seconds late",
    "half": "one frame to the box ends after half of its bytes",
    "flipped": "one bit of one frame to the box is flipped",
    "stuck": "each byte to the box reads 0x55",
    "swapped_frames": "each second frame to the box overtakes the one before it",
    "brown_out": "the box, or the left axis, starts anew",
    "no_watchdog": "the axes have no watchdog (from 0 s on)",
    "two_with_one_id": "a second drive answers to each node id",
    "second_host": "another program sends one sound command to the box",
    "gone": "the device disappears from the computer",
    "camera_gone": "the camera sends no more frames",
    "imu_frozen": "the inertial sensor repeats its last sample",
    "swapped_belts": "the box's left output drives the right belt",
    "left_reversed": "the left belt runs backwards",
    "right_reversed": "the right belt runs backwards",
    "ignores_zero": "a base ignores commands of zero",
    "moves": "a base moves by itself",
    "jump": "the odometry of a base jumps by 1 m once",
    "other_frame": "the odometry of a base is of another frame",
    "two_bases": "two bases publish odometry",
}
"""Kinds of faults and what each does."""
WRITTEN = re.compile(r"(?P<kind>\w+)(?:@(?P<start>[\d.]+))?(?:=(?P<value>[\d.]+))?")
Item = TypeVar("Item")


@dataclass(frozen=True, slots=True, kw_only=True)
class EmulatedFault:
    """One fault."""

    kind: str
    start_s: float
    value: float
    """Duration or delay [s]; infinite for good."""


class Faults:
    """Faults of one emulator.

    Raises:
        SettingsError: If a fault is written in another way or has another kind.
    """

    def __init__(self, written: Sequence[str]) -> None:
        self._faults = [_fault_of(text, 0.0) for text in written]
        self._done: set[EmulatedFault] = set()

    def type(self, line: str, t_s: float) -> None:
        """Begin the fault that a person typed, now unless it has a start; an empty line ends all faults.

        Raises:
            SettingsError: If there is no such kind.
        """
        self._faults = [*self._faults, _fault_of(line.strip(), t_s)] if line.strip() else []

    def active(self, kind: str, t_s: float) -> bool:
        """Return whether a fault acts at a time."""
        return any(fault.kind == kind and 0.0 <= t_s - fault.start_s < fault.value for fault in self._faults)

    def once(self, kind: str, t_s: float) -> bool:
        """Return whether a fault that occurs once is due; true at the first call after its start alone."""
        due = [fault for fault in self._faults if fault.kind == kind and t_s >= fault.start_s and fault not in self._done]
        self._done.update(due)
        return bool(due)

    def delay_s(self, t_s: float) -> float:
        """Return the delay of a frame that enters the line at a time [s]."""
        return max((fault.value for fault in self._faults if fault.kind == "late" and t_s >= fault.start_s), default=0.0)


class FaultyLine(Generic[Item]):
    """Line from the host to the box, with faults.

    Args:
        spoil: Returns what ``half``, ``flipped`` or ``stuck`` leaves of a frame: one, or none.
    """

    def __init__(self, faults: Faults, spoil: Callable[[str, Item], list[Item]]) -> None:
        self._faults, self._spoil = faults, spoil
        self._under_way: deque[tuple[float, Item]] = deque()
        self._overtaken: list[Item] = []

    def carry(self, frames: Sequence[Item], t_s: float) -> list[Item]:
        """Accept the frames that the host sent until a time, and return those that reach the box by then."""
        for frame in frames:
            passed = self._passed(frame, t_s)
            self._under_way.extend((t_s + self._faults.delay_s(t_s), item) for item in passed)
        arrived = []
        while self._under_way and self._under_way[0][0] <= t_s:
            arrived.append(self._under_way.popleft()[1])
        return arrived

    def _passed(self, frame: Item, t_s: float) -> list[Item]:
        """Return what a frame becomes on the line."""
        active = self._faults.active
        if active("unplugged", t_s):
            return []
        spoilt = [kind for kind in ("half", "flipped") if self._faults.once(kind, t_s)] + ["stuck"] * active("stuck", t_s)
        if spoilt:
            return self._spoil(spoilt[0], frame)
        if not active("swapped_frames", t_s):
            return [frame]
        self._overtaken.append(frame)
        passed, self._overtaken = (self._overtaken[::-1], []) if len(self._overtaken) == 2 else ([], self._overtaken)
        return passed


def spoilt_bytes(kind: str, frame: bytes) -> list[bytes]:
    """Return a frame of a serial line after a fault: cut, with a random bit flipped, or of one byte alone."""
    flipped = int.from_bytes(frame, "little") ^ 1 << random.randrange(8 * len(frame))
    kinds = {"half": frame[: len(frame) // 2], "stuck": b"\x55" * len(frame), "flipped": flipped.to_bytes(len(frame), "little")}
    return [kinds[kind]]


def _fault_of(text: str, start_s: float) -> EmulatedFault:
    """Return a fault as written; without a start it begins at ``start_s``."""
    written = WRITTEN.fullmatch(text)
    if written is None:
        raise SettingsError(f"fault '{text}' is not written as KIND, KIND@START or KIND@START=VALUE, for example late@3=0.15")
    kind, start, value = written.group("kind", "start", "value")
    if kind not in KINDS:
        alike = closest(kind, KINDS)
        hint = f"; did you mean '{alike}'?" if alike else f"; kinds: {', '.join(KINDS)}"
        raise SettingsError(f"fault '{text}': no kind '{kind}'{hint}")
    return EmulatedFault(kind=kind, start_s=float(start or start_s), value=float(value or math.inf))
