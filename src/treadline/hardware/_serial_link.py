"""Link to a box with the firmware of this project (``firmware/``) on a serial line: drives, joints, inertial sensor and handset.

Robot file: ``link = "serial"``, ``port``, and ``baud`` where the line is no USB device.
"""

import contextlib
import math
import os
import random
import time
from collections.abc import Sequence

import serial

from treadline.core.errors import LinkError
from treadline.core.signals import FlipperReading, ImuSample, OperatorInput, SeatReading
from treadline.hardware import _frame as frame
from treadline.hardware._frame import BoxState, Cause, Flag, FrameReader, HostMessage, Kind, Present, Reply, counts
from treadline.hardware.ports import BoxReading, DriveLimits, DriveState

SPEAKS_S = 2.0
"""Time after opening within which a box must have sent a whole frame [s]: boards that restart when their port opens take one."""
MOVE_VALID_S = 0.1
"""Time for which rates of seat and flipper are valid [s], see ``JointLink``."""
CHUNK = 65536
"""Bytes read at once, more than a system buffers."""
ERRORS = {
    Cause.TWO_HOSTS: "two hosts send commands to the box; stop one of them",
    Cause.DEAD_MAN: "the dead-man switch at the box was released",
    Cause.BUTTON: "the stop button at the box was pressed",
}


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
        try:
            self._line = serial.Serial(port, baud, timeout=0, write_timeout=0, exclusive=True)
        except (serial.SerialException, OSError, ValueError) as error:
            raise LinkError(_open_problem(port, error)) from error
        self._reader, self._has_spoken = FrameReader(), False
        self._sender, self._sequence = random.randrange(1, 2**16), 0
        self._state: BoxState | None = None
        self._was_armed = False
        self._joints, self._joints_s = (0, 0), -math.inf

    def poll(self) -> Sequence[BoxReading]:
        """Return the readings since the last call, and hand the limits to a box that has none.

        Raises:
            LinkError: If the device has gone, is no box, or speaks another version.
        """
        try:
            received = self._line.read(CHUNK)
        except (serial.SerialException, OSError, TypeError) as error:
            raise LinkError(f"the box at {self._port} has gone ({error}); connect it and start again") from error
        now_s, readings = time.monotonic(), list[BoxReading]()
        states = [state for content in self._reader.feed(received) if (state := frame.state_of(content)) is not None]
        for state in states:
            # Of states that arrived together the older ones are older by the box's clock, unless it has started anew.
            t_s = now_s - max((states[-1].now_ms - state.now_ms) * frame.MILLI, 0.0)
            self._state, self._has_spoken = state, True
            readings.extend(_sensor_readings(state, t_s))
            if self._limits is not None:
                readings.append(_drive_state(state, t_s, self._error(state)))
        if not self._has_spoken and now_s - self._opened_s > SPEAKS_S:
            raise LinkError(
                f"{self._port} sent no frame of a box within {SPEAKS_S:g} s ({self._reader.broken} broken ones); "
                "check the port, the bit rate, and that the box runs the firmware"
            )
        if readings and self._limits is not None:
            self._set_limits(self._limits)
        return readings

    def send(self, left_m_s: float, right_m_s: float) -> None:
        """Set the belt speeds. A speed that is not a number stops the box."""
        if not (math.isfinite(left_m_s) and math.isfinite(right_m_s)):
            self.stop()
            return
        self._send(Kind.DRIVE, (counts(left_m_s, frame.BELT_M_S), counts(right_m_s, frame.BELT_M_S), *self._rates(), 0, 0))

    def hold(self) -> None:
        """Ramp to zero and stand braked."""
        self._send(Kind.HOLD, (0, 0, *self._rates(), 0, 0))

    def stop(self) -> None:
        """Stop at once, latched until ``rearm``."""
        self._send(Kind.STOP)

    def rearm(self) -> None:
        """End the latched stop that the newest state reported."""
        self._send(Kind.REARM)

    def move(self, seat_m_s: float, flipper_rad_s: float) -> None:
        """Set the rates of seat and flipper, which travel with the next ``send`` or ``hold``; not a number stops both."""
        is_finite = math.isfinite(seat_m_s) and math.isfinite(flipper_rad_s)
        self._joints = (counts(seat_m_s, frame.SEAT_M), counts(flipper_rad_s, frame.FLIPPER_RAD_S)) if is_finite else (0, 0)
        self._joints_s = time.monotonic()

    def close(self) -> None:
        """Stop the box and release the port."""
        if self._line.is_open:
            self.stop()
            self._line.close()

    def _rates(self) -> tuple[int, int]:
        return self._joints if time.monotonic() - self._joints_s <= MOVE_VALID_S else (0, 0)

    def _set_limits(self, limits: tuple[int, ...]) -> None:
        """Send the limits to a box that stands and has others: it accepts a re-arm afterwards."""
        state = self._state
        if state is not None and state.cause != Cause.ARMED and state.limits != limits:
            self._send(Kind.LIMITS, limits)

    def _send(self, kind: Kind, values: tuple[int, ...] = (0,) * frame.VALUES) -> None:
        """Write a message; a line that takes no bytes, or has gone, is reported by ``poll`` and by the box's silence.

        pyserial's own ``write`` waits for a full line for ever, with a busy core, even if its timeout is zero.
        """
        if self._limits is None:
            return
        self._sequence = (self._sequence + 1) % 2**16
        stamp_ms, latch = (0, 0) if self._state is None else (self._state.now_ms, self._state.latch)
        message = HostMessage(
            kind=kind, sender=self._sender, sequence=self._sequence, stamp_ms=stamp_ms, latch=latch, values=values
        )
        with contextlib.suppress(serial.SerialException, OSError):
            os.write(self._line.fileno(), message.frame())

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
        return ERRORS.get(state.cause)


