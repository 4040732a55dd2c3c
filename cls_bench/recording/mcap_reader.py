"""Reads recordings: topics as numpy arrays, chunk by chunk."""

import importlib
import json
import re
import threading
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import IO, Any, NamedTuple, TypeVar

import numpy as np
from google.protobuf.message import DecodeError  # type: ignore[import-untyped]
from numpy.typing import NDArray

from cls_bench.errors import InputError
from cls_bench.recording import foxglove
from cls_bench.recording.clock import clock_of
from cls_bench.recording.mcap_file import UNKNOWN_NS, Chunk, DamagedError, McapFile, Messages
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
from cls_bench.recording.samples import decode
from cls_bench.recording.seal import SEAL_KEY, SEAL_METADATA, seal_of
from cls_bench.signals import (
    EVENTS_TOPIC,
    MOST_STAGES,
    Block,
    Clock,
    Column,
    Event,
    Signal,
    Topic,
    axes_of,
    axis_of,
    is_axis,
    topics,
)
from cls_bench.text import printable

INCOMPLETE = "incomplete"
"""Status of a recording whose run was killed."""

READERS = 2
"""Chunks that are unpacked at once: more would hold more memory."""

PIECE_NS = 1_000_000_000
"""Where chunks overlap in time, blocks are put together piece by piece of this length."""

CACHE_BYTES = 128 << 20
"""Unpacked chunks that are kept while blocks are put together from chunks that overlap in time."""

LONGEST_BLOCK = 1 << 16
"""Ticks of a block that is put together; our own are shorter."""

MOST_AXES = 8
"""Axes of a bench that are read."""

LONGEST_TEXT = 1000
"""Characters of a text in the file, such as an event's, that are shown."""

_NAMES = {topic.path.strip("/"): topic.names for topic in topics(stages=MOST_STAGES)}
"""Signals that a topic of an axis can have."""

Times = NDArray[np.uint64]
_T = TypeVar("_T")
Array = NDArray[np.float64]

Poses = Array
"""Position [m] and quaternion w, x, y, z of each body, world first, shape (rows, bodies, 7)."""


class RecordingWarning(UserWarning):
    """Something is wrong with a recording that can be read all the same; see :attr:`Recording.doubts`."""


@dataclass(frozen=True)
class Series:
    """Signals of one topic over time."""

    time: Array
    """time since the start of the run, shape (rows,) [s]"""
    values: Mapping[str, Array]
    """signal name -> values, each of shape (rows,), in the signal's SI unit"""

    def __getitem__(self, signal: str) -> Array:
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


class Loss(NamedTuple):
    """A stretch of time that was recorded but cannot be read, or is missing."""

    start: float
    """[s]"""
    end: float
    """[s]"""
    reason: str


class _Channel(NamedTuple):
    """A channel with samples: its number, and field number -> name in its messages."""

    id: int
    fields: Mapping[int, str]


class _Wanted(NamedTuple):
    """What to read of a topic."""

    topic: Topic
    names: tuple[str, ...]
    every: int = 1


_Part = tuple[Times, Array]
"""Times [ns] and samples, shape (signals, rows)."""


