"""What lies where in an MCAP file, whoever wrote it, and the messages of one chunk at a time.

Nothing in the file is believed before it was checked: lengths against the file, sizes against :data:`LIMITS`, chunks
against their CRC, message indexes against the messages, the summary against its own CRC. A record that cannot be one
costs what lies up to the next that can; a chunk that cannot be read costs that chunk.
"""

import itertools
import os
import stat
import struct
import zlib
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import IO, Any, NamedTuple, TypeVar

import lz4.frame
import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Header, Metadata, Schema
from mcap.writer import MCAP0_MAGIC
from numpy.typing import NDArray

from cls_bench.errors import InputError
from cls_bench.recording.layout import MESSAGE_HEAD_BYTES, Index
from cls_bench.text import printable


class Limits(NamedTuple):
    """The most that is read into memory of what a file claims to hold."""

    chunk: int = 64 << 20
    """bytes of an unpacked chunk"""
    ratio: int = 100
    """bytes that a packed byte may become; recordings reach 20"""
    slack: int = 64 << 10
    """bytes that a chunk may become beside that"""
    attachments: int = 64 << 20
    """bytes of all attachments together"""
    text: int = 16 << 20
    """bytes of all metadata, schemas and channels together"""
    others: int = 1000
    """records of a chunk that are no messages"""
    indexes: int = 1 << 20
    """message indexes of all chunks together, for each of which 100 bytes are kept"""
    end_ns: int = 24 * 3600 * 10**9
    """latest time of a message since the start of a run [ns]"""
    search: int = 256 << 20
    """bytes that are searched for the next record behind a damaged one"""


LIMITS = Limits()

_HEAD = struct.Struct("<BQ")  # opcode and length of a record
_CHUNK_HEAD = struct.Struct("<QQQII")  # first and last time, size, CRC, length of the compression's name
_MESSAGE_HEAD = struct.Struct("<BQHIQ")  # opcode, length, channel, sequence, log time
_STATISTICS = struct.Struct("<QHIIII")  # messages, schemas, channels, attachments, metadata records, chunks
_FOOTER = struct.Struct("<BQQQI")  # with its opcode and length
_INDEXED = np.dtype([
    ("opcode", "u1"), ("length", "<u8"), ("channel", "<u2"), ("sequence", "<u4"), ("time", "<u8"),
])  # fmt: skip

_LEAST = {
    Opcode.HEADER: 8, Opcode.FOOTER: 20, Opcode.SCHEMA: 14, Opcode.CHANNEL: 16, Opcode.MESSAGE: 22, Opcode.CHUNK: 40,
    Opcode.MESSAGE_INDEX: 6, Opcode.ATTACHMENT: 36, Opcode.METADATA: 8, Opcode.DATA_END: 4,
}  # fmt: skip
"""Least length of a record without its head."""

_LANDMARKS = np.array([Opcode.CHUNK, Opcode.MESSAGE_INDEX, Opcode.ATTACHMENT, Opcode.METADATA, Opcode.DATA_END], "u1")
"""Records at which reading may go on behind damage; the messages in a chunk that is not packed are none of them."""

_BARE_BYTES = 1 << 20
"""Messages outside of chunks are read in stretches of about so many bytes."""

_SEARCH_BYTES = 1 << 20

_SLACK_NS = 20_000_000
"""Chunks that are further apart than this, or overlap more, are not believed as to their times."""

UNKNOWN_NS = -1
"""Time of a chunk that is not known, since its head is damaged."""

_TEXT = "metadata, schemas and channels"

_Record = TypeVar("_Record", Attachment, Channel, Header, Metadata, Schema)


class DamagedError(Exception):
    """A chunk that cannot be read; the text says why."""


@dataclass(frozen=True)
class Messages:
    """The content of a chunk."""

    data: bytes
    index: Mapping[int, Index]
    """channel -> log time [ns] and offset in :attr:`data` of its messages, in the order of the file"""

    def of(self, channel: int) -> Index:
        """Times and offsets of a channel's messages."""
        return self.index.get(channel, _NONE)

    def payloads(self, channel: int, start_ns: int = 0, end_ns: int | None = None) -> Iterator[tuple[int, int, bytes]]:
        """Log time [ns], sequence number and data of a channel's messages with start ≤ time < end."""
        for time, at in self.of(channel).tolist():
            if start_ns <= time and (end_ns is None or time < end_ns):
                _, length, _, sequence, _ = _MESSAGE_HEAD.unpack_from(self.data, at)
                yield time, sequence, self.data[at + MESSAGE_HEAD_BYTES : at + _HEAD.size + length]


