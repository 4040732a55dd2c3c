"""(a) the tick over that of the bench of one rig and over MuJoCo's step, (b) a plain-Python loop over ours, (d) a
user's outer loop over the built-in, (h) short blocks over long ones, (i) three axes over one, (k)
400 changes over none, (l) two bodies over one."""

import time

import mujoco

from benchmarks.conftest import Comparison, ratio
from benchmarks.versions import BEFORE, HERE, before, processes
from benchmarks.worker import blocks, sway
from cls_bench.bench import Bench
from cls_bench.control.outer_loop import Command, Inputs

STEPS = 20_000


def _bare() -> float:
    """Seconds a bare step of the bench's model in motion, with the torques that the laws put on its joints last."""
    scenario = sway(3600)
    bench = Bench(scenario.parameters_at_start())
    bench.compile()
    for _, _ in zip(range(5), blocks(bench, scenario), strict=False):
        pass
    mujoco.mj_step(bench.model, bench.data)
    bench.data.qfrc_applied[:] = 0.0
    start = time.perf_counter()
    mujoco.mj_step(bench.model, bench.data, STEPS)
    return (time.perf_counter() - start) / STEPS


def test_tick(comparison: Comparison) -> None:
    with before() as old, processes((HERE, ("tick",), {}), (old, ("tick",), {})) as (ours, theirs):
        times = comparison.times({"now": ours.measure, "before": theirs.measure, "bare": _bare}, 40)
    now, then, floor = (1e6 * min(times[name]) for name in ("now", "before", "bare"))
    comparison.record(
        "a", f"closed-loop tick with trace ÷ that of {BEFORE}", ratio(times, "now", "before"), most=0.62,
        detail=f"{now:.2f} µs ÷ {then:.2f} µs at best: {50 / now:.0f} times real time",
    )  # fmt: skip
    comparison.record(
        "a", "closed-loop tick with trace ÷ bare mj_step", ratio(times, "now", "bare"),
        detail=f"{now:.2f} µs ÷ {floor:.2f} µs at best",
    )  # fmt: skip


def test_plain_python_over_ours(comparison: Comparison) -> None:
    plain = (HERE, ("plain",), {"NUMBA_DISABLE_JIT": "1"})
    with processes(plain, (HERE, ("tick",), {})) as (python, ours):
        times = comparison.times({"python": python.measure, "ours": ours.measure}, 5)
    comparison.record(
        "b", "plain-Python loop ÷ ours", ratio(times, "python", "ours"), least=3,
        detail=f"{1e6 * min(times['python']):.0f} µs a tick",
    )  # fmt: skip


def test_blocks(comparison: Comparison) -> None:
    with processes((HERE, ("blocks", "10"), {}), (HERE, ("blocks", "200"), {})) as (short, long):
        times = comparison.times({"short": short.measure, "long": long.measure}, 40)
    cost = 1e6 * (min(times["short"]) - min(times["long"])) / 95  # blocks more in a second
    comparison.record(
        "h", "blocks of 10 ms ÷ blocks of 200 ms, processor time", ratio(times, "short", "long"), most=1.1,
        detail=f"{cost:.0f} µs a block",
    )  # fmt: skip


def test_axes(comparison: Comparison) -> None:
    with processes((HERE, ("axes", "3"), {}), (HERE, ("axes", "1"), {})) as (three, one):
        times = comparison.times({"three": three.measure, "one": one.measure}, 40)
    comparison.record(
        "i", "three axes in one bench ÷ one", ratio(times, "three", "one"), most=2.6,
        detail=f"{1e6 * min(times['three']):.2f} µs a tick",
    )  # fmt: skip


TWO_BODIES = 'feel.bodies="two"', "feel.linkage.backlash=0.01", "feel.linkage.override=40.0"


def test_two_bodies(comparison: Comparison) -> None:
    with processes((HERE, ("tick", *TWO_BODIES), {}), (HERE, ("tick",), {})) as (two, one):
        times = comparison.times({"two": two.measure, "one": one.measure}, 40)
    cost = 8e6 * (min(times["two"]) - min(times["one"]))  # in a PLC cycle
    comparison.record(
        "l", "tick with a feel model of two bodies ÷ one", ratio(times, "two", "one"), most=1.05,
        detail=f"{cost:.2f} µs more a PLC cycle",
    )  # fmt: skip


def test_changes(comparison: Comparison) -> None:
    with processes((HERE, ("changes", "400"), {}), (HERE, ("changes", "0"), {})) as (many, none):
        times = comparison.times({"many": many.measure, "none": none.measure}, 40)
    comparison.record(
        "k", "400 changes of a parameter ÷ none, processor time", ratio(times, "many", "none"), most=1.01,
        detail=f"5 s in {min(times['many']):.3f} s",
    )  # fmt: skip


class SpringAndMass:
    """A user's outer loop: the feel of a sprung mass, integrated by hand."""

    def __init__(self, cycle: float) -> None:
        self.cycle = cycle
        self.angle = self.velocity = 0.0

    def step(self, inputs: Inputs) -> Command:
        acceleration = (inputs.torque - 35.0 * self.angle - 1.5 * self.velocity) / 0.3
        self.velocity += self.cycle * acceleration
        self.angle += self.cycle * self.velocity
        return Command(self.angle, self.velocity, acceleration)


def _run(own: bool) -> float:
    scenario = sway(2.0)
    p = scenario.parameters_at_start()
    bench = Bench(p, controller=SpringAndMass(p.rates.plc_cycle) if own else None)
    bench.compile()
    start = time.perf_counter()
    for _ in blocks(bench, scenario):
        pass
    return time.perf_counter() - start


def test_users_outer_loop_over_built_in(comparison: Comparison) -> None:
    times = comparison.times({"user": lambda: _run(True), "built-in": lambda: _run(False)}, 20)
    comparison.record(
        "d", "outer loop in Python ÷ built-in", ratio(times, "user", "built-in"), most=1.6,
        detail=f"{2.0 / min(times['user']):.0f} times real time",
    )  # fmt: skip
