"""``sensor_msgs/PointCloud2``: header, field list and points."""

from typing import NamedTuple

import numpy as np

from treadline.core.errors import LogFormatError
from treadline.io.decode import CdrReader

POINT_CLOUD = "sensor_msgs/msg/PointCloud2"
"""Message type of point clouds."""
NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
"""Number types of ``sensor_msgs/PointField``."""
MOST_FIELDS = 64
"""Largest number of fields of a point; usual clouds have four to nine."""


class CloudMessage(NamedTuple):
    """Points of one message."""

    t_s: float
    frame_id: str
    width: int
    height: int
    """Number of rows; 1 for an unorganised cloud."""
    values: np.ndarray
    """Structured array with the fields of the message."""


def point_cloud(r: CdrReader) -> CloudMessage:
    """Return the points of a message.

    Raises:
        LogFormatError: If the declared sizes contradict each other.
    """
    t_s, frame_id = r.stamp()
    height, width, count = r.uint32(), r.uint32(), r.uint32()
    if count > MOST_FIELDS:
        raise LogFormatError(f"a cloud declares {count} fields; at most {MOST_FIELDS} are read")
    fields = [(r.string(), r.uint32(), r.uint8(), r.uint32()) for _ in range(count)]
    order = ">" if r.uint8() else "<"
    step, row_step = r.uint32(), r.uint32()
    data = r.take(r.uint32())
    usable = [(name, offset, NUMBERS[kind]) for name, offset, kind, number in fields if number == 1 and kind in NUMBERS]
    if any(offset + np.dtype(number).itemsize > step for _, offset, number in usable):
        raise LogFormatError(f"a field of the cloud ends beyond its point of {step} bytes")
    if row_step < width * step or len(data) != height * row_step:
        raise LogFormatError(f"a cloud of {width}×{height} points of {step} bytes holds {len(data)} bytes in rows of {row_step}")
    kind = np.dtype(
        {
            "names": [name for name, _, _ in usable],
            "formats": [order + number for _, _, number in usable],
            "offsets": [offset for _, offset, _ in usable],
            "itemsize": step,
        }
    )
    rows = np.frombuffer(data, np.uint8).reshape(height, row_step)[:, : width * step]
    values = np.ascontiguousarray(rows).reshape(-1).view(kind) if width * height else np.zeros(0, kind)
    return CloudMessage(t_s, frame_id, width, height, values)
