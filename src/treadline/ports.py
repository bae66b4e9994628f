"""What the mission needs of a chair, real or simulated, and what only a simulator can tell.

``Plant`` is all the mission ever sees. ``Truth`` comes from a ``TruthPlant`` and is for scoring: experiments read it,
the mission cannot. ``Transport`` is what carries signals where the blocks run apart.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

from treadline.signals import FlipperCommand, Reading, SeatCommand, TrackCommand


@runtime_checkable
class Plant(Protocol):
    """A chair on its tracks: MuJoCo, Gazebo, a recorded log or hardware."""

    def start(self) -> None:
        """Put the chair at its start, at ``t_s = 0``, belts at rest."""

    def advance(self, until_s: float) -> None:
        """Step the simulation, or wait, until the mission clock shows ``until_s``."""

    def read(self) -> Sequence[Reading]:
        """Return every sample that arrived since the last call, each kind in the order of its stamps; a camera's arrive late."""

    def write(self, tracks: TrackCommand, seat: SeatCommand, flipper: FlipperCommand | None = None) -> None:
        """Send commands, which hold until the next call. ``flipper=None`` stops the flipper; a chair without one ignores it."""

    def close(self) -> None:
        """Release what the plant holds."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Truth:
    """The state of a simulated chair at one instant."""

    t_s: float
    heading_rad: float
    """In the nosing plane, positive anticlockwise from above."""
    yaw_rad: float
    """About gravity."""
    heading_rate_rad_s: float
    """Angular velocity along the nosing plane's normal."""
    pitch_rad: float
    """Of the chassis against the level, front up positive."""
    roll_rad: float
    """Of the chassis against the level, left side up positive."""
    pitch_rate_rad_s: float
    x_m: float
    """Position of B along the stair (S), up the flight; where flights turn, S is that of the flight that the chair is on."""
    y_m: float
    """Position of B across the stair (S), left."""
    seat_pitch_rad: float
    left_m_s: float
    """Belt speed as run, actuator lag and mismatch included."""
    right_m_s: float
    stability_margin_rad: float
    """Smallest static tip-over margin at this attitude, on the nosings and floors in reach of the belts and of the front tip."""
    friction_use: float
    """Share of the friction circle needed to hold this heading on this slope; 1 slides."""
    passenger_x_m: float
    """Payload centre of mass in W, horizontal, up the flight."""
    passenger_y_m: float
    """Payload centre of mass in W, horizontal, across the flight."""
    passenger_z_m: float
    """Payload centre of mass in W, height."""
    contact_force_share: float = math.nan
    """Sum of the normal contact forces over the weight, largest of the steps since the last tick; NaN where unknown."""
    airborne_share: float = math.nan
    """Share of the steps since the last tick in which nothing touches the chair; NaN where unknown."""
    contact_residual_m_s2: float = math.nan
    """Residual of the contact forces (Signorini's condition), largest of the steps since the last tick; NaN where unknown."""
    hull_contacts: float = 0.0
    """Contacts of hull, seat and passenger with stair, walls and obstacles: 0 in a regular run."""
    left_force_n: float = 0.0
    """Traction of the belt, forward positive, mean over the last tick."""
    right_force_n: float = 0.0
    power_w: float = 0.0
    """Electric power drawn from the battery, its own loss included."""


@runtime_checkable
class TruthPlant(Plant, Protocol):
    """A plant that also knows the truth: simulators only."""

    def truth(self) -> Sequence[Truth]:
        """Return every 100 Hz truth sample since the last call, ``t_s = 0`` included."""


@runtime_checkable
class Transport(Protocol):
    """What carries signals between nodes, by channel: calls in one process, ROS 1, or ROS 2's wire."""

    def announce(self, channel: str) -> None:
        """Make known that this node will speak on a channel."""

    def publish(self, channel: str, signal: Any) -> None:
        """Send a signal to all who take from the channel."""

    def subscribe(self, channel: str, take: Callable[[Any], object]) -> None:
        """Have a channel's signals taken; ``take`` runs in the thread that delivers, one signal after the other."""

    def deliver(self, timeout_s: float) -> int:
        """Hand out what has come, waiting for something at most that long; return how many signals."""

    def close(self) -> None:
        """Leave."""
