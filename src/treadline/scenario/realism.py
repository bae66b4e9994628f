"""The ``[realism]`` table of a scenario: limits of actuators and sensors that an ideal chair does not have.

Each default is typical of the class of hardware; docs/realism.md gives the source and the effect of each. Zero, or ``false``,
makes the part ideal.
"""

from typing import Annotated

from pydantic import Field

from treadline.core.settings import Settings


class Realism(Settings):
    """Transport of camera readings, resolution of the encoders, limits of the motors, charge of the battery."""

    camera_latency_s: Annotated[float, Field(ge=0.0, le=0.5)] = 0.06
    """Mean time from exposure to delivery of a camera's readings [s]; they are delivered at the next tick. Typical, assumed: two
    frames of a depth camera at 30 Hz over USB."""
    camera_jitter_s: Annotated[float, Field(ge=0.0, le=0.2)] = 0.01
    """Standard deviation of the latency [s]; readings keep their order. Typical, assumed: scheduling without a real-time kernel."""
    camera_drop_rate: Annotated[float, Field(ge=0.0, lt=1.0)] = 0.01
    """Probability that a frame never arrives. Typical, assumed: USB transfers lost under load."""
    encoder_counts_m: Annotated[float, Field(ge=0.0, le=1e8)] = 109_000.0
    """Encoder counts per metre of belt [1/m]; a speed is counts per 10 ms. Typical: a 500-line encoder (HEDS-5540: 2000 counts per
    turn) on a motor geared 24:1 to a pulley of 0.07 m, 2000 · 24 / (2π · 0.07 m). Zero reports exact speeds."""
    motor_limits: bool = True
    """Whether motors and brakes have the limits in the chair's file; without, belts follow their speeds at any load."""
    battery_charge: Annotated[float, Field(gt=0.0, le=1.0)] = 1.0
    """State of charge at the start, 1 full."""
