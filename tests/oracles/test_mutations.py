"""A wrong plant behind the verification's back makes the right rows fall short, and leaves the others alone."""

from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
import pytest

from cls_bench.compiled import compiled, mj_step
from cls_bench.parameters import Parameters
from cls_bench.plant import mechanism
from cls_bench.plant import model as plant_model
from cls_bench.verification import (
    Row,
    axes,
    backlash,
    four_bar,
    gear,
    limb,
    linearisation,
    load_cell,
    motor,
    outer_loop,
    stiction,
    subject,
    verify,
    whole_plant,
)
from cls_bench.verification.runner import Case
from cls_bench.verification.subject import Subject


def scaled(p: Parameters, key: str, factor: float) -> Parameters:
    def changed(section: Any, path: list[str]) -> Any:
        inner = getattr(section, path[0])
        if len(path) == 1:
            return section.model_copy(update={path[0]: type(inner)(inner * factor)})
        return section.model_copy(update={path[0]: changed(inner, path[1:])})

    return changed(p, key.split("."))


def moved(*names: str) -> Case:
    """The case of the whole plant, of these rigs alone."""

    def case(of: Subject) -> Iterator[Row]:
        yield from whole_plant.agree_on(of, names)

    return case


def in_mujoco(*names: str) -> Case:
    """The case of MuJoCo's own elements, of these rigs alone."""

    def case(of: Subject) -> Iterator[Row]:
        yield from whole_plant.agree_in_mujoco(of, names)

    return case


class Mutation(NamedTuple):
    """A parameter, what it is multiplied by, and which rows of which cases have to notice (a part of their name)."""

    key: str
    factor: float
    cases: tuple[Case, ...]
    short: tuple[str, ...]
    """in every row with one of these in it"""
    sound: tuple[str, ...] = ()
    """in no row with one of these in it"""


ANGLE, TORQUE = "column angle", "motor torque"

