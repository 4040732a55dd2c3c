"""The bench as a whole: the same every time, changes on time, a user's own loop, and runs that end early."""

import ctypes
import hashlib
import math
import os
import signal
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import mujoco
import numpy as np
import pytest

from cls_bench.bench import Bench, DivergedError
from cls_bench.control import outer_loop, plc, validity
from cls_bench.control.outer_loop import Command, OuterLoop
from cls_bench.control.state import STATE
from cls_bench.drivers import scripted
from cls_bench.errors import ControllerError, InputError
from cls_bench.feel import model as feel
from cls_bench.feel import solver
from cls_bench.feel.element import PIECE
from cls_bench.parameters import Column, Parameters, record_of
from cls_bench.scenario import Scenario, parse_scenario
from cls_bench.signals import TOPICS
from tests.running import hold, run

SWAY = """
hand = [{at = 0.0, kind = "hold", angle_deg = 0.0},
        {at = 0.01, kind = "sine", amplitude_deg = 10.0, frequency = 3.0, fade = 0.05}]
squeeze = [{at = 0.1, value = 0.5}]
changes = [{at = 0.15, parameters.feel.inertia = 0.4}]
"""


# --- the same every time ---------------------------------------------------------------------------------------------


def test_same_seed_same_samples():
    assert run(SWAY, seed=3).same_samples(run(SWAY, seed=3))


def test_another_seed_is_another_noise():
    one, other = run(SWAY, seed=3), run(SWAY, seed=4)
    assert not np.array_equal(one["/load_cell.counts"], other["/load_cell.counts"])
    np.testing.assert_allclose(one["/column.angle"], other["/column.angle"], atol=1e-3)


@pytest.mark.parametrize("ticks", [8, 56, 2000])
def test_how_a_run_is_cut_into_blocks_does_not_matter(ticks):
    assert run(SWAY, duration=0.3, block_ticks=ticks).same_samples(run(SWAY, duration=0.3))


def test_compiling_beforehand_does_not_matter():
    scenario = parse_scenario(f'title = "t"\nduration = 0.05\n{SWAY.replace("0.15", "0.03").replace("0.1,", "0.02,")}')
    angles = []
    for beforehand in (False, True):
        bench = Bench(scenario.parameters_at_start())
        if beforehand:
            bench.compile()
        angles.append(np.concatenate([b.signals["/column"] for b in scripted.run(bench, scenario)]))
    np.testing.assert_array_equal(*angles)


def digest(r) -> str:
    return hashlib.sha256(b"".join(r[name].tobytes() for name in sorted(r.signals))).hexdigest()


def test_plain_python_gives_the_same_samples():
    """With the JIT off the same source runs as plain Python, through mujoco.mj_step, over 0.2 s."""
    code = (
        "from tests.running import run; from tests.test_bench import SWAY, digest; "
        "from cls_bench.compiled import JIT; assert not JIT; print(digest(run(SWAY, seed=5)))"
    )
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1", "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == digest(run(SWAY, seed=5))


# --- blocks and the model --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("duration", [0.05, 0.30015, 5e-5])
def test_blocks_follow_on_each_other(duration):
    scenario = parse_scenario(f'title = "t"\nduration = {duration}\nchanges = [{{at = 0.0, mode = "position"}}]')
    bench = Bench(scenario.parameters_at_start())
    end = 0
    for block in scripted.run(bench, scenario):
        assert block.first_tick == end
        assert 0 < block.ticks <= bench.block_ticks == 4000
        for topic, rows in block:
            assert rows.shape == (topic.rows(block.first_tick, block.ticks), len(topic.signals))
            assert np.isfinite(rows).all()
        assert block.poses.shape == (len(block.row_ticks(bench.clock.pose_ticks)), len(bench.body_names), 7)
        np.testing.assert_allclose(np.linalg.norm(block.poses[:, :, 3:], axis=2), 1.0)
        end = block.end_tick
    assert end == math.ceil(round(duration / 5e-5) / 8) * 8  # whole PLC cycles
    assert bench.time == pytest.approx(end * 5e-5)


def test_a_bench_runs_once():
    scenario = parse_scenario('title = "t"\nduration = 0.01\n')
    bench = Bench(Parameters())
    list(scripted.run(bench, scenario))
    with pytest.raises(RuntimeError, match="run already"):
        next(scripted.run(bench, scenario))