_NONE: Index = np.zeros((0, 2), "<u8")


@dataclass
class Chunk:
    """A chunk, or a stretch of messages outside of chunks."""

    offset: int
    """of the packed bytes in the file"""
    length: int
    size: int
    """bytes when unpacked"""
    crc: int
    """0 if there is none"""
    compression: bytes
    start_ns: int
    end_ns: int
    indexes: dict[int, tuple[int, int]] = field(default_factory=dict)
    """channel -> offset and length of the entries of its message index"""
    bare: bool = False
    """whether it is such a stretch"""
    surveyed: bool = False
    """whether its schemas, channels and times were taken from its content"""
    index_holds: bool = False
    """whether the message indexes were found to be right"""
    channels: frozenset[int] | None = None
    """channels of its messages, once it was read"""
    lost: str = ""
    """why it cannot be read, once that is known"""


class McapFile:
    """The records of an MCAP file. Raises InputError if it cannot be opened or is no MCAP file."""

    def __init__(self, path: Path):
        self.path = path
        self.library = ""
        """who wrote the file"""
        self.chunks: list[Chunk] = []
        """in the order of the file"""
        self.schemas: dict[int, Schema] = {}
        self.channels: dict[int, Channel] = {}
        self.metadata: dict[str, dict[str, str]] = {}
        self.attachments: dict[str, bytes] = {}
        self.faults: list[str] = []
        """what is wrong with the file, one line each; chunks that cannot be read are not among them"""
        self.truncated = True
        self.vouched = False
        """whether schemas and channels have a checksum that is right: only those of a summary can have one"""
        self._room = {"attachments": LIMITS.attachments, _TEXT: LIMITS.text}
        self._indexes = 0
        self._found: Counter[int] = Counter()
        with self.open() as file:
            self._end = file.seek(0, os.SEEK_END)
            file.seek(0)
            magic = file.read(len(MCAP0_MAGIC))
            if magic != MCAP0_MAGIC:
                raise InputError(f"{path}: not a recording of cls-bench: {'no MCAP file' if magic else 'it is empty'}")
            data_end = self._data_end(file)
            self._scan(file, data_end)
            if data_end is not None and data_end < self._footer_at:
                self._read_summary(file, data_end)
            named = {channel for chunk in self.chunks for channel in chunk.indexes}
            named |= self._survey(file, [chunk for chunk in self.chunks if not chunk.indexes])
            if not self._knows(named) or not self._follow_each_other():
                self._survey(file, self.chunks)

    @contextmanager
    def open(self) -> Iterator[IO[bytes]]:
        """The file, opened for reading; nothing but a regular file is. Raises InputError."""
        try:
            if not stat.S_ISREG(self.path.stat().st_mode):
                kind = "a folder" if self.path.is_dir() else "not a regular file"
                raise InputError(f"{self.path}: not a recording of cls-bench: it is {kind}")
            with self.path.open("rb") as file:
                yield file
        except FileNotFoundError:
            raise InputError(f"{self.path}: no such file") from None
        except (OSError, ValueError) as error:  # a ValueError: a name with a zero byte in it
            reason = error.strerror if isinstance(error, OSError) else error
            raise InputError(f"{self.path}: cannot be read: {reason}") from None

    # --- reading a chunk ---------------------------------------------------------------------------------------------

    def load(self, file: IO[bytes], chunk: Chunk) -> Messages:
        """The messages of ``chunk``. Raises DamagedError, the next time without reading it again."""
        if not chunk.lost:
            try:
                data = self._unpack(file, chunk)
                messages = Messages(data, self._indexed(file, chunk, data) or _walked(data))
                chunk.channels = frozenset(messages.index)
                return messages
            except DamagedError as error:
                chunk.lost = str(error)
        raise DamagedError(chunk.lost)

    def _unpack(self, file: IO[bytes], chunk: Chunk) -> bytes:
        file.seek(chunk.offset)
        packed = file.read(chunk.length)
        data = _unpacked(packed, chunk.compression, chunk.size)
        if len(data) != chunk.size:
            raise DamagedError("its size is not what it says")
        if chunk.crc and zlib.crc32(data) != chunk.crc:
            raise DamagedError("wrong checksum")
        return data

    def _indexed(self, file: IO[bytes], chunk: Chunk, data: bytes) -> dict[int, Index] | None:
        """The message indexes of ``chunk`` if they name all that is in it and nothing else; they have no checksum."""
        found: dict[int, Index] = {}
        covered = 0
        heads: NDArray[np.void] = np.ndarray((max(len(data) - _INDEXED.itemsize + 1, 0),), _INDEXED, data, strides=(1,))
        for channel, (offset, length) in chunk.indexes.items():
            file.seek(offset)
            entries = file.read(length)
            if len(entries) % 16:
                return None
            index = np.frombuffer(entries, "<u8").reshape(-1, 2)
            time, at = index[:, 0], index[:, 1]
            if not len(at):
                continue
            if not chunk.index_holds:
                if int(at.max()) >= len(heads) or (at[1:] <= at[:-1]).any():
                    return None
                head = heads[at]
                lengths = head["length"]
                if (
                    (head["opcode"] != Opcode.MESSAGE).any() or (head["channel"] != channel).any()
                    or (head["time"] != time).any() or int(time.max()) > LIMITS.end_ns
                    or int(lengths.min()) < _LEAST[Opcode.MESSAGE] or int(lengths.max()) > len(data)
                    or int((at + lengths).max()) + _HEAD.size > len(data)
                ):  # fmt: skip
                    return None
                covered += int(lengths.sum()) + _HEAD.size * len(at)
            found[channel] = index
        chunk.index_holds = chunk.index_holds or covered == len(data)
        return found if chunk.index_holds else None

    # --- what lies where ---------------------------------------------------------------------------------------------

    def _scan(self, file: IO[bytes], data_end: int | None) -> None:
        """Note all records up to the summary, or to the end of the file if it is not known where that is.

        The record that ends the data is believed only where the summary begins: behind any other there may be more.
        """
        end = self._end if data_end is None else data_end
        at = before = len(MCAP0_MAGIC)
        while at + _HEAD.size <= end:
            file.seek(at)
            opcode, length = _HEAD.unpack(file.read(_HEAD.size))
            body = at + _HEAD.size
            if not self._is_record(opcode, body, length):
                following = self._next_landmark(file, before + 1)
                if following is None or following >= end:
                    if data_end is not None:
                        self.faults.append(f"there is damage between its bytes {min(before, at)} and {end}")
                    return
                first, last = min(before, following), max(at, following)
                self.faults.append(f"there is damage between its bytes {first} and {last}")
                at = before = following
                continue
            if opcode in (Opcode.DATA_END, Opcode.FOOTER):
                if data_end is None or body + length >= end:
                    return
                self.faults.append(f"its data ends at its byte {at}, and goes on behind it")
            before = at
            if opcode == Opcode.MESSAGE:
                at = self._add_bare(file, at)
                continue
            self._add(file, opcode, body, length)
            at = body + length
        if data_end is not None:
            self.faults.append("the end of its data is not marked")

    def _is_record(self, opcode: int, body: int, length: int) -> bool:
        return opcode != 0 and _LEAST.get(opcode, 0) <= length <= self._end - body  # type: ignore[call-overload]

    def _next_landmark(self, file: IO[bytes], start: int) -> int | None:
        """Offset of the next record at or behind ``start`` that is followed by another one."""
        for base in range(start, min(self._end, start + LIMITS.search), _SEARCH_BYTES):
            file.seek(base)
            data = file.read(_SEARCH_BYTES + _HEAD.size - 1)
            count = len(data) - _HEAD.size + 1
            if count <= 0:
                return None
            opcodes = np.frombuffer(data, "u1")[:count]
            lengths = np.ndarray((count,), "<u8", data, offset=1, strides=(1,))
            candidates = np.isin(opcodes, _LANDMARKS) & (lengths <= self._end)
            for place in np.flatnonzero(candidates).tolist():
                if self._starts_chain(file, base + place):
                    return base + int(place)
        return None

    def _starts_chain(self, file: IO[bytes], at: int) -> bool:
        """Whether the record at ``at`` and the one behind it can be records, or the file ends with it."""
        for _ in range(2):
            file.seek(at)
            head = file.read(_HEAD.size)
            if len(head) < _HEAD.size:
                return not head
            opcode, length = _HEAD.unpack(head)
            if opcode > Opcode.DATA_END or not self._is_record(opcode, at + _HEAD.size, length):
                return False
            at += _HEAD.size + length
        return True

    def _add(self, file: IO[bytes], opcode: int, body: int, length: int) -> None:
        """Take over a record that is no message."""
        self._found[opcode] += 1
        match opcode:
            case Opcode.CHUNK:
                self._add_chunk(file, body, length)
            case Opcode.MESSAGE_INDEX if self.chunks:
                self._indexes += 1
                if self._indexes > LIMITS.indexes:
                    raise InputError(f"{self.path}: damaged: it has more than {LIMITS.indexes} message indexes")
                file.seek(body)
                channel, entries = struct.unpack("<HI", file.read(6))
                if entries <= length - 6:
                    self.chunks[-1].indexes[channel] = (body + 6, entries)
            case Opcode.ATTACHMENT:
                self._add_attachment(file, body, length)
            case Opcode.HEADER | Opcode.SCHEMA | Opcode.CHANNEL | Opcode.METADATA:
                self._add_text(opcode, self._content(file, body, length, _TEXT))

    def _content(self, file: IO[bytes], body: int, length: int, what: str) -> bytes:
        self._room[what] -= length
        if self._room[what] < 0:
            limit = LIMITS.attachments if what == "attachments" else LIMITS.text
            raise InputError(f"{self.path}: too large: its {what} take more than {limit >> 20} MiB")
        file.seek(body)
        return file.read(length)

    def _add_text(self, opcode: int, content: bytes) -> None:
        match opcode:
            case Opcode.HEADER:
                header = self._parse(Header.read, content, "its header")
                self.library = header.library if header else ""
            case Opcode.SCHEMA:
                schema = self._parse(Schema.read, content, "a schema")
                if schema:
                    self.schemas.setdefault(schema.id, schema)
            case Opcode.CHANNEL:
                channel = self._parse(Channel.read, content, "a channel")
                if channel:
                    self.channels.setdefault(channel.id, channel)
            case Opcode.METADATA:
                metadata = self._parse(Metadata.read, content, "a metadata record")
                if metadata:
                    self.metadata[metadata.name] = metadata.metadata

    def _add_attachment(self, file: IO[bytes], body: int, length: int) -> None:
        content = self._content(file, body, length, "attachments")
        attachment = self._parse(Attachment.read, content, "an attachment")
        if attachment is None:
            return
        (crc,) = struct.unpack("<I", content[-4:])
        if crc and crc != zlib.crc32(content[:-4]):
            self.faults.append(f'the attachment "{printable(attachment.name)}" has a wrong checksum')
            return
        self.attachments[attachment.name] = attachment.data

    def _parse(self, read: Callable[[ReadDataStream], _Record], content: bytes, what: str) -> _Record | None:
        try:
            stream = BytesIO(content)
            record = read(ReadDataStream(stream))
        except (McapError, struct.error, UnicodeDecodeError, OverflowError, MemoryError):
            record = None
        if record is None or stream.tell() != len(content):  # what was cut off is not noticed by the library
            self.faults.append(f"{what} cannot be read")
            return None
        return record

    def _add_chunk(self, file: IO[bytes], body: int, length: int) -> None:
        file.seek(body)
        head = file.read(_CHUNK_HEAD.size + 64)
        start_ns, end_ns, size, crc, name_length = _CHUNK_HEAD.unpack_from(head)
        at = _CHUNK_HEAD.size + name_length
        chunk = Chunk(0, 0, size, crc, head[_CHUNK_HEAD.size : at], start_ns, end_ns)
        if not start_ns <= end_ns <= LIMITS.end_ns:
            chunk.start_ns = chunk.end_ns = UNKNOWN_NS
        self.chunks.append(chunk)
        if name_length > 32 or at + 8 > length:
            chunk.lost = "its head is damaged"
            return
        (chunk.length,) = struct.unpack_from("<Q", head, at)
        chunk.offset = body + at + 8
        if chunk.length > length - at - 8:
            chunk.lost = "it is longer than its record"
        elif not size <= min(LIMITS.chunk, LIMITS.ratio * chunk.length + LIMITS.slack):
            chunk.lost = f"it claims to hold {size} bytes, packed into {chunk.length}"

    def _add_bare(self, file: IO[bytes], at: int) -> int:
        """Take over the messages outside of chunks from offset ``at`` on; returns the offset behind them."""
        file.seek(at)
        data = file.read(_BARE_BYTES)
        length = _HEAD.unpack_from(data)[1] + _HEAD.size
        if length > len(data):
            if length > LIMITS.chunk:
                self.faults.append(f"a message of {length} bytes is left out")
                return at + int(length)
            file.seek(at)
            data = file.read(length)
        first, last, place = LIMITS.end_ns, 0, 0
        while place + MESSAGE_HEAD_BYTES <= len(data):
            opcode, length, _, _, time = _MESSAGE_HEAD.unpack_from(data, place)
            end = place + _HEAD.size + length
            if opcode not in (Opcode.MESSAGE, Opcode.SCHEMA, Opcode.CHANNEL) or end > len(data):
                break
            if opcode == Opcode.MESSAGE:
                if length < _LEAST[Opcode.MESSAGE] or time > LIMITS.end_ns:
                    break
                first, last = min(first, time), max(last, time)
            else:
                self._room[_TEXT] -= length
                self._add_text(opcode, data[place + _HEAD.size : end])
            place = end
        if not place:
            self.faults.append("a message has a time that is not one of a run")
            return at + int(_HEAD.unpack_from(data)[1]) + _HEAD.size
        self.chunks.append(Chunk(at, place, place, 0, b"", first, last, bare=True, surveyed=True))
        return at + place

    def _data_end(self, file: IO[bytes]) -> int | None:
        """Where the data ends: at the summary, or at the footer if there is none; None if there is no footer.

        A file that ends as it should was not cut short; without a footer there all the same, it was damaged.
        """
        footer_at = self._footer_at
        if footer_at < len(MCAP0_MAGIC):
            return None
        file.seek(footer_at)
        tail = file.read()
        if tail[_FOOTER.size :] != MCAP0_MAGIC:
            return None
        self.truncated = False
        opcode, length, start, _, _ = _FOOTER.unpack_from(tail)
        if opcode == Opcode.FOOTER and length == _FOOTER.size - _HEAD.size:
            if start == 0:
                return footer_at
            if len(MCAP0_MAGIC) <= start <= footer_at:
                return int(start)
        self.faults.append("its footer is damaged")
        return None

    @property
    def _footer_at(self) -> int:
        return self._end - len(MCAP0_MAGIC) - _FOOTER.size

    def _read_summary(self, file: IO[bytes], start: int) -> None:
        """Take schemas and channels from the summary if its checksum is right: elsewhere they have none.

        It also counts what is in the file: what is missing is said.
        """
        length = self._footer_at - start
        if length > LIMITS.text + LIMITS.chunk:
            return
        file.seek(start)
        content = file.read(length + _FOOTER.size)
        summary, crc = content[:length], _FOOTER.unpack_from(content, length)[-1]
        if crc and zlib.crc32(content[:-4]) != crc:
            self.faults.append("its summary has a wrong checksum")
            return
        schemas, channels = dict(self.schemas), dict(self.channels)
        self.vouched = crc != 0
        if crc:
            self.schemas.clear()
            self.channels.clear()
        for opcode, content in _records(summary):
            if opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                self._add_text(opcode, content)
            elif opcode == Opcode.STATISTICS and len(content) >= _STATISTICS.size:
                self._count(*_STATISTICS.unpack_from(content)[3:])
        if any(self.schemas.get(key, schema) != schema for key, schema in schemas.items()) or any(
            self.channels.get(key, channel) != channel for key, channel in channels.items()
        ):
            self.faults.append("schemas or channels differ from those in its summary, which are used")
        self.schemas, self.channels = schemas | self.schemas, channels | self.channels

    def _count(self, attachments: int, metadata: int, chunks: int) -> None:
        """Hold what was found against what the summary counts."""
        for what, found, counted in (
            ("chunks", sum(not chunk.bare for chunk in self.chunks), chunks),
            ("attachments", self._found[Opcode.ATTACHMENT], attachments),
            ("metadata records", self._found[Opcode.METADATA], metadata),
        ):
            if found != counted:
                self.faults.append(f"it holds {found} {what}, and its summary counts {counted}")

    def _knows(self, channels: set[int]) -> bool:
        return all(k in self.channels and self.channels[k].schema_id in {0, *self.schemas} for k in channels)

    def _follow_each_other(self) -> bool:
        """Whether the chunks cover the time one after the other, as their heads have it: these have no checksum."""
        if any(chunk.start_ns == UNKNOWN_NS for chunk in self.chunks):
            return False
        return all(
            abs(after.start_ns - before.end_ns) < _SLACK_NS and before.start_ns <= before.end_ns
            for before, after in itertools.pairwise(self.chunks)
        )

    def _survey(self, file: IO[bytes], chunks: Iterable[Chunk]) -> set[int]:
        """Take schemas, channels and times from the content of ``chunks``; returns the channels of their messages."""
        named: set[int] = set()
        for chunk in chunks:
            if chunk.surveyed or chunk.lost:
                continue
            chunk.surveyed = True
            try:
                messages = self.load(file, chunk)
            except DamagedError:
                continue
            times = [index[:, 0] for index in messages.index.values()]
            if times:
                chunk.start_ns = min(int(time.min()) for time in times)
                chunk.end_ns = max(int(time.max()) for time in times)
            named |= messages.index.keys()
            for opcode, content in _records(messages.data) if _holds_more(messages) else ():
                if opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                    self._room[_TEXT] -= len(content)
                    if self._room[_TEXT] >= 0:
                        self._add_text(opcode, content)
        return named


