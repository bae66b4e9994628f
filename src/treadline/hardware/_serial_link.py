"""Link to a box with the firmware of this project (``firmware/``) on a serial line: drives, joints, inertial sensor and handset.

Robot file: ``link = "serial"``, ``port``, and ``baud`` where the line is no USB device.
"""

import math
import os
import random
import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import serial
from serial.tools.list_ports import comports

from treadline.core.errors import LinkError
from treadline.core.signals import FlipperReading, ImuSample, OperatorInput, SeatReading
from treadline.guard.stop_latch import AGAIN_S
from treadline.hardware import _frame as frame
from treadline.hardware._frame import BoxState, Cause, Flag, FrameReader, HostMessage, Kind, Present, Reply
from treadline.hardware.device_threads import DeviceThreads, received_bytes, write_or_lose
from treadline.hardware.ports import BoxReading, DriveLimits, DriveState

SPEAKS_S = 2.0
"""Time without a message after which a device counts as silent [s]: boards that restart when their port opens take one."""
NEVER = (0, -math.inf)
"""Latched stop that a re-arm ended, and when: none yet."""
MOVE_VALID_S = 0.1
"""Time for which rates of seat and flipper are valid [s], see ``JointLink``."""
ERRORS = {
    Cause.TWO_HOSTS: "two hosts send commands to the box; stop one of them",
    Cause.DEAD_MAN: "the dead-man switch at the box was released",
    Cause.BUTTON: "the stop button at the box was pressed",
    Cause.RUNAWAY: "a belt turned although the box stood, which cut the drives' power; check brake and drives",
}
PROBLEMS = {
    "lock": "is in use by another program; end it, or give another port",
    "Permission": "needs a permission: add yourself to its group (ls -l {port}), for example: sudo usermod -aG dialout $USER",
    "No such file": "does not exist; connect the device, and look for its port with: python -m serial.tools.list_ports",
    "": "cannot be opened: {error}; give the device of a serial line",
}
"""Remedies by a word of the system's error."""


class SerialLine:
    """Serial line whose calls return at once.

    Args:
        port: Device of the line, for example /dev/ttyACM0.
        baud: Bit rate; USB devices ignore it.
        parse: Makes one item of the bytes that arrive, in the reader's thread; a false one is left out.

    Raises:
        LinkError: If the port is missing, busy, not permitted, or one of two devices with one id.
    """

    def __init__(self, port: str, baud: int, parse: Callable[[bytes], Any] = bytes) -> None:
        _check_only_one(port)
        try:
            self._line = serial.Serial(port, baud, timeout=0, write_timeout=0, exclusive=True)
        except (serial.SerialException, OSError, ValueError) as error:
            remedy = next(remedy for word, remedy in PROBLEMS.items() if word in str(error))
            raise LinkError(f"{port} {remedy.format(port=port, error=error)}") from error
        descriptor = self._line.fileno()
        self._threads: DeviceThreads[Any, bytes] = DeviceThreads(
            lambda within_s: parse(received_bytes(descriptor, within_s)),
            partial(write_or_lose, descriptor),  # pyserial's own ``write`` waits for a full line for ever, with a busy core
            lambda error: f"the device at {port} has gone ({error}); connect it and start again",
        )

    def read(self) -> list[tuple[float, Any]]:
        """Return the items that have arrived, each with its time of arrival [s].

        Raises:
            LinkError: If the device has gone.
        """
        return self._threads.read()

    def write(self, data: bytes) -> None:
        """Queue bytes; a line that takes none, or has gone, is reported by ``read`` and by the device's silence."""
        self._threads.write(data)

    def close(self) -> None:
        """Write what is queued and release the port."""
        self._threads.close()
        self._line.close()


def _check_only_one(port: str) -> None:
    """Raise where another USB device has the id of this one: which of them has the port changes with each connection."""
    if "by-path" in port:
        return
    found = {info.device: (info.vid, info.pid, info.serial_number, str(info.location).partition(":")[0]) for info in comports()}
    vid, pid, number, socket = found.get(os.path.realpath(port), (None, None, None, ""))
    if number and any(other[:3] == (vid, pid, number) and other[3] != socket for other in found.values()):
        raise LinkError(
            f"{port}: two devices have the USB id {vid:04x}:{pid:04x} {number}; unplug one, or give its /dev/serial/by-path"
        )


