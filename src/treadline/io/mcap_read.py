"""Messages of any MCAP file, and the signals of a run's own log. The file is not trusted: sizes and counts are limited.

Checksums are verified if present. A log written by treadline has checksums everywhere, so a chunk without checksum is rejected
(``sealed``): any damage gives one ``LogFormatError``, and all messages yielded before have verified checksums.
"""

import mmap
import struct
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.records import Channel, Chunk, DataEnd, Header, McapRecord, Message, Schema
from mcap.stream_reader import StreamReader
from mcap.writer import MCAP0_MAGIC

from treadline.core.errors import LogFormatError, TreadlineError, one_line
from treadline.io.images import Pairing
from treadline.io.message_types import message_of, stamped_s
from treadline.io.messages import CAMERA_INFO, IMAGE
from treadline.io.standard_messages import LOOKED, OURS, signal_reader

MAX_FILE_BYTES = 8 * 1024**3
"""Largest size of a run log [bytes]; other logs are read record by record without a limit."""
MAX_CHUNK_BYTES = 256 * 1024**2
"""Largest decompressed chunk [bytes]; the treadline writer closes a chunk at 4 MB."""
MAX_MESSAGES = 50_000_000
"""Largest number of messages: about twelve hours of driving."""
LIBRARY = "treadline"
"""Library name in the MCAP header of logs written by treadline."""
_PIECE = 1 << 20
CAMERA_ROLES = {"/camera/color/image_raw": "color", "/camera/depth/image_rect": "depth", "/camera/color/camera_info": "info"}
"""Topics of the camera in a run's own log, with the roles that ``Pairing`` knows."""

BROKEN = (McapError, zstandard.ZstdError, struct.error, ValueError, LookupError, EOFError, OverflowError, MemoryError)
"""Exceptions of the parsers for damaged files: lengths, opcodes, text, numbers out of range."""


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


class LogDecoder:
    """Decoder of a run's own messages; pairs the images of a frame."""

    def __init__(self) -> None:
        def lost(t_s: float, reason: str) -> None:
            raise LogFormatError(f"the depth image at {t_s} s has {reason}")

        self._pairing = Pairing(lost=lost, is_ours=True)

    def signal(self, topic: str, kind: str, data: bytes) -> Any | None:
        """Return the signal completed by a message, or None."""
        read = signal_reader(topic, kind) if topic in OURS or topic in LOOKED else None
        if read is None and topic not in CAMERA_ROLES:
            return None
        message = message_of(kind, data)
        t_s = stamped_s(message.header.stamp)
        if read is not None:
            return read(message, t_s)
        role = CAMERA_ROLES[topic]
        if kind != (CAMERA_INFO if role == "info" else IMAGE):
            raise LogFormatError(f"{topic} holds {kind}")
        return next((frame for frame, _ in self._pairing.take(role, message, t_s)), None)


def read_log(path: Path, wants: Callable[[str], bool] = lambda _: True) -> Iterator[Any]:
    """Yield signals, events and ground truth of a run log in recorded order, for the requested topics.

    Raises:
        LogFormatError: If the file is missing, too large, damaged or not a treadline log.
    """
    decoder = LogDecoder()
    with damage(path):
        for topic, _, data in mcap_messages(path, wants, sealed=True):
            signal = decoder.signal(topic.name, topic.kind, data)
            if signal is not None:
                yield signal


@contextmanager
def damage(file: Path) -> Iterator[None]:
    """Turn every failure to read a log into one error that names the file."""
    try:
        yield
    except LogFormatError as error:
        raise LogFormatError(f"{file}: {one_line(error, 500)}") from None
    except TreadlineError:
        raise
    except OSError as error:
        raise LogFormatError(f"{file}: {error.strerror or error}") from None
    except Exception as error:
        cause = one_line(error, 500) or type(error).__name__
        raise LogFormatError(f"{file}: not a whole log: {cause}; was it cut short? (mcap recover, rosbag reindex)") from error


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


