"""Link to two axes of ODrive motor drives by CANSimple, through python-can.

Robot file: ``link = "can"``, ``interface`` and ``channel`` of python-can, ``left_node``, ``right_node``, ``wheel_radius_m`` and
``gear_ratio``. Velocity limit, ramp and watchdog are those of the drives' own configuration (docs/reference/firmware.md); the link
proves the watchdog before each re-arm.

Source: ODrive's documentation of its CAN protocol and the published message database ``odrive-cansimple-0.6.10.dbc``. An
arbitration id is the node's id, shifted by five bits, and the command.
"""

import contextlib
import math
import struct
import time
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Any

import can

from treadline.core.errors import LinkError
from treadline.hardware.device_threads import DeviceThreads
from treadline.hardware.ports import DriveLimits, DriveState

PROTOCOL = 2
"""Version of the protocol, which ``GET_VERSION`` reports for firmware 0.6."""
IDLE, CLOSED_LOOP = 1, 8
"""States of an axis."""
VELOCITY_CONTROL, VELOCITY_RAMP = 2, 2
"""Control mode and input mode."""
WATCHDOG_EXPIRED, ESTOP_REQUESTED = 0x100_0000, 0x200_0000
"""Bits of the error of an axis."""
FLOATS = struct.Struct("<ff")
"""Two numbers: velocity and torque, position and velocity, voltage and current; each report of a drive has this length."""
WORD, WORDS = struct.Struct("<I"), struct.Struct("<II")
HEARTBEAT = struct.Struct("<IBBBx")
"""Error, state, result of the last procedure, end of the trajectory."""
COMMAND_BITS = 5
SETTLE_S = 2.0
"""Time in which an axis must take a state [s]: twenty heartbeats of the default period."""


class CanCommand(IntEnum):
    """Commands, the lower five bits of an arbitration id."""

    GET_VERSION = 0x00
    HEARTBEAT = 0x01
    ESTOP = 0x02
    ADDRESS = 0x06
    SET_AXIS_STATE = 0x07
    ENCODER_ESTIMATES = 0x09
    SET_CONTROLLER_MODE = 0x0B
    SET_INPUT_VEL = 0x0D
    BUS_VOLTAGE = 0x17
    CLEAR_ERRORS = 0x18


@dataclass(slots=True)
class Axis:
    """What one node reported last."""

    node: int
    velocity_m_s: float = 0.0
    is_new: bool = False
    """Whether ``velocity_m_s`` came after the last ``DriveState``."""
    state: int = 0
    error: int = 0
    was_closed: bool = False
    """Whether the axis was in closed-loop control since it was last asked to be: its errors are new."""
    protocol: int | None = None
    serials: set[bytes] = field(default_factory=set)
    """Serial numbers that answered under this id."""

    @property
    def is_closed(self) -> bool:
        """Whether the axis is in closed-loop control."""
        return self.state == CLOSED_LOOP and not self.error

    @property
    def problem(self) -> str | None:
        """Error of the drive in one line; none for those that stop() and the watchdog set."""
        if self.protocol is None:
            return f"drive {self.node} does not report its protocol version; it needs firmware 0.6"
        error = self.error & ~(WATCHDOG_EXPIRED | ESTOP_REQUESTED)
        return f"drive {self.node} reports error {error:#x}; read it with odrivetool: dump_errors" if error else None


