"""Chair behind a CAN bus: two ODrive axes, one for each belt, with the rules of the firmware inside.

CANSimple has neither stamps nor senders, so an axis judges commands by their arrival alone.
"""

import math
from collections.abc import Iterator
from typing import Any

import can

from treadline.hardware import _can_link as simple
from treadline.hardware import _frame as frame
from treadline.hardware._can_link import CanCommand, open_bus
from treadline.hardware._frame import Cause, HostMessage, Kind
from treadline.hardware.emulators._chair import EmulatedChair
from treadline.hardware.emulators._faults import Faults, FaultyLine
from treadline.hardware.emulators._firmware import DriveBox, Outputs, Readings
from treadline.hardware.emulators._serial import SOUND, TICK_MS, Terminal
from treadline.hardware.ports import DriveLimits

NODES = (1, 2)
"""Node ids of the axes, left and right, whose motors turn the chair's pulleys directly."""
HEARTBEAT_TICKS = 2
"""Ticks between two heartbeats: the configuration that docs/reference/firmware.md asks for."""
VERSION = bytes([simple.PROTOCOL, 4, 4, 58, 0, 6, 10, 0])
"""Answer to a request for the version: protocol, hardware, firmware 0.6.10."""


class EmulatedAxis:
    """One axis: CANSimple on one side, a box with one belt on the other.

    Args:
        turn_m: Travel of the belt in a turn of the motor [m].
        limits: Limits of the box, as in ``HostMessage.values``.
        has_watchdog: Whether the watchdog is configured.
    """

    def __init__(self, node: int, turn_m: float, limits: tuple[int, ...], *, has_watchdog: bool) -> None:
        self._node = node
        self._turn_m, self._limits, self._has_watchdog = turn_m, limits, has_watchdog
        self.start()

    def start(self) -> None:
        """Switch the axis on: idle, without an error."""
        self._box, self._now_ms, self._sequence, self._cleared = DriveBox(), 0, 0, 0
        self._newest: tuple[Kind, tuple[int, ...]] | None = None
        self.tick()
        self._pass(Kind.LIMITS, self._limits)

    def tick(self) -> Outputs:
        """Advance by a tick; the left belt of the outputs is that of this axis."""
        if self._newest is not None and not self._has_watchdog:
            self._pass(*self._newest)
        self._now_ms += TICK_MS
        return self._box.tick(self._now_ms, SOUND)

    def take(self, command: int, content: bytes) -> None:
        """Obey a message of the host."""
        match command:
            case CanCommand.SET_INPUT_VEL:
                (speed,), limit = frame.counts("belts", [simple.FLOATS.unpack(content)[0] * self._turn_m]), self._limits[0]
                self._newest = Kind.DRIVE, (max(-limit, min(speed, limit)), 0, 0, 0, 0, 0)
                self._pass(*self._newest)
            case CanCommand.ESTOP:
                self._pass(Kind.STOP)
            case CanCommand.CLEAR_ERRORS:
                self._cleared = self._box.state.latch
            case CanCommand.SET_AXIS_STATE if content == simple.WORD.pack(simple.CLOSED_LOOP) and not self._error:
                for _ in range(100):  # the time that the rules of a box ask for, and an axis does not
                    self.tick()
                self._pass(Kind.REARM)

    @property
    def heartbeat(self) -> bytes:
        """Error and state."""
        state = simple.CLOSED_LOOP if self._box.state.cause == Cause.ARMED else simple.IDLE
        return simple.HEARTBEAT.pack(self._error, state, 0, 0)

    def events(self) -> list[str]:
        """Return a line if the axis was stopped or armed."""
        return [f"axis {self._node} {event}" for event in self._box.events()]

    @property
    def _error(self) -> int:
        """Error of the last stop, until it is cleared."""
        state, bits = self._box.state, {Cause.WATCHDOG: simple.WATCHDOG_EXPIRED, Cause.STOPPED: simple.ESTOP_REQUESTED}
        return 0 if state.latch == self._cleared else bits.get(state.cause, 0)

    def _pass(self, kind: Kind, values: tuple[int, ...] = (0,) * frame.VALUES) -> None:
        """Pass a message to the box, stamped now."""
        self._sequence = (self._sequence + 1) % 2**16
        latch, numbers = self._box.state.latch, {"sender": 0, "sequence": self._sequence, "stamp_ms": self._now_ms}
        self._box.receive(HostMessage(kind=kind, latch=latch, values=values, **numbers).frame())


