"""A lab's base with odometry, or two VESC drives on a CAN bus: belts with a time-out of the base's own.

The speeds of the first travel as JSON in datagrams of this computer, in place of ROS; the sensors are on a serial line.
"""

import contextlib
import json
import math
import socket
import time
from collections.abc import Iterator
from typing import Any

import can

from treadline.core.signals import TICK_S
from treadline.hardware import _frame as frame
from treadline.hardware import _vesc_wire as vesc
from treadline.hardware._base_link import BaseOdometry
from treadline.hardware._can_link import open_bus, turn_m
from treadline.hardware.emulators._chair import EmulatedChair
from treadline.hardware.emulators._faults import Faults
from treadline.hardware.emulators._firmware import DriveBox, Outputs
from treadline.hardware.emulators._serial import Terminal

TIMEOUT_S = 0.3
"""Time-out of an emulated base [s]: shorter than ``BaseLink`` asks for."""
IDS, POLE_PAIRS, GEAR_RATIO, HOST = (1, 2), 7, 10.0, "127.0.0.1"
"""Ids of the drives, left and right, their motors and gears; and the address of this computer."""


class EmulatedBase:
    """Belts that follow the last command until the base's own time-out; wires to the host are its children."""

    def __init__(self, chair: EmulatedChair, faults: Faults, terminal: Terminal, timeout_s: float = TIMEOUT_S) -> None:
        self._chair, self._faults, self._terminal, self._timeout_s = chair, faults, terminal, timeout_s
        self._sensors, self._asked, self._asked_s = DriveBox(), (0.0, 0.0), -math.inf

    def step(self) -> Iterator[str]:
        """Obey, drive the chair for one tick, and report."""
        t_s, active = self._chair.t_s, self._faults.active
        for asked in self._received():
            if not active("unplugged", t_s):
                self._asked = asked if any(asked) or not active("ignores_zero", t_s) else self._asked
                self._asked_s = t_s
        is_late = t_s - self._asked_s > self._timeout_s
        left, right = (0.2, 0.2) if active("moves", t_s) else (0.0, 0.0) if is_late else self._asked
        outputs = Outputs(brake=left == right == 0.0)
        outputs.belts_um_s[:] = [round(1e6 * left), round(1e6 * right)]
        self._terminal.write(self._sensors.frame(self._chair.step(outputs)))
        if not active("unplugged", t_s):
            self._report(*frame.physical("belts", self._chair.inputs.belts))
        yield from ()

    def _received(self) -> Iterator[tuple[float, float]]:
        raise NotImplementedError

    def _report(self, left_m_s: float, right_m_s: float) -> None:
        raise NotImplementedError


class DatagramBase(EmulatedBase):
    """Base with odometry at each tick, in datagrams to the host that it last obeyed."""

    def __init__(self, chair: EmulatedChair, faults: Faults, terminal: Terminal, options: dict[str, Any]) -> None:
        super().__init__(chair, faults, terminal)
        self._end, self._x_m = DatagramWire(port=0, own_port=options["port"]), 0.0

    def _received(self) -> Iterator[tuple[float, float]]:
        yield from self._end.messages()

    def _report(self, left_m_s: float, right_m_s: float) -> None:
        t_s, active = self._chair.t_s, self._faults.active
        self._x_m += 0.5 * (left_m_s + right_m_s) * TICK_S + 1.0 * self._faults.once("jump", t_s)
        sender = "second" if active("two_bases", t_s) and round(t_s / TICK_S) % 2 else "first"
        child = "base_footprint" if active("other_frame", t_s) else "base_link"
        self._end.write(child, sender, [self._x_m, 0.0], left_m_s, right_m_s)


class VescDrives(EmulatedBase):
    """Two VESC drives, whose motors turn the pulleys by a gear."""

    def __init__(self, chair: EmulatedChair, faults: Faults, terminal: Terminal, options: dict[str, Any]) -> None:
        super().__init__(chair, faults, terminal)
        self._bus, self._speeds = open_bus(**options), dict.fromkeys(IDS, 0.0)
        self._m_s = turn_m(chair.chair.tracks.pulley_radius_m, GEAR_RATIO) / (60.0 * POLE_PAIRS)

    def _received(self) -> Iterator[tuple[float, float]]:
        while (message := self._bus.recv(0)) is not None:
            command, drive = divmod(message.arbitration_id, 1 << 8)
            if drive in self._speeds and command in (vesc.SET_RPM, vesc.SET_CURRENT_BRAKE):
                erpm = vesc.COMMAND.unpack(message.data)[0] if command == vesc.SET_RPM else 0
                self._speeds[drive] = erpm * self._m_s
                yield self._speeds[IDS[0]], self._speeds[IDS[1]]

    def _report(self, left_m_s: float, right_m_s: float) -> None:
        for drive, speed_m_s in zip(IDS, (left_m_s, right_m_s), strict=True):
            speed = vesc.SPEED.pack(round(speed_m_s / self._m_s), 0, 0)
            for command, content in ((vesc.STATUS_5, vesc.SUPPLY.pack(0, 266)), (vesc.STATUS, speed)):
                self._bus.send(can.Message(arbitration_id=command << 8 | drive, data=content))


class DatagramWire:
    """One end of the datagrams; that of the host is a wire of ``BaseLink``."""

    def __init__(self, *, port: int, own_port: int = 0) -> None:
        self._socket, self._to = socket.socket(socket.AF_INET, socket.SOCK_DGRAM), (HOST, port)
        self._socket.bind((HOST, own_port))
        self._socket.setblocking(False)

    def messages(self) -> Iterator[Any]:
        """Yield what has arrived, and answer its sender from now on."""
        with contextlib.suppress(OSError):  # nothing more; or a datagram had no receiver, as before the other program starts
            while True:
                data, self._to = self._socket.recvfrom(4096)
                yield json.loads(data)

    def read(self) -> list[tuple[float, BaseOdometry]]:
        """Return the odometry that has arrived."""
        return [(time.monotonic(), BaseOdometry(*message)) for message in self.messages()]

    def write(self, *content: Any) -> None:
        """Send belt speeds, or odometry; before the first message there is nobody to send to."""
        with contextlib.suppress(OSError):
            self._socket.sendto(json.dumps(content).encode(), self._to)

    def close(self) -> None:
        """Release the socket."""
        self._socket.close()
