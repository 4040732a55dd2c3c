"""Recordings from anywhere: written again by other tools, of someone else, damaged, edited, hostile."""

import contextlib
import html
import json
import os
import random
import struct
import subprocess
import sys
import time
import tracemalloc
import warnings
import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import lz4.frame
import numpy as np
import pytest
import zstandard
from click.testing import CliRunner
from mcap.reader import make_reader
from mcap.writer import CompressionType, IndexType, Writer

from cls_bench import experiment
from cls_bench.cli import main
from cls_bench.errors import InputError
from cls_bench.recording import Recording
from cls_bench.recording.mcap_file import LIMITS
from cls_bench.recording.samples import decode
from cls_bench.recording.seal import SEAL_KEY, SEAL_METADATA, seal_of
from cls_bench.report.drawn_model import MODEL_FILES, model_xml
from cls_bench.report.recorded_run import NOT_MEASURED, RecordedRun
from cls_bench.scenario import parse_scenario
from cls_bench.signals import CLOCK, TOPICS, Event
from cls_bench.text import printable
from tests.attacks.mcap_mutations import join, split
from tests.test_recording import INFO, joined, make_block, make_blocks, record, same_bits

TICK_NS, TICK_S = CLOCK.tick_ns, CLOCK.tick_s

MAGIC = b"\x89MCAP0\r\n"
HEAD = struct.Struct("<BQ")
FOOTER, CHANNEL, CHUNK, INDEX, ATTACHMENT, METADATA, DATA_END = 2, 4, 6, 7, 9, 12, 15

TINY = """
title = "tiny"
duration = 0.42
[[hand]]
at = 0.0
kind = "ramp"
to_deg = 4.0
over = 0.2
[[checks]]
name = "early"
metric = "maximum"
signal = "/column.angle"
window = [0.02, 0.18]
min = 0.001
[[checks]]
name = "late"
metric = "mean"
signal = "/load_cell.torque"
window = [0.22, 0.38]
max = 1000.0
"""


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording of three chunks with a scenario of two checks."""
    folder = tmp_path_factory.mktemp("tiny")
    return experiment.run(parse_scenario(TINY, name="tiny"), out=folder, rerun=False).mcap


# ---------------------------------------------------------------------------------------------------------------------
# Tools for changing files


def records_of(content: bytes) -> list[tuple[int, bytes]]:
    found, at = [], len(MAGIC)
    while at + HEAD.size <= len(content) - len(MAGIC):
        opcode, length = HEAD.unpack_from(content, at)
        found.append((opcode, content[at + HEAD.size : at + HEAD.size + length]))
        at += HEAD.size + length
    return found


def joined_records(records: Sequence[tuple[int, bytes]]) -> bytes:
    """The file of these records, without a summary if they have a data section."""
    ends = places(records, DATA_END)
    if ends:
        records = [*records[: ends[0] + 1], (FOOTER, bytes(20))]
    return MAGIC + b"".join(HEAD.pack(opcode, len(body)) + body for opcode, body in records) + MAGIC


def unpacked(body: bytes) -> tuple[int, int, bytes]:
    """First and last time, and the records of a chunk."""
    start, end, size, _, name = struct.unpack_from("<QQQII", body)
    return start, end, zstandard.decompress(body[40 + name :], max_output_size=size)


def packed(start: int, end: int, data: bytes, compression: str = "zstd", **heads: int) -> bytes:
    make: dict[str, Callable[[bytes], bytes]] = {"zstd": zstandard.compress, "lz4": lz4.frame.compress, "": bytes}
    content, name = make[compression](data), compression.encode()
    head = (start, end, heads.get("size", len(data)), heads.get("crc", zlib.crc32(data)), len(name))
    return struct.pack("<QQQII", *head) + name + struct.pack("<Q", len(content)) + content


def text(value: str) -> bytes:
    return struct.pack("<I", len(value.encode())) + value.encode()


def metadata(name: str, entries: dict[str, str]) -> tuple[int, bytes]:
    body = b"".join(text(key) + text(value) for key, value in entries.items())
    return METADATA, text(name) + struct.pack("<I", len(body)) + body


def attachment(name: str, data: bytes) -> tuple[int, bytes]:
    body = bytes(16) + text(name) + text("x/y") + struct.pack("<Q", len(data)) + data
    return ATTACHMENT, body + struct.pack("<I", zlib.crc32(body))


def changed(source: Path, target: Path, change: Callable[[list[tuple[int, bytes]]], Any]) -> Path:
    """The file with its records changed in place by ``change``."""
    records = records_of(source.read_bytes())
    change(records)
    target.write_bytes(joined_records(records))
    return target


def places(records: Sequence[tuple[int, bytes]], opcode: int) -> list[int]:
    return [k for k, (found, _) in enumerate(records) if found == opcode]


def replace_named(records: list[tuple[int, bytes]], record: tuple[int, bytes], name: str) -> None:
    """Put ``record`` in the place of the attachment or metadata record ``name``, or before the end if there is none."""
    at = 16 if record[0] == ATTACHMENT else 0
    same = [k for k in places(records, record[0]) if records[k][1][at:].startswith(text(name))]
    if same:
        records[same[0]] = record
    else:
        records.insert(places(records, DATA_END)[0], record)


@contextlib.contextmanager
def quiet() -> Iterator[None]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


def opened(path: Path) -> Recording:
    with quiet():
        return Recording(path)


def opened_run(path: Path) -> RecordedRun:
    with quiet():
        return RecordedRun(path)


# ---------------------------------------------------------------------------------------------------------------------
# Written again by others


def without_zeros(data: bytes) -> bytes:
    """A message of doubles as proto3 writers make it: no field for what is 0."""
    parts = [data[k : k + 9] for k in range(0, len(data), 9)]
    return b"".join(part for part in parts if part[1:] != bytes(8))


def rewritten(
    source: Path, target: Path, *, order: str = "file", first: str = "about", ids: int = 0, sparse: bool = False,
    extra: bool = False, **options: Any,
) -> Path:  # fmt: skip
    """The recording written again by the library's writer."""
    with source.open("rb") as file, target.open("wb") as out:
        reader = make_reader(file)
        messages = list(reader.iter_messages(log_time_order=False))
        writer = Writer(out, **options)
        writer.start(library="another tool")
        for k in range(ids):  # other numbers for ours
            writer.register_channel(f"/nothing_{k}", "json", writer.register_schema(f"s{k}", "jsonschema", b"{}"))

        def write_about() -> None:
            for entry in reader.iter_attachments():
                writer.add_attachment(7, 7, entry.name, entry.media_type, entry.data)
            for entry in reader.iter_metadata():
                writer.add_metadata(entry.name, entry.metadata)

        if first == "about":
            write_about()
        numbers: dict[int, int] = {}
        if order == "topic":
            messages.sort(key=lambda m: m[1].topic)
        elif order == "shuffled":
            random.Random(1).shuffle(messages)
        for schema, channel, message in messages:
            if channel.id not in numbers:
                schema_id = writer.register_schema(schema.name, schema.encoding, schema.data) if schema else 0
                numbers[channel.id] = writer.register_channel(
                    channel.topic, channel.message_encoding, schema_id, channel.metadata
                )
            data = without_zeros(message.data) if sparse and "ticks" in channel.metadata else message.data
            if sparse and data is not message.data:
                data += b"\xa0\x06\x07"  # field 100, a varint, that this version does not know
            writer.add_message(numbers[channel.id], message.log_time, data, message.publish_time, message.sequence)
        if extra:
            schema_id = writer.register_schema("foxglove.Log", "protobuf", b"")
            number = writer.register_channel("/notes", "protobuf", schema_id, {"ticks": "3"})
            writer.add_message(number, 10**7, b"anything", 10**7)
            writer.add_message(writer.register_channel("/json", "json", 0), 0, b"{}", 0)
        if first != "about":
            write_about()
        writer.finish()
    return target


