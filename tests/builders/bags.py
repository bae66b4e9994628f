"""Bags of numbers, one topic a channel."""

import struct
from pathlib import Path

from mcap.writer import CompressionType, Writer

SECOND = 1_000_000_000
FLOAT = "float64 data"
STAMPED = "\n".join(
    [
        "std_msgs/Header header",
        "float64 data",
        "string note",
        "=" * 80,
        "MSG: std_msgs/Header",
        "builtin_interfaces/Time stamp",
        "string frame_id",
        "=" * 80,
        "MSG: builtin_interfaces/Time",
        "int32 sec",
        "uint32 nanosec",
    ]
)
Channel = list[tuple[float, float]]
"""Time in seconds and value of each message."""


def cdr(value: float, stamp_s: float | None) -> bytes:
    header, note = b"", b""
    if stamp_s is not None:
        header = struct.pack("<iII2s2x", *divmod(round(stamp_s * SECOND), SECOND), 2, b"a")
        note = struct.pack("<I2s", 2, b"x")
    return b"\x00\x01\x00\x00" + header + struct.pack("<d", value) + note


def bag(path: Path, *, stamps: dict[str, list[float]] | None = None, **channels: Channel) -> Path:
    """Write one topic per channel; those in ``stamps`` carry a header."""
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.ZSTD, enable_data_crcs=True)
        writer.start()
        for name, channel in channels.items():
            headers = (stamps or {}).get(name)
            schema = writer.register_schema(f"test_msgs/msg/{name.title()}", "ros2msg", (STAMPED if headers else FLOAT).encode())
            key = writer.register_channel(f"/{name}", "cdr", schema)
            for k, (t_s, value) in enumerate(channel):
                writer.add_message(key, round(t_s * SECOND), cdr(value, headers[k] if headers else None), 0)
        writer.finish()
    return path


def one_topic(path: Path, *, kind: str, language: str, definition: str, encoding: str = "cdr") -> Path:
    """Write one topic, /y, with the numbers from 0 to 8, one a second."""
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        key = writer.register_channel("/y", encoding, writer.register_schema(kind, language, definition.encode()))
        for k in range(9):
            writer.add_message(key, k * SECOND, cdr(float(k), None), 0)
        writer.finish()
    return path
