"""Links of a chair as one: opened by name, polled in mission time and in the chair's signs, commanded in one call.

``DriveState -> TrackReading, PlantState``; the other readings pass with their stamps on the mission clock.
"""

import math
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, closing
from dataclasses import replace
from typing import Any

from treadline.core.errors import LinkError, TreadlineError
from treadline.core.files import own_module
from treadline.core.signals import FlipperCommand, PlantState, SeatCommand, TrackCommand, TrackReading
from treadline.hardware.ports import DriveLimits, DriveLink, DriveState, JointLink, SensorLink

REARM_S = 4.5
"""Longest time in which a box ends its latched stop [s]: drives on CAN prove their watchdog first, and take a state within
2 s; a base is measured in four parts of 1 s at most."""
PROTOCOLS = {"drives": DriveLink, "imu": SensorLink, "joints": JointLink, "handset": SensorLink}
"""Protocol of the link of each port."""


def open_links(requests: Mapping[str, Any], limits: DriveLimits) -> dict[str, Any]:
    """Return the links of a chair by port; those that are open are closed where another fails.

    Args:
        requests: Class and options of each link, as ``LinkTable.request`` gives them.
        limits: Limits for the box at the drives.

    Raises:
        LinkError: If a class does not exist or fits no port, or a device does not open.
    """
    links: dict[str, Any] = {}
    with ExitStack() as opened:
        for port, request in requests.items():
            more = {"limits": limits} if port == "drives" else {}
            shared = links.get(request["class"])
            links[port] = shared or opened.enter_context(closing(open_driver(port, request, **more)))
            wanted = [name for name in dir(PROTOCOLS[port]) if not name.startswith("_") and not hasattr(links[port], name)]
            if wanted:
                kind = type(links[port]).__name__
                raise LinkError(f"{port}: {kind} has no {', '.join(wanted)}(); see treadline.hardware.ports")
        opened.pop_all()
    return links


def open_driver(table: str, request: Mapping[str, Any], **more: Any) -> Any:
    """Return an object of a class that the robot file names.

    Args:
        table: Table of the robot file.
        request: Class as ``module:Class``, and options.
        more: Further options.

    Raises:
        LinkError: If the class does not exist or takes no such options, or the device does not open.
    """
    module, _, name = request["class"].partition(":")
    try:
        return getattr(own_module(module), name)(**request["options"], **more)
    except TreadlineError as error:
        raise LinkError(f"{table}: {error}") from error
    except TypeError as error:
        raise LinkError(f"{table}: {error}; correct the keys of [{table}] in the robot file") from error
    except ImportError as error:
        remedy = "pip install '.[hardware]' in treadline's folder, or correct the name in the robot file"
        raise LinkError(f"{table}: {request['class']} cannot be imported ({error}); {remedy}") from error
    except Exception as error:
        raise LinkError(f"{table}: {request['class']} cannot be opened: {type(error).__name__}: {error}") from error


class Links:
    """Open links, in mission time and in the chair's signs.

    Args:
        links: Links by port; ports may share one.
        signs: The keys of ``robot_file.SignsTable``.
    """

    def __init__(self, links: Mapping[str, Any], signs: Mapping[str, Any]) -> None:
        self._drives: DriveLink = links["drives"]
        self._joints: JointLink | None = links.get("joints")
        self._each = {id(link): (port, link) for port, link in reversed(list(links.items()))}
        self._swapped, self._signs = signs["swapped"], (signs["left"], signs["right"])
        self._stops, self._rearmed_s = True, -math.inf
        self.state: DriveState | None = None
        """Newest state of the drives, in the box's signs."""
        self.lost: str | None = None
        """Why a link was lost; None while all work."""

    def poll(self, start_s: float) -> Iterator[Any]:
        """Yield the readings since the last call, on a clock that is zero at ``start_s`` of the monotonic one; none from before."""
        for port, link in list(self._each.values()):
            for reading in self._guarded(port, link.poll) or ():
                t_s = reading.t_s - start_s
                if isinstance(reading, DriveState):
                    self.state = reading
                    yield from self._drive_signals(reading, t_s) if t_s >= 0.0 else ()
                elif t_s >= 0.0:
                    yield replace(reading, t_s=t_s)

    def command(self, tracks: TrackCommand, seat: SeatCommand, flipper: FlipperCommand | None, *, held: bool) -> None:
        """Pass the guard's commands on; the brake of a held chair latches the box."""
        if self._joints is not None:
            rate_rad_s = 0.0 if flipper is None else flipper.rate_rad_s
            self._guarded("joints", self._joints.move, seat.rate_m_s, rate_rad_s)
        if held and tracks.brake:
            self.stop()
        elif tracks.brake:
            self._guarded("drives", self._drives.hold)
        else:
            left, right = (sign * speed for sign, speed in zip(self._signs, (tracks.left_m_s, tracks.right_m_s), strict=True))
            self._guarded("drives", self._drives.send, *((right, left) if self._swapped else (left, right)))

    def stop(self) -> None:
        """Stop at once; the box stays latched until ``rearm``."""
        self._stops = True
        self._guarded("drives", self._drives.stop, is_last=True)

    @property
    def is_rearming(self) -> bool:
        """Whether the box was asked to end its latched stop and has not reported it: it takes no motion yet."""
        return time.monotonic() - self._rearmed_s < REARM_S

    def rearm(self) -> None:
        """End the latched stop of the box."""
        self._stops, self._rearmed_s = False, time.monotonic()
        self._guarded("drives", self._drives.rearm)

    def close(self) -> None:
        """Stop the drives and release all devices."""
        self.stop()
        for port, link in self._each.values():
            self._guarded(port, link.close, is_last=True)

    def _drive_signals(self, state: DriveState, t_s: float) -> Iterator[TrackReading | PlantState]:
        belts = (state.right_m_s, state.left_m_s) if self._swapped else (state.left_m_s, state.right_m_s)
        left, right = (sign * speed for sign, speed in zip(self._signs, belts, strict=True))
        yield TrackReading(t_s=t_s, left_m_s=left, right_m_s=right, brake_on=state.latched)
        if not state.latched:
            self._rearmed_s = -math.inf
        fault = None if self.is_rearming else state.error
        if fault is None and state.latched and not self._stops and not self.is_rearming:
            fault = "its watchdog had no valid command in time" if state.watchdog_tripped else "the box latched a stop"
        yield PlantState(t_s=t_s, fault=fault, battery_v=state.voltage_v)

    def _guarded(self, port: str, call: Callable[..., Any], *arguments: float, is_last: bool = False) -> Any:
        """Return the result of a call; a link that fails, by whatever error, is lost: it is still stopped and closed."""
        if not is_last and self.lost is not None and self.lost.startswith(f"{port}: "):
            return None
        try:
            return call(*arguments)
        except Exception as error:  # noqa: BLE001 - a driver of the user may raise anything
            cause = str(error) if isinstance(error, TreadlineError) else f"{type(error).__name__}: {error}"
            self.lost = self.lost or f"{port}: {' '.join(cause.split())}"
            return None