FORMS: dict[str, dict[str, Any]] = {
    "lz4": {"compression": CompressionType.LZ4},
    "not packed": {"compression": CompressionType.NONE},
    "no chunks": {"use_chunking": False},
    "no chunks, no summary": {
        "use_chunking": False, "repeat_channels": False, "repeat_schemas": False, "use_statistics": False,
        "use_summary_offsets": False, "index_types": IndexType.NONE,
    },
    "no index": {"index_types": IndexType.NONE, "chunk_size": 20_000},
    "no summary": {
        "repeat_channels": False, "repeat_schemas": False, "use_statistics": False, "use_summary_offsets": False,
        "index_types": IndexType.MESSAGE, "chunk_size": 20_000,
    },
    "no checksums": {"enable_crcs": False},
    "small chunks": {"chunk_size": 5000},
    "one chunk": {"chunk_size": 1 << 30},
    "attachments last": {"first": "messages"},
    "topic after topic": {"order": "topic", "chunk_size": 50_000},
    "shuffled": {"order": "shuffled", "chunk_size": 50_000},
    "shuffled, no chunks": {"order": "shuffled", "use_chunking": False},
    "other numbers": {"ids": 5},
    "zeros left out": {"sparse": True},
    "other topics": {"extra": True},
}  # fmt: skip


