"""Sweeps: the same rows on any engine and any number of workers, nothing lost, errors as rows."""

import itertools
import json
import math
import os
import re
import signal
import subprocess
import sys
import threading
import time
import tracemalloc
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from click.testing import CliRunner, Result

from cls_bench import tick
from cls_bench.analysis.window import Window
from cls_bench.bench import Bench, DivergedError
from cls_bench.cli import main
from cls_bench.cli.worker import THREAD_MB, Limits
from cls_bench.drivers import scripted
from cls_bench.errors import InputError
from cls_bench.experiment import run
from cls_bench.hand import HandSamples
from cls_bench.parameters import Parameters
from cls_bench.scenario import Check, Scenario, load_scenario
from cls_bench.signals import CLOCK, TOPICS, Block
from cls_bench.sweep.core import evaluate_points
from cls_bench.sweep.engine import Dask, Row, Threads, make_engine
from cls_bench.sweep.journal import Journal
from cls_bench.sweep.plan import load_sweep
from cls_bench.sweep.runs import Memory, measure_in_memory

ROOT = Path(__file__).parents[1]

SCENARIO = """
title = "Push"
duration = 0.2
seed = 3
[[hand]]
at = 0.0
kind = "ramp"
to_deg = 5.0
over = 0.15
[[squeeze]]
at = 0.05
value = 0.5
[[checks]]
name = "peak"
metric = "maximum"
signal = "/column.angle"
window = [0.0, 0.2]
max = 0.05
[[checks]]
name = "torque"
metric = "rms"
signal = "/load_cell.torque"
window = [0.05, 0.15]
"""

GRID = """
title = "Push over inertia and grip"
scenario = "push.toml"
[[axes]]
key = "feel.inertia"
kind = "range"
from = 0.2
to = 0.5
count = 4
[[axes]]
key = "squeeze[0].value"
kind = "list"
values = [0.0, 1.0]
"""


@pytest.fixture
def file(tmp_path: Path) -> Callable[[str], Path]:
    """Writes a sweep file beside its scenario."""

    def write(sweep: str) -> Path:
        (tmp_path / "push.toml").write_text(SCENARIO)
        path = tmp_path / "sweep.toml"
        path.write_text(sweep)
        return path

    return write


def call(*arguments: str | Path) -> Result:
    return CliRunner().invoke(main, ["sweep", *map(str, arguments)])


# --- points ----------------------------------------------------------------------------------------------------------


def test_grid_is_the_product_with_the_last_axis_fastest(file: Any) -> None:
    points = load_sweep(file(GRID)).sweep.points
    inertias = np.linspace(0.2, 0.5, 4).tolist()
    expected = list(itertools.product(inertias, (0.0, 1.0)))
    assert [(p["feel.inertia"], p["squeeze[0].value"]) for p in points] == expected


RANDOM = """
title = "Random"
scenario = "push.toml"
samples = 400
design = "{design}"
seed = {seed}
[[axes]]
key = "limb.mass"
kind = "normal"
mean = 1.8
deviation = 0.3
[[axes]]
key = "feel.inertia"
kind = "log_uniform"
from = 0.1
to = 1.0
[[axes]]
key = "plc.command_latency"
kind = "list"
values = [1, 2]
[[axes]]
key = "feel.stiffness"
kind = "uniform"
from = 10.0
to = 20.0
"""


@pytest.mark.parametrize("design", ["random", "latin_hypercube"])
def test_draws_follow_their_distributions_and_seed(file: Any, design: str) -> None:
    points = load_sweep(file(RANDOM.format(design=design, seed=1))).sweep.points
    assert len(points) == 800
    assert list(points[0]) == ["limb.mass", "feel.inertia", "plc.command_latency", "feel.stiffness"]
    first, second = points[:400], points[400:]
    assert {p["plc.command_latency"] for p in first} == {1}
    # Every combination of the other axes has the same draws.
    assert [p["limb.mass"] for p in first] == [p["limb.mass"] for p in second]
    mass = np.array([p["limb.mass"] for p in first])
    inertia = np.log10([p["feel.inertia"] for p in first])
    stiffness = np.array([p["feel.stiffness"] for p in first])
    # Three standard errors of 400 draws; the correlation of independent draws likewise.
    assert abs(mass.mean() - 1.8) < 3 * 0.3 / 20
    assert abs(mass.std() - 0.3) < 3 * 0.3 / np.sqrt(800)
    assert abs(inertia.mean() + 0.5) < 3 * np.sqrt(1 / 12) / 20
    assert inertia.min() >= -1.0
    assert inertia.max() <= 0.0
    assert abs(np.corrcoef(mass, inertia)[0, 1]) < 3 / 20
    assert 10.0 <= stiffness.min() < stiffness.max() <= 20.0
    again = load_sweep(file(RANDOM.format(design=design, seed=1))).sweep.points
    other = load_sweep(file(RANDOM.format(design=design, seed=2))).sweep.points
    assert again == points
    assert other != points


