"""The Rerun view: what it draws, that the .mcap alone gives the same, and a look at it where a viewer can start."""

import io
import json
import os
import re
import signal
import socket
import subprocess
import sys
import time
import urllib.request
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from cls_bench.cli import main
from cls_bench.cli.view import _rrd
from cls_bench.errors import InputError
from cls_bench.experiment import Result, run
from cls_bench.geometry import LONGEST_ARROW, METRES_PER_NEWTON, force_arrows
from cls_bench.recording import McapRecorder, Recording, rerun_process
from cls_bench.recording import rerun_layout as layout
from cls_bench.recording.rerun_process import quiet_environment
from cls_bench.recording.rerun_writer import RerunRecorder, write_rrd
from cls_bench.scenario import parse_scenario
from cls_bench.signals import MOST_STAGES, TOPIC, TOPICS, Block, Event, topics
from tests.test_recording import BODIES, INFO, make_block, rrd_columns, rrd_table

TOML = """
title = "Off, then on"
duration = 1.2
[drive]
power = "off"
[[hand]]
at = 0.0
kind = "ramp"
to_deg = 3.0
over = 0.4
[[changes]]
at = 0.5
power = "on"
[[squeeze]]
at = 0.6
value = 1.0
[[hand]]
at = 0.9
kind = "release"
"""

ROOT = Path(__file__).parents[1]
RERUN = str(Path(sys.executable).with_name("rerun"))


@pytest.fixture(scope="module")
def short(tmp_path_factory: pytest.TempPathFactory) -> Result:
    """A run of 1.2 s with both files."""
    return run(parse_scenario(TOML), out=tmp_path_factory.mktemp("rerun_view"))


def states(path: Path, lane: str) -> list[tuple[float, str]]:
    """Times [s] and values of a lane's changes."""
    times, values = rrd_table(path, f"/{lane}", "StateChange:state")
    return [(time / 1e9, value[0]) for time, value in zip(times, values, strict=True)]


