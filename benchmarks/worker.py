"""A version's own work, timed in a process of its own: for each line on standard input one measurement in seconds.

``python worker.py WHAT``, with that version's package on the path; the same file serves versions before and after the
bench became a stepper. WHAT: ``tick`` (µs would be too small a unit: seconds a tick), ``axes N`` (the same, with N axes
in one bench), ``run none|mcap|both`` (a run of 4 s), ``blocks MS`` (processor time of a simulated second in blocks of
that length), ``changes N`` (processor time of a run of 5 s with N changes of a parameter), ``plain`` (a tick of the
loop as plain Python).
"""

import inspect
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from cls_bench.bench import Bench
from cls_bench.scenario import parse_scenario

SWAY = """
title = "The hand sways the column, the drive is on"
duration = {duration}
[[hand]]
at = 0.0
kind = "sine"
amplitude_deg = 8.0
frequency = 1.0
"""

BLOCKS = 10
"""Blocks of 0.2 s in a measurement of the tick."""


def sway(duration: float, overrides: Sequence[str] = ()) -> Any:
    """The column follows a hand that moves by ±8° at 1 Hz: all friction elements slide and stick, all loops work."""
    return parse_scenario(SWAY.format(duration=float(duration)), name="sway", set=overrides)


def blocks(bench: Any, scenario: Any) -> Iterator[Any]:
    """The blocks of a run, in this version's way."""
    if hasattr(bench, "run"):
        return iter(bench.run(scenario))
    from cls_bench.drivers import scripted

    return scripted.run(bench, scenario)


def tick(*overrides: str) -> Callable[[], float]:
    """Seconds a tick of the closed loop, trace and what a block costs included."""
    scenario = sway(3600, overrides)
    bench = Bench(scenario.parameters_at_start())
    bench.compile()
    run = blocks(bench, scenario)

    def measure() -> float:
        start = time.perf_counter()
        ticks = sum(next(run).ticks for _ in range(BLOCKS))
        return (time.perf_counter() - start) / float(ticks)

    return measure


def axes(count: int) -> Callable[[], float]:
    """The same with some axes, all swayed alike."""
    from cls_bench.pilot import HandTimeline

    scenario = sway(3600)
    parameters = scenario.parameters_at_start()
    bench = Bench({f"axis{k}": parameters for k in range(count)} if count > 1 else parameters)
    bench.compile()
    bench.start()
    timeline = HandTimeline(scenario)

    def measure() -> float:
        taken = 0.0
        for _ in range(BLOCKS):
            hand = timeline.sample(bench.next_tick, bench.block_ticks)
            start = time.perf_counter()
            bench.advance([hand] * count)
            taken += time.perf_counter() - start
        return taken / (BLOCKS * bench.block_ticks)

    return measure


def run(kind: str) -> Callable[[], float]:
    """Seconds of a run of 4 s from its first tick until its files are closed."""
    from cls_bench.experiment import run_info
    from cls_bench.recording import Recorder

    scenario, folder = sway(4.0), Path(tempfile.mkdtemp())
    Bench(scenario.parameters_at_start()).compile()

    def measure() -> float:
        bench = Bench(scenario.parameters_at_start())
        if kind == "none":
            start = time.perf_counter()
            for _ in blocks(bench, scenario):
                pass
            return time.perf_counter() - start
        shutil.rmtree(folder, ignore_errors=True)
        given: Any = ({},) if "controller" in inspect.signature(run_info).parameters else ()
        topics: Any = {"topics": bench.topics} if "topics" in inspect.signature(Recorder).parameters else {}
        info = run_info(scenario, bench, *given)
        with Recorder(folder / "run", info, rerun=kind == "both", **topics) as recorder:
            start = time.perf_counter()
            for block in blocks(bench, scenario):
                recorder.write(block)
            recorder.finish("complete")
            return time.perf_counter() - start

    return measure


def in_blocks(milliseconds: float) -> Callable[[], float]:
    """Processor time of a simulated second, driven in blocks of that length."""
    from cls_bench.pilot import HandTimeline

    scenario = sway(3600)
    bench = Bench(scenario.parameters_at_start())
    bench.compile()
    bench.start()
    timeline, ticks = HandTimeline(scenario), bench.clock.tick_of(1e-3 * milliseconds)
    count = round(1.0 / (ticks * bench.clock.tick_s))

    def measure() -> float:
        hands = [timeline.sample(bench.next_tick + k * ticks, ticks) for k in range(count)]
        start = time.process_time()
        for hand in hands:
            bench.advance(hand)
        return time.process_time() - start

    return measure


def changes(count: int) -> Callable[[], float]:
    """Processor time of a run of 5 s with some changes of a parameter in it, 10 ms apart, hardly to be felt."""
    text = SWAY.format(duration=5.0) + "".join(
        f"[[changes]]\nat = {0.5 + 0.01 * k:.2f}\nparameters.feel.stiffness = {35 + 0.01 * (k % 2):.2f}\n"
        for k in range(count)
    )
    scenario = parse_scenario(text, name="sway")
    bench = Bench(scenario.parameters_at_start())
    bench.compile()

    def measure() -> float:
        bench.reset()
        start = time.process_time()
        for _ in blocks(bench, scenario):
            pass
        return time.process_time() - start

    return measure


def plain() -> Callable[[], float]:
    """Seconds a tick of the same laws on MuJoCo's bindings, as a user would write them: plain Python, plain objects."""
    from cls_bench import tick as loop
    from cls_bench.compiled import JIT
    from cls_bench.pilot import HandTimeline

    assert not JIT
    scenario, ticks = sway(3600), 400
    bench = Bench(scenario.parameters_at_start())
    bench.start()
    timeline = HandTimeline(scenario)
    bodies = _Table([_plain(record) for record in bench._axes])
    none = np.zeros((0, 4), np.int64)  # a user would not copy numbers one by one from array to array
    at = 0

    def measure() -> float:
        nonlocal at
        hand = loop.Hand.of([timeline.sample(at, ticks)])
        noise = bench._streams.draw(ticks, bench._chances)
        trace = bench._room(at, ticks)._replace(tick=none, drive=none, plc=none)
        start = time.perf_counter()
        loop.advance(
            bench.plant, bodies, bench._watched, hand, noise, trace, bench._bodies, bench._cycles,
            *getattr(bench, "_courses", ()), bench._bound, bench._warned, at, ticks, 0,
        )  # fmt: skip
        at += ticks
        return (time.perf_counter() - start) / ticks

    return measure


def _plain(record: Any) -> Any:
    """A NumPy record as a plain object with plain numbers; arrays stay."""
    if getattr(record, "dtype", None) is not None and record.dtype.names:
        if record.shape:
            return [_plain(entry) for entry in record]
        return SimpleNamespace(**{name: _plain(record[name]) for name in record.dtype.names})
    return record if np.ndim(record) else record.item() if hasattr(record, "item") else record


class _Table(list):  # type: ignore[type-arg]
    """Axes."""

    @property
    def shape(self) -> tuple[int]:
        return (len(self),)


WHAT: dict[str, Callable[..., Callable[[], float]]] = {
    "tick": tick, "plain": plain, "run": run,
    "changes": lambda count: changes(int(count)),
    "axes": lambda count: axes(int(count)), "blocks": lambda length: in_blocks(float(length)),
}  # fmt: skip


def main(what: str, *arguments: str) -> None:
    """Measure once for each line."""
    measure = WHAT[what](*arguments)
    measure()
    for _ in sys.stdin:
        print(measure(), flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