def test_latin_hypercube_fills_every_stratum_once(file: Any) -> None:
    points = load_sweep(file(RANDOM.format(design="latin_hypercube", seed=5))).sweep.points[:400]
    strata = np.floor((np.array([p["feel.stiffness"] for p in points]) - 10.0) / 10.0 * 400).astype(int)
    assert sorted(strata) == list(range(400))


def test_log_range_and_whole_numbers(file: Any) -> None:
    sweep = """
title = "x"
scenario = "push.toml"
[[axes]]
key = "feel.inertia"
kind = "log_range"
from = 0.1
to = 1.6
count = 5
[[axes]]
key = "seed"
kind = "range"
from = 1
to = 3
count = 3
"""
    points = load_sweep(file(sweep)).sweep.points
    assert [p["feel.inertia"] for p in points[::3]] == pytest.approx([0.1, 0.2, 0.4, 0.8, 1.6])
    assert [p["seed"] for p in points[:3]] == [1, 2, 3]
    assert all(type(p["seed"]) is int for p in points)


def test_aircraft_and_flight_are_swept(file: Any) -> None:
    plan = load_sweep(
        file("""
title = "Conditions"
scenario = "aircraft_c27j_elevator"
[[axes]]
key = "aircraft.condition"
kind = "list"
values = ["medium", "hydraulics_off"]
[[axes]]
key = "flight.altitude_ft"
kind = "list"
values = [0.0, 30000.0]
[[axes]]
key = "flight.airspeed_kt"
kind = "list"
values = [200.0]
""")
    )
    feels = [plan.scenario.changed(point).parameters_at_start().feel for point in plan.sweep.points]
    assert [feel.hydraulics.pressure for feel in feels] == [1.0, 1.0, 0.0, 0.0]
    assert feels[1].flight.airspeed > 1.5 * feels[0].flight.airspeed == pytest.approx(1.5 * 200.0 * 1852.0 / 3600.0)


def test_a_changed_file_among_those_of_an_axis_is_another_sweep(file: Any, tmp_path: Path) -> None:
    text = 'title = "F"\nscenario = "feel_q"\n[[axes]]\nkey = "flight.tab_deg"\nkind = "list"\nvalues = ["a", "b"]\n'
    text += '[[axes]]\nkey = "flight.file"\nkind = "list"\nvalues = ["one.csv", "two.csv"]\n'
    scenario = load_scenario("feel_q").source.decode()
    path = file(text.replace('"feel_q"', '"q.toml"'))
    (path.parent / "q.toml").write_text(scenario)
    for name in ("one", "two"):
        (path.parent / f"{name}.csv").write_text("time,a,b\n0,0,1\n1,1,2\n")
    before = load_sweep(path).identity
    (path.parent / "two.csv").write_text("time,a,b\n0,0,1\n1,1,3\n")
    assert load_sweep(path).identity != before


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (("count = 4", "count = 1"), "axes[0].count: 1 is not valid"),
        (('kind = "list"', 'kind = "lists"'), "axes[1]: "),
        (("to = 0.5", 'to = "0.5"'), 'axes[0].to: "0.5" is not valid'),
        (('key = "feel.inertia"', 'key = "feel.inertial"'), '"feel.inertial" is unknown'),
        (('key = "feel.inertia"', 'key = "squeeze[0].value"'), "there twice"),
        (("squeeze[0]", "squeeze[3]"), "the scenario has 1 entries of squeeze"),
        (("squeeze[0].value", "squeeze[0].tight"), "squeeze[0].tight: unknown key"),
        (("squeeze[0].value", "flight.airspeed"), "flight.airspeed: unknown key; did you mean airspeed_kt"),
        (("squeeze[0].value", "aircraft.axis"), "aircraft.name: missing"),
        (('"push.toml"', '"pull.toml"'), "pull.toml: no such file"),
        (("[[axes]]", "colour = 1\n[[axes]]"), "colour: unknown key"),
        (("[[axes]]", "samples = 3\n[[axes]]"), "samples: give it if there are random axes"),
        (("[[axes]]", 'collect = ["speed"]\n[[axes]]'), '"speed" is no check of push'),
        (("count = 4", "count = 1000000"), "are more than the"),
        (("title", "titel ="), "broken TOML"),
    ],
)
def test_bad_sweep_file_is_one_line(file: Any, tmp_path: Path, change: tuple[str, str], said: str) -> None:
    result = call(file(GRID.replace(*change, 1)), "--out", tmp_path / "out")
    assert result.exit_code == 2
    assert result.stderr.count("\n") == 1
    assert said in result.stderr
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("scheduler", ["thread", "threads:0", "threads:x", "local-cluster:-1"])
def test_bad_scheduler_is_one_line(file: Any, tmp_path: Path, scheduler: str) -> None:
    result = call(file(GRID), "--out", tmp_path / "out", "--scheduler", scheduler)
    assert result.exit_code == 2
    assert f"--scheduler {scheduler}: " in result.stderr