def test_files_pass_the_checks_of_rerun_itself(short: Result) -> None:
    for command in (["rrd", "verify", short.rrd], ["mcap", "check", short.mcap]):
        done = subprocess.run([RERUN, *map(str, command)], capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout + done.stderr


def test_the_mcap_alone_gives_the_same_view(short: Result, tmp_path: Path) -> None:
    path = tmp_path / "again.rrd"
    write_rrd([Recording(short.mcap)], path)
    assert short.rrd is not None
    ours, theirs = rrd_columns(path), rrd_columns(short.rrd)

    def drawn(entities: Any) -> set[str]:  # a capsule comes back as a cylinder and two spheres, a plane as a box
        return {entity for entity in entities if entity.count("/") < 3 and not entity.startswith("/__")}

    assert drawn(ours) == drawn(theirs)
    for entity, column in (
        ("/column", "Scalars:scalars"), ("/plots/torque", "Scalars:scalars"), ("/events", "TextLog:text"),
        ("/bench/column", "Transform3D:quaternion"), (f"/{layout.FORCES}", "Arrows3D:vectors"),
        (f"/{layout.DRIVE_LANE}", "StateChange:state"), (f"/{layout.TORQUE_OVER_ANGLE}/now", "Points2D:positions"),
    ):  # fmt: skip
        (times, values), (their_times, their_values) = (rrd_table(file, entity, column) for file in (path, short.rrd))
        assert np.array_equal(times, their_times) and values == their_values, entity
    cylinders = [entity for entity in ours if entity.startswith("/bench/") and "cylinder" in entity]
    assert len(cylinders) >= len({entity.split("/")[2] for entity in theirs if "capsule" in entity})


def test_blocks_of_a_recording_are_those_that_were_recorded(tmp_path: Path) -> None:
    blocks = [make_block(0, 4000, (Event(12, "warning", "drive", "hot"),)), make_block(4000, 1203), make_block(5203, 7)]
    recorder = McapRecorder(tmp_path / "run.mcap", INFO, topics=TOPICS)
    for block in blocks:
        recorder.write(block)
    recorder.finish("complete")
    recording = Recording(tmp_path / "run.mcap")
    for block, read in zip(blocks, recording.blocks(), strict=True):
        assert (read.first_tick, read.ticks, read.events) == (block.first_tick, block.ticks, block.events)
        for topic in TOPICS:
            assert np.array_equal(read.signals[topic.path], block.signals[topic.path])
        if len(block.poses):
            assert np.array_equal(read.poses[:, 1:], block.poses[:, 1:])  # the world does not move
    info = recording.run_info()
    assert info.body_names == BODIES
    assert (info.scenario_toml, info.metadata, info.mjcf) == (INFO.scenario_toml, INFO.metadata, INFO.mjcf)
    boxes = [geom for geom in info.geoms if geom.kind == "box"]
    assert boxes[0].size == INFO.geoms[0].size and boxes[0].rgba == INFO.geoms[0].rgba
    (mesh,) = (geom for geom in info.geoms if geom.kind == "mesh")
    assert mesh.vertices is not None and np.array_equal(mesh.vertices, np.eye(3))
    time, poses = recording.poses(0.1, 0.2)
    assert time.tolist() == pytest.approx(np.arange(0.1, 0.2, 0.01).tolist())
    assert np.array_equal(poses[:, 1:], blocks[0].poses[10:20, 1:])


def test_lanes_follow_power_grip_and_events(short: Result) -> None:
    assert short.rrd is not None
    power = states(short.rrd, layout.DRIVE_LANE)
    assert [state for _, state in power] == ["power off", "power on"]
    assert power[1][0] == pytest.approx(0.5, abs=0.002)
    hand = states(short.rrd, layout.HAND_LANE)
    assert [state for _, state in hand] == ["loose", "firm", "tight", "let go"]
    assert [time for time, _ in hand] == pytest.approx([0.0, 0.605, 0.63, 0.9], abs=0.002)
    assert [state for _, state in states(short.rrd, layout.TRAVEL_LANE)] == ["free"]
    assert states(short.rrd, layout.EVENT_LANE) == [(0.5, "scenario: drive power on")]
    (look,) = (
        b for b in rrd_columns(short.rrd)[f"/{layout.HAND_LANE}"] if "StateConfiguration:values" in b.schema.names
    )
    assert look.column("StateConfiguration:values").to_pylist()[0] == list(layout.HAND_STATES)


def test_the_travel_lane_follows_the_column(tmp_path: Path) -> None:
    limits = {"feel": {"aft_limit": {"angle": 0.2}}, "column": {"switch_angle": 0.3}}
    recorder = RerunRecorder(tmp_path / "run.rrd", replace(INFO, parameters=limits), topics=TOPICS)
    signals = {t.path: np.zeros((t.rows(0, 800), len(t.signals))) for t in TOPICS}
    signals["/column"][:, 0] = np.interp(np.arange(800), [0, 400, 799], [0.0, -0.4, 0.0])
    recorder.write(Block(0, 800, signals, np.zeros((4, len(BODIES), 7))))
    recorder.finish("complete")
    found = states(tmp_path / "run.rrd", layout.TRAVEL_LANE)
    assert [state for _, state in found] == ["free", "model's limit", "limit switch", "model's limit", "free"]
    assert [time for time, _ in found] == pytest.approx([0.0, 0.01, 0.015, 0.025, 0.03], abs=0.0006)


def test_torque_over_displacement_is_the_recorded_one(short: Result) -> None:
    assert short.rrd is not None
    recording = Recording(short.mcap)
    angle = np.rad2deg(recording.read("/column", ["angle"], every=40)["angle"])
    torque = recording.read("/load_cell", ["torque"], every=40)["torque"]
    (curve,) = rrd_columns(short.rrd)[f"/{layout.TORQUE_OVER_ANGLE}/curve"]
    strips = curve.column("LineStrips2D:strips").to_pylist()[0]
    points = np.array([point for strip in strips for point in strip])
    (marks,) = rrd_columns(short.rrd)[f"/{layout.TORQUE_OVER_ANGLE}/marks"]
    labels = marks.column("Points2D:labels").to_pylist()[0]
    right, top = (float(text.split("°")[0].split(" ")[0]) for text in labels[1:3])
    assert right >= np.abs(angle).max() > right / 2.6 and top >= np.abs(torque).max() > top / 2.6
    assert np.allclose(points[:, 0] * right / 1.5, angle, atol=1e-5 * right)
    assert np.allclose(-points[:, 1] * top, torque, atol=1e-5 * top)
    assert len(strips) == 2  # power off, power on


def test_arrows_show_the_forces_on_the_column() -> None:
    half = np.sqrt(0.5)
    upright = np.array([[0.0, 0.0, 0.35, 1.0, 0.0, 0.0, 0.0]])
    tilted = np.array([[0.0, 0.0, 0.35, half, 0.0, half, 0.0]])  # 90° about y: x points down
    rod = np.array([[0.0, 0.0, 0.525, 1.0, 0.0, 0.0, 0.0]])
    origins, vectors = force_arrows(upright, rod, np.array([10.0]), np.array([20.0]))
    assert np.allclose(vectors[0], [[10.0 * METRES_PER_NEWTON, 0, 0], [-20.0 * METRES_PER_NEWTON, 0, 0]])
    assert np.allclose(origins[0][:, [0, 2]], [[0.0, 0.65], [0.0, 0.525]])
    origins, vectors = force_arrows(tilted, rod, np.array([10.0]), np.array([-1e4]))
    assert np.allclose(vectors[0], [[0, 0, -10.0 * METRES_PER_NEWTON], [LONGEST_ARROW, 0, 0]])
    assert np.allclose(origins[0, 0, [0, 2]], [0.30, 0.35])


def test_arrows_in_the_file_pull_against_each_other(short: Result) -> None:
    assert short.rrd is not None
    times, vectors = rrd_table(short.rrd, f"/{layout.FORCES}", "Arrows3D:vectors")
    force = Recording(short.mcap).read("/pilot", ["hand_force"], every=50)
    assert np.array_equal(times, np.round(force.time * 1e9))
    held = (force.time > 0.35) & (force.time < 0.48)
    lengths = np.linalg.norm(np.array(vectors), axis=2)
    expected = np.minimum(METRES_PER_NEWTON * np.abs(force["hand_force"]), LONGEST_ARROW)
    assert np.allclose(lengths[:, 0], expected, atol=1e-6)
    assert (np.array(vectors)[held, 0, 0] > 0).all() and (np.array(vectors)[held, 1, 0] < 0).all()


def test_curves_keep_their_peaks_and_have_colours_with_meanings(short: Result) -> None:
    import rerun as rr

    assert short.rrd is not None
    found = rrd_columns(short.rrd)
    for plot in layout.PLOTS:
        (look,) = (batch for batch in found[plot.entity] if "SeriesLines:names" in batch.schema.names)
        there = [curve for curve in plot.curves if curve[1] in TOPIC[curve[0]].names]
        assert look.column("SeriesLines:names").to_pylist()[0] == [name for _, _, name, _ in there]
        policy = look.column("SeriesLines:aggregation_policy").to_pylist()[0][0]
        assert policy == rr.components.AggregationPolicy.MinMax.value
        assert len(look.column("SeriesLines:colors").to_pylist()[0]) == len(set(c[3] for c in there))


def test_several_runs_share_one_timeline_and_nothing_else(short: Result, tmp_path: Path) -> None:
    path = tmp_path / "both.rrd"
    write_rrd([Recording(short.mcap), Recording(short.mcap)], path)
    found = rrd_columns(path)
    first, second = (
        {entity.removeprefix(prefix) for entity in found if entity.startswith(f"{prefix}/")}
        for prefix in ("/run_1", "/run_2")
    )
    assert first == second and {"/bench/column", "/plots/torque", "/column", f"/{layout.DRIVE_LANE}"} <= first
    alone = {entity for entity in found if not entity.startswith(("/run_", "/__"))}
    assert alone <= {"/"}


def test_a_run_without_the_bench_s_bodies_has_no_arrows(tmp_path: Path) -> None:
    recorder = RerunRecorder(tmp_path / "run.rrd", replace(INFO, body_names=("world", "crank", "wheel")), topics=TOPICS)
    signals = {t.path: np.zeros((t.rows(0, 1), len(t.signals))) for t in TOPICS}
    recorder.write(Block(0, 1, signals, np.zeros((1, len(BODIES), 7))))  # too short for a curve too
    recorder.finish("complete")
    found = rrd_columns(tmp_path / "run.rrd")
    assert f"/{layout.FORCES}" not in found and f"/{layout.TORQUE_OVER_ANGLE}/curve" not in found
    assert rrd_table(tmp_path / "run.rrd", "/column", "Scalars:scalars")[0].tolist() == [0]


def test_every_plot_names_signals_that_are_recorded() -> None:
    known = {topic.path: topic for topic in topics(stages=MOST_STAGES)}
    for plot in layout.PLOTS:
        for topic, name, _, _ in plot.curves:
            assert name in known[topic].names
        units = {s.unit for t, n, _, _ in plot.curves for s in known[t].signals if s.name == n}
        assert len(units) == 1, plot.title


# ---------------------------------------------------------------------------------------------------------------------
# The viewer


def test_view_without_a_display_says_how_to_serve(short: Result, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    done = CliRunner().invoke(main, ["view", str(short.mcap)])
    assert done.exit_code == 2
    assert done.stderr == f"error: there is no display; serve it to a browser: cls-bench view --serve {short.mcap}\n"


def test_the_mcap_alone_is_converted_for_the_while(short: Result, tmp_path: Path) -> None:
    alone = tmp_path / "alone.mcap"
    alone.write_bytes(short.mcap.read_bytes())
    (tmp_path / "alone.rrd").write_bytes(b"")  # of a run that was killed early
    with _rrd([alone], [Recording(alone)]) as shown:
        assert "/plots/torque" in rrd_columns(shown)
    assert not shown.exists()


class Served:
    """``cls-bench view --serve`` in a process of its own."""

    def __init__(self, recording: Path, environment: dict[str, str] | None = None):
        self.port = free_ports()
        command = [sys.executable, "-c", "from cls_bench.cli import main; main()", "view", "--serve"]
        self.process = subprocess.Popen(
            [*command, "--port", str(self.port), str(recording)], stdout=-1, stderr=-1, text=True, cwd=ROOT,
            env=dict(os.environ) | (environment or {}),
        )  # fmt: skip
        assert self.process.stdout is not None
        self.line = self.process.stdout.readline()

    def listens(self) -> bool:
        """Whether one of the ports answers."""
        for port in (self.port, self.port + 1):
            with socket.socket() as probe:
                if probe.connect_ex(("127.0.0.1", port)) == 0:
                    return True
        return False

    def ended(self) -> bool:
        """Whether the ports are free soon."""
        deadline = time.monotonic() + 10.0
        while self.listens() and time.monotonic() < deadline:
            time.sleep(0.05)
        return not self.listens()


def free_ports() -> int:
    """The first of two ports in a row that nobody uses."""
    while True:
        with socket.socket() as first, socket.socket() as second:
            first.bind(("127.0.0.1", 0))
            port = int(first.getsockname()[1])
            try:
                second.bind(("127.0.0.1", port + 1))
            except OSError:
                continue
            return port


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGKILL])
def test_view_serves_and_leaves_nothing_behind(short: Result, tmp_path: Path, number: signal.Signals) -> None:
    home = {"HOME": str(tmp_path), "XDG_CONFIG_HOME": str(tmp_path / "config"), "XDG_DATA_HOME": str(tmp_path / "data")}
    served = Served(short.mcap, home)
    address = f"http://127.0.0.1:{served.port}/"
    source = f"rerun%2Bhttp%3A%2F%2F127.0.0.1%3A{served.port + 1}%2Fproxy"
    assert served.line == f"until Ctrl-C, open {address}?url={source}&notebook=1\n"
    with urllib.request.urlopen(address, timeout=10) as page:
        text = page.read().decode()
    assert 'get_query_bool(query, "notebook"' in text  # the page takes what the address says
    served.process.send_signal(number)
    _, errors = served.process.communicate(timeout=30)
    assert served.process.returncode == (-9 if number == signal.SIGKILL else 130), errors
    assert "Traceback" not in errors and served.ended()
    assert not (tmp_path / "config").exists() and not (tmp_path / "data").exists()  # the user's settings of Rerun


