"""What may become of an MCAP file: by accident, by other tools, and on purpose.

Each mutation takes the bytes of a recording and a generator of random numbers. Of what one of :data:`DAMAGES` leaves,
no sample may be wrong, and a lack must be said. What one of :data:`REWRITES` makes is the same recording. What one of
:data:`EDITS` makes may be any recording or none, but must hurt no one.
"""

import io
import struct
import zlib
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import Attachment, Channel, Chunk, Message, Metadata, Schema
from mcap.writer import MCAP0_MAGIC, CompressionType, IndexType, Writer

Rng = np.random.Generator
Record = tuple[int, bytes]
Mutation = Callable[[bytes, Rng], bytes]

EXTREMES = (0, 1, 2, 2**15, 2**16 - 1, 2**31 - 1, 2**31, 2**32 - 1, 2**40, 2**63 - 1, 2**63, 2**64 - 1)


def split(data: bytes) -> list[Record]:
    """Opcode and content of all records."""
    records, at = [], len(MCAP0_MAGIC)
    while at + 9 <= len(data) - len(MCAP0_MAGIC):
        opcode, length = struct.unpack_from("<BQ", data, at)
        records.append((opcode, data[at + 9 : at + 9 + length]))
        at += 9 + length
    return records


def join(records: list[Record], magic: bytes = MCAP0_MAGIC) -> bytes:
    """The file of ``records``."""
    return magic + b"".join(struct.pack("<BQ", opcode, len(body)) + body for opcode, body in records) + magic


def _encoded(record: Any) -> Record:
    builder = RecordBuilder()
    record.write(builder)
    data = bytes(builder.end())  # type: ignore[no-untyped-call]
    return data[0], data[9:]


def _decoded(kind: Any, body: bytes) -> Any:
    return kind.read(ReadDataStream(io.BytesIO(body)))


# --- damage ----------------------------------------------------------------------------------------------------------


def flip(data: bytes, rng: Rng) -> bytes:
    damaged = np.frombuffer(bytearray(data), np.uint8).copy()
    damaged[rng.integers(0, len(data), rng.integers(1, 17))] ^= rng.integers(1, 256, dtype=np.uint8)
    return damaged.tobytes()


def flip_head(data: bytes, rng: Rng) -> bytes:
    """Where header, schemas, channels, metadata and attachments stand."""
    end = _first_chunk(data)
    return flip(data[:end], rng) + data[end:]


def flip_tail(data: bytes, rng: Rng) -> bytes:
    """Where the last index, the closing metadata and the summary stand."""
    start = max(len(data) - int(rng.integers(50, 20_000)), 0)
    return data[:start] + flip(data[start:], rng)


def flip_index(data: bytes, rng: Rng) -> bytes:
    """In a message index, which has no checksum."""
    records = split(data)
    number = _pick(records, rng, Opcode.MESSAGE_INDEX)
    records[number] = records[number][0], flip(records[number][1], rng)
    return join(records)


def _first_chunk(data: bytes) -> int:
    at = len(MCAP0_MAGIC)
    while data[at] != Opcode.CHUNK:
        at += 9 + struct.unpack_from("<Q", data, at + 1)[0]
    return at


def _pick(records: list[Record], rng: Rng, *opcodes: int) -> int:
    found = [k for k, (opcode, _) in enumerate(records) if not opcodes or opcode in opcodes]
    return int(rng.choice(found))


def truncate(data: bytes, rng: Rng) -> bytes:
    return data[: rng.integers(0, len(data))]


def truncate_tail(data: bytes, rng: Rng) -> bytes:
    return data[: -int(rng.integers(1, 5000))]


def blot(data: bytes, rng: Rng) -> bytes:
    """A stretch of zeros or of 0xff."""
    start, length = int(rng.integers(0, len(data))), int(rng.choice([1, 512, 4096, 65_536]))
    filler = bytes([int(rng.choice([0, 255]))]) * min(length, len(data) - start)
    return data[:start] + filler + data[start + len(filler) :]


def insert(data: bytes, rng: Rng) -> bytes:
    at = int(rng.integers(0, len(data)))
    return data[:at] + rng.bytes(int(rng.integers(1, 100))) + data[at:]


def delete(data: bytes, rng: Rng) -> bytes:
    at = int(rng.integers(0, len(data)))
    return data[:at] + data[at + int(rng.choice([1, 10, 1000, 100_000])) :]


