"""What pages and comparisons say of a run with a controller of the user's own."""

import html
import re
import shlex
from pathlib import Path

import pytest
from click.testing import CliRunner

from cls_bench import experiment
from cls_bench.cli import main
from cls_bench.controllers import Place
from cls_bench.report import comparison, page
from cls_bench.report.figures import pictures
from cls_bench.report.recorded_run import RecordedRun

SCENARIO = """
title = "moved, then let go"
duration = 1.6
[[hand]]
at = 0.0
kind = "ramp"
to_deg = 8.0
over = 0.6
[[hand]]
at = 0.8
kind = "release"
[[checks]]
name = "width"
metric = "hysteresis"
window = [0.0, 0.8]
[[checks]]
name = "used"
metric = "part60_tolerance_used"
window = [0.8, 1.6]
"""

LOOP = """
from cls_bench import Command
class Spring:
    def __init__(self, stiffness=35.0, label=""): self.stiffness = stiffness
    def step(self, inputs): return Command(inputs.torque / self.stiffness)
"""

ARGUMENTS = {"stiffness": 40.0, "label": "it's $(touch x)"}


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, RecordedRun]:
    folder = tmp_path_factory.mktemp("runs")
    (folder / "moved.toml").write_text(SCENARIO)
    (folder / "my loop.py").write_text(LOOP)
    place = f"{folder / 'my loop.py'}:Spring"

    def recorded(**options: object) -> RecordedRun:
        return RecordedRun(experiment.run(folder / "moved.toml", out=folder, rerun=False, **options).mcap)

    return {
        "feel model": recorded(), "own": recorded(controller=Place(place, ARGUMENTS), seed=7, set=["feel.inertia=0.4"]),
        "softer": recorded(controller=Place(place, {**ARGUMENTS, "stiffness": 20.0})),
    }  # fmt: skip


def labels(run: RecordedRun) -> set[str]:
    return {
        text for picture in pictures(run) for ax in picture.figure.axes
        for text in (*(line.get_label() for line in ax.lines), ax.get_ylabel())
    }  # fmt: skip


def test_figures_claim_no_feel_model_that_did_not_run(runs):
    assert "feel model (set)" in labels(runs["feel model"])
    assert "expected: independent solution" in labels(runs["feel model"])
    own = labels(runs["own"])
    assert "Spring (set)" in own
    assert not [label for label in own if "feel" in label or "expected" in label]


def command_of(text: str) -> list[str]:
    shown = re.search(r"How to run it again</h2>\s*<pre>(.*?)\n", text)
    assert shown is not None
    return shlex.split(html.unescape(shown[1]))


def test_the_page_names_the_controller_and_the_true_command(runs, tmp_path):
    run = runs["own"]
    text = page.write_report([run], tmp_path).read_text()
    words = command_of(text)
    assert words[:2] == ["cls-bench", "run"]
    assert words[words.index("--controller") + 1] == f"{run.path.parent / 'my loop.py'}:Spring"
    assert run.recording.metadata["controller.sha256"] in text


def test_the_command_makes_the_same_recording_again(runs, tmp_path, monkeypatch):
    run = runs["own"]
    monkeypatch.chdir(run.path.parent)
    words = command_of(page.write_report([run], tmp_path).read_text())
    result = CliRunner().invoke(main, [*words[1:], "--out", str(tmp_path / "again"), "--no-rerun"])
    assert result.exit_code in (0, 1, 4), result.output  # as the first
    (again,) = (tmp_path / "again").glob("*.mcap")
    first, second = run.recording.read("/column"), RecordedRun(again).recording.read("/column")
    assert all((first[name] == second[name]).all() for name in first.values)


def test_comparison_lists_a_changed_controller(runs, tmp_path):
    changed = {key: (a, b) for key, a, b in comparison.controller_differences(runs["feel model"], runs["own"])}
    assert changed["name"] == ("feel model", "Spring")
    assert set(changed) >= {"name", "source", "sha256", "arguments"}
    (only,) = comparison.controller_differences(runs["own"], runs["softer"])
    assert only[0] == "arguments"
    assert comparison.controller_differences(runs["own"], runs["own"]) == []
    both = [str(runs[name].path) for name in ("own", "softer")]
    result = CliRunner().invoke(main, ["compare", *both, "--out", str(tmp_path)])
    assert result.exit_code == 0
    assert "20.0" in result.output
    (written,) = Path(tmp_path).glob("*.html")
    assert "Controllers that differ" in written.read_text()


def test_an_object_from_a_program_is_named(tmp_path):
    class Mine:
        def step(self, inputs):
            return (0.0,)

    (tmp_path / "moved.toml").write_text(SCENARIO)
    result = experiment.run(tmp_path / "moved.toml", out=tmp_path, rerun=False, controller=Mine())
    text = page.write_report([RecordedRun(result.mcap)], tmp_path).read_text()
    assert "the controller was the object Mine of a program" in html.unescape(text)