@pytest.mark.parametrize("offset", [0, 1])
def test_a_taken_port_is_said_before_an_address(short: Result, offset: int) -> None:
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = int(other.getsockname()[1])
        done = CliRunner().invoke(main, ["view", "--serve", "--port", str(port - offset), str(short.mcap)])
    assert done.exit_code == 2 and "http" not in done.output
    assert done.stderr == f"error: port {port} cannot be used (Address already in use); choose another with --port\n"


def test_rerun_is_told_to_send_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    users, settings = tmp_path / "users", tmp_path / "settings"
    (users / "rerun").mkdir(parents=True)
    (users / "rerun" / "analytics.json").write_text("the user's")
    (users / "xkb").mkdir()
    settings.mkdir()
    monkeypatch.setenv("XDG_CONFIG_HOME", str(users))
    monkeypatch.setenv("FORCE_RERUN_ANALYTICS", "1")
    environment = quiet_environment(settings)
    assert environment["CI"] and "FORCE_RERUN_ANALYTICS" not in environment
    done = subprocess.run(
        [RERUN, "analytics", "config"], env=environment, capture_output=True, text=True, check=True
    )  # fmt: skip
    told = json.loads(done.stdout)
    assert told["analytics_enabled"] is False and told["config_file_path"].startswith(str(settings))
    assert (users / "rerun" / "analytics.json").read_text() == "the user's"
    assert (settings / "xkb").resolve() == users / "xkb"


