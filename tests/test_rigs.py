"""Rigs: those that come with the bench, their figures, the rules that give them gains, faults of their files."""

import math

import numpy as np
import pytest
import scipy.linalg

from cls_bench.errors import InputError
from cls_bench.linear.alone import drive_alone
from cls_bench.linear.bench import LinearBench
from cls_bench.linear.hand import Hand
from cls_bench.linear.least import GRIPS
from cls_bench.linear.plant import plant
from cls_bench.linear.variation import changed
from cls_bench.parameters import Parameters
from cls_bench.resources import shipped_rigs
from cls_bench.rigs import load_rig, parse_rig, resonances
from cls_bench.rigs.modes import chain
from cls_bench.rigs.tuning import GAIN_MARGIN, answer_delay, gain_limit

SHIPPED = tuple(shipped_rigs())
BARE = 'title = "x"\n'

SIDE_STICK = """
title = "Side stick on a torque motor, no linkage"
[data_sheet]
gearbox = []
[data_sheet.motor]
stall_torque_Nm = 6.0
torque_constant_Nm_per_A = 1.1
motor_constant_Nm_per_sqrtW = 0.9
rotor_inertia_kgcm2 = 12
[data_sheet.load_cell]
capacity_Nm = 40
stiffness_Nm_per_rad = 20000
[parameters.linkage]
kind = "none"
[parameters.column]
inertia = 0.01
mass = 0.8
mass_height = 0.08
grip_height = 0.18
travel = 0.3
switch_angle = 0.32
stop_angle = 0.34
[parameters.feel]
inertia = 0.05
damping = 0.3
stiffness = 10
"""

CYCLIC = """
title = "Helicopter cyclic, a torque motor on the crank"
[data_sheet]
gearbox = []
[data_sheet.motor]
rated_torque_Nm = 12.0
rated_current_A = 5.0
torque_constant_Nm_per_A = 2.4
resistance_ohm = 4.5
inductance_mH = 20
rotor_inertia_kgcm2 = 25
[parameters.linkage]
crank = 0.08
rod = 0.35
arm = 0.10
rod_angle = 0.4
crank_angle = 0.2
arm_angle = -0.1
[parameters.column]
inertia = 0.35
mass = 2.0
mass_height = 0.3
grip_height = 0.65
travel = 0.2
switch_angle = 0.22
stop_angle = 0.24
"""

TILTED = (
    {"rod_angle": 0.4, "crank_angle": 0.3, "arm_angle": -0.1},
    {"rod_angle": 1.5, "crank_angle": 1.4, "arm_angle": 1.6, "rod": 0.4},
    {"rod_angle": -0.3, "crank_angle": -0.3, "arm_angle": -0.2, "rod": 0.3},
)


def drive_growth(p: Parameters, hand: Hand, gain: float = 1.0) -> float:
    """Growth rate of the drive's own loops with its velocity controller's gain as many times as large [1/s]."""
    louder = changed(p, "drive.velocity_bandwidth", gain * p.drive.velocity_bandwidth)
    return LinearBench(louder, hand, closed=False, model=False).growth_rate


@pytest.mark.parametrize("name", SHIPPED)
def test_the_drive_of_a_shipped_rig_is_calm_however_it_is_gripped(name: str) -> None:
    p = load_rig(name).parameters
    assert all(drive_growth(p, hand) < 0.0 for hand in GRIPS)
    assert drive_growth(p, Hand(None), 0.9 * GAIN_MARGIN) < 0.0
    assert drive_alone(p) == ""


@pytest.mark.parametrize("toml", [SIDE_STICK, CYCLIC])
def test_the_rule_keeps_the_drive_from_singing(toml: str) -> None:
    p = parse_rig(toml).parameters
    assert all(drive_growth(p, hand) < 0.0 for hand in GRIPS)
    limit, sings = gain_limit(p)
    assert p.drive.velocity_bandwidth == pytest.approx(limit / GAIN_MARGIN)
    at_limit = limit / p.drive.velocity_bandwidth
    # The rule's loop is continuous, the linear model's sampled and with back EMF: a few degrees at a light resonance.
    assert drive_growth(p, Hand(None), 0.9 * at_limit) < 0.0 < drive_growth(p, Hand(None), 1.25 * at_limit)
    loud = changed(p, "drive.velocity_bandwidth", 1.3 * limit)
    frequency = LinearBench(loud, Hand(None), closed=False, model=False).growth.imag / (2.0 * math.pi)
    assert frequency == pytest.approx(sings, rel=0.1)
    assert "the drive itself is unstable at" in drive_alone(loud)


@pytest.mark.parametrize("name", SHIPPED)
def test_the_rules_limit_is_the_linear_models(name: str) -> None:
    p = load_rig(name).parameters
    at_limit = gain_limit(p)[0] / p.drive.velocity_bandwidth
    assert drive_growth(p, Hand(None), 0.88 * at_limit) < 0.0 < drive_growth(p, Hand(None), 1.12 * at_limit)


