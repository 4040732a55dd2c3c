"""How recordings are written: beside each other, on full disks, until they are killed, and with less in them."""

import errno
import html
import json
import os
import random
import resource
import signal
import subprocess
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader

from cls_bench.cli import main
from cls_bench.errors import InputError, OutputError
from cls_bench.experiment import run
from cls_bench.recording import McapRecorder, Recorder, Recording
from cls_bench.recording import recorder as recorder_module
from cls_bench.recording.layout import Samples
from cls_bench.recording.rerun_writer import RerunRecorder, write_rrd
from cls_bench.recording.seal import seal_of
from cls_bench.report.page import write_report
from cls_bench.report.recorded_run import RecordedRun
from cls_bench.scenario import parse_scenario
from cls_bench.signals import CLOCK, TOPIC, TOPICS, Block
from tests.test_recording import INFO, make_block, make_blocks, rrd_columns, rrd_table
from tests.test_recording_reading import with_result

ROOT = Path(__file__).parents[1]

TOML = """
title = "short"
duration = 0.8
[[hand]]
at = 0.0
kind = "step"
to_deg = 3.0
[[checks]]
name = "peak"
metric = "maximum"
signal = "/column.angle"
window = [0.0, 0.8]
[[checks]]
name = "tracking"
metric = "tracking_error_rms_deg"
window = [0.2, 0.8]
"""

COMMAND = [sys.executable, "-c", "from cls_bench.cli import main; main()"]


def cls_bench(*arguments: object, **how: object) -> "subprocess.Popen[str]":
    return subprocess.Popen([*COMMAND, *map(str, arguments)], cwd=ROOT, stdout=-1, stderr=-1, text=True, **how)  # type: ignore[call-overload,no-any-return]


# --- beside each other -----------------------------------------------------------------------------------------------

INERTIAS = [0.3 + 0.05 * number for number in range(10)]


def peak(inertia: float, folder: Path) -> float:
    return run(parse_scenario(TOML, set=[f"feel.inertia={inertia}"]), out=folder, rerun=False)["peak"]


def test_ten_threads_record_ten_runs(tmp_path: Path) -> None:
    alone = [peak(inertia, tmp_path / "alone") for inertia in INERTIAS]
    assert len(set(alone)) == len(alone)
    with ThreadPoolExecutor(10) as pool:
        results = list(
            pool.map(lambda i: run(parse_scenario(TOML, set=[f"feel.inertia={i}"]), out=tmp_path / "all"), INERTIAS)
        )
    assert [result["peak"] for result in results] == alone
    for result, inertia in zip(results, INERTIAS, strict=True):
        assert result.recording().parameters["feel"]["inertia"] == inertia
        assert json.loads(result.recording().result["checks"])["peak"] == result["peak"]
        assert result.rrd == result.mcap.with_suffix(".rrd") and result.rrd.stat().st_size > 0
    assert len(list((tmp_path / "all").iterdir())) == 20


@pytest.mark.parametrize("count", [3, pytest.param(10, marks=pytest.mark.slow)])
def test_processes_record_their_own_runs(tmp_path: Path, count: int) -> None:
    (tmp_path / "short.toml").write_text(TOML)
    inertias = INERTIAS[:count]
    started = [
        cls_bench("run", tmp_path / "short.toml", "--out", tmp_path / "all", "--json", "--set", f"feel.inertia={i}")
        for i in inertias
    ]
    found = [json.loads(process.communicate()[0]) for process in started]
    assert [one["metrics"]["peak"]["value"] for one in found] == [peak(i, tmp_path / "alone") for i in inertias]
    for one, inertia in zip(found, inertias, strict=True):
        recording = Recording(Path(one["recordings"]["mcap"]))
        assert recording.parameters["feel"]["inertia"] == inertia
    assert len(list((tmp_path / "all").iterdir())) == 2 * count


