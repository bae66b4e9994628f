"""Message decoders from message definitions: bytes of a topic to an object with fields.

mcap-ros2-support decodes CDR with ``ros2msg`` definitions, as written by ROS 2 into MCAP. rosbags (the extra ``ros``) decodes ROS 1
messages, IDL definitions, and bags without definitions.
"""

import re
from collections.abc import Callable
from contextlib import redirect_stderr
from io import StringIO
from typing import Any, NamedTuple

from mcap.records import Schema
from mcap_ros2.decoder import DecoderFactory

from treadline.core.errors import LogFormatError

MOST_ELEMENTS = 1 << 25
"""Longest decoded sequence; a damaged message can declare billions of elements."""
LONGEST_DEFINITION = 1 << 20
"""Longest accepted message definition [characters]; the longest standard definitions have about ten thousand."""


class RecordedTopic(NamedTuple):
    """Topic as declared in its file."""

    name: str
    encoding: str
    """Message encoding: cdr or ros1."""
    kind: str
    """Message type, for example sensor_msgs/msg/Imu."""
    language: str
    """Language of the definition: ros2msg, ros2idl, ros1msg, or empty."""
    definition: str


Packet = tuple[RecordedTopic, int, bytes]
"""Topic, log time [ns], message."""


def decoder_of(topic: RecordedTopic) -> Callable[[bytes], Any]:
    """Return the decoder of a topic's messages.

    Raises:
        LogFormatError: If the encoding is unknown, or rosbags is not installed.
    """
    # IDL allows computed constants: a shift in ten characters gives a number of a gigabyte.
    if len(topic.definition) > LONGEST_DEFINITION or "<<" in topic.definition:
        raise LogFormatError(f"{topic.name}: the definition of '{topic.kind[:80]}' is too long or computes; no message type does")
    if topic.encoding == "cdr" and topic.language == "ros2msg":
        schema = Schema(id=1, data=topic.definition.encode(), encoding="ros2msg", name=topic.kind)
        with redirect_stderr(StringIO()):  # the definition parser also prints its exceptions
            decode: Callable[[bytes], Any] | None = DecoderFactory().decoder_for("cdr", schema)
        if decode is not None:
            return decode
    if topic.encoding not in {"cdr", "ros1"} or topic.language not in {"ros1msg", "ros2idl", "omgidl", ""}:
        raise LogFormatError(f"{topic.name} is encoded in '{topic.encoding}' ({topic.language}); ROS 1 and ROS 2 messages are read")
    return _by_rosbags(topic)


def _by_rosbags(topic: RecordedTopic) -> Callable[[bytes], Any]:
    try:
        from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore
    except ImportError:
        raise needs_rosbags(f"{topic.name} ({topic.kind})") from None
    # rosbags generates source code from the type names, so only valid names may pass.
    if not re.fullmatch(r"[A-Za-z]\w*(/[A-Za-z]\w*){1,2}", topic.kind, re.ASCII):
        raise LogFormatError(f"{topic.name} has the type '{topic.kind[:80]}', which is not a valid name")
    package, *_, short = topic.kind.split("/")
    kind = f"{package}/msg/{short}"
    # Bags without definitions come from ROS 2 Humble or older; newer bags include the definitions.
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
    """Return the error for an input that only rosbags can read."""
    return LogFormatError(f"{what} needs rosbags: pip install '.[ros]' in treadline's folder")