# --- machinery -------------------------------------------------------------------------------------------------------


def square(point: Mapping[str, Any]) -> dict[str, Any]:
    """Slower for early points, so that the order of completion is not the order of the points."""
    time.sleep(0.004 if point["x"] < 20 else 0.001)
    if point["x"] == 7:
        raise ValueError("seven\nand more")
    if point["x"] == 8:
        raise InputError("eight is not valid")
    return {"y": point["x"] ** 2, "nan": float("nan"), "text": "ü", "flag": True, "none": None}


POINTS = [{"x": k} for k in range(40)]


def same(a: list[Row], b: list[Row]) -> bool:
    return repr(a) == repr(b)  # NaN equals itself here


@pytest.mark.parametrize("workers", [1, 3])
def test_rows_come_in_the_points_order_and_errors_are_rows(workers: int) -> None:
    rows = evaluate_points(square, POINTS, scheduler=Threads(workers))
    assert [row.index for row in rows] == list(range(40))
    assert [row.values.get("y") for row in rows if not row.error] == [k**2 for k in range(40) if k not in (7, 8)]
    assert rows[7].error == "ValueError: seven"
    assert rows[8].error == "eight is not valid"
    assert not rows[7].values


def test_interrupted_evaluation_resumes_where_it_was(tmp_path: Path) -> None:
    whole = evaluate_points(square, POINTS)
    journal = tmp_path / "new" / "points.jsonl"

    def interrupt(done: int, total: int) -> None:
        if done == 15:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        evaluate_points(square, POINTS, journal=journal, report=interrupt)
    with journal.open("ab") as cut:
        cut.write(b'[39, {"y": 15')
    with pytest.raises(InputError, match="15 of 40 points; continue with --resume"):
        evaluate_points(square, POINTS, journal=journal)
    with pytest.raises(InputError, match="another sweep"):
        evaluate_points(square, POINTS, journal=journal, identity="other", resume=True)

    evaluated: list[int] = []

    def watched(point: Mapping[str, Any]) -> dict[str, Any]:
        evaluated.append(point["x"])
        return square(point)

    rows = evaluate_points(watched, POINTS, journal=journal, resume=True)
    assert same(rows, whole)
    assert len(evaluated) == 25
    again = evaluate_points(watched, POINTS, journal=journal, resume=True)
    assert same(again, whole)
    assert len(evaluated) == 25