class CanSimpleLink:
    """Drive link to one axis for each belt.

    Args:
        channel: Channel of the bus, for example can0.
        left_node: Node id of the left belt's axis.
        wheel_radius_m: Radius of the pulley that drives a belt [m].
        limits: Limits of the commands; the drives must be configured with the same.
        gear_ratio: Turns of the motor for a turn of the pulley.
        interface: Interface of python-can.
        options: Further options of python-can's bus.

    Raises:
        LinkError: If a number is impossible, or the bus does not open.
    """

    def __init__(
        self,
        *,
        channel: str,
        left_node: int,
        right_node: int,
        wheel_radius_m: float,
        limits: DriveLimits,
        gear_ratio: float = 1.0,
        interface: str = "socketcan",
        **options: Any,
    ) -> None:
        self._turn_m = turn_m(wheel_radius_m, gear_ratio)
        self._axes = {node: Axis(node) for node in _nodes(left_node, right_node)}
        self._limits, self._bus = limits, CanBus(interface=interface, channel=channel, **options)
        self._voltage_v: float | None = None
        self._phase = "latched"
        """latched; proving: standing without a command until the watchdog trips; arming; armed."""
        self._phase_s = 0.0
        self._fault: str | None = None
        self._ask(CanCommand.GET_VERSION)

    def poll(self) -> Sequence[DriveState]:
        """Return a state for each pair of the axes' encoder estimates since the last call.

        Raises:
            LinkError: If the bus has gone, a drive speaks another protocol, or two drives have one id.
        """
        states = []
        for t_s, message in self._bus.read():
            # SocketCAN reports faults of the bus as messages too.
            is_report = not (message.is_remote_frame or message.is_error_frame)
            if not is_report or message.arbitration_id >> COMMAND_BITS not in self._axes:
                continue
            self._take(message)
            self._advance()
            if all(axis.is_new for axis in self._axes.values()):
                states.append(self._drive_state(t_s))
        return states

    def send(self, left_m_s: float, right_m_s: float) -> None:
        """Set the belt speeds within the limits. A speed that is not a number stops the drives."""
        if not (math.isfinite(left_m_s) and math.isfinite(right_m_s)):
            self.stop()
        elif self._phase in ("arming", "armed"):
            limit_m_s = self._limits.speed_m_s
            for node, speed_m_s in zip(self._axes, (left_m_s, right_m_s), strict=True):
                velocity = max(-limit_m_s, min(speed_m_s, limit_m_s)) / self._turn_m if self._phase == "armed" else 0.0
                self._send(node, CanCommand.SET_INPUT_VEL, FLOATS.pack(velocity, 0.0))

    def hold(self) -> None:
        """Ramp to zero with the drives' own ramp."""
        self.send(0.0, 0.0)

    def stop(self) -> None:
        """Stop at once, latched until ``rearm``."""
        self._enter("latched")
        for node in self._axes:
            self._send(node, CanCommand.ESTOP)

    def rearm(self) -> None:
        """Prove the watchdog, then end the latched stop; the belts stand meanwhile."""
        if any(axis.protocol is None for axis in self._axes.values()):
            return
        self._fault = None
        self._enter("proving")
        self._close_loops()

    def close(self) -> None:
        """Stop the drives and release the bus."""
        self.stop()
        self._bus.close()

    def _take(self, message: can.Message) -> None:
        """Keep what a message reports."""
        axis = self._axes[message.arbitration_id >> COMMAND_BITS]
        command, content = message.arbitration_id & ((1 << COMMAND_BITS) - 1), bytes(message.data)
        if len(content) != FLOATS.size and command != CanCommand.SET_AXIS_STATE:
            return
        match command:
            case CanCommand.HEARTBEAT:
                axis.error, axis.state, *_ = HEARTBEAT.unpack(content)
                axis.was_closed |= axis.is_closed
                if axis.protocol is None:
                    self._ask(CanCommand.GET_VERSION)
            case CanCommand.ENCODER_ESTIMATES:
                axis.velocity_m_s, axis.is_new = FLOATS.unpack(content)[1] * self._turn_m, True
            case CanCommand.BUS_VOLTAGE:
                self._voltage_v = FLOATS.unpack(content)[0]
            case CanCommand.GET_VERSION:
                self._identify(axis, content[0])
            case CanCommand.ADDRESS:
                axis.serials.add(content[1:7])
                if len(axis.serials) > 1:
                    raise LinkError(f"two drives have the node id {axis.node}; set another one with odrivetool: can.config.node_id")
            case CanCommand.SET_INPUT_VEL | CanCommand.SET_AXIS_STATE if (
                not self._bus.is_echo(message) and self._phase != "latched"
            ):
                self._fail(f"two hosts send commands to drive {axis.node}; stop one of them")

    def _identify(self, axis: Axis, protocol: int) -> None:
        """Keep the protocol of an axis, and ask for its serial number."""
        if protocol != PROTOCOL:
            raise LinkError(f"drive {axis.node} speaks version {protocol} of CANSimple, not {PROTOCOL}; update its firmware")
        if axis.protocol is None:
            axis.protocol = protocol
            self._ask(CanCommand.ADDRESS)

    def _advance(self) -> None:
        """Carry on with arming, and stop both axes where one has stopped; the watchdog, which the state names, is no fault."""
        axes, is_late = self._axes.values(), time.monotonic() - self._phase_s > SETTLE_S
        have_not_tripped = [axis for axis in axes if not (axis.was_closed and axis.error & WATCHDOG_EXPIRED)]
        are_open = [axis for axis in axes if not axis.is_closed]
        if self._phase == "proving" and not have_not_tripped:
            self._enter("arming")
            self._close_loops()
        elif self._phase == "proving" and is_late:
            wanted = f"axis0.config.watchdog_timeout = {self._limits.watchdog_s:g}, enable_watchdog = True"
            self._fail(f"drive {have_not_tripped[0].node} has no watchdog; set it with odrivetool: {wanted}")
        elif self._phase == "arming" and not are_open:
            self._enter("armed")
        elif are_open and (self._phase == "armed" or (self._phase == "arming" and is_late)):
            unexplained = [axis.node for axis in are_open if not axis.error & WATCHDOG_EXPIRED]
            causes = [f"drive {node} left closed-loop control; check its supply and errors (odrivetool)" for node in unexplained]
            self._fail(self._fault or next(iter(causes), None))

    def _close_loops(self) -> None:
        """Clear the errors and ask for closed-loop control at zero speed."""
        for node, axis in self._axes.items():
            axis.was_closed = False
            self._send(node, CanCommand.CLEAR_ERRORS, b"\0")
            self._send(node, CanCommand.SET_CONTROLLER_MODE, WORDS.pack(VELOCITY_CONTROL, VELOCITY_RAMP))
            self._send(node, CanCommand.SET_INPUT_VEL, FLOATS.pack(0.0, 0.0))
            self._send(node, CanCommand.SET_AXIS_STATE, WORD.pack(CLOSED_LOOP))

    def _enter(self, phase: str) -> None:
        self._phase, self._phase_s = phase, time.monotonic()

    def _fail(self, fault: str | None) -> None:
        """Stop with a cause, which stays until ``rearm``."""
        self._fault = fault
        self.stop()

    def _drive_state(self, t_s: float) -> DriveState:
        axes = list(self._axes.values())
        for axis in axes:
            axis.is_new = False
        problems = [self._fault, *(axis.problem for axis in axes)]
        return DriveState(
            t_s=t_s,
            box_s=None,
            left_m_s=axes[0].velocity_m_s,
            right_m_s=axes[1].velocity_m_s,
            watchdog_tripped=self._phase == "latched" and any(axis.error & WATCHDOG_EXPIRED for axis in axes),
            latched=self._phase != "armed",
            error=next(filter(None, problems), None),
            voltage_v=self._voltage_v,
        )

    def _ask(self, command: CanCommand) -> None:
        """Request a message from both axes."""
        for node in self._axes:
            self._send(node, command, remote=True)

    def _send(self, node: int, command: CanCommand, content: bytes = b"", *, remote: bool = False) -> None:
        identifier = node << COMMAND_BITS | command
        message = can.Message(arbitration_id=identifier, data=content, is_extended_id=False, is_remote_frame=remote)
        self._bus.write(message, is_command=command in (CanCommand.SET_INPUT_VEL, CanCommand.SET_AXIS_STATE))


