"""Parameters: sources and units, bounds, the compiled record, and the table in models/README.md."""

import math
import re

import numpy as np
import pytest
from pydantic import ValidationError

from cls_bench.errors import InputError
from cls_bench.kinematics import crank_from_column, crank_ratio, fit_polynomials, polynomial
from cls_bench.parameters import (
    _SHIPPED,
    CONTROL,
    DEG,
    FLATTEST,
    PLANT,
    STEEPEST,
    Column,
    Parameters,
    kind_of,
    leaves,
    memory_of,
    mesh_efficiency,
    record_of,
)
from cls_bench.parameters.page import table, with_table
from cls_bench.resources import model_folder
from cls_bench.scenario import parse_scenario

LEAVES = list(leaves(Parameters()))


def parameters(**sections):
    """Parameters with some values changed: ``parameters(motor={"cogging_amplitude": 0.1})``."""
    whole = Parameters().model_dump()
    for name, values in sections.items():
        for key, value in values.items():
            whole[name][key] = {**whole[name][key], **value} if isinstance(value, dict) else value
    return Parameters.model_validate(whole)


@pytest.mark.parametrize(("key", "about"), [(key, about) for key, _, about in LEAVES], ids=[key for key, *_ in LEAVES])
def test_every_parameter_says_what_it_is_and_where_it_comes_from(key, about):
    assert about["unit"]
    assert about["meaning"]
    source = about["source"]
    assert source, f"{key} has no source"
    assert source.removeprefix("assumed").strip(" :"), f"{key} is assumed without a reason"


def test_the_record_holds_every_value():
    """What compiled code reads is what the user set."""
    p = parameters(
        plc={"outer_loop": "velocity"}, column={"mass": 0.8}, gearbox={"stages": 1, "stage1": {"kind": "worm"}},
        load_cell={"wire": "signal_broken"},
    )  # fmt: skip
    record = record_of(p)
    choices = {
        "plc.outer_loop": 1, "gearbox.stage1.kind": 3, "gearbox.stage2.kind": 0, "gearbox.stage3.kind": 0,
        "load_cell.wire": 2, "linkage.kind": 0, "nameplate.linkage": 0, "feel.bodies": 0, "feel.gust.spectrum": 0,
        "feel.jam.of": 0,
    }  # fmt: skip
    for key, value, _ in leaves(p):
        found = record
        for name in key.split("."):
            found = getattr(found, name)
        if isinstance(value, tuple):
            assert found.count == len(value) and tuple(found["values"][: len(value)]) == value, key
            continue
        assert found == (choices.pop(key) if isinstance(value, str) else value), key
    assert not choices
    assert memory_of(p).dtype == kind_of(Parameters)


def test_each_section_belongs_to_one_side():
    assert not set(PLANT) & set(CONTROL)
    assert {*PLANT, *CONTROL, "rates", "simulation"} == set(Parameters.model_fields)


@pytest.mark.parametrize(
    ("section", "values", "says"),
    [
        ("column", {"inertia": -1.0}, "greater than or equal to 0.00001"),
        ("column", {"mass": 3.0}, "inertia must exceed mass × mass_height²"),
        ("column", {"switch_angle": 0.3}, "must grow in this order"),
        ("linkage", {"rod_end_mass": 0.4}, "must not be more"),
        ("gearbox", {"efficiency": 0.99}, "not permitted"),
        ("gearbox", {"stages": 4}, "less than or equal to 3"),
        ("gearbox", {"stage2": {"efficiency": 1.01}}, "less than or equal to 1"),
        ("gearbox", {"stage2": {"backdrive_efficiency": -11.0}}, "greater than or equal to -10"),
        ("gearbox", {"stage1": {"kind": "cycloid"}}, "Input should be 'planetary', 'spur', 'belt' or 'worm'"),
        ("nameplate", {"gear_ratio": 0.0}, "greater than or equal"),
        ("nameplate", {"rod": 0.02}, "nameplate: crank, rod and arm: the linkage cannot be closed"),
        ("feel", {"aft_limit": {"angle": 0.5}}, "aft_limit.angle must not exceed"),
        ("motor", {"resistance": math.nan}, "finite number"),
        ("motor", {"resistance": "6"}, "valid number"),
        ("motor", {"resistence": 6.0}, "not permitted"),
        ("encoder", {"counts": 4096.5}, "valid integer"),
    ],
)
def test_impossible_values_are_refused(section, values, says):
    with pytest.raises(ValidationError) as refused:
        parameters(**{section: values})
    assert says in str(refused.value)