DAMAGE: dict[str, tuple[Callable[[list[bytes]], list[bytes]], str, int]] = {
    # what is done to the journal's lines, what is said, how many points are evaluated again
    "nothing": (lambda lines: lines, "", 0),
    "cut off": (lambda lines: [*lines[:-1], lines[-1][:-5]], "1 line not taken (1 cut off)", 1),
    "no JSON": (lambda lines: [*lines[:3], b"{]\n", *lines[4:]], "1 line not taken (1 damaged", 1),
    "no text": (lambda lines: [*lines, b"\xff\x00\n"], "1 line not taken", 0),
    "nested": (lambda lines: [*lines, b"[" * 100_000 + b"\n"], "1 line not taken", 0),
    "digits": (lambda lines: [*lines, b"[" + b"1" * 5000 + b', {}, "", ""]\n'], "1 line not taken", 0),
    "empty lines": (lambda lines: [lines[0], b"\n", b"\n", *lines[1:]], "2 lines not taken", 0),
    "an edited value": (lambda lines: [lines[0], lines[1].replace(b'"y": 0', b'"y": 1'), *lines[2:]],
                        "1 line not taken (1 damaged", 1),
    "an edited error": (lambda lines: [line.replace(b"seven", b"eight") for line in lines], "1 line not taken", 1),
    "another point's number": (lambda lines: [lines[0], lines[1].replace(b"[0,", b"[39,"), *lines[2:]],
                               "1 line not taken", 1),
    "no such point": (lambda lines: [*lines, b'[40, {"y": 1}, "", "0"]\n', b'[-1, {"y": 1}, "", "0"]\n'],
                      "2 lines not taken", 0),
    "other types": (lambda lines: [*lines, b'["0", {}, "", ""]\n', b'[0, [], "", ""]\n', b'[true, {}, "", ""]\n',
                                   b"7\n", b"null\n", b'[1.0, {}, "", ""]\n', b'[1, {"y": [1]}, "", ""]\n',
                                   b'[1, {"y": 1}, 3, ""]\n', b'{"a": 1, "b": 2, "c": 3, "d": 4}\n'],
                    "9 lines not taken", 0),
    "of an older version": (lambda lines: [lines[0], b'[0, {"y": 0}, ""]\n', *lines[2:]], "1 line not taken", 1),
    "doubled": (lambda lines: [*lines, lines[1]], "1 line not taken (1 doubled)", 0),
    "a binary end": (lambda lines: [*lines, b"\0" * 4096], "1 line not taken (1 cut off)", 0),
}


@pytest.mark.parametrize("name", DAMAGE)
def test_a_damaged_journal_is_said_and_never_taken(tmp_path: Path, name: str) -> None:
    harm, said, again = DAMAGE[name]
    journal = tmp_path / "points.jsonl"
    whole = evaluate_points(square, POINTS, journal=journal, scheduler=Threads(1))
    sound = journal.read_bytes()
    journal.write_bytes(b"".join(harm(sound.splitlines(keepends=True))))
    evaluated: list[int] = []

    def watched(point: Mapping[str, Any]) -> dict[str, Any]:
        evaluated.append(point["x"])
        return square(point)

    told: list[str] = []
    rows = evaluate_points(watched, POINTS, journal=journal, resume=True, say=told.append)
    assert same(rows, whole)
    assert len(evaluated) == again
    assert [line for line in told if said in line and "\n" not in line] == told
    assert len(told) == bool(said)
    assert sorted(journal.read_bytes().splitlines()) == sorted(sound.splitlines())
    told.clear()
    assert same(evaluate_points(watched, POINTS, journal=journal, resume=True, say=told.append), whole)
    assert (told, len(evaluated)) == ([], again)


def test_lines_of_another_sweep_are_not_taken(tmp_path: Path) -> None:
    """Not even where the numbers fit: identity and point are part of each line's checksum."""
    ours, theirs = tmp_path / "ours.jsonl", tmp_path / "theirs.jsonl"
    whole = evaluate_points(square, POINTS, journal=ours)
    evaluate_points(lambda point: {"y": 1}, POINTS, journal=theirs, identity="other")
    header, *_ = ours.read_bytes().splitlines(keepends=True)
    ours.write_bytes(header + b"".join(theirs.read_bytes().splitlines(keepends=True)[1:]))
    told: list[str] = []
    assert same(evaluate_points(square, POINTS, journal=ours, resume=True, say=told.append), whole)
    assert "40 lines not taken" in told[0]
    assert "0 of 40 points are known" in told[0]
    for damaged in (b"", b"{}\n", header[:20] + b"\n", b"\0" * 100):
        ours.write_bytes(damaged)
        if damaged:
            with pytest.raises(InputError, match="choose another --out"):
                evaluate_points(square, POINTS, journal=ours, resume=True)
        else:
            assert same(evaluate_points(square, POINTS, journal=ours, resume=True), whole)


def test_contradicting_lines_are_evaluated_again(tmp_path: Path) -> None:
    journal = tmp_path / "points.jsonl"
    points = [{"x": 1}, {"x": 2}]
    rows = evaluate_points(lambda point: {"y": math.nan}, points, journal=journal)
    other = tmp_path / "other.jsonl"
    evaluate_points(lambda point: {"y": 2.0}, points, journal=other)
    journal.write_bytes(journal.read_bytes() + other.read_bytes().splitlines(keepends=True)[1])
    told: list[str] = []
    again = evaluate_points(lambda point: {"y": math.nan}, points, journal=journal, resume=True, say=told.append)
    assert same(again, rows)
    assert "1 contradicting another" in told[0]
    assert "1 of 2 points are known" in told[0]