def run_metadata(path: Path) -> dict[str, str]:
    """Return the properties of the run that a log of treadline keeps in its metadata record; empty without one.

    Raises:
        LogFormatError: If the file is missing or damaged.
    """
    with damage(path), path.open("rb") as file:
        found = SeekingReader(file, record_size_limit=MAX_CHUNK_BYTES).iter_metadata()
        return next((dict(record.metadata) for record in found if record.name == LIBRARY), {})


def mcap_messages(path: Path, wants: Callable[[str], bool], *, sealed: bool = False) -> Iterator[Packet]:
    """Yield the messages of the requested topics, in file order.

    No object is made for a message that is not requested, so that a few topics of a long log are read several times as fast.

    Args:
        sealed: Whether each message must be in a chunk with a checksum, as in logs written by treadline.
    """
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
        if sealed and len(data) > MAX_FILE_BYTES:
            raise LogFormatError(f"{len(data)} bytes; at most {MAX_FILE_BYTES} are read")
        topics = _Topics(wants)
        count = 0
        for record in _records(data, sealed=sealed):
            for packet in topics.messages_in(record) if isinstance(record, Chunk) else topics.message(record):
                count += 1
                if count > MAX_MESSAGES:
                    raise LogFormatError(f"more than {MAX_MESSAGES} messages")
                yield packet


_PREFIX = struct.Struct("<BQ")
"""Opcode and length of a record."""
_MESSAGE = struct.Struct("<HIQQ")
"""Channel, sequence number, log time and publish time at the start of a message record."""


class _Topics:
    """Topics declared so far by the records of a file, as far as they are requested."""

    def __init__(self, wants: Callable[[str], bool]) -> None:
        self._wants = wants
        self._schemas: dict[int, Schema] = {}
        self._topics: dict[int, RecordedTopic | None] = {}

    def message(self, record: McapRecord) -> Iterator[Packet]:
        """Yield the message of a record outside chunks if it is requested; keep what a schema or a channel declares."""
        if isinstance(record, Schema):
            self._schemas[record.id] = record
        elif isinstance(record, Channel):
            self._topics[record.id] = None
            if self._wants(record.topic):
                schema = self._schemas.get(record.schema_id, Schema(id=0, name="", encoding="", data=b""))
                kind, language, definition = schema.name, schema.encoding, schema.data.decode()
                self._topics[record.id] = RecordedTopic(record.topic, record.message_encoding, kind, language, definition)
        elif isinstance(record, Message) and (topic := self._topics[record.channel_id]) is not None:
            yield topic, record.log_time, record.data

    def messages_in(self, chunk: Chunk) -> Iterator[Packet]:
        """Yield the requested messages of a chunk whose checksum, if it has one, is right."""
        data = _inflated(chunk)
        if chunk.uncompressed_crc and zlib.crc32(data) != chunk.uncompressed_crc:
            raise ValueError("the checksum of a chunk is wrong")
        for opcode, start, end in _extents(data, 0):
            if opcode == Opcode.MESSAGE:
                channel, _, logged_ns, _ = _MESSAGE.unpack_from(data, start)
                topic = self._topics[channel]
                if topic is not None:
                    yield topic, logged_ns, data[start + _MESSAGE.size : end]
            elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                yield from self.message(_parsed(opcode, data[start:end]))


_KINDS: dict[int, Callable[[ReadDataStream, int], McapRecord]] = {
    Opcode.SCHEMA: lambda stream, _: Schema.read(stream),
    Opcode.CHANNEL: lambda stream, _: Channel.read(stream),
    Opcode.MESSAGE: Message.read,
    Opcode.CHUNK: lambda stream, _: Chunk.read(stream),
    Opcode.DATA_END: lambda stream, _: DataEnd.read(stream),
}
"""Parsers of the records that are read. Indexes are skipped: parsing them takes longer than the messages."""


def _parsed(opcode: int, content: bytes) -> McapRecord:
    return _KINDS[opcode](ReadDataStream(BytesIO(content)), len(content))


