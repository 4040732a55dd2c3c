"""Controllers of the user's own: how they are found and made, and what becomes of those that misbehave."""

import dataclasses
import gc
import hashlib
import json
import subprocess
import sys
import warnings
from pathlib import Path

import pytest

from cls_bench import experiment
from cls_bench.cli.basics import _run_with_controller
from cls_bench.cli.worker import Limits
from cls_bench.controllers import Controller, Place, parse_arguments
from cls_bench.errors import ControllerError, InputError
from cls_bench.parameters import Parameters
from cls_bench.recording import Recording
from cls_bench.recording.closing import close_cut
from cls_bench.scenario import load_scenario, parse_scenario
from tests.hostile_controllers import DEADLY, FAILING, STRANGE, TAMPERING

SCENARIO = """
title = "short"
duration = 0.3
[[hand]]
at = 0.0
kind = "hold"
angle_deg = 3.0
[[checks]]
name = "peak"
metric = "maximum"
signal = "/column.angle"
window = [0.0, 0.3]
max = 0.2
"""

STILL = "from cls_bench import Command\nclass Loop:\n    def step(self, inputs): return Command(0.0)\n"


def made(folder: Path, text: str, name: str = "Loop", file: str = "loop.py", **arguments: object) -> object:
    (folder / file).write_text(text)
    return Controller(Place(f"{folder / file}:{name}", arguments)).make(Parameters().for_control)


# --- found and made ---------------------------------------------------------------------------------------------------


def test_modules_beside_the_file_are_found(tmp_path):
    (tmp_path / "gains.py").write_text("K = 35.0\n")
    (tmp_path / "more").mkdir()
    (tmp_path / "more" / "__init__.py").write_text("from gains import K\n")
    (tmp_path / "more" / "inner.py").write_text("from . import K\nTWICE = 2 * K\n")
    loop = made(tmp_path, """
from gains import K
import gains as again, more.inner
from more import inner as also
class Loop:
    def __init__(self):
        import gains
        self.k = K, gains.K, again.K, more.inner.TWICE, also.TWICE
    def step(self, inputs): pass
""")
    assert loop.k == (35.0, 35.0, 35.0, 70.0, 70.0)
    assert "gains" not in sys.modules


@pytest.mark.parametrize("name", ["json", "control", "tick", "queue", "numpy", "cls_bench", "my-loop", "a.b"])
def test_no_name_hides_another_or_is_hidden(tmp_path, name):
    installed = sys.modules.get(name)
    (tmp_path / "helper.py").write_text("import json\n")
    loop = made(tmp_path, "import json, helper, numpy\n" + STILL + "    mine = json, helper.json\n", file=f"{name}.py")
    assert loop.mine == (json, json)
    assert sys.modules.get(name) is installed


def test_what_lies_beside_comes_before_what_is_installed_for_the_user_alone(tmp_path):
    (tmp_path / "control.py").write_text("MINE = True\n")
    loop = made(tmp_path, STILL + "    def __init__(self):\n        import control\n        self.c = control\n")
    assert loop.c.MINE
    import control

    assert control.tf is not None


def test_dataclasses_and_pickle_work_inside(tmp_path):
    loop = made(tmp_path, """
from __future__ import annotations
import dataclasses, pickle
@dataclasses.dataclass
class Gains:
    k: float = 2.0
class Loop:
    def __init__(self): self.copy = pickle.loads(pickle.dumps(Gains(3.0)))
    def step(self, inputs): pass
""")
    assert dataclasses.asdict(loop.copy) == {"k": 3.0}


def test_an_edit_of_the_same_size_and_time_is_noticed(tmp_path):
    import os

    made(tmp_path, STILL + "    k = 1\n")
    stamp = (tmp_path / "loop.py").stat()
    (tmp_path / "loop.py").write_text(STILL + "    k = 2\n")
    os.utime(tmp_path / "loop.py", ns=(stamp.st_atime_ns, stamp.st_mtime_ns))
    assert Controller(Place(f"{tmp_path}/loop.py:Loop")).make(Parameters().for_control).k == 2


LATE = """
class Loop:
    LATE = True
    def step(self, inputs):
        import gains
        return gains.K
"""