class CanBus:
    """Bus of python-can that is read and written in threads of its own, and separates its own commands from another host's.

    Args:
        options: Interface, channel and further options of python-can's bus.

    Raises:
        LinkError: If it does not open.
    """

    def __init__(self, **options: Any) -> None:
        bus = self._bus = open_bus(**options)
        gone = f"the CAN bus {options['interface']} {options['channel']} has gone"

        def transmit(message: can.Message) -> None:
            # A bus that takes no message is reported by ``read``, and stops the drives by their watchdog.
            with contextlib.suppress(can.CanError, OSError):
                bus.send(message, timeout=0)

        self._threads: DeviceThreads[can.Message, can.Message] = DeviceThreads(
            bus.recv, transmit, lambda error: f"{gone} ({error}); bring it up and start again"
        )
        self.read = self._threads.read
        """Returns the messages since the last call, with the monotonic time of their arrival [s]; raises if the bus has gone."""
        self._sent: deque[tuple[int, bytes]] = deque(maxlen=64)
        """Commands of which the bus may return copies."""

    def write(self, message: can.Message, *, is_command: bool = True) -> None:
        """Send a message; a command is remembered, because a bus may return a copy of it."""
        if is_command:
            self._sent.append((message.arbitration_id, bytes(message.data)))
        self._threads.write(message)

    def is_echo(self, message: can.Message) -> bool:
        """Return whether a command on the bus is a copy of one that was sent here; each copy counts once."""
        command = message.arbitration_id, bytes(message.data)
        is_own = command in self._sent
        if is_own:
            self._sent.remove(command)
        return is_own

    def close(self) -> None:
        """Release the bus."""
        self._threads.close()
        self._bus.shutdown()


def open_bus(**options: Any) -> can.BusABC:
    """Return a bus by the options of python-can.

    Raises:
        LinkError: If it does not open.
    """
    try:
        return can.Bus(**options)
    except (can.CanError, OSError, ValueError, ImportError) as error:
        name = f"{options['interface']} {options['channel']}"
        raise LinkError(f"no CAN bus {name} ({error}); bring it up, or correct interface and channel") from error


def turn_m(wheel_radius_m: float, gear_ratio: float) -> float:
    """Return the travel of a belt in a turn of its motor [m].

    Raises:
        LinkError: If a number is impossible.
    """
    for name, value in (("wheel_radius_m", wheel_radius_m), ("gear_ratio", gear_ratio)):
        if not (math.isfinite(value) and value > 0.0):
            raise LinkError(f"{name} is {value}; it must be above zero: measure the belt's drive pulley and read the gear's plate")
    return math.tau * wheel_radius_m / gear_ratio


def _nodes(left: int, right: int) -> tuple[int, int]:
    """Return the two node ids."""
    if left == right or not (0 <= left < 64 and 0 <= right < 64):
        raise LinkError(f"left_node is {left} and right_node {right}; give each drive an id of its own from 0 to 63")
    return left, right
