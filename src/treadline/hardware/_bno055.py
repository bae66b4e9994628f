"""Inertial sensor BNO055 of Bosch on a serial line of its own: registers by its UART protocol, attitude in IMU mode.

Robot file: ``link = "bno055"``, ``port``, and ``forward`` and ``up``, the sensor's axes (printed on its board) that point forward
and up on the chair. Source of all numbers: BNO055 data sheet BST-BNO055-DS000-14, sections 3.3 to 3.6, 4.3 and 4.7.

IMU mode fuses gyro and accelerometer. NDOF mode would add the magnetometer, which motors and the steel of a stair deflect, and AMG
mode gives no attitude.
"""

import struct
import time
from collections.abc import Sequence
from typing import Any

from treadline.core.errors import LinkError
from treadline.core.signals import ImuSample
from treadline.hardware._serial_link import SPEAKS_S, SerialLine

READ_CHIP, READ_SAMPLE = b"\xaa\x01\x00\x01", b"\xaa\x01\x08\x20"
"""Commands to read: begin, read, register, number of bytes. The answer is ``DATA``, the number of bytes, and these."""
CONFIGURE, SET_UNITS, SET_AXES, FUSE = (
    b"\xaa\x00\x3d\x01\x00",
    b"\xaa\x00\x3b\x01\x82",
    b"\xaa\x00\x41\x02",
    b"\xaa\x00\x3d\x01\x08",
)
"""Commands to write: begin, write, register, number of bytes, bytes. Mode of configuration and IMU mode; rad/s and m/s², with the
orientation's convention as after a reset; AXIS_MAP_CONFIG and AXIS_MAP_SIGN, which follow."""
DATA, STATUS, WRITTEN, CHIP = b"\xbb", b"\xee", b"\xee\x01", b"\xbb\x01\xa0"
"""Begin of data, begin of a status, status of what was written, answer of a BNO055 to ``READ_CHIP``."""
SAMPLE = struct.Struct("<3h6x3h6x4h")
"""Registers 0x08 to 0x27: accelerations, (magnetometer), rates, (Euler angles), quaternion w, x, y, z."""
PER_M_S2, PER_RAD_S, PER_ONE = 100.0, 900.0, 2.0**14
"""Counts for 1 m/s², for 1 rad/s and for a quaternion's 1."""
ANSWER_S = 0.03
"""Time after which an answer is lost [s]: 38 bytes of question and answer take 3.3 ms, and the fusion has a period of 10 ms. Pause
after a change of the mode as well, which takes 19 ms to configure and 7 ms back."""


