"""Recordings of synthetic blocks: what was written comes back bit for bit, whatever ends the run."""

import errno
import json
import os
import signal
import struct
import subprocess
import sys
import threading
import tracemalloc
import warnings
import zlib
from collections.abc import Sequence
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from mcap.reader import make_reader

from cls_bench.errors import InputError, OutputError
from cls_bench.geometry import Geom, along_z
from cls_bench.recording import McapRecorder, Recorder, Recording, RunInfo
from cls_bench.recording.layout import message_dtype
from cls_bench.signals import CLOCK, TOPIC, TOPICS, Block, Event

BODIES = ("world", "crank", "column")
TICK_NS, POSE_TICKS = CLOCK.tick_ns, CLOCK.pose_ticks


def _geom(kind: str, body: int = 1, **changes: object) -> Geom:
    plain = Geom(body, kind, (0.1, 0.2, 0.3), (0.0, 0.0, 1.0), (1.0, 0.0, 0.0, 0.0), (0.2, 0.4, 0.6, 1.0))
    return replace(plain, **changes)


KINDS = ("box", "capsule", "cylinder", "ellipsoid", "sphere", "plane")
TRIANGLE = _geom(
    "mesh", 2, vertices=np.eye(3, dtype=np.float32), faces=np.array([[0, 1, 2]], np.int32)
)  # fmt: skip
INFO = RunInfo(
    scenario_name="synthetic",
    scenario_toml="title = 'Prüfstand'\n".encode(),
    mjcf={"bench.xml": b"<mujoco/>", "crank.stl": bytes(range(256))},
    parameters={"motor": {"resistance": 6.0, "source": "thesis, table 3.2"}},
    metadata={"seed": "7", "mujoco": "4.0.0"},
    wall_start="2026-01-01T00:00:00+00:00",
    body_names=BODIES,
    geoms=(*(_geom(kind) for kind in KINDS), TRIANGLE),
    clock=CLOCK,
)