class SerialLink:
    """Drive, joint and sensor link over one serial line.

    Args:
        port: Device of the line, for example /dev/ttyACM0.
        limits: Limits that the box receives before it can be armed. None: only its sensors are read, and nothing is sent.
        baud: Bit rate; USB devices ignore it. 100 states a second need 83,000 bit/s.

    Raises:
        LinkError: If the port is missing, busy, or not permitted.
    """

    def __init__(self, *, port: str, limits: DriveLimits | None = None, baud: int = 115_200) -> None:
        self._port, self._opened_s = port, time.monotonic()
        self._limits = None if limits is None else frame.limit_values(limits)
        self._reader, self._has_spoken = FrameReader(), False
        self._line = SerialLine(port, baud, self._states)
        self._sender, self._sequence = random.randrange(1, 2**16), 0
        self._state: BoxState | None = None
        self._was_armed = False
        self._joints, self._joints_s = (0.0, 0.0), -math.inf
        self._ended = NEVER

    def poll(self) -> Sequence[BoxReading]:
        """Return the readings since the last call, and hand the limits to a box that stands and has others.

        Raises:
            LinkError: If the device has gone, is no box, or speaks another version.
        """
        readings = list[BoxReading]()
        for arrived_s, states in self._line.read():
            for state in states:
                # Of states that arrived together the older ones are older by the box's clock, unless it has started anew.
                t_s = arrived_s - max((states[-1].now_ms - state.now_ms) * frame.MILLI, 0.0)
                self._state, self._has_spoken = state, True
                self._ended = NEVER if state.cause == Cause.ARMED else self._ended
                readings.extend(_sensor_readings(state, t_s))
                if self._limits is not None:
                    readings.append(_drive_state(state, t_s, self._error(state)))
        if not self._has_spoken and time.monotonic() - self._opened_s > SPEAKS_S:
            raise LinkError(
                f"{self._port} sent no frame of a box within {SPEAKS_S:g} s ({self._reader.broken} broken ones); "
                "check the port, the bit rate, and that the box runs the firmware"
            )
        newest = self._state if readings else None
        if newest is not None and self._limits is not None and newest.cause != Cause.ARMED and newest.limits != self._limits:
            self._send(Kind.LIMITS, self._limits)  # a box that stands accepts a re-arm afterwards
        elif newest is not None and newest.latch == self._ended[0] and time.monotonic() - self._ended[1] < AGAIN_S:
            self._send(Kind.REARM)  # the box's stop may be younger than the guard's hold
        return readings

    def send(self, left_m_s: float, right_m_s: float) -> None:
        """Set the belt speeds. A speed that is not a number stops the box."""
        if not (math.isfinite(left_m_s) and math.isfinite(right_m_s)):
            self.stop()
            return
        self._send(Kind.DRIVE, (*frame.counts("drive", (left_m_s, right_m_s, *self._rates())), 0, 0))

    def hold(self) -> None:
        """Ramp to zero and stand braked."""
        self._send(Kind.HOLD, (*frame.counts("drive", (0.0, 0.0, *self._rates())), 0, 0))

    def stop(self) -> None:
        """Stop at once, latched until ``rearm``."""
        self._ended = NEVER
        self._send(Kind.STOP)

    def rearm(self) -> None:
        """End the latched stop that the newest state reported, and no later one."""
        self._ended = NEVER if self._state is None else (self._state.latch, time.monotonic())
        self._send(Kind.REARM)

    def move(self, seat_m_s: float, flipper_rad_s: float) -> None:
        """Set the rates of seat and flipper, which travel with the next ``send`` or ``hold``; not a number stops both."""
        is_finite = math.isfinite(seat_m_s) and math.isfinite(flipper_rad_s)
        self._joints = (seat_m_s, flipper_rad_s) if is_finite else (0.0, 0.0)
        self._joints_s = time.monotonic()

    def close(self) -> None:
        """Stop the box and release the port."""
        self.stop()
        self._line.close()

    def _states(self, received: bytes) -> list[BoxState]:
        """Return the states whose frames end in these bytes."""
        return [state for content in self._reader.feed(received) if (state := frame.state_of(content)) is not None]

    def _rates(self) -> tuple[float, float]:
        return self._joints if time.monotonic() - self._joints_s <= MOVE_VALID_S else (0.0, 0.0)

    def _send(self, kind: Kind, values: tuple[int, ...] = (0,) * frame.VALUES) -> None:
        """Write a message, unless only sensors are read."""
        if self._limits is None:
            return
        self._sequence = (self._sequence + 1) % 2**16
        stamp_ms, latch = (0, 0) if self._state is None else (self._state.now_ms, self._state.latch)
        message = HostMessage(
            kind=kind, sender=self._sender, sequence=self._sequence, stamp_ms=stamp_ms, latch=latch, values=values
        )
        self._line.write(message.frame())

    def _error(self, state: BoxState) -> str | None:
        """Return the error of a state in one line."""
        self._was_armed |= state.cause == Cause.ARMED
        if state.cause == Cause.START and self._was_armed:
            return "the box has started anew; check its supply"
        if state.cause == Cause.DRIVE_ERROR or state.drive_error:
            return f"the motor drives report error {state.drive_error:#x}"
        if state.cause == Cause.ARMED and state.sender != self._sender:
            return "another host drives the box; stop it first"
        if state.cause != Cause.ARMED and not any(state.limits) and state.reply == Reply.BEYOND:
            return "the box refused the limits; its watchdog may have 0.1 s at most, and speed and acceleration are positive"
        if state.cause in (Cause.START, Cause.STOPPED) and Flag.STOP in state.flags:  # it forbids the re-arm
            return ERRORS[Cause.BUTTON]
        if state.cause in (Cause.START, Cause.STOPPED) and Flag.DEAD_MAN not in state.flags:
            return ERRORS[Cause.DEAD_MAN]
        return ERRORS.get(Cause.RUNAWAY if Flag.OPEN in state.flags else state.cause)


