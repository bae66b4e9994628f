"""Writer of an MCAP file: Zstandard chunks with indexes, statistics and checksums.

The writer of the library ``mcap`` makes the same bytes, with ten calls and an object for each message; this one appends a tuple.
"""

import struct
import zlib
from collections.abc import Iterable, Mapping
from typing import BinaryIO

import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)
from mcap.writer import MCAP0_MAGIC

CHUNK_BYTES = 4 * 1024 * 1024
"""Size at which a chunk is complete [bytes]."""
_OPCODE = int(Opcode.MESSAGE)  # an enumeration takes a microsecond to pack
_MESSAGE = struct.Struct("<BQHIQQ")
"""Head of a message: opcode, length of what follows, channel, sequence number, log time, publish time."""
_INDEX = struct.Struct("<BQHI")
"""Head of a message index: opcode, length of what follows, channel, length of the entries."""
_FOOTER = struct.Struct("<BQQQ")
"""Part of the footer that its checksum covers: opcode, length, begin of the summary and of the summary's offsets."""


class McapWriter:
    """Writer of messages into one file. Interrupts must wait for the end of each method.

    Args:
        stream: File to write.
        library: Name of the program in the file's header.
    """

    def __init__(self, stream: BinaryIO, library: str) -> None:
        self._stream = stream
        self._crc = 0
        self._schemas: dict[str, Schema] = {}
        self._channels: list[Channel] = []
        self._counts: dict[int, int] = {}
        self._metadata: list[MetadataIndex] = []
        self._chunks: list[ChunkIndex] = []
        self._pending: list[tuple[int, int, bytes]] = []
        """Records of the chunk in progress: channel, 0 for a declaration, log time [ns], bytes."""
        self._size = 0
        self._put(MCAP0_MAGIC + _bytes([Header(profile="ros2", library=library)]))

    def add_metadata(self, name: str, entries: Mapping[str, str]) -> None:
        """Write a metadata record."""
        record = _bytes([Metadata(name=name, metadata=dict(entries))])
        self._metadata.append(MetadataIndex(offset=self._stream.tell(), length=len(record), name=name))
        self._put(record)

    def add_channel(self, topic: str, kind: str, definition: str, metadata: Mapping[str, str]) -> int:
        """Declare a topic, and its message type if that is new; return the channel's number, which is 1 or greater."""
        if kind not in self._schemas:
            self._schemas[kind] = Schema(id=len(self._schemas) + 1, data=definition.encode(), encoding="ros2msg", name=kind)
            self._append(0, 0, _bytes([self._schemas[kind]]))
        number, schema = len(self._channels) + 1, self._schemas[kind].id
        self._channels.append(Channel(id=number, topic=topic, message_encoding="cdr", schema_id=schema, metadata=dict(metadata)))
        self._counts[number] = 0
        self._append(0, 0, _bytes(self._channels[-1:]))
        return number

    def add_message(self, channel: int, taken_ns: int, stamp_ns: int, data: bytes) -> None:
        """Write one message."""
        head = _MESSAGE.pack(_OPCODE, _MESSAGE.size - 9 + len(data), channel, self._counts[channel], taken_ns, stamp_ns)
        self._counts[channel] += 1
        self._append(channel, taken_ns, head + data)

    def finish(self) -> None:
        """Write the last chunk, the summary and the footer."""
        self._end_chunk()
        self._put(_bytes([DataEnd(self._crc)]))
        summary_start, summary, offsets = self._stream.tell(), b"", []
        groups: tuple[tuple[Opcode, Iterable[McapRecord]], ...] = (
            (Opcode.SCHEMA, self._schemas.values()),
            (Opcode.CHANNEL, self._channels),
            (Opcode.STATISTICS, [self._statistics()]),
            (Opcode.CHUNK_INDEX, self._chunks),
            (Opcode.ATTACHMENT_INDEX, ()),
            (Opcode.METADATA_INDEX, self._metadata),
        )
        for opcode, records in groups:
            data = _bytes(records)
            start = summary_start + len(summary)
            offsets.append(SummaryOffset(group_opcode=opcode, group_start=start, group_length=len(data)))
            summary += data
        offset_start = summary_start + len(summary)
        summary += _bytes(offsets)
        crc = zlib.crc32(_FOOTER.pack(Opcode.FOOTER, 20, summary_start, offset_start), zlib.crc32(summary))
        footer = Footer(summary_start=summary_start, summary_offset_start=offset_start, summary_crc=crc)
        self._put(summary + _bytes([footer]) + MCAP0_MAGIC)

    def _append(self, channel: int, taken_ns: int, record: bytes) -> None:
        self._pending.append((channel, taken_ns, record))
        self._size += len(record)
        if self._size > CHUNK_BYTES:
            self._end_chunk()

    def _end_chunk(self) -> None:
        indexes: dict[int, list[int]] = {}
        offset = 0
        for channel, taken_ns, record in self._pending:
            if channel:
                indexes.setdefault(channel, []).extend((taken_ns, offset))
            offset += len(record)
        if not indexes:
            return
        data = b"".join([record for _, _, record in self._pending])
        packed, start = zstandard.compress(data), self._stream.tell()
        times = [time_ns for entries in indexes.values() for time_ns in entries[::2]]
        chunk = Chunk(
            compression="zstd",
            data=packed,
            message_start_time=min(times),
            message_end_time=max(times),
            uncompressed_crc=zlib.crc32(data),
            uncompressed_size=len(data),
        )
        record = _bytes([chunk])
        index, index_offsets = b"", {}
        for channel, entries in indexes.items():
            index_offsets[channel] = start + len(record) + len(index)
            size = 8 * len(entries)
            index += _INDEX.pack(Opcode.MESSAGE_INDEX, 6 + size, channel, size) + struct.pack(f"<{len(entries)}Q", *entries)
        self._chunks.append(
            ChunkIndex(
                message_start_time=chunk.message_start_time,
                message_end_time=chunk.message_end_time,
                chunk_start_offset=start,
                chunk_length=len(record),
                message_index_offsets=index_offsets,
                message_index_length=len(index),
                compression=chunk.compression,
                compressed_size=len(packed),
                uncompressed_size=len(data),
            )
        )
        self._put(record + index)
        self._pending, self._size = [], 0

    def _statistics(self) -> Statistics:
        return Statistics(
            attachment_count=0,
            channel_count=len(self._channels),
            channel_message_counts=self._counts,
            chunk_count=len(self._chunks),
            message_count=sum(self._counts.values()),
            metadata_count=len(self._metadata),
            message_start_time=min((chunk.message_start_time for chunk in self._chunks), default=0),
            message_end_time=max((chunk.message_end_time for chunk in self._chunks), default=0),
            schema_count=len(self._schemas),
        )

    def _put(self, data: bytes) -> None:
        self._crc = zlib.crc32(data, self._crc)
        self._stream.write(data)


def _bytes(records: Iterable[McapRecord]) -> bytes:
    """Return records as the library writes them."""
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    return bytes(builder.end())  # type: ignore[no-untyped-call]
