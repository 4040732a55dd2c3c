"""A wrong parameter behind the verification's back makes the right rows fall short, and leaves the others alone."""

from typing import Any, NamedTuple

import pytest

from cls_bench.parameters import Parameters
from cls_bench.verification import backlash, gear, limb, linearisation, load_cell, motor, stiction, verify
from cls_bench.verification import energy_balance as energy
from cls_bench.verification.runner import Case


def scaled(p: Parameters, key: str, factor: float) -> Parameters:
    def changed(section: Any, path: list[str]) -> Any:
        inner = getattr(section, path[0])
        return section.model_copy(update={path[0]: inner * factor if len(path) == 1 else changed(inner, path[1:])})

    return changed(p, key.split("."))


class Mutation(NamedTuple):
    """A parameter, what it is multiplied by, and which rows of which cases have to notice (a part of their name)."""

    key: str
    factor: float
    cases: tuple[Case, ...]
    short: tuple[str, ...]
    """in every row with one of these in it"""
    sound: tuple[str, ...] = ()
    """in no row with one of these in it"""


MUTATIONS = (
    Mutation("linkage.arm", 1.1, (linearisation.frequency_response, limb.resonance),
             ("gain at 5 Hz", "gain at 100 Hz", "resonance 1", "worst deviation"), ("two-mass",)),
    Mutation("linkage.crank", 1.1, (linearisation.frequency_response, energy.balance),
             ("worst deviation", "resonance 1", "drive on: energy", "drive off: energy")),
    Mutation("gearbox.stage1.backlash", 0.5, (backlash.dead_zone, backlash.gear_demo, backlash.stop_block_demo),
             ("dead zone of stage 1", "gear stage: time at which the gap"), ("stage 2", "stop blocks", "stiffness")),
    Mutation("gearbox.stage2.stiffness", 0.9, (backlash.dead_zone, linearisation.frequency_response),
             ("stiffness of stage 2", "resonance 1"), ("dead zone", "stiffness of stage 1", "gain at 5 Hz")),
    Mutation("gearbox.efficiency", 1.05, (gear.efficiency, gear.lossy_gear_demo),
             ("motor drives at 1 N", "motor drives at 4 N", "100 N·m at the crank", "load angle while it sticks")),
    Mutation("gearbox.backdrive_loss_ratio", 1.2, (gear.efficiency, gear.lossy_gear_demo),
             ("at the crank drives the motor", "load angle at 0.5 s"), ("motor drives at",)),
    Mutation("gearbox.breakaway_ratio", 1.1, (stiction.breakaway, stiction.stick_slip, stiction.creep),
             ("gear mesh, forward", "gear mesh, back", "stick-slip: period"), ("column bearing", "creep")),
    Mutation("column.coulomb_friction", 0.8, (stiction.breakaway, stiction.creep),
             ("breakaway torque of the column bearing", "creep of the column bearing"), ("gear mesh",)),
    Mutation("motor.torque_constant", 1.05, (motor.envelope, motor.current_step),
             ("peak current", "stall current", "no-load speed"), ("after a step",)),
    Mutation("motor.inductance", 1.5, (motor.current_step, motor.envelope),
             ("current 0.2 ms", "current 1 ms"), ("torque held", "no-load")),
    Mutation("motor.rotor_inertia", 1.1, (motor.power_balance, linearisation.frequency_response),
             ("kinetic energy", "worst deviation in gain"), ("work in a run-up",)),
    Mutation("load_cell.stiffness", 0.8, (load_cell.static, load_cell.ringing, load_cell.filter_step),
             ("give under", "rod end on the cell"), ("reading", "resolution", "filter")),
    Mutation("load_cell.filter_bandwidth", 0.5, (load_cell.static, load_cell.ringing),
             (), ("reading", "give", "rod end")),
    Mutation("load_cell.capacity", 1.1, (load_cell.static,),
             ("reading at rest", "resolution"), ("give", "800 N")),
    Mutation("limb.mass", 1.2, (limb.resonance, limb.rigid, linearisation.frequency_response),
             ("squeeze 0", "squeeze 0.5", "one rigid body"), ("gain", "phase")),
    Mutation("column.inertia", 1.1, (linearisation.frequency_response, limb.resonance, motor.power_balance),
             ("worst deviation", "resonance 1", "two-mass resonance at squeeze 1"), ("energy", "work")),
    Mutation("column.stop_stiffness", 1.2, (backlash.stop_block_demo, backlash.dead_zone),
             ("stop blocks: time", "stop blocks: speed"), ("stage",)),
)  # fmt: skip


@pytest.mark.parametrize("mutation", MUTATIONS, ids=lambda m: f"{m.key}×{m.factor:g}")
def test_wrong_parameter_is_noticed(mutation: Mutation) -> None:
    rows = verify(cases=mutation.cases, alter=lambda p: scaled(p, mutation.key, mutation.factor), workers=1)
    passed = {row.quantity: row.passed for row in rows}
    for part in mutation.short:
        concerned = [name for name in passed if part in name]
        assert concerned, part
        assert not [name for name in concerned if passed[name]], "these should have fallen short"
    for part in mutation.sound:
        concerned = [name for name in passed if part in name]
        assert concerned, part
        assert not [name for name in concerned if not passed[name]], "these have nothing to do with it"


def test_nothing_wrong_nothing_noticed() -> None:
    rows = verify(cases=(load_cell.static, motor.envelope), alter=lambda p: scaled(p, "limb.mass", 1.0), workers=1)
    assert all(row.passed for row in rows)
