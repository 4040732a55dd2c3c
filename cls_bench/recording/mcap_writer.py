"""Writes a run as MCAP: the recording of record.

The mcap library writes a Python object per message, which takes longer than simulating it. So the samples' Message
records come from numpy (:mod:`cls_bench.recording.layout`), a chunk for each block; all else is made of the library's
own record classes. The same run gives the same bytes, but for the metadata records with the wall
clock.

The file grows by whole chunks, each handed to the system at once: what ends a run, be it ``kill -9`` or a full disk,
costs the chunk that was under way.
"""

import itertools
import json
import struct
import zlib
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import zstandard
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Message,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)
from mcap.writer import MCAP0_MAGIC

from cls_bench.recording import foxglove
from cls_bench.recording.clock import CLOCK_KEY, clock_text
from cls_bench.recording.growing_file import GrowingFile
from cls_bench.recording.layout import Index, Samples
from cls_bench.recording.run_info import RunInfo
from cls_bench.recording.seal import SEAL_KEY, SEAL_METADATA, seal_of
from cls_bench.signals import EVENTS_TOPIC, Block, Clock, Topic
from cls_bench.text import utf8

TRANSFORMS_TOPIC = "/tf"
SCENE_TOPIC = "/scene"

RUN_METADATA = "run"
"""Metadata record with the scenario's name and :attr:`RunInfo.metadata`."""

WALL_CLOCK_METADATA = "wall_clock"
"""Metadata record with all that differs between equal runs."""

WALL_CLOCK_END_METADATA = "wall_clock_end"
"""Metadata record with the wall-clock time of the end."""

RESULT_METADATA = "result"
"""Closing metadata record, missing if the run was killed: ``status`` says how the run ended, ``verdict`` how it was
judged, ``checks`` is a JSON object of what was measured, ``ticks`` how far the run went."""

SCENARIO_ATTACHMENT = "scenario.toml"
PARAMETERS_ATTACHMENT = "parameters.json"


