"""Runs from the Python API: what a result holds, what equal runs share, what stops a run."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from cls_bench import Command, Inputs, parse_scenario, run
from cls_bench.errors import InputError
from cls_bench.recording import Recording

TOML = """
title = "short"
duration = 0.4
seed = 3
[[hand]]
at = 0.0
kind = "step"
to_deg = 3.0
[[checks]]
name = "peak"
metric = "maximum"
signal = "/column.angle"
window = [0.0, 0.4]
[[checks]]
name = "late"
metric = "maximum"
signal = "/column.angle"
window = [0.2, 0.4]
max = 1.0
"""


def without_wall_clock(path: Path) -> bytes:
    """The file's bytes but for the wall clock in its metadata records; its length is constant."""
    data = path.read_bytes()
    recording = Recording(path)
    for clock in (recording.wall_start.encode(), recording.wall_end.encode()):
        assert data.count(clock) == 1
        data = data.replace(clock, b"")
    return data


def test_equal_runs_give_equal_bytes(tmp_path: Path) -> None:
    first = run(parse_scenario(TOML), out=tmp_path / "a", rerun=False)
    second = run(parse_scenario(TOML), out=tmp_path / "b", rerun=False)
    a, b = without_wall_clock(first.mcap), without_wall_clock(second.mcap)
    # The summary's checksum covers no wall clock: only its own bytes may differ.
    assert a == b


def test_another_seed_gives_other_samples(tmp_path: Path) -> None:
    a = run(parse_scenario(TOML), out=tmp_path, rerun=False).recording().read("/load_cell")["counts"]
    b = run(parse_scenario(TOML, seed=4), out=tmp_path, rerun=False).recording().read("/load_cell")["counts"]
    assert not np.array_equal(a, b)


def test_a_result_gives_metrics_by_name(tmp_path: Path) -> None:
    result = run(parse_scenario(TOML), out=tmp_path, rerun=False)
    angle = result.recording().read("/column", ["angle"], every=8)["angle"]
    assert result["peak"] == np.max(angle)
    with pytest.raises(KeyError, match="peak, late"):
        result["nothing"]


def test_the_recording_says_how_to_run_it_again(tmp_path: Path) -> None:
    result = run(parse_scenario(TOML, set=["feel.inertia=0.5"]), out=tmp_path, rerun=False)
    recording = result.recording()
    again = parse_scenario(
        recording.attachments["scenario.toml"], set=json.loads(recording.metadata["overrides"]), name="scenario"
    )
    repeated = run(again, out=tmp_path / "again", rerun=False)
    assert without_wall_clock(result.mcap) == without_wall_clock(repeated.mcap)


class Wild:
    """An outer loop that loses its mind after 0.2 s."""

    def step(self, inputs: Inputs) -> Command:
        return Command(math.nan if inputs.time >= 0.2 else 0.0)


def test_nan_from_a_users_controller_stops_the_run_and_keeps_the_recording(tmp_path: Path) -> None:
    result = run(parse_scenario(TOML), out=tmp_path, rerun=False, controller=Wild())
    assert result.status == "controller_failed"
    assert result.exit_code == 5
    assert "Wild.step returned" in result.message
    assert "0.2000 s" in result.message
    recording = result.recording()
    assert recording.status == "controller_failed"
    assert len(recording.read("/column")) == 4000
    assert any(event.level == "error" for event in recording.events())
    assert math.isnan(result["late"])
    assert not next(check for check in result.checks if check.check.name == "late").passed


def test_overrides_need_a_file(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="loaded already"):
        run(parse_scenario(TOML), out=tmp_path, seed=4)