class Bno055Link:
    """Sensor link to a BNO055: one sample a call, 100 Hz in the guard process.

    Args:
        port: Device of the line.
        forward: Axis of the sensor that points forward on the chair: x, -x, y, -y, z or -z.
        up: Axis of the sensor that points up.

    Raises:
        LinkError: If the port does not open, no BNO055 answers within ``SPEAKS_S``, or the axes are impossible.
    """

    def __init__(self, *, port: str, forward: str = "x", up: str = "z") -> None:
        axes = axis_map(forward, up)
        self._name, self._line = f"the BNO055 at {port}", SerialLine(port, 115_200)
        self._received, self._asked_s, self._heard_s = b"", 0.0, time.monotonic()
        try:
            self._begin(axes)
        except LinkError:
            self._line.close()
            raise

    def poll(self) -> Sequence[ImuSample]:
        """Return the sample that has been asked for, and ask for the next; one that is lost or refused is asked for again.

        Raises:
            LinkError: If the port has gone, or no attitude has come for ``SPEAKS_S``.
        """
        answer = self._answer()
        if answer is None and time.monotonic() - self._asked_s < ANSWER_S:
            return []
        # More than one answer: some came late, and which question each answers is unknown.
        samples = [] if answer is None else _samples(self._received, self._asked_s)
        if samples:
            self._heard_s = self._asked_s
        elif self._asked_s - self._heard_s > SPEAKS_S:
            raise LinkError(f"{self._name} {_fault(answer)}")
        self._ask(READ_SAMPLE)
        return samples

    def close(self) -> None:
        """Release the port."""
        self._line.close()

    def _begin(self, axes: bytes) -> None:
        """Configure the sensor for the axes of the chair, and begin the fusion."""
        chip = self._answer_to(READ_CHIP)
        if chip != CHIP:
            raise LinkError(f"{self._name} reports chip id 0x{chip[2:].hex()}, not 0xa0: another device; correct port")
        for command in (CONFIGURE, SET_UNITS, SET_AXES + axes, FUSE):
            self._answer_to(command)
            time.sleep(ANSWER_S)

    def _ask(self, command: bytes) -> None:
        """Send a command; what is left of an earlier answer is dropped."""
        self._line.read()
        self._received, self._asked_s = b"", time.monotonic()
        self._line.write(command)

    def _answer(self) -> bytes | None:
        """Return the answer; None before it is whole."""
        self._received += b"".join(data for _, data in self._line.read())
        if len(self._received) < 2:
            return None
        length = {DATA: 2 + self._received[1], STATUS: 2}.get(self._received[:1], len(self._received) + 1)
        return self._received[:length] if len(self._received) >= length else None

    def _answer_to(self, command: bytes) -> bytes:
        """Return the answer to a command, which is repeated until one comes that is no error."""
        end_s = time.monotonic() + SPEAKS_S
        while True:
            self._ask(command)
            while (answer := self._answer()) is None and time.monotonic() - self._asked_s < ANSWER_S:
                time.sleep(0.1 * ANSWER_S)
            if answer is not None and (answer == WRITTEN or answer[:1] == DATA):
                return answer
            if self._asked_s > end_s:
                raise LinkError(f"{self._name} {_fault(answer)}")


def _fault(answer: bytes | None) -> str:
    """Return what is wrong with an answer, with the remedy."""
    if answer is None:
        return "does not answer; cross TX and RX, check its supply, and that PS1 is high and PS0 low"
    if answer[:1] == STATUS:
        return f"answers with status {answer[1]:#04x} (0x07: bus overrun; others: data sheet, section 4.7); check the line"
    return "has no attitude: it has started anew; check its supply"


def _samples(answer: bytes, t_s: float) -> list[ImuSample]:
    """Return a sample taken at a time [s]; none of a status, and without an attitude, which is zero until the fusion has begun."""
    if len(answer) != 2 + SAMPLE.size or not any(answer[-8:]):
        return []
    counts = SAMPLE.unpack(answer[2:])
    forces: Any = [count / PER_M_S2 for count in counts[:3]]
    rates: Any = [count / PER_RAD_S for count in counts[3:6]]
    quaternion: Any = [count / PER_ONE for count in counts[6:]]
    return [ImuSample(t_s=t_s, orientation=quaternion, angular_velocity_rad_s=rates, linear_acceleration_m_s2=forces)]


def axis_map(forward: str, up: str) -> bytes:
    """Return AXIS_MAP_CONFIG and AXIS_MAP_SIGN, by which the sensor reports in the axes of the chair (section 3.4).

    Raises:
        LinkError: If the two are not different axes.
    """
    ahead, above = forward.removeprefix("-"), up.removeprefix("-")
    left = "xyz".translate({ord(letter): None for letter in ahead + above})
    if len(left) != 1 or len(ahead + above) != 2:
        raise LinkError(f"forward is '{forward}' and up is '{up}'; give two different axes of x, -x, y, -y, z, -z")
    signs = len(forward) - 1, (len(forward) + len(up) + (ahead + left + above not in "xyzxy")) % 2, len(up) - 1
    config = sum("xyz".index(axis) << 2 * place for place, axis in enumerate((ahead, left, above)))
    return bytes([config, signs[0] << 2 | signs[1] << 1 | signs[2]])