class McapRecorder:
    """An MCAP file that grows by one chunk with every block and is readable up to the last of them.

    Of ``topics``, made of those of the run, the signals and ticks they have are recorded; without ``poses`` neither the
    bodies' shapes nor their motion. Raises :class:`OSError` when the file cannot be created or written, ValueError for
    topics or blocks of another clock than the run's.
    """

    def __init__(self, path: Path, info: RunInfo, *, topics: Sequence[Topic], poses: bool = True):
        self._topics = tuple(topics)
        self._clock = info.clock
        if any(topic.tick_ns != self._clock.tick_ns for topic in self._topics):
            raise ValueError(f"the topics are of another clock than {self._clock}")
        self._has_poses = poses
        self._events_id, self._transforms_id, self._scene_id = (len(self._topics) + number for number in (1, 2, 3))
        self._schemas, self._channels = self._schemas_and_channels()
        self._attachments: list[McapRecord] = []
        self._metadata: list[McapRecord] = []
        self._chunks: list[McapRecord] = []
        self._counts = dict.fromkeys((channel.id for channel in self._channels), 0)
        self._start_ns, self._end_ns = 0, 0
        self._compressor = zstandard.ZstdCompressor(level=1)
        self._transforms = foxglove.Transforms(info.body_names)
        self._scene = foxglove.scene(info.body_names, info.geoms)
        self._said: dict[str, dict[str, str]] = {}  # what the seal covers
        self._attached: dict[str, bytes] = {}
        self._ticks = 0
        self._offset = 0
        self._file = GrowingFile(path)
        try:
            self._write(MCAP0_MAGIC)
            self._write_records(Header(profile="", library="cls-bench"), *self._schemas, *self._channels)
            self._write_metadata(RUN_METADATA, {"scenario": info.scenario_name, **info.metadata})
            self._write_metadata(WALL_CLOCK_METADATA, {"start": info.wall_start})
            self._write_attachments(info)
            self._file.flush()
        except BaseException:
            self.close()
            raise

    @property
    def written_ticks(self) -> int:
        """How many ticks of the run the file holds, whatever becomes of this process."""
        return self._ticks

    def write(self, block: Block) -> None:
        """Append ``block`` as a chunk and flush. Raises :class:`OSError` when the file cannot be written."""
        if block.clock != self._clock:
            raise ValueError(f"a block of {block.clock} in a recording at {self._clock}")
        self._append(block)
        self._ticks = block.end_tick

    def _append(self, block: Block) -> None:
        samples = Samples(self._topics, block)
        data, indexes = _insert(samples, self._extras(block), self._clock)
        indexes = {channel: index for channel, index in sorted(indexes.items()) if len(index)}
        if not indexes:
            return
        start_ns = min(int(index[0, 0]) for index in indexes.values())
        end_ns = max(int(index[-1, 0]) for index in indexes.values())
        self._start_ns = min(start_ns, self._start_ns) if self._chunks else start_ns
        self._end_ns = max(end_ns, self._end_ns)
        for channel, index in indexes.items():
            self._counts[channel] += len(index)
        chunk = Chunk(
            compression="zstd",
            data=self._compressor.compress(data),
            message_start_time=start_ns,
            message_end_time=end_ns,
            uncompressed_crc=zlib.crc32(data),
            uncompressed_size=len(data),
        )
        at = self._offset
        self._write_records(chunk)
        index_at = self._offset
        offsets = {channel: self._write(_message_index(channel, index)) for channel, index in indexes.items()}
        self._file.flush()
        self._chunks.append(
            ChunkIndex(
                chunk_start_offset=at,
                chunk_length=index_at - at,
                message_start_time=start_ns,
                message_end_time=end_ns,
                message_index_offsets=offsets,
                message_index_length=self._offset - index_at,
                compression=chunk.compression,
                compressed_size=len(chunk.data),
                uncompressed_size=chunk.uncompressed_size,
            )
        )

    def finish(
        self, status: str, wall_end: str = "", *, verdict: str = "", checks: Mapping[str, float | None] | None = None
    ) -> None:
        """Write ``status``, the summary and the footer, and close the file. Raises :class:`OSError`.

        ``wall_end`` is the wall-clock time, ISO 8601; recorded if given. ``verdict``, the status if left out, and
        ``checks`` are what the run was found to be; what it says of itself is sealed.
        """
        try:
            if wall_end:
                self._write_metadata(WALL_CLOCK_END_METADATA, {"end": wall_end})
            found = json.dumps(checks or {}, ensure_ascii=False, allow_nan=False)
            ticks = str(self._ticks)
            self._write_metadata(
                RESULT_METADATA, {"status": status, "verdict": verdict or status, "checks": found, "ticks": ticks}
            )
            self._write_metadata(SEAL_METADATA, {SEAL_KEY: seal_of(self._said, self._attached)})
            self._write_records(DataEnd(data_section_crc=0))
            self._write(self._summary(self._offset))
            self._write(MCAP0_MAGIC)
            self._file.flush()
            self._file.check_place()
        finally:
            self.close()

    def close(self) -> None:
        """Close the file as it is, without a summary; what was written stays readable."""
        self._file.close()

    def _extras(self, block: Block) -> list[Message]:
        """The messages of a block that are no samples, sorted by time."""
        found: list[tuple[int, int, bytes]] = []
        found += ((event.tick, self._events_id, foxglove.log(event)) for event in block.events)
        if self._has_poses:
            if not self._counts[self._scene_id]:
                found.insert(0, (block.first_tick, self._scene_id, self._scene))
            for tick, poses in zip(block.row_ticks(self._clock.pose_ticks).tolist(), block.poses, strict=True):
                found.append((tick, self._transforms_id, self._transforms(tick * self._clock.tick_ns, poses)))
        found.sort(key=lambda entry: entry[0])
        numbers = {channel: itertools.count(count) for channel, count in self._counts.items()}
        return [
            Message(
                channel_id=channel,
                sequence=next(numbers[channel]),
                log_time=tick * self._clock.tick_ns,
                publish_time=tick * self._clock.tick_ns,
                data=data,
            )
            for tick, channel, data in found
        ]

    def _schemas_and_channels(self) -> tuple[list[McapRecord], list[Channel]]:
        schemas: list[McapRecord] = []
        channels: list[Channel] = []

        def add(topic: str, name: str, schema: bytes, metadata: dict[str, str]) -> None:
            number = len(schemas) + 1
            metadata = {**metadata, CLOCK_KEY: clock_text(self._clock)}
            schemas.append(Schema(id=number, name=name, encoding="protobuf", data=schema))
            channels.append(
                Channel(id=number, topic=topic, message_encoding="protobuf", schema_id=number, metadata=metadata)
            )

        for topic in self._topics:
            add(topic.path, foxglove.message_name(topic), foxglove.topic_schema(topic), _topic_metadata(topic))
        others: list[tuple[str, Any, str]] = [(EVENTS_TOPIC, Log, "What happened during the run.")]
        if self._has_poses:
            others.append((TRANSFORMS_TOPIC, FrameTransforms, "Poses of the bodies in the world."))
            others.append((SCENE_TOPIC, SceneUpdate, "Shapes of the bodies, once."))
        for path, message, meaning in others:
            add(path, message.DESCRIPTOR.full_name, foxglove.library_schema(message), {"meaning": meaning})
        return schemas, channels

    def _write(self, data: bytes) -> int:
        """Write ``data``; returns the offset at which it starts."""
        at = self._offset
        self._file.write(data)
        self._offset += len(data)
        return at

    def _write_records(self, *records: McapRecord) -> int:
        return self._write(_serialized(records))

    def _write_metadata(self, name: str, metadata: dict[str, str]) -> None:
        metadata = {utf8(key): utf8(value) for key, value in metadata.items()}
        self._said[name] = metadata
        at = self._write_records(Metadata(name=name, metadata=metadata))
        self._metadata.append(MetadataIndex(offset=at, length=self._offset - at, name=name))

    def _write_attachments(self, info: RunInfo) -> None:
        parameters = json.dumps(info.parameters, indent=1, ensure_ascii=False).encode()
        self._write_attachment(SCENARIO_ATTACHMENT, "application/toml", info.scenario_toml)
        self._write_attachment(PARAMETERS_ATTACHMENT, "application/json", parameters)
        for name, content in info.mjcf.items():
            xml = name.endswith(".xml")
            self._write_attachment(name, "application/xml" if xml else "application/octet-stream", content)

    def _write_attachment(self, name: str, media_type: str, data: bytes) -> None:
        name = utf8(name)
        self._attached[name] = data
        attachment = Attachment(create_time=0, log_time=0, name=name, media_type=media_type, data=data)
        at = self._write_records(attachment)
        index = AttachmentIndex(
            offset=at,
            length=self._offset - at,
            create_time=0,
            log_time=0,
            name=name,
            media_type=media_type,
            data_size=len(data),
        )
        self._attachments.append(index)

    def _summary(self, start: int) -> bytes:
        """The summary section that begins at offset ``start``, and the footer."""
        counts = {channel: count for channel, count in self._counts.items() if count}
        statistics = Statistics(
            message_count=sum(counts.values()),
            schema_count=len(self._schemas),
            channel_count=len(self._channels),
            attachment_count=len(self._attachments),
            metadata_count=len(self._metadata),
            chunk_count=len(self._chunks),
            message_start_time=self._start_ns,
            message_end_time=self._end_ns,
            channel_message_counts=counts,
        )
        groups: tuple[tuple[Opcode, list[McapRecord]], ...] = (
            (Opcode.SCHEMA, self._schemas),
            (Opcode.CHANNEL, [*self._channels]),
            (Opcode.STATISTICS, [statistics]),
            (Opcode.CHUNK_INDEX, self._chunks),
            (Opcode.ATTACHMENT_INDEX, self._attachments),
            (Opcode.METADATA_INDEX, self._metadata),
        )
        summary = bytearray()
        offsets: list[McapRecord] = []
        for opcode, records in groups:
            data = _serialized(records)
            if data:
                offsets.append(SummaryOffset(opcode, start + len(summary), len(data)))
            summary += data
        offsets_at = start + len(summary)
        summary += _serialized(offsets)
        footer = Footer(summary_start=start, summary_offset_start=offsets_at, summary_crc=0)
        summary += _serialized([footer])[:-4]  # the CRC is the last field and covers all before it
        return bytes(summary + struct.pack("<I", zlib.crc32(summary)))


