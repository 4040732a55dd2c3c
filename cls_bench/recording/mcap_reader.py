"""Reads recordings: topics as numpy arrays, chunk by chunk."""

import importlib
import json
import struct
import warnings
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import IO, Any, TypeVar

import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Metadata, Schema
from mcap.writer import MCAP0_MAGIC
from numpy.typing import NDArray

from cls_bench.errors import InputError
from cls_bench.recording import foxglove
from cls_bench.recording.layout import FIELD_BYTES, MESSAGE_HEAD_BYTES, Index, message_dtype, tags
from cls_bench.recording.mcap_writer import (
    PARAMETERS_ATTACHMENT,
    RESULT_METADATA,
    RUN_METADATA,
    SCENARIO_ATTACHMENT,
    SCENE_TOPIC,
    TRANSFORMS_TOPIC,
    WALL_CLOCK_END_METADATA,
    WALL_CLOCK_METADATA,
)
from cls_bench.recording.run_info import RunInfo
from cls_bench.signals import EVENTS_TOPIC, TICK_NS, Block, Event, Signal, Topic

INCOMPLETE = "incomplete"
"""Status of a recording whose run was killed."""

READERS = 2
"""Chunks that are unpacked at once: more would hold more memory."""

_HEAD = struct.Struct("<BQ")  # opcode and length of a record
_CHUNK_HEAD = struct.Struct("<QQQII")  # first and last time, size, CRC, length of the compression's name
_HEAD_BYTES = 64  # of a record: more than is needed of a chunk's or a message index's head

Poses = NDArray[np.float64]
"""Position [m] and quaternion w, x, y, z of each body, world first, shape (rows, bodies, 7)."""

_Record = TypeVar("_Record", Attachment, Channel, Metadata, Schema)


@dataclass(frozen=True)
class Series:
    """Signals of one topic over time."""

    time: NDArray[np.float64]
    """time since the start of the run, shape (rows,) [s]"""
    values: Mapping[str, NDArray[np.float64]]
    """signal name -> values, each of shape (rows,), in the signal's SI unit"""

    def __getitem__(self, signal: str) -> NDArray[np.float64]:
        return self.values[signal]

    def __len__(self) -> int:
        return len(self.time)

    def to_pandas(self) -> Any:
        """As a pandas DataFrame with the time [s] as index. InputError if pandas is not installed."""
        return _library("pandas").DataFrame(dict(self.values), index=_library("pandas").Index(self.time, name="time"))

    def to_polars(self) -> Any:
        """As a polars DataFrame, the time [s] in its first column. InputError if polars is not installed."""
        return _library("polars").DataFrame({"time": self.time, **self.values})


def _library(name: str) -> Any:
    try:
        return importlib.import_module(name)
    except ImportError:
        raise InputError(f"{name} is not installed: pip install {name}") from None


@dataclass
class _Chunk:
    """Where a chunk and the message indexes of its channels lie in the file."""

    offset: int
    length: int
    start_ns: int
    end_ns: int
    size: int
    crc: int
    indexes: dict[int, tuple[int, int]] = field(default_factory=dict)
    """channel -> offset and length of the entries"""
    indexed: bool = False
    """all of its message indexes are there"""


@dataclass(frozen=True)
class _Wanted:
    """What to read of a topic."""

    topic: Topic
    names: tuple[str, ...]
    columns: list[int]
    every: int


