"""Messages between the mission and the guard process: one JSON object a datagram, on a pair of connected local sockets.

The sockets never block: a datagram that does not fit is lost, and its receiver detects the silence.
"""

import json
import socket
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from typing import Any

from treadline.core import signals
from treadline.guard import GuardConfig
from treadline.hardware.ports import DriveLimits, DriveState, StickReading

LARGEST = 1 << 16
"""Size of the receive buffer [bytes]; the readings of a tick have 2,000."""
TYPES: dict[str, type[Any]] = {kind.__name__: kind for kind in (DriveLimits, DriveState, GuardConfig, StickReading)}
TYPES |= {name: kind for name, kind in vars(signals).items() if isinstance(kind, type) and is_dataclass(kind)}
"""Types that cross the boundary, by name: every signal, and what only a real chair has."""
FIELDS = {kind: tuple(item.name for item in fields(kind)) for kind in TYPES.values()}


def send(channel: socket.socket, message: Mapping[str, Any]) -> None:
    """Send a message, or lose it: where the receiver does not read, or has ended."""
    try:
        channel.send(json.dumps(message, default=_table).encode(), socket.MSG_DONTWAIT | socket.MSG_NOSIGNAL)
    except OSError:
        return


def received(channel: socket.socket) -> Iterator[dict[str, Any]]:
    """Yield the messages that have arrived.

    Raises:
        EOFError: If the other process has ended.
    """
    while True:
        try:
            data = channel.recv(LARGEST, socket.MSG_DONTWAIT)
        except BlockingIOError:
            return
        except OSError as error:
            raise EOFError from error
        if not data:
            raise EOFError
        yield json.loads(data, object_hook=_value)


def _table(value: Any) -> dict[str, Any]:
    return {"": type(value).__name__, **{name: getattr(value, name) for name in FIELDS[type(value)]}}


def _value(table: dict[str, Any]) -> Any:
    kind = table.pop("", None)
    return table if kind is None else TYPES[kind](**table)
