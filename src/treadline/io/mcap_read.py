"""Messages of any MCAP file, and the signals of a run's own log. The file is not trusted: sizes and counts have caps.

Checksums are compared wherever the writer left one. A run's log has them everywhere, so there a chunk without one is refused
as well (``sealed``): anything wrong with it is one ``LogFormatError``, and what was yielded before it had passed its checksum.
"""

import dataclasses
import mmap
import struct
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO, Any, cast

import lz4.frame
import zstandard
from mcap.exceptions import McapError
from mcap.records import Channel, Chunk, DataEnd, Header, McapRecord, Message, Schema
from mcap.stream_reader import StreamReader, breakup_chunk

from treadline.errors import LogFormatError
from treadline.io.decode import Decoder
from treadline.io.ros_types import Packet, Topic

MAX_FILE_BYTES = 8 * 1024**3
"""Of a run's log; others are read record by record, however long."""
MAX_CHUNK_BYTES = 256 * 1024**2
"""Decompressed; our writer closes a chunk at 4 MB."""
MAX_MESSAGES = 50_000_000
"""Some twelve hours of driving."""
LIBRARY = "treadline"
"""Name of the writer in the header of our own logs."""
_PIECE = 1 << 20

# What the parser of a broken file may stumble over: lengths, opcodes, text, numbers beyond their range.
BROKEN = (
    McapError,
    zstandard.ZstdError,
    struct.error,
    ValueError,
    IndexError,
    KeyError,
    EOFError,
    OverflowError,
    MemoryError,
)


def read_log(path: Path, wants: Callable[[str], bool] = lambda _: True) -> Iterator[Any]:
    """Yield the signals, events and truth of a run's log in the order they were written, of the topics wanted.

    Raises:
        LogFormatError: If the file is missing, too large, damaged or not a log of treadline.
    """
    decoder = Decoder()
    try:
        for topic, _, data in mcap_messages(path, wants, sealed=True):
            signal = decoder.signal(topic.name, data)
            if signal is not None:
                yield signal
    except LogFormatError as error:
        raise LogFormatError(f"{path}: {error}") from None
    except OSError as error:
        raise LogFormatError(f"{path}: {error.strerror or error}") from None
    except BROKEN as error:
        raise LogFormatError(f"{path}: not a whole MCAP file: {error}; was it cut short or changed?") from None


def has_arrivals(path: Path) -> bool:
    """Return whether the log times of a file are mission times of arrival, as in every log that treadline writes."""
    if path.suffix.lower() != ".mcap" or not path.is_file():
        return False
    with path.open("rb") as file:
        try:
            header = next(iter(StreamReader(file, record_size_limit=MAX_CHUNK_BYTES).records), None)
        except BROKEN:
            return False  # the survey of the log reports the damage
    return isinstance(header, Header) and header.library == LIBRARY


def mcap_messages(path: Path, wants: Callable[[str], bool], *, sealed: bool = False) -> Iterator[Packet]:
    """Yield the messages of the topics wanted, in the order of the file.

    Args:
        sealed: Whether every message must stand in a chunk with a checksum, as in what treadline writes.
    """
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
        if sealed and len(data) > MAX_FILE_BYTES:
            raise LogFormatError(f"{len(data)} bytes; at most {MAX_FILE_BYTES} are read")
        schemas: dict[int, Schema] = {}
        topics: dict[int, Topic | None] = {}
        count = 0
        for record in _unpacked(data, sealed=sealed):
            if isinstance(record, Schema):
                schemas[record.id] = record
            elif isinstance(record, Channel):
                topics[record.id] = _topic(record, schemas) if wants(record.topic) else None
            elif isinstance(record, Message) and (topic := topics[record.channel_id]) is not None:
                count += 1
                if count > MAX_MESSAGES:
                    raise LogFormatError(f"more than {MAX_MESSAGES} messages")
                yield topic, record.log_time, record.data


def _topic(channel: Channel, schemas: dict[int, Schema]) -> Topic:
    schema = schemas.get(channel.schema_id)
    return Topic(
        name=channel.topic,
        encoding=channel.message_encoding,
        kind="" if schema is None else schema.name,
        language="" if schema is None else schema.encoding,
        definition="" if schema is None else schema.data.decode(),
    )


def _unpacked(data: mmap.mmap, *, sealed: bool) -> Iterator[McapRecord]:
    # The map's read() stops at the end by itself; what it has is read record by record, however long the file.
    reader = StreamReader(cast("IO[bytes]", data), validate_crcs=True, emit_chunks=True, record_size_limit=MAX_CHUNK_BYTES)
    for record in reader.records:
        if isinstance(record, Chunk):
            if sealed and (record.compression != "zstd" or record.uncompressed_crc == 0):
                raise LogFormatError(f"a chunk is compressed by '{record.compression}' or has no checksum; zstd and one are needed")
            yield from breakup_chunk(dataclasses.replace(record, data=_inflated(record), compression=""), validate_crc=True)
        elif not sealed:
            yield record
        elif isinstance(record, Message):
            raise LogFormatError("a message outside a chunk has no checksum")
        elif isinstance(record, DataEnd) and record.data_section_crc == 0:
            raise LogFormatError("the data has no checksum")


def _inflated(chunk: Chunk) -> bytes:
    """Return what a chunk holds; never more than it announces."""
    size = chunk.uncompressed_size
    if size > MAX_CHUNK_BYTES:
        raise LogFormatError(f"a chunk unpacks to {size} bytes; at most {MAX_CHUNK_BYTES} are read")
    if chunk.compression not in _INFLATE:
        raise LogFormatError(f"a chunk is compressed by '{chunk.compression}'; zstd and lz4 are read: mcap compress makes it so")
    data = _INFLATE[chunk.compression](chunk.data, size + 1)
    if len(data) != size:
        raise LogFormatError(f"a chunk does not unpack to the {size} bytes that it announces")
    return data


def inflate_zstd(data: bytes, most: int) -> bytes:
    """Return what a frame holds, at most so many bytes."""
    stream = zstandard.ZstdDecompressor().stream_reader(data)
    return _gathered(lambda: stream.read(_PIECE), most)


def inflate_lz4(data: bytes, most: int) -> bytes:
    """Return what a frame holds, at most so many bytes."""
    frame = lz4.frame.LZ4FrameDecompressor()
    rest = iter((data,))
    return _gathered(lambda: b"" if frame.eof else frame.decompress(next(rest, b""), max_length=_PIECE), most)


def _gathered(piece: Callable[[], bytes], most: int) -> bytes:
    """Join pieces until they end: a size that is announced is no reason to allocate it."""
    plain = bytearray()
    while len(plain) < most and (more := piece()):
        plain += more
    return bytes(memoryview(plain)[:most])


_INFLATE: dict[str, Callable[[bytes, int], bytes]] = {"": lambda data, _: data, "zstd": inflate_zstd, "lz4": inflate_lz4}