def test_modules_are_forgotten_with_the_last_object(tmp_path):
    (tmp_path / "gains.py").write_text("K = 3\n")
    text = f"import gains\n{LATE}"
    kept = made(tmp_path, text)
    gc.collect()
    modules, finders = len(sys.modules), len(sys.meta_path)
    for _ in range(20):
        made(tmp_path, text)
        with pytest.raises(ControllerError):
            made(tmp_path, "import gains\n1 / 0\n", file="bad.py")
    gc.collect()
    assert len(sys.modules) == modules
    assert len(sys.meta_path) == finders
    assert kept.step(None) == 3  # what is in use still finds its own


def test_modules_of_an_object_without_weak_references_stay(tmp_path):
    loop = made(tmp_path, LATE.replace("LATE = True", "__slots__ = ()"))
    (tmp_path / "gains.py").write_text("K = 3\n")
    gc.collect()
    assert loop.step(None) == 3


def test_arguments_and_parameters_are_passed_by_name(tmp_path):
    text = "class Loop:\n    def __init__(self, k=1.0, parameters=None): self.given = k, parameters\n"
    text += "    def step(self, inputs): pass\n"
    k, parameters = made(tmp_path, text, k=5.0).given
    assert k == 5.0
    assert parameters.feel.inertia == Parameters().feel.inertia
    assert made(tmp_path, text, parameters=7).given == (1.0, 7)


def test_arguments_are_toml():
    found = parse_arguments(["a=1.5", "b=true", 'c="x = y"', "d=word", "e=[1, 2]", "f={g = 1}"])
    assert found == {"a": 1.5, "b": True, "c": "x = y", "d": "word", "e": [1, 2], "f": {"g": 1}}
    for bad in ("a", "=1", "a=", "a b=1", "a=[1", "1=2", "a=1\nb=2"):
        with pytest.raises(InputError, match="--controller-arg"):
            parse_arguments([bad])


@pytest.mark.parametrize("place", ["loop.py", ":Loop", "none.py:Loop", "no_such_module:Loop", "json:Nope",
                                   "loop.py:Nope", "loop.py:a b", "os.path.nope:Loop", "/:Loop",
                                   "\0.py:Loop"])  # fmt: skip
def test_a_controller_that_is_not_there_is_bad_input(tmp_path, place):
    (tmp_path / "loop.py").write_text(STILL)
    with pytest.raises(InputError) as caught:
        Controller(Place(place, folder=tmp_path))
    assert "\n" not in str(caught.value)


def test_the_scenario_may_name_it(tmp_path):
    (tmp_path / "loop.py").write_text(
        "from cls_bench import Command\nclass Loop:\n    def __init__(self, at): self.at = at\n"
        "    def step(self, inputs): return Command(self.at)\n"
    )
    path = tmp_path / "s.toml"
    path.write_text(SCENARIO + '[controller]\nsource = "loop.py:Loop"\narguments = {at = 0.02}\n')
    result = experiment.run(path, out=tmp_path, rerun=False)
    recording = result.recording()
    assert recording.read("/feel", ["angle"])["angle"][-1] == 0.02
    about = recording.metadata
    assert about["controller.name"] == "Loop"
    assert about["controller.source"] == "loop.py"
    assert json.loads(about["controller.arguments"]) == {"at": 0.02}
    content = (tmp_path / "loop.py").read_bytes()
    assert about["controller.sha256"] == hashlib.sha256(content).hexdigest()
    assert recording.attachments["controller.py"] == content
    (tmp_path / "loop.py").unlink()
    with pytest.raises(InputError, match=r"controller\.source"):
        experiment.validate(load_scenario(path))


def test_a_recording_of_the_feel_model_says_so(tmp_path):
    result = experiment.run(parse_scenario(SCENARIO), out=tmp_path, rerun=False)
    assert result.recording().metadata["controller.name"] == "feel model"


# --- that fail --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", FAILING)
def test_what_python_survives_is_a_controller_error(tmp_path, name):
    """In this very process, as from Python."""
    (tmp_path / "loop.py").write_text(FAILING[name])
    if name in ("exits at import",):
        pytest.skip("ends the process it is in")
    try:
        result = experiment.run(
            parse_scenario(SCENARIO), out=tmp_path, rerun=False, controller=f"{tmp_path / 'loop.py'}:Loop"
        )
    except ControllerError as error:
        message = str(error)
        assert not list(tmp_path.glob("*.mcap"))
    else:
        assert (result.status, result.exit_code) == ("controller_failed", 5)
        message = result.message
        assert "t = 0.1196 s" in message
        recording = result.recording()
        assert recording.status == "controller_failed"
        assert len(recording.read("/column")) == 2392
    assert message.isprintable()
    assert len(message) < 1000


