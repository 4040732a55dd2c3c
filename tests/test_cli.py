"""The command line as a user meets it: exit codes, one line for each error, nothing lost."""

import json
import resource
import signal
import subprocess
import sys
import time
import warnings
from pathlib import Path

import jsonschema
import pytest
from click.testing import CliRunner, Result

from cls_bench.cli import main
from cls_bench.recording import Recording
from cls_bench.resources import shipped_scenarios

SHORT = """
title = "short"
duration = 0.2
[[hand]]
at = 0.0
kind = "hold"
angle_deg = 3.0
[[checks]]
name = "peak"
metric = "maximum"
signal = "/column.angle"
window = [0.0, 0.2]
max = 0.2
"""


def call(*arguments: str | Path) -> Result:
    return CliRunner().invoke(main, [str(a) for a in arguments])


@pytest.fixture
def short(tmp_path: Path) -> Path:
    path = tmp_path / "short.toml"
    path.write_text(SHORT)
    return path


def one_line(result: Result) -> str:
    """The error, which must be a single line without a traceback."""
    assert isinstance(result.exception, SystemExit), result.exception
    assert result.stderr.count("\n") == 1, result.stderr
    assert result.stderr.startswith("error: ")
    return result.stderr


# --- what works ------------------------------------------------------------------------------------------------------


def test_run_prints_a_table_and_where_the_recordings_lie(short: Path, tmp_path: Path) -> None:
    result = call("run", short, "--out", tmp_path / "out")
    assert result.exit_code == 0, result.output
    assert "peak" in result.stdout
    assert "PASSED" in result.stdout
    assert max(map(len, result.stdout.splitlines()[:6])) <= 80
    for path in (tmp_path / "out").iterdir():
        assert path.name in result.stdout.replace("\n", "")
    assert {p.suffix for p in (tmp_path / "out").iterdir()} == {".mcap", ".rrd"}
    assert result.stderr == ""  # no progress noise where there is no terminal


def test_json_is_one_object_with_all_that_was_promised(short: Path, tmp_path: Path) -> None:
    result = call("run", short, "--out", tmp_path / "out", "--no-rerun", "--json")
    answer = json.loads(result.stdout)
    assert list(answer) == ["scenario", "status", "metrics", "checks", "events", "recordings", "timing"]
    assert answer["scenario"] == "short"
    assert answer["status"] == "passed"
    assert answer["metrics"]["peak"]["unit"] == "rad"
    assert answer["checks"][0] == {
        "name": "peak", "metric": "maximum", "window": [0.0, 0.2], "value": answer["metrics"]["peak"]["value"],
        "unit": "rad", "min": None, "max": 0.2, "passed": True,
    }  # fmt: skip
    assert answer["recordings"]["rrd"] is None
    assert Recording(Path(answer["recordings"]["mcap"])).status == "complete"
    assert answer["timing"]["simulated_s"] == pytest.approx(0.2)
    assert answer["timing"]["real_time_factor"] > 0


def test_a_failed_check_is_exit_code_1(short: Path, tmp_path: Path) -> None:
    short.write_text(SHORT.replace("max = 0.2", "max = -0.1"))
    result = call("run", short, "--out", tmp_path / "out", "--no-rerun")
    assert result.exit_code == 1
    assert "FAILED" in result.stdout


def test_no_run_overwrites_another(short: Path, tmp_path: Path) -> None:
    for _ in range(3):
        call("run", short, "--out", tmp_path / "out", "--no-rerun")
    assert len(list((tmp_path / "out").glob("*.mcap"))) == 3


def test_set_and_seed_reach_the_recording(short: Path, tmp_path: Path) -> None:
    call("run", short, "--out", tmp_path / "out", "--no-rerun", "--seed", "9", "--set", "feel.inertia=0.7")
    (path,) = (tmp_path / "out").glob("*.mcap")
    recording = Recording(path)
    assert recording.metadata["seed"] == "9"
    assert recording.parameters["feel"]["inertia"] == 0.7
    assert "feel.inertia=0.7" in recording.metadata["overrides"]


