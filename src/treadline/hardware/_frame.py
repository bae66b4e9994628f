"""Messages between the host and the box at the drives, as frames on a serial line.

``HostMessage -> bytes`` and ``bytes -> BoxState``; the other direction is ``firmware/``, in C. A frame is the content and its
CRC-32, with consistent overhead byte stuffing (COBS: Cheshire and Baker, IEEE/ACM Transactions on Networking 7, 1999) and a zero
byte at the end. Numbers have their least significant byte first. Byte tables: docs/reference/firmware.md.
"""

import struct
import zlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from enum import IntEnum, IntFlag
from itertools import cycle
from typing import Any

from treadline.core.errors import LinkError
from treadline.hardware.ports import HOLD_M_S2, DriveLimits

VERSION = 2
"""Version of the messages, the first byte of each."""
UNITS = {
    "drive": (1e-4, 1e-4, 1e-5, 1e-3),
    "limits": (1e-4, 1e-3, 1e-3, 1e-3, 1e-5, 1e-3),
    "set_points": (1e-6,),
    "belts": (1e-4,),
    "voltage": (1e-3,),
    "orientation": (2.0**-14,),
    "rates": (1e-4,),
    "accelerations": (1e-3,),
    "seat": (1e-4, 1e-5),
    "flipper": (1e-4, 0.1),
}
"""Units of the numbers of a message, by their names in the byte tables, in SI units; a single one holds for all."""
MILLI = 1e-3
"""Unit of the box's clock [s]."""

HOST = struct.Struct("<BBBHHIH6h")
"""Bytes of a host's message."""
STATE = struct.Struct("<BBBIHBBBBHHIH6h2i2hH4h3h3h2h2h")
"""Bytes of the box's state."""
STATE_KIND = 0x80
"""Kind of the box's state."""
VALUES = 6
"""Number of values in a host's message."""
_CRC = struct.Struct("<I")
_LONGEST = 254
"""Largest number of bytes between two zeros that COBS admits without a second code byte."""


Kind = IntEnum("Kind", "DRIVE HOLD STOP REARM LIMITS")
"""Kinds of a host's messages."""
Cause = IntEnum("Cause", "ARMED START STOPPED WATCHDOG TWO_HOSTS DEAD_MAN BUTTON DRIVE_ERROR RUNAWAY", start=0)
"""Causes of a latched stop."""
Reply = IntEnum("Reply", "ACCEPTED BROKEN VERSION FOREIGN STALE OUT_OF_ORDER NOT_NOW OLD_LATCH NO_LIMITS BLOCKED BEYOND", start=0)
"""Reasons for which the box rejected a message; ``firmware/rules.h`` describes each."""
Flag = IntFlag("Flag", "BRAKE DEAD_MAN STOP REARM FLIGHT_ENDS GO_BACK OPEN")
"""Bits of ``BoxState.flags``."""
Present = IntFlag("Present", "IMU SEAT FLIPPER HANDSET VOLTAGE")
"""Bits of ``BoxState.present``: what the box measures."""


@dataclass(frozen=True, slots=True, kw_only=True)
class HostMessage:
    """Message of a host, in the units of the frame."""

    kind: Kind
    sender: int
    """Number that the host draws at random when it connects; a second one stops an armed box."""
    sequence: int
    """One more for each message, modulo 65536."""
    stamp_ms: int
    """Box time of the newest state that the host received [ms]."""
    latch: int = 0
    """Number of the latched stop that a re-arm ends."""
    values: tuple[int, ...] = (0,) * VALUES
    """Drive and hold: left, right [0.1 mm/s], seat [0.01 mm/s], flipper [mrad/s]. Limits: largest belt speed [0.1 mm/s],
    acceleration, deceleration of a hold [mm/s²], watchdog [ms], seat [0.01 mm/s], flipper [mrad/s]. Otherwise zero."""

    def frame(self) -> bytes:
        """Return the message as a frame, ending zero included."""
        head = (VERSION, self.kind, HOST.size, self.sender, self.sequence, self.stamp_ms, self.latch)
        return frame_of(HOST.pack(*head, *self.values))