class Recording:
    """A recording made by :class:`McapRecorder`, complete, cut short, or written again by other tools.

    Opening it reads the heads of all records; :meth:`read` and :meth:`events` then hold one chunk at a time. Raises
    :class:`InputError` if there is no such file or it is no recording. A chunk that is damaged costs what is in it and
    a :class:`RecordingWarning`; so does a file that was cut short, whose ``truncated`` is then true, unless it is known
    to be ``unfinished``.
    """

    def __init__(self, path: Path, *, unfinished: bool = False):
        self.path = path
        self._file = McapFile(path)
        self._lock = threading.Lock()
        self._said: set[str] = set()
        self._gaps: dict[str, str] = {}
        self._verified = False
        self.truncated = self._file.truncated
        self.topics: dict[str, Topic] = {}
        """topics of signals in the file, with units and meanings as recorded"""
        self.attachments: dict[str, bytes] = self._file.attachments
        """name -> content: scenario.toml, parameters.json and the model files"""
        self.clock: Clock
        """rates of the run, as the file says them"""
        self._samples: dict[str, list[_Channel]] = {}
        self._others: dict[str, list[int]] = {}
        self._find_topics()
        if not self.topics and self._file.library != "cls-bench":
            cut = ", or was cut short before them" if self.truncated else ""
            raise InputError(f"{path}: not a recording of cls-bench: it has none of its topics{cut}")
        self._chunks = sorted(self._file.chunks, key=lambda chunk: chunk.start_ns)
        if self.truncated and not unfinished:
            self._warn("it was cut short; reading its complete chunks")
        for fault in self._file.faults:
            self._warn(fault)
        self._warn_of_lost_chunks()

    # --- what it says about its run ----------------------------------------------------------------------------------

    @property
    def all_metadata(self) -> Mapping[str, Mapping[str, str]]:
        """All metadata records by name."""
        return self._file.metadata

    @property
    def metadata(self) -> Mapping[str, str]:
        """Seed, versions, … and ``scenario``, the scenario's name."""
        return self._file.metadata.get(RUN_METADATA, {})

    @property
    def scenario_name(self) -> str:
        """Name of the scenario; empty if the file was cut before it."""
        return self.metadata.get("scenario", "")

    @property
    def wall_start(self) -> str:
        """Wall-clock time of the start, ISO 8601; empty if the file was cut before it."""
        return self._file.metadata.get(WALL_CLOCK_METADATA, {}).get("start", "")

    @property
    def wall_end(self) -> str:
        """Wall-clock time of the end, ISO 8601; empty if the run was killed."""
        return self._file.metadata.get(WALL_CLOCK_END_METADATA, {}).get("end", "")

    @property
    def result(self) -> Mapping[str, str]:
        """The closing record: ``status`` and, as they were when the run ended, ``verdict`` and ``checks``."""
        return self._file.metadata.get(RESULT_METADATA, {})

    @property
    def status(self) -> str:
        """What was passed to ``finish``, or ``"incomplete"`` if the run was killed."""
        return printable(self.result.get("status", INCOMPLETE), LONGEST_TEXT)

    @property
    def parameters(self) -> Any:
        """The parameters of the run as nested dictionaries. InputError if they are damaged."""
        try:
            found = json.loads(self.attachments.get(PARAMETERS_ATTACHMENT, b"{}"))
        except (ValueError, RecursionError):
            found = None
        if not isinstance(found, dict):
            raise self._damaged(f"{PARAMETERS_ATTACHMENT} is no JSON object")
        return found

    @property
    def duration(self) -> float:
        """Time from the start of the run to the end of the last tick that was recorded and can be read [s].

        Of a recording with fewer samples, the run may have gone on for a part of their interval after the last.
        """
        ends = [chunk.end_ns for chunk in self._chunks if not chunk.lost]
        end = max(ends) // self.clock.tick_ns + 1 if ends else 0
        text = self.result.get("ticks", "")
        ticks = int(text) if re.fullmatch("[0-9]{1,9}", text) else 0
        slowest = max((topic.ticks for topic in self.topics.values()), default=1)
        return self.clock.time(ticks if 0 < ticks - end < slowest else end)

    # --- what is wrong with it ---------------------------------------------------------------------------------------

    def verify(self) -> None:
        """Read all samples once, so that :attr:`losses` and :attr:`doubts` are complete."""
        if self._verified:
            return
        self._verified = True
        wanted = [_Wanted(topic, topic.names) for topic in self.topics.values()]

        def look(messages: Messages) -> None:
            for part in wanted:
                self._part(messages, part, 0, None)

        self._each_chunk(self._chosen(0, None), look)

    def require_samples(self) -> None:
        """Raise InputError unless there are samples, as far as was read."""
        if any(chunk.channels is None and not chunk.indexes for chunk in self._chunks):
            self.verify()  # what is not indexed says what it holds once it was read
        own = {channel.id for channels in self._samples.values() for channel in channels}
        good = [chunk for chunk in self._chunks if not chunk.lost]
        if not any(own & (chunk.indexes.keys() if chunk.channels is None else chunk.channels) for chunk in good):
            lost = any(chunk.lost for chunk in self._chunks)
            why = "all of its chunks are damaged" if lost else "the run ended before the first were written"
            raise InputError(f"{self.path}: holds no samples: {why}")

    @property
    def losses(self) -> tuple[Loss, ...]:
        """What is lost, in order of time, as far as was read."""
        good = [chunk for chunk in self._chunks if not chunk.lost]
        lost = [chunk for chunk in self._chunks if chunk.lost]
        tick_ns = self.clock.tick_ns
        period = max((topic.ticks for topic in self.topics.values()), default=1) * tick_ns
        found = []
        end = good[0].start_ns if good else 0
        for chunk in good:
            if chunk.start_ns > end + period:
                inside = [other for other in lost if end < other.start_ns < chunk.start_ns]
                inside = inside or [other for other in lost if other.start_ns == UNKNOWN_NS][:1]
                lost = [other for other in lost if all(other is not there for there in inside)]
                reason = inside[0].lost if inside else "nothing was found there"
                found.append(Loss((end + tick_ns) / 1e9, chunk.start_ns / 1e9, reason))
            end = max(end, chunk.end_ns)
        for other in lost:
            if other.start_ns == UNKNOWN_NS:  # it may have been anywhere that nothing else tells of
                found.append(Loss(0.0, (end + tick_ns) / 1e9, f"somewhere; {other.lost}"))
            else:
                found.append(Loss(other.start_ns / 1e9, (other.end_ns + tick_ns) / 1e9, other.lost))
        return tuple(sorted(found))

    @cached_property
    def _seal_is_broken(self) -> bool:
        seal = self._file.metadata.get(SEAL_METADATA, {}).get(SEAL_KEY)
        return seal is not None and seal != seal_of(self._file.metadata, self.attachments)

    @property
    def doubts(self) -> tuple[str, ...]:
        """What is wrong with the file, as far as was read, one line each."""
        lines = [f"the file was cut short: it ends at {self.duration:g} s"] if self.truncated else []
        lines += self._file.faults
        lines += [f"samples from {start:g} to {end:g} s are lost: {reason}" for start, end, reason in self.losses]
        lines += self._gaps.values()
        if self._seal_is_broken:
            lines.append("what the file says about its run was changed after the run: its seal is broken")
        return tuple(printable(line, LONGEST_TEXT) for line in lines)

    # --- what it holds -----------------------------------------------------------------------------------------------

    def events(self) -> tuple[Event, ...]:
        """All events in order of time. InputError if one is damaged."""
        found = []
        for time, sequence, payload in self._payloads(EVENTS_TOPIC):
            try:
                event = foxglove.parse_log(payload, time // self.clock.tick_ns, self.clock.tick_ns)
            except (DecodeError, UnicodeDecodeError):
                raise self._damaged(f"the event at {time / 1e9:g} s cannot be read") from None
            source, message = (printable(text, LONGEST_TEXT) for text in (event.source, event.message))
            found.append((time, sequence, replace(event, source=source, message=message)))
        found.sort(key=lambda entry: entry[:2])
        return tuple(event for _, _, event in found)

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
        :class:`InputError` for an unknown topic or signal. What is in damaged chunks is left out, with a warning.
        """
        if every < 1:
            raise InputError(f"every = {every}: must be at least 1")
        known = self._topic(topic)
        names = known.names if signals is None else tuple(signals)
        self._require(known, names)
        return self._series([_Wanted(known, names, every)], start, end)[0]

    def samples_at(self, signal: str, ticks: range) -> Column:
        """Samples of ``/topic.name`` at ``ticks``, multiples of their step and the topic's; what is lost is left out.

        Raises :class:`InputError` for an unknown topic or signal.
        """
        path, _, name = signal.rpartition(".")
        topic = self._topic(path)
        self._require(topic, [name])
        tick_ns = self.clock.tick_ns
        wanted = _Wanted(topic, (name,), ticks.step // topic.ticks)
        times, values = self._read([wanted], ticks.start * tick_ns, ticks.stop * tick_ns)[0]
        return Column((times // np.uint64(tick_ns)).astype(np.int64), values[0])

    def read_all(self, start: float | None = None, end: float | None = None) -> dict[str, Series]:
        """All signals of all topics with start ≤ time < end [s], by topic: each chunk is unpacked just once."""
        wanted = [_Wanted(topic, topic.names) for topic in self.topics.values()]
        return dict(zip(self.topics, self._series(wanted, start, end), strict=True))

    def blocks(self) -> Iterator[Block]:
        """The run as blocks of all :attr:`known_topics`, with poses and events; as it was recorded, unless rewritten.

        A signal that is not in the file is NaN; one with fewer samples than usual is held from one to the next. A block
        ends where samples are lost.
        """
        self.verify()
        events = self.events()
        bodies = len(self._body_names)
        chunks = self._chosen(0, None)
        with self._file.open() as file:
            cache: dict[int, Messages] = {}
            for start_ns, end_ns in _pieces(chunks):
                inside = [chunk for chunk in chunks if chunk.start_ns < end_ns and chunk.end_ns >= start_ns]
                found = self._cached(file, cache, inside)
                parts = {
                    topic.path: self._joined(
                        topic.path, [self._part(messages, _Wanted(topic, topic.names), start_ns, end_ns)
                                     for messages in found],
                    )
                    for topic in self.topics.values()
                }  # fmt: skip
                poses = self._poses_in(found, start_ns, end_ns)
                yield from self._blocks(parts, poses, bodies, events)

    def poses(self, start: float | None = None, end: float | None = None) -> tuple[Array, Poses]:
        """Times [s] and poses of the bodies with start ≤ time < end [s], as in :class:`cls_bench.signals.Block`."""
        start_ns, end_ns = self._span(start, end)
        chosen = self._chosen(start_ns, end_ns)
        found = self._each_chunk(chosen, lambda messages: self._poses_in([messages], start_ns, end_ns))
        times = np.concatenate([np.zeros(0, np.uint64), *(part[0] for part in found)])
        order = np.argsort(times, kind="stable")
        rows = [part[1] for part in found if len(part[0])]
        return times[order] / 1e9, np.concatenate(rows)[order] if rows else np.zeros((0, 1, 7))

    def run_info(self) -> RunInfo:
        """What the recording says about its run besides the samples, shapes of the bodies included."""
        attachments = dict(self.attachments)
        scenario = attachments.pop(SCENARIO_ATTACHMENT, b"")
        attachments.pop(PARAMETERS_ATTACHMENT, None)
        scene = next((payload for _, _, payload in self._payloads(SCENE_TOPIC)), b"")
        bodies = self._body_names
        try:
            geoms = foxglove.parse_scene(scene, bodies) if scene else ()
        except (DecodeError, ValueError, OverflowError):
            raise self._damaged("the shapes of the bodies cannot be read") from None
        return RunInfo(
            scenario_name=printable(self.scenario_name, LONGEST_TEXT),
            scenario_toml=scenario,
            mjcf=attachments,
            parameters=self.parameters,
            metadata={name: text for name, text in self.metadata.items() if name != "scenario"},
            wall_start=self.wall_start,
            body_names=bodies,
            geoms=geoms,
            clock=self.clock,
        )

    # --- topics ------------------------------------------------------------------------------------------------------

    def _find_topics(self) -> None:
        """Clock and topics of the file; of one that is recorded in several channels, the first says what it is."""
        own = []
        for channel in self._file.channels.values():
            if channel.message_encoding != "protobuf":
                continue
            schema = self._file.schemas.get(channel.schema_id)
            if schema is None or not schema.name.startswith(f"{foxglove.PACKAGE}."):
                self._others.setdefault(channel.topic, []).append(channel.id)
            else:
                own.append((channel, schema))
        try:
            self.clock = clock_of(channel.metadata for channel, _ in own)
        except ValueError as error:
            raise self._damaged(f"its clock cannot be understood: {error}") from None
        for channel, schema in own:
            try:
                fields = foxglove.double_fields(schema.data, schema.name)
                ticks = int(channel.metadata["ticks"])
            except (DecodeError, KeyError, ValueError):
                fields, ticks = {}, 0
            path = channel.topic
            known_names = _NAMES.get(path.rpartition("/")[2])
            if not self._file.vouched and known_names:  # a letter of a name may have changed
                strange = [name for name in fields.values() if name not in known_names]
                fields = {number: name for number, name in fields.items() if name not in strange}
                for name in strange:
                    self._file.faults.append(f'{path} has no signal "{printable(name, 100)}": it is left out')
            if not fields or not 1 <= ticks <= 1_000_000 or path != printable(path):
                raise self._damaged(f'topic "{printable(path, 100)}" cannot be understood')
            about = {key: printable(text, LONGEST_TEXT) for key, text in channel.metadata.items()}
            signals = tuple(
                Signal(name, about.get(f"{name}.unit", ""), about.get(f"{name}.meaning", ""))
                for name in fields.values()
            )
            topic = Topic(path, ticks, about.get("meaning", ""), signals, self.clock.tick_ns)
            known = self.topics.setdefault(path, topic)
            if (known.ticks, known.names) != (topic.ticks, topic.names):
                raise self._damaged(f"topic {path} is there twice, in different ways")
            self._samples.setdefault(path, []).append(_Channel(channel.id, fields))
        axes = axes_of(self.topics.values())
        order = {topic.path: number for number, topic in enumerate(topics(stages=MOST_STAGES))}

        def place(path: str) -> tuple[int, int]:
            axis = axis_of(path)
            return axes.index(axis), order.get(path.removeprefix(f"/{axis}") if axis else path, len(order))

        self.topics = dict(sorted(self.topics.items(), key=lambda item: place(item[0])))

    @cached_property
    def known_topics(self) -> tuple[Topic, ...]:
        """What was simulated, as far as the file tells: all topics of each axis that is there, at their own rates."""
        found: list[Topic] = []
        axes = [axis for axis in axes_of(self.topics.values()) if not axis or is_axis(axis)]
        if len(axes) > MOST_AXES:
            raise InputError(f"{self.path}: has {len(axes)} axes, {MOST_AXES} at most are read")
        for axis in axes:
            gearbox = self.topics.get(f"/{axis}/gearbox" if axis else "/gearbox")
            numbers = [re.match("stage([1-9])_", name) for name in gearbox.names] if gearbox else []
            stages = max((int(number[1]) for number in numbers if number), default=0)
            own = topics(self.clock, min(stages, MOST_STAGES), axis)
            found += own if any(topic.path in self.topics for topic in own) else ()
        return tuple(found)

    def _topic(self, path: str) -> Topic:
        if path not in self.topics:
            raise InputError(f"{self.path} has no topic {path!r}; it has {', '.join(self.topics) or 'none'}")
        return self.topics[path]

    @staticmethod
    def _require(topic: Topic, names: Iterable[str]) -> None:
        for name in names:
            if name not in topic.names:
                raise InputError(f"topic {topic.path} has no signal {name!r}; it has {', '.join(topic.names)}")

    # --- chunks ------------------------------------------------------------------------------------------------------

    def _damaged(self, what: str) -> InputError:
        return InputError(f"{self.path}: damaged: {what}")

    def _warn(self, line: str) -> None:
        with self._lock:
            if line in self._said:
                return
            self._said.add(line)
        warnings.warn(f"{self.path}: {printable(line, LONGEST_TEXT)}", RecordingWarning, stacklevel=4)

    def _warn_of_lost_chunks(self) -> None:
        for chunk in self._chunks:
            if chunk.lost and chunk.start_ns == UNKNOWN_NS:
                self._warn(f"a chunk is lost: {chunk.lost}")
            elif chunk.lost:
                start, end = chunk.start_ns / 1e9, (chunk.end_ns + self.clock.tick_ns) / 1e9
                self._warn(f"the chunk from {start:g} to {end:g} s is lost: {chunk.lost}")

    def _chosen(self, start_ns: int, end_ns: int | None) -> list[Chunk]:
        """The chunks that can be read and may hold messages of that time."""
        return [
            chunk for chunk in self._chunks
            if not chunk.lost and chunk.channels != frozenset()
            and chunk.end_ns >= start_ns and (end_ns is None or chunk.start_ns < end_ns)
        ]  # fmt: skip

    def _each_chunk(self, chunks: Sequence[Chunk], take: Callable[[Messages], _T]) -> list[_T]:
        """``take`` of each of ``chunks`` that is not damaged."""

        def taken_from(chunk: Chunk) -> list[_T]:
            with self._file.open() as file:
                try:
                    return [take(self._file.load(file, chunk))]
                except DamagedError as error:
                    chunk.lost = str(error)
                    return []

        with ThreadPoolExecutor(READERS) as pool:  # unpacking, checksum and copying release the interpreter
            found = [part for parts in pool.map(taken_from, chunks) for part in parts]
        self._warn_of_lost_chunks()
        return found

    def _cached(self, file: IO[bytes], cache: dict[int, Messages], chunks: Sequence[Chunk]) -> list[Messages]:
        """The messages of ``chunks``; those that fit are kept in ``cache`` for the next call, all others dropped."""
        for key in cache.keys() - {id(chunk) for chunk in chunks}:
            del cache[key]
        found = []
        for chunk in chunks:
            messages = cache.get(id(chunk))
            if messages is None:
                try:
                    messages = self._file.load(file, chunk)
                except DamagedError:
                    continue
                if sum(len(other.data) for other in cache.values()) < CACHE_BYTES:
                    cache[id(chunk)] = messages
            found.append(messages)
        self._warn_of_lost_chunks()
        return found

    def _payloads(self, topic: str) -> Iterator[tuple[int, int, bytes]]:
        """Time [ns], sequence number and data of the messages of a topic that is no topic of signals."""
        channels = self._others.get(topic, ())
        with self._file.open() as file:
            for chunk in self._chunks if channels else ():
                if chunk.lost or (chunk.channels is not None and chunk.channels.isdisjoint(channels)):
                    continue
                try:
                    messages = self._file.load(file, chunk)
                except DamagedError:
                    continue
                for channel in channels:
                    yield from messages.payloads(channel)
        self._warn_of_lost_chunks()

    # --- samples -----------------------------------------------------------------------------------------------------

    def _series(self, wanted: Sequence[_Wanted], start: float | None, end: float | None) -> list[Series]:
        """Samples of all of ``wanted`` with start ≤ time < end [s]."""
        found = self._read(wanted, *self._span(start, end))
        return [
            Series(times / 1e9, dict(zip(part.names, values, strict=True)))
            for part, (times, values) in zip(wanted, found, strict=True)
        ]

    def _read(self, wanted: Sequence[_Wanted], start_ns: int, end_ns: int | None) -> list[_Part]:
        """Samples of all of ``wanted``, in one pass over the chunks."""
        found = self._each_chunk(
            self._chosen(start_ns, end_ns),
            lambda messages: [self._part(messages, part, start_ns, end_ns) for part in wanted],
        )
        return [
            self._joined(part.topic.path, [chunk[number] for chunk in found], len(part.names))
            for number, part in enumerate(wanted)
        ]

    def _joined(self, topic: str, parts: Sequence[_Part], signals: int = 0) -> _Part:
        """The parts in order of time. InputError if there are two samples of one time."""
        times = np.concatenate([np.zeros(0, np.uint64), *(part[0] for part in parts)])
        values = np.concatenate([part[1] for part in parts], axis=1) if parts else np.zeros((signals, 0))
        if not (times[1:] > times[:-1]).all():
            order = np.argsort(times, kind="stable")
            times, values = times[order], values[:, order]
            twice = np.flatnonzero(times[1:] == times[:-1])
            if len(twice):
                raise self._damaged(f"there are two samples of {topic} at {times[twice[0]] / 1e9:g} s")
        return times, values

    def _part(self, messages: Messages, wanted: _Wanted, start_ns: int, end_ns: int | None) -> _Part:
        """Times and samples of ``wanted`` in a chunk. Raises DamagedError."""
        topic = wanted.topic
        parts: list[_Part] = []
        for channel in self._samples[topic.path]:
            index = messages.of(channel.id)
            times = index[:, 0]
            if len(times) and (times % np.uint64(topic.ticks * topic.tick_ns)).any():
                raise DamagedError(f"it has samples of {topic.path} at times at which there are none")
            if len(times) and not (start_ns <= times[0] and (end_ns is None or times[-1] < end_ns) and _rise(times)):
                index = index[(times >= start_ns) & (True if end_ns is None else times < np.uint64(end_ns))]
            if wanted.every > 1:
                index = index[index[:, 0] % np.uint64(wanted.every * topic.ticks * topic.tick_ns) == 0]
            if not len(index):
                continue
            rows = {number: wanted.names.index(name) for number, name in channel.fields.items() if name in wanted.names}
            values = decode(messages.data, index[:, 1], rows, len(wanted.names))
            if values is None:
                raise DamagedError(f"its samples of {topic.path} cannot be read")
            if np.isnan(values).any():
                at = times[0] / 1e9
                self._gaps.setdefault(topic.path, f"a sample of {topic.path} is missing in the chunk from {at:g} s on")
                self._warn(self._gaps[topic.path])
            parts.append((index[:, 0], values))
        if len(parts) == 1:
            return parts[0]
        return self._joined(topic.path, parts, len(wanted.names))

    def _span(self, start: float | None, end: float | None) -> tuple[int, int | None]:
        """First time and time behind the last [ns]: ticks at or after, forgiving the rounding of decimal fractions."""
        tick_ns = self.clock.tick_ns

        def next_ns(time: float) -> int:
            return max(int(np.ceil(round(time * 1e9 / tick_ns, 6))), 0) * tick_ns

        return 0 if start is None else next_ns(start), None if end is None else next_ns(end)

    def _blocks(
        self, parts: Mapping[str, _Part], poses: tuple[Times, Poses], bodies: int, events: Sequence[Event]
    ) -> Iterator[Block]:
        """Blocks of the stretches of ``parts`` in which no sample of the fastest topic is missing."""
        tick_ns, pose_ticks = np.uint64(self.clock.tick_ns), self.clock.pose_ticks
        recorded = [self.topics[path] for path, (times, _) in parts.items() if len(times)]
        if not recorded:
            return
        fastest = min(recorded, key=lambda topic: topic.ticks)
        ticks = (parts[fastest.path][0] // tick_ns).astype(np.int64)
        posed = (poses[0] // tick_ns).astype(np.int64)
        for stretch in np.split(ticks, np.flatnonzero(np.diff(ticks) != fastest.ticks) + 1):
            begin, end = int(stretch[0]), int(stretch[-1]) + fastest.ticks
            for first in range(begin, end, LONGEST_BLOCK):
                count = min(end - first, LONGEST_BLOCK)
                signals = {known.path: _rows(known, self.topics, parts, first, count) for known in self.known_topics}
                wanted = np.arange(-(-first // pose_ticks) * pose_ticks, first + count, pose_ticks, dtype=np.int64)
                placed = np.full((len(wanted), bodies, 7), np.nan)
                _, ours, theirs = np.intersect1d(wanted, posed, return_indices=True)
                placed[ours] = poses[1][theirs]
                inside = tuple(event for event in events if first <= event.tick < first + count)
                yield Block(first, count, signals, placed, inside, self.clock, self.known_topics)

    # --- poses -------------------------------------------------------------------------------------------------------

    @cached_property
    def _body_names(self) -> tuple[str, ...]:
        """The bodies, world first."""
        first = next((payload for _, _, payload in self._payloads(TRANSFORMS_TOPIC)), b"")
        try:
            names = foxglove.parse_body_names(first) if first else (foxglove.WORLD,)
        except DecodeError:
            raise self._damaged("the poses of the bodies cannot be read") from None
        names = tuple(printable(name, 100) for name in names)
        if len(set(names)) < len(names) or len(names) > foxglove.MOST_BODIES:
            raise self._damaged(f"the poses are not those of a bench: {len(names)} bodies")
        return names

    def _poses_in(self, found: Iterable[Messages], start_ns: int, end_ns: int | None) -> tuple[Times, Poses]:
        """Times [ns] and poses in chunks, in order of time."""
        rows: list[tuple[int, list[list[float]]]] = []
        for messages in found:
            for channel in self._others.get(TRANSFORMS_TOPIC, ()):
                for time, _, payload in messages.payloads(channel, start_ns, end_ns):
                    try:
                        poses = foxglove.parse_transforms(payload)
                    except DecodeError:
                        poses = []
                    if len(poses) != len(self._body_names):
                        raise self._damaged(f"the poses at {time / 1e9:g} s cannot be read")
                    rows.append((time, poses))
        rows.sort(key=lambda row: row[0])
        times = np.array([time for time, _ in rows], np.uint64)
        return times, np.array([poses for _, poses in rows], np.float64).reshape(len(rows), len(self._body_names), 7)


def _rise(times: Times) -> bool:
    return bool((times[1:] > times[:-1]).all())


# --- blocks ----------------------------------------------------------------------------------------------------------


def _pieces(chunks: Sequence[Chunk]) -> Iterator[tuple[int, int]]:
    """Stretches of time [ns] in which chunks lie: each of its own, or where several overlap, pieces of a second."""
    k = 0
    while k < len(chunks):
        start, end, first = chunks[k].start_ns, chunks[k].end_ns, k
        while k + 1 < len(chunks) and chunks[k + 1].start_ns <= end:
            k += 1
            end = max(end, chunks[k].end_ns)
        k += 1
        if k - first == 1:
            yield start, end + 1
            continue
        step = max(PIECE_NS, -(-(end - start) // 1000 // PIECE_NS) * PIECE_NS)
        for piece in range(start // step * step, end + 1, step):
            yield max(piece, start), min(piece + step, end + 1)


def _rows(known: Topic, recorded: Mapping[str, Topic], parts: Mapping[str, _Part], first: int, count: int) -> Array:
    """Samples of a known topic at its ticks from ``first`` on, shape (rows, signals); NaN where there are none."""
    wanted = np.arange(-(-first // known.ticks) * known.ticks, first + count, known.ticks, dtype=np.int64)
    rows = np.full((len(wanted), len(known.signals)), np.nan)
    topic = recorded.get(known.path)
    if topic is None:
        return rows
    times, values = parts[known.path]
    ticks = (times // np.uint64(known.tick_ns)).astype(np.int64)
    low, high = np.searchsorted(ticks, (first, first + count))
    if topic.names == known.names and np.array_equal(ticks[low:high], wanted):
        return values[:, low:high].T
    place = np.searchsorted(ticks, wanted, side="right") - 1
    there = (place >= 0) & (wanted - ticks[np.maximum(place, 0)] < topic.ticks) if len(ticks) else place >= 0
    for column, name in enumerate(known.names):
        if name in topic.names:
            rows[there, column] = values[topic.names.index(name), place[there]]
    return rows
