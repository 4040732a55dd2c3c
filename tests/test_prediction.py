"""The linear model on its own, and against the simulation; the growth fit; what onsets are searched over."""

import math

import numpy as np
import pytest

from cls_bench.analysis.growth import modes
from cls_bench.errors import InputError
from cls_bench.linear.bench import LinearBench
from cls_bench.linear.cycle import Compensation
from cls_bench.linear.hand import Hand, forward_inertia, limb_mass_for
from cls_bench.linear.least import least_inertia
from cls_bench.linear.plant import plant
from cls_bench.linear.prediction import critical, growth_rate, inner_loop, loop_gain, predict, rule
from cls_bench.linear.variation import Setup, changed, ideal, variation
from cls_bench.parameters import Parameters
from cls_bench.parameters.override import override
from cls_bench.stability import trial
from cls_bench.stability.trial import STILL
from cls_bench.stability.validation import RATES, RIGS, Configuration, bench, compare, difference, points


def at(inertia: float, p: Parameters | None = None, hand: Hand | None = None) -> Setup:
    return Setup(changed(p or Parameters(), "feel.inertia", inertia), hand or Hand())


# The plant against the thesis's figures


def test_total_inertia_at_the_motor_is_that_of_table_3_3():
    p = Parameters()
    # Every coordinate moves as if all springs were rigid; the motor turns by 1.
    rigid = np.array([1.0, 1.0 / 5.0, 1.0 / 25.0, 1.0 / 25.0 / 1.75])
    total = rigid @ plant(p, Hand(None)).mass @ rigid
    assert total == pytest.approx(4.00e-5 + 5.27e-5, rel=0.01)


def test_springs_hold_no_torque_in_rigid_motion_and_the_grip_only_its_own_stretch():
    p = Parameters()
    stiff = plant(p, Hand(1.0, arm=False)).stiffness
    rigid = np.array([1.0, 1.0 / 5.0, 1.0 / 25.0, 1.0 / 25.0 / 1.75, 1.0 / 25.0 / 1.75])
    torque = stiff @ rigid
    weight = 9.80665 * (0.9 * 0.12 + 0.3755 * 0.175) * rigid[3]  # of column and rod, towards either side
    assert torque[3] == pytest.approx(-weight, rel=1e-6)
    assert abs(torque[4]) < 1e-9 * stiff[4, 4]
    assert abs(torque[:2]).max() < 1e-12 * stiff.max()


def test_forward_inertia_and_the_limb_mass_for_it_are_inverse():
    p = Parameters()
    bare = 3.51e-2 + 0.15 * 0.175**2
    assert forward_inertia(p, Hand(None)) == pytest.approx(bare)
    assert forward_inertia(p, Hand()) == pytest.approx(bare + 1.8 * 0.3**2)
    assert limb_mass_for(p, forward_inertia(p, Hand())) == pytest.approx(1.8)


# Frequency responses and stability


def test_inner_loop_follows_slow_motion_exactly_and_is_late_by_its_delays():
    response = inner_loop(Parameters(), Hand(None), [0.05])
    assert abs(response.value[0]) == pytest.approx(1.0, abs=1e-3)
    # A position loop without velocity feed-forward lags by 1/k_p, and by bus, interpolation and voltage latency.
    lag = -np.angle(response.value[0]) / (2.0 * np.pi * 0.05)
    assert 1.0 / (2.0 * np.pi * 35.0) < lag < 1.0 / (2.0 * np.pi * 35.0) + 2e-3


