"""Recordings of any rig: rates, gear stages and axes are those of the file, and what it says of them is checked."""

import json
import re
import struct
import warnings
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from cls_bench.analysis import metrics
from cls_bench.analysis.memory import Memory
from cls_bench.analysis.window import Window
from cls_bench.cli import main
from cls_bench.errors import InputError
from cls_bench.parameters import Gearbox, GearStage, Parameters
from cls_bench.recording import McapRecorder, Recorder, Recording, RunInfo
from cls_bench.recording import mcap_reader as reading
from cls_bench.recording.clock import CLOCK_KEY, clock_text, parse_clock
from cls_bench.recording.foxglove_layout import foxglove_layout
from cls_bench.recording.rerun_writer import RerunRecorder, write_rrd
from cls_bench.report import comparison, figures
from cls_bench.report.page import write_report
from cls_bench.report.recorded_run import RecordedRun
from cls_bench.scenario import Check
from cls_bench.signals import CLOCK, TOPICS, Block, Clock, Event, Topic, topics
from tests.test_recording import INFO, rrd_columns, rrd_table, same_bits
from tests.test_recording_reading import CHANNEL, changed, places, text

FAST = Clock(tick_ns=62_500, velocity_ticks=2, position_ticks=4, bus_ticks=16, plc_ticks=16)
"""Current controller at 16 kHz, PLC at 1 kHz."""

ODD = Clock(tick_ns=31_250, velocity_ticks=3, position_ticks=6, bus_ticks=4, plc_ticks=20)
"""A velocity cycle that does not divide the PLC's."""

SLOW = Clock(tick_ns=200_000, velocity_ticks=1, position_ticks=1, bus_ticks=1, plc_ticks=50)
"""PLC at 100 Hz."""

TONE = 12.5
"""Frequency of the angle of :func:`run_of` [Hz]."""

LAG = 0.004
"""Time by which its column is behind its feel model [s]."""

Group = tuple[int, str]
"""Stages and name of an axis."""


def topics_of(clock: Clock, groups: Sequence[Group]) -> tuple[Topic, ...]:
    return tuple(topic for stages, axis in groups for topic in topics(clock, stages, axis))