def call(folder: Path, text: str, *options: str) -> tuple[int, str, str]:
    """The command line, as a process of its own."""
    (folder / "s.toml").write_text(SCENARIO)
    (folder / "loop.py").write_text(text.replace("OUT", str(folder / "out")))
    command = [sys.executable, "-m", "cls_bench", "run", f"{folder}/s.toml", "--out", f"{folder}/out", "--no-rerun"]
    command += ["--json", "--controller", f"{folder}/loop.py:Loop", *options]
    done = subprocess.run(command, capture_output=True, text=True, errors="replace", timeout=180, check=False)
    assert "Traceback" not in done.stdout + done.stderr
    return done.returncode, done.stdout, done.stderr


def failed(folder: Path, text: str) -> str:
    """Run what fails; its error."""
    code, output, errors = call(folder, text, "--controller-timeout", "1")
    assert code == 5, errors
    assert len(errors) < 70_000
    files = list((folder / "out").glob("*.mcap"))
    if output:
        assert json.loads(output)["status"] == "controller_failed"
    for file in files:
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # it is whole
            assert Recording(file).status == "controller_failed"
    return errors.strip().splitlines()[-1]


QUICK = ("exits", "reads from nowhere", "loops whatever comes", "allocates without end")


@pytest.mark.parametrize("name", [
    pytest.param(name, marks=() if name in QUICK else pytest.mark.slow) for name in DEADLY
])  # fmt: skip
def test_what_python_does_not_survive_ends_the_command_with_one_line(tmp_path, name):
    assert failed(tmp_path, DEADLY[name]).startswith("error: ")


@pytest.mark.slow
@pytest.mark.parametrize("name", FAILING)
def test_the_command_line_says_the_same(tmp_path, name):
    assert failed(tmp_path, FAILING[name]).startswith("error: ")


@pytest.mark.parametrize("name", [
    pytest.param(name, marks=() if name in ("goes on in a fork", "writes to standard output") else pytest.mark.slow)
    for name in STRANGE
])  # fmt: skip
def test_what_is_only_odd_changes_nothing(tmp_path, name):
    code, output, _ = call(tmp_path, STRANGE[name])
    assert code == 0
    assert json.loads(output)["status"] == "passed"
    (file,) = (tmp_path / "out").glob("*.mcap")
    assert Recording(file).status == "complete"


@pytest.mark.parametrize("name", [
    pytest.param(name, marks=() if name == "changes the metrics" else pytest.mark.slow) for name in TAMPERING
])  # fmt: skip
def test_who_tampers_with_the_bench_is_never_passed(tmp_path, name):
    code, output, errors = call(tmp_path, TAMPERING[name])
    assert code in (2, 5)
    assert '"status": "passed"' not in output
    assert errors.strip().splitlines()[-1].startswith("error: ")


def test_a_supervised_run_gives_the_same_samples(tmp_path):
    (tmp_path / "loop.py").write_text(STILL)
    place = Place(f"{tmp_path / 'loop.py'}:Loop")
    scenario = parse_scenario(SCENARIO)
    here = experiment.run(scenario, out=tmp_path / "a", rerun=False, controller=place)
    there = _run_with_controller(scenario, place, Limits(), tmp_path / "b", False, experiment.Progress())
    for topic in ("/column", "/drive"):
        a, b = (result.recording().read(topic) for result in (here, there))
        assert all((a[name] == b[name]).all() for name in a.values)
    assert [check.value for check in here.checks] == [check.value for check in there.checks]


def test_a_recording_that_was_cut_is_closed(tmp_path):
    result = experiment.run(parse_scenario(SCENARIO), out=tmp_path, rerun=False)
    assert not close_cut(result.mcap, "controller_failed")
    content = result.mcap.read_bytes()
    rows = len(result.recording().read("/column"))
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(content[: content.index(b"result") - 20])
    assert close_cut(cut, "controller_failed")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        recording = Recording(cut)
    assert recording.status == "controller_failed"
    assert len(recording.read("/column")) == rows