def _sensor_readings(state: BoxState, t_s: float) -> list[BoxReading]:
    """Return the readings of the sensors that the box has."""
    readings: list[BoxReading] = []
    if Present.IMU in state.present:  # mounted along the axes of the chair
        sample = ImuSample(
            t_s=t_s,
            orientation=frame.physical("orientation", state.orientation),
            angular_velocity_rad_s=frame.physical("rates", state.rates),
            linear_acceleration_m_s2=frame.physical("accelerations", state.accelerations),
        )
        readings.append(sample)
    if Present.SEAT in state.present:
        pitch_rad, stroke_m = frame.physical("seat", state.seat)
        readings.append(SeatReading(t_s=t_s, pitch_rad=pitch_rad, stroke_m=stroke_m))
    if Present.FLIPPER in state.present:
        angle_rad, torque_n_m = frame.physical("flipper", state.flipper)
        readings.append(FlipperReading(t_s=t_s, angle_rad=angle_rad, torque_n_m=torque_n_m))
    if Present.HANDSET in state.present:
        buttons = {"stop": Flag.STOP, "rearm": Flag.REARM, "flight_ends": Flag.FLIGHT_ENDS, "go_back": Flag.GO_BACK}
        pressed = {name: flag in state.flags for name, flag in buttons.items()}
        readings.append(OperatorInput(t_s=t_s, dead_man=Flag.DEAD_MAN in state.flags, **pressed))
    return readings


def _drive_state(state: BoxState, t_s: float, error: str | None) -> DriveState:
    left_m_s, right_m_s = frame.physical("belts", state.belts)
    (voltage_v,) = frame.physical("voltage", [state.voltage_mv])
    return DriveState(
        t_s=t_s,
        box_s=state.now_ms * frame.MILLI,
        left_m_s=left_m_s,
        right_m_s=right_m_s,
        watchdog_tripped=state.cause == Cause.WATCHDOG,
        latched=state.cause != Cause.ARMED,
        error=error,
        voltage_v=voltage_v if Present.VOLTAGE in state.present else None,
    )
