"""What drive and PLC know: nameplate and samples. No true value of the plant reaches them, and none of theirs it."""

import ast
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal, get_args, get_origin, get_type_hints

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from cls_bench import control
from cls_bench.axis import AXIS, set_parameters
from cls_bench.bench import Bench
from cls_bench.control.state import configure
from cls_bench.parameters import CONTROL, PLANT, ControlParameters, Parameters, leaves
from cls_bench.plant import model as plant_model
from cls_bench.plant.sensors import SAMPLES
from tests.running import advanced, collected, parameters

BASE = parameters({
    "gearbox.stages": 3,
    "feel.detents": {"place": [0.1], "width": [0.05], "torque": [1.0], "profile": [0.9, 0.1, -0.9]},
    "feel.surface": {"control_angle": [-0.3, 0.3], "deflection": [-0.3, 0.4]},
})  # fmt: skip
"""The thesis's rig with a third stage, a detent and a gearing, so that every parameter means something."""

KEYS = {key: value for key, value, _ in leaves(BASE)}
OF_PLANT = [key for key in KEYS if key.partition(".")[0] in PLANT]
OF_CONTROL = [key for key in KEYS if key.partition(".")[0] in CONTROL]


def candidates(key: str) -> Iterator[Any]:
    """Other values that a parameter might have."""
    value, section = KEYS[key], type(BASE)
    for name in key.split("."):
        kind: Any = section.model_fields[name].annotation
        section = kind
    if get_origin(kind) is Literal:
        yield from (choice for choice in get_args(kind) if choice != value)
    elif kind is bool:
        yield not value
    elif isinstance(value, tuple):
        yield (0.99 * value[0], *value[1:])
    elif kind is int:
        yield from (value + 1, value - 1)
    else:
        yield from (value * 1.01, value * 0.99, 0.01, 1e-3, 0.5, -0.01, math.nextafter(value, math.inf))


def with_value(key: str, value: Any) -> Parameters:
    table = BASE.model_dump()
    *parents, last = key.split(".")
    inner = table
    for parent in parents:
        inner = inner[parent]
    inner[last] = value
    return Parameters.model_validate(table)


def changed(key: str) -> Parameters:
    """The base with another legal value of that parameter alone."""
    for value in candidates(key):
        if value == KEYS[key]:
            continue
        try:
            p = with_value(key, value)
        except ValidationError:
            continue
        differs = [k for k, new, _ in leaves(p) if new != KEYS[k]]
        assert differs == [key]
        return p
    raise AssertionError(f"no other value of {key} is legal")


def record(p: Parameters) -> Any:
    """The axis as the bench fills it in."""
    axis = np.zeros(1, AXIS).view(np.recarray)[0]
    set_parameters(axis, p)
    return axis


def model(p: Parameters) -> bytes:
    """What MuJoCo is given."""
    built = plant_model.build({"": p})
    content = np.zeros(mujoco.mj_sizeModel(built), np.uint8)
    mujoco.mj_saveModel(built, None, content)
    return content.tobytes()


FRESH = record(BASE)


def test_every_key_belongs_to_a_side():
    apart = {key.partition(".")[0] for key in KEYS} - {*PLANT, *CONTROL}
    assert apart == {"rates", "simulation"}
    assert len(OF_PLANT) > 90 and len(OF_CONTROL) > 50


@pytest.mark.parametrize("key", OF_PLANT)
def test_a_plant_parameter_changes_no_constant_of_the_controller(key):
    p = changed(key)
    axis = record(p)
    assert axis.controller.tobytes() == FRESH.controller.tobytes()
    assert axis.truth.parameters.tobytes() != FRESH.truth.parameters.tobytes()


@pytest.mark.parametrize("key", OF_CONTROL)
def test_what_the_controller_believes_changes_nothing_in_the_plant(key):
    p = changed(key)
    axis = record(p)
    assert axis.truth.tobytes() == FRESH.truth.tobytes()
    assert model(p) == model(BASE)
    assert axis.controller.parameters.tobytes() != FRESH.controller.parameters.tobytes()


