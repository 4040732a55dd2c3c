"""Parameters: sources and units, bounds, the compiled record, and the table in models/README.md."""

import math
import typing
from typing import Any

import pytest
from pydantic import ValidationError

from cls_bench.errors import InputError
from cls_bench.parameters import _SHIPPED, Parameters, Section, leaves, record_of
from cls_bench.parameters.page import table, with_table
from cls_bench.parameters.plant import mesh_efficiency
from cls_bench.resources import model_folder
from cls_bench.scenario import parse_scenario
from tests.running import parameters

LEAVES = list(leaves(Parameters()))


@pytest.mark.parametrize(("key", "about"), [(key, about) for key, _, about in LEAVES], ids=[key for key, *_ in LEAVES])
def test_every_parameter_says_what_it_is_and_where_it_comes_from(key, about):
    assert about["unit"]
    assert about["meaning"]
    source = about["source"]
    assert source, f"{key} has no source"
    assert source.removeprefix("assumed").strip(" :"), f"{key} is assumed without a reason"


def choices(section: Section, key: str) -> tuple[Any, ...]:
    """The choices of a parameter that has them."""
    *parents, name = key.split(".")
    for parent in parents:
        section = getattr(section, parent)
    return typing.get_args(type(section).model_fields[name].annotation)


def test_the_record_holds_every_value():
    """What compiled code reads is what the user set; a choice is its place among them."""
    p = parameters({
        "plc.outer_loop": "velocity", "column.mass": 0.8, "gearbox.stage2.ratio": 4.0, "gearbox.stage1.kind": "worm",
    })  # fmt: skip
    record, seen = record_of(p), []
    for key, value, _ in leaves(p):
        found = record
        for name in key.split("."):
            found = getattr(found, name)
        if isinstance(value, str):
            seen.append(value)
            value = choices(p, key).index(value)  # noqa: PLW2901
        assert found == value, key
    assert {"velocity", "worm", "planetary", "whole"} <= set(seen)


@pytest.mark.parametrize(
    ("section", "values", "says"),
    [
        ("column", {"inertia": -1.0}, "greater than or equal to 0.00001"),
        ("column", {"mass": 3.0}, "inertia must exceed mass × mass_height²"),
        ("column", {"switch_angle": 0.3}, "must grow in this order"),
        ("linkage", {"rod_end_mass": 0.4}, "must not be more"),
        ("gearbox", {"stages": 4}, "less than or equal to 3"),
        ("gearbox", {"stage1": {"efficiency": 1.01}}, "less than or equal to 1"),
        ("gearbox", {"stage1": {"kind": "chain"}}, "'planetary', 'spur', 'belt' or 'worm'"),
        ("gearbox", {"stage2": {"backdrive_efficiency": -11.0}}, "greater than or equal to -10"),
        ("feel", {"aft_limit": {"angle": 0.5}}, "aft_limit.angle must not exceed"),
        ("motor", {"resistance": math.nan}, "finite number"),
        ("motor", {"resistance": "6"}, "valid number"),
        ("motor", {"resistence": 6.0}, "not permitted"),
        ("encoder", {"counts": 4096.5}, "valid integer"),
    ],
)
def test_impossible_values_are_refused(section, values, says):
    whole = getattr(Parameters(), section).model_dump()
    for name, value in values.items():
        whole[name] = {**whole[name], **value} if isinstance(value, dict) else value
    with pytest.raises(ValidationError) as refused:
        Parameters.model_validate({section: whole})
    assert says in str(refused.value)


def test_values_are_checked_on_assignment_too():
    p = Parameters()
    with pytest.raises(ValidationError):
        p.motor.resistance = -1.0
    assert p.motor.resistance == 6.0


@pytest.mark.parametrize("overall", [0.6, 0.7, 0.85, 0.9])
def test_mesh_efficiency_gives_the_overall_one(overall):
    """Stages one after the other, written out: each takes its drag, then its mesh loss."""
    for drags, ratios in (((0.055, 0.125), (5.0, 5.0)), ((0.02,), (10.0,)), ((0.01, 0.02, 0.05), (2.0, 3.0, 4.5))):
        torque = 1.0
        for drag, ratio in zip(drags, ratios, strict=True):
            torque = (torque - drag) * mesh_efficiency(overall, 1.0, drags, ratios) * ratio
        assert torque == pytest.approx(overall * math.prod(ratios))
    with pytest.raises(ValueError, match=r"efficiency 0\.9 cannot be reached: the drag alone costs more at 0\.1 N·m"):
        mesh_efficiency(0.9, 0.1, (0.055, 0.125), (5.0, 5.0))


def test_the_thesis_gearbox_has_85_percent_at_stall_torque():
    torque = 1.0
    for stage in Parameters().gearbox.in_use:
        torque = (torque - stage.drag) * stage.efficiency * stage.ratio
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
    low, high = about["valid"].split(", ")
    assert low[0] in ">≥"
    assert high[0] in "<≤"
    assert float(low.strip(">≥ ")) <= value <= float(high.strip("<≤ "))
    section, _, name = key.rpartition(".")
    for wrong in (float(low.strip(">≥ ")) - 1.0, 2.0 * float(high.strip("<≤ ")) + 1.0, math.inf, math.nan):
        with pytest.raises(InputError, match=f"parameters.{key}: .* is not valid; give a"):
            parse_scenario('title = "t"\nduration = 1.0', set=[f"{section}.{name}={wrong!r}"])


@pytest.mark.parametrize(
    ("overrides", "says"),
    [
        (["linkage.rod=0.02"], "cannot be closed over ±24°|dead point"),
        (["linkage.crank=0.05"], "cannot be closed|dead point"),
        (["column.stop_angle=0.59", "linkage.crank=0.09"], "dead point|cannot be closed|do not follow"),
        (["linkage.rod_end_mass=0.376"], "rod_end_mass is a part of rod_column_mass"),
        (["drive.position_integral_time=1e-9"], "position_integral_time: give 0"),
    ],
)
def test_what_cannot_be_built_is_refused_by_validation(overrides, says):
    with pytest.raises(InputError, match=says):
        parse_scenario('title = "t"\nduration = 1.0', set=overrides)


def test_the_shipped_linkage_is_the_one_that_is_not_looked_at():
    p = Parameters()
    assert (p.linkage.four_bar, p.nameplate.reach, p.plc.polynomial_degree) == _SHIPPED
    assert p.nameplate.four_bar == p.linkage.four_bar
    assert p.with_nameplate().nameplate.reach == p.nameplate.reach