def test_the_sdk_leaves_no_settings_behind(tmp_path: Path) -> None:
    """Recording and converting in this process never starts Rerun's analytics: they would make a file first."""
    script = f"""
import sys; sys.path[:0] = [{str(ROOT)!r}]
from pathlib import Path
from tests.test_recording import INFO, TOPICS, make_block
from cls_bench.recording.rerun_writer import RerunRecorder
recorder = RerunRecorder(Path({str(tmp_path / "run.rrd")!r}), INFO, topics=TOPICS)
recorder.write(make_block(0, 4000))
recorder.finish("complete")
"""
    home = {name: str(tmp_path / name) for name in ("HOME", "XDG_CONFIG_HOME", "XDG_DATA_HOME")}
    environment = {name: text for name, text in os.environ.items() if name != "CI"} | home
    subprocess.run([sys.executable, "-c", script], env=environment, check=True, cwd=ROOT)
    assert not [path for path in tmp_path.rglob("*") if "rerun" in path.name]


@pytest.mark.needs_vulkan
def test_the_viewer_shows_the_bench_and_the_curves(short: Result) -> None:
    from PIL import Image

    from cls_bench.recording.rerun_screenshot import SIZE, screenshot

    assert short.rrd is not None
    png = screenshot([short.rrd], 0.4)
    image = np.asarray(Image.open(io.BytesIO(png)).convert("RGB"), float)
    assert image.shape == (SIZE[1], SIZE[0], 3)

    def near(part: np.ndarray, color: tuple[int, ...], distance: float = 40.0) -> int:
        return int((np.linalg.norm(part - np.array(color), axis=2) < distance).sum())

    bench, loop, right = image[70:470, :510], image[510:765, :510], image[60:660, 520:]
    assert near(bench, (20, 85, 140), 60) > 200  # the load cell, in whatever light
    assert near(bench, (205, 50, 35), 60) > 50  # the stops
    assert near(loop, layout.MODEL) > 40 and near(loop, layout.MEASURED) > 30
    assert near(right, layout.MODEL) > 300 and near(right, layout.MEASURED) > 300


def test_without_a_graphics_driver_one_line_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from cls_bench.recording.rerun_screenshot import screenshot

    viewer = tmp_path / "rerun"
    viewer.write_text("#!/bin/sh\necho \"thread 'main' panicked at 'No graphics adapter was found'\"\nexit 101\n")
    viewer.chmod(0o755)
    monkeypatch.setattr(rerun_process, "program", lambda: viewer)
    expected = (
        "the Rerun viewer cannot start (No graphics adapter was found); it needs a Vulkan driver: on Debian, "
        "apt install mesa-vulkan-drivers"
    )
    with pytest.raises(InputError, match=rf"^{re.escape(expected)}$"):
        screenshot([tmp_path / "run.rrd"], 0.4)