@pytest.mark.parametrize("form", FORMS)
def test_a_recording_written_again_in_another_form_is_the_same(form: str, tmp_path: Path) -> None:
    blocks = make_blocks((1400, 1, 7, 603, 0, 333))
    blocks[0].signals["/column"][::3, 1] = 0.0
    blocks[1].signals["/drive"][:] = 0.0
    blocks[3].signals["/feel"][:, 0] = -0.0
    source = Recording(record(tmp_path / "run.mcap", blocks, wall_end="2026-01-01T00:00:01+00:00"))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        recording = Recording(rewritten(source.path, tmp_path / "again.mcap", **FORMS[form]))
    recording.require_samples()  # before anything was read, as view asks
    assert recording.topics == source.topics and not recording.truncated
    assert (recording.doubts, recording.duration, recording.status) == ((), source.duration, "passed")
    assert recording.attachments == source.attachments and recording.metadata == source.metadata
    assert recording.events() == source.events()
    everything = recording.read_all()
    for topic in TOPICS:
        expected = joined(blocks, topic.path)
        part = recording.read(topic.path, topic.names[::-1], 0.03, 0.0901, every=2)
        theirs = source.read(topic.path, topic.names[::-1], 0.03, 0.0901, every=2)
        assert same_bits(part.time, theirs.time)
        for column, name in enumerate(topic.names):
            assert same_bits(everything[topic.path][name], expected[:, column]), (topic.path, name)
            assert same_bits(part[name], theirs[name])
    ticks, first = 0, 0
    for block in recording.blocks():
        assert block.first_tick == first
        first = block.end_tick
        ticks += block.ticks
        for topic, rows in block:
            assert same_bits(rows, joined(blocks, topic.path)[-(-block.first_tick // topic.ticks) :][: len(rows)])
        assert block.poses.shape == (len(block.row_ticks(200)), 3, 7) and np.isfinite(block.poses).all()
    assert ticks == blocks[-1].end_tick
    info = recording.run_info()
    assert info.body_names == INFO.body_names and len(info.geoms) == len(source.run_info().geoms) > 0
    for ours, theirs_ in zip(recording.poses(0.02, 0.07), source.poses(0.02, 0.07), strict=True):
        assert same_bits(ours, theirs_)


def test_a_run_written_again_has_the_same_checks_and_no_doubts(run: Path, tmp_path: Path) -> None:
    ours = opened_run(run)
    again = opened_run(rewritten(run, tmp_path / "again.mcap", compression=CompressionType.LZ4, order="topic"))
    assert [check.value for check in again.checks] == [check.value for check in ours.checks]
    assert (again.verdict, again.doubts) == (ours.verdict, ours.doubts) == ("passed", ())


def test_records_of_unknown_kinds_are_passed_over(run: Path, tmp_path: Path) -> None:
    def insert(records: list[tuple[int, bytes]]) -> None:
        for place in sorted(places(records, CHUNK) + places(records, METADATA), reverse=True):
            records.insert(place, (0x90, b"private" * 3))
        k = places(records, CHUNK)[0]
        start, end, data = unpacked(records[k][1])
        records[k] = (CHUNK, packed(start, end, HEAD.pack(0x81, 3) + b"abc" + data))

    recording = opened(changed(run, tmp_path / "x.mcap", insert))
    assert len(recording.read("/column")) == 8400
    recording.verify()
    assert recording.losses == ()


def test_decoding_of_fields_in_any_order() -> None:
    def message(payload: bytes) -> bytes:
        return HEAD.pack(5, 22 + len(payload)) + bytes(22) + payload

    def double(number: int, value: float) -> bytes:
        return bytes([number << 3 | 1]) + struct.pack("<d", value)

    payloads = [
        double(1, 1.5) + double(2, 2.5), double(2, 7.0), b"", double(2, -1.0) + double(1, -2.0),
        b"\x98\x06\x05" + double(1, 3.0), b"\x5a\x02ab" + double(2, 4.0), b"\x7d" + bytes(4) + double(1, 5.0),
        double(1, 1.0) + double(1, 9.0), double(3, 8.0) + double(2, 6.0),
    ]  # fmt: skip
    data, offsets = b"", []
    for payload in payloads:
        offsets.append(len(data))
        data += message(payload)
    found = decode(data, np.array(offsets, np.uint64), {1: 0, 2: 1}, 2)
    assert found is not None
    assert found.T.tolist() == [[1.5, 2.5], [0, 7], [0, 0], [-2, -1], [3, 0], [0, 4], [5, 0], [9, 0], [0, 6]]
    for damaged in (b"\x09\x00", b"\x0b" + bytes(8), b"\x01" + bytes(8), b"\xff" * 12, b"\x0a\xff\x01a", bytes(5000)):
        data = message(damaged)
        assert decode(data, np.zeros(1, np.uint64), {1: 0}, 1) is None, damaged


# ---------------------------------------------------------------------------------------------------------------------
# Someone else's, other versions', empty


def foreign_files(folder: Path) -> Iterator[Path]:
    for name, encoding, schema, about in (
        ("json", "json", ("stick", "jsonschema", b"{}"), {}),
        ("ticks", "json", ("x", "jsonschema", b"{}"), {"ticks": "5"}),
        ("no_schema", "json", None, {"ticks": "5"}),
        ("protobuf", "protobuf", ("x.Y", "protobuf", b"\n"), {"ticks": "1"}),
    ):  # fmt: skip
        for chunked in (False, True):
            path = folder / f"{name}_{chunked}.mcap"
            with path.open("wb") as file:
                writer = Writer(file, use_chunking=chunked)
                writer.start()
                schema_id = writer.register_schema(*schema) if schema else 0
                channel = writer.register_channel("/x", encoding, schema_id, about)
                writer.add_message(channel, 17 * 10**17, b"{}", 17 * 10**17)
                writer.finish()
            yield path
    bag = b"#ROSBAG V2.0\n" + bytes(100)
    for name, content in (("empty", b""), ("bag", bag), ("cut", MAGIC), ("text", b"hello")):
        path = folder / f"{name}.mcap"
        path.write_bytes(content)
        yield path
    yield folder
    yield Path("/dev/zero")
    fifo = folder / "fifo.mcap"
    os.mkfifo(fifo)
    yield fifo


def invoke(*arguments: object) -> Any:
    return CliRunner().invoke(main, [str(argument) for argument in arguments])


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no FIFOs here")
def test_files_of_others_are_told_in_one_line(tmp_path: Path) -> None:
    for path in foreign_files(tmp_path):
        for command in (("report", path), ("compare", path, path), ("view", path), ("render", path)):
            done = invoke(*command)
            assert done.exit_code == 2, (command, done.output, done.exception)
            assert done.stderr.startswith(f"error: {path}: not a recording of cls-bench: "), done.stderr
            assert done.stderr.count("\n") == 1


def test_a_recording_without_samples_is_told_in_one_line(tmp_path: Path) -> None:
    for status in ("passed", None):
        path = record(tmp_path / f"{status}.mcap", [], status=status)
        for command in (("report", path), ("compare", path, path), ("view", path), ("render", path)):
            done = invoke(*command)
            assert (done.exit_code, done.stderr) == (
                2, f"error: {path}: holds no samples: the run ended before the first were written\n",
            ), command  # fmt: skip


def test_arguments_are_looked_at_before_libraries(run: Path) -> None:
    script = (
        "import sys\n"
        "for name in ('mujoco', 'matplotlib', 'rerun', 'OpenGL'): sys.modules[name] = None\n"
        "import ctypes.util; ctypes.util.find_library = lambda name: None\n"
        "from cls_bench.cli import main; main(sys.argv[1:])"
    )
    for arguments, said in (
        (("missing.mcap",), "missing.mcap: no such file"),
        ((run, "--at", 9), "ends at 0.42 s; there is nothing at 9 s"),
        ((run, "--camera", "moon"), "valid: bench, side, pilot, drive"),
        ((run, "--at", "nan"), "nan is not a finite number"),
        ((run, "--video", "--from", 0.3, "--to", 0.2), "must start before it ends"),
        ((run, "--video", "--to", 7), "there is nothing at 7 s"), ((run.parent,), "it is a folder"),
    ):  # fmt: skip
        command = [sys.executable, "-c", script, "render", *map(str, arguments)]
        environment = {key: value for key, value in os.environ.items() if key != "MUJOCO_GL"}
        done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
        assert (done.returncode, done.stderr.count("\n")) == (2, 1), done.stderr
        assert done.stderr.startswith("error: ") and said in done.stderr


def test_fewer_and_more_topics_than_this_version_knows(run: Path, tmp_path: Path) -> None:
    with run.open("rb") as file, (tmp_path / "other.mcap").open("wb") as out:
        reader = make_reader(file)
        writer = Writer(out)
        writer.start()
        numbers: dict[str, int] = {}
        for schema, channel, message in reader.iter_messages():
            assert schema is not None
            if channel.topic in ("/gearbox", "/pilot"):
                continue
            if channel.topic not in numbers:
                number = writer.register_schema(schema.name, schema.encoding, schema.data)
                numbers[channel.topic] = writer.register_channel(channel.topic, "protobuf", number, channel.metadata)
                if channel.topic == "/feel":
                    numbers["/new"] = writer.register_channel("/new", "protobuf", number, channel.metadata)
            for topic in (channel.topic, *(["/new"] if channel.topic == "/feel" else [])):
                writer.add_message(numbers[topic], message.log_time, message.data, message.log_time, message.sequence)
        for entry in reader.iter_attachments():
            writer.add_attachment(0, 0, entry.name, entry.media_type, entry.data)
        writer.finish()
    other = opened_run(tmp_path / "other.mcap")
    assert "/new" in other.recording.topics and len(other.recording.read("/new")) == len(other.recording.read("/feel"))
    assert [check.value for check in other.checks] == [check.value for check in opened_run(run).checks]
    with pytest.raises(InputError, match=r"^[^\n]*has no topic '/pilot'; it has [^\n]*$"):
        other.recording.read("/pilot")
    done = invoke("report", other.path, "--out", tmp_path)
    assert done.exit_code == 0, done.output
    page = Path(done.stdout.strip()).read_text()
    assert "Not drawn: the whole run" in page and "/gearbox was not recorded as it was simulated" in page
    for block in other.recording.blocks():
        assert np.isnan(block.signals["/pilot"]).all() and np.isfinite(block.signals["/column"]).all()
        assert "/gearbox" not in block.signals  # nothing in the file says how many stages there were


# ---------------------------------------------------------------------------------------------------------------------
# Damage


def damaged_chunk(kind: str) -> Callable[[list[tuple[int, bytes]]], None]:
    """Damage the second of three chunks."""

    def change(records: list[tuple[int, bytes]]) -> None:
        k = places(records, CHUNK)[1]
        body = records[k][1]
        start, end, data = unpacked(body)
        bad = bytearray(body)
        if kind == "bits":
            bad[len(bad) // 2] ^= 1
        elif kind == "wrong checksum":
            bad[24] ^= 1
        elif kind == "unknown packing":
            bad[36:40] = b"zip5"
        elif kind == "claims 2^40 bytes":
            struct.pack_into("<Q", bad, 16, 1 << 40)
        elif kind == "claims too little":
            struct.pack_into("<Q", bad, 16, 5)
        elif kind == "longer than its record":
            struct.pack_into("<Q", bad, 40, 1 << 50)
        elif kind == "long name of its packing":
            struct.pack_into("<I", bad, 28, 1 << 20)
        elif kind == "record lengths":
            wrong = bytearray(data)
            struct.pack_into("<Q", wrong, 1, 1 << 62)
            bad = bytearray(packed(start, end, bytes(wrong)))
        elif kind == "odd times":
            wrong = bytearray(data)
            struct.pack_into("<Q", wrong, _message_of_column(data) + 15, start + 7)
            bad = bytearray(packed(start, end, bytes(wrong)))
        elif kind == "cut short":
            bad = bad[:2000]
        elif kind == "missing":
            del records[k]
            while records[k][0] == INDEX:
                del records[k]
            return
        records[k] = (CHUNK, bytes(bad))

    return change


def _message_of_column(data: bytes) -> int:
    at = 0
    while struct.unpack_from("<H", data, at + 9)[0] != 2:
        at += HEAD.size + HEAD.unpack_from(data, at)[1]
    return at


DAMAGE = (
    "bits", "wrong checksum", "unknown packing", "claims 2^40 bytes", "claims too little", "longer than its record",
    "long name of its packing", "record lengths", "odd times", "cut short", "missing",
)  # fmt: skip


@pytest.mark.parametrize("kind", DAMAGE)
def test_a_damaged_chunk_costs_that_chunk(kind: str, run: Path, tmp_path: Path) -> None:
    whole = opened(run)
    path = changed(run, tmp_path / "x.mcap", damaged_chunk(kind))
    with pytest.warns(UserWarning) if kind != "missing" else contextlib.nullcontext():
        recording = Recording(path)
        series = recording.read("/column")
    first, last = (0.2, 0.4)
    kept = (whole.read("/column").time < first - 1e-9) | (whole.read("/column").time >= last - 1e-9)
    assert same_bits(series.time, whole.read("/column").time[kept])
    assert same_bits(series["angle"], whole.read("/column")["angle"][kept])
    ((start, end, reason),) = recording.losses
    assert (start, end) == (pytest.approx(0.2), pytest.approx(0.4)) and reason
    assert [line for line in recording.doubts if "samples from 0.2 to 0.4 s are lost" in line]
    assert sum(block.ticks for block in recording.blocks()) == len(series)

    judged = opened_run(path)
    early, late = judged.checks
    assert early.value == opened_run(run).checks[0].value and early.passed
    assert np.isnan(late.value) and not late.passed and late.note == "there are no samples from 0.22 to 0.38 s"
    assert judged.verdict == NOT_MEASURED
    if kind not in ("bits", "missing"):
        return
    done = invoke("report", path, "--out", tmp_path)
    assert done.exit_code == 0 and "warning: " in done.stderr and "are lost" in done.stderr
    page = Path(done.stdout.strip()).read_text()
    assert "samples from 0.2 to 0.4 s are lost" in page and "not measured" in page and "Not audited" in page
    compared = invoke("compare", run, path, "--out", tmp_path)
    assert compared.exit_code == 0 and "are lost" in compared.stderr


@pytest.mark.parametrize("times", [(0, (1 << 64) - 1), (5, 4), (0, 0), (1 << 63, 1 << 63)])
def test_the_times_in_a_chunks_head_are_not_believed(times: tuple[int, int], run: Path, tmp_path: Path) -> None:
    def edit(records: list[tuple[int, bytes]]) -> None:
        k = places(records, CHUNK)[1]
        records[k] = (CHUNK, struct.pack("<QQ", *times) + records[k][1][16:])

    recording, whole = (opened(path) for path in (changed(run, tmp_path / "x.mcap", edit), run))
    for start, end in ((None, None), (0.25, 0.3)):
        ours, theirs = (it.read("/column", ["angle"], start, end) for it in (recording, whole))
        assert same_bits(ours.time, theirs.time) and same_bits(ours["angle"], theirs["angle"])
    assert recording.duration == whole.duration and recording.losses == ()


@pytest.mark.parametrize("length", [1, 100, 1 << 40, (1 << 64) - 1])
def test_a_wrong_length_of_a_record_costs_no_more_than_that_record(length: int, run: Path, tmp_path: Path) -> None:
    content = bytearray(run.read_bytes())
    at = len(MAGIC)
    seen = 0
    while seen < 2 or content[at] != CHUNK:  # the head of the second chunk
        seen += content[at] == CHUNK
        if content[at] == CHUNK and seen == 2:
            break
        at += HEAD.size + HEAD.unpack_from(content, at)[1]
    struct.pack_into("<Q", content, at + 1, length)
    path = tmp_path / "x.mcap"
    path.write_bytes(content)
    recording = opened(path)
    assert any("there is damage between its bytes" in line for line in recording.doubts)
    times = opened(path).read("/column").time
    assert (times < 0.2).sum() == 4000 and (times >= 0.4).sum() == 400 and recording.status == "complete"


def test_a_message_index_is_not_believed(run: Path, tmp_path: Path) -> None:
    expected = opened(run).read_all()
    rng = random.Random(3)
    for kind in range(6):

        def spoil(records: list[tuple[int, bytes]], kind: int = kind) -> None:
            for k in places(records, INDEX):
                body = bytearray(records[k][1])
                if kind == 0:
                    struct.pack_into("<Q", body, 14, (1 << 64) - 1)  # far outside
                elif kind == 1:
                    struct.pack_into("<Q", body, 6, 12345)  # another time
                elif kind == 2:
                    body = body[:-16]
                    struct.pack_into("<I", body, 2, len(body) - 6)  # one less
                elif kind == 3:
                    struct.pack_into("<I", body, 2, 1 << 31)  # longer than it is
                elif kind == 4:
                    struct.pack_into("<H", body, 0, rng.randrange(60_000))  # another channel
                else:
                    struct.pack_into("<Q", body, 14, struct.unpack_from("<Q", body, 14)[0] + 1)
                records[k] = (INDEX, bytes(body))

        recording = opened(changed(run, tmp_path / "x.mcap", spoil))
        found = recording.read_all()
        for topic, series in expected.items():
            assert same_bits(found[topic].time, series.time)
            assert all(same_bits(found[topic][name], series[name]) for name in series.values)


def doubts_of(path: Path) -> str:
    recording = opened(path)
    with quiet():
        recording.verify()
    return "\n".join(recording.doubts)


def rejoined(source: Path, target: Path, change: Callable[[list[tuple[int, bytes]]], Any]) -> Path:
    """The file with its records changed in place, its summary kept, and a footer that says where that begins now."""
    content = source.read_bytes()
    records = split(content)
    change(records)
    shorter = join(records)
    start = struct.unpack_from("<Q", content, len(content) - len(MAGIC) - 20)[0] + len(shorter) - len(content)
    end = len(shorter) - len(MAGIC) - 29
    footer = HEAD.pack(FOOTER, 20) + struct.pack("<QQ", start, 0)
    crc = zlib.crc32(footer, zlib.crc32(shorter[start:end]))
    target.write_bytes(shorter[:end] + footer + struct.pack("<I", crc) + MAGIC)
    return target


def test_data_that_goes_on_behind_its_end_is_read_and_said(run: Path, tmp_path: Path) -> None:
    """A record that ends the data, or a footer, in front of everything else hid all behind it without a word."""
    whole = opened(run).read_all()
    assert not opened(rejoined(run, tmp_path / "same.mcap", len)).doubts
    for opcode in (DATA_END, FOOTER):

        def ahead(records: list[tuple[int, bytes]], opcode: int = opcode) -> None:
            records.insert(1, records[places(records, opcode)[-1]])

        path = rejoined(run, tmp_path / f"ahead{opcode}.mcap", ahead)
        found = opened(path).read_all()
        assert [(topic, len(series)) for topic, series in found.items()] == [(t, len(s)) for t, s in whole.items()]
        assert "goes on behind it" in doubts_of(path)


@pytest.mark.parametrize(
    ("opcode", "what"), [(CHUNK, "chunks"), (ATTACHMENT, "attachments"), (METADATA, "metadata records")]
)
def test_what_is_missing_between_records_is_counted(opcode: int, what: str, run: Path, tmp_path: Path) -> None:
    """What was taken out as a whole leaves no hole to be seen: the summary counts."""

    def taken_out(records: list[tuple[int, bytes]]) -> None:
        del records[places(records, opcode)[-1]]

    path = rejoined(run, tmp_path / "without.mcap", taken_out)
    assert f" {what}, and its summary counts " in doubts_of(path)


def test_a_signal_that_there_is_not_is_left_out_where_nothing_vouches_for_its_name(run: Path, tmp_path: Path) -> None:
    """A letter of a schema changed in a file that was cut short, so that its summary with the checksum is gone."""
    content = run.read_bytes()
    path = tmp_path / "misspelt.mcap"
    path.write_bytes(content[: len(content) - 40].replace(b"counts", b"coLnts", 1))
    assert "coLnts" not in opened(path).topics["/load_cell"].names
    assert '/load_cell has no signal "coLnts"' in doubts_of(path)


def test_attachments_are_checked(run: Path, tmp_path: Path) -> None:
    content = bytearray(run.read_bytes())
    content[content.index(b'title = "tiny"') + 9] ^= 1
    path = tmp_path / "x.mcap"
    path.write_bytes(content)
    with pytest.warns(UserWarning, match='attachment "scenario.toml" has a wrong checksum'):
        recording = Recording(path)
    assert "scenario.toml" not in recording.attachments
    with quiet(), pytest.raises(InputError, match=r"^[^\n]*carries no scenario[^\n]*$"):
        RecordedRun(path)


@pytest.mark.parametrize("content", [b"{", b"[1]", b"\xff", b"[" * 100_000, b'{"a": ' + b"9" * 5000 + b"}"])
def test_parameters_that_cannot_be_read_are_one_line(content: bytes, run: Path, tmp_path: Path) -> None:
    name = "parameters.json"
    path = changed(run, tmp_path / "x.mcap", lambda r: replace_named(r, attachment(name, content), name))
    with pytest.raises(InputError, match=r"^[^\n]*damaged: parameters\.json is no JSON object$"):
        _ = opened(path).parameters


# ---------------------------------------------------------------------------------------------------------------------
# Edited


def with_result(
    source: Path, target: Path, *, seal: str = "right", samples: Callable[[bytes], bytes] | None = None, **entries: str
) -> Path:
    """The recording with other entries in its closing record."""

    def edit(records: list[tuple[int, bytes]]) -> None:
        told = opened(source)
        result = {**told.result, **entries}
        replace_named(records, metadata("result", result), "result")
        everything = {**told.all_metadata, "result": result}
        value = seal_of(everything, told.attachments) if seal == "right" else "0" * 64
        replace_named(records, metadata(SEAL_METADATA, {SEAL_KEY: value}), SEAL_METADATA)

    return changed(source, target, edit)


def test_the_verdict_is_that_of_the_samples(run: Path, tmp_path: Path) -> None:
    checks = {check.check.name: check.value for check in opened_run(run).checks}
    path = tmp_path / "x.mcap"
    truth = {"verdict": "passed", "checks": json.dumps(checks)}
    assert opened_run(with_result(run, path, **truth)).doubts == ()
    for entries, said in (
        ({"verdict": "failed"}, 'the file says "failed", its samples and events give "passed"'),
        ({"verdict": "tripped"}, 'the file says "tripped", its samples and events give "passed"'),
        ({"checks": json.dumps(checks | {"early": 7.5})}, '"early": the file says 7.5, its samples give 0.0'),
        ({"checks": json.dumps(checks | {"early": None})}, '"early": the file says that it was not measured'),
        ({"checks": json.dumps(checks | {"other": 1.0})}, 'the file has a value of "other"'),
        ({"ticks": "9000"}, "the run went on to 0.45 s, its samples end at 0.42 s"),
    ):
        edited = opened_run(with_result(run, path, **{**truth, **entries}))
        assert edited.verdict == "passed"
        assert len(edited.doubts) == 1 and edited.doubts[0].startswith(said), edited.doubts
        if "checks" in entries:
            continue
        done = invoke("report", path, "--out", tmp_path)
        assert f"warning: {path}: {said}" in done.stderr and done.stderr.count("\n") == 1
        assert said in html.unescape(Path(done.stdout.strip()).read_text())
        assert said in invoke("compare", run, path, "--out", tmp_path).stderr
    assert opened_run(with_result(run, path, seal="wrong", **truth)).doubts == (
        "what the file says about its run was changed after the run: its seal is broken",
    )
    for nonsense in ("{", "[]", '{"early": "x"}', "9" * 5000, '{"early": 1e999}'):
        assert opened_run(with_result(run, path, verdict="passed", checks=nonsense)).verdict == "passed"


def test_the_seal_covers_what_is_said_but_not_the_clock() -> None:
    about = {"run": {"seed": "1"}, "wall_clock": {"start": "x"}, "seal": {"sha256": "?"}}
    seal = seal_of(about, {"a": b"1"})
    assert seal == seal_of({"wall_clock_end": {}, "run": {"seed": "1"}}, {"a": b"1"})
    others = {seal_of({"run": {"seed": "2"}}, {"a": b"1"}), seal_of(about, {"a": b"2"}), seal_of(about, {})}
    assert len({seal, *others}) == 4


def test_a_trip_that_was_not_expected_is_found_in_the_events(tmp_path: Path) -> None:
    info = replace(INFO, scenario_toml=b'title = "x"\nduration = 0.1\n')
    block = make_block(0, 2000, (Event(40, "error", "safety", "safe torque off: limit switch open"),))
    judged = opened_run(record(tmp_path / "run.mcap", [block], info, status="complete"))
    assert judged.verdict == "tripped" and judged.doubts == ()
    assert opened_run(record(tmp_path / "run.mcap", [block], info, status="passed")).doubts == (
        'the file says "passed", its samples and events give "tripped"',
    )


# ---------------------------------------------------------------------------------------------------------------------
# Hostile


def test_sample_files_come_from_the_recording_alone(run: Path, tmp_path: Path) -> None:
    secret = tmp_path / "secret.csv"
    secret.write_text("time,value\n0,0\n0.1,1\n")
    for name in (str(secret), "/dev/zero", "/etc/passwd", f"../{tmp_path.name}/secret.csv", "x" * 10_000):
        toml = f'{TINY}[[hand]]\nat = 0.3\nkind = "samples"\nfile = "{name}"\nunit = "deg"\n'.encode()
        evil = attachment("scenario.toml", toml)
        path = changed(run, tmp_path / "x.mcap", lambda r, a=evil: replace_named(r, a, "scenario.toml"))  # type: ignore[misc]
        done = invoke("report", path, "--out", tmp_path)
        assert done.exit_code == 2 and done.stderr.count("\n") == 1 and "its scenario cannot be read" in done.stderr
        assert len(done.stderr) < 1500
    evil = attachment("scenario.toml", toml.replace(b"x" * 10_000, b"/etc/passwd"))
    path = changed(run, path, lambda r: replace_named(r, evil, "scenario.toml"))
    inside = changed(path, tmp_path / "y.mcap", lambda r: r.insert(9, attachment("/etc/passwd", secret.read_bytes())))
    assert opened_run(inside).scenario.sample_files == {"/etc/passwd": secret.read_bytes()}


def test_names_that_climb_leave_the_disk_alone(run: Path, tmp_path: Path) -> None:
    def add(records: list[tuple[int, bytes]]) -> None:
        for name in ("../../evil.toml", "/tmp/evil.toml", "\x00", ""):
            records.insert(9, attachment(name, b"evil"))
        replace_named(records, metadata("run", {"scenario": "../../../evil", "overrides": ""}), "run")

    (tmp_path / "in" / "deep").mkdir(parents=True)
    path = changed(run, tmp_path / "in" / "deep" / "x.mcap", add)
    before = set(tmp_path.rglob("*"))
    judged = opened_run(path)
    assert "/" not in judged.name and set(tmp_path.rglob("*")) == before


def test_nothing_from_the_file_is_obeyed_by_shell_page_or_terminal(run: Path, tmp_path: Path) -> None:
    evil = "\x1b[31m<script>alert(1)</script>`id`$(id)\nrm -rf ~; '\u202e"
    toml = TINY.replace('"tiny"', json.dumps(evil)).replace('"late"', json.dumps(evil))

    def edit(records: list[tuple[int, bytes]]) -> None:
        replace_named(records, attachment("scenario.toml", toml.encode()), "scenario.toml")
        about = {"scenario": evil, "commit": evil, "mujoco": evil, "overrides": f"description={json.dumps(evil)}"}
        replace_named(records, metadata("run", about), "run")
        replace_named(records, metadata("wall_clock", {"start": evil}), "wall_clock")
        replace_named(records, metadata("result", {"status": "complete", "verdict": evil}), "result")

    path = changed(run, tmp_path / "x.mcap", edit)
    for command in (("report", path), ("compare", path, path)):
        done = invoke(*command, "--out", tmp_path)
        if done.exit_code == 0:
            page = Path(done.stdout.splitlines()[-1]).read_text()
            assert "<script" not in page
            if command[0] == "report":
                command_text = page[page.index("<h2>How to run it again</h2>") :].split("</pre>")[0]
                assert command_text.count("\n") <= 4  # a comment that goes on would be a command
        assert "\x1b" not in done.stdout + done.stderr and "\u202e" not in done.stderr
    assert printable("a\x1b[0m\r\nb\u202e\ud800\x9b") == "a�[0m  b���" and printable("é 漢 −°", 3) == "é 漢…"


def hostile_chunks(kind: str) -> list[tuple[int, bytes]]:
    if kind == "a bomb":
        return [(CHUNK, packed(0, 1, bytes(1 << 29)))]
    if kind == "an honest bomb":
        return [(CHUNK, packed(0, 1, (b"\x80" + bytes(8)) * (6 << 20)))] * 4
    if kind == "an lz4 bomb":
        return [(CHUNK, packed(0, 1, bytes(1 << 28), "lz4"))]
    if kind == "a bomb that lies":
        return [(CHUNK, packed(0, 1, bytes(1 << 29), size=1 << 16))]
    if kind == "an lz4 bomb that lies":
        return [(CHUNK, packed(0, 1, bytes(1 << 28), "lz4", size=1 << 16))]
    if kind == "indexes":
        return [(INDEX, bytes(6))] * 30_000
    raise AssertionError(kind)


@pytest.mark.parametrize(
    "kind", ["a bomb", "an honest bomb", "an lz4 bomb", "a bomb that lies", "an lz4 bomb that lies", "indexes"]
)
def test_memory_and_time_are_bound(kind: str, run: Path, tmp_path: Path) -> None:
    hostile = hostile_chunks(kind)

    def add(records: list[tuple[int, bytes]]) -> None:
        k = places(records, CHUNK)[1]
        records[k:k] = hostile

    path = changed(run, tmp_path / "x.mcap", add)
    tracemalloc.start()
    began = time.perf_counter()
    judged = opened_run(path)
    _ = judged.checks, judged.doubts
    took, peak = time.perf_counter() - began, tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 100e6 and took < 15.0
    assert judged.verdict == "passed"


def test_times_that_no_run_has(run: Path, tmp_path: Path) -> None:
    for stamp in (LIMITS.end_ns + TICK_NS, 1 << 63, (1 << 64) - TICK_NS):

        def edit(records: list[tuple[int, bytes]], stamp: int = stamp) -> None:
            k = places(records, CHUNK)[2]
            start, end, data = unpacked(records[k][1])
            wrong = bytearray(data)
            struct.pack_into("<Q", wrong, _message_of_column(data) + 15, stamp)
            records[k] = (CHUNK, packed(start, end, bytes(wrong)))

        recording = opened(changed(run, tmp_path / "x.mcap", edit))
        with quiet():
            assert len(recording.read("/column")) == 8000
        assert recording.duration == pytest.approx(0.4) and recording.doubts


def test_two_samples_of_one_time_are_refused(run: Path, tmp_path: Path) -> None:
    def twice(records: list[tuple[int, bytes]]) -> None:
        records.insert(places(records, CHUNK)[1], records[places(records, CHUNK)[0]])

    with quiet(), pytest.raises(InputError, match=r"^[^\n]*there are two samples of /column at 0 s$"):
        Recording(changed(run, tmp_path / "x.mcap", twice)).read("/column")


@pytest.mark.parametrize("ticks", ["0", "1000000000000", "-4", "4.5", "", "nan"])
def test_rates_that_are_none(ticks: str, run: Path, tmp_path: Path) -> None:
    def edit(records: list[tuple[int, bytes]]) -> None:
        for k in places(records, CHANNEL):
            body = records[k][1].replace(text("ticks") + text("8"), text("ticks") + text(ticks))
            at = 4 + 4 + struct.unpack_from("<I", body, 4)[0]
            at += 4 + struct.unpack_from("<I", body, at)[0]
            body = body[:at] + struct.pack("<I", len(body) - at - 4) + body[at + 4 :]
            records[k] = (CHANNEL, body)

    with quiet(), pytest.raises(InputError, match=r'^[^\n]*damaged: topic "/feel" cannot be understood$'):
        Recording(changed(run, tmp_path / "x.mcap", edit))


@pytest.mark.parametrize(
    ("model", "said"),
    [
        ('<mujoco><include file="/etc/passwd"/></mujoco>', "has <include>"),
        ('<mujoco><asset><mesh file="/dev/zero"/></asset></mujoco>', "has <mesh>"),
        ('<mujoco><asset><texture file="/dev/zero"/></asset></mujoco>', "names the file /dev/zero"),
        ('<mujoco><asset><texture width="999999" height="9"/></asset></mujoco>', "texture of 999999 x 9 pixels"),
        ('<!DOCTYPE x [<!ENTITY a "b">]><mujoco>&a;</mujoco>', "declares entities"),
        ('<mujoco><size memory="900G"/></mujoco>', "has <size>"),
        ("<mujoco>", "no XML"),
    ],
)  # fmt: skip
@pytest.mark.parametrize("name", MODEL_FILES)
def test_models_that_no_bench_has_are_not_drawn(
    name: str, model: str, said: str, run: Path, tmp_path: Path
) -> None:  # fmt: skip
    path = changed(run, tmp_path / "x.mcap", lambda r: replace_named(r, attachment(name, model.encode()), "bench.xml"))
    done = invoke("render", path)
    assert done.exit_code == 2 and said in done.stderr and done.stderr.count("\n") == 1
    assert f"its {name} is not drawn" in done.stderr


def test_the_model_of_an_older_recording_is_found(run: Path, tmp_path: Path) -> None:
    model = Recording(run).attachments["bench.xml"]
    old = attachment("bench_as_run.xml", model)
    path = changed(run, tmp_path / "x.mcap", lambda r: replace_named(r, old, "bench.xml"))
    with quiet():
        assert "bench.xml" not in Recording(path).attachments
        assert model_xml(Recording(path)) == model.decode()


# ---------------------------------------------------------------------------------------------------------------------
# Any mutation


def mutated(content: bytes, rng: random.Random) -> bytes:
    """The file with bits flipped, a stretch taken out, put in, doubled, emptied or cut, or a record made another."""
    data = bytearray(content)
    kind = rng.choice(["bits", "bits", "cut", "zeros", "less", "twice", "noise", "record", "field", "samples"])
    at, length = rng.randrange(len(data)), rng.choice([1, 10, 1000, 100_000])
    if kind == "bits":
        low, high = rng.choice([(0, len(data)), (0, 30_000), (len(data) - 9000, len(data))])
        for _ in range(rng.choice([1, 1, 20])):
            data[rng.randrange(low, high)] ^= 1 << rng.randrange(8)
    elif kind == "cut":
        del data[at:]
    elif kind == "zeros":
        data[at : at + length] = bytes(len(data[at : at + length]))
    elif kind == "less":
        del data[at : at + length]
    elif kind == "twice":
        data[at:at] = data[at : at + length]
    elif kind == "noise":
        data[at:at] = rng.randbytes(length)
    else:
        records = records_of(content)
        k = rng.randrange(len(records))
        opcode, body = records[k]
        if kind == "record":
            other = rng.randrange(len(records))
            rng.choice([
                lambda: records.pop(k), lambda: records.insert(other, records[k]),
                lambda: records.__setitem__(k, (rng.randrange(256), body)), lambda: rng.shuffle(records),
                lambda: records.__setitem__(k, (opcode, body[: rng.randrange(len(body) + 1)])),
            ])()  # fmt: skip
        elif kind == "field" and len(body) >= 8:
            wrong = bytearray(body)
            value = rng.choice([0, 1, 1 << 16, 1 << 31, (1 << 32) - 1, 1 << 40, 1 << 63, (1 << 64) - 1])
            struct.pack_into("<Q", wrong, rng.choice([0, rng.randrange(len(body) - 7)]), value)
            records[k] = (opcode, bytes(wrong))
        else:
            k = rng.choice(places(records, CHUNK))
            start, end, inner = unpacked(records[k][1])
            wrong = bytearray(inner)
            for _ in range(rng.choice([1, 5])):
                bad = rng.choice([float("nan"), float("inf"), 1e300, -1e13])
                place = rng.randrange(len(wrong) - 8)
                struct.pack_into("<d", wrong, place, bad)
            records[k] = (CHUNK, packed(start, end, bytes(wrong), rng.choice(["zstd", "lz4", ""])))
        return joined_records(records)
    return bytes(data)


def exercise(path: Path) -> None:
    """All that is read of a recording."""
    recording = Recording(path)
    recording.read_all()
    recording.events()
    recording.poses()
    for _ in recording.blocks():
        pass
    with contextlib.suppress(InputError):
        recording.run_info()
    judged = RecordedRun(path)
    assert all("\n" not in line and "\x1b" not in line for line in judged.doubts)
    assert judged.verdict and all(np.isfinite(check.value) or check.note for check in judged.checks)


def fuzz(run: Path, path: Path, seeds: range) -> None:
    content = run.read_bytes()
    for seed in seeds:
        path.write_bytes(mutated(content, random.Random(seed)))
        began = time.perf_counter()
        with quiet():
            try:
                exercise(path)
            except InputError as error:
                assert str(error).startswith(str(path)) and "\n" not in str(error), (seed, error)
            except Exception as error:
                raise AssertionError(f"mutation {seed}: {error!r}") from error
        assert time.perf_counter() - began < 10.0, seed


def test_mutated_recordings_are_read_or_refused(run: Path, tmp_path: Path) -> None:
    fuzz(run, tmp_path / "x.mcap", range(60))


@pytest.mark.slow
def test_many_mutated_recordings_are_read_or_refused(run: Path, tmp_path: Path) -> None:
    fuzz(run, tmp_path / "x.mcap", range(60, 3000))


def test_no_wrong_sample_is_read_from_a_damaged_file(run: Path, tmp_path: Path) -> None:
    truth = opened(run).read_all()
    content = run.read_bytes()
    rng = random.Random(11)
    path = tmp_path / "x.mcap"
    for number in range(60):
        data = bytearray(content)
        for _ in range(rng.choice([1, 1, 4])):
            data[rng.randrange(len(data) if number % 2 else 20_000)] ^= 1 << rng.randrange(8)
        path.write_bytes(data)
        try:
            recording = opened(path)
            with quiet():
                found = recording.read_all()
        except InputError:
            continue
        for topic, series in found.items():
            place = np.round(series.time / (recording.topics[topic].ticks * TICK_S)).astype(int)
            assert same_bits(truth[topic].time[place], series.time)
            assert all(same_bits(truth[topic][name][place], series[name]) for name in series.values)
            assert len(series) == len(truth[topic]) or recording.doubts


def test_a_message_that_lost_its_fields_is_no_sample_of_zeros(tmp_path: Path) -> None:
    """Proto3 leaves zeros out, but not in a file in which other zeros are written."""
    from mcap.reader import make_reader
    from mcap.writer import Writer

    blocks = make_blocks((400,))
    blocks[0].signals["/drive"][5] = 0.0
    source, emptied = record(tmp_path / "run.mcap", blocks), tmp_path / "emptied.mcap"
    with source.open("rb") as file, emptied.open("wb") as out:
        reader, writer = make_reader(file), Writer(out)
        writer.start(library="cls-bench")
        schemas, channels, seen = {}, {}, 0
        for schema, channel, message in reader.iter_messages():
            if schema.id not in schemas:
                schemas[schema.id] = writer.register_schema(schema.name, schema.encoding, schema.data)
            if channel.id not in channels:
                channels[channel.id] = writer.register_channel(
                    channel.topic, channel.message_encoding, schemas[schema.id], channel.metadata
                )
            seen += channel.topic == "/drive"
            data = b"" if channel.topic == "/drive" and seen == 8 else message.data
            writer.add_message(channels[channel.id], message.log_time, data, message.publish_time, message.sequence)
        writer.finish()
    recording = Recording(emptied)
    with pytest.warns(UserWarning, match="a sample of /drive is missing"):
        voltage = recording.read("/drive", ["voltage"])["voltage"]
    assert np.flatnonzero(np.isnan(voltage)).tolist() == [7]
    assert voltage[5] == 0.0
    assert any("/drive is missing" in line for line in recording.doubts)
