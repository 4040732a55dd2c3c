"""The whole plant against the reduced model and MuJoCo's own elements, and how its error falls with the step."""

import math
from collections.abc import Iterable, Iterator
from functools import cache
from typing import NamedTuple

import numpy as np

from cls_bench.bench import Bench
from cls_bench.drivers import scripted
from cls_bench.linear.linkage import levers
from cls_bench.linear.plant import rigid
from cls_bench.parameters import Parameters, Simulation
from cls_bench.resources import shipped_rigs
from cls_bench.rigs import THESIS, load_rig
from cls_bench.scenario import Scenario
from cls_bench.scenario.segments import Sine
from cls_bench.verification import reduced_model
from cls_bench.verification.reading import Array
from cls_bench.verification.reduced_model import Guide
from cls_bench.verification.rigs import rigs
from cls_bench.verification.row import Row
from cls_bench.verification.subject import Feedback, Subject
from cls_bench.verification.twin import Twin

GROUP, STEPS, RIGS, TWIN = "whole plant", "convergence", "whole plant of any rig", "whole plant in MuJoCo's elements"
REFERENCE = "reduced model (solve_ivp)"

ALLOWED = 1e-3
"""Deviation of the column angle that passes, as a part of the travel to one side."""

TORQUE = 0.01
"""Deviation of the motor torque that passes, r.m.s. over r.m.s."""

FINE = 32
"""Steps in a tick for the comparison over 2 s, which has to tell laws apart and not steps."""

FINEST = 64
"""Steps in a tick for the order of convergence, and for a worm: self-locking friction that gives way under a load
chatters, and its path follows the step."""


def _step(p: Parameters, substeps: int) -> float:
    """Length of a step [µs]."""
    return p.rates.clock.tick_s / substeps * 1e6


def _grown(time: Array, over: float) -> Array:
    share = np.minimum(time / over, 1.0)
    return np.asarray(share**2 * (3.0 - 2.0 * share))


# --- the thesis's rig under recorded torques ---


class Record(NamedTuple):
    """Torques [N·m] on motor and column, an entry a tick."""

    time: Array
    motor: Array
    hand: Array


@cache
def record(name: str) -> Record:
    """Torques that swing the column by ±10° at 0.5 Hz against a hand, made once with the bench itself.

    "smooth" loads the meshes on one flank only, "backlash" changes the flank at every turn of the hand.
    """
    p = Parameters()
    specimen = Subject().plant(p)
    time = specimen.times(2.0)
    grown = _grown(time, 0.5)
    ratio = p.gearbox.ratio * levers(p.linkage).ratio
    target = math.radians(10.0) * ratio * np.sin(2.0 * np.pi * 0.5 * time) * grown
    if name == "smooth":  # pulls all the time: the meshes stay on one flank
        hand = -(10.0 + 4.0 * np.sin(2.0 * np.pi * 1.3 * time)) * grown
    else:
        hand = 12.0 * np.sin(2.0 * np.pi * 1.5 * time) * grown
    acted: dict[str, Array] = {}
    specimen.run(time, {"column": hand}, feedback={"motor": Feedback(2.0, 0.05)}, target={"motor": target}, acted=acted)
    return Record(time, acted["motor"], hand)


@cache
def reference(name: str) -> Array:
    """Column angle [rad] of the reduced model under :func:`record`, at its times."""
    made = record(name)
    return reduced_model.follow(Parameters(), made.time, made.motor, made.hand)[:, 3]


def _angle(subject: Subject, name: str, substeps: int, duration: float = 2.0) -> Array:
    """Column angle [rad] of the plant under the record at every tick, with ``substeps`` steps in one."""
    specimen = subject.plant(Parameters(simulation=Simulation(substeps=substeps)))
    made, time = record(name), specimen.times(duration)
    torques = {"motor": np.interp(time, made.time, made.motor), "column": np.interp(time, made.time, made.hand)}
    return specimen.run(time, torques).angle["column"][::substeps]