def test_with_an_ideal_drive_the_loop_gain_is_that_of_thesis_3_6_2():
    # G = M F P with M and F by hand, at a frequency where the column is rigid and the aliases are nothing.
    p = ideal(Parameters())
    frequency = 20.0
    s = 2j * math.pi * frequency
    hand = Hand(None)
    m = forward_inertia(p, hand) * s**2 + p.column.viscous_friction * s
    f = 1.0 / (p.feel.inertia * s**2 + p.feel.damping * s + p.feel.stiffness)
    inner = inner_loop(p, hand, [frequency]).value[0]
    measured = loop_gain(Setup(p, hand), [frequency]).value[0]
    # The load cell's filter and its sampling delay the measured torque a little: under 0.1 ms.
    assert abs(measured / (m * f * inner)) == pytest.approx(1.0, abs=0.03)
    assert abs(np.angle(measured / (m * f * inner))) < 2.0 * np.pi * frequency * 3e-4


@pytest.mark.parametrize("inertia", [0.1, 0.2, 0.25, 0.6])
@pytest.mark.parametrize("architecture", ["position", "velocity"])
def test_nyquist_and_eigenvalues_agree(inertia, architecture):
    setup = at(inertia, changed(Parameters(), "plc.outer_loop", architecture))
    p = predict(setup)
    unstable = np.sum(np.abs(LinearBench(setup.parameters, setup.hand).lifted.eigenvalues) > 1.0)
    assert p.encirclements == unstable
    assert p.stable == (unstable == 0) == (p.gain_margin > 1.0)


def test_at_the_critical_inertia_the_margins_vanish_and_the_oscillation_neither_grows_nor_decays():
    onset = critical(Setup(), variation("feel.inertia"))
    p = predict(at(onset))
    assert p.gain_margin == pytest.approx(1.0, abs=2e-3)
    assert p.phase_margin == pytest.approx(0.0, abs=math.radians(0.3))
    assert p.growth == pytest.approx(0.0, abs=0.05)
    assert p.frequency == pytest.approx(p.phase_crossover, rel=0.01)


def test_rule_is_the_thesis_s_and_optimistic():
    setup = Setup()
    found = rule(setup)
    response = inner_loop(setup.parameters, Hand(None), [found.crossover])
    assert abs(np.angle(-response.value[0])) < math.radians(1.0)
    assert found.magnitude == pytest.approx(abs(response.value[0]), rel=0.01)
    assert found.ratio == pytest.approx(forward_inertia(setup.parameters, setup.hand) / 0.3)
    by_rule = found.ratio * 0.3 / found.critical_ratio
    assert by_rule < critical(setup, variation("feel.inertia"))


def test_a_loose_grip_and_no_hand_are_calmer_than_a_tight_one():
    tight, loose, off = (growth_rate(at(0.15, hand=Hand(s))) for s in (1.0, 0.0, None))
    assert tight > 0 > loose and off < 0


def test_compensating_half_of_the_inertia_lowers_the_critical_inertia_of_the_linear_model():
    half = Compensation(0.5 * forward_inertia(Parameters(), Hand()), 0.002)
    vary = variation("feel.inertia")
    assert critical(Setup(), vary, half) < 0.95 * critical(Setup(), vary)


def test_delay_is_whole_and_squeeze_without_onset_has_none():
    delay = critical(Setup(), variation("delay"))
    assert delay == round(delay)
    p = Parameters()
    assert growth_rate(Setup(changed(p, "plc.command_latency", int(delay)))) > 0
    assert growth_rate(Setup(changed(p, "plc.command_latency", int(delay) - 1))) < 0
    assert critical(Setup(), variation("squeeze")) is None


# Against the simulation


@pytest.mark.parametrize("inertia", [0.19, 0.23])
def test_growth_rate_and_frequency_are_those_of_the_simulation(inertia):
    setup = at(inertia, ideal(Parameters()))
    seen = trial.run(setup, STILL)
    predicted = LinearBench(setup.parameters, setup.hand).growth
    assert seen.growth == pytest.approx(predicted.real, abs=0.1)
    assert seen.frequency == pytest.approx(predicted.imag / (2.0 * math.pi), rel=0.01)