def test_two_sweeps_cannot_share_a_journal(tmp_path: Path) -> None:
    with Journal(tmp_path / "points.jsonl", "a", POINTS), pytest.raises(InputError, match="being written by another"):
        Journal(tmp_path / "points.jsonl", "a", POINTS, resume=True)


def test_interrupt_drops_points_that_have_not_begun() -> None:
    begun: list[int] = []

    def slow(point: Mapping[str, Any]) -> dict[str, Any]:
        begun.append(point["x"])
        time.sleep(0.01)
        return {}

    def interrupt(done: int, total: int) -> None:
        if done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        evaluate_points(slow, [{"x": k} for k in range(1000)], report=interrupt, scheduler="threads:2")
    assert len(begun) <= 2 + 2 * 2


def test_memory_gives_what_a_recording_gives(tmp_path: Path, file: Any) -> None:
    file(GRID)
    scenario = load_scenario(tmp_path / "push.toml")
    result = run(scenario, out=tmp_path, rerun=False)
    values = measure_in_memory(scenario)
    assert values == {"status": result.status, "message": "", "peak": result["peak"], "torque": result["torque"]}
    # Signal by signal and in a window that starts between two PLC cycles.
    names = ("/column.angle", "/feel.torque", "/drive.current", "/pilot.hand_force")
    checks = [Check(name=name, metric="mean", signal=name, window=(0.05013, 0.15)) for name in names]
    memory = in_memory(scenario, checks)
    ours, theirs = (Window(s, 0.05013, 0.15, Parameters()) for s in (memory, result.recording()))
    for name in names:
        assert len(ours[name]) > 200
        np.testing.assert_array_equal(ours[name], theirs[name])
    np.testing.assert_array_equal(ours.time, theirs.time)


def in_memory(scenario: Scenario, checks: Sequence[Check]) -> Memory:
    memory = Memory(checks, CLOCK, TOPICS)
    for block in scripted.run(Bench(Parameters(), seed=scenario.seed), scenario):
        memory.keep(block)
    return memory


def test_memory_holds_what_checks_read_and_no_more() -> None:
    """800 s of it would be 16 MB for each signal, and not 400 MB."""
    checks = [
        Check(name="peak", metric="maximum", signal="/column.angle", window=(0.0, 8.0)),
        Check(name="shake", metric="oscillation_amplitude_deg", window=(0.0, 8.0)),
        Check(name="force", metric="mean", signal="/pilot.hand_force", window=(1.0, 1.2)),
    ]  # fmt: skip
    memory = Memory(checks, CLOCK, TOPICS)
    tracemalloc.start()
    for first in range(0, 200_000, 4000):
        rows = {topic.path: np.ones((topic.rows(first, 4000), len(topic.signals))) for topic in TOPICS}
        memory.keep(Block(first, 4000, rows, np.zeros((0, 1, 7))))
    del rows
    held, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert len(memory.samples_at("/column.angle", range(0, 200_000, 8)).ticks) == 20_000
    assert len(memory.samples_at("/pilot.hand_force", range(20_000, 24_000, 8)).ticks) == 500
    assert held < 250_000  # 164 kB of samples, in 42 pieces
    with pytest.raises(KeyError, match=r"no check reads /column\.torque"):
        memory.samples_at("/column.torque", range(0, 8, 8))


# --- the command -----------------------------------------------------------------------------------------------------


def test_same_table_on_any_number_of_workers(file: Any, tmp_path: Path) -> None:
    tables = []
    for workers in (1, 2, 3):
        out = tmp_path / str(workers)
        result = call(file(GRID), "--out", out, "--scheduler", f"threads:{workers}")
        assert result.exit_code == 0, result.output
        tables.append((out / "table.parquet").read_bytes())
        assert (out / "figure.png").stat().st_size > 10_000
        assert (out / "figure.svg").is_file()
    assert tables[0] == tables[1] == tables[2]
    table = pq.read_table(tmp_path / "1" / "table.parquet")
    assert table.column_names == ["point", "feel.inertia", "squeeze[0].value", "status", "peak", "torque", "message"]
    assert table.schema.field("torque").metadata[b"unit"] == "N·m".encode()
    assert len(set(table["torque"].to_pylist())) == 8  # every point is a run of its own
    assert set(table["status"].to_pylist()) <= {"passed", "failed"}