MUTATIONS = (
    # linkage
    Mutation("linkage.arm", 1.1, (linearisation.frequency_response, limb.resonance),
             ("gain at 5 Hz", "gain at 100 Hz", "resonance 1", "worst deviation"), ("two-mass",)),
    Mutation("linkage.crank", 1.1, (linearisation.frequency_response, moved("thesis")),
             ("worst deviation in gain", "resonance 1", ANGLE, TORQUE)),
    Mutation("linkage.crank_angle", 1.02, (four_bar.free, moved("tilted four-bar", "motor on the column")),
             ("tilted, swing", "tilted four-bar, step 50 µs: worst", "rod below both axes, swing"),
             ("upright", "motor on the column")),
    Mutation("linkage.rod_angle", 1.05, (four_bar.free, moved("tilted four-bar")),
             ("tilted, swing", "tilted four-bar", "short and heavy rod, swing"), ("upright",)),
    Mutation("linkage.rod_column_mass", 1.2, (four_bar.free, moved("tilted four-bar", "motor on the column")),
             ("change of its energy", ", swing of", "tilted four-bar, step 50 µs: deviation"),
             ("motor on the column",)),
    Mutation("linkage.rod_end_mass", 1.2, (linearisation.frequency_response, load_cell.ringing),
             ("worst deviation in phase", "rod end on the cell"), ("gain at 5 Hz",)),
    # stages
    Mutation("gearbox.stage1.backlash", 0.5, (backlash.dead_zone, backlash.gear_demo, backlash.stop_block_demo),
             ("dead zone of stage 1", "dead zone of a worm", "gear stage: time at which the gap"),
             ("stage 2", "stop blocks", "stiffness")),
    Mutation("gearbox.stage2.stiffness", 0.9, (backlash.dead_zone, linearisation.frequency_response),
             ("stiffness of stage 2", "resonance 1"), ("dead zone", "stiffness of stage 1", "gain at 5 Hz")),
    Mutation("gearbox.stage1.stiffness", 0.9, (linearisation.rigs_in_frequency, backlash.dead_zone),
             ("belt: resonance 1", "belt: resonance 2", "worm: resonance 1", "stiffness of a worm"),
             ("direct drive", "motor on the column", "stage 2")),
    Mutation("gearbox.stage3.stiffness", 0.9, (linearisation.rigs_in_frequency, backlash.dead_zone),
             ("three stages: resonance 1", "stiffness of stage 3"),
             ("one stage", "belt", "worm", "stage 1", "stage 2")),
    Mutation("gearbox.stage3.ratio", 1.02, (gear.efficiency_of_rigs, moved("three stages", "belt")),
             ("three stages, step",), ("belt", "one stage", "worm")),
    Mutation("gearbox.stage1.efficiency", 0.95, (gear.efficiency, gear.lossy_gear_demo, gear.efficiency_of_rigs),
             ("motor drives at 1 N", "motor drives at 4 N", "load angle while it sticks again"), ("drives the motor",)),
    Mutation("gearbox.stage1.backdrive_efficiency", 0.95, (gear.efficiency, gear.efficiency_of_rigs,
                                                           gear.self_locking, gear.lossy_gear_demo),
             ("at the crank drives the motor", "motor torque that lowers it", "acceleration of the crank",
              "load angle at 0.5 s"), ("motor drives at", "speed of the motor shaft")),
    Mutation("gearbox.stage1.backdrive_efficiency", -1.0, (gear.self_locking,),
             ("speed of the motor shaft", "acceleration of the crank")),
    Mutation("gearbox.stage1.drag_ratio", 1.2, (gear.efficiency_of_rigs, gear.drag_per_direction,
                                                moved("one stage", "direct drive")),
             ("one stage: efficiency, 40 N·m at the crank", "drag per direction: load angle",
              "one stage, step 50 µs: deviation of the motor torque"),
             ("motor drives at", "rigid gear without drag", "direct drive")),
    Mutation("gearbox.stage1.transmission_error", 1.5, (moved("one stage", "direct drive"),),
             ("one stage, step 50 µs: deviation of the motor torque",), ("direct drive",)),
    Mutation("gearbox.stage1.transmission_error", 1.5, (in_mujoco("one stage", "direct drive"),),
             ("one stage as MJCF, step 50 µs: deviation of the motor torque",), ("direct drive",)),
    Mutation("linkage.rod_column_mass", 1.2, (in_mujoco("tilted four-bar", "motor on the column"),),
             ("tilted four-bar as MJCF, step 50 µs: deviation",), ("motor on the column",)),
    Mutation("gearbox.stage1.ripple", 1.3, (moved("one stage", "belt"),),
             ("one stage, step 50 µs: deviation of the motor torque",), ("belt",)),
    Mutation("gearbox.breakaway_ratio", 1.1, (stiction.breakaway, stiction.stick_slip, stiction.creep),
             ("gear mesh, forward", "gear mesh, back", "stick-slip: period"), ("column bearing", "creep")),
    # motor
    Mutation("motor.torque_constant", 1.05, (motor.envelope, motor.current_step, motor.acts_when_it_flows),
             ("peak current", "stall current", "no-load speed", "time by which"), ("10 V",)),
    Mutation("motor.inductance", 1.5, (motor.current_step, motor.envelope),
             ("current 0.2 ms", "current 1 ms"), ("torque held", "no-load")),
    Mutation("motor.rotor_inertia", 1.1, (motor.power_balance, linearisation.frequency_response),
             ("kinetic energy", "worst deviation in gain"), ("work in a run-up",)),
    Mutation("motor.cogging_amplitude", 1.5, (moved("direct drive", "thesis"),),
             ("direct drive, step 50 µs: deviation of the motor torque",), ("thesis",)),
    # load cell
    Mutation("load_cell.stiffness", 0.8, (load_cell.static, load_cell.ringing, load_cell.filter_step,
                                          load_cell.torque_cell),
             ("give under", "rod end on the cell", "column on the cell", "twist"), ("reading", "resolution", "filter")),
    Mutation("load_cell.filter_bandwidth", 0.5, (load_cell.static, load_cell.ringing, load_cell.filter_step),
             ("Hz filter",), ("reading", "give", "rod end")),
    Mutation("load_cell.capacity", 1.1, (load_cell.static,),
             ("reading at rest", "resolution"), ("give", "800 N")),
    # limb and column
    Mutation("limb.mass", 1.2, (limb.resonance, limb.rigid, linearisation.frequency_response),
             ("squeeze 0", "squeeze 0.5", "one rigid body"), ("gain", "phase")),
    Mutation("column.inertia", 1.1, (linearisation.frequency_response, limb.resonance, motor.power_balance),
             ("worst deviation", "resonance 1", "two-mass resonance at squeeze 1"), ("energy", "work")),
    Mutation("column.coulomb_friction", 0.8, (stiction.breakaway, stiction.creep),
             ("breakaway torque of the column bearing", "creep of the column bearing"), ("gear mesh",)),
    Mutation("column.stop_stiffness", 1.2, (backlash.stop_block_demo, backlash.dead_zone),
             ("stop blocks: time", "stop blocks: speed"), ("stage",)),
    # whole bench
    Mutation("load_cell.filter_bandwidth", 0.5, (outer_loop.growing,), ("growth rate", "neither grows nor decays"),
             ("frequency",)),
    Mutation("motor.inductance", 1.5, (outer_loop.growing,), ("growth rate", "neither grows nor decays")),
)  # fmt: skip