def _holds_more(messages: Messages) -> bool:
    """Whether there are other records than messages."""
    sizes = (int(taken(messages.data, index[:, 1], 1, "<u8").sum()) for index in messages.index.values())
    count = sum(len(index) for index in messages.index.values())
    return sum(sizes) + _HEAD.size * count < len(messages.data)


def taken(data: bytes, offsets: NDArray[np.uint64], at: int, dtype: str) -> NDArray[Any]:
    """The field ``at`` bytes behind each of ``offsets``, of any alignment; all must lie inside of ``data``."""
    room = len(data) - at - np.dtype(dtype).itemsize + 1
    fields: NDArray[Any] = np.ndarray((room,), dtype, data, offset=at, strides=(1,))[offsets]
    return fields


def _records(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Opcode and content of the complete records in ``data``."""
    at = 0
    while at + _HEAD.size <= len(data):
        opcode, length = _HEAD.unpack_from(data, at)
        end = at + _HEAD.size + length
        if end > len(data):
            return
        yield opcode, data[at + _HEAD.size : end]
        at = end


def _unpacked(packed: bytes, compression: bytes, size: int) -> bytes:
    """The unpacked bytes, ``size`` + 1 at most. Raises DamagedError."""
    try:
        match compression:
            case b"":
                return packed
            case b"zstd":
                if zstandard.frame_content_size(packed) not in (size, -1):  # it would be trusted as to the memory
                    raise DamagedError("its size is not what it says")
                return zstandard.decompress(packed, max_output_size=size)
            case b"lz4":
                return bytes(lz4.frame.LZ4FrameDecompressor().decompress(packed, max_length=size + 1))
    except (zstandard.ZstdError, RuntimeError, EOFError, ValueError, MemoryError):
        raise DamagedError("it cannot be unpacked") from None
    raise DamagedError(f'it is packed with "{printable(compression.decode(errors="replace"))}"; known: zstd, lz4')


def _walked(data: bytes) -> dict[int, Index]:
    """Channel -> times and offsets of the messages, from record to record. Raises DamagedError."""
    offsets: list[int] = []
    length_at = struct.Struct("<Q").unpack_from
    at, end, others = 0, len(data), 0
    while at + _HEAD.size <= end:
        if data[at] == Opcode.MESSAGE:
            offsets.append(at)
        else:
            others += 1
            if not data[at] or others > LIMITS.others:
                raise DamagedError("its records are damaged")
        at += _HEAD.size + length_at(data, at + 1)[0]
    if at != end or (offsets and offsets[-1] + MESSAGE_HEAD_BYTES > end):
        raise DamagedError("its records are damaged")
    places = np.array(offsets, "<u8")
    if not len(places):
        return {}
    channels, times = taken(data, places, 9, "<u2"), taken(data, places, 15, "<u8")
    if int(taken(data, places, 1, "<u8").min()) < _LEAST[Opcode.MESSAGE] or int(times.max()) > LIMITS.end_ns:
        raise DamagedError("its messages are not those of a run")
    found = {}
    for channel in np.unique(channels).tolist():
        own = channels == channel
        found[channel] = np.stack([times[own], places[own]], axis=1)
    return found
