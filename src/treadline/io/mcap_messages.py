"""Messages of any MCAP file, chunked or not, compressed or not; checksums are compared wherever the writer left one.

``mcap_read`` is stricter, for it reads only what treadline wrote; the caps are the same.
"""

import dataclasses
import mmap
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO, cast

import lz4.frame
import zstandard
from mcap.records import Channel, Chunk, McapRecord, Message, Schema
from mcap.stream_reader import StreamReader, breakup_chunk

from treadline.errors import LogFormatError
from treadline.io import mcap_read
from treadline.io.ros_types import Packet, Topic

_PIECE = 1 << 20


def mcap_messages(path: Path, wants: Callable[[str], bool]) -> Iterator[Packet]:
    """Yield the messages of the topics wanted, in the order of the file."""
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
        schemas: dict[int, Schema] = {}
        topics: dict[int, Topic | None] = {}
        for record in _unpacked(data):
            if isinstance(record, Schema):
                schemas[record.id] = record
            elif isinstance(record, Channel):
                topics[record.id] = _topic(record, schemas) if wants(record.topic) else None
            elif isinstance(record, Message) and (topic := topics[record.channel_id]) is not None:
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


def _unpacked(data: mmap.mmap) -> Iterator[McapRecord]:
    # The map's read() stops at the end by itself; what it has is read record by record, however long the file.
    most = mcap_read.MAX_CHUNK_BYTES
    reader = StreamReader(cast("IO[bytes]", data), validate_crcs=True, emit_chunks=True, record_size_limit=most)
    for record in reader.records:
        if isinstance(record, Chunk):
            yield from breakup_chunk(dataclasses.replace(record, data=_inflated(record), compression=""), validate_crc=True)
        else:
            yield record


def _inflated(chunk: Chunk) -> bytes:
    """Return what a chunk holds; never more than it announces."""
    size = chunk.uncompressed_size
    if size > mcap_read.MAX_CHUNK_BYTES:
        raise LogFormatError(f"a chunk unpacks to {size} bytes; at most {mcap_read.MAX_CHUNK_BYTES} are read")
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
    return bytes(plain[:most])


_INFLATE: dict[str, Callable[[bytes, int], bytes]] = {"": lambda data, _: data, "zstd": inflate_zstd, "lz4": inflate_lz4}