def test_reports_of_recordings_with_one_name_stand_side_by_side(tmp_path: Path) -> None:
    runs = []
    for number, inertia in enumerate((0.3, 0.4)):
        result = run(parse_scenario(TOML, set=[f"feel.inertia={inertia}"]), out=tmp_path, rerun=False)
        (tmp_path / str(number)).mkdir()
        runs.append(RecordedRun(result.mcap.rename(tmp_path / str(number) / "same.mcap")))
    pages = [write_report([run], tmp_path / "reports") for run in (*runs, runs[0])]
    assert [page.name for page in pages] == ["same.html", "same-2.html", "same.html"]
    assert "feel.inertia=0.3" in pages[0].read_text() and "feel.inertia=0.4" in pages[1].read_text()
    folders = sorted(path.name for path in (tmp_path / "reports").iterdir())
    assert folders == ["same-2.html", "same-2_figures", "same.html", "same_figures"]


def test_a_long_name_is_shortened(tmp_path: Path) -> None:
    file = tmp_path / ("ü" * 120 + "x.toml")
    file.write_text(TOML)
    done = CliRunner().invoke(main, ["run", str(file), "--out", str(tmp_path / "out"), "--json"])
    assert done.exit_code == 0, done.output
    recording = Path(json.loads(done.stdout)["recordings"]["mcap"])
    assert recording.name.startswith("ü" * 60) and len(os.fsencode(recording.name)) < 220
    page = write_report([RecordedRun(recording)], tmp_path / "reports")
    assert page.exists() and Recording(recording).scenario_name == file.stem


def test_a_name_that_is_no_text_is_recorded(tmp_path: Path) -> None:
    file = tmp_path / os.fsdecode(b"sc\xffn.toml")
    file.write_text(TOML)
    result = run(file, out=tmp_path, rerun=False)
    assert result.recording().scenario_name == "sc\\udcffn" and result.mcap.exists()


# --- full disks ------------------------------------------------------------------------------------------------------


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Callable[[str], Path]]:
    """Mounts a file system of a given size; skips where that is not allowed."""
    disk = tmp_path / "disk"
    disk.mkdir()

    def mount(options: str) -> Path:
        command = ["mount", "-t", "tmpfs", "-o", options, "tmpfs", str(disk)]
        try:
            done = subprocess.run(command, capture_output=True, check=False)
        except FileNotFoundError:
            pytest.skip("no mount")
        if done.returncode:
            pytest.skip("a file system of its own can be mounted by root only")
        return disk

    yield mount
    subprocess.run(["umount", str(disk)], capture_output=True, check=False)


def said(process: "subprocess.Popen[str]") -> str:
    """The one line with which a command ends that cannot write."""
    _, errors = process.communicate(timeout=120)
    assert process.returncode == 2, errors
    (line,) = errors.splitlines()
    return line


@pytest.mark.parametrize("options", ["size=64k", "size=1m", "size=5m", "nr_inodes=2", "size=1m,ro"])
def test_a_full_disk_is_one_line(tmp_path: Path, small_disk: Callable[[str], Path], options: str) -> None:
    (tmp_path / "short.toml").write_text(TOML.replace("0.8", "3.0"))
    disk = small_disk(options)
    line = said(cls_bench("run", tmp_path / "short.toml", "--out", disk))
    assert line.startswith("error: cannot write ")
    assert line.endswith("Read-only file system" if options.endswith("ro") else "No space left on device")
    files = list(disk.iterdir())
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for file in files:
            if file.suffix == ".mcap":
                assert Recording(file).duration >= (0.2 if options == "size=1m" else 0.0)
            else:
                assert "/column" in rrd_columns(file)
    assert bool(files) == (options in ("size=1m", "size=5m"))  # what holds nothing is removed


@pytest.mark.parametrize("room", [30_000, 100_000, 1_500_000])
def test_a_limit_of_the_file_size_is_one_line(tmp_path: Path, room: int) -> None:
    (tmp_path / "short.toml").write_text(TOML.replace("0.8", "3.0"))
    limit = partial(resource.setrlimit, resource.RLIMIT_FSIZE, (room, room))
    line = said(cls_bench("run", tmp_path / "short.toml", "--out", tmp_path / "out", preexec_fn=limit))
    assert line.startswith("error: cannot write ") and line.endswith(": File too large")