def swap(data: bytes, rng: Rng) -> bytes:
    """Two sectors change places."""
    a, b = sorted(int(k) * 512 for k in rng.integers(0, len(data) // 512 + 1, 2))
    if a == b:
        return data
    return data[:a] + data[b : b + 512] + data[a + 512 : b] + data[a : a + 512] + data[b + 512 :]


def length_of_a_record(data: bytes, rng: Rng) -> bytes:
    records = split(data)
    number = _pick(records, rng)
    at = len(MCAP0_MAGIC) + sum(9 + len(body) for _, body in records[:number])
    old = len(records[number][1])
    return data[: at + 1] + struct.pack("<Q", _extreme(rng, old)) + data[at + 9 :]


def _extreme(rng: Rng, near: int) -> int:
    choices = (*EXTREMES, max(near - 1, 0), near + 1)
    return choices[int(rng.integers(len(choices)))]


def opcode_of_a_record(data: bytes, rng: Rng) -> bytes:
    records = split(data)
    number = _pick(records, rng)
    records[number] = int(rng.integers(0, 256)), records[number][1]
    return join(records)


def remove_records(data: bytes, rng: Rng) -> bytes:
    records = split(data)
    for _ in range(int(rng.integers(1, 4))):
        del records[_pick(records, rng)]
    return join(records)


def duplicate_records(data: bytes, rng: Rng) -> bytes:
    records = split(data)
    for _ in range(int(rng.integers(1, 4))):
        records.insert(int(rng.integers(0, len(records))), records[_pick(records, rng)])
    return join(records)


def shuffle_records(data: bytes, rng: Rng) -> bytes:
    records = split(data)
    head, rest = records[:1], records[1:]
    return join(head + [rest[int(k)] for k in rng.permutation(len(rest))])


def twice(data: bytes, rng: Rng) -> bytes:
    """The file behind itself."""
    return data + data


def garbage_behind(data: bytes, rng: Rng) -> bytes:
    return data + rng.bytes(int(rng.integers(1, 5000)))


def garbage_before(data: bytes, rng: Rng) -> bytes:
    return rng.bytes(int(rng.integers(1, 50))) + data


def body_of_a_record(data: bytes, rng: Rng) -> bytes:
    """Another record's content."""
    records = split(data)
    a, b = _pick(records, rng), _pick(records, rng)
    records[a] = records[a][0], records[b][1]
    return join(records)


DAMAGES: tuple[Mutation, ...] = (
    flip, flip_head, flip_tail, flip_index, truncate, truncate_tail, blot, insert, delete, swap, length_of_a_record,
    opcode_of_a_record, remove_records, duplicate_records, shuffle_records, twice, garbage_behind, garbage_before,
    body_of_a_record,
)  # fmt: skip


# --- other writers ---------------------------------------------------------------------------------------------------


def _rewritten(data: bytes, order: Callable[[list[Any]], list[Any]] = lambda found: found, **options: Any) -> bytes:
    """All that is in a recording, written by the mcap library."""
    reader = make_reader(io.BytesIO(data))
    out = io.BytesIO()
    writer = Writer(out, **options)
    writer.start(profile="", library="another tool")
    summary = reader.get_summary()
    assert summary is not None
    schemas = {number: writer.register_schema(s.name, s.encoding, s.data) for number, s in summary.schemas.items()}
    channels = {
        number: writer.register_channel(c.topic, c.message_encoding, schemas[c.schema_id], c.metadata)
        for number, c in summary.channels.items()
    }
    for _, _, m in order(list(reader.iter_messages(log_time_order=False))):
        writer.add_message(channels[m.channel_id], m.log_time, m.data, m.publish_time, m.sequence)
    for a in reader.iter_attachments():
        writer.add_attachment(a.create_time, a.log_time, a.name, a.media_type, a.data)
    for record in reader.iter_metadata():
        writer.add_metadata(record.name, record.metadata)
    writer.finish()
    return out.getvalue()


_KINDS = (CompressionType.NONE, CompressionType.LZ4, CompressionType.ZSTD)


def another_compression(data: bytes, rng: Rng) -> bytes:
    return _rewritten(
        data, compression=_KINDS[int(rng.integers(3))], chunk_size=int(rng.choice([10_000, 300_000, 8 << 20]))
    )


def no_chunks(data: bytes, rng: Rng) -> bytes:
    return _rewritten(data, use_chunking=False)


def no_index(data: bytes, rng: Rng) -> bytes:
    kinds = (IndexType.NONE, IndexType.CHUNK, IndexType.ATTACHMENT)
    return _rewritten(data, index_types=kinds[int(rng.integers(3))], compression=_KINDS[int(rng.integers(3))])


def no_summary(data: bytes, rng: Rng) -> bytes:
    return _rewritten(
        data, use_statistics=False, use_summary_offsets=False, repeat_channels=False, repeat_schemas=False
    )


def checksums(data: bytes, rng: Rng) -> bytes:
    return _rewritten(data, enable_crcs=True, enable_data_crcs=True)


def topics_in_turn(data: bytes, rng: Rng) -> bytes:
    """One topic after the other instead of by time."""
    return _rewritten(data, lambda found: sorted(found, key=lambda m: m[2].channel_id), chunk_size=200_000)


def heads_behind(data: bytes, rng: Rng) -> bytes:
    """Metadata and attachments behind the chunks."""
    records = split(data)
    head = (Opcode.METADATA, Opcode.ATTACHMENT)
    end = next(k for k, (opcode, _) in enumerate(records) if opcode == Opcode.DATA_END)
    moved = [record for record in records[:end] if record[0] in head]
    return join(
        [record for record in records[:end] if record[0] not in head]
        + moved
        + [(Opcode.DATA_END, bytes(4)), (Opcode.FOOTER, bytes(20))]
    )


def unknown_records(data: bytes, rng: Rng) -> bytes:
    """Records of a later version, or private ones, between the others; no summary."""
    records = split(data)
    end = next(k for k, (opcode, _) in enumerate(records) if opcode == Opcode.DATA_END)
    mixed = records[:1]
    for record in records[1:end]:
        if record[0] != Opcode.MESSAGE_INDEX and rng.random() < 0.2:
            mixed.append((int(rng.integers(0x80, 0x100)), rng.bytes(int(rng.integers(0, 50)))))
        mixed.append(record)
    return join([*mixed, (Opcode.DATA_END, bytes(4)), (Opcode.FOOTER, bytes(20))])


REWRITES: tuple[Mutation, ...] = (
    another_compression, no_chunks, no_index, no_summary, checksums, topics_in_turn, heads_behind, unknown_records,
)  # fmt: skip


# --- on purpose ------------------------------------------------------------------------------------------------------

MARK = "pwned"
"""A shell that carries out what stands in the file makes a file of this name."""

EVIL_TEXTS = (
    "", "\0", "\n\n", "../../../escape", "/escape", "a/../../b", "x" * 300, "x" * 1_000_000, f"; touch {MARK};",
    f"$(touch {MARK})", f"`touch {MARK}`", f"' ; touch {MARK} ; '", f'" ; touch {MARK} ; "', f"\ntouch {MARK}\n",
    f"x.toml & touch {MARK} #", "<script>alert(1)</script>", "</pre><img src=x onerror=alert(1)>",
    "\x1b[2J\x1b]0;x\x07",
    "\ud7ff\uffff", "\u202eabc", "nan", "-1", "1e999", "%s%n{0.__class__}", "{{ 7 * 7 }}", "[bold red]x[/]", "CON",
    "/dev/zero", "/etc/passwd", "~root/x", "--help", "-", "passed", "complete", "0" * 5000, "[" * 50_000,
)  # fmt: skip


def _text(rng: Rng) -> str:
    return EVIL_TEXTS[int(rng.integers(len(EVIL_TEXTS)))]


def _edit(data: bytes, rng: Rng, kind: Any, opcode: int, change: Callable[[Any], Any]) -> bytes:
    """One record of a kind, changed; checksums are made anew."""
    records = split(data)
    number = _pick(records, rng, opcode)
    records[number] = _encoded(change(_decoded(kind, records[number][1])))
    return join(records)


def metadata_value(data: bytes, rng: Rng) -> bytes:
    def change(record: Metadata) -> Metadata:
        entries = dict(record.metadata)
        if entries:
            entries[str(rng.choice(list(entries)))] = _text(rng)
        return Metadata(record.name, entries)

    return _edit(data, rng, Metadata, Opcode.METADATA, change)


def metadata_name(data: bytes, rng: Rng) -> bytes:
    return _edit(data, rng, Metadata, Opcode.METADATA, lambda record: Metadata(_text(rng), dict(record.metadata)))


def more_metadata(data: bytes, rng: Rng) -> bytes:
    records = split(data)
    more = [_encoded(Metadata(_text(rng), {_text(rng): _text(rng)})) for _ in range(int(rng.integers(1, 300)))]
    return join(records[:1] + more + records[1:])


def attachment_name(data: bytes, rng: Rng) -> bytes:
    return _edit(data, rng, Attachment, Opcode.ATTACHMENT, lambda record: replace(record, name=_text(rng)))


def attachment_data(data: bytes, rng: Rng) -> bytes:
    def change(record: Attachment) -> Attachment:
        choices = (b"", b"\0" * 1000, rng.bytes(1000), record.data[: len(record.data) // 2],
                   flip(record.data or b"x", rng), b"[" * 100_000, b"a" * 5_000_000, b"{}", b"null",
                   b'{"feel": {"inertia": NaN}}',
                   _text(rng).encode(), b'<mujoco><include file="/etc/passwd"/></mujoco>')  # fmt: skip
        return replace(record, data=choices[int(rng.integers(len(choices)))])

    return _edit(data, rng, Attachment, Opcode.ATTACHMENT, change)


SCENARIO_EDITS = (
    ('file = "hand.csv"', 'file = "/dev/zero"'), ('file = "hand.csv"', 'file = "/etc/passwd"'),
    ('file = "hand.csv"', 'file = "CANARY"'), ('file = "hand.csv"', 'file = "../../../../../../../../etc/passwd"'),
    ('file = "hand.csv"', 'file = "/proc/self/environ"'), ('file = "hand.csv"', 'file = "."'),
    ("duration = 0.5", "duration = 3600.0"), ("duration = 0.5", "duration = 1e-9"), ("max = 0.2", "max = -1.0"),
    ("max = 0.2", "min = 5.0"), ("[[checks]]", "[[checks" + "]]" * 3),
    ('name = "peak"', 'name = "<script>alert(1)</script>"'),
    ('title = "Attacked"', f'title = "$(touch {MARK}) <script>alert(1)</script>"'),
    ("window = [0.0, 0.5]", "window = [0.0, 0.4]"),
    ('metric = "maximum"', 'metric = "minimum"'), ("seed = 3", "seed = 9223372036854775807"),
    ('title = "Attacked"', "title = '''\n" + "long " * 10_000 + "'''"),
    ("duration = 0.5", "duration = 0.5\n" + "a." * 20_000 + "b = 1"),
    ("duration = 0.5", "duration = 0.5\nx = " + "[" * 3_000),
    ("duration = 0.5", "duration = 0.5\nparameters.feel.inertia = 0.9"),
)  # fmt: skip


def scenario_text(data: bytes, rng: Rng, canary: str = "CANARY") -> bytes:
    records = split(data)
    for k, (opcode, body) in enumerate(records):
        if opcode == Opcode.ATTACHMENT:
            attachment = _decoded(Attachment, body)
            if attachment.name == "scenario.toml":
                old, new = SCENARIO_EDITS[int(rng.integers(len(SCENARIO_EDITS)))]
                text = attachment.data.decode().replace(old, new.replace("CANARY", canary))
                records[k] = _encoded(replace(attachment, data=text.encode()))
    return join(records)


def channel(data: bytes, rng: Rng) -> bytes:
    def change(record: Channel) -> Channel:
        metadata = dict(record.metadata)
        match int(rng.integers(5)):
            case 0:
                return replace(record, id=int(rng.choice([0, 1, 3, 65_535])))
            case 1:
                return replace(record, topic=str(rng.choice(["/column", "/feel", "", "/tf", _text(rng)[:1000]])))
            case 2:
                return replace(record, schema_id=int(rng.choice([0, 1, 2, 77, 65_535])))
            case 3:
                return replace(record, message_encoding=_text(rng)[:1000])
            case _:
                key = str(rng.choice(["ticks", *metadata]))
                metadata[key] = str(rng.choice(["0", "-1", "1", "8", "1000000000", "nan", "9" * 5000, "x"]))
                return replace(record, metadata=metadata)

    return _edit(data, rng, Channel, Opcode.CHANNEL, change)


def clock(data: bytes, rng: Rng) -> bytes:
    """Other rates, possible or not, in all channels or in one."""
    tick = int(rng.choice([0, 1, 10_000, 25_000, 50_000, 62_500, 100_000, 200_000, 10**9]))
    velocity, bus = (int(n) for n in rng.choice([0, 1, 2, 3, 4, 8, 64, 10**8], 2))
    said = (
        f"tick_ns={tick} velocity_ticks={velocity} position_ticks={velocity * int(rng.integers(1, 4))} "
        f"bus_ticks={bus} plc_ticks={bus * int(rng.integers(1, 9))}"
    )
    one = rng.random() < 0.2

    def change(record: Record) -> Record:
        channel = _decoded(Channel, record[1])
        return _encoded(replace(channel, metadata={**channel.metadata, "clock": said}))

    records = split(data)
    places = [k for k, (opcode, _) in enumerate(records) if opcode == Opcode.CHANNEL]
    for k in places[:1] if one else places:
        records[k] = change(records[k])
    return join(records)


def schema(data: bytes, rng: Rng) -> bytes:
    def change(record: Schema) -> Schema:
        choices = (
            b"",
            rng.bytes(100),
            flip(record.data, rng),
            record.data * 2,
            record.data[:-3],
            b"\x0a" + b"\xff" * 9,
        )
        return replace(record, data=choices[int(rng.integers(len(choices)))])

    return _edit(data, rng, Schema, Opcode.SCHEMA, change)


def _unpacked(chunk: Chunk) -> bytes:
    return zstandard.decompress(chunk.data, max_output_size=chunk.uncompressed_size)


def _packed(chunk: Chunk, data: bytes) -> Chunk:
    return replace(
        chunk, data=zstandard.compress(data, 1), uncompressed_size=len(data), uncompressed_crc=zlib.crc32(data)
    )


def _messages(data: bytes) -> Iterator[tuple[int, int]]:
    """Offset and length of the records in a chunk."""
    at = 0
    while at + 9 <= len(data):
        (length,) = struct.unpack_from("<Q", data, at + 1)
        yield at, int(length)
        at += 9 + int(length)


def chunk_content(data: bytes, rng: Rng) -> bytes:
    """Bytes in a chunk, with its checksum made anew."""

    def change(chunk: Chunk) -> Chunk:
        content = bytearray(_unpacked(chunk))
        places = [at for at, _ in _messages(bytes(content))]
        for _ in range(int(rng.integers(1, 20))):
            at = places[int(rng.integers(len(places)))]
            match int(rng.integers(5)):
                case 0:  # the time
                    struct.pack_into("<Q", content, at + 15, _extreme(rng, 0))
                case 1:  # the length
                    struct.pack_into("<Q", content, at + 1, _extreme(rng, 31))
                case 2:  # the channel
                    struct.pack_into("<H", content, at + 9, int(rng.integers(0, 20)))
                case 3:  # a value
                    struct.pack_into("<d", content, at + 32, float(rng.choice([np.nan, np.inf, 1e308, -1e308])))
                case _:
                    content[int(rng.integers(len(content)))] ^= int(rng.integers(1, 256))
        return _packed(chunk, bytes(content))

    return _edit(data, rng, Chunk, Opcode.CHUNK, change)


def chunk_head(data: bytes, rng: Rng) -> bytes:
    def change(chunk: Chunk) -> Chunk:
        match int(rng.integers(6)):
            case 0:
                return replace(chunk, uncompressed_size=_extreme(rng, chunk.uncompressed_size))
            case 1:
                return replace(chunk, message_start_time=_extreme(rng, chunk.message_start_time))
            case 2:
                return replace(chunk, message_end_time=_extreme(rng, chunk.message_end_time))
            case 3:
                return replace(chunk, compression=str(rng.choice(["", "lz4", "zstd ", "xyz", "z" * 1000])))
            case 4:
                return replace(chunk, uncompressed_crc=0, data=flip(chunk.data, rng))
            case _:
                return replace(chunk, data=chunk.data[: int(rng.integers(0, len(chunk.data)))])

    return _edit(data, rng, Chunk, Opcode.CHUNK, change)


_BOMBS: dict[int, bytes] = {}


def bomb(data: bytes, rng: Rng) -> bytes:
    """A chunk, or several, of a few kB that unpack to 256 MB or 2 GB of zeros, with or without saying so."""
    size = int(rng.choice([256 << 20, 2 << 30]))
    if size not in _BOMBS:
        packer = zstandard.ZstdCompressor(level=3).compressobj()
        zeros = bytes(1 << 20)
        _BOMBS[size] = b"".join(packer.compress(zeros) for _ in range(size >> 20)) + packer.flush()
    claimed = int(rng.choice([size, 1000, 50 << 20]))

    def change(chunk: Chunk) -> Chunk:
        return replace(chunk, data=_BOMBS[size], uncompressed_size=claimed, uncompressed_crc=0)

    for _ in range(int(rng.integers(1, 4))):
        data = _edit(data, rng, Chunk, Opcode.CHUNK, change)
    return data


def many_records(data: bytes, rng: Rng) -> bytes:
    """A hundred thousand records of no use."""
    records = split(data)
    chunk = next(_decoded(Chunk, body) for opcode, body in records if opcode == Opcode.CHUNK)
    kinds = (
        _encoded(_packed(chunk, b"")), (int(Opcode.MESSAGE_INDEX), struct.pack("<HI", 1, 0)),
        _encoded(Metadata("x", {})),
        _encoded(Channel(id=9, topic="/x", message_encoding="", schema_id=0, metadata={})), (0x80, b""),
        _encoded(Attachment(0, 0, "x", "", b"")),
    )  # fmt: skip
    place = int(rng.integers(1, len(records)))
    return join(records[:place] + [kinds[int(rng.integers(len(kinds)))]] * 100_000 + records[place:])


def event_text(data: bytes, rng: Rng) -> bytes:
    """An event, which the run did not have, that says what it should not."""
    from foxglove_schemas_protobuf.Log_pb2 import Log

    records = split(data)
    channels = [_decoded(Channel, body) for opcode, body in records if opcode == Opcode.CHANNEL]
    events = next((c.id for c in channels if c.topic == "/events"), 7)
    said = _text(rng).encode("utf-8", "replace").decode("utf-8", "replace")
    log = Log(level=int(rng.choice([0, 2, 3, 4, 5])), message=said, name=said[:100])
    message = Message(channel_id=events, log_time=100_000, data=log.SerializeToString(), publish_time=0, sequence=0)
    builder = RecordBuilder()
    message.write(builder)
    content = bytes(builder.end())  # type: ignore[no-untyped-call]
    chunk = next(_decoded(Chunk, body) for opcode, body in records if opcode == Opcode.CHUNK)
    place = _pick(records, rng, Opcode.CHUNK)
    return join(
        [
            *records[:place],
            _encoded(_packed(replace(chunk, message_start_time=100_000, message_end_time=100_000), content)),
            *records[place:],
        ]
    )


def no_recording(data: bytes, rng: Rng) -> bytes:
    """A valid MCAP file of someone else, or nothing of the kind."""
    out = io.BytesIO()
    writer = Writer(out)
    writer.start(profile="ros2", library="another")
    encoding = str(rng.choice(["json", "cdr", "protobuf", ""]))
    schema_id = writer.register_schema("x", encoding, rng.bytes(20)) if rng.random() < 0.7 else 0
    metadata = {"ticks": "8", "meaning": "x"} if rng.random() < 0.5 else {}
    number = writer.register_channel(str(rng.choice(["/column", "/events", "/x"])), encoding, schema_id, metadata)
    for k in range(int(rng.integers(0, 50))):
        writer.add_message(number, 1_700_000_000_000_000_000 + k, rng.bytes(30), 0, k)
    writer.finish()
    choices = (
        out.getvalue(),
        out.getvalue(),
        b"",
        MCAP0_MAGIC,
        MCAP0_MAGIC * 2,
        rng.bytes(1000),
        b"<html></html>",
        bytes(10_000),
    )
    return choices[int(rng.integers(len(choices)))]


EDITS: tuple[Mutation, ...] = (
    metadata_value, metadata_name, more_metadata, attachment_name, attachment_data, scenario_text, channel, clock,
    schema, chunk_content, chunk_head, bomb, many_records, event_text, no_recording,
)  # fmt: skip


def mutate(number: int, data: bytes, rng: Rng, canary: Path) -> tuple[str, str, bytes]:
    """Kind (``damage``, ``rewrite``, ``edit``), name and bytes of mutation ``number``."""
    kinds = [("damage", m) for m in DAMAGES] + [("rewrite", m) for m in REWRITES] + [("edit", m) for m in EDITS]
    kind, mutation = kinds[number % len(kinds)]
    if mutation is scenario_text:
        return kind, mutation.__name__, scenario_text(data, rng, str(canary))
    mutated = mutation(data, rng)
    if kind == "damage" and rng.random() < 0.2:  # damage seldom comes alone
        second = DAMAGES[int(rng.integers(len(DAMAGES)))]
        if second not in (remove_records, duplicate_records, shuffle_records, opcode_of_a_record, length_of_a_record,
                          body_of_a_record, flip_index, flip_head):  # fmt: skip
            return kind, f"{mutation.__name__} and {second.__name__}", second(mutated or b"x", rng)
    return kind, mutation.__name__, mutated
