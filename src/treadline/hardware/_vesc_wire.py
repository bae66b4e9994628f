"""Two VESC motor drives on a CAN bus, one for each belt, as the wire of a base, through python-can.

Robot file: ``link = "vesc"``, ``interface`` and ``channel`` of python-can, ``left_id``, ``right_id``, ``wheel_radius_m``,
``gear_ratio`` and ``pole_pairs``. In VESC Tool: CAN status messages 1 and 5 at 50 Hz or more, and a time-out below 0.5 s, which the
link measures.

Source: vedderb/bldc, ``documentation/comm_can.md``. An identifier of 29 bits is the command, shifted by eight bits, and the drive's
id; numbers are big-endian.
"""

import struct
from typing import Any

import can

from treadline.core.errors import LinkError
from treadline.hardware._base_link import BaseOdometry
from treadline.hardware._can_link import CanBus, turn_m

SET_CURRENT_BRAKE, SET_RPM, STATUS, STATUS_5 = 2, 3, 9, 27
"""The four commands in use."""
COMMAND = struct.Struct(">i")
"""Current of the brake [mA], or electrical revolutions per minute."""
SPEED, SUPPLY = struct.Struct(">ihh"), struct.Struct(">ih")
"""Electrical revolutions per minute, current [0.1 A] and duty [0.001]; tachometer and voltage [0.1 V]."""


class VescWire:
    """Wire to one VESC for each belt.

    Args:
        channel: Channel of the bus, for example can0.
        left_id: Id of the left belt's drive.
        wheel_radius_m: Radius of the pulley that drives a belt [m].
        pole_pairs: Pole pairs of the motor: electrical revolutions in one of its own.
        gear_ratio: Turns of the motor for a turn of the pulley.
        brake_a: Current with which a standing belt is braked [A].
        interface: Interface of python-can.
        options: Further options of python-can's bus.

    Raises:
        LinkError: If a number is impossible, or the bus does not open.
    """

    def __init__(
        self,
        *,
        channel: str,
        left_id: int,
        right_id: int,
        wheel_radius_m: float,
        pole_pairs: int,
        gear_ratio: float = 1.0,
        brake_a: float = 10.0,
        interface: str = "socketcan",
        **options: Any,
    ) -> None:
        if left_id == right_id or not (0 <= left_id < 255 and 0 <= right_id < 255) or pole_pairs < 1 or brake_a <= 0.0:
            raise LinkError(f"left_id {left_id}, right_id {right_id}, pole_pairs {pole_pairs}, brake_a {brake_a:g}: see VESC Tool")
        self._ids, self._brake = (left_id, right_id), COMMAND.pack(round(1000.0 * brake_a))
        self._m_s = turn_m(wheel_radius_m, gear_ratio) / (60.0 * pole_pairs)
        self._speeds: dict[int, float] = {}
        self._voltage_v: float | None = None
        self._bus = CanBus(interface=interface, channel=channel, **options)

    def read(self) -> list[tuple[float, BaseOdometry]]:
        """Return the belts' speeds, once for each pair of status messages."""
        found = []
        for t_s, message in self._bus.read():
            command, drive = divmod(message.arbitration_id, 1 << 8)
            if not message.is_extended_id or drive not in self._ids:
                continue
            if command in (SET_RPM, SET_CURRENT_BRAKE) and not self._bus.is_echo(message):
                raise LinkError(f"two hosts send commands to drive {drive}; stop one of them")
            if command == STATUS and len(message.data) >= SPEED.size:
                self._speeds[drive] = SPEED.unpack_from(message.data)[0] * self._m_s
            elif command == STATUS_5 and len(message.data) >= SUPPLY.size:
                self._voltage_v = SUPPLY.unpack_from(message.data)[1] / 10.0
            if len(self._speeds) == len(self._ids):
                left, right = (self._speeds.pop(drive) for drive in self._ids)
                found.append((t_s, BaseOdometry("base_link", "", (0.0, 0.0), left, right, self._voltage_v)))
        return found

    def write(self, left_m_s: float, right_m_s: float) -> None:
        """Set the speeds; a belt that is to stand is braked."""
        for drive, speed_m_s in zip(self._ids, (left_m_s, right_m_s), strict=True):
            command, content = (
                (SET_RPM, COMMAND.pack(round(speed_m_s / self._m_s))) if speed_m_s else (SET_CURRENT_BRAKE, self._brake)
            )
            self._bus.write(can.Message(arbitration_id=command << 8 | drive, data=content))

    def close(self) -> None:
        """Release the bus."""
        self._bus.close()