class Writing:
    """Stands in for ``os.write`` and can make files of a suffix fail or wait."""

    def __init__(self, suffix: str, *, after: int = 0):
        self.suffix, self.room = suffix, after
        self.error: OSError | None = None
        self.gate = threading.Event()
        self.gate.set()
        self._plain = os.write

    def __call__(self, descriptor: int, data: bytes) -> int:
        if Path(f"/dev/fd/{descriptor}").resolve().suffix == self.suffix:
            self.room -= len(data)
            self.gate.wait()
            if self.error is not None and self.room < 0:
                self._plain(descriptor, data[: len(data) // 2])  # a part fits
                raise self.error
        return self._plain(descriptor, data)


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EDQUOT, errno.EIO])
def test_an_rrd_that_fails_leaves_the_mcap_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: int
) -> None:
    writing = Writing(".rrd", after=800_000)
    writing.error = OSError(number, os.strerror(number))
    monkeypatch.setattr(os, "write", writing)
    with pytest.raises(OutputError) as caught:
        run(parse_scenario(TOML.replace("0.8", "2.0")), out=tmp_path)
    (mcap,), (rrd,) = tmp_path.glob("*.mcap"), tmp_path.glob("*.rrd")
    assert str(caught.value) == f"cannot write {rrd}: {os.strerror(number)}; {mcap.name} is complete"
    recording = Recording(mcap)
    assert (recording.status, recording.result["verdict"], recording.duration) == ("complete", "passed", 2.0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # Rerun says that there is no footer
        times, _ = rrd_table(rrd, "/column", "Scalars:scalars")
    assert 0 < times[-1] < 2e9  # whole batches


def test_an_mcap_that_fails_ends_the_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    writing = Writing(".mcap", after=1_500_000)
    writing.error = OSError(errno.EDQUOT, os.strerror(errno.EDQUOT))
    monkeypatch.setattr(os, "write", writing)
    with pytest.raises(OutputError, match=r"^cannot write [^\n]*\.mcap: Disk quota exceeded$"):
        run(parse_scenario(TOML.replace("0.8", "30.0")), out=tmp_path)
    (mcap,) = tmp_path.glob("*.mcap")
    with pytest.warns(UserWarning, match="cut short"):
        recording = Recording(mcap)
    assert 0.2 <= recording.duration < 2.0 and recording.status == "incomplete"
    (rrd,) = tmp_path.glob("*.rrd")
    assert rrd_columns(rrd)["/__properties/result"][0].column("status").to_pylist() == [["interrupted"]]  # type: ignore[attr-defined]


def test_an_rrd_that_takes_nothing_does_not_hold_up_the_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recorder_module, "STALL_S", 0.5)
    writing = Writing(".rrd")
    monkeypatch.setattr(os, "write", writing)
    blocks = make_blocks((4000,) * 20)
    recorder = Recorder(tmp_path / "run", INFO, topics=TOPICS)
    writing.gate.clear()
    try:
        for block in blocks:
            recorder.write(block)
        began = time.monotonic()
        with pytest.raises(OutputError, match=r"run\.rrd: it took nothing for 0\.5 s; run\.mcap is complete$"):
            recorder.finish("complete")
        assert time.monotonic() - began < 5.0
    finally:
        writing.gate.set()
    assert Recording(tmp_path / "run.mcap").duration == pytest.approx(4.0)


def test_files_that_are_removed_are_missed(tmp_path: Path) -> None:
    for suffix in ("mcap", "rrd"):
        recorder = Recorder(tmp_path / "run", INFO, topics=TOPICS)
        recorder.write(make_block(0, 400))
        (tmp_path / f"run.{suffix}").unlink()
        with pytest.raises(OutputError, match=rf"^cannot write .*run\.{suffix}: it was removed while the run went on"):
            recorder.finish("complete")