def test_list_names_every_shipped_scenario() -> None:
    result = call("list")
    assert result.exit_code == 0
    assert all(name in result.stdout for name in shipped_scenarios())


@pytest.mark.parametrize("option, word", [
    ("--metrics", "breakout_torque"), ("--signals", "/load_cell.torque"), ("--signals", "/gearbox.stage3_twist"),
    ("--parameters", "gearbox.stage1.backlash"),
])  # fmt: skip
def test_list_names_what_scenarios_are_made_of(option: str, word: str) -> None:
    result = call("list", option)
    assert result.exit_code == 0
    assert word in result.stdout


def test_every_shipped_scenario_is_valid_for_us_and_for_the_schema() -> None:
    import tomllib

    assert call("validate", *shipped_scenarios()).exit_code == 0
    schema = json.loads(call("schema").stdout)
    jsonschema.Draft202012Validator.check_schema(schema)
    for path in shipped_scenarios().values():
        jsonschema.validate(tomllib.loads(path.read_text()), schema)


# --- what does not ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("change, words", [
    (("duration = 0.2", "duraton = 0.2"), ("duraton", "duration")),
    (("duration = 0.2", 'duration = "long"'), ("duration", '"long"', "number")),
    (("duration = 0.2", "duration = 0.0"), ("duration", "0.0", "> 0")),
    (("window = [0.0, 0.2]", "window = [0.0, 3.0]"), ("checks[0].window", "3", "0.2")),
    (('metric = "maximum"', 'metric = "maxmum"'), ("checks[0].metric", "maxmum", "maximum")),
    (('signal = "/column.angle"', 'signal = "/column.angel"'), ("checks[0].signal", "/column.angel", "angle")),
    (('signal = "/column.angle"', ""), ("checks[0]", "signal")),
    (("[[checks]]", "[parameters.feel]\ninertia = -1.0\n[[checks]]"), ("parameters.feel.inertia", "-1", "≥ 0.001")),
    (("[[checks]]", "[[checks"), ("line 8", "TOML")),
])  # fmt: skip
def test_a_bad_scenario_is_one_line_that_names_file_key_value_and_what_is_valid(
    short: Path, tmp_path: Path, change: tuple[str, str], words: tuple[str, ...]
) -> None:
    assert change[0] in SHORT
    short.write_text(SHORT.replace(*change))
    for command in (("run", short, "--out", tmp_path / "out"), ("validate", short)):
        result = call(*command)
        assert result.exit_code == 2
        message = one_line(result)
        assert str(short) in message
        for word in words:
            assert word in message, message
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("override, words", [
    ("feel.inertia", ("KEY=VALUE",)),
    ("feel.inertia=-1.0", ("feel.inertia", "-1", "≥ 0.001")),
    ("feel.inertai=1.0", ("feel.inertai", "inertia")),
    ("gearbox.efficiency=0.99", ("gearbox.efficiency", "unknown parameter", "gearbox.stage1.efficiency")),
    ("gearbox.stage1.efficiency=1.01", ("gearbox.stage1.efficiency", "1.01", "≤ 1")),
    ("gearbox.stage3.efficiency=0.99", ("gearbox.stage3.efficiency", "no stage 3", "gearbox.stages = 2")),
    ("column.switch_angle=0.3", ("column", "travel, switch_angle and stop_angle must grow in this order")),
])  # fmt: skip
def test_a_bad_override_is_one_line(short: Path, override: str, words: tuple[str, ...]) -> None:
    result = call("validate", short, "--set", override)
    assert result.exit_code == 2
    message = one_line(result)
    assert all(word in message for word in words), message


def test_a_missing_scenario_names_those_that_exist(tmp_path: Path) -> None:
    result = call("run", "friction_maskin", "--out", tmp_path)
    assert result.exit_code == 2
    assert "friction_masking" in one_line(result)
    assert call("run", tmp_path / "none.toml").exit_code == 2


def test_an_output_folder_that_is_a_file_is_one_line(short: Path, tmp_path: Path) -> None:
    (tmp_path / "taken").write_text("")
    result = call("run", short, "--out", tmp_path / "taken" / "inner")
    assert result.exit_code == 2
    assert str(tmp_path / "taken") in one_line(result)