def test_parameters_are_values_that_do_not_change():
    p = Parameters()
    with pytest.raises(ValidationError, match="frozen"):
        p.motor.resistance = 5.0
    assert p.motor.resistance == 6.0


@pytest.mark.parametrize("overall", [0.6, 0.7, 0.85, 0.9])
@pytest.mark.parametrize(("drags", "ratios"), [
    ((0.055, 0.125), (5.0, 5.0)), ((0.02,), (10.0,)), ((0.01, 0.02, 0.05), (2.0, 3.0, 4.5)),
])  # fmt: skip
def test_mesh_efficiency_gives_the_overall_one_at_rated_torque(overall, drags, ratios):
    """Stages one after the other, written out as losses over the torque that is handed on."""
    loss = 1.0 / mesh_efficiency(overall, 1.0, drags, ratios) - 1.0
    torque = 1.0
    for drag, ratio in zip(drags, ratios, strict=True):
        torque = (torque - drag) / (1 + loss) * ratio
    assert torque == pytest.approx(overall * math.prod(ratios))


def test_an_efficiency_that_drag_alone_forbids_is_refused():
    with pytest.raises(ValueError, match=r"efficiency 0\.99 cannot be reached: the drag alone costs more at 1 N·m"):
        mesh_efficiency(0.99, 1.0, (0.055, 0.125), (5.0, 5.0))


def test_the_default_gearbox_has_the_data_sheets_efficiency():
    """Thesis 3.2.2: 85 % at 1 N·m, from the defaults of the stages themselves."""
    torque = 1.0
    for stage in Parameters().gearbox.in_use:
        torque = (torque - stage.drag) * stage.ratio * stage.efficiency
        assert 1.0 - stage.backdrive_efficiency == pytest.approx(1.5 * (1.0 / stage.efficiency - 1.0))
    assert torque == pytest.approx(0.85 * 25.0)


def test_the_table_in_the_models_readme_is_up_to_date():
    """If this fails: python -m cls_bench.parameters.page models/README.md"""
    page = (model_folder() / "README.md").read_text(encoding="utf-8")
    assert with_table(page) == page
    assert table() in page
    assert all(f"`{key}`" in page for key, *_ in LEAVES)


@pytest.mark.parametrize(("key", "value", "about"), LEAVES, ids=[key for key, *_ in LEAVES])
def test_every_number_has_two_bounds_and_the_default_lies_within(key, value, about):
    if isinstance(value, bool | str):
        return
    bounds = about["valid"]
    if isinstance(value, tuple):
        assert value == () and bounds.startswith(f"up to {about['most']} numbers, each ")
        bounds = bounds.partition("each ")[2]
    low, high = bounds.split(", ")
    assert low[0] in ">≥"
    assert high[0] in "<≤"
    least, most = float(low.strip(">≥ ")), float(high.strip("<≤ "))
    if isinstance(value, tuple):
        for wrong in (least - 1.0, 2.0 * most + 1.0, math.inf, math.nan):
            with pytest.raises(InputError, match=f"parameters.{re.escape(key)}: .* is not valid; "):
                parse_scenario('title = "t"\nduration = 1.0', set=[f"{key}=[{wrong!r}]"])
        return
    assert least <= value <= most
    for wrong in (float(low.strip(">≥ ")) - 1.0, 2.0 * float(high.strip("<≤ ")) + 1.0, math.inf, math.nan):
        with pytest.raises(InputError, match=f"parameters.{re.escape(key)}: .* is not valid; give a"):
            parse_scenario('title = "t"\nduration = 1.0', set=[f"{key}={wrong!r}"])


@pytest.mark.parametrize(
    ("overrides", "says"),
    [
        (["linkage.rod=0.02"], "cannot be closed over ±24°|dead point"),
        (["linkage.crank=0.05"], "cannot be closed|dead point"),
        (["column.stop_angle=0.59", "linkage.crank=0.09"], "dead point|cannot be closed|do not follow"),
        (["linkage.rod_end_mass=0.3755001"], "rod_end_mass is a part of rod_column_mass"),
        (["drive.position_integral_time=1e-9"], "position_integral_time: give 0"),
    ],
)
def test_what_cannot_be_built_is_refused_by_validation(overrides, says):
    with pytest.raises(InputError, match=says):
        parse_scenario('title = "t"\nduration = 1.0', set=overrides)


