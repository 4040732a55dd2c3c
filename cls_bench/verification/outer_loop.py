"""The whole bench at the edge of stability: the step decides nothing, and growth is that of the linear model."""

import math
from collections.abc import Iterator

import numpy as np
from scipy.signal import butter, sosfiltfilt

from cls_bench.analysis.growth import modes
from cls_bench.bench import Bench
from cls_bench.drivers import scripted
from cls_bench.linear.bench import LinearBench
from cls_bench.linear.hand import Hand
from cls_bench.linear.prediction import critical
from cls_bench.linear.variation import Setup, changed, ideal, variation
from cls_bench.parameters import Parameters, Simulation
from cls_bench.resources import shipped_scenarios
from cls_bench.scenario import Change, Hold, Scenario, Squeeze, load_scenario
from cls_bench.verification.reading import Array
from cls_bench.verification.row import Row
from cls_bench.verification.subject import Subject

GROUP = "outer loop"

SUBSTEPS = (1, 4, 16)

SAMPLE = 0.8e-3
"""Period at which the oscillation is fitted [s]."""

GROWING, ONSET = (0.20, 0.23), (0.214, 0.220)
"""I_fcs [kg·m²] whose growth rates are compared, and those between which the onset is interpolated."""

SHAKE = 15.0
"""Slower motion is the hand's [Hz]."""


def shaking(subject: Subject) -> Iterator[Row]:
    """Amplitude of `stability_moderate` once the hand squeezes, for 1, 4 and 16 steps in a tick."""
    scenario = load_scenario(shipped_scenarios()["stability_moderate"])
    found = {}
    for substeps in SUBSTEPS:
        p = scenario.parameters_at_start().model_copy(update={"simulation": Simulation(substeps=substeps)})
        p = subject.alter(p)
        blocks, clock = scripted.run(Bench(p, seed=scenario.seed), scenario.on(p)), p.rates.clock
        angle = np.concatenate([block["/column.angle"] for block in blocks])
        found[substeps] = _shake(angle[clock.tick_of(6.0) :], 1.0 / clock.tick_s)
    finest = SUBSTEPS[-1]
    for substeps in SUBSTEPS[:-1]:
        yield Row(GROUP, f"stability_moderate: amplitude with {substeps} step{'s' * (substeps > 1)} a tick", "deg",
                  found[finest], f"the same with {finest}", found[substeps], 0.02)  # fmt: skip


def _shake(angle: Array, rate: float) -> float:
    """Amplitude [deg] of what is faster than :data:`SHAKE`: of a sine with the same power."""
    fast = sosfiltfilt(butter(4, SHAKE, "highpass", fs=rate, output="sos"), angle)
    return math.degrees(math.sqrt(2.0) * float(np.std(fast)))


def growing(subject: Subject) -> Iterator[Row]:
    """Growth rates of the bench without friction and backlash on a tight grip, and where they change sign."""
    bare, law = ideal(Parameters()), "linear model"
    for inertia in GROWING:
        p = changed(bare, "feel.inertia", inertia)
        expected, obtained = LinearBench(p, Hand(1.0)).growth, _growth(subject.alter(p))
        what = f"tight grip, no friction, I_fcs {inertia:g} kg·m²"
        yield Row(GROUP, f"{what}: growth rate", "1/s", expected.real, law, obtained.real, 0.02)
        yield Row(GROUP, f"{what}: frequency", "Hz", expected.imag / (2.0 * math.pi), law,
                  obtained.imag / (2.0 * math.pi), 0.005)  # fmt: skip
        finest = _growth(subject.alter(changed(p, "simulation.substeps", SUBSTEPS[-1])))
        yield Row(GROUP, f"{what}: growth rate with {SUBSTEPS[-1]} steps a tick", "1/s", expected.real, law,
                  finest.real, 0.002)  # fmt: skip
    two = changed(changed(bare, "feel.bodies", "two"), "feel.inertia", GROWING[0])
    expected, obtained = LinearBench(two, Hand(1.0)).growth, _growth(subject.alter(two))
    what = "tight grip, no friction, feel model of two bodies"
    yield Row(GROUP, f"{what}: growth rate", "1/s", expected.real, law, obtained.real, 0.02)
    yield Row(GROUP, f"{what}: frequency", "Hz", expected.imag / (2.0 * math.pi), law,
              obtained.imag / (2.0 * math.pi), 0.005)  # fmt: skip
    onset = critical(Setup(bare), variation("feel.inertia", 0.15, 0.30))
    low, high = (_growth(subject.alter(changed(bare, "feel.inertia", inertia))).real for inertia in ONSET)
    found = ONSET[0] + (ONSET[1] - ONSET[0]) * low / (low - high) if low > 0.0 > high else math.nan
    yield Row(GROUP, "tight grip, no friction: I_fcs at which it neither grows nor decays", "kg·m²",
              math.nan if onset is None else onset, law, found, 0.005)  # fmt: skip


def _growth(p: Parameters) -> complex:
    """Growth rate [1/s] + j · angular frequency of the bench's oscillation after a tap on the feel model."""
    tap = p.feel.inertia  # N·m
    scenario = Scenario(
        title="tap", duration=0.8, hand=[Hold(at=0.0, angle_deg=0.0)], squeeze=[Squeeze(at=0.0, value=1.0)],
        changes=[
            Change(at=0.05, parameters={"feel.disturbance.torque": tap}),
            Change(at=0.06, parameters={"feel.disturbance.torque": 0.0}),
        ],
    )  # fmt: skip
    blocks = scripted.run(Bench(p), scenario.on(p))
    speed = np.concatenate([block["/column.velocity"] for block in blocks])
    count = round(SAMPLE / p.rates.clock.tick_s)
    sampled = speed[: len(speed) // count * count].reshape(-1, count).mean(axis=1)
    acceleration = np.diff(sampled) / SAMPLE
    found = max(modes(acceleration[round(0.25 / SAMPLE) :], SAMPLE), key=lambda mode: mode.share)
    return complex(found.growth, 2.0 * math.pi * found.frequency)
