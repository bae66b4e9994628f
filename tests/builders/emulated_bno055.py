"""BNO055 behind a pseudo-terminal: its registers, the fusion that fills them in IMU mode, and faults of its line."""

import os
import struct
import tty
from threading import Thread

AT_REST = struct.pack("<3h6x3h6x4h", 0, -1, 981, 900, 0, -90, 16384, 0, 0, -1)
"""Registers 0x08 to 0x27 by the data sheet: 9.81 m/s² upwards, 1 rad/s about x and -0.1 rad/s about z, level."""


class EmulatedBno055:
    """Sensor at a port; ``fault`` is silent, cut, overrun, other chip, restarted, or empty."""

    def __init__(self) -> None:
        self._near, self._far = os.openpty()
        tty.setraw(self._far)
        self.port, self.fault, self.registers = os.ttyname(self._far), "", bytearray(128)
        self._thread = Thread(target=self._run)
        self._thread.start()

    def end(self) -> None:
        """Remove the sensor."""
        os.write(self._far, b"end")
        self._thread.join()
        os.close(self._near)
        os.close(self._far)

    def _run(self) -> None:
        while (command := os.read(self._near, 1000)) != b"end":
            answer = b"\xee\x07" if self.fault == "overrun" else self._answer(*command[:4], command[4:])
            os.write(self._near, answer[: {"silent": 0, "cut": len(answer) // 2}.get(self.fault, len(answer))])

    def _answer(self, start: int, command: int, register: int, length: int, data: bytes) -> bytes:
        assert start == 0xAA
        self.registers = bytearray(128) if self.fault == "restarted" else self.registers
        self.registers[0] = 0xA1 if self.fault == "other chip" else 0xA0
        self.registers[register : register + len(data)] = data
        self.registers[8:0x28] = AT_REST if self.registers[0x3D] == 0x08 else bytes(0x20)
        return bytes([0xBB, length]) + self.registers[register : register + length] if command == 1 else b"\xee\x01"