def test_the_model_travels_complete():
    bench = Bench(Parameters(column=Column(inertia=0.05)))
    model = mujoco.MjModel.from_xml_string(bench.mjcf["bench.xml"].decode())
    assert [model.body(k).name for k in range(model.nbody)] == list(bench.body_names)
    stepped = bench.model
    for joint in ("motor", "carrier1"):
        assert model.body_inertia[model.joint(joint).bodyid[0]] == pytest.approx(stepped.body(joint).inertia, rel=1e-5)
    column = model.body("column")
    assert column.inertia[1] + column.mass[0] * column.ipos[2] ** 2 == pytest.approx(0.05, rel=1e-5)
    rod_end = 0.15 * 0.175**2  # a body of its own there, part of the column in what is stepped
    column = stepped.body("column")
    assert column.inertia[1] + column.mass[0] * column.ipos[2] ** 2 == pytest.approx(0.05 + rod_end)
    assert model.opt.timestep == stepped.opt.timestep == 5e-5
    assert {"cls_bench.xml", "scene.xml"} < set(bench.mjcf)
    assert bench.body_names[0] == "world"
    assert {g.kind for g in bench.geoms} >= {"box", "cylinder", "capsule"}


def test_a_linkage_that_cannot_be_closed_is_refused():
    with pytest.raises(InputError, match=r"^scenario with --set: parameters: .*the linkage cannot be closed"):
        parse_scenario('title = "t"\nduration = 1.0', set=["linkage.crank=0.01"])