def test_the_difference_is_the_simulation_s_step():
    setup = at(0.2, ideal(Parameters()))
    predicted = growth_rate(setup)
    coarse, fine = (
        abs(predicted - trial.run(changed_to(setup, "simulation.substeps", n), STILL).growth) for n in (1, 4)
    )
    assert fine < 0.5 * coarse < 0.05


def changed_to(setup: Setup, key: str, value: float) -> Setup:
    return Setup(changed(setup.parameters, key, value), setup.hand)


def check_growth(p: Parameters) -> None:
    """A little below and a little above the least inertia, growth rate and frequency are those of the simulation."""
    worst, _ = least_inertia(p, [Hand(1.0)])
    for factor in (0.9, 1.1):
        setup = Setup(changed(p, "feel.inertia", factor * worst), Hand(1.0))
        seen, predicted = trial.run(setup, STILL), LinearBench(setup.parameters, setup.hand).growth
        assert seen.growth == pytest.approx(predicted.real, abs=0.15)
        assert seen.frequency == pytest.approx(predicted.imag / (2.0 * math.pi), rel=0.005)


@pytest.mark.parametrize("rates", list(RATES))
@pytest.mark.parametrize("rig", list(RIGS))
def test_growth_rate_of_every_rig_is_that_of_the_simulation(rig, rates):
    p = bench(rig, rates)
    check_growth(p)


FEELS = {
    "two bodies": {"bodies": "two"},
    "two bodies, stiff rod": {"bodies": "two", "linkage": {"stiffness": 2e4, "damping": 3.0}},
    "aft body jammed": {"bodies": "two", "jam": {"of": "aft"}},
    "disconnected": {"bodies": "two", "linkage": {"connected": False}},
    "everything": {
        "bodies": "two", "q_feel": {"gradient": 0.01}, "centering": {"stiffness": 60.0, "breakout": 2.0},
        "flight": {"dynamic_pressure": 2000.0, "airspeed": 60.0}, "unbalance": {"gradient": 2.0},
        "surface": {"area": 1.0, "chord": 0.3, "hinge_deflection": -0.05, "hinge_rate": -2.0},
        "detents": {"place": (0.0,), "width": (0.1,), "torque": (0.5,)},
        "autopilot": {"engaged": True, "stiffness": 100.0, "damping": 4.0, "clutch": 20.0},
        "hydraulics": {"pressure": 0.6, "off_damping": 1.0},
    },
    "everything on one body": {
        "centering": {"stiffness": 60.0, "breakout": 2.0}, "unbalance": {"gradient": 2.0},
        "flight": {"dynamic_pressure": 2000.0, "airspeed": 60.0},
        "surface": {"area": 1.0, "chord": 0.3, "hinge_deflection": -0.05, "hinge_rate": -2.0},
        "detents": {"place": (0.0,), "width": (0.1,), "torque": (0.5,)},
        "autopilot": {"engaged": True, "stiffness": 100.0, "damping": 4.0, "clutch": 20.0},
    },
}  # fmt: skip


@pytest.mark.parametrize("architecture", ["position", "velocity"])
@pytest.mark.parametrize("feel", FEELS)
def test_growth_rate_of_every_feel_model_is_that_of_the_simulation(feel, architecture):
    p = changed(ideal(override(Parameters(), {"feel": FEELS[feel]})), "plc.outer_loop", architecture)
    worst, _ = least_inertia(p, [Hand(1.0)])
    for factor in (0.9, 1.1):
        setup = Setup(changed(p, "feel.inertia", factor * worst), Hand(1.0))
        seen, predicted = trial.run(setup, STILL), LinearBench(setup.parameters, setup.hand).growth
        assert seen.stable == (factor > 1.0)
        if seen.reason == "dies out":  # sooner than four windows could agree
            continue
        assert seen.growth == pytest.approx(predicted.real, abs=0.06)
        assert seen.frequency == pytest.approx(predicted.imag / (2.0 * math.pi), rel=0.005)