def test_failing_points_are_rows(file: Any, tmp_path: Path) -> None:
    sweep = """
title = "Some of it is impossible"
scenario = "push.toml"
collect = ["torque"]
[[axes]]
key = "limb.mass"
kind = "list"
values = [1.8, -1.0]
[[axes]]
key = "duration"
kind = "list"
values = [0.2, 0.1]
[[checks]]
name = "speed"
metric = "maximum"
signal = "/column.velocity"
window = [0.0, 0.1]
"""
    result = call(file(sweep), "--out", tmp_path / "out", "--json")
    assert result.exit_code == 0, result.output
    found = json.loads(result.stdout)
    assert found["statuses"] == {"error": 3, "passed": 1}
    assert found["metrics"]["torque"]["missing"] == 3
    table = pq.read_table(found["table"])
    assert table["status"].to_pylist() == ["passed", "error", "error", "error"]
    assert table["speed"].to_pylist()[1:] == [None, None, None]
    assert table["speed"].to_pylist()[0] > 0.1
    assert "window" in table["message"][1].as_py()
    assert "limb.mass: -1.0 is not valid" in table["message"][2].as_py()


def test_nothing_but_errors_is_an_error(file: Any, tmp_path: Path) -> None:
    sweep = GRID.replace("from = 0.2", "from = -0.5").replace("to = 0.5", "to = -0.2")
    result = call(file(sweep), "--out", tmp_path / "out")
    assert result.exit_code == 2
    assert "no point could be evaluated" in result.stderr
    assert pq.read_table(tmp_path / "out" / "table.parquet").num_rows == 8


def sweep_with_controller(file: Any, tmp_path: Path, controller: str, *options: str) -> tuple[Result, list[Any]]:
    """The sweep of twelve points with a controller; its statuses."""
    path = file(GRID.replace("count = 4", "count = 6"))
    own = '[controller]\nsource = "loop.py:Loop"\n[[hand]]'
    (tmp_path / "push.toml").write_text(SCENARIO.replace("[[hand]]", own, 1))
    (tmp_path / "loop.py").write_text(controller)
    result = call(path, "--out", tmp_path / "out", *options)
    table = tmp_path / "out" / "table.parquet"
    return result, pq.read_table(table)["status"].to_pylist() if table.exists() else []


LOOP = "from cls_bench import Command\nclass Loop:\n    def step(self, inputs): return Command(0.0)\n"


def test_many_workers_have_the_memory_they_need(file: Any, tmp_path: Path) -> None:
    result, statuses = sweep_with_controller(file, tmp_path, LOOP, "--scheduler", "threads:32")
    assert result.exit_code == 0, result.output
    assert statuses == ["passed"] * 12


@pytest.mark.slow
def test_a_cluster_has_the_memory_it_needs(file: Any, tmp_path: Path) -> None:
    pytest.importorskip("distributed")
    result, statuses = sweep_with_controller(file, tmp_path, LOOP, "--scheduler", "local-cluster:2")
    assert result.exit_code == 0, result.output
    assert statuses == ["passed"] * 12


def test_limits_grow_with_the_workers() -> None:
    assert Limits().tree_mb == 600
    assert Limits(megabytes=100, threads=4).process_mb == 4 * (100 + THREAD_MB)
    one, two = (Limits(processes=n).tree_mb for n in (1, 2))
    assert two - one > Limits().megabytes


def test_a_controller_that_takes_too_much_ends_the_sweep(file: Any, tmp_path: Path) -> None:
    greedy = LOOP.replace("return", "KEEP.append(bytearray(2**20)); return") + "KEEP = []\n"
    options = "--scheduler", "threads:2", "--controller-memory", "50"
    result, statuses = sweep_with_controller(file, tmp_path, greedy, *options)
    assert result.exit_code == 5
    assert "error: " in result.stderr
    assert "passed" not in statuses


def test_a_controller_that_cannot_be_made_has_failed(file: Any, tmp_path: Path) -> None:
    odd = LOOP.replace("    def step", "    def __init__(self, parameters): CHECK\n    def step")
    result, statuses = sweep_with_controller(file, tmp_path, odd.replace("CHECK", "1 / 0"))
    assert result.exit_code == 5
    assert "the controller failed at every point" in result.stderr
    assert statuses == ["controller_failed"] * 12
    (tmp_path / "out" / "points.jsonl").unlink()
    some = odd.replace("CHECK", "1 / (parameters.feel.inertia > 0.25)")
    result, statuses = sweep_with_controller(file, tmp_path, some)
    assert result.exit_code == 0, result.output
    assert statuses == ["controller_failed"] * 2 + ["passed"] * 10


