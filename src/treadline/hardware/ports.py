"""Ports of a real chair: drives, inertial sensor, seat and flipper, handset. A driver of another chair implements one of them.

All calls return at once: they never wait for a device. Even a non-blocking read of a terminal may wait, so the reader and the
writer of a driver run in ``device_threads.DeviceThreads``. Stamps are ``time.monotonic()`` of the host at the arrival of a message
[s]; the host converts them to mission time. A link raises ``LinkError`` from its constructor or from ``poll`` with the true cause
in one line, and from no other call.

A class is named in the robot file as ``module:Class`` and is called with the other keys of its table as keyword arguments, a link
to drives also with ``limits``. Where one device carries several ports, its class implements their protocols, and the other tables
say ``link = "drives"``; ``poll`` then returns the readings of all.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from treadline.core.signals import FlipperReading, ImuSample, OperatorInput, SeatReading

HOLD_M_S2 = 1.0
"""Largest deceleration of a hold that is not urgent [m/s²]: that of the guard's ramped stop from 0.2 m/s
(``guard._half_cosine_stop``)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveLimits:
    """Limits that a link hands to the box at the drives when it opens; the box enforces them whatever the host sends."""

    speed_m_s: float
    """Largest speed of one belt [m/s], positive."""
    acceleration_m_s2: float
    """Largest change of a commanded belt speed [m/s²], positive; a hold ramps down with ``HOLD_M_S2`` at most."""
    watchdog_s: float
    """Time without a valid command after which the box stops and latches [s], positive and at most 0.1 s."""
    seat_m_s: float = 0.0
    """Largest rate of the seat's stroke [m/s]; 0 for a chair without a seat actuator at the box."""
    flipper_rad_s: float = 0.0
    """Largest rate of the flipper [rad/s]; 0 for a chair without a flipper at the box."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveState:
    """State of the drives, from one message of the box. Positive speeds drive the chair forward, up the stair."""

    t_s: float
    """Host's monotonic time at arrival [s]."""
    box_s: float | None
    """The box's own clock when it sampled the state [s]; None if it has no clock."""
    left_m_s: float
    """Measured speed of the left belt [m/s]."""
    right_m_s: float
    """Measured speed of the right belt [m/s]."""
    watchdog_tripped: bool
    """Whether the latched stop was caused by missing or broken commands."""
    latched: bool
    """Whether the box stands until ``rearm``: after its start, a ``stop``, the watchdog, or an error."""
    error: str | None
    """Error as the box names it, in one line; None without one."""
    voltage_v: float | None
    """Battery voltage [V]; None if it is not measured."""
    note: str | None = None
    """What the link measured of the drives, for the person; None before."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StickReading:
    """Deflection of a handset's stick, as shares of the largest speed from -1 to 1; used on the bench alone."""

    t_s: float
    speed: float
    """Forward share."""
    turn: float
    """Share of the turn, positive to the left."""


BoxReading = DriveState | ImuSample | SeatReading | FlipperReading | OperatorInput | StickReading
"""Readings of a link. Their ``t_s`` is the host's monotonic time at arrival."""


@runtime_checkable
class SensorLink(Protocol):
    """Link that is only read: an inertial sensor (``ImuSample``, in the chair frame B) or a handset (``OperatorInput``, 10 Hz)."""

    def poll(self) -> Sequence[BoxReading]:
        """Return the readings since the last call, oldest first; none if nothing arrived.

        Raises:
            LinkError: If the device has gone.
        """

    def close(self) -> None:
        """Release the device; a link to drives or joints stops them first. May be called twice."""


@runtime_checkable
class DriveLink(SensorLink, Protocol):
    """Link to the belts' drives: ``DriveState`` at 50 Hz or more.

    The drives stand, latched, until the first ``rearm``. They stop by themselves without a command for ``DriveLimits.watchdog_s``.
    """

    def send(self, left_m_s: float, right_m_s: float) -> None:
        """Set the belt speeds [m/s]; repeated at 50 Hz or more. A latched box ignores it."""

    def hold(self) -> None:
        """Ramp to zero and stand braked; not latched: the next ``send`` drives. Repeated at 50 Hz or more, as ``send``."""

    def stop(self) -> None:
        """Stop at once, latched until ``rearm``."""

    def rearm(self) -> None:
        """End a latched stop, at a person's request alone; the belts stand until the next ``send``."""


@runtime_checkable
class JointLink(SensorLink, Protocol):
    """Link to the actuators of seat and flipper: ``SeatReading`` and ``FlipperReading`` at 50 Hz or more."""

    def move(self, seat_m_s: float, flipper_rad_s: float) -> None:
        """Set the rates of seat stroke [m/s] and flipper [rad/s], of which the device has those it has; valid for 0.1 s."""