# --- kill -9 ---------------------------------------------------------------------------------------------------------

ANNOUNCED = """
import sys
from cls_bench.experiment import Progress, run
from cls_bench.scenario import load_scenario

class Said(Progress):
    def advanced(self, simulated_s, real_time_factor):
        print(simulated_s, flush=True)

run(load_scenario("motion_tracking", set=["duration=8.0"]), out=sys.argv[1], progress=Said())
"""


@pytest.mark.parametrize("trial", range(3))
def test_kill_9_loses_nothing_that_was_announced(tmp_path: Path, trial: int) -> None:
    """The promise is 0.2 s in the .mcap and 0.5 s in the .rrd; what is announced has been written."""
    process = subprocess.Popen(
        [sys.executable, "-c", ANNOUNCED, str(tmp_path)], cwd=ROOT, stdout=-1, stderr=subprocess.DEVNULL, text=True
    )
    assert process.stdout is not None
    lines = ["0"]
    while float(lines[-1]) == 0.0:
        lines.append(process.stdout.readline())
    time.sleep(random.Random(trial).uniform(0.0, 0.5))
    process.send_signal(signal.SIGKILL)
    lines += process.stdout.read().splitlines()
    process.wait()
    announced = float([line for line in lines if line.strip()][-1])
    (mcap,), (rrd,) = tmp_path.glob("*.mcap"), tmp_path.glob("*.rrd")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        assert announced > 0.0 and Recording(mcap).duration >= announced - 0.2
        times, _ = rrd_table(rrd, "/column", "Scalars:scalars")
    assert times[-1] / 1e9 >= announced - 0.5


# --- less in them ----------------------------------------------------------------------------------------------------


def test_fewer_signals_at_a_lower_rate(tmp_path: Path) -> None:
    whole = run(parse_scenario(TOML), out=tmp_path / "whole")
    overrides = ['record.signals=["/column.angle", "/load_cell.*", "/feel.angle"]', "record.rate_hz=1000"]
    less = run(parse_scenario(TOML, set=[*overrides, "record.poses=false"]), out=tmp_path / "less")
    assert [r.value for r in less.checks] == [r.value for r in whole.checks]  # bit for bit
    recording, all_of_it = less.recording(), whole.recording()
    assert {path: (t.ticks, t.names) for path, t in recording.topics.items()} == {
        "/column": (20, ("angle",)), "/load_cell": (20, TOPIC["/load_cell"].names), "/feel": (16, ("angle",)),
    }  # fmt: skip
    assert np.array_equal(recording.read("/column")["angle"], all_of_it.read("/column", every=20)["angle"])
    assert np.array_equal(recording.read("/feel")["angle"], all_of_it.read("/feel", every=2)["angle"])
    assert recording.duration == 0.8 and recording.events() == all_of_it.events()
    assert recording.poses()[0].tolist() == [] and recording.topics["/column"].signals[0].unit == "rad"
    assert less.mcap.stat().st_size < whole.mcap.stat().st_size / 10
    assert json.loads(recording.result["checks"]) == {r.check.name: r.value for r in less.checks}


def test_the_views_of_less(tmp_path: Path) -> None:
    overrides = ['record.signals=["/column.angle", "/load_cell.torque"]', "record.rate_hz=1000"]
    result = run(parse_scenario(TOML, set=overrides), out=tmp_path)
    assert result.rrd is not None
    write_rrd([result.recording()], tmp_path / "again.rrd")
    for path in (result.rrd, tmp_path / "again.rrd"):
        found = rrd_columns(path)
        assert {"/column", "/load_cell", "/plots/torque", "/bench/column"} <= set(found)
        assert not {"/drive", "/feel", "/plots/motor_torque"} & set(found)
        times, values = rrd_table(path, "/plots/torque", "Scalars:scalars")
        assert times.tolist() == (np.arange(0, 16_000, 20) * CLOCK.tick_ns).tolist() and len(values[0]) == 1  # type: ignore[arg-type]
    page = write_report([RecordedRun(result.mcap)], tmp_path / "reports").read_text()
    assert "as measured by the run" in page and f"{result['tracking']:.4g}" in page
    assert RecordedRun(result.mcap).verdict == "passed"