def test_view_of_a_missing_recording_is_one_line(tmp_path: Path) -> None:
    result = call("view", tmp_path / "none.rrd")
    assert result.exit_code == 2
    assert "none.rrd" in one_line(result)


# --- what interrupts a run -------------------------------------------------------------------------------------------


def start(*arguments: str | Path, **options: object) -> "subprocess.Popen[str]":
    command = [sys.executable, "-c", "from cls_bench.cli import main; main()", *map(str, arguments)]
    return subprocess.Popen(command, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE, **options)  # type: ignore[call-overload,no-any-return]


def readable(folder: Path) -> Recording:
    (path,) = folder.glob("*.mcap")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return Recording(path)


def test_ctrl_c_is_one_line_and_keeps_what_was_recorded(short: Path, tmp_path: Path) -> None:
    short.write_text(SHORT.replace("duration = 0.2", "duration = 3000.0"))
    process = start("run", short, "--out", tmp_path / "out", "--no-rerun")
    deadline = time.monotonic() + 120.0
    while time.monotonic() < deadline:
        files = list((tmp_path / "out").glob("*.mcap"))
        if files and files[0].stat().st_size > 2_000_000:
            break
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 130
    assert errors.strip().splitlines()[-1].startswith("interrupted")
    assert "Traceback" not in errors
    recording = readable(tmp_path / "out")
    assert recording.status == "interrupted"
    assert recording.duration > 0.5
    assert len(recording.read("/column")) == round(recording.duration / 50e-6)


def test_a_full_disk_is_one_line_and_keeps_what_was_recorded(short: Path, tmp_path: Path) -> None:
    short.write_text(SHORT.replace("duration = 0.2", "duration = 20.0"))

    def limit() -> None:
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (2_000_000, 2_000_000))

    from cls_bench.experiment import run

    run(short, out=tmp_path / "warm", set=["duration=0.2"], rerun=False)  # the cache must not meet the limit
    process = start("run", short, "--out", tmp_path / "out", "--no-rerun", preexec_fn=limit)
    _, errors = process.communicate(timeout=120)
    assert process.returncode == 2
    assert errors.count("\n") == 1
    assert errors.startswith("error: cannot write ")
    assert readable(tmp_path / "out").duration > 0.2


def test_the_command_starts_quickly_because_help_imports_no_simulator() -> None:
    code = "import sys; from cls_bench.cli import main\ntry: main(['--help'])\nexcept SystemExit: pass\n"
    code += "print([m for m in ('mujoco', 'numba', 'numpy', 'rerun') if m in sys.modules])"
    output = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert output.strip().endswith("[]")


CONTROLLER = """
from cls_bench import Command

class Still:
    def step(self, inputs):
        return Command(0.0)

class Blind:
    pass
"""


def test_a_users_own_outer_loop_replaces_the_feel_model(short: Path, tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(CONTROLLER)
    result = call("run", short, "--out", tmp_path / "out", "--no-rerun", "--controller", f"{tmp_path}/mine.py:Still")
    assert result.exit_code == 0, result.output
    (path,) = (tmp_path / "out").glob("*.mcap")
    assert abs(Recording(path).read("/column", ["angle"])["angle"]).max() < 0.01  # it holds against the hand


@pytest.mark.parametrize("place, word, code", [
    ("mine.py:Other", "Still", 2), ("none.py:Still", "no such file", 2), ("mine.py", "FILE.py:NAME", 2),
    ("mine.py:Blind", "step", 2), ("broken.py:Still", "SyntaxError", 5),
])  # fmt: skip
def test_a_bad_controller_is_one_line(short: Path, tmp_path: Path, place: str, word: str, code: int) -> None:
    (tmp_path / "mine.py").write_text(CONTROLLER)
    (tmp_path / "broken.py").write_text("def (")
    result = call("run", short, "--out", tmp_path / "out", "--controller", f"{tmp_path}/{place}")
    assert result.exit_code == code
    assert word in one_line(result)