def test_gains_are_the_thesiss_in_proportion() -> None:
    """Each of the three bounds decides somewhere."""
    thesis = Parameters()
    soft = parse_rig(f"{BARE}[parameters.load_cell]\nstiffness = 2.0e5\n")
    share = resonances(soft.parameters).held / resonances(thesis).held
    assert soft.parameters.drive.velocity_bandwidth == pytest.approx(100.0 * share)
    assert soft.parameters.drive.position_bandwidth == pytest.approx(35.0 * share)
    assert soft.parameters.drive.velocity_integral_time == pytest.approx(0.02 / share)
    slow = parse_rig(f"{BARE}[data_sheet.drive]\nvelocity_cycle_us = 400\nposition_cycle_us = 400\n")
    share = answer_delay(thesis) / answer_delay(slow.parameters)
    assert slow.parameters.drive.velocity_bandwidth == pytest.approx(100.0 * share)
    assert answer_delay(thesis) == pytest.approx(200e-6 + 400e-6 + 75e-6 + 1.0 / (2000.0 * math.pi))
    stiff = parse_rig(f"{BARE}[parameters.load_cell]\nstiffness = 9.0e6\n")
    assert stiff.parameters.drive.velocity_bandwidth == 100.0
    stated = parse_rig(f"{BARE}[parameters.drive]\nvelocity_bandwidth = 55.0\n[parameters.column]\nmass = 1.0\n")
    assert stated.parameters.drive.velocity_bandwidth == 55.0


@pytest.mark.parametrize(("cycle", "bandwidth"), [(25, 1000.0), (50, 1000.0), (100, 500.0), (200, 250.0)])
def test_the_current_loop_follows_its_cycle(cycle: int, bandwidth: float) -> None:
    table = f"current_cycle_us = {cycle}\nvelocity_cycle_us = 400\nposition_cycle_us = 400\n"
    rig = parse_rig(f"{BARE}[data_sheet.drive]\n{table}")
    assert rig.parameters.drive.current_bandwidth == pytest.approx(bandwidth)
    assert [d.key for d in rig.derived].count("drive.current_bandwidth") == (cycle > 50)
    assert drive_alone(rig.parameters) == ""


@pytest.mark.parametrize("name", ["current", "velocity", "position"])
def test_a_bandwidth_is_at_most_half_the_rate_of_its_controller(name: str) -> None:
    cycles = "current_cycle = 0.0002\nvelocity_cycle = 0.0004\nposition_cycle = 0.0008\n"
    most = {"current": 2500.0, "velocity": 1250.0, "position": 625.0}[name]
    text = f"{BARE}[parameters.rates]\n{cycles}[parameters.drive]\n{name}_bandwidth = "
    assert getattr(parse_rig(f"{text}{most}\n").parameters.drive, f"{name}_bandwidth") == most
    with pytest.raises(InputError, match=f"^rig.toml: parameters.*{name}_bandwidth = .*must be at most {most:g} Hz$"):
        parse_rig(f"{text}{1.001 * most}\n")


def linear_resonances(p: Parameters) -> tuple[float, float]:
    """Free and held by the linear model, whose weights are left out."""
    light = p.model_copy(update={"column": p.column.model_copy(update={"mass_height": 0.0})})
    found = plant(light, Hand(None))

    def modes(first: int) -> list[float]:
        squares = scipy.linalg.eigh(found.stiffness[first:, first:], found.mass[first:, first:], eigvals_only=True)
        return sorted(math.sqrt(value) / (2.0 * math.pi) for value in squares if value > 0.0)

    return next(f for f in modes(0) if f > 5.0), modes(1)[0]


@pytest.mark.parametrize("rig", [*SHIPPED, *TILTED], ids=str)
def test_resonances_are_those_of_the_linear_model(rig: str | dict[str, float]) -> None:
    if isinstance(rig, str):
        p = load_rig(rig).parameters
    else:
        p = parse_rig(BARE + "[parameters.linkage]\n" + "".join(f"{key} = {x}\n" for key, x in rig.items())).parameters
    assert resonances(p) == pytest.approx(linear_resonances(p), rel=0.005)


def test_the_motor_finds_all_inertia_below_the_resonances_and_its_own_above() -> None:
    p = load_rig("direct_drive").parameters
    low, high = abs(chain(p).mobility(np.array([5.0, 5e4])))
    assert 1.0 / (2.0 * math.pi * 5.0 * low) == pytest.approx(p.nameplate.load_inertia, rel=0.001)
    link = p.linkage
    own = p.motor.rotor_inertia + link.crank_inertia + sum(link.masses[:2]) * link.crank**2
    assert 1.0 / (2.0 * math.pi * 5e4 * high) == pytest.approx(own, rel=0.001)