def test_the_shipped_linkage_is_the_one_that_is_not_looked_at():
    """It is taken as good without compiling the kinematics; so it must be good."""
    p = Parameters()
    plate, column = p.nameplate, p.column
    assert (plate.four_bar, plate.reach, p.plc.polynomial_degree) == _SHIPPED
    assert (p.linkage.four_bar, max(column.switch_angle + 3.0 * DEG, column.stop_angle)) == _SHIPPED[:2]
    bar, reach, degree = _SHIPPED
    fitted = fit_polynomials(bar, reach, degree)
    for angle in np.linspace(-reach, reach, 41):
        crank = crank_from_column(bar, angle)
        ratio = crank_ratio(bar, crank, angle)
        assert FLATTEST < ratio < STEEPEST
        assert polynomial(fitted.ratio, angle) == pytest.approx(ratio, rel=1e-2)
        assert 1.0 / polynomial(fitted.inverse_ratio, crank) == pytest.approx(ratio, rel=1e-2)


# --- the nameplate ----------------------------------------------------------------------------------------------------


def test_the_delivered_nameplate_is_what_the_thesis_says():
    """Table 3.1, 3.2 and 3.3, written out; the load cell's 50 kg to both sides over 24 bit."""
    plate = Parameters().nameplate
    assert (plate.gear_ratio, plate.crank, plate.rod, plate.arm) == (25.0, 0.100, 0.209, 0.175)
    assert (plate.torque_constant, plate.load_inertia) == (0.2944, 9.27e-5)
    assert plate.load_cell_gain == pytest.approx(2 * 50.0 * 9.80665 / 2**24)
    assert plate.reach == pytest.approx(24.0 * DEG)


def test_a_rigs_nameplate_follows_from_its_data_sheets():
    """One stage, a shaft in place of the linkage: inertia at the motor written out."""
    p = parameters(
        gearbox={"stages": 1, "stage1": {"ratio": 10.0, "inertia": 2e-4}, "input_inertia": 1e-5},
        linkage={"kind": "none", "arm": 0.2, "crank_inertia": 3e-4}, motor={"rotor_inertia": 6e-5},
        load_cell={"capacity": 100.0, "adc_bits": 16},
    )  # fmt: skip
    plate = p.with_nameplate().nameplate
    assert (plate.gear_ratio, plate.linkage, plate.arm) == (10.0, "none", 0.2)
    assert plate.load_inertia == pytest.approx(6e-5 + 1e-5 + (2e-4 + 3e-4 + Column().inertia) / 100.0)
    assert plate.load_cell_gain == pytest.approx(200.0 / 2**16)
    a = Column().travel
    fitted = 3.0 * (math.sin(a) - a * math.cos(a)) / a**3
    assert plate.unbalance == pytest.approx(9.80665 * 0.9 * 0.12 * fitted)
    assert p.nameplate == Parameters().nameplate  # until asked, the controller believes what it did


# --- one way to change a key ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("key", "value"), [
    ("gearbox.stage3.ratio", 3.0), ("linkage.rod", 0.21), ("linkage.rod_end_mass", 0.1),
])  # fmt: skip
def test_what_a_rig_has_not_cannot_be_set(key, value):
    text = 'title = "t"\nduration = 1.0'
    here = ['linkage.kind="none"'] if key.startswith("linkage") else []
    with pytest.raises(InputError, match=f"{re.escape(key)}.*there is no"):
        parse_scenario(text, set=[*here, f"{key}={value}"])


def test_a_recording_of_an_earlier_version_is_read_and_a_new_scenario_learns_the_name():
    text = (
        'title = "t"\nduration = 1.0\n[parameters.feel]\nshaker_torque = 0.5\ncentering_breakout = 0.2\n'
        "[[changes]]\nat = 0.5\nparameters.feel.autopilot_torque = 2.0\n"
    )
    old = parse_scenario(text, sample_files={}, set=["feel.disturbance_torque=1.0"])
    feel, later = old.parameters_at(0.0).feel, old.parameters_at(0.6).feel
    assert (feel.shaker.torque, feel.centering.breakout, feel.disturbance.torque) == (0.5, 0.2, 1.0)
    assert (feel.autopilot.torque, later.autopilot.torque) == (0.0, 2.0)
    with pytest.raises(InputError, match=r"feel.shaker_torque: is called feel.shaker.torque now"):
        parse_scenario(text)