class Recording:
    """A recording made by :class:`McapRecorder`, complete or cut short.

    Opening it reads the heads of all records; :meth:`read` and :meth:`events` then hold one chunk at a time. Raises
    :class:`InputError` if there is no such file or it is no MCAP file. Of a file that was cut short, all complete
    chunks are read; ``truncated`` is then true and a warning is issued once, unless the file is known to be
    ``unfinished``.
    """

    def __init__(self, path: Path, *, unfinished: bool = False):
        self.path = path
        self.truncated = True
        self.topics: dict[str, Topic] = {}
        """topics of signals in the file, with units and meanings as recorded"""
        self.attachments: dict[str, bytes] = {}
        """name -> content: scenario.toml, parameters.json and the model files"""
        self._channels: dict[str, int] = {}
        self._chunks: list[_Chunk] = []
        self._metadata: dict[str, dict[str, str]] = {}
        try:
            with path.open("rb") as file:
                if file.read(len(MCAP0_MAGIC)) != MCAP0_MAGIC:
                    raise InputError(f"{path} is no MCAP file")
                self._scan(file)
        except OSError as error:
            raise InputError(f"cannot read {path}: {error.strerror}") from None
        if self.truncated and not unfinished:
            warnings.warn(f"{path} was cut short; reading its complete chunks", stacklevel=2)

    @property
    def metadata(self) -> Mapping[str, str]:
        """Seed, versions, … and ``scenario``, the scenario's name."""
        return self._metadata.get(RUN_METADATA, {})

    @property
    def scenario_name(self) -> str:
        """Name of the scenario; empty if the file was cut before it."""
        return self.metadata.get("scenario", "")

    @property
    def wall_start(self) -> str:
        """Wall-clock time of the start, ISO 8601; empty if the file was cut before it."""
        return self._metadata.get(WALL_CLOCK_METADATA, {}).get("start", "")

    @property
    def wall_end(self) -> str:
        """Wall-clock time of the end, ISO 8601; empty if the run was killed."""
        return self._metadata.get(WALL_CLOCK_END_METADATA, {}).get("end", "")

    @property
    def status(self) -> str:
        """What was passed to ``finish``, or ``"incomplete"`` if the run was killed."""
        return self._metadata.get(RESULT_METADATA, {}).get("status", INCOMPLETE)

    @property
    def parameters(self) -> Any:
        """The parameters of the run as nested dictionaries."""
        return json.loads(self.attachments.get(PARAMETERS_ATTACHMENT, b"{}"))

    @property
    def duration(self) -> float:
        """Time from the start of the run to the end of the last recorded tick [s]."""
        if not self._chunks:
            return 0.0
        return (max(chunk.end_ns for chunk in self._chunks) + TICK_NS) / 1e9

    def events(self) -> tuple[Event, ...]:
        """All events in the order in which they were recorded."""
        channel = self._channels.get(EVENTS_TOPIC)
        if channel is None:
            return ()
        found = []
        with self.path.open("rb") as file:
            for chunk in self._chunks:
                if chunk.indexed and channel not in chunk.indexes:
                    continue
                data = self._load(file, chunk)
                for time, offset in self._index(file, chunk, channel).tolist():
                    found.append(foxglove.parse_log(_payload(data, offset), time // TICK_NS))
        return tuple(found)

    def read(
        self,
        topic: str,
        signals: Sequence[str] | None = None,
        start: float | None = None,
        end: float | None = None,
        every: int = 1,
    ) -> Series:
        """Samples of ``signals`` (all if None) of ``topic`` with start ≤ time < end [s].

        ``every`` keeps the rows whose tick is divisible by ``every`` times the topic's ticks. Raises
        :class:`InputError` for an unknown topic or signal, and if a chunk is damaged.
        """
        if every < 1:
            raise InputError(f"every = {every}: must be at least 1")
        known = self._topic(topic)
        names = known.names if signals is None else tuple(signals)
        return self._read([_Wanted(known, names, [self._column(known, name) for name in names], every)], start, end)[0]

    def read_all(self, start: float | None = None, end: float | None = None) -> dict[str, Series]:
        """All signals of all topics with start ≤ time < end [s], by topic: each chunk is unpacked just once."""
        wanted = [_Wanted(t, t.names, list(range(len(t.names))), 1) for t in self.topics.values()]
        return dict(zip(self.topics, self._read(wanted, start, end), strict=True))

    def blocks(self) -> Iterator[Block]:
        """The run as the blocks in which it was recorded, poses and events with them."""
        events = self.events()
        wanted = [_Wanted(t, t.names, list(range(len(t.names))), 1) for t in self.topics.values()]
        with self.path.open("rb") as file:
            for chunk in self._chunks:
                data = self._load(file, chunk)
                parts = self._parts(file, chunk, data, wanted, 0, None)
                fastest = next(times for part, (times, _) in zip(wanted, parts, strict=True) if part.topic.ticks == 1)
                first, ticks = int(fastest[0]) // TICK_NS, len(fastest)
                signals = {part.topic.path: rows.T for part, (_, rows) in zip(wanted, parts, strict=True)}
                _, poses = self._poses(file, chunk, data)
                inside = tuple(event for event in events if first <= event.tick < first + ticks)
                yield Block(first, ticks, signals, poses, inside)

    def poses(self, start: float | None = None, end: float | None = None) -> tuple[NDArray[np.float64], Poses]:
        """Times [s] and poses of the bodies with start ≤ time < end [s], as in :class:`cls_bench.signals.Block`."""
        start_ns = 0 if start is None else _next_tick(start) * TICK_NS
        end_ns = self._chunks[-1].end_ns + 1 if end is None and self._chunks else _next_tick(end or 0.0) * TICK_NS
        times, rows = [np.zeros(0, np.uint64)], []
        with self.path.open("rb") as file:
            for chunk in self._chunks:
                if chunk.end_ns >= start_ns and chunk.start_ns < end_ns:
                    time, poses = self._poses(file, chunk, self._load(file, chunk))
                    kept = (time >= start_ns) & (time < end_ns)
                    times.append(time[kept])
                    rows.append(poses[kept])
        return np.concatenate(times) / 1e9, np.concatenate(rows) if rows else np.zeros((0, 1, 7))

    def _poses(self, file: IO[bytes], chunk: _Chunk, data: bytes) -> tuple[NDArray[np.uint64], Poses]:
        """Times [ns] and poses in a chunk."""
        channel = self._channels.get(TRANSFORMS_TOPIC)
        index = self._index(file, chunk, channel) if channel is not None else np.zeros((0, 2), np.uint64)
        rows = [foxglove.parse_transforms(_payload(data, int(offset))) for offset in index[:, 1]]
        return index[:, 0], np.array(rows, np.float64).reshape(len(rows), -1, 7) if rows else np.zeros((0, 1, 7))

    def run_info(self) -> RunInfo:
        """What the recording says about its run besides the samples, shapes of the bodies included."""
        attachments = dict(self.attachments)
        scenario = attachments.pop(SCENARIO_ATTACHMENT, b"")
        attachments.pop(PARAMETERS_ATTACHMENT, None)
        transforms, scene = self._first_payload(TRANSFORMS_TOPIC), self._first_payload(SCENE_TOPIC)
        bodies = foxglove.parse_body_names(transforms) if transforms else (foxglove.WORLD,)
        return RunInfo(
            scenario_name=self.scenario_name,
            scenario_toml=scenario,
            mjcf=attachments,
            parameters=self.parameters,
            metadata={name: text for name, text in self.metadata.items() if name != "scenario"},
            wall_start=self.wall_start,
            body_names=bodies,
            geoms=foxglove.parse_scene(scene, bodies) if scene else (),
        )

    def _first_payload(self, topic: str) -> bytes:
        """Data of the first message of a topic; empty if there is none."""
        channel = self._channels.get(topic)
        if channel is None:
            return b""
        with self.path.open("rb") as file:
            for chunk in self._chunks:
                index = self._index(file, chunk, channel)
                if len(index):
                    return _payload(self._load(file, chunk), int(index[0, 1]))
        return b""

    def _read(self, wanted: Sequence["_Wanted"], start: float | None, end: float | None) -> list[Series]:
        """Samples of all of ``wanted``, in one pass over the chunks."""
        start_ns = 0 if start is None else _next_tick(start) * TICK_NS
        end_ns = None if end is None else _next_tick(end) * TICK_NS
        chunks = [
            chunk for chunk in self._chunks
            if chunk.end_ns >= start_ns and (end_ns is None or chunk.start_ns < end_ns)
        ]  # fmt: skip
        with ThreadPoolExecutor(READERS) as pool:  # unpacking, checksum and copying release the interpreter

            def parts(chunk: _Chunk) -> list[tuple[NDArray[np.uint64], NDArray[np.float64]]]:
                with self.path.open("rb") as file:
                    return self._parts(file, chunk, None, wanted, start_ns, end_ns)

            found = list(pool.map(parts, chunks))
        series = []
        for number, part in enumerate(wanted):
            times = [chunk[number][0] for chunk in found]
            values = [chunk[number][1] for chunk in found]
            time = np.concatenate(times) / 1e9 if times else np.zeros(0)
            joined = np.concatenate(values, axis=1) if values else np.zeros((len(part.names), 0))
            series.append(Series(time, dict(zip(part.names, joined, strict=True))))
        return series

    def _parts(
        self, file: IO[bytes], chunk: _Chunk, data: bytes | None, wanted: Sequence["_Wanted"],
        start_ns: int, end_ns: int | None,
    ) -> list[tuple[NDArray[np.uint64], NDArray[np.float64]]]:  # fmt: skip
        """Times [ns] and samples, shape (signals, rows), of all of ``wanted`` in a chunk, unpacked only if needed."""
        parts = []
        for part in wanted:
            index = self._index(file, chunk, self._channels[part.topic.path])
            kept = index[:, 0] >= start_ns
            if part.every > 1:
                kept &= index[:, 0] % (part.every * part.topic.ticks * TICK_NS) == 0
            if end_ns is not None:
                kept &= index[:, 0] < end_ns
            index = index[kept]
            if not len(index):
                parts.append((index[:, 0], np.zeros((len(part.names), 0))))
                continue
            data = self._load(file, chunk) if data is None else data
            parts.append((index[:, 0], self._values(data, index[:, 1], len(part.topic.signals), part.columns)))
        return parts

    def _topic(self, path: str) -> Topic:
        if path not in self.topics:
            raise InputError(f"{self.path} has no topic {path!r}; it has {', '.join(self.topics) or 'none'}")
        return self.topics[path]

    def _column(self, topic: Topic, name: str) -> int:
        if name not in topic.names:
            raise InputError(f"topic {topic.path} has no signal {name!r}; it has {', '.join(topic.names)}")
        return topic.names.index(name)

    def _values(
        self, data: bytes, offsets: NDArray[np.uint64], signals: int, columns: Sequence[int]
    ) -> NDArray[np.float64]:
        """Samples of ``columns`` from the Message records at ``offsets``, shape (columns, rows).

        Of each field a view with an element at every byte of the chunk is made, of which the wanted ones are taken.
        """
        record = message_dtype(signals)
        if int(offsets.max()) + record.itemsize > len(data):
            raise self._damaged("a message index points beyond its chunk")

        def field(at: int, dtype: str) -> NDArray[Any]:
            room = len(data) - record.itemsize + 1
            taken: NDArray[Any] = np.ndarray((room,), dtype, data, offset=at, strides=(1,))[offsets]
            return taken

        length_at = record.fields["length"][1]  # type: ignore[index]
        intact = field(length_at, "<u8") == record.itemsize - _HEAD.size
        values = np.empty((len(columns), len(offsets)))
        starts = MESSAGE_HEAD_BYTES + FIELD_BYTES * np.arange(signals)
        for tag, start in zip(tags(signals), starts.tolist(), strict=True):
            intact &= field(start, "u1") == tag
        for row, column in enumerate(columns):
            values[row] = field(int(starts[column]) + 1, "<f8")
        if not intact.all():
            raise self._damaged("samples are not in the layout of cls-bench")
        return values

    def _damaged(self, what: str) -> InputError:
        return InputError(f"{self.path} is damaged: {what}")

    def _load(self, file: IO[bytes], chunk: _Chunk) -> bytes:
        """The uncompressed records of a chunk."""
        file.seek(chunk.offset)
        try:
            data = zstandard.decompress(file.read(chunk.length), max_output_size=chunk.size)
        except zstandard.ZstdError:
            raise self._damaged(f"chunk at {chunk.start_ns / 1e9:.4f} s cannot be decompressed") from None
        if zlib.crc32(data) != chunk.crc:
            raise self._damaged(f"checksum of the chunk at {chunk.start_ns / 1e9:.4f} s")
        return data

    def _index(self, file: IO[bytes], chunk: _Chunk, channel: int) -> Index:
        """Times and offsets of a channel's messages in a chunk."""
        if channel in chunk.indexes:
            offset, length = chunk.indexes[channel]
            file.seek(offset)
            return np.frombuffer(file.read(length), "<u8").reshape(-1, 2)
        if chunk.indexed:
            return np.zeros((0, 2), "<u8")
        return _walk(self._load(file, chunk), channel)

    def _scan(self, file: IO[bytes]) -> None:
        """Note what lies where, up to the footer or the last complete record."""
        end = file.seek(0, 2)
        at = len(MCAP0_MAGIC)
        schemas: dict[int, Schema] = {}
        while at + _HEAD.size <= end:
            file.seek(at)
            head = file.read(_HEAD_BYTES)
            opcode, length = _HEAD.unpack_from(head)
            body = at + _HEAD.size
            if body + length > end:
                return
            if opcode not in (Opcode.CHUNK, Opcode.MESSAGE_INDEX) and self._chunks:
                self._chunks[-1].indexed = True
            match opcode:
                case Opcode.SCHEMA:
                    schema = self._parse(Schema.read, file, body, length)
                    schemas[schema.id] = schema
                case Opcode.CHANNEL:
                    self._add_channel(self._parse(Channel.read, file, body, length), schemas)
                case Opcode.METADATA:
                    metadata = self._parse(Metadata.read, file, body, length)
                    self._metadata[metadata.name] = metadata.metadata
                case Opcode.ATTACHMENT:
                    attachment = self._parse(Attachment.read, file, body, length)
                    self.attachments[attachment.name] = attachment.data
                case Opcode.CHUNK:
                    self._add_chunk(head, body)
                case Opcode.MESSAGE_INDEX if self._chunks:
                    channel, entries = struct.unpack_from("<HI", head, _HEAD.size)
                    self._chunks[-1].indexes[channel] = (body + 6, entries)
                case Opcode.DATA_END | Opcode.FOOTER:  # the summary repeats what is known by now
                    self.truncated = not _ends_well(file, end)
                    return
                case 0:  # no opcode: zeros that a crash left behind
                    return
            at = body + length

    def _parse(self, read: Callable[[ReadDataStream], _Record], file: IO[bytes], body: int, length: int) -> _Record:
        file.seek(body)
        try:
            return read(ReadDataStream(BytesIO(file.read(length))))
        except (McapError, struct.error, UnicodeDecodeError):
            raise self._damaged(f"record at byte {body}") from None

    def _add_channel(self, channel: Channel, schemas: Mapping[int, Schema]) -> None:
        self._channels[channel.topic] = channel.id
        if "ticks" not in channel.metadata:
            return
        names = foxglove.field_names(schemas[channel.schema_id].data)
        about = channel.metadata
        signals = tuple(Signal(name, about[f"{name}.unit"], about[f"{name}.meaning"]) for name in names)
        self.topics[channel.topic] = Topic(channel.topic, int(about["ticks"]), about["meaning"], signals)

    def _add_chunk(self, head: bytes, body: int) -> None:
        if self._chunks:
            self._chunks[-1].indexed = True
        start_ns, end_ns, size, crc, name_length = _CHUNK_HEAD.unpack_from(head, _HEAD.size)
        at = _HEAD.size + _CHUNK_HEAD.size
        if head[at : at + name_length] != b"zstd":
            raise self._damaged("a chunk is not compressed with zstd")
        (length,) = struct.unpack_from("<Q", head, at + name_length)
        self._chunks.append(_Chunk(body + at - _HEAD.size + name_length + 8, length, start_ns, end_ns, size, crc))


def _payload(data: bytes, offset: int) -> bytes:
    """Data of the Message record at ``offset`` of an uncompressed chunk."""
    _, length = _HEAD.unpack_from(data, offset)
    return data[offset + MESSAGE_HEAD_BYTES : offset + _HEAD.size + length]


def _ends_well(file: IO[bytes], end: int) -> bool:
    file.seek(end - len(MCAP0_MAGIC))
    return file.read() == MCAP0_MAGIC


def _next_tick(time: float) -> int:
    """First tick at or after ``time`` [s], forgiving the rounding of decimal fractions."""
    return int(np.ceil(round(time * 1e9 / TICK_NS, 6)))


def _walk(data: bytes, channel: int) -> Index:
    """The index of a channel's messages, from the records themselves."""
    return np.array([entry for entry in _messages(data, channel)], "<u8").reshape(-1, 2)


def _messages(data: bytes, channel: int) -> Iterator[tuple[int, int]]:
    at = 0
    while at < len(data):
        opcode, length = _HEAD.unpack_from(data, at)
        if opcode == Opcode.MESSAGE:
            found, _, time = struct.unpack_from("<HIQ", data, at + _HEAD.size)
            if found == channel:
                yield time, at
        at += _HEAD.size + length
