"""The whole plant against the reduced model, and how its error falls with the step."""

import functools
import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from cls_bench.bench import Bench
from cls_bench.parameters import Parameters, Simulation
from cls_bench.plant.state import COLUMN
from cls_bench.scenario import parse_scenario
from cls_bench.signals import TICK_S
from cls_bench.verification import reduced_model
from cls_bench.verification.reading import Array
from cls_bench.verification.row import Row
from cls_bench.verification.subject import Held, Subject, run_plant

GROUP = "whole plant"
REFERENCE = "reduced model (solve_ivp)"

ALLOWED = 1e-3
"""Deviation of the column angle that passes, as a part of the travel to one side."""

FINE = 32
"""Steps in a tick for the comparison over 2 s, which has to tell laws apart and not steps."""


CLOSED_LOOP = """
    title = "sweep"
    duration = 3.0
    [[hand]]
    at = 0.0
    kind = "sine"
    amplitude_deg = 10.0
    frequency = 0.7
    fade = 0.5
"""


class Record(NamedTuple):
    """Torques [N·m] on motor and column, an entry a tick."""

    time: Array
    motor: Array
    hand: Array


def _hand(name: str, time: Array) -> Array:
    grown = np.minimum(time / 0.5, 1.0) ** 2 * (3.0 - 2.0 * np.minimum(time / 0.5, 1.0))
    if name == "smooth":  # pulls all the time: the meshes stay on one flank
        return np.asarray(-(10.0 + 4.0 * np.sin(2.0 * np.pi * 1.3 * time)) * grown)
    return np.asarray(12.0 * np.sin(2.0 * np.pi * 1.5 * time) * grown)


@functools.lru_cache(maxsize=4)
def record(name: str) -> Record:
    """Torques that swing the column by ±10° at 0.5 Hz against a hand, made once with the bench itself.

    "smooth" loads the meshes on one flank only, "backlash" changes the flank at every turn of the hand.
    """
    p = Parameters()
    specimen = Subject().plant(p)
    time = specimen.times(2.0)
    grown = np.minimum(time / 0.5, 1.0) ** 2 * (3.0 - 2.0 * np.minimum(time / 0.5, 1.0))
    ratio = p.gearbox.ratio**2 * p.linkage.arm / p.linkage.crank
    target = math.radians(10.0) * ratio * np.sin(2.0 * np.pi * 0.5 * time) * grown
    hand = _hand(name, time)
    motor, _ = run_plant(specimen, np.zeros(len(time)), hand, held=Held(2.0, 0.05), target=target)
    return Record(time, motor, hand)


@functools.lru_cache(maxsize=4)
def reference(name: str) -> Array:
    """Column angle [rad] of the reduced model under :func:`record`, at its times."""
    made = record(name)
    return reduced_model.follow(Parameters(), made.time, made.motor, made.hand)[:, 3]


def _angle(subject: Subject, name: str, substeps: int, duration: float = 2.0) -> Array:
    """Column angle [rad] of the plant under the record at every tick, with ``substeps`` steps in one."""
    specimen = subject.plant(Parameters(simulation=Simulation(substeps=substeps)))
    made, time = record(name), specimen.times(duration)
    motor, hand = np.interp(time, made.time, made.motor), np.interp(time, made.time, made.hand)
    return run_plant(specimen, motor, hand)[1][::substeps, COLUMN]


def agreement(subject: Subject) -> Iterator[Row]:
    """Column angle over 2 s, for a load on one flank of the teeth and for one that crosses the backlash.

    Nothing guides the column but the two torques, and friction that ripples with the teeth makes its path unstable: a
    deviation grows up to eightyfold from the first second to the second. Hence the fine step; see also
    :func:`convergence`.
    """
    travel = Parameters().column.travel
    for name in ("smooth", "backlash"):
        deviation = _angle(subject, name, FINE) - reference(name)
        yield Row(GROUP, f"{name} record: worst deviation of the column angle in 2 s, step 1.6 µs", "rad", 0.0,
                  REFERENCE, _worst(deviation), ALLOWED * travel, relative=False)  # fmt: skip


def convergence(subject: Subject) -> Iterator[Row]:
    """Deviation over the first second for steps from 50 µs down, and the order at which it falls."""
    travel = Parameters().column.travel
    for name in ("smooth", "backlash"):
        worst = []
        steps = (1, 2, 4, 8)
        for substeps in steps:
            angle = _angle(subject, name, substeps, 1.0)
            worst.append(_worst(angle - reference(name)[: len(angle)]))
            yield Row("convergence", f"{name} record: worst deviation of the column angle in 1 s, "
                      f"step {TICK_S / substeps * 1e6:g} µs", "rad", 0.0, REFERENCE, worst[-1], ALLOWED * travel,
                      relative=False)  # fmt: skip
        if name == "smooth":  # the instants at which flanks change leave no order to be seen
            order = -float(np.polyfit(np.log2(steps), np.log2(np.abs(worst)), 1)[0])
            yield Row("convergence", f"{name} record: order of convergence", "1", 1.0, "semi-implicit Euler", order,
                      0.25, relative=False)  # fmt: skip


def closed_loop(subject: Subject) -> Iterator[Row]:
    """The bench as it is used: what the step of 50 µs costs where the controller guides the column."""
    travel = Parameters().column.travel
    scenario = parse_scenario(CLOSED_LOOP)
    angles = []
    for substeps in (1, 8):
        p = subject.alter(
            scenario.parameters_at_start().model_copy(update={"simulation": Simulation(substeps=substeps)})
        )
        blocks = Bench(p, seed=scenario.seed).run(scenario)
        angles.append(np.concatenate([block["/column.angle"] for block in blocks]))
    yield Row("convergence", "drive on, hand sweeps ±10°: worst deviation of the column angle, step 50 µs", "rad", 0.0,
              "the same at 6.25 µs", _worst(angles[0] - angles[1]), ALLOWED * travel, relative=False)  # fmt: skip


def _worst(deviation: Array) -> float:
    return float(deviation[np.argmax(np.abs(deviation))])