@pytest.mark.parametrize("rates", list(RATES))
@pytest.mark.parametrize("rig", list(RIGS))
def test_growth_rate_with_two_bodies_on_every_rig_is_that_of_the_simulation(rig, rates):
    p = bench(rig, rates)
    inertia = p.feel.inertia
    two = {"bodies": "two", "aft": {"inertia": inertia}, "linkage": {"stiffness": 3000.0 * inertia}}
    p = ideal(override(p, {"feel": two}))
    check_growth(p)


@pytest.mark.parametrize("rig", list(RIGS))
def test_critical_forward_inertia(rig):
    (row,) = compare([p for p in points(rig) if tuple(p.values())[2:] == (1.0, 1, "shipped", "elastic")])
    assert abs(difference(row)) < 0.02


@pytest.mark.slow
@pytest.mark.parametrize("rates", list(RATES))
@pytest.mark.parametrize("rig", list(RIGS))
def test_critical_forward_inertia_of_all_configurations(rig, rates):
    found = [difference(row) for row in compare(points(rig, rates))]
    seen = [value for value in found if not math.isnan(value)]
    assert len(found) == len(seen) == 48
    assert max(abs(value) for value in seen) < 0.02


def test_a_swing_slower_than_the_fits_is_not_called_stable():
    """At the end of its torque the drive swings at some 5 Hz, where a trial fits from 10 on."""
    point = {"rig": "direct_drive", "rates": "plc 1 kHz, drive 16 kHz", "inertia": 2.0, "delay": 3, "gains": "softer",
             "grip": "rigid"}  # fmt: skip
    setup = Configuration().setup(point)
    heavy = variation("forward_inertia", of=setup.parameters).apply(setup, 2.0)
    assert LinearBench(heavy.parameters, heavy.hand).growth_rate > 10.0
    verdict = trial.run(heavy, STILL)
    assert (verdict.stable, verdict.reason) == (False, "sustained")


# The fit of growth rates


def test_modes_finds_a_slow_growth_beside_a_stronger_slow_swing_and_noise():
    time = np.arange(150) * 8e-4
    rng = np.random.default_rng(1)
    x = np.exp(0.7 * time) * np.sin(2 * np.pi * 47.0 * time + 0.3) + 2.0 * np.exp(-8.0 * time) * np.cos(20.0 * time)
    x += 1e-3 * rng.standard_normal(150)
    fast = [mode for mode in modes(x, 8e-4) if mode.frequency > 10]
    assert fast[0].frequency == pytest.approx(47.0, abs=0.02)
    assert fast[0].growth == pytest.approx(0.7, abs=0.1)
    assert fast[0].amplitude == pytest.approx(math.exp(0.7 * time[75]), rel=0.01)


def test_modes_of_nothing_and_of_too_little():
    assert modes(np.zeros(100), 1e-3) == []
    with pytest.raises(ValueError, match="too few"):
        modes(np.ones(20), 1e-3)


# What an onset is searched over


def test_variation_names_what_is_valid():
    with pytest.raises(InputError, match='vary = "mass": must be limb_mass'):
        variation("mass")
    with pytest.raises(InputError, match="must grow"):
        variation("limb_mass", 2.0, 1.0)
    assert variation("plc.feedback_latency", 0, 3).whole
    assert variation("drive.position_bandwidth").high == pytest.approx(350.0)


def test_changed_leaves_the_original_and_checks_values():
    p = Parameters()
    assert changed(p, "gearbox.stage1.drag", 0.0).gearbox.stage1.drag == 0.0
    assert p.gearbox.stage1.drag > 0
    with pytest.raises(InputError, match=r"feel.inertia: -1.0 is not valid; give a number ≥ 0.001"):
        changed(p, "feel.inertia", -1.0)
    with pytest.raises(InputError, match=r'feel.mass: unknown parameter'):
        changed(p, "feel.mass", 1.0)
    with pytest.raises(InputError, match="the column alone has more"):
        variation("forward_inertia").apply(Setup(), 0.01)