def test_no_memory_is_no_wrong_model(monkeypatch: pytest.MonkeyPatch) -> None:
    def compile_nothing(spec: object) -> None:
        raise ValueError("Error: Could not allocate memory")

    monkeypatch.setattr("cls_bench.plant.model.mujoco.MjSpec.compile", compile_nothing)
    with pytest.raises(MemoryError, match="no memory"):
        Bench(Parameters())


class Fragile(Bench):
    """A bench that leaves all bounds after its first block if the rendered inertia is low."""

    def advance(self, hand: HandSamples | Sequence[HandSamples] | tick.Hand, *, last: bool = False) -> Block:
        block = super().advance(hand, last=last)
        if self.parameters.feel.inertia < 0.3:
            self.failure = DivergedError(self.time, "motor current")
        return block


def test_diverged_points_are_rows(file: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cls_bench.sweep.runs.Bench", Fragile)
    monkeypatch.setattr("cls_bench.sweep.runs._used", threading.local())  # no bench of another test's is used again
    sweep = """
title = "Before and after"
scenario = "push.toml"
[[axes]]
key = "feel.inertia"
kind = "list"
values = [0.4, 0.2, 0.5]
[[checks]]
name = "late"
metric = "mean"
signal = "/column.angle"
window = [0.3, 0.4]
"""
    path = file(sweep)
    (tmp_path / "push.toml").write_text(SCENARIO.replace("duration = 0.2", "duration = 0.4"))
    result = call(path, "--out", tmp_path / "out", "--json")
    assert result.exit_code == 0, result.output
    table = pq.read_table(tmp_path / "out" / "table.parquet")
    assert [status == "diverged" for status in table["status"].to_pylist()] == [False, True, False]
    assert table["message"].to_pylist() == [
        "",
        "diverged at t = 0.2000 s: motor current",
        "",
    ]
    assert table["peak"][1].as_py() > 0.01  # measured before
    assert np.isnan(table["late"].to_pylist()).tolist() == [False, True, False]


def test_ctrl_c_keeps_what_is_done(file: Any, tmp_path: Path) -> None:
    path = file(GRID.replace("count = 4", "count = 40"))
    whole = call(path, "--out", tmp_path / "whole")
    assert whole.exit_code == 0, whole.output
    out = tmp_path / "out"
    command = [sys.executable, "-c", "from cls_bench.cli import main; main()", "sweep", str(path), "--out", str(out)]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, cwd=ROOT)
    wait_for(lambda: (out / "points.jsonl").exists() and lines(out) > 5, process)
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=30)
    assert process.returncode == 130, said
    assert "continue with --resume" in said
    assert "Traceback" not in said
    done = lines(out)
    assert 5 < done < 80
    assert not (out / "table.parquet").exists()
    refused = call(path, "--out", out)
    assert refused.exit_code == 2
    assert f"has {done} of 80 points" in refused.stderr
    resumed = call(path, "--out", out, "--resume")
    assert resumed.exit_code == 0, resumed.output
    assert (out / "table.parquet").read_bytes() == (tmp_path / "whole" / "table.parquet").read_bytes()


def lines(out: Path) -> int:
    """Rows in the journal."""
    return (out / "points.jsonl").read_bytes().count(b"\n") - 1


def wait_for(condition: Callable[[], bool], *processes: subprocess.Popen[Any], timeout: float = 60.0) -> None:
    """Until ``condition`` holds while the processes run."""
    end = time.monotonic() + timeout
    while not condition():
        assert time.monotonic() < end, "waited in vain"
        for process in processes:
            assert process.poll() is None, f"{process.args} ended with {process.returncode}"
        time.sleep(0.01)


# --- Dask ------------------------------------------------------------------------------------------------------------