def run_of(
    clock: Clock, groups: Sequence[Group] = ((2, ""),), duration: float = 1.0, block: float = 0.2
) -> list[Block]:
    """Blocks whose column follows a tone behind its feel model; the n-th axis n times as far."""
    own = topics_of(clock, groups)
    length = max(1, round(block / clock.plc_s)) * clock.plc_ticks
    names = ("world", *(f"{axis}/{name}" if axis else name for _, axis in groups for name in ("column", "rod_end")))
    blocks = []
    for first in range(0, clock.tick_of(duration), length):
        ticks = min(length, clock.tick_of(duration) - first)
        rng = np.random.default_rng(first)
        signals = {}
        for topic in own:
            rows = rng.standard_normal((topic.rows(first, ticks), len(topic.signals)))
            time = np.arange(-(-first // topic.ticks), -(-(first + ticks) // topic.ticks)) * clock.time(topic.ticks)
            size = 0.1 * (1 + [axis for _, axis in groups].index(topic.axis))
            for kind, late in (("column", LAG), ("feel", 0.0)):
                if topic.path.endswith(kind):
                    rows[:, topic.names.index("angle")] = size * np.sin(2 * np.pi * TONE * (time - late))
            signals[topic.path] = rows
        every = clock.pose_ticks
        poses = rng.standard_normal((len(range(-(-first // every) * every, first + ticks, every)), len(names), 7))
        events = (Event(first + 3, "info", "scenario", f"block {len(blocks)}", clock.tick_ns),)
        blocks.append(Block(first, ticks, signals, poses, events, clock, own))
    return blocks


def info_of(blocks: Sequence[Block]) -> RunInfo:
    axes = dict.fromkeys(topic.axis for topic in blocks[0].topics)
    names = ("world", *(f"{axis}/{name}" if axis else name for axis in axes for name in ("column", "rod_end")))
    return replace(INFO, clock=blocks[0].clock, body_names=names, geoms=())


def recorded(path: Path, blocks: Sequence[Block], kept: Sequence[Topic] | None = None) -> Recording:
    recorder = McapRecorder(path, info_of(blocks), topics=blocks[0].topics if kept is None else kept)
    for block in blocks:
        recorder.write(block)
    recorder.finish("passed")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return Recording(path)


def column_of(blocks: Sequence[Block], signal: str) -> np.ndarray:
    return np.concatenate([block[signal] for block in blocks])


RIGS: dict[str, tuple[Clock, list[Group]]] = {
    "16 kHz drive, 1 kHz PLC": (FAST, [(2, "")]),
    "no stage": (CLOCK, [(0, "")]),
    "one stage": (FAST, [(1, "")]),
    "three stages": (ODD, [(3, "")]),
    "100 Hz": (SLOW, [(1, "")]),
    "two axes": (FAST, [(2, "pitch"), (0, "roll")]),
    "three axes": (CLOCK, [(2, "pitch"), (3, "roll"), (1, "yaw")]),
}


@pytest.mark.parametrize("rig", RIGS)
def test_a_run_of_any_rig_comes_back_bit_for_bit_at_its_own_times(rig: str, tmp_path: Path) -> None:
    clock, groups = RIGS[rig]
    blocks = run_of(clock, groups)
    recording = recorded(tmp_path / "run.mcap", blocks)
    assert recording.clock == clock and tuple(recording.topics.values()) == topics_of(clock, groups)
    assert recording.duration == pytest.approx(1.0, abs=1e-12) and recording.doubts == ()
    for topic in blocks[0].topics:
        series = recording.read(topic.path)
        assert same_bits(series.time, np.arange(len(series)) * (topic.ticks * clock.tick_ns) / 1e9)
        for name in topic.names:
            assert same_bits(series[name], column_of(blocks, f"{topic.path}.{name}"))
    assert [event.time for event in recording.events()] == [block.events[0].time for block in blocks]
    part = recording.read(f"{blocks[0].topics[0].path.rpartition('/')[0]}/column", ["angle"], 0.3, 0.4)
    assert part.time[0] == pytest.approx(0.3, abs=clock.tick_s) and part.time[-1] < 0.4
    time, poses = recording.poses()
    assert np.allclose(np.diff(time), clock.time(clock.pose_ticks)) and poses.shape[1] == 1 + 2 * len(groups)


@pytest.mark.parametrize("rig", RIGS)
def test_blocks_of_any_rig_are_those_that_were_recorded(rig: str, tmp_path: Path) -> None:
    blocks = run_of(*RIGS[rig])
    recording = recorded(tmp_path / "run.mcap", blocks)
    for block, read in zip(blocks, recording.blocks(), strict=True):
        assert (read.first_tick, read.ticks, read.events) == (block.first_tick, block.ticks, block.events)
        assert (read.clock, read.topics) == (block.clock, block.topics)
        for topic, rows in read:
            assert np.array_equal(rows, block.signals[topic.path])
        assert np.array_equal(read.poses[:, 1:], block.poses[:, 1:])
    assert recording.run_info().clock == blocks[0].clock


@pytest.mark.parametrize("rig", RIGS)
def test_metrics_of_any_rig_have_the_right_times(rig: str, tmp_path: Path) -> None:
    clock, groups = RIGS[rig]
    blocks = run_of(clock, groups, 4.0)
    recording = recorded(tmp_path / "run.mcap", blocks)
    for number, (_, axis) in enumerate(groups, start=1):
        window = Window(recording, 0.5, 3.5, Parameters(), axis=axis)
        assert window.rate == pytest.approx(1.0 / clock.plc_s) and window.rows == round(3.0 / clock.plc_s)
        assert window.time[0] == 0.5 and window.time[-1] == pytest.approx(3.5 - clock.plc_s)
        expected = {
            "oscillation_frequency_hz": TONE, "tracking_lag_ms": 1e3 * LAG,
            "oscillation_amplitude_deg": np.rad2deg(0.1) * number,
        }  # fmt: skip
        for name, value in expected.items():
            arguments = {"above_hz": 5.0} if name.startswith("oscillation") else {}
            check = Check(name=name, metric=name, window=(0.5, 3.5), arguments=arguments)
            found = metrics.evaluate(check, window)
            assert found.value == pytest.approx(value, rel=0.05), (name, found.note)


@pytest.mark.parametrize("rig", RIGS)
def test_memory_and_recording_give_the_same_samples(rig: str, tmp_path: Path) -> None:
    clock, groups = RIGS[rig]
    blocks = run_of(clock, groups)
    recording = recorded(tmp_path / "run.mcap", blocks)
    names = [f"{'/' + groups[-1][1] if groups[-1][1] else ''}{name}" for name in ("/column.angle", "/drive.current")]
    checks = [Check.model_construct(name=name, metric="mean", signal=name, window=(0.33, 0.77)) for name in names]
    memory = Memory(checks, clock, blocks[0].topics)
    for block in blocks:
        memory.keep(block)
    ours, theirs = (Window(source, 0.33, 0.77, Parameters()) for source in (memory, recording))
    for name in names:
        assert len(ours[name]) == ours.rows > 40 and np.array_equal(ours[name], theirs[name])
        mean = Check.model_construct(name=name, metric="mean", signal=name, window=(0.33, 0.77), arguments={})
        assert metrics.evaluate(mean, ours) == metrics.evaluate(mean, theirs)
    with pytest.raises(ValueError, match="a block of Clock"):
        memory.keep(replace(blocks[0], clock=clock._replace(plc_ticks=2 * clock.plc_ticks)))


# ---------------------------------------------------------------------------------------------------------------------
# Stages and axes


def test_a_stage_that_is_not_there_is_said(tmp_path: Path) -> None:
    recording = recorded(tmp_path / "run.mcap", run_of(CLOCK, [(1, "")]))
    window = Window(recording, 0.1, 0.9, Parameters())
    assert window.is_complete("/gearbox.stage1_torque")
    with pytest.raises(InputError, match="has no signal 'stage2_torque'; it has stage1_twist, stage1_torque, "):
        window["/gearbox.stage2_torque"]
    check = Check.model_construct(
        name="x", metric="mean", signal="/gearbox.stage2_torque", window=(0.1, 0.9), arguments={}
    )
    metrics.validate(check)  # another rig may have it
    memory = Memory([check], CLOCK, recording.known_topics)
    note = "the run has no /gearbox.stage2_torque"
    assert note in metrics.evaluate(check, Window(memory, 0.1, 0.9, Parameters())).note
    direct = recorded(tmp_path / "direct.mcap", run_of(CLOCK, [(0, "")]))
    with pytest.raises(InputError, match="has no topic '/gearbox'; it has /pilot, /column, "):
        Window(direct, 0.1, 0.9, Parameters())["/gearbox.stage1_torque"]


def test_of_several_axes_one_is_named(tmp_path: Path) -> None:
    blocks = run_of(FAST, [(2, "pitch"), (0, "roll")])
    recording = recorded(tmp_path / "run.mcap", blocks)
    with pytest.raises(InputError, match=r"^/column is there of pitch and roll: say which axis$"):
        Window(recording, 0.1, 0.9, Parameters())["/column.angle"]
    roll = Window(recording, 0.0, 1.0, Parameters(), axis="roll")
    assert np.array_equal(roll["/column.angle"], column_of(blocks, "/roll/column.angle")[::16])
    assert np.array_equal(roll["/pitch/column.angle"], column_of(blocks, "/pitch/column.angle")[::16])
    with pytest.raises(InputError, match="has no topic '/roll/gearbox'"):
        roll["/gearbox.stage1_torque"]
    check = Check.model_construct(
        name="x", metric="maximum", signal="/pitch/column.angle", window=(0.0, 1.0), arguments={}
    )
    assert metrics.signals_of(check) == {"/pitch/column.angle"} and metrics.axis_of(check) == "pitch"
    for wrong in ("/pitch/colum.angle", "/a/b/column.angle", "/Pitch/column.angle", "column.angle"):
        with pytest.raises(InputError, match=r"names no topic; valid: /pilot\.…, /column\.…"):
            metrics.validate(check.model_copy(update={"signal": wrong}))


def test_less_is_recorded_of_any_rig(tmp_path: Path) -> None:
    blocks = run_of(FAST, [(3, "pitch"), (1, "roll")])
    kept = [
        replace(topic, ticks=80, signals=topic.signals[1:]) if topic.path == "/pitch/gearbox" else topic
        for topic in blocks[0].topics if not topic.path.startswith("/roll/feel")
    ]  # fmt: skip
    recording = recorded(tmp_path / "run.mcap", blocks, kept)
    assert list(recording.topics.values()) == kept and recording.known_topics == blocks[0].topics
    series = recording.read("/pitch/gearbox", ["stage3_twist"])
    assert np.array_equal(series["stage3_twist"], column_of(blocks, "/pitch/gearbox.stage3_twist")[::80])
    assert np.allclose(np.diff(series.time), 0.005)
    block = next(recording.blocks())
    held = block["/pitch/gearbox.stage2_torque"]
    assert len(held) == block.ticks and len(set(held[:80])) == 1 and held[80] != held[79]
    assert np.isnan(block["/roll/feel.angle"]).all() and np.isnan(block["/pitch/gearbox.stage1_twist"]).all()
    with pytest.raises(InputError, match=r"^/pitch/gearbox was recorded at 200 Hz, not at 1000 Hz$"):
        Window(recording, 0.0, 1.0, Parameters())["/pitch/gearbox.stage3_twist"]


def test_more_axes_than_a_bench_has_are_refused(tmp_path: Path) -> None:
    groups = [(0, f"a{k}") for k in range(9)]
    path = recorded(tmp_path / "run.mcap", run_of(CLOCK, groups, 0.2)).path
    with pytest.raises(InputError, match=r"^[^\n]*has 9 axes, 8 at most are read$"):
        list(Recording(path).blocks())


# ---------------------------------------------------------------------------------------------------------------------
# What a file says of its clock


def channel_edit(key: str, value: str | None, topic: str = "") -> Callable[[list[tuple[int, bytes]]], None]:
    """Changes a value in the metadata of all channels, or of that of ``topic``; takes it out for None."""

    def edit(records: list[tuple[int, bytes]]) -> None:
        for k in places(records, CHANNEL):
            body, at = records[k][1], 4
            ends = []
            for _ in range(2):
                at += 4 + struct.unpack_from("<I", body, at)[0]
                ends.append(at)
            if topic and body[8 : ends[0]].decode() != topic:
                continue
            entries, inside = {}, at + 4
            while inside < len(body):
                pair = []
                for _ in range(2):
                    size = struct.unpack_from("<I", body, inside)[0]
                    pair.append(body[inside + 4 : inside + 4 + size].decode())
                    inside += 4 + size
                entries[pair[0]] = pair[1]
            entries.pop(key, None)
            if value is not None:
                entries[key] = value
            packed = b"".join(text(name) + text(said) for name, said in entries.items())
            records[k] = (CHANNEL, body[:at] + struct.pack("<I", len(packed)) + packed)

    return edit


def test_a_recording_of_old_is_of_the_old_rates(tmp_path: Path) -> None:
    blocks = run_of(CLOCK)
    source = recorded(tmp_path / "run.mcap", blocks).path
    old = Recording(changed(source, tmp_path / "old.mcap", channel_edit(CLOCK_KEY, None)))
    assert old.clock == CLOCK and tuple(old.topics.values()) == TOPICS
    assert same_bits(old.read("/column")["angle"], column_of(blocks, "/column.angle"))


@pytest.mark.parametrize("clock", [CLOCK, FAST, ODD, SLOW], ids=str)
def test_a_clock_as_text(clock: Clock) -> None:
    assert parse_clock(clock_text(clock)) == clock


GOOD = clock_text(FAST)


@pytest.mark.parametrize(
    ("said", "why"),
    [
        ("", '"" is none'),
        ("tick_ns=50000", "is none"),
        (GOOD.replace("62500", "0"), "tick_ns = 0 is not 10 to 200 µs"),
        (GOOD.replace("62500", "9999"), "tick_ns = 9999 is not 10 to 200 µs"),
        (GOOD.replace("62500", "999999999"), "tick_ns = 999999999 is not 10 to 200 µs"),
        (GOOD.replace("62500", "9" * 400), "is none"),
        (GOOD.replace("62500", "-62500"), "is none"),
        (GOOD.replace("62500", "6.25e4"), "is none"),
        (GOOD.replace("62500", "062500"), "is none"),
        (GOOD.replace("62500", "٦٢٥٠٠"), "is none"),
        (GOOD.replace("plc_ticks=16", "plc_ticks=0"), "plc_ticks = 0 is not 1 to 64"),
        (GOOD.replace("plc_ticks=16", "plc_ticks=24"), "plc_ticks = 24 is no multiple of bus_ticks = 16"),
        (GOOD.replace("plc_ticks=16", "plc_ticks=128"), "plc_ticks = 128 is not 1 to 64"),
        (GOOD.replace("62500", "200000").replace("plc_ticks=16", "plc_ticks=64"), "plc_ticks = 64 is not 1 to 50"),
        (GOOD.replace("position_ticks=4", "position_ticks=3"), "position_ticks = 3 is no multiple of velocity_ticks"),
        (GOOD.replace(" bus_ticks=16", ""), "is none"),
        (GOOD + " more_ticks=1", "is none"),
        (GOOD + "\n\x1b[2J" + "x" * 100_000, "is none"),
    ],
)
def test_a_clock_that_no_bench_has_is_one_line(said: str, why: str, tmp_path: Path) -> None:
    source = recorded(tmp_path / "run.mcap", run_of(FAST, duration=0.2)).path
    hostile = changed(source, tmp_path / "hostile.mcap", channel_edit(CLOCK_KEY, said))
    line = rf"(?s)^[^\n]*hostile.mcap: damaged: its clock [^\n]*({why})[^\n]*$"
    with pytest.raises(InputError, match=line) as caught:
        Recording(hostile)
    assert len(str(caught.value)) < 500 and "\x1b" not in str(caught.value)
    done = CliRunner().invoke(main, ["view", "--layout", str(tmp_path / "x.json"), str(hostile)])
    assert done.exit_code == 2 and done.stderr.count("\n") == 1 and not (tmp_path / "x.json").exists()


@pytest.mark.parametrize("said", [clock_text(CLOCK), None], ids=["another", "none"])
def test_all_topics_are_of_one_clock(said: str | None, tmp_path: Path) -> None:
    source = recorded(tmp_path / "run.mcap", run_of(FAST, duration=0.2)).path
    mixed = changed(source, tmp_path / "mixed.mcap", channel_edit(CLOCK_KEY, said, "/feel"))
    with pytest.raises(InputError, match="its topics are of different clocks"):
        Recording(mixed)


def test_samples_at_times_that_its_clock_has_not_are_damage(tmp_path: Path) -> None:
    source = recorded(tmp_path / "run.mcap", run_of(FAST, duration=0.4)).path
    other = changed(source, tmp_path / "other.mcap", channel_edit(CLOCK_KEY, clock_text(CLOCK)))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        recording = Recording(other)
        assert len(recording.read("/column")) == 0
    assert any("at times at which there are none" in line for line in recording.doubts)


def test_blocks_of_a_slow_file_are_bounded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One sample a second for an hour is 3600 samples, and not 72 million rows of every topic at once."""
    monkeypatch.setattr(reading, "LONGEST_BLOCK", 1000)
    blocks = run_of(CLOCK, duration=0.4)
    kept = [replace(topic, ticks=4000, signals=topic.signals[:1]) for topic in TOPICS if topic.path == "/column"]
    recording = recorded(tmp_path / "run.mcap", blocks, kept)
    found = list(recording.blocks())
    assert max(block.ticks for block in found) == 1000
    assert sum(block.ticks for block in found) == 8000
    assert [block.first_tick for block in found] == list(range(0, 8000, 1000))
    angle = np.concatenate([block["/column.angle"] for block in found])
    assert np.array_equal(angle, np.repeat(column_of(blocks, "/column.angle")[::4000], 4000))


def test_a_window_holds_no_more_than_an_hour_at_the_usual_rate(tmp_path: Path) -> None:
    quick = Clock(10_000, 1, 1, 1, 1)
    recording = recorded(tmp_path / "run.mcap", run_of(quick, duration=0.05, block=0.05))
    window = Window(recording, 0.0, 3600.0, Parameters())
    for read in (lambda: window["/column.angle"], lambda: window.time):
        with pytest.raises(InputError, match=r"^0 to 3600 s are 360000000 samples at 100000 Hz, 9000001 at most$"):
            read()
    check = Check(name="x", metric="mean", signal="/column.angle", window=(0.0, 3600.0))
    assert "9000001 at most" in metrics.evaluate(check, window).note


@pytest.mark.parametrize("make", [McapRecorder, RerunRecorder])
def test_a_file_takes_blocks_of_its_own_clock_alone(make: type, tmp_path: Path) -> None:
    blocks = run_of(FAST, duration=0.2)
    recorder = make(tmp_path / "run", INFO, topics=TOPICS)
    with pytest.raises(ValueError, match="a block of Clock"):
        recorder.write(blocks[0])
    recorder.close()


def test_a_recorder_says_how_far_it_is_by_its_clock(tmp_path: Path) -> None:
    blocks = run_of(FAST)
    with Recorder(tmp_path / "run", info_of(blocks), topics=blocks[0].topics, rerun=False) as recorder:
        for block in blocks:
            recorder.write(block)
        recorder.flush()
        assert recorder.written_s == pytest.approx(1.0)


# ---------------------------------------------------------------------------------------------------------------------
# Views


@pytest.mark.parametrize("rig", RIGS)
def test_the_view_of_any_rig_is_the_same_while_recording_and_after(rig: str, tmp_path: Path) -> None:
    clock, groups = RIGS[rig]
    blocks = run_of(clock, groups)
    path, later = tmp_path / "run.rrd", tmp_path / "later.rrd"
    recorder = RerunRecorder(path, info_of(blocks), topics=blocks[0].topics)
    for block in blocks:
        recorder.write(block)
    recorder.finish("passed")
    write_rrd([recorded(tmp_path / "run.mcap", blocks)], later)
    shown = rrd_columns(path)
    assert {entity for entity in shown if not entity.startswith("/__")} == {
        entity for entity in rrd_columns(later) if not entity.startswith("/__")
    }
    for stages, axis in groups:
        root = f"/{axis}" if axis else ""
        for entity in ("/column", "/plots/torque", "/torque_over_angle/now", "/bench/forces"):
            (times, values), again = (rrd_table(file, f"{root}{entity}", _kind(entity)) for file in (path, later))
            assert np.array_equal(times, again[0]) and values == again[1], entity
            assert len(times) and (times % (clock.plc_ticks * clock.tick_ns) == 0).all(), entity
        times, values = rrd_table(path, f"{root}/column", "Scalars:scalars")
        assert np.allclose(np.diff(times), 1e9 * clock.plc_s)
        rows = column_of(blocks, f"{root}/column.angle")[:: clock.plc_ticks]
        assert np.array_equal(np.array(values)[:, 0], rows)
        assert (f"{root}/plots/mesh_torque" in shown) == (f"{root}/gearbox" in shown) == (stages > 0)
        if stages:
            (look,) = (b for b in shown[f"{root}/plots/mesh_torque"] if "SeriesLines:names" in b.schema.names)
            expected = [f"stage {n} [N·m]" for n in range(1, stages + 1)]
            assert look.column("SeriesLines:names").to_pylist()[0] == expected


def _kind(entity: str) -> str:
    kinds = {"/torque_over_angle/now": "Points2D:positions", "/bench/forces": "Arrows3D:vectors"}
    return kinds.get(entity, "Scalars:scalars")


def test_without_a_rod_there_is_the_hand_s_arrow_alone(tmp_path: Path) -> None:
    blocks = [replace(block, poses=block.poses[:, :2]) for block in run_of(CLOCK, [(0, "")], 0.4)]
    info = replace(info_of(blocks), body_names=("world", "column"))
    recorder = RerunRecorder(tmp_path / "run.rrd", info, topics=blocks[0].topics)
    for block in blocks:
        recorder.write(block)
    recorder.finish("passed")
    _, vectors = rrd_table(tmp_path / "run.rrd", "/bench/forces", "Arrows3D:vectors")
    assert {len(arrows) for arrows in vectors} == {1}


def test_two_runs_of_different_rigs_stand_side_by_side(tmp_path: Path) -> None:
    first = recorded(tmp_path / "a.mcap", run_of(CLOCK, duration=0.4))
    second = recorded(tmp_path / "b.mcap", run_of(FAST, [(0, "pitch"), (1, "roll")], 0.4))
    write_rrd([first, second], tmp_path / "both.rrd")
    found = set(rrd_columns(tmp_path / "both.rrd"))
    assert {"/run_1/column", "/run_1/plots/mesh_torque", "/run_2/pitch/column", "/run_2/roll/plots/torque"} <= found
    assert "/run_2/pitch/plots/mesh_torque" not in found and "/run_2/column" not in found


@pytest.mark.parametrize(
    "parameters", [{"feel": 3}, {"feel": {"aft_limit": {"angle": "x"}}, "column": []}, {"a": None}]
)
def test_parameters_that_say_no_limits_cost_the_travel_lane_alone(parameters: dict, tmp_path: Path) -> None:
    blocks = run_of(CLOCK, duration=0.2)
    recorder = RerunRecorder(tmp_path / "run.rrd", replace(info_of(blocks), parameters=parameters), topics=TOPICS)
    for block in blocks:
        recorder.write(block)
    recorder.finish("passed")
    assert "/plots/torque" in rrd_columns(tmp_path / "run.rrd")


def _panels(layout: dict, node: object) -> list[str]:
    if isinstance(node, str):
        inside = [_panels(layout, tab["layout"]) for tab in layout["configById"][node].get("tabs", [])]
        return [node, *(name for names in inside for name in names)]
    assert isinstance(node, dict)
    return _panels(layout, node["first"]) + _panels(layout, node["second"])


@pytest.mark.parametrize("rig", RIGS)
def test_the_layout_for_lichtblick_fits_the_recording(rig: str, tmp_path: Path) -> None:
    clock, groups = RIGS[rig]
    recording = recorded(tmp_path / "run.mcap", run_of(clock, groups, 0.2))
    target = tmp_path / "layout.json"
    done = CliRunner().invoke(main, ["view", "--layout", str(target), str(recording.path)])
    assert (done.exit_code, done.output) == (0, f"{target}\n")
    layout = json.loads(target.read_text())
    there = {f"{topic.path}.{name}" for topic in recording.topics.values() for name in topic.names}
    panels = layout["configById"].values()
    values = {path["value"] for panel in panels for path in panel.get("paths", [])}
    assert values <= there
    meshes = {value for value in values if value.endswith("_torque") and "gearbox" in value}
    assert len(meshes) == sum(stages for stages, _ in groups)
    assert sorted(_panels(layout, layout["layout"])) == sorted(layout["configById"])
    if len(groups) > 1:
        assert [tab["title"] for tab in layout["configById"]["Tab!axes"]["tabs"]] == [axis for _, axis in groups]


def test_the_layout_in_the_documents_is_that_of_the_thesis_s_rig() -> None:
    shipped = Path(__file__).parent.parent / "docs" / "lichtblick.json"
    assert json.loads(shipped.read_text()) == foxglove_layout(TOPICS)


def test_a_layout_is_there_for_what_was_recorded_of_little() -> None:
    column = [replace(topic, signals=topic.signals[:1]) for topic in TOPICS if topic.path == "/column"]
    layout = foxglove_layout(column)
    assert sorted(_panels(layout, layout["layout"])) == ["3D!bench", "Plot!angle", "RosOut!events"]
    assert sorted(_panels(foxglove_layout(()), foxglove_layout(())["layout"])) == ["3D!bench", "RosOut!events"]


# ---------------------------------------------------------------------------------------------------------------------
# Reports


def toml_of(clock: Clock, stages: int = 2) -> bytes:
    """A scenario of a synthetic run, with a check for each kind of figure that needs no release."""
    cycles = {
        "current": clock.tick_s, "velocity": clock.velocity_s, "position": clock.position_s,
        "bus": clock.time(clock.bus_ticks), "plc": clock.plc_s,
    }  # fmt: skip
    rates = "\n".join(f"{name}_cycle = {value:.9f}" for name, value in cycles.items())
    kinds = ("oscillation_amplitude_deg", "tracking_ripple_deg", "hysteresis", "breakout_torque")
    checks = "\n".join(
        f'[[checks]]\nname = "{kind}"\nmetric = "{kind}"\nwindow = [0.5, 1.5]\n' for kind in kinds
    )
    return (
        f'title = "synthetic"\nduration = 2.0\n[parameters.simulation]\nsubsteps = 8\n'
        f"[parameters.rates]\n{rates}\n[parameters.gearbox]\n"
        f"stages = {stages}\n{checks}"
    ).encode()


def reported(path: Path, clock: Clock, groups: Sequence[Group], toml: bytes | None = None) -> RecordedRun:
    blocks = run_of(clock, groups, 2.0)
    info = replace(info_of(blocks), scenario_toml=toml or toml_of(clock, groups[0][0]), scenario_name=path.stem)
    recorder = McapRecorder(path, info, topics=blocks[0].topics)
    for block in blocks:
        recorder.write(block)
    recorder.finish("complete", verdict="passed")
    return RecordedRun(path)


REPORTED = {name: rig for name, rig in RIGS.items() if "axes" not in name}


@pytest.mark.parametrize("rig", REPORTED)
def test_a_report_of_any_rig(rig: str, tmp_path: Path) -> None:
    clock, groups = REPORTED[rig]
    run = reported(tmp_path / "run.mcap", clock, groups)
    assert run.simulated == topics_of(clock, groups) and not any("clock" in line for line in run.doubts)
    left_out: list[str] = []
    names = [picture.name for picture in figures.pictures(run, left_out)]
    assert left_out == []
    assert names == [
        "torque_over_displacement", "static", "squeezing", "squeezing_close", "imperfections", "overview"
    ]  # fmt: skip
    page = write_report([run], tmp_path / "page").read_text()
    rows = re.findall(r"<td[^>]*>(/[a-z_]+)</td>\s*<td[^>]*>([^<]*)</td>", page)
    assert rows == [(topic.path, f"{topic.rate:g}") for topic in run.simulated]


def test_a_clock_that_is_not_the_scenario_s_is_doubted(tmp_path: Path) -> None:
    run = reported(tmp_path / "run.mcap", FAST, [(2, "")], toml_of(CLOCK))
    said = "is a tick of 62.5 µs and 16 in a PLC cycle, that of its scenario a tick of 50 µs and 8 in a PLC cycle"
    assert any(line == f"the clock of its samples {said}" for line in run.doubts)


def test_figures_of_several_axes_are_drawn_one_axis_after_the_other(tmp_path: Path) -> None:
    toml = b'title = "two"\nduration = 2.0\n'
    run = reported(tmp_path / "run.mcap", FAST, [(2, "pitch"), (0, "roll")], toml)
    assert run.axes == ("pitch", "roll")
    left_out: list[str] = []
    pictures = list(figures.pictures(run, left_out))
    assert left_out == []
    assert [(p.name, p.title) for p in pictures] == [
        ("pitch_overview", "pitch: The whole run"), ("roll_overview", "roll: The whole run")
    ]  # fmt: skip
    for axis in run.axes:
        angle = run.recording.read(f"/{axis}/column", ["angle"], every=16)["angle"]
        assert np.array_equal(run.on(axis).whole["/column.angle"], angle)
        assert len(run.on(axis).powered) == 2000
    signals = comparison.signals_of(run)
    assert signals[0] == "/pitch/column.angle" and signals[-1] == "/roll/drive.torque"
    assert len(list(comparison.overlays(run, run, signals, None, []))) == 6


def test_runs_of_different_rates_are_compared_at_the_slower_one_s_times(tmp_path: Path) -> None:
    a, b = (
        reported(tmp_path / f"{name}.mcap", clock, [(2, "")]) for name, clock in (("a", CLOCK), ("b", FAST))
    )  # fmt: skip
    for first, second in ((a, b), (b, a)):
        missing: list[str] = []
        (picture,) = comparison.overlays(first, second, ["/column.angle"], None, missing)
        assert missing == [] and "2500 samples a second is interpolated" in picture.caption
        time, one, other = comparison._together(first.whole, second.whole, "/column.angle")
        assert np.allclose(time, np.arange(2000) / 1000.0)
        assert np.abs(one - other).max() < 0.1 * (np.pi * TONE * 0.0004) ** 2  # the chord under the sine
        (line,) = (axes for axes in picture.figure.axes[1].lines)
        assert np.abs(line.get_ydata()).max() < 0.01


def test_mesh_orders_are_those_of_the_stages_there_are() -> None:
    planetary, worm = GearStage(ratio=5.0, teeth=18), GearStage(kind="worm", ratio=20.0, teeth=2)
    belt = GearStage(kind="belt", ratio=2.0, teeth=0)
    for stages, expected in (
        ((), []), ((planetary,), [(1, 14.4)]), ((planetary, planetary), [(1, 14.4), (2, 2.88)]),
        ((worm,), [(1, 2.0)]), ((belt, worm, planetary), [(2, 1.0), (3, 18 * 0.8 / 40.0)]),
    ):  # fmt: skip
        box = Gearbox(stages=len(stages), **{f"stage{n}": stage for n, stage in enumerate(stages, start=1)})
        found = figures.mesh_orders(box)
        assert [number for number, _ in found] == [number for number, _ in expected]
        assert [order for _, order in found] == pytest.approx([order for _, order in expected])