@dataclass(frozen=True, slots=True)
class BoxState:
    """State of the box and its readings, in the units and the order of the frame."""

    now_ms: int
    latch: int
    """Number of latched stops since the start of the box."""
    cause: Cause
    flags: Flag
    present: Present
    reply: Reply
    """Reason of the newest rejection."""
    rejections: int
    """Number of rejected messages since the start of the box, modulo 65536."""
    sender: int
    """Host that armed the box last."""
    heard_ms: int
    """Stamp of the newest accepted message [ms]."""
    drive_error: int
    """Error code of the motor drives, 0 without one."""
    limits: tuple[int, ...]
    """Limits in force, as in ``HostMessage.values``; zero before they are set."""
    set_points_um_s: tuple[int, ...]
    """Set points of the belts after limits and slew, left and right [µm/s]."""
    belts: tuple[int, ...]
    """Measured speeds of the belts."""
    voltage_mv: int
    orientation: tuple[int, ...]
    rates: tuple[int, ...]
    accelerations: tuple[int, ...]
    seat: tuple[int, ...]
    """Pitch of the seat, and stroke."""
    flipper: tuple[int, ...]
    """Angle of the flipper, and torque."""


def counts(name: str, values: Iterable[float]) -> tuple[int, ...]:
    """Return finite values in the units of a field, rounded and kept within 16 bits, as a sensor's converter does."""
    return tuple(
        round(min(max(value / unit, -(2.0**15)), 2.0**15 - 1.0)) for value, unit in zip(values, cycle(UNITS[name]), strict=False)
    )


def physical(name: str, numbers: Iterable[int]) -> Any:
    """Return the numbers of a field as a tuple of values in SI units."""
    return tuple(number * unit for number, unit in zip(numbers, cycle(UNITS[name]), strict=False))


def limit_values(limits: DriveLimits) -> tuple[int, ...]:
    """Return limits as the values of a message."""
    hold_m_s2 = min(HOLD_M_S2, limits.acceleration_m_s2)
    motion = (limits.speed_m_s, limits.acceleration_m_s2, hold_m_s2, limits.watchdog_s)
    return counts("limits", (*motion, limits.seat_m_s, limits.flipper_rad_s))


def frame_of(content: bytes) -> bytes:
    """Return a content as a frame: CRC, byte stuffing, ending zero."""
    parts = (content + _CRC.pack(zlib.crc32(content))).split(b"\0")
    return b"".join(bytes([len(part) + 1]) + part for part in parts) + b"\0"


def content_of(frame: bytes) -> bytes | None:
    """Return the content of a frame without its ending zero; None if the frame is broken."""
    content, place = bytearray(frame), 0
    while place < len(frame):
        end = place + frame[place]
        if not place < end <= len(frame):
            return None
        content[place], place = 0, end
    body, crc = bytes(content[1 : -_CRC.size]), content[-_CRC.size :]
    return body if body and _CRC.pack(zlib.crc32(body)) == crc else None


def state_of(content: bytes) -> BoxState | None:
    """Return the state that a content holds; None if the content is of another kind.

    Raises:
        LinkError: If the content is of another version.
    """
    if content[0] != VERSION:
        raise LinkError(
            f"the box speaks version {content[0]} of the messages, and this program version {VERSION}; "
            "write the firmware of the same release to the box"
        )
    if len(content) != STATE.size or content[1] != STATE_KIND:
        return None
    n: Any = STATE.unpack(content)
    fields = [*n[3:5], Cause(n[5]), Flag(n[6]), Present(n[7]), Reply(n[8]), *n[9:13], n[13:19], n[19:21], n[21:23], n[23]]
    fields += [n[24:28], n[28:31], n[31:34], n[34:36], n[36:38]]
    return BoxState(*fields)


class FrameReader:
    """Reader of a line: bytes in whatever portions they arrive, to the contents of whole frames."""

    def __init__(self) -> None:
        self._rest = b""
        self.broken = 0
        """Number of broken frames so far."""

    def feed(self, received: bytes) -> Iterator[bytes]:
        """Return the contents of the frames that end in these bytes."""
        *frames, rest = (self._rest + received).split(b"\0")
        self._rest = rest[:_LONGEST]  # a line that never ends a frame must not fill the memory
        for frame in filter(None, frames):
            content = content_of(frame)
            if content is None:
                self.broken += 1
            else:
                yield content
