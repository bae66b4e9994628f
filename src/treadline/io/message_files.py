"""Files of messages: MCAP, ``.bag`` of ROS 1, read by rosbags, and ``.db3`` of ROS 2, an SQLite file; and folders of them.

Messages are decoded by their definitions to objects with fields, by the code that rosbags generates from a definition.

The files are not trusted: no read beyond the end of the file, and the size limit of MCAP chunks for decompression.
"""

import bz2
import mmap
import re
import sqlite3
from collections.abc import Callable, Iterator
from contextlib import closing
from functools import lru_cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import zstandard

from treadline.core.errors import LogFormatError
from treadline.io import mcap_read
from treadline.io.mcap_read import Packet, RecordedTopic, inflate_lz4, inflate_zstd, mcap_messages

_ZSTD = b"\x28\xb5\x2f\xfd"


def _db3_messages(path: Path, wants: Callable[[str], bool]) -> Iterator[Packet]:
    """Yield the messages of the requested topics of a ROS 2 SQLite file, in order of time."""
    with path.open("rb") as file:
        magic = file.read(16)
    if magic != b"SQLite format 3\0":
        raise LogFormatError("not an SQLite file; was it cut short or compressed (unpack it: zstd -d)?")
    with closing(sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro&immutable=1", uri=True)) as base:
        base.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, mcap_read.MAX_CHUNK_BYTES)
        base.execute("PRAGMA trusted_schema = OFF")
        tables = {name for (name,) in base.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
        if not {"topics", "messages"} <= tables:
            raise LogFormatError("an SQLite file, but no ROS 2 bag: it has no topics and messages")
        definitions: dict[str, tuple[str, str]] = {}
        if "message_definitions" in tables:
            query = "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions"
            definitions = {kind: (language, text) for kind, language, text in base.execute(query)}
        topics = {}
        for key, name, kind, encoding in base.execute("SELECT id, name, type, serialization_format FROM topics"):
            language, text = definitions.get(kind, ("", ""))
            if wants(name):
                topics[key] = RecordedTopic(
                    name=name, encoding=encoding, kind=kind, language=language if text else "", definition=text
                )
        marks = ",".join("?" * len(topics))
        query = f"SELECT topic_id, timestamp, data FROM messages WHERE topic_id IN ({marks}) ORDER BY timestamp"  # noqa: S608 - marks
        for key, time_ns, data in base.execute(query, list(topics)):
            yield topics[key], time_ns, _plain(data)


def _plain(data: bytes) -> bytes:
    """Return a message, decompressed if rosbag2 compressed it individually."""
    if not data.startswith(_ZSTD):
        return data
    size = zstandard.get_frame_parameters(data).content_size
    if not 0 < size <= mcap_read.MAX_CHUNK_BYTES:
        raise LogFormatError(f"a message unpacks to {size} bytes; at most {mcap_read.MAX_CHUNK_BYTES} are read")
    return inflate_zstd(data, size)


def _bag_messages(path: Path, wants: Callable[[str], bool]) -> Iterator[Packet]:
    """Yield the messages of the requested topics of a ROS 1 bag, in order of time."""
    from rosbags.rosbag1 import Reader

    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
        # In place of a path: the map limits every read to the file size, whatever a damaged header declares.
        reader = Reader(cast("Any", SimpleNamespace(exists=lambda: True, open=lambda _mode: data)))
        with reader:
            reader.chunks = {at: chunk._replace(decompressor=_capped(chunk.decompressor)) for at, chunk in reader.chunks.items()}
            topics = {
                item.id: RecordedTopic(item.topic, "ros1", item.msgtype, "ros1msg", item.msgdef.data)
                for item in reader.connections
                if wants(item.topic)
            }
            wanted = [item for item in reader.connections if item.id in topics]
            for connection, time_ns, message in reader.messages(wanted) if wanted else ():
                yield topics[connection.id], time_ns, message


def _capped(decompress: Callable[[bytes], bytes]) -> Callable[[bytes], bytes]:
    """Return a decompressor with a size limit: a kilobyte can declare a terabyte."""
    from rosbags.rosbag1.reader import decompressors

    most = mcap_read.MAX_CHUNK_BYTES

    def capped(data: bytes) -> bytes:
        if decompress is decompressors["bz2"]:
            plain = bz2.BZ2Decompressor().decompress(data, most + 1)
        elif decompress is decompressors["lz4"]:
            plain = inflate_lz4(data, most + 1)
        else:
            return data
        if len(plain) > most:
            raise LogFormatError(f"a chunk unpacks to more than {most} bytes")
        return plain

    return capped


READERS: dict[str, Callable[[Path, Callable[[str], bool]], Iterator[Packet]]] = {
    ".mcap": mcap_messages,
    ".bag": _bag_messages,
    ".db3": _db3_messages,
}
"""Reader of a file of messages, by its ending."""


def parts_of(path: Path) -> list[Path]:
    """Return the files of a log in their order: itself, or those of a bag's folder."""
    return [path] if path.is_file() else sorted((p for p in path.iterdir() if p.suffix in READERS), key=_number)


def _number(path: Path) -> tuple[int, str]:
    """Order the parts of a bag: run_2 before run_10."""
    digits = path.stem.rpartition("_")[2]
    return int(digits) if digits.isascii() and digits.isdigit() else 0, path.name


@lru_cache
def decoder_of(topic: RecordedTopic) -> Callable[[bytes], Any]:
    """Return the decoder of a topic's messages.

    Raises:
        LogFormatError: If the encoding is unknown, or the definition cannot be used.
    """
    # The longest standard definitions have ten thousand characters. IDL allows computed constants: a shift in ten characters gives
    # a number of a gigabyte.
    if len(topic.definition) > 1 << 20 or "<<" in topic.definition:
        raise LogFormatError(f"{topic.name}: the definition of '{topic.kind[:80]}' is too long or computes; no message type does")
    if topic.encoding not in {"cdr", "ros1"} or topic.language not in {"ros2msg", "ros1msg", "ros2idl", "omgidl", ""}:
        raise LogFormatError(f"{topic.name} is encoded in '{topic.encoding}' ({topic.language}); ROS 1 and ROS 2 messages are read")
    # rosbags generates source code from the type names, so only valid names may pass.
    if not re.fullmatch(r"[A-Za-z]\w*(/[A-Za-z]\w*){1,2}", topic.kind, re.ASCII):
        raise LogFormatError(f"{topic.name} has the type '{topic.kind[:80]}', which is not a valid name")
    package, *_, short = topic.kind.split("/")
    kind = f"{package}/msg/{short}"
    # Bags without definitions come from ROS 2 Humble or older; newer bags include the definitions.
    from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

    store = get_typestore(Stores.EMPTY if topic.definition else Stores.ROS2_HUMBLE)
    store.max_sequence_length = 1 << 25  # a damaged message can declare billions of elements
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
