"""(a) the tick over MuJoCo's step, (b) a plain-Python loop over ours, (d) a user's outer loop over the built-in."""

import json
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any, Self

import mujoco
import numpy as np

from benchmarks.conftest import Comparison, ratio
from benchmarks.scenarios import sway
from cls_bench import tick
from cls_bench.bench import Bench, Command, Inputs
from cls_bench.pilot import HandTimeline
from cls_bench.plant import sensors
from cls_bench.signals import PLC_S

TICKS = 4000


class Stepper:
    """A bench in motion, advanced by a few ticks at a time, with the bare step of the same model from the same state.

    For the bare step the inputs and all that the laws set from tick to tick stay as they were.
    """

    MODEL = (
        "tendon_lengthspring", "tendon_stiffness", "tendon_damping", "wrap_prm", "actuator_biasprm",
        "actuator_gainprm", "actuator_dynprm",
    )  # fmt: skip

    def __init__(self) -> None:
        scenario = sway(3600)
        self.bench = Bench(scenario.parameters_at_start(), seed=1)
        self.bench.compile()
        self.timeline = HandTimeline(scenario)
        blocks = self.bench.run(scenario)
        for _ in range(5):
            next(blocks)
        self._kind = mujoco.mjtState.mjSTATE_INTEGRATION
        self._state = np.zeros(mujoco.mj_stateSize(self.bench.model, self._kind))

    def bare(self) -> float:
        """Seconds of the bare steps."""
        model, data = self.bench.model, self.bench.data
        mujoco.mj_getState(model, data, self._state, self._kind)
        start = time.perf_counter()
        mujoco.mj_step(model, data, TICKS)
        taken = time.perf_counter() - start
        mujoco.mj_setState(model, data, self._state, self._kind)
        return taken

    def closed(self) -> float:
        """Seconds of as many ticks of the closed loop, trace included."""
        bench, first = self.bench, self.bench._tick
        hand = tick.Hand.of(self.timeline.sample(first, TICKS))
        noise = bench._rng.standard_normal((TICKS, sensors.NOISES))
        _, trace = bench._buffers(first, TICKS)
        start = time.perf_counter()
        done = bench._advance(hand, noise, trace, first, TICKS)
        taken = time.perf_counter() - start
        assert done == TICKS
        bench._tick += TICKS
        return taken


def test_tick_over_step(comparison: Comparison) -> None:
    stepper = Stepper()
    times = comparison.times({"bare": stepper.bare, "closed": stepper.closed}, 100)
    floor, cost = (1e6 * min(times[name]) / TICKS for name in ("bare", "closed"))
    comparison.record(
        "a", "closed-loop tick with trace ÷ bare mj_step", ratio(times, "closed", "bare"), most=1.05,
        detail=f"{cost:.2f} µs ÷ {floor:.2f} µs at best: {50 / cost:.1f} times real time",
    )  # fmt: skip


class PlainPython:
    """The same loop as plain Python on MuJoCo's bindings, in a process without numba's compiler."""

    def __enter__(self) -> Self:
        self._process = subprocess.Popen(
            [sys.executable, "-m", "benchmarks.plain_python"], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
            text=True, env=os.environ | {"NUMBA_DISABLE_JIT": "1"}, cwd=Path(__file__).parents[1],
        )  # fmt: skip
        return self

    def __exit__(self, *_: object) -> None:
        self._process.communicate("")

    def run(self) -> float:
        """Seconds a tick."""
        stdin, stdout = self._process.stdin, self._process.stdout
        assert stdin is not None
        assert stdout is not None
        stdin.write("run\n")
        stdin.flush()
        return float(json.loads(stdout.readline()))


def test_plain_python_over_ours(comparison: Comparison) -> None:
    stepper = Stepper()
    with PlainPython() as plain:
        times = comparison.times({"python": plain.run, "ours": lambda: stepper.closed() / TICKS}, 30)
    cost = 1e6 * min(times["python"])
    comparison.record(
        "b", "plain-Python loop ÷ ours", ratio(times, "python", "ours"), least=3, detail=f"{cost:.0f} µs a tick"
    )


class SpringAndMass:
    """A user's outer loop: the feel of a sprung mass, integrated by hand."""

    def __init__(self) -> None:
        self.angle = self.velocity = 0.0

    def step(self, inputs: Inputs) -> Command:
        acceleration = (inputs.torque - 35.0 * self.angle - 1.5 * self.velocity) / 0.3
        self.velocity += PLC_S * acceleration
        self.angle += PLC_S * self.velocity
        return Command(self.angle, self.velocity, acceleration)


def _run(controller: Any) -> float:
    scenario = sway(0.5)
    bench = Bench(scenario.parameters_at_start(), controller=controller)
    bench.compile()
    start = time.perf_counter()
    for _ in bench.run(scenario):
        pass
    return time.perf_counter() - start


def test_users_outer_loop_over_built_in(comparison: Comparison) -> None:
    times = comparison.times({"user": lambda: _run(SpringAndMass()), "built-in": lambda: _run(None)}, 20)
    factor = 0.5 / min(times["user"])
    comparison.record(
        "d", "outer loop in Python ÷ built-in", ratio(times, "user", "built-in"), most=1.6,
        detail=f"{factor:.1f} times real time",
    )  # fmt: skip