def agreement(subject: Subject) -> Iterator[Row]:
    """Column angle over 2 s, for a load on one flank of the teeth and for one that crosses the backlash.

    Nothing guides the column but the two torques, and friction that ripples with the teeth makes its path unstable: a
    deviation grows up to eightyfold from the first second to the second. Hence the fine step. Then the deviation over
    the first second for steps from 50 µs down, and the order at which it falls.
    """
    p = Parameters()
    travel = p.column.travel
    for name in ("smooth", "backlash"):
        deviation = _angle(subject, name, FINE) - reference(name)
        yield Row(GROUP, f"{name} record: worst deviation of the column angle in 2 s, step {_step(p, FINE):.1f} µs",
                  "rad", 0.0, REFERENCE, _worst(deviation), ALLOWED * travel, relative=False)  # fmt: skip
    for name in ("smooth", "backlash"):
        angles = {substeps: _angle(subject, name, substeps, 1.0) for substeps in (1, 2, 4, 8)}
        for substeps, angle in angles.items():
            step, deviation = _step(p, substeps), angle - reference(name)[: len(angle)]
            yield Row(STEPS, f"{name} record: worst deviation of the column angle in 1 s, step {step:g} µs", "rad", 0.0,
                      REFERENCE, _worst(deviation), ALLOWED * travel, relative=False)  # fmt: skip
        if name == "smooth":  # the instants at which flanks change leave no order to be seen
            # From coarser steps on the error falls more slowly; at 50 µs it is less than first order would have it.
            coarse, middle, fine = (_angle(subject, name, n, 1.0) for n in (FINEST // 4, FINEST // 2, FINEST))
            order = math.log2(abs(_worst(coarse - middle) / _worst(middle - fine)))
            yield Row(STEPS, f"{name} record: order of convergence", "1", 1.0, "semi-implicit Euler", order, 0.25,
                      relative=False)  # fmt: skip


def closed_loop(subject: Subject) -> Iterator[Row]:
    """The bench as it is used: what the step of 50 µs costs where the controller guides the column."""
    scenario = Scenario(title="sweep", duration=3.0, hand=[Sine(at=0.0, amplitude_deg=10.0, frequency=0.7, fade=0.5)])
    angles = []
    for substeps in (1, 8):
        p = subject.alter(Parameters(simulation=Simulation(substeps=substeps)))
        blocks = scripted.run(Bench(p), scenario.on(p))
        angles.append(np.concatenate([block["/column.angle"] for block in blocks]))
    yield Row(STEPS, "drive on, hand sweeps ±10°: worst deviation of the column angle, step 50 µs", "rad", 0.0,
              "the same at 6.25 µs", _worst(angles[0] - angles[1]), ALLOWED * Parameters().column.travel,
              relative=False)  # fmt: skip


# --- any rig, its motor guided ---


class Exercise(NamedTuple):
    """A hand's torque [N·m] on the column, and a guide that swings the motor against it."""

    time: Array
    hand: Array
    guide: Guide


def exercise(p: Parameters) -> Exercise:
    """Half the travel to and fro at 1 Hz, against a hand of a seventh of what the load cell measures at 3 Hz; for 1 s.

    The guide makes the path stable: what deviates does not grow. It is soft enough for the column to show a hundredth
    of the friction, and its torque shows all that acts.
    """
    step = p.rates.clock.tick_s
    time = np.asarray(np.arange(round(1.0 / step) + 1) * step, dtype=np.float64)
    grown = _grown(time, 0.3)
    ratio, inertia = rigid(p)
    swing = 0.5 * p.column.travel * ratio * np.sin(2.0 * np.pi * time) * grown
    hand = p.load_cell.capacity * p.linkage.arm / 7.0 * np.sin(2.0 * np.pi * 3.0 * time) * grown
    return Exercise(time, hand, Guide(2e4 * inertia, 500.0 * inertia, swing, np.gradient(swing, step)))


def _guiding(guide: Guide, angle: Array, speed: Array) -> Array:
    return guide.stiffness * (guide.angle - angle) + guide.damping * (guide.rate - speed)


class Path(NamedTuple):
    """What came of an exercise, an entry a tick."""

    column: Array  # angle [rad]
    torque: Array  # of the guide on the motor [N·m]


def _reduced(p: Parameters, made: Exercise) -> Path:
    found = reduced_model.follow(p, made.time, np.zeros(len(made.time)), made.hand, guide=made.guide)
    coordinates = found.shape[1] // 2
    return Path(found[:, coordinates - 1], _guiding(made.guide, found[:, 0], found[:, coordinates]))


def _finer(made: Exercise, times: int) -> Exercise:
    """The same with ``times`` as many entries."""
    time = np.arange((len(made.time) - 1) * times + 1) * (made.time[1] / times)

    def between(values: Array) -> Array:
        return np.asarray(np.interp(time, made.time, values))

    guide = made.guide
    return Exercise(time, between(made.hand), guide._replace(angle=between(guide.angle), rate=between(guide.rate)))


def _stepped(subject: Subject, p: Parameters, made: Exercise, substeps: int) -> Path:
    specimen = subject.plant(p.model_copy(update={"simulation": Simulation(substeps=substeps)}))
    motor, fine = specimen.shafts[0], _finer(made, substeps)
    acted: dict[str, Array] = {}
    result = specimen.run(
        fine.time, {"column": fine.hand}, feedback={motor: Feedback(made.guide.stiffness, made.guide.damping)},
        target={motor: fine.guide.angle}, acted=acted,
    )  # fmt: skip
    return Path(result.angle["column"][::substeps], acted[motor][::substeps])


def _in_mujoco(p: Parameters, made: Exercise, substeps: int) -> Path:
    fine = _finer(made, substeps)
    twin = Twin(p.model_copy(update={"simulation": Simulation(substeps=substeps)}))
    column, torque = twin.run(fine.hand, fine.guide)
    return Path(column[::substeps], torque[::substeps])


def _is_locking(p: Parameters) -> bool:
    return any(stage.backdrive_efficiency <= 0.0 for stage in p.gearbox.in_use)


def _compared(group: str, name: str, p: Parameters, obtained: Path, expected: Path, source: str) -> Iterator[Row]:
    difference = obtained.torque - expected.torque
    yield Row(group, f"{name}: worst deviation of the column angle", "rad", 0.0, source,
              _worst(obtained.column - expected.column), ALLOWED * p.column.travel, relative=False)  # fmt: skip
    yield Row(group, f"{name}: deviation of the motor torque, r.m.s. over r.m.s.", "1", 0.0, source,
              float(np.sqrt(np.mean(difference**2) / np.mean(expected.torque**2))), TORQUE, relative=False)  # fmt: skip


@cache
def _bench(name: str) -> Parameters:
    """A rig of :mod:`cls_bench.verification.rigs`, or as ``rig NAME`` one that comes with the bench."""
    return rigs()[name] if name in rigs() else load_rig(name.removeprefix("rig ")).parameters


@cache
def _expected(name: str) -> tuple[Exercise, Path]:
    """The exercise of :func:`_bench`, and what the reduced model makes of it."""
    p = _bench(name)
    made = exercise(p)
    return made, _reduced(p, made)


def agree_on(subject: Subject, names: Iterable[str]) -> Iterator[Row]:
    """The rigs of these names against the reduced model."""
    for name in names:
        p, (made, expected) = _bench(name), _expected(name)
        substeps = FINEST if _is_locking(p) else p.simulation.substeps
        yield from _compared(
            RIGS, f"{name}, step {_step(p, substeps):.2g} µs", p, _stepped(subject, p, made, substeps), expected,
            REFERENCE,
        )  # fmt: skip


def rigs_agree(subject: Subject) -> Iterator[Row]:
    """The rigs of :mod:`cls_bench.verification.rigs`: every kind of stage and linkage."""
    yield from agree_on(subject, rigs())


def shipped_rigs_agree(subject: Subject) -> Iterator[Row]:
    """The rigs that come with the bench."""
    yield from agree_on(subject, [f"rig {name}" for name in shipped_rigs() if name != THESIS])


def agree_in_mujoco(subject: Subject, names: Iterable[str]) -> Iterator[Row]:
    """The same exercise in MuJoCo's own elements: what a viewer shows is what is stepped."""
    for name in names:
        p = _bench(name)
        made, substeps = exercise(p), FINE if _is_locking(p) else p.simulation.substeps
        yield from _compared(
            TWIN, f"{name} as MJCF, step {_step(p, substeps):.2g} µs", p, _stepped(subject, p, made, substeps),
            _in_mujoco(p, made, substeps), "MuJoCo, from the MJCF",
        )  # fmt: skip


def twins_agree(subject: Subject) -> Iterator[Row]:
    """The rigs of :mod:`cls_bench.verification.rigs` as MJCF."""
    yield from agree_in_mujoco(subject, rigs())


def _worst(deviation: Array) -> float:
    return float(deviation[np.argmax(np.abs(deviation))])
