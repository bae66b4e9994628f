"""Faults of an emulated chair: on its line, in its box and in its wiring.

A fault is written ``KIND@START`` or ``KIND@START=VALUE``, times on the emulator's clock [s], for example ``late@3=0.15``.
"""

import random
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
}
"""Kinds of faults and what each does."""
FOR_GOOD_S = 1e9
"""Duration of a fault without one [s]."""
Item = TypeVar("Item")


@dataclass(frozen=True, slots=True, kw_only=True)
class EmulatedFault:
    """One fault."""

    kind: str
    start_s: float
    value: float = FOR_GOOD_S


class Faults:
    """Faults of one emulator.

    Raises:
        SettingsError: If a fault is written in another way or has another kind.
    """

    def __init__(self, written: Sequence[str]) -> None:
        self._faults = [_fault_of(text) for text in written]
        self._done: set[EmulatedFault] = set()

    def type(self, line: str, t_s: float) -> None:
        """Begin the fault that a person typed, written without a start; an empty line ends all faults.

        Raises:
            SettingsError: If there is no such kind.
        """
        kind, _, value = line.strip().partition("=")
        self._faults = [*self._faults, _fault_of(f"{kind}@{t_s}={value or FOR_GOOD_S}")] if kind else []

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
        spoil: Returns a frame after ``half``, ``flipped`` or ``stuck``; None if the line drops it.
    """

    def __init__(self, faults: Faults, spoil: Callable[[str, Item], Item | None]) -> None:
        self._faults, self._spoil = faults, spoil
        self._under_way: deque[tuple[float, Item]] = deque()
        self._overtaken: Item | None = None

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
        if self._faults.active("unplugged", t_s):
            return []
        for kind in ("half", "flipped"):
            if self._faults.once(kind, t_s):
                spoilt = self._spoil(kind, frame)
                return [] if spoilt is None else [spoilt]
        if self._faults.active("stuck", t_s):
            spoilt = self._spoil("stuck", frame)
            return [] if spoilt is None else [spoilt]
        if not self._faults.active("swapped_frames", t_s):
            return [frame]
        if self._overtaken is None:
            self._overtaken = frame
            return []
        before, self._overtaken = self._overtaken, None
        return [frame, before]


def spoilt_bytes(kind: str, frame: bytes) -> bytes:
    """Return a frame of a serial line after a fault: cut, with a random bit flipped, or of one byte alone."""
    if kind == "half":
        return frame[: len(frame) // 2]
    if kind == "stuck":
        return b"\x55" * len(frame)
    spoilt, bit = bytearray(frame), random.randrange(8 * len(frame))
    spoilt[bit // 8] ^= 1 << bit % 8
    return bytes(spoilt)


def _fault_of(text: str) -> EmulatedFault:
    """Return a fault as written."""
    kind, _, times = text.partition("@")
    start, _, value = times.partition("=")
    if kind not in KINDS:
        alike = closest(kind, KINDS)
        hint = f"; did you mean '{alike}'?" if alike else f"; kinds: {', '.join(KINDS)}"
        raise SettingsError(f"fault '{text}': no kind '{kind}'{hint}")
    try:
        return EmulatedFault(kind=kind, start_s=float(start), value=float(value) if value else FOR_GOOD_S)
    except ValueError:
        raise SettingsError(f"fault '{text}' has no times; write for example {kind}@3 or {kind}@3=0.15") from None
