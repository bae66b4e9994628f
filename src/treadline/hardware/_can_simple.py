"""CANSimple, the CAN protocol of ODrive's motor drives, as far as a link needs it: commands, states, errors.

Source: ODrive's documentation of its CAN protocol and the published message database ``odrive-cansimple-0.6.10.dbc``. An
arbitration id is the node's id, shifted by five bits, and the command.
"""

import struct
from enum import IntEnum

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
