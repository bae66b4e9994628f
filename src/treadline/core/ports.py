"""Interfaces between the mission and a chair, real or simulated.

The mission uses ``Plant`` only. ``TruthPlant`` adds ground truth (``Truth``) for scoring: experiments read ground truth, the
mission has no access. ``Transport`` carries signals between blocks in different processes.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

from treadline.core.camera_images import RgbdFrame
from treadline.core.signals import (
    FlipperCommand,
    FlipperReading,
    FrameQuality,
    FreeGround,
    HeadingMeasurement,
    ImuSample,
    OperatorInput,
    PlantState,
    SeatCommand,
    SeatReading,
    StairMap,
    TrackCommand,
    TrackReading,
)

Reading = (
    RgbdFrame
    | ImuSample
    | SeatReading
    | TrackReading
    | FlipperReading
    | HeadingMeasurement
    | StairMap
    | FrameQuality
    | FreeGround
    | OperatorInput
    | PlantState
)
"""Readings from a plant. A camera with its own detector gives ``FrameQuality``, ``HeadingMeasurement``, ``StairMap``
and ``FreeGround``."""


@runtime_checkable
class Plant(Protocol):
    """A chair on its tracks: MuJoCo, Gazebo, a recorded log or hardware.

    Two attributes are optional. ``virtual_time = True`` states that time advances in ``advance`` alone, however long the loop
    takes; any other plant is taken to run on the wall clock, and a loop that stands still for 0.3 s of it holds the chair.
    ``brake()`` brakes the belts at once; a second thread calls it while ``advance``, ``read`` or ``write`` does not return.
    It must not wait for a lock that these calls hold: it would brake only after they return.
    """

    def start(self) -> None:
        """Put the chair at its start pose, at ``t_s = 0``, belts at rest."""

    def advance(self, until_s: float) -> None:
        """Step the simulation, or wait, until the mission clock reaches ``until_s``."""

    def read(self) -> Sequence[Reading]:
        """Return all samples since the last call, each kind in order of its stamps; camera samples arrive late."""

    def write(self, tracks: TrackCommand, seat: SeatCommand, flipper: FlipperCommand | None = None) -> None:
        """Send commands, which hold until the next call. ``flipper=None`` stops the flipper; a chair without one ignores it."""

    def close(self) -> None:
        """Release all resources of the plant."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Truth:
    """Ground truth of a simulated chair at one instant."""

    t_s: float
    heading_rad: float
    """Heading in the nosing plane [rad], positive anticlockwise seen from above."""
    yaw_rad: float
    """Rotation of the chassis about the vertical [rad]. With pitch and roll it gives the attitude, see ``angles.attitude_of``."""
    heading_rate_rad_s: float
    """Angular velocity about the normal of the nosing plane [rad/s]."""
    pitch_rad: float
    """Elevation of the chassis's x axis above horizontal [rad], front up positive."""
    roll_rad: float
    """Elevation of the chassis's y axis above horizontal [rad], left side up positive."""
    pitch_rate_rad_s: float
    x_m: float
    """Position of B along the stair frame S [m], up the flight. With turning flights, S belongs to the flight under the chair."""
    y_m: float
    """Position of B across the stair frame S [m], left."""
    seat_pitch_rad: float
    left_m_s: float
    """Actual belt speed [m/s], with actuator lag and mismatch."""
    right_m_s: float
    stability_margin_rad: float
    """Smallest static tip-over margin at this attitude [rad], over the nosings and floors in reach of belts and front tip."""
    friction_use: float
    """Required fraction of the friction circle at this heading and slope; the chair slides at 1."""
    passenger_x_m: float
    """Payload centre of mass in W, horizontal, up the flight [m]."""
    passenger_y_m: float
    """Payload centre of mass in W, horizontal, across the flight [m]."""
    passenger_z_m: float
    """Payload centre of mass in W, height [m]."""
    contact_force_share: float = math.nan
    """Ratio of summed normal contact forces to the weight, maximum over the physics steps since the last tick; NaN if unknown."""
    airborne_share: float = math.nan
    """Fraction of the physics steps since the last tick without any contact of the chair; NaN if unknown."""
    contact_residual_m_s2: float = math.nan
    """Residual of the contact forces (Signorini's condition) [m/s²], maximum over the physics steps since the last tick; NaN if
    unknown."""
    hull_contacts: float = 0.0
    """Number of contacts of hull, seat and passenger with stair, walls and obstacles: 0 in a regular run."""
    left_force_n: float = 0.0
    """Traction of the left belt [N], forward positive, mean over the last tick."""
    right_force_n: float = 0.0
    """Traction of the right belt [N], forward positive, mean over the last tick."""
    power_w: float = 0.0
    """Electric power drawn from the battery [W], internal battery loss included."""
    chassis_x_m: float = math.nan
    """Position of B in W [m], up the flight; NaN in logs that were written before the pose was kept."""
    chassis_y_m: float = math.nan
    """Position of B in W [m], left; NaN if unknown."""
    chassis_z_m: float = math.nan
    """Position of B in W [m], height; NaN if unknown."""


@runtime_checkable
class TruthPlant(Plant, Protocol):
    """Plant with ground truth: simulators only."""

    def truth(self) -> Sequence[Truth]:
        """Return all 100 Hz ground-truth samples since the last call, ``t_s = 0`` included."""


@runtime_checkable
class Transport(Protocol):
    """Channel-based transport of signals between nodes: calls in one process, ROS 1, or ROS 2."""

    def announce(self, channel: str) -> None:
        """Declare this node as a publisher of a channel."""

    def publish(self, channel: str, signal: Any) -> None:
        """Send a signal to all subscribers of the channel."""

    def subscribe(self, channel: str, take: Callable[[Any], object]) -> None:
        """Register ``take`` for a channel; the delivering thread calls ``take`` for one signal after the other."""

    def deliver(self, timeout_s: float) -> int:
        """Deliver pending signals, waiting at most ``timeout_s`` for the first; return the number delivered."""

    def close(self) -> None:
        """Disconnect from the transport."""
