"""Messages by their definition: what turns the bytes of a topic into an object with fields.

CDR with ``ros2msg`` definitions, as ROS 2 writes into MCAP, is decoded by mcap-ros2-support. ROS 1, IDL definitions, and bags that
hold no definition at all are rosbags' matter (the extra ``ros``).
"""

import re
from collections.abc import Callable
from contextlib import redirect_stderr
from io import StringIO
from typing import Any, NamedTuple

from mcap.records import Schema
from mcap_ros2.decoder import DecoderFactory

from treadline.errors import LogFormatError

MOST_ELEMENTS = 1 << 25
"""Longest sequence that is decoded: a broken message announces billions."""
LONGEST_DEFINITION = 1 << 20
"""Characters; the longest of the standard ones have some ten thousand."""


class Topic(NamedTuple):
    """A topic as its file declares it."""

    name: str
    encoding: str
    """cdr or ros1."""
    kind: str
    """The message type, as sensor_msgs/msg/Imu."""
    language: str
    """What the definition is written in: ros2msg, ros2idl, ros1msg, or nothing."""
    definition: str


Packet = tuple[Topic, int, bytes]
"""Topic, log time in nanoseconds, message."""


def decoder_of(topic: Topic) -> Callable[[bytes], Any]:
    """Return what decodes the messages of a topic.

    Raises:
        LogFormatError: If its encoding is unknown, or rosbags is missing.
    """
    # IDL knows constants that are computed: a shift writes a gigabyte in ten characters.
    if len(topic.definition) > LONGEST_DEFINITION or "<<" in topic.definition:
        raise LogFormatError(f"{topic.name}: the definition of '{topic.kind[:80]}' is too long or computes; no message type does")
    if topic.encoding == "cdr" and topic.language == "ros2msg":
        schema = Schema(id=1, data=topic.definition.encode(), encoding="ros2msg", name=topic.kind)
        with redirect_stderr(StringIO()):  # the parser of definitions also prints what it raises
            decode: Callable[[bytes], Any] | None = DecoderFactory().decoder_for("cdr", schema)
        if decode is not None:
            return decode
    if topic.encoding not in {"cdr", "ros1"} or topic.language not in {"ros1msg", "ros2idl", "omgidl", ""}:
        raise LogFormatError(f"{topic.name} is encoded in '{topic.encoding}' ({topic.language}); ROS 1 and ROS 2 messages are read")
    return _by_rosbags(topic)


def _by_rosbags(topic: Topic) -> Callable[[bytes], Any]:
    try:
        from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore
    except ImportError:
        raise needs_rosbags(f"{topic.name} ({topic.kind})") from None
    # rosbags makes classes of the names: nothing but names may pass.
    if not re.fullmatch(r"[A-Za-z]\w*(/[A-Za-z]\w*){1,2}", topic.kind, re.ASCII):
        raise LogFormatError(f"{topic.name} has the type '{topic.kind[:80]}', which is no name")
    package, *_, short = topic.kind.split("/")
    kind = f"{package}/msg/{short}"
    # Bags without definitions come from ROS 2 Humble or older; each other topic brings its own.
    store = get_typestore(Stores.EMPTY if topic.definition else Stores.ROS2_HUMBLE)
    store.max_sequence_length = MOST_ELEMENTS
    if topic.definition:
        store.register(
            get_types_from_idl(topic.definition) if "idl" in topic.language else get_types_from_msg(topic.definition, kind)
        )
    if kind not in store.types:
        raise LogFormatError(
            f"{topic.name}: the type '{topic.kind}' is not defined in the bag; convert it: ros2 bag convert to MCAP"
        )
    if topic.encoding == "ros1":
        return lambda data: store.deserialize_ros1(data, kind)
    return lambda data: store.deserialize_cdr(data, kind)


def needs_rosbags(what: object) -> LogFormatError:
    """Return the error for what only rosbags reads."""
    return LogFormatError(f"{what} needs rosbags: pip install '.[ros]' in treadline's folder")