class CanAxes:
    """Both axes between a CAN bus and a chair, whose sensors are on a serial line.

    Args:
        options: Interface, channel and further options of python-can's bus.
    """

    def __init__(self, chair: EmulatedChair, faults: Faults, terminal: Terminal, options: dict[str, Any]) -> None:
        self._chair, self._faults, self._terminal = chair, faults, terminal
        self._bus, self._turn_m = open_bus(**options), math.tau * chair.chair.tracks.pulley_radius_m
        self._line: FaultyLine[can.Message] = FaultyLine(faults, lambda *_: [])  # a bus drops a broken message
        drives = chair.chair.drives
        limits = DriveLimits(speed_m_s=drives.max_speed_m_s, acceleration_m_s2=drives.max_acceleration_m_s2, watchdog_s=0.1)
        values, has_watchdog = frame.limit_values(limits), not faults.active("no_watchdog", 0.0)
        self._axes = {node: EmulatedAxis(node, self._turn_m, values, has_watchdog=has_watchdog) for node in NODES}
        self._sensors = DriveBox()

    def step(self) -> Iterator[str]:
        """Carry messages, run both axes, and drive the chair for one tick; yield a line for each change of an axis."""
        t_s = self._chair.t_s
        for message in self._line.carry(self._received(), t_s):
            self._obey(message)
        if self._faults.once("second_host", t_s):
            self._write(min(self._axes), CanCommand.SET_INPUT_VEL, simple.FLOATS.pack(0.123, 0.0))
        if self._faults.once("brown_out", t_s):
            self._axes[min(self._axes)].start()
        outputs = Outputs(brake=True)
        for side, axis in enumerate(self._axes.values()):
            moved = axis.tick()
            outputs.belts_um_s[side], outputs.brake = moved.belts_um_s[0], outputs.brake and moved.brake
            yield from axis.events()
        self._report(self._chair.step(outputs))

    def _received(self) -> list[can.Message]:
        """Return the messages of the host."""
        messages = iter(lambda: self._bus.recv(0), None)
        return [message for message in messages if message and message.arbitration_id >> simple.COMMAND_BITS in self._axes]

    def _obey(self, message: can.Message) -> None:
        node, command = divmod(message.arbitration_id, 1 << simple.COMMAND_BITS)
        if not message.is_remote_frame:
            self._axes[node].take(command, bytes(message.data))
        elif command == CanCommand.GET_VERSION:
            self._write(node, CanCommand.GET_VERSION, VERSION)
        elif command == CanCommand.ADDRESS:
            for serial in range(node, node + 1 + self._faults.active("two_with_one_id", self._chair.t_s)):
                self._write(node, CanCommand.ADDRESS, bytes([node]) + serial.to_bytes(6, "little") + b"\0")

    def _report(self, readings: Readings) -> None:
        """Send estimates, heartbeats and the voltage."""
        self._terminal.write(self._sensors.frame(readings))
        is_even = round(1000 * self._chair.t_s) // TICK_MS % HEARTBEAT_TICKS == 0
        (voltage_v,) = frame.physical("voltage", [readings.voltage_mv])
        for (node, axis), belt_m_s in zip(self._axes.items(), frame.physical("belts", self._chair.inputs.belts), strict=True):
            self._write(node, CanCommand.ENCODER_ESTIMATES, simple.FLOATS.pack(0.0, belt_m_s / self._turn_m))
            if is_even:
                self._write(node, CanCommand.HEARTBEAT, axis.heartbeat)
                self._write(node, CanCommand.BUS_VOLTAGE, simple.FLOATS.pack(voltage_v, 0.0))

    def _write(self, node: int, command: CanCommand, content: bytes) -> None:
        if not self._faults.active("unplugged", self._chair.t_s):
            identifier = node << simple.COMMAND_BITS | command
            self._bus.send(can.Message(arbitration_id=identifier, data=content, is_extended_id=False))