def test_a_thinned_file_is_compared_with_a_full_one(tmp_path: Path) -> None:
    full = run(parse_scenario(TOML), out=tmp_path / "full", rerun=False)
    thin = run(parse_scenario(TOML, set=[
        'record.signals=["/column.angle", "/load_cell.torque", "/feel.angle"]', "record.rate_hz=4000",
    ]), out=tmp_path / "thin", rerun=False)  # fmt: skip
    signals = ("/column.angle", "/load_cell.torque", "/drive.torque", "/feel.angle")
    options = [word for signal in signals for word in ("--signal", signal)]
    files = [str(full.mcap), str(thin.mcap)]
    for pair in (files, files[::-1]):
        done = CliRunner().invoke(main, ["compare", *pair, *options, "--out", str(tmp_path / "pages")])
        assert done.exit_code == 0, done.output
        *said, name = done.stdout.splitlines()
        page = html.unescape(Path(name).read_text())
        assert any(line.split()[:3] == ["tracking", "deg", f"{thin['tracking']:.4g}"] for line in said)
        assert "tracking" in page and "<svg" in page  # /feel is drawn
        left_out = [line.removeprefix("not drawn: ") for line in said if line.startswith("not drawn: ")]
        assert [line.split(": ")[0] for line in left_out] == list(signals[:3])
        assert f"{thin.mcap}: /column was recorded at 4000 Hz, not at 2500 Hz" in left_out[0]
        assert f"{thin.mcap} has no topic '/drive'" in left_out[2] and str(full.mcap) not in "".join(left_out)
        assert all(f"Not drawn: {line}" in page for line in left_out)


@pytest.mark.parametrize("signals", ['["/column.angle"]', '["/column.*", "/load_cell.*"]'])
def test_values_in_a_thinned_file_are_held_against_its_samples(tmp_path: Path, signals: str) -> None:
    """Those that can be measured; the others are believed."""
    result = run(parse_scenario(TOML, set=[f"record.signals={signals}"]), out=tmp_path, rerun=False)
    assert RecordedRun(result.mcap).doubts == ()
    truth = {check.check.name: check.value for check in result.checks}
    for change, said in (
        ({"peak": 7.5}, [f'"peak": the file says 7.5, its samples give {truth["peak"]:.6g}']),
        ({"peak": None}, [f'"peak": the file says that it was not measured, its samples give {truth["peak"]:.6g}']),
        ({"tracking": 7.5}, []),
    ):
        checks = json.dumps(truth | change)
        edited = with_result(result.mcap, tmp_path / "edited.mcap", checks=checks)
        opened = RecordedRun(edited)
        assert list(opened.doubts) == said
        assert {c.check.name: c.value for c in opened.checks} == truth | (change if not said else {})


@pytest.mark.parametrize(
    ("options", "problem"),
    [
        (["--signals", "/colum.angle"], 'record.signals: "/colum.angle" is no signal; did you mean /column.angle'),
        (["--rate", "3000"], "record.rate_hz: 3000 Hz is not 20000 Hz over a whole number; the nearest are 2857"),
        (["--rate", "0"], "0.0 is not in the range"),
        (["--rate", "nan"], "nan is not a finite number"),
        (["--signals", ""], 'record.signals: "" is no signal'),
    ],
)
def test_what_cannot_be_recorded_is_one_line(options: list[str], problem: str) -> None:
    done = CliRunner().invoke(main, ["run", "motion_tracking", *options])
    assert done.exit_code == 2 and problem in done.stderr and len(done.stderr.splitlines()) == 1