def _topic_metadata(topic: Topic) -> dict[str, str]:
    """What the schema cannot say, for readers and people."""
    metadata = {"meaning": topic.meaning, "ticks": str(topic.ticks)}
    for signal in topic.signals:
        metadata[f"{signal.name}.unit"] = signal.unit
        metadata[f"{signal.name}.meaning"] = signal.meaning
    return metadata


def _serialized(records: Iterable[McapRecord]) -> bytes:
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    return bytes(builder.end())  # type: ignore[no-untyped-call]


def _message_index(channel: int, index: Index) -> bytes:
    """A MessageIndex record; the library's own takes a Python call for every message."""
    entries = index.tobytes()
    return struct.pack("<BQHI", Opcode.MESSAGE_INDEX, 6 + len(entries), channel, len(entries)) + entries


def _insert(samples: Samples, extras: list[Message], clock: Clock) -> tuple[bytes, dict[int, Index]]:
    """Put each of ``extras``, sorted by time, before the samples of its tick; returns the chunk and its indexes."""
    if not extras:
        return samples.data, samples.indexes
    end = len(samples.data)
    places = [min(max(samples.position(extra.log_time // clock.tick_ns), 0), end) for extra in extras]
    records = [_serialized([extra]) for extra in extras]
    shifts = np.concatenate([[0], np.cumsum([len(record) for record in records])]).astype(np.uint64)
    pieces = [samples.data[: places[0]]]
    for record, place, until in zip(records, places, [*places[1:], end], strict=True):
        pieces += (record, samples.data[place:until])
    indexes = {}
    for channel, index in samples.indexes.items():
        shifted = index.copy()
        shifted[:, 1] += shifts[np.searchsorted(places, index[:, 1], side="right")]
        indexes[channel] = shifted
    for channel in {extra.channel_id for extra in extras}:
        entries = [
            (extra.log_time, place + int(shift))
            for extra, place, shift in zip(extras, places, shifts, strict=False)
            if extra.channel_id == channel
        ]
        indexes[channel] = np.array(entries, "<u8")
    return b"".join(pieces), indexes