@pytest.mark.parametrize("key", [key for key in OF_CONTROL if key.startswith("nameplate.")])
def test_every_word_of_the_nameplate_is_read(key):
    """A belief that changes nothing would be none: design or law depends on it."""
    read_by_a_law = {  # straight from the record, without a design
        "gear_ratio", "torque_constant", "thermal_time_constant", "load_inertia", "unbalance", "load_cell_gain",
        "stop_angle", "arm", "arm_angle",
    }  # fmt: skip
    name = key.partition(".")[2]
    designed = record(changed(key)).controller.design.tobytes() != FRESH.controller.design.tobytes()
    assert designed or name in read_by_a_law, f"{key} is read by nothing"


@settings(max_examples=40, deadline=None)
@given(st.dictionaries(st.sampled_from(OF_PLANT), st.floats(0.9, 1.1), min_size=1, max_size=30))
def test_nor_do_many_at_once_on_the_bench(factors):
    """All that drive and PLC hold before the first tick, of benches with wrong plants of any kind."""
    table = BASE.model_dump()
    for key, factor in factors.items():
        *parents, last = key.split(".")
        inner = table
        for parent in parents:
            inner = inner[parent]
        if type(inner[last]) is float:
            inner[last] *= factor
    try:
        p = Parameters.model_validate(table)
    except ValidationError:
        return
    assert Bench(p).axes[0].record.controller.tobytes() == Bench(BASE).axes[0].record.controller.tobytes()


def test_nor_does_a_change_in_mid_run():
    bench = Bench(BASE)
    held = bench.axes[0].record.controller
    before = held.parameters.tobytes(), held.design.tobytes()
    live = {key: about["live"] for key, _, about in leaves(BASE)}
    alive = [key for key in OF_PLANT if live[key]]
    assert len(alive) > 10
    for key in alive:
        bench.change(changed(key))
        assert (held.parameters.tobytes(), held.design.tobytes()) == before, key


def test_samples_are_what_a_drive_and_a_plc_can_measure():
    """Counts of encoder and potentiometer, of the load cell's converter, the drive's own current, two contacts."""
    assert SAMPLES.names == (
        "encoder", "current", "load_cell", "potentiometer", "switch_forward", "switch_aft"
    )  # fmt: skip


def test_a_controller_that_believes_wrongly_measures_wrongly():
    """The gain of the load cell: the plant's is an error of the measurement, the nameplate's one of the belief."""
    def torque(values):
        bench = Bench(parameters(values))
        run = collected(bench, advanced(bench, 0.3, power=False))
        return run["/load_cell.torque"][200:], run["/load_cell.force"]

    base, force = torque({"plc.remove_unbalance": False, "load_cell.noise": 0.0})
    gain = Parameters().nameplate.load_cell_gain
    believed, same = torque(
        {"plc.remove_unbalance": False, "load_cell.noise": 0.0, "nameplate.load_cell_gain": 1.1 * gain}
    )
    shown, same_too = torque({"plc.remove_unbalance": False, "load_cell.noise": 0.0, "load_cell.gain_error": 0.1})
    np.testing.assert_array_equal(force, same)
    np.testing.assert_array_equal(force, same_too)
    assert np.abs(base).max() > 0.1
    np.testing.assert_allclose(believed, 1.1 * base, rtol=1e-12)
    np.testing.assert_allclose(shown, believed, atol=3 * 0.175 * gain)  # within the converter's rounding


def test_no_code_of_control_is_handed_all_parameters():
    """What is not handed over cannot be looked at: control's own design gets what a controller may know."""
    assert get_type_hints(configure)["p"] is ControlParameters
    assert set(ControlParameters.model_fields) == {*CONTROL, "rates"}
    folder = Path(control.__file__).parent
    for path in folder.glob("*.py"):
        names = {node.id for node in ast.walk(ast.parse(path.read_text("utf-8"))) if isinstance(node, ast.Name)}
        assert "Parameters" not in names, path.name
    given = []

    def watched(design, record, p):
        given.append(p)
        configure(design, record, p)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("cls_bench.axis.configure", watched)
        Bench(BASE)
    assert given and all(type(p) is ControlParameters for p in given)
