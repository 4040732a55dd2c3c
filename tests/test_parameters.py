"""Parameters: sources and units, bounds, the compiled record, and the table in models/README.md."""

import math

import pytest
from pydantic import ValidationError

from cls_bench.errors import InputError
from cls_bench.parameters import _SHIPPED_LINKAGE, Parameters, leaves, record_of, table, with_table
from cls_bench.resources import model_folder
from cls_bench.scenario import parse_scenario
from tests.plant_rig import parameters

LEAVES = list(leaves(Parameters()))


@pytest.mark.parametrize(("key", "about"), [(key, about) for key, _, about in LEAVES], ids=[key for key, *_ in LEAVES])
def test_every_parameter_says_what_it_is_and_where_it_comes_from(key, about):
    assert about["unit"]
    assert about["meaning"]
    source = about["source"]
    assert source, f"{key} has no source"
    assert source.removeprefix("assumed").strip(" :"), f"{key} is assumed without a reason"


def test_the_record_holds_every_value():
    """What compiled code reads is what the user set."""
    p = parameters(plc={"outer_loop": "velocity"}, column={"mass": 0.8}, gearbox={"ratio": 4.0})
    record = record_of(p)
    for key, value, _ in leaves(p):
        found = record
        for name in key.split("."):
            found = getattr(found, name)
        expected = {"position": 0, "velocity": 1}.get(value, value) if isinstance(value, str) else value
        assert found == expected, key


@pytest.mark.parametrize(
    ("section", "values", "says"),
    [
        ("column", {"inertia": -1.0}, "greater than or equal to 0.00001"),
        ("column", {"mass": 3.0}, "inertia must exceed mass × mass_height²"),
        ("column", {"switch_angle": 0.3}, "must grow in this order"),
        ("linkage", {"rod_end_mass": 0.4}, "must be less"),
        ("gearbox", {"efficiency": 0.99}, "efficiency 0.99 cannot be reached"),
        ("gearbox", {"backdrive_loss_ratio": 50.0}, "less than or equal"),
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


def test_values_are_checked_on_assignment_too():
    p = Parameters()
    with pytest.raises(ValidationError):
        p.motor.resistance = -1.0
    assert p.motor.resistance == 6.0


def test_mesh_loss_gives_the_efficiency_at_rated_torque():
    """Two stages one after the other, written out."""
    for efficiency in (0.7, 0.85, 0.9):
        box = parameters(gearbox={"efficiency": efficiency}).gearbox
        torque = box.rated_torque
        for stage in (box.stage1, box.stage2):
            torque = (torque - stage.drag) / (1 + box.mesh_loss) * box.ratio
        assert torque == pytest.approx(efficiency * box.rated_torque * box.ratio**2)


def test_the_table_in_the_models_readme_is_up_to_date():
    """If this fails: python -m cls_bench.parameters models/README.md"""
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
        (["linkage.rod_end_mass=0.3754999"], "rod_end_mass is a part of rod_column_mass"),
        (["drive.position_integral_time=1e-9"], "position_integral_time: give 0"),
    ],
)
def test_what_cannot_be_built_is_refused_by_validation(overrides, says):
    with pytest.raises(InputError, match=says):
        parse_scenario('title = "t"\nduration = 1.0', set=overrides)


def test_the_shipped_linkage_is_the_one_that_is_not_looked_at():
    p = Parameters()
    assert (p.linkage.four_bar, p.kinematic_range, p.plc.polynomial_degree) == _SHIPPED_LINKAGE
    assert parameters(plc={"polynomial_degree": 11}).kinematic_range == p.kinematic_range
