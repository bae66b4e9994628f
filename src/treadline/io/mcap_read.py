"""Reading a run's log back. The file is not trusted: sizes and counts have caps, checksums are always compared.

Anything wrong with it is one ``LogFormatError``; what was yielded before it had passed its chunk's checksum.
"""

import mmap
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any, cast

import zstandard
from mcap.exceptions import McapError
from mcap.records import Channel, Chunk, DataEnd, McapRecord, Message
from mcap.stream_reader import StreamReader, breakup_chunk

from treadline.errors import LogFormatError
from treadline.io.decode import Decoder

MAX_FILE_BYTES = 8 * 1024**3
MAX_CHUNK_BYTES = 256 * 1024**2
"""Decompressed; the writer closes a chunk at 4 MB."""
MAX_MESSAGES = 50_000_000
"""Some twelve hours of driving."""

# What the parser of a broken file may stumble over: lengths, opcodes, text, numbers beyond their range.
_BROKEN = (
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


def read_log(path: Path) -> Iterator[Any]:
    """Yield the signals, events and truth of a log in the order they were written.

    Raises:
        LogFormatError: If the file is missing, too large, damaged or not a log of treadline.
    """
    try:
        with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
            yield from _signals(data)
    except LogFormatError as error:
        raise LogFormatError(f"{path}: {error}") from None
    except OSError as error:
        raise LogFormatError(f"{path}: {error.strerror or error}") from None
    except _BROKEN as error:
        raise LogFormatError(f"{path}: not a whole MCAP file: {error}; was it cut short or changed?") from None


def _signals(data: mmap.mmap) -> Iterator[Any]:
    if len(data) > MAX_FILE_BYTES:
        raise LogFormatError(f"{len(data)} bytes; at most {MAX_FILE_BYTES} are read")
    decoder = Decoder()
    topics: dict[int, str] = {}
    count = 0
    # A record longer than the file is broken: no memory for it. The map's read() stops at the end by itself.
    reader = StreamReader(cast("IO[bytes]", data), validate_crcs=True, emit_chunks=True, record_size_limit=len(data))
    for record in _unpacked(reader):
        if isinstance(record, Channel):
            topics[record.id] = record.topic
        elif isinstance(record, Message):
            count += 1
            if count > MAX_MESSAGES:
                raise LogFormatError(f"more than {MAX_MESSAGES} messages")
            signal = decoder.signal(topics[record.channel_id], record.data)
            if signal is not None:
                yield signal


def _unpacked(reader: StreamReader) -> Iterator[McapRecord]:
    for record in reader.records:
        if isinstance(record, Chunk):
            _check(record)
            yield from breakup_chunk(record, validate_crc=True)
        elif isinstance(record, Message):
            raise LogFormatError("a message outside a chunk has no checksum")
        elif isinstance(record, DataEnd) and record.data_section_crc == 0:
            raise LogFormatError("the data has no checksum")
        elif not isinstance(record, Channel):
            yield record


def _check(chunk: Chunk) -> None:
    if chunk.compression != "zstd" or chunk.uncompressed_crc == 0:
        raise LogFormatError(f"a chunk is compressed by '{chunk.compression}' or has no checksum; zstd and one are needed")
    # The frame's own header says how much is allocated, not the chunk's.
    size = zstandard.get_frame_parameters(chunk.data).content_size
    if size != chunk.uncompressed_size or size > MAX_CHUNK_BYTES:
        raise LogFormatError(
            f"a chunk unpacks to {size} bytes, {chunk.uncompressed_size} announced; at most {MAX_CHUNK_BYTES} are read"
        )