def test_record_is_a_table_of_the_scenario() -> None:
    table = '\n[record]\nsignals = ["/feel.*"]\nrate_hz = 2500\nposes = false\n'
    record = parse_scenario(TOML + table).record
    assert [topic.path for topic in record.topics(TOPICS)] == ["/feel"] and not record.poses
    assert parse_scenario(TOML).record.topics(TOPICS) == TOPICS
    with pytest.raises(InputError, match=r"record\.rate: unknown key; did you mean rate_hz"):
        parse_scenario(TOML + "\n[record]\nrate = 2500\n")


@st.composite
def selections(draw: st.DrawFn) -> Block | tuple:  # type: ignore[type-arg]
    topics = []
    for topic in TOPICS:
        kept = tuple(signal for signal in topic.signals if draw(st.booleans()))
        if kept:
            topics.append(replace(topic, signals=kept, ticks=topic.ticks * draw(st.integers(1, 40))))
    return tuple(topics), draw(st.integers(0, 500)), draw(st.lists(st.integers(0, 300), max_size=4))


@settings(max_examples=40, deadline=None)
@given(selections())
def test_any_selection_comes_back(tmp_path_factory: pytest.TempPathFactory, selection: tuple) -> None:  # type: ignore[type-arg]
    topics, first, lengths = selection
    path = tmp_path_factory.mktemp("selection") / "run.mcap"
    recorder = McapRecorder(path, INFO, topics=topics, poses=False)
    blocks = []
    for ticks in lengths:
        blocks.append(make_block(first, ticks))
        recorder.write(blocks[-1])
        first += ticks
    recorder.finish("complete")
    recording = Recording(path)
    assert tuple(recording.topics.values()) == topics
    for topic in topics:
        series = recording.read(topic.path)
        for name in topic.names:
            source = TOPIC[topic.path]
            parts = [
                b.signals[topic.path][b.row_ticks(source.ticks) % topic.ticks == 0, source.names.index(name)]
                for b in blocks
            ]
            assert np.array_equal(series[name], np.concatenate([np.zeros(0), *parts]))
    with path.open("rb") as file:
        times = [message.log_time for _, _, message in make_reader(file, validate_crcs=True).iter_messages()]
    assert len(times) == sum(len(recording.read(topic.path)) for topic in topics)


def test_samples_are_sorted_by_time_and_topic() -> None:
    samples = Samples(TOPICS, make_block(3, 61))
    entries = sorted((int(at), int(time), channel) for channel, index in samples.indexes.items() for time, at in index)
    assert [entry[1:] for entry in entries] == sorted(entry[1:] for entry in entries)
    assert samples.position(3) == 0 and samples.position(64) == samples.position(10**6) == len(samples.data)


# --- what the file says of itself ------------------------------------------------------------------------------------


def test_the_seal_covers_all_but_the_clock(tmp_path: Path) -> None:
    seals = []
    for clock in ("2026-01-01T00:00:00+00:00", "2027-01-01T00:00:00+00:00"):
        recorder = McapRecorder(tmp_path / "run.mcap", replace(INFO, wall_start=clock), topics=TOPICS)
        recorder.write(make_block(0, 400))
        recorder.finish("complete", clock, verdict="failed", checks={"peak": 1.5, "late": None})
        recording = Recording(tmp_path / "run.mcap")
        seals.append(recording.all_metadata["seal"]["sha256"])
        assert seals[-1] == seal_of(recording.all_metadata, recording.attachments)
    assert seals[0] == seals[1]
    assert recording.result == {
        "status": "complete", "verdict": "failed", "checks": '{"peak": 1.5, "late": null}', "ticks": "400",
    }  # fmt: skip


def test_equal_runs_give_equal_rrds_up_to_rerun_s_own_ids(tmp_path: Path) -> None:
    for name in ("a", "b"):
        recorder = RerunRecorder(tmp_path / f"{name}.rrd", INFO, topics=TOPICS)
        for block in make_blocks((4000, 4000, 100)):
            recorder.write(block)
        assert recorder.written_ticks == 8000
        recorder.finish("complete")
    a, b = (rrd_table(tmp_path / f"{name}.rrd", "/column", "Scalars:scalars") for name in "ab")
    assert np.array_equal(a[0], b[0]) and a[1] == b[1]