# --- changes ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("at", "tick"), [(0.05, 1000), (0.05015, 1008), (0.0504, 1008), (0.0, 0)])
def test_parameters_change_with_the_next_plc_cycle(at, tick):
    r = run(
        f'changes = [{{at = {at}, mode = "torque", parameters.drive.set_torque = 0.5}}]', duration=0.06
    )
    command = r["/drive.torque_command"]
    np.testing.assert_array_equal(command[tick // 4 :], 0.5)
    assert (command[: tick // 4] != 0.5).all()
    assert sorted((e.tick, e.source, e.message) for e in r.events) == [
        (tick, "scenario", "drive mode torque"), (tick, "scenario", "drive.set_torque = 0.5 N·m"),
    ]  # fmt: skip


def test_power_changes_and_says_so():
    r = run('changes = [{at = 0.1, power = "on"}]\n[drive]\npower = "off"', duration=0.15)
    assert not r.between("/drive.voltage", 0.0, 0.1).any()
    assert r.between("/drive.voltage", 0.1, 0.15).any()
    assert [e.message for e in r.events] == ["drive power on"]


def test_several_changes_of_nested_parameters():
    r = run(
        """
        changes = [{at = 0.01, parameters.feel = {inertia = 0.2, aft_limit.stiffness = 9.0}},
                   {at = 0.02, parameters.feel.inertia = 0.5}]
        """,
        duration=0.05,
    )
    f = r.bench.parameters.feel
    assert (f.inertia, f.aft_limit.stiffness, f.stiffness) == (0.5, 9.0, 35.0)
    assert {e.message for e in r.events} == {
        "feel.inertia = 0.2 kg·m²", "feel.aft_limit.stiffness = 9.0 N·m/rad", "feel.inertia = 0.5 kg·m²",
    }  # fmt: skip


# --- a user's own outer loop -----------------------------------------------------------------------------------------


class OwnFeelModel:
    """The built-in position loop, once more from outside."""

    def __init__(self):
        self.feel = record_of(Parameters()).feel
        self.state = np.zeros(1, dtype=feel.STATE).view(np.recarray)[0]
        self.piece = np.zeros(1, dtype=PIECE).view(np.recarray)[0]
        self.inputs = []

    def step(self, inputs):
        self.inputs.append(inputs)
        solver.step(self.feel, self.state, self.piece, inputs.torque, inputs.time, 4e-4)
        return Command(self.state.angle, self.state.velocity, self.state.acceleration)


def test_an_own_loop_that_does_the_same_gives_the_same_samples():
    text = SWAY.replace("changes", "#")
    own = OwnFeelModel()
    assert isinstance(own, OuterLoop)
    theirs, ours = run(text, controller=own), run(text)
    assert theirs.same_samples(ours)
    assert theirs["/surface.deflection"].any()  # the surface goes along with what the loop asks for
    assert [i.time for i in own.inputs] == pytest.approx([k * 4e-4 for k in range(500)])


def test_an_own_loop_is_asked_only_while_the_drive_obeys():
    for power in ("power", "mode"):
        own = OwnFeelModel()
        run(f'changes = [{{at = 0.1, {power} = "off"}}]', controller=own)
        assert len(own.inputs) == 250


@pytest.mark.parametrize("seed", range(5))
def test_the_port_knows_the_controllers_record_by_name(seed):
    """However the record is laid out, a loop sees what the PLC measured, and its answer gets where it belongs."""

    def shuffled(kind):
        fields = [(name, kind.fields[name][0]) for name in kind.names] + [("more", np.float64)]
        return np.dtype([fields[k] for k in np.random.default_rng(seed).permutation(len(fields))])

    class Remembers:
        def step(self, inputs):
            self.inputs = inputs
            return Command(0.1, 0.2, 0.3, 0.4)

    def failed(what, error):
        raise AssertionError(what) from error

    measured = {"force": 1.0, "torque": 2.0, "angle": 3.0, "velocity": 4.0}
    asked = {"set_angle": 0.1, "set_velocity": 0.2, "set_acceleration": 0.3, "set_torque": 0.4}
    state = np.zeros(1, [("plc", shuffled(plc.STATE)), ("feel", shuffled(feel.STATE))])
    for name, value in measured.items():
        state["plc"][name] = value
    loop = Remembers()
    asking = outer_loop.Asking([None, loop], [np.zeros(1, STATE), state], 5e-5, failed)
    assert ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_int64)(asking.ask.address)(2 * 800 + 1) == 0
    assert loop.inputs._asdict() == {"time": pytest.approx(0.04), **measured}
    written = {name: float(state["plc"][name][0]) for name in state["plc"].dtype.names}
    assert {name: value for name, value in written.items() if value} == measured | asked
    words = validity.numbers(state["feel"].dtype, {})
    written = {n.name: float(state["feel"].view(np.float64)[n.word]) for n in words}
    assert {name: value for name, value in written.items() if value} == {"angle": 0.1, "velocity": 0.2, "torque": 2.0}


def test_a_loop_that_failed_is_not_blamed_for_what_comes_after_a_reset():
    bench = Bench(Parameters(), controller=Fails(raises))
    list(bench_until_failure(bench))
    assert isinstance(bench.failure, ControllerError)
    bench.reset()
    bench.start()
    bench.plant.qvel[0] = math.nan
    bench.advance(hold(8))
    assert isinstance(bench.failure, DivergedError)


def bench_until_failure(bench):
    bench.start()
    while bench.failure is None:
        yield bench.advance(hold(2000))


def test_a_plain_tuple_is_a_command():
    class Plain:
        def step(self, inputs):
            return 0.01, 0.0

    assert run(controller=Plain())["/feel.angle"][-1] == 0.01


class Fails:
    def __init__(self, how):
        self.how = how

    def step(self, inputs):
        if inputs.time < 0.25:
            return Command(0.0)
        return self.how()


def raises():
    raise KeyError("no\nsuch table")


@pytest.mark.parametrize(
    ("how", "message"),
    [
        (raises, "failed at t = 0.2500 s: KeyError: "),
        (lambda: Command(math.nan), "returned Command(angle=nan"),
        (lambda: Command(0.0, torque=math.inf), "returned Command(angle=0.0"),
        (lambda: None, "returned None at t = 0.2500 s; a Command of finite numbers is valid: angle, velocity"),
        (lambda: 0.1, "returned 0.1"),
        (lambda: "abc", "returned 'abc'"),
        (lambda: (), "returned ()"),
        (lambda: (1, 2, 3, 4, 5), "returned (1, 2, 3, 4, 5)"),
    ],
)
def test_a_failing_loop_ends_the_run_and_leaves_what_was(how, message):
    r = run(controller=Fails(how), duration=0.5)
    assert isinstance(r.error, ControllerError)
    assert r.error.exit_code == 5
    text = str(r.error)
    assert text.startswith("Fails.step ")
    assert message in text
    assert "\n" not in text
    assert len(r["/column.angle"]) == 5000  # all until 0.25 s
    for topic in TOPICS:
        assert len(r[f"{topic.path}.{topic.names[0]}"]) == 5000 // topic.ticks
    assert [(e.level, e.message) for e in r.events] == [("error", text)]


def test_a_loop_that_fails_at_once_still_leaves_its_event():
    class Never:
        def step(self, inputs):
            raise ValueError("no")

    r = run(controller=Never())
    assert isinstance(r.error, ControllerError)
    assert len(r["/column.angle"]) == 0
    assert len(r.events) == 1


def test_something_without_a_step_is_refused():
    with pytest.raises(InputError, match=r"object has no method step\(inputs\)"):
        Bench(Parameters(), controller=object())


# --- a run that leaves all bounds ------------------------------------------------------------------------------------


def let_any_stiffness_in(monkeypatch):
    for place in ("scenario.scenario", "step_limit"):
        monkeypatch.setattr(f"cls_bench.{place}.unstable_parameter", lambda *_: None)


def absurd(parameters):
    stage = parameters.gearbox.stage1.model_copy(update={"stiffness": 1e15})
    return parameters.model_copy(update={"gearbox": parameters.gearbox.model_copy(update={"stage1": stage})})


@pytest.mark.parametrize("stiffness", ["1e9", "1e15"])
def test_a_diverging_run_says_when_and_what(tmp_path, monkeypatch, stiffness):
    """A mesh far too stiff for the step, let in for once: the numbers explode, and MuJoCo must not start anew."""
    monkeypatch.chdir(tmp_path)
    let_any_stiffness_in(monkeypatch)
    if stiffness == "1e15":  # beyond the parameter's bounds
        start = Scenario.parameters_at_start
        monkeypatch.setattr(Scenario, "parameters_at_start", lambda scenario: absurd(start(scenario)))
    r = run(SWAY, duration=0.5, set=["gearbox.stage1.stiffness=1e9"])
    error = r.error
    assert isinstance(error, DivergedError)
    assert error.exit_code == 3
    assert 0.0 < error.time < 0.5
    assert error.cause.startswith("velocity of joint ")
    assert f"t = {error.time:.4f} s" in str(error)
    assert error.cause in str(error)
    assert len(r["/column.angle"]) == round(error.time / 5e-5)
    assert all(np.isfinite(values).all() for values in r.signals.values())
    assert (r.events[-1].level, r.events[-1].message) == ("error", str(error))
    if stiffness == "1e15":  # from sound to absurd in one step, so that MuJoCo itself warns
        warning = r.events[-2]
        assert (warning.level, warning.source) == ("warning", "simulation")
        assert "QACC" in warning.message
        assert warning.time == pytest.approx(error.time, abs=1e-3)
    assert not list(tmp_path.iterdir())  # MuJoCo leaves no log file of its own


def test_warnings_go_to_the_bench_whose_thread_they_come_from(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    let_any_stiffness_in(monkeypatch)
    start = Scenario.parameters_at_start

    def chosen(scenario):
        return absurd(start(scenario)) if scenario.seed else start(scenario)

    monkeypatch.setattr(Scenario, "parameters_at_start", chosen)
    with ThreadPoolExecutor(2) as pool:
        sound, wild = pool.map(lambda seed: run(SWAY, duration=0.5, seed=seed), (0, 1))
    assert [e.level for e in sound.events if e.source == "simulation"] == []
    assert [e.level for e in wild.events if e.source == "simulation"] == ["warning", "error"]
    assert not list(tmp_path.iterdir())


def test_ctrl_c_in_a_users_loop_passes_through():
    class Interrupted:
        def step(self, inputs):
            if inputs.time >= 0.01:
                signal.raise_signal(signal.SIGINT)
            return Command(0.0)

    scenario = parse_scenario('title = "test"\nduration = 0.2')
    bench = Bench(scenario.parameters_at_start(), controller=Interrupted())
    with pytest.raises(KeyboardInterrupt):
        list(scripted.run(bench, scenario))
    assert bench.time == pytest.approx(0.01)
    assert isinstance(bench.failure, KeyboardInterrupt)
