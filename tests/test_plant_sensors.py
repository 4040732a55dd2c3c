"""Sensors: resolution, range, noise and filter of all that control may know."""

import math

import numpy as np
import pytest

from cls_bench.bench import Bench
from cls_bench.parameters import DEG, GRAVITY, Parameters, record_of
from cls_bench.plant import sensors, state
from cls_bench.plant.sensors import load_cell_count, sample, weigh
from cls_bench.signals import TICK_S
from tests.plant_rig import Run, parameters

P = Parameters()
QUIET = parameters(
    load_cell={"noise": 0.0}, encoder={"noise": 0.0}, potentiometer={"noise": 0.0},
)  # fmt: skip


def fresh() -> np.recarray:
    return np.zeros(1, dtype=sensors.SAMPLES).view(np.recarray)[0]


def settled(p: Parameters, force: float, noise: float = 0.0) -> float:
    """Counts after a constant force [N] has passed the filter."""
    samples = fresh()
    for _ in range(50):
        weigh(record_of(p).load_cell, force, noise, samples)
    return float(samples.load_cell)


def test_load_cell_range_is_50_kg_both_ways_in_24_bit():
    count = load_cell_count(record_of(P).load_cell)
    assert count == pytest.approx(2 * 50 * GRAVITY / 2**24)
    assert settled(QUIET, 100.0) * count == pytest.approx(100.0, abs=count)
    assert settled(QUIET, 400.0) == -settled(QUIET, -400.0)
    assert settled(QUIET, 5000.0) == 2**23 - 1
    assert settled(QUIET, -5000.0) == -(2**23)


def test_load_cell_resolves_one_count():
    coarse = parameters(load_cell={"noise": 0.0, "adc_bits": 12})
    count = load_cell_count(record_of(coarse).load_cell)
    assert count == pytest.approx(0.239, rel=0.01)
    assert settled(coarse, 10.4 * count) == 10
    assert settled(coarse, 10.6 * count) == 11


def test_load_cell_noise_is_that_of_16_4_effective_bits_at_100_hz():
    rng, cell, samples, counts = np.random.default_rng(1), record_of(P).load_cell, fresh(), []
    for n in rng.standard_normal(40_000):
        weigh(cell, 20.0, n, samples)
        counts.append(samples.load_cell)
    force = np.array(counts[200:]) * load_cell_count(cell)
    assert force.mean() == pytest.approx(20.0, abs=0.01)
    assert force.std() == pytest.approx(0.16, rel=0.03)
    at_100_hz = force[: len(force) // 200 * 200].reshape(-1, 200).mean(axis=1)
    assert math.log2(981 / at_100_hz.std()) == pytest.approx(16.4, abs=0.2)


@pytest.mark.parametrize("corner", [500.0, 5000.0])
def test_load_cell_filter_is_a_low_pass_of_first_order(corner):
    cell, samples = record_of(parameters(load_cell={"noise": 0.0, "filter_bandwidth": corner})).load_cell, fresh()
    for k in range(1, 21):
        weigh(cell, 100.0, 0.0, samples)
        exact = 100.0 * (1 - math.exp(-2 * math.pi * corner * k * TICK_S))
        assert samples.load_cell * load_cell_count(cell) == pytest.approx(exact, abs=1e-3)


def sampled(p: Parameters, *, motor: float = 0.0, column: float = 0.0, noise: float = 0.0) -> np.recarray:
    bench, samples = Bench(p), fresh()
    bench.data.qpos[state.MOTOR], bench.data.qpos[state.COLUMN] = motor, column
    sample(bench.plant, record_of(p), 0.0, np.full(sensors.NOISES, noise), samples)
    return samples


@pytest.mark.parametrize(("interpolation", "steps"), [(1, 4096), (64, 4096 * 64)])
def test_encoder_counts_4096_a_revolution_interpolated(interpolation, steps):
    p = parameters(encoder={"noise": 0.0, "interpolation": interpolation})
    step = 2 * math.pi / steps
    assert sampled(p, motor=10.4 * step).encoder == pytest.approx(10 * step)
    assert sampled(p, motor=10.6 * step).encoder == pytest.approx(11 * step)
    assert sampled(p, motor=-1000.0).encoder == pytest.approx(-1000.0, abs=step)  # many revolutions


def test_encoder_noise_comes_before_the_quantiser():
    p = parameters(encoder={"interpolation": 65536, "noise": 1e-4})
    assert sampled(p, motor=1.0, noise=2.0).encoder == pytest.approx(1.0002, abs=1e-7)


def test_potentiometer_has_16_bit_over_30_degrees_and_saturates():
    step = 2 * 30 * DEG / 2**16
    assert sampled(QUIET, column=7.4 * step).potentiometer == pytest.approx(7 * step)
    assert sampled(QUIET, column=40 * DEG).potentiometer == pytest.approx(30 * DEG)
    assert sampled(QUIET, column=-40 * DEG).potentiometer == pytest.approx(-30 * DEG)


@pytest.mark.parametrize(
    ("degrees", "forward", "aft"), [(0, 1, 1), (20.9, 1, 1), (21.1, 0, 1), (-20.9, 1, 1), (-21.1, 1, 0)]
)
def test_limit_switches_open_beyond_the_travel(degrees, forward, aft):
    """Normally closed: open beyond 21°, so a broken wire reads like a reached limit."""
    samples = sampled(QUIET, column=degrees * DEG)
    assert (samples.switch_forward, samples.switch_aft) == (forward, aft)


RESTING = 'duration = 0.1\n[drive]\npower = "off"\n'


def test_noise_is_seeded():
    first, same, other = Run(RESTING), Run(RESTING), Run(RESTING, "seed=4")
    assert np.array_equal(first["/load_cell.counts"], same["/load_cell.counts"])
    assert not np.array_equal(first["/load_cell.counts"], other["/load_cell.counts"])


def test_load_cell_carries_what_the_hand_pushes():
    """Held at rest by the drive, 40 N at the grip: 40 N · 0.300 / 0.175 in the rod, tension positive for a push."""
    run = Run(
        """
        duration = 1.5
        [drive]
        power = "on"
        [[hand]]
        at = 0.0
        kind = "ramp"
        to_N = 40.0
        over = 0.5
        """,
        "feel.stiffness=500.0", "feel.damping=10.0", "feel.friction=0.0",
    )  # fmt: skip
    angle = run.during("/column.angle", 1.4, 1.5).mean()
    assert 0.0 < angle < 2 * DEG
    hand = run.during("/pilot.hand_force", 1.4, 1.5).mean()
    assert hand == pytest.approx(40.0, rel=0.01)
    friction = P.column.coulomb_friction / P.linkage.arm
    expected = hand * 0.300 / 0.175
    assert run.during("/load_cell.force", 1.4, 1.5).mean() == pytest.approx(expected, abs=friction + 0.2)
    assert run.during("/load_cell.torque", 1.4, 1.5).mean() == pytest.approx(hand * 0.300, abs=0.06)
    deflection = run.bench.data.qpos[state.LOAD_CELL]
    assert deflection == pytest.approx(expected / 3e6, rel=0.02)