def judge(rows: list[Row], short: tuple[str, ...], sound: tuple[str, ...] = ()) -> None:
    passed = {row.quantity: row.passed for row in rows}
    assert len(passed) == len(rows)
    for part in short:
        concerned = [name for name in passed if part in name]
        assert concerned, part
        assert not [name for name in concerned if passed[name]], "these should have fallen short"
    for part in sound:
        concerned = [name for name in passed if part in name]
        assert concerned, part
        assert not [name for name in concerned if not passed[name]], "these have nothing to do with it"


@pytest.mark.parametrize("mutation", MUTATIONS, ids=lambda m: f"{m.key}×{m.factor:g}")
def test_wrong_parameter_is_noticed(mutation: Mutation) -> None:
    rows = verify(cases=mutation.cases, alter=lambda p: scaled(p, mutation.key, mutation.factor), workers=1)
    judge(rows, mutation.short, mutation.sound)


def test_nothing_wrong_nothing_noticed() -> None:
    rows = verify(
        cases=(load_cell.static, motor.envelope, moved("one stage", "belt", "tilted four-bar")),
        alter=lambda p: scaled(p, "limb.mass", 1.0), workers=1,
    )  # fmt: skip
    assert all(row.passed for row in rows)


# --- wrong laws ---


def acting(torque: Callable[[Any, float, float], float]) -> Any:
    """The plant's laws, but the motor pulls with the current that ``torque`` makes of (record, voltage, speed)."""

    def act(plant: Any, truth: Any, connected: bool, voltage: float, *hand: Any) -> None:
        mechanism.act(plant, truth, connected, voltage, *hand)
        constant = truth.parameters.motor.torque_constant
        wrong = constant * torque(truth, voltage, plant.qvel[truth.joints.motor])
        plant.force[truth.joints.motor] += wrong - truth.body.motor_torque
        truth.body.motor_torque = wrong

    return SimpleNamespace(arrive=mechanism.arrive, act=act, configure=mechanism.configure)


def early(truth: Any, voltage: float, speed: float) -> float:
    """The current at the end of the step."""
    m = truth.parameters.motor
    final = (voltage - m.torque_constant * speed) / m.resistance
    return float(final + (truth.body.current - final) * truth.mechanism.current_decay)


def late() -> Callable[[Any, float, float], float]:
    """The current of the step before."""
    before = [0.0]

    def torque(truth: Any, voltage: float, speed: float) -> float:
        before.append(float(truth.body.current))
        return before.pop(0)

    return torque


@compiled
def step(model: Any, data: Any) -> None:
    mj_step(model, data)


def rows_with(law: Callable[[Any, float, float], float], monkeypatch: pytest.MonkeyPatch) -> list[Row]:
    """Rows of the motor whose current ``law`` says; stepped by a loop in plain Python, as ``law`` is."""
    loop = getattr(subject._run, "py_func", subject._run)

    def run(plant: Any, truths: Any, *rest: Any) -> None:
        loop(plant, truths.view(np.recarray), *rest)

    monkeypatch.setattr(subject, "mechanism", acting(law))
    monkeypatch.setattr(subject, "_run", run)
    monkeypatch.setattr(subject, "mj_step", step)
    return verify(cases=(motor.acts_when_it_flows, motor.current_step), workers=1)


@pytest.mark.parametrize("wrong", [early, late()], ids=["early", "late"])
def test_current_that_acts_a_step_off_is_noticed(wrong: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    judge(rows_with(wrong, monkeypatch), ("time by which the speed lags",), ("10 V",))


def test_current_that_acts_when_it_flows_is_sound(monkeypatch: pytest.MonkeyPatch) -> None:
    rows = rows_with(lambda truth, voltage, speed: float(truth.body.current), monkeypatch)
    assert all(row.passed for row in rows)


@pytest.mark.parametrize("joint", ["limb", "column"])
def test_axis_that_sees_another_is_noticed(joint: str, monkeypatch: pytest.MonkeyPatch) -> None:
    find = plant_model.find_joints

    def wrong(model: Any, axis: str, stages: int, joints: Any) -> None:
        find(model, axis, stages, joints)
        if axis == "roll" and model.njnt > stages + 3:
            joints[joint] = model.joint(f"pitch/{joint}").qposadr[0]

    monkeypatch.setattr(plant_model, "find_joints", wrong)
    rows = verify(cases=(axes.apart,), workers=1)
    judge(rows, ("three alike", "two stages, one, and none"))