class Cluster:
    """A real scheduler and its workers, each a process of its own."""

    def __init__(self, folder: Path):
        self.folder = folder
        self.contact = folder / "scheduler.json"
        self.scheduler = self._start("scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard")
        wait_for(self.contact.exists, self.scheduler)
        self.workers = [self._worker() for _ in range(2)]

    @property
    def address(self) -> str:
        return str(json.loads(self.contact.read_text())["address"])

    def _worker(self) -> subprocess.Popen[bytes]:
        return self._start("worker", "--nthreads", "1", "--no-nanny", "--no-dashboard")

    def _start(self, kind: str, *options: str) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-m", "dask", kind, "--scheduler-file", str(self.contact), *options]
        environment = os.environ | {"PYTHONPATH": str(ROOT)}
        with (self.folder / "dask.log").open("ab") as log:
            return subprocess.Popen(command, stdout=log, stderr=log, cwd=self.folder, env=environment)

    def close(self) -> None:
        for process in (*self.workers, self.scheduler):
            process.kill()
            process.wait()


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[Cluster]:
    started = Cluster(tmp_path)
    yield started
    started.close()


def test_killed_worker_loses_and_doubles_nothing(file: Any, tmp_path: Path, cluster: Cluster) -> None:
    path = file(GRID.replace("count = 4", "count = 40"))
    threads = call(path, "--out", tmp_path / "threads")
    assert threads.exit_code == 0, threads.output
    out = tmp_path / "dask"
    command = [sys.executable, "-c", "from cls_bench.cli import main; main()", "sweep", str(path), "--out", str(out)]
    process = subprocess.Popen([*command, "--scheduler", cluster.address], stderr=subprocess.PIPE, text=True, cwd=ROOT)
    wait_for(lambda: (out / "points.jsonl").exists() and lines(out) > 15, process, *cluster.workers)
    cluster.workers[0].kill()
    _, said = process.communicate(timeout=60)
    assert process.returncode == 0, said
    numbers = [json.loads(line)[0] for line in (out / "points.jsonl").read_bytes().splitlines()[1:]]
    assert sorted(numbers) == list(range(80))
    assert (out / "table.parquet").read_bytes() == (tmp_path / "threads" / "table.parquet").read_bytes()


def test_local_cluster_gives_the_same_rows() -> None:
    rows = evaluate_points(square, POINTS, scheduler="local-cluster:2")
    assert same(rows, evaluate_points(square, POINTS))


def test_no_scheduler_there(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cls_bench.sweep.engine.CONNECT_S", 0.5)
    with pytest.raises(InputError, match="no scheduler answers"):
        evaluate_points(square, POINTS, scheduler="tcp://127.0.0.1:1")


def test_lost_scheduler_is_one_line_and_keeps_the_rows(cluster: Cluster, tmp_path: Path) -> None:
    journal = tmp_path / "points.jsonl"

    def stop(done: int, total: int) -> None:
        if done == 10:
            cluster.scheduler.kill()

    with pytest.raises(Exception, match="scheduler was lost"):
        evaluate_points(
            square, [{"x": 9 + k} for k in range(2000)], journal=journal, scheduler=cluster.address, report=stop
        )
    assert lines(tmp_path) >= 10


def test_worker_with_other_sources_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cls_bench.sweep.engine.sources", lambda: "other")
    with pytest.raises(InputError, match="other sources"):
        evaluate_points(square, POINTS, scheduler="local-cluster:1")


def test_schedulers_by_name() -> None:
    assert make_engine("threads:3") == Threads(3)
    assert make_engine("local-cluster:2") == Dask(workers=2)
    assert make_engine("tcp://host:8786") == Dask(address="tcp://host:8786")


def test_sweeps_shown_in_the_guide_are_valid(tmp_path: Path) -> None:
    texts = re.findall(
        r"^```toml sweep\n(.*?)^```", (ROOT / "docs" / "sweeps.md").read_text(), re.MULTILINE | re.DOTALL
    )
    assert texts
    for text in texts:
        path = tmp_path / "shown.toml"
        path.write_text(text)
        plan = load_sweep(path)
        assert len(plan.sweep.points) == 5 * 2 * 20
        assert [check.name for check in plan.checks] == ["squeezed_amplitude", "torque_ripple"]


def test_a_resumed_sweep_notices_a_changed_controller(file: Any, tmp_path: Path) -> None:
    """Its own file and the modules beside it are part of what is evaluated."""
    path = file(GRID)
    (tmp_path / "push.toml").write_text(SCENARIO + '\n[controller]\nsource = "loop.py:Loop"\n')
    (tmp_path / "gain.py").write_text("K = 1.0\n")
    (tmp_path / "loop.py").write_text("from gain import K\nclass Loop:\n    pass\n")
    before = load_sweep(path).identity
    assert load_sweep(path).identity == before
    (tmp_path / "gain.py").write_text("K = 2.0\n")
    assert load_sweep(path).identity != before