def _open_problem(port: str, error: Exception) -> str:
    """Return why a port cannot be opened, with the remedy."""
    text = str(error)
    if "lock" in text:
        return f"{port} is in use by another program; end it, or give another port"
    if "Permission" in text:
        return (
            f"no permission to open {port}; add yourself to its group (ls -l {port}), for example: sudo usermod -aG dialout $USER"
        )
    if "No such file" in text:
        return f"no device {port}; connect the box, and look for its port with: python -m serial.tools.list_ports"
    return f"{port} cannot be opened: {text}; give the device of a serial line"


def _sensor_readings(state: BoxState, t_s: float) -> list[BoxReading]:
    """Return the readings of the sensors that the box has."""
    readings: list[BoxReading] = []
    if Present.IMU in state.present:
        readings.append(_imu_sample(state, t_s))
    if Present.SEAT in state.present:
        pitch, stroke = state.seat
        readings.append(SeatReading(t_s=t_s, pitch_rad=pitch * frame.RAD, stroke_m=stroke * frame.SEAT_M))
    if Present.FLIPPER in state.present:
        angle, torque = state.flipper
        readings.append(FlipperReading(t_s=t_s, angle_rad=angle * frame.RAD, torque_n_m=torque * frame.TORQUE_N_M))
    if Present.HANDSET in state.present:
        buttons = {"stop": Flag.STOP, "rearm": Flag.REARM, "flight_ends": Flag.FLIGHT_ENDS, "go_back": Flag.GO_BACK}
        pressed = {name: flag in state.flags for name, flag in buttons.items()}
        readings.append(OperatorInput(t_s=t_s, dead_man=Flag.DEAD_MAN in state.flags, **pressed))
    return readings


def _drive_state(state: BoxState, t_s: float, error: str | None) -> DriveState:
    left, right = state.belts
    return DriveState(
        t_s=t_s,
        box_s=state.now_ms * frame.MILLI,
        left_m_s=left * frame.BELT_M_S,
        right_m_s=right * frame.BELT_M_S,
        watchdog_tripped=state.cause == Cause.WATCHDOG,
        latched=state.cause != Cause.ARMED,
        error=error,
        voltage_v=state.voltage_mv * frame.MILLI if Present.VOLTAGE in state.present else None,
    )


def _imu_sample(state: BoxState, t_s: float) -> ImuSample:
    """Return the inertial sample of a state, whose sensor is mounted along the axes of the chair."""
    w, x, y, z = (part * frame.QUATERNION for part in state.orientation)
    about_x, about_y, about_z = (rate * frame.RAD for rate in state.rates)
    along_x, along_y, along_z = (part * frame.MILLI for part in state.accelerations)
    return ImuSample(
        t_s=t_s,
        orientation=(w, x, y, z),
        angular_velocity_rad_s=(about_x, about_y, about_z),
        linear_acceleration_m_s2=(along_x, along_y, along_z),
    )