def _records(data: mmap.mmap, *, sealed: bool) -> Iterator[McapRecord]:
    """Yield the chunks of a file, and the records outside chunks unless ``sealed``."""
    if data[: len(MCAP0_MAGIC)] != MCAP0_MAGIC:
        raise ValueError("it does not begin as an MCAP file")
    for opcode, start, end in _extents(data, len(MCAP0_MAGIC)):
        if opcode == Opcode.FOOTER and data[end:] == MCAP0_MAGIC:
            return
        if opcode not in _KINDS:
            continue
        record = _parsed(opcode, data[start:end])
        if isinstance(record, DataEnd):
            _check_data(data, start - _PREFIX.size, record.data_section_crc, sealed=sealed)
            continue
        if sealed:
            _check_sealed(record)
        if not sealed or isinstance(record, Chunk):
            yield record
    raise ValueError("it does not end as an MCAP file")


def _extents(data: bytes | mmap.mmap, at: int) -> Iterator[tuple[int, int, int]]:
    """Yield opcode, and start and end of the content, of each record of a chunk or of a file from a place on."""
    whole = len(data)
    while at < whole:
        opcode, length = _PREFIX.unpack_from(data, at)
        start = at + _PREFIX.size
        at = start + length
        if length > MAX_CHUNK_BYTES:
            raise ValueError(f"a record of {length} bytes; at most {MAX_CHUNK_BYTES} are read")
        if at > whole:
            raise ValueError("a record is longer than what holds it")
        yield opcode, start, at


def _check_sealed(record: McapRecord) -> None:
    if isinstance(record, Message):
        raise LogFormatError("a message outside a chunk has no checksum")
    if isinstance(record, Chunk) and (record.compression != "zstd" or record.uncompressed_crc == 0):
        raise LogFormatError(
            f"a chunk is compressed by '{record.compression}' or has no checksum; zstd and a checksum are required"
        )


def _check_data(data: mmap.mmap, end: int, crc: int, *, sealed: bool) -> None:
    """Check the checksum of everything before the record at ``end``, 0 for none."""
    if crc == 0 and sealed:
        raise LogFormatError("the data has no checksum")
    with memoryview(data) as view, view[:end] as before:
        if crc not in (0, zlib.crc32(before)):
            raise ValueError("the checksum of the data is wrong")


def _inflated(chunk: Chunk) -> bytes:
    """Return the decompressed chunk, limited to its declared size."""
    size = chunk.uncompressed_size
    if size > MAX_CHUNK_BYTES:
        raise LogFormatError(f"a chunk unpacks to {size} bytes; at most {MAX_CHUNK_BYTES} are read")
    if chunk.compression not in _INFLATE:
        raise LogFormatError(
            f"a chunk is compressed by '{chunk.compression}'; zstd and lz4 are supported: convert it with mcap compress"
        )
    data = _INFLATE[chunk.compression](chunk.data, size + 1)
    if len(data) != size:
        raise LogFormatError(f"a chunk does not unpack to its declared {size} bytes")
    return data


def inflate_zstd(data: bytes, most: int) -> bytes:
    """Return the decompressed frame, at most ``most`` bytes."""
    stream = zstandard.ZstdDecompressor().stream_reader(data)
    return _gathered(lambda: stream.read(_PIECE), most)


def inflate_lz4(data: bytes, most: int) -> bytes:
    """Return the decompressed frame, at most ``most`` bytes."""
    frame = lz4.frame.LZ4FrameDecompressor()
    rest = iter((data,))
    return _gathered(lambda: b"" if frame.eof else frame.decompress(next(rest, b""), max_length=_PIECE), most)


def _gathered(piece: Callable[[], bytes], most: int) -> bytes:
    """Join pieces up to a limit; a declared size alone must not cause an allocation."""
    plain = bytearray()
    while len(plain) < most and (more := piece()):
        plain += more
    return bytes(memoryview(plain)[:most])


_INFLATE: dict[str, Callable[[bytes, int], bytes]] = {"": lambda data, _: data, "zstd": inflate_zstd, "lz4": inflate_lz4}