def make_block(first: int, ticks: int, events: tuple[Event, ...] = (), seed: int = 0) -> Block:
    rng = np.random.default_rng([seed, first])
    signals = {t.path: rng.standard_normal((t.rows(first, ticks), len(t.signals))) for t in TOPICS}
    poses = len(range(-(-first // POSE_TICKS) * POSE_TICKS, first + ticks, POSE_TICKS))
    return Block(first, ticks, signals, rng.standard_normal((poses, len(BODIES), 7)), events)


def make_blocks(lengths: Sequence[int] = (4000, 1, 7, 1203, 0, 2789, 333)) -> list[Block]:
    """Blocks of awkward lengths, one after the other, with events in, before and behind them."""
    blocks, first = [], 0
    for number, ticks in enumerate(lengths):
        events = (
            Event(first, "info", "scenario", f"block {number}"),
            Event(first + ticks // 2, "warning", "drive", "40 °C"),
            Event(first + max(ticks - 1, 0), "error", "safety", ""),
        )
        blocks.append(make_block(first, ticks, events[: number % 4]))
        first += ticks
    return blocks


def record(
    path: Path, blocks: Sequence[Block], info: RunInfo = INFO, status: str | None = "passed", wall_end: str = ""
) -> Path:
    recorder = McapRecorder(path, info, topics=TOPICS)
    for block in blocks:
        recorder.write(block)
    if status is None:
        recorder.close()
    else:
        recorder.finish(status, wall_end)
    return path


def joined(blocks: Sequence[Block], topic: str) -> np.ndarray:
    return np.concatenate([block.signals[topic] for block in blocks])


def ticks_of(blocks: Sequence[Block], every: int) -> np.ndarray:
    return np.concatenate([block.row_ticks(every) for block in blocks])


def same_bits(a: np.ndarray, b: np.ndarray) -> bool:
    return a.shape == b.shape and np.ascontiguousarray(a).tobytes() == np.ascontiguousarray(b).tobytes()


# ---------------------------------------------------------------------------------------------------------------------
# MCAP: round trip through our own reader


def test_every_signal_comes_back_bit_for_bit(tmp_path: Path) -> None:
    blocks = make_blocks()
    special = blocks[0].signals["/column"]
    special[:5, 0] = [0.0, -0.0, np.nan, np.inf, 5e-324]
    recording = Recording(record(tmp_path / "run.mcap", blocks))
    assert tuple(recording.topics.values()) == TOPICS  # names, units, meanings, rates
    for topic in TOPICS:
        series = recording.read(topic.path)
        expected = joined(blocks, topic.path)
        assert tuple(series.values) == topic.names
        for column, name in enumerate(topic.names):
            assert same_bits(series[name], expected[:, column])
        assert same_bits(series.time, ticks_of(blocks, topic.ticks) * TICK_NS / 1e9)


def test_all_about_the_run_comes_back(tmp_path: Path) -> None:
    blocks = make_blocks()
    recording = Recording(record(tmp_path / "run.mcap", blocks, status="diverged"))
    assert recording.scenario_name == "synthetic"
    assert recording.metadata == {"scenario": "synthetic", **INFO.metadata}
    assert recording.wall_start == INFO.wall_start
    assert recording.status == "diverged"
    assert recording.parameters == INFO.parameters
    assert recording.attachments == {
        "scenario.toml": INFO.scenario_toml, "parameters.json": json.dumps(INFO.parameters, indent=1).encode(),
        **INFO.mjcf,
    }  # fmt: skip
    assert recording.duration == pytest.approx(blocks[-1].end_tick * TICK_NS * 1e-9, abs=1e-12)
    assert recording.events() == tuple(event for block in blocks for event in block.events)
    assert not recording.truncated


def test_a_run_without_blocks_is_a_valid_recording(tmp_path: Path) -> None:
    recording = Recording(record(tmp_path / "run.mcap", []))
    assert (recording.duration, recording.events(), recording.status) == (0.0, (), "passed")
    assert recording.read("/drive", ["current"])["current"].shape == (0,)


@pytest.mark.parametrize(
    ("start", "end"),
    [
        (None, None),
        (0.0, 0.1),
        (0.05, 0.20005),
        (0.3, None),
        (None, 0.00005),
        (0.1, 0.1),
        (9.0, None),
        (0.00205, 0.00815),
    ],
)
@pytest.mark.parametrize("every", [1, 3, 8])
def test_time_window_and_decimation(tmp_path: Path, start: float | None, end: float | None, every: int) -> None:
    blocks = make_blocks()
    recording = Recording(record(tmp_path / "run.mcap", blocks))
    for topic in (TOPIC["/column"], TOPIC["/drive"]):
        ticks = ticks_of(blocks, topic.ticks)
        first = 0 if start is None else round(start * 20_000)
        last = 10**9 if end is None else round(end * 20_000)
        wanted = (ticks >= first) & (ticks < last) & (ticks % (every * topic.ticks) == 0)
        names = topic.names[::-2]  # some, in another order than in the file
        series = recording.read(topic.path, names, start, end, every)
        assert tuple(series.values) == names
        assert same_bits(series.time, ticks[wanted] * TICK_NS / 1e9)
        for name in names:
            assert same_bits(series[name], joined(blocks, topic.path)[wanted, topic.names.index(name)])


def test_wrong_names_say_what_there_is(tmp_path: Path) -> None:
    recording = Recording(record(tmp_path / "run.mcap", make_blocks((40,))))
    with pytest.raises(InputError, match=r"no topic '/colum'; it has /pilot, /column"):
        recording.read("/colum")
    with pytest.raises(InputError, match=r"/column has no signal 'angel'; it has angle, velocity, torque"):
        recording.read("/column", ["angel"])
    with pytest.raises(InputError, match="every = 0"):
        recording.read("/column", every=0)


def test_files_that_are_no_recordings(tmp_path: Path) -> None:
    other = tmp_path / "notes.txt"
    other.write_text("hello")
    for path in (other, tmp_path / "missing.mcap", tmp_path):
        with pytest.raises(InputError, match=rf"^[^\n]*{path.name}[^\n]*$"):
            Recording(path)


# ---------------------------------------------------------------------------------------------------------------------
# MCAP: what other readers see


def test_the_library_reads_the_same_messages_in_order(tmp_path: Path) -> None:
    blocks = make_blocks()
    with record(tmp_path / "run.mcap", blocks).open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        assert summary is not None and summary.statistics is not None
        found: dict[str, list[tuple[int, int, bytes]]] = {}
        last = 0
        for schema, channel, message in reader.iter_messages(log_time_order=False):
            assert schema is not None and schema.encoding == "protobuf"
            assert message.publish_time == message.log_time
            if channel.topic in TOPIC:  # events may lie outside of an empty block
                assert message.log_time >= last
                last = message.log_time
            found.setdefault(channel.topic, []).append((message.sequence, message.log_time, message.data))
        pool = {}
        for schema in summary.schemas.values():
            files = descriptor_pb2.FileDescriptorSet.FromString(schema.data)
            pool[schema.name] = message_factory.GetMessages(files.file, descriptor_pool.DescriptorPool())[schema.name]
        schema_of = {channel.topic: summary.schemas[channel.schema_id].name for channel in summary.channels.values()}
        assert schema_of["/load_cell"] == "cls_bench.LoadCell"
        for topic in TOPICS:
            messages = found[topic.path]
            ticks = ticks_of(blocks, topic.ticks)
            assert [number for number, _, _ in messages] == (ticks // topic.ticks).tolist()
            assert [time for _, time, _ in messages] == (ticks * TICK_NS).tolist()
            decoded = [pool[schema_of[topic.path]].FromString(data) for _, _, data in messages[::17]]
            values = np.array([[getattr(message, name) for name in topic.names] for message in decoded])
            assert same_bits(values, joined(blocks, topic.path)[::17])
        counts = {summary.channels[n].topic: count for n, count in summary.statistics.channel_message_counts.items()}
        assert counts == {topic: len(messages) for topic, messages in found.items()}
        assert summary.statistics.message_end_time == max(time for m in found.values() for _, time, _ in m)
        assert summary.statistics.chunk_count == len(summary.chunk_indexes)
        assert {attachment.name for attachment in reader.iter_attachments()} == {
            "scenario.toml", "parameters.json", *INFO.mjcf,
        }  # fmt: skip
        assert [metadata.name for metadata in reader.iter_metadata()] == ["run", "wall_clock", "result", "seal"]


def test_the_library_finds_messages_through_the_indexes(tmp_path: Path) -> None:
    blocks = make_blocks()
    with record(tmp_path / "run.mcap", blocks).open("rb") as file:
        messages = make_reader(file).iter_messages(
            ["/feel", "/events"], starting_at=150_000_000, ending_before=320_000_000
        )
        found = [(channel.topic, message.log_time) for _, channel, message in messages]
    ticks = ticks_of(blocks, 8)
    expected = [("/feel", tick * TICK_NS) for tick in ticks.tolist() if 3000 <= tick < 6400]
    expected += [("/events", e.tick * TICK_NS) for b in blocks for e in b.events if 3000 <= e.tick < 6400]
    assert sorted(found) == sorted(expected)


def test_points_on_a_shapes_axis_follow_its_rotation() -> None:
    half = np.sqrt(0.5)
    about_x, about_y = (half, half, 0.0, 0.0), (half, 0.0, half, 0.0)
    assert np.allclose(along_z(_geom("capsule", quaternion=about_x), 0.5), [0.0, -0.5, 1.0])
    assert np.allclose(along_z(_geom("capsule", quaternion=about_y), 0.5), [0.5, 0.0, 1.0])


def test_poses_and_scene_for_foxglove(tmp_path: Path) -> None:
    blocks = make_blocks()
    with record(tmp_path / "run.mcap", blocks).open("rb") as file:
        messages = list(make_reader(file, validate_crcs=True).iter_messages(["/tf", "/scene"]))
    transforms = [(m.log_time, FrameTransforms.FromString(m.data)) for _, c, m in messages if c.topic == "/tf"]
    poses = np.concatenate([block.poses for block in blocks])
    assert [time for time, _ in transforms] == (ticks_of(blocks, POSE_TICKS) * TICK_NS).tolist()
    for row, (time, message) in zip(poses, transforms, strict=True):
        for body, transform in enumerate(message.transforms, start=1):
            assert (transform.parent_frame_id, transform.child_frame_id) == ("world", BODIES[body])
            assert transform.timestamp.ToNanoseconds() == time
            at, turn = transform.translation, transform.rotation
            assert [at.x, at.y, at.z, turn.w, turn.x, turn.y, turn.z] == row[body].tolist()
    (scene,) = (SceneUpdate.FromString(m.data) for _, c, m in messages if c.topic == "/scene")
    crank, column = scene.entities
    assert (crank.frame_id, column.frame_id) == ("crank", "column")
    assert (len(crank.cubes), len(crank.cylinders), len(crank.spheres)) == (2, 2, 4)
    assert sorted(sphere.pose.position.z for sphere in crank.spheres) == [0.8, 1.0, 1.0, 1.2]  # capsule: 1 ± 0.2
    assert len(column.triangles[0].points) == 3


def test_equal_runs_give_equal_bytes(tmp_path: Path) -> None:
    first = record(tmp_path / "a.mcap", make_blocks()).read_bytes()
    assert record(tmp_path / "b.mcap", make_blocks()).read_bytes() == first
    later = replace(INFO, wall_start="2027-12-31T23:59:59+00:00")
    other = record(tmp_path / "c.mcap", make_blocks(), later).read_bytes()
    assert other != first
    assert other.replace(later.wall_start.encode(), INFO.wall_start.encode()) == first


def test_the_footer_checks_the_summary(tmp_path: Path) -> None:
    content = record(tmp_path / "run.mcap", make_blocks()).read_bytes()
    start, offsets, crc = struct.unpack("<QQI", content[-28:-8])  # before the closing magic
    assert zlib.crc32(content[start:-12]) == crc
    assert start < offsets < len(content)


def test_a_topic_cannot_have_more_signals_than_one_byte_tags() -> None:
    assert message_dtype(15).itemsize == 31 + 15 * 9
    with pytest.raises(ValueError, match="1 to 15 signals, not 16"):
        message_dtype(16)


# ---------------------------------------------------------------------------------------------------------------------
# MCAP: ends that nobody wished for


def opened_truncated(path: Path) -> Recording:
    with pytest.warns(UserWarning, match="was cut short") as caught:
        recording = Recording(path)
    assert len(caught) == 1 and recording.truncated
    return recording


def test_a_killed_run_keeps_every_flushed_block(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    blocks = make_blocks()
    recorder = McapRecorder(path, INFO, topics=TOPICS)
    recorder.write(make_block(0, 1))  # shorter than any buffer
    assert (
        opened_truncated(path).read("/column")["angle"].tolist() == make_block(0, 1).signals["/column"][:, 0].tolist()
    )
    recorder.close()

    recorder = McapRecorder(path, INFO, topics=TOPICS)
    for block in blocks:
        recorder.write(block)
    recording = opened_truncated(path)  # the file is still open, nothing was finished
    assert recording.status == "incomplete"
    assert recording.events() == tuple(event for block in blocks for event in block.events)
    for topic in TOPICS:
        series = recording.read(topic.path)
        assert same_bits(series[topic.names[-1]], joined(blocks, topic.path)[:, -1])
    recorder.close()


def test_a_file_cut_anywhere_reads_up_to_the_last_complete_chunk(tmp_path: Path) -> None:
    blocks = make_blocks((200, 203, 197))
    whole = record(tmp_path / "run.mcap", blocks).read_bytes()
    cut = tmp_path / "cut.mcap"
    lengths = set()
    for size in np.linspace(60, len(whole) - 1, 180).astype(int).tolist():
        cut.write_bytes(whole[:size])
        recording = opened_truncated(cut)
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # one warning, on opening
            if "/column" in recording.topics:
                angle = recording.read("/column")["angle"]
                assert same_bits(angle, joined(blocks, "/column")[: len(angle), 0])
                lengths.add(len(angle))
                events = tuple(event for block in blocks for event in block.events)
                assert recording.events() == events[: len(recording.events())]
    assert lengths == {0, 200, 403, 600}
    cut.write_bytes(whole[:-2000] + bytes(5000))  # zeros, as some file systems leave them behind
    assert len(opened_truncated(cut).read("/column")) == 600


# ---------------------------------------------------------------------------------------------------------------------
# Recorder: both files from one thread


def test_recorder_writes_what_the_mcap_recorder_writes(tmp_path: Path) -> None:
    blocks = make_blocks()
    recorder = Recorder(tmp_path / "new" / "run.v2", INFO, topics=TOPICS, rerun=False)
    for block in blocks:
        recorder.write(block)
    recorder.finish("passed")
    recorder.finish("passed")
    assert recorder.mcap_path == tmp_path / "new" / "run.v2.mcap" and recorder.rrd_path is None
    end = Recording(recorder.mcap_path).wall_end
    assert abs(datetime.now(UTC) - datetime.fromisoformat(end)) < timedelta(minutes=1)
    assert recorder.mcap_path.read_bytes() == record(tmp_path / "ref.mcap", blocks, wall_end=end).read_bytes()
    assert list(recorder.mcap_path.parent.iterdir()) == [recorder.mcap_path]


@pytest.mark.parametrize(("error", "status"), [(None, "complete"), (KeyboardInterrupt, "interrupted")])
def test_leaving_the_context_finishes_the_files(tmp_path: Path, error: type[BaseException] | None, status: str) -> None:
    blocks = make_blocks()
    try:
        with Recorder(tmp_path / "run", INFO, topics=TOPICS) as recorder:
            for block in blocks:
                recorder.write(block)
            if error:
                raise error
    except KeyboardInterrupt:
        pass
    recording = Recording(tmp_path / "run.mcap")
    assert recording.status == status and not recording.truncated
    assert len(recording.read("/column")) == blocks[-1].end_tick


def test_ctrl_c_from_the_keyboard(tmp_path: Path) -> None:
    script = f"""
import sys; sys.path[:0] = {[str(Path(__file__).parent)]!r}
from test_recording import INFO, TOPICS, make_block
from cls_bench.recording import Recorder
from pathlib import Path
try:
    with Recorder(Path({str(tmp_path / "run")!r}), INFO, topics=TOPICS, rerun=False) as recorder:
        first = 0
        while True:
            recorder.write(make_block(first, 400))
            first += 400
            if first == 4000:
                print("running", flush=True)
except KeyboardInterrupt:
    sys.exit(3)
"""
    process = subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None and process.stdout.readline() == "running\n"
    process.send_signal(signal.SIGINT)
    assert process.wait(20) == 3
    recording = Recording(tmp_path / "run.mcap")
    assert recording.status == "interrupted" and recording.duration >= 0.19


def test_a_full_disk_is_one_line_and_keeps_what_was_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    blocks = make_blocks((4000,) * 6)
    room = 1_500_000
    written = 0
    plain = os.write

    def write(descriptor: int, data: bytes) -> int:
        nonlocal written
        if not str(Path(f"/dev/fd/{descriptor}").resolve()).endswith(".mcap"):
            return plain(descriptor, data)
        if written == room:
            raise OSError(errno.ENOSPC, "No space left on device")
        done = plain(descriptor, data[: room - written])  # as much as fits, then the error
        written += done
        return done

    monkeypatch.setattr(os, "write", write)
    with pytest.raises(OutputError) as caught, Recorder(tmp_path / "run", INFO, topics=TOPICS) as recorder:
        for block in blocks * 10:
            recorder.write(block)
    assert str(caught.value) == f"cannot write {tmp_path / 'run.mcap'}: No space left on device"
    recording = opened_truncated(tmp_path / "run.mcap")
    angle = recording.read("/column")["angle"]
    assert len(angle) >= 4000 and same_bits(angle, joined(blocks, "/column")[: len(angle), 0])
    assert "/column" in rrd_columns(tmp_path / "run.rrd")  # the other file was finished all the same


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full")
@pytest.mark.parametrize("suffix", ["mcap", "rrd"])
def test_a_device_that_is_full_from_the_start(tmp_path: Path, suffix: str) -> None:
    (tmp_path / f"run.{suffix}").symlink_to("/dev/full")
    full = rf"^cannot write .*run\.{suffix}: No space left on device$"
    with pytest.raises(OutputError, match=full), Recorder(tmp_path / "run", INFO, topics=TOPICS) as recorder:
        for block in make_blocks((4000,) * 12):
            recorder.write(block)


def test_a_folder_that_cannot_be_written(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    threads = threading.active_count()
    with pytest.raises(OutputError, match=r"^cannot write .*/file: File exists$"):
        Recorder(tmp_path / "file" / "run", INFO, topics=TOPICS)
    with pytest.raises(OutputError, match=r"^cannot write .*/taken\.rrd: Is a directory$"):
        (tmp_path / "taken.rrd").mkdir()
        Recorder(tmp_path / "taken", INFO, topics=TOPICS)
    assert threading.active_count() == threads


def test_a_bug_in_the_thread_reaches_the_caller(tmp_path: Path) -> None:
    block = make_block(0, 40)
    broken = replace(block, signals={**block.signals, "/feel": np.zeros((3, 3))})
    recorder = Recorder(tmp_path / "run", INFO, topics=TOPICS, rerun=False)
    recorder.write(broken)
    with pytest.raises(ValueError, match="broadcast"):
        recorder.finish("passed")


def test_memory_does_not_grow_with_the_run(tmp_path: Path) -> None:
    psutil = pytest.importorskip("psutil")
    block = make_block(0, 4000)
    with Recorder(tmp_path / "run", INFO, topics=TOPICS) as recorder:
        process = psutil.Process()
        sizes = []
        for number in range(150):  # 30 s: 120 MB of samples
            recorder.write(replace(block, first_tick=4000 * number))
            if number in (49, 149):
                sizes.append(process.memory_info().rss)
    assert sizes[1] - sizes[0] < 30e6
    recording = Recording(tmp_path / "run.mcap")
    tracemalloc.start()
    series = recording.read("/gearbox", ["stage1_twist"], every=8)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert len(series) == 75_000
    assert peak < 10e6  # a chunk and twice the result; the topic alone is 29 MB


# ---------------------------------------------------------------------------------------------------------------------
# Rerun


def rrd_columns(path: Path) -> dict[str, list[object]]:
    """Entity -> its chunks as record batches."""
    from rerun.chunk import RrdReader

    found: dict[str, list[object]] = {}
    for chunk in RrdReader(str(path)).stream().to_chunks():
        found.setdefault(chunk.entity_path, []).append(chunk.to_record_batch())
    return found


def rrd_table(path: Path, entity: str, column: str) -> tuple[np.ndarray, list[object]]:
    """Times [ns] and values of one column of an entity, over all its chunks in time order."""
    rows: list[tuple[int, object]] = []
    for batch in rrd_columns(path)[entity]:
        if column in batch.schema.names and "sim_time" in batch.schema.names:
            times = batch.column("sim_time").cast("int64").to_pylist()
            rows += zip(times, batch.column(column).to_pylist(), strict=True)
    rows.sort(key=lambda row: row[0])
    return np.array([time for time, _ in rows]), [value for _, value in rows]


@pytest.fixture(scope="module")
def rrd(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[Block]]:
    blocks = make_blocks((4003, 1, 7, 1203, 0, 45_789, 333))
    path = tmp_path_factory.mktemp("rerun") / "run"
    with Recorder(path, INFO, topics=TOPICS) as recorder:
        for block in blocks:
            recorder.write(block)
        recorder.finish("failed")
    assert recorder.rrd_path is not None
    return recorder.rrd_path, blocks


def test_rerun_has_every_topic_at_the_plc_rate(rrd: tuple[Path, list[Block]]) -> None:
    path, blocks = rrd
    for topic in TOPICS:
        ticks = ticks_of(blocks, topic.ticks)
        kept = ticks % 8 == 0
        times, values = rrd_table(path, topic.path, "Scalars:scalars")
        assert times.tolist() == (ticks[kept] * TICK_NS).tolist()
        assert same_bits(np.array(values), joined(blocks, topic.path)[kept])
        (static,) = (batch for batch in rrd_columns(path)[topic.path] if "SeriesLines:names" in batch.schema.names)
        names = static.column("SeriesLines:names").to_pylist()[0]
        assert names == [f"{s.name} [{s.unit}]" for s in topic.signals]


def test_rerun_has_the_plots_the_events_and_the_poses(rrd: tuple[Path, list[Block]]) -> None:
    path, blocks = rrd
    _, values = rrd_table(path, "/plots/angle_deg", "Scalars:scalars")
    column = joined(blocks, "/column")[ticks_of(blocks, 1) % 8 == 0, 0]
    feel, surface = joined(blocks, "/feel")[:, 1], joined(blocks, "/surface")[:, 0]
    assert np.allclose(values, np.rad2deg(np.stack([column, feel, surface], axis=1)), rtol=1e-12)

    times, texts = rrd_table(path, "/events", "TextLog:text")
    events = [event for block in blocks for event in block.events]
    assert sorted(zip(times.tolist(), texts, strict=True), key=str) == sorted(
        ((e.tick * TICK_NS, [f"{e.source}: {e.message}"]) for e in events), key=str
    )

    poses = np.concatenate([block.poses for block in blocks])
    for body, name in enumerate(BODIES[1:], start=1):
        times, places = rrd_table(path, f"/bench/{name}", "Transform3D:translation")
        _, turns = rrd_table(path, f"/bench/{name}", "Transform3D:quaternion")
        assert times.tolist() == (ticks_of(blocks, POSE_TICKS) * TICK_NS).tolist()
        assert np.allclose(np.array(places)[:, 0], poses[:, body, :3], atol=1e-6)
        assert np.allclose(np.array(turns)[:, 0], poses[:, body, [4, 5, 6, 3]], atol=1e-6)


def test_rerun_has_every_shape_the_status_and_a_blueprint(rrd: tuple[Path, list[Block]]) -> None:
    from rerun.chunk import RrdReader

    path, _ = rrd
    found = rrd_columns(path)
    assert {f"/bench/crank/{kind}_0" for kind in KINDS} | {"/bench/column/mesh_0"} <= set(found)
    (capsule,) = found["/bench/crank/capsule_0"]
    start = capsule.column("Capsules3D:translations").to_pylist()[0][0]
    assert np.allclose(start, [0.0, 0.0, 0.8])  # centre 1.0 less half length 0.2
    assert capsule.column("Capsules3D:lengths").to_pylist()[0][0] == pytest.approx(0.4)
    assert found["/__properties/result"][0].column("status").to_pylist() == [["failed"]]
    assert len(RrdReader(str(path)).blueprints()) == 1


def test_a_killed_rerun_file_reads_up_to_the_last_batch(tmp_path: Path) -> None:
    script = f"""
import sys, os; sys.path[:0] = {[str(Path(__file__).parent)]!r}
from test_recording import INFO, TOPICS, make_block
from cls_bench.recording.rerun_writer import RerunRecorder
from pathlib import Path
recorder = RerunRecorder(Path({str(tmp_path / "run.rrd")!r}), INFO, topics=TOPICS)
for number in range(13):  # batches of two
    recorder.write(make_block(4000 * number, 4000))
os._exit(9)
"""
    assert subprocess.run([sys.executable, "-c", script], check=False).returncode == 9
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # Rerun says that there is no footer
        times, _ = rrd_table(tmp_path / "run.rrd", "/column", "Scalars:scalars")
    assert times.tolist() == list(range(0, 48_000 * TICK_NS, 8 * TICK_NS))


@pytest.mark.parametrize("share", [0.01, 0.5, 0.99])
def test_a_rerun_file_reads_when_its_process_is_killed_in_the_midst_of_a_write(tmp_path: Path, share: float) -> None:
    """The system takes a part of a piece at least, and then there is no one left to take it back."""
    script = f"""
import sys, os; sys.path[:0] = {[str(Path(__file__).parent)]!r}
from test_recording import INFO, TOPICS, make_block
from cls_bench.recording import growing_file
from cls_bench.recording.rerun_writer import RerunRecorder
from pathlib import Path
recorder = RerunRecorder(Path({str(tmp_path / "run.rrd")!r}), INFO, topics=TOPICS)
written = os.write

def dies(descriptor, piece):
    written(descriptor, piece[: int({share} * len(piece))])
    os._exit(9)

for number in range(13):  # batches of two
    if number == 11:
        growing_file.os.write = dies
    recorder.write(make_block(4000 * number, 4000))
"""
    assert subprocess.run([sys.executable, "-c", script], check=False).returncode == 9
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # Rerun says that there is no footer
        times, _ = rrd_table(tmp_path / "run.rrd", "/column", "Scalars:scalars")
    assert times.tolist() == list(range(0, 40_000 * TICK_NS, 8 * TICK_NS))


def test_shapes_that_cannot_be_drawn_say_so(tmp_path: Path) -> None:
    info = replace(INFO, geoms=(_geom("hfield"),))
    with pytest.raises(ValueError, match="kind 'hfield'"):
        Recorder(tmp_path / "run", info, topics=TOPICS)
