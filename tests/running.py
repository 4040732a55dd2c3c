"""Runs a scenario text, or a bench by hand, and hands out the signals as whole arrays; for tests only."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cls_bench.bench import Bench
from cls_bench.control.outer_loop import OuterLoop
from cls_bench.drivers import scripted
from cls_bench.hand import HandSamples
from cls_bench.parameters import Parameters
from cls_bench.parameters.override import override
from cls_bench.scenario import parse_scenario
from cls_bench.signals import Block, Event, Topic


class Run(NamedTuple):
    """What a run left: signals by name such as "/column.angle", events, and the bench itself."""

    signals: dict[str, NDArray[np.float64]]
    events: list[Event]
    bench: Bench
    error: Exception | None

    def __getitem__(self, name: str) -> NDArray[np.float64]:
        return self.signals[name]

    def topic(self, path: str) -> Topic:
        """The topic of that path."""
        return next(topic for topic in self.bench.topics if topic.path == path)

    def time(self, path: str) -> NDArray[np.float64]:
        """Times of a topic's rows [s]."""
        topic = self.topic(path)
        rows = len(self.signals[f"{path}.{topic.names[0]}"])
        return np.arange(rows) * topic.ticks * self.bench.clock.tick_s

    def between(self, name: str, start: float, end: float) -> NDArray[np.float64]:
        """The part of a signal with start ≤ t < end [s]."""
        t = self.time(name.partition(".")[0])
        return self.signals[name][(t >= start - 1e-9) & (t < end - 1e-9)]

    def same_samples(self, other: "Run") -> bool:
        """Whether all signals agree bit for bit."""
        return self.signals.keys() == other.signals.keys() and all(
            np.array_equal(self.signals[name], other.signals[name]) for name in self.signals
        )


def run(
    toml: str = "", *, duration: float = 0.2, set: Sequence[str] = (), seed: int | None = None,
    controller: OuterLoop | Any = None, block_ticks: int | None = None,
) -> Run:  # fmt: skip
    """Run the scenario of title, ``duration`` and ``toml``; an error that ends the run is kept in the result."""
    text = f'title = "test"\nduration = {duration!r}\n{toml}'
    scenario = parse_scenario(text, set=set, seed=seed)
    bench = Bench(scenario.parameters_at_start(), seed=scenario.seed, controller=controller)
    if block_ticks is not None:
        bench.block_ticks = block_ticks
    return collected(bench, scripted.run(bench, scenario))


def collected(bench: Bench, blocks: Iterable[Block]) -> Run:
    """The blocks of a run one after the other; an error that ends them is kept in the result."""
    rows: dict[str, list[NDArray[np.float64]]] = {topic.path: [] for topic in bench.topics}
    events: list[Event] = []
    failure = None
    try:
        for block in blocks:
            for topic, values in block:
                rows[topic.path].append(values)
            events += block.events
    except Exception as error:
        failure = error
    signals = {}
    for topic in bench.topics:
        parts = rows[topic.path]
        table = np.concatenate(parts) if parts else np.zeros((0, len(topic.names)))
        signals |= {f"{topic.path}.{name}": table[:, k] for k, name in enumerate(topic.names)}
    return Run(signals, events, bench, failure)


# --- a bench by hand --------------------------------------------------------------------------------------------------


def parameters(values: Mapping[str, Any] = {}, base: Parameters | None = None) -> Parameters:
    """Parameters with other values by dotted key: ``parameters({"feel.inertia": 0.5})``."""
    table: dict[str, Any] = {}
    for key, value in values.items():
        *parents, last = key.split(".")
        inner = table
        for parent in parents:
            inner = inner.setdefault(parent, {})
        inner[last] = value
    return override(base or Parameters(), table)


def hold(ticks: int) -> HandSamples:
    """A hand that holds the column at neutral, firmly."""
    return swaying(0, ticks, 0.0, 1.0)


def swaying(first: int, ticks: int, amplitude: float, frequency: float, tick_s: float = 50e-6) -> HandSamples:
    """A hand that sways from tick ``first`` on by ± ``amplitude`` [rad] at ``frequency`` [Hz]."""
    omega = 2.0 * np.pi * frequency
    t = np.arange(first, first + ticks) * tick_s
    yes, none = np.ones(ticks, np.bool_), np.zeros(ticks)
    return HandSamples(
        amplitude * np.sin(omega * t), amplitude * omega * np.cos(omega * t), none, yes, yes, np.full(ticks, 0.5)
    )


def off(ticks: int) -> HandSamples:
    """No hand on the grip."""
    none, no = np.zeros(ticks), np.zeros(ticks, np.bool_)
    return HandSamples(none, none, none, no, no, none)


def advanced(
    bench: Bench, duration: float, *, amplitude: float = 0.1, frequency: float = 3.0, blocks: Sequence[int] = (),
    power: bool = True,
) -> Iterator[Block]:  # fmt: skip
    """Start ``bench`` and advance it by ``duration`` [s] under a swaying hand on every axis.

    In blocks of ``blocks`` ticks, over and over; of the longest where none are given.
    """
    clock = bench.clock
    end = -(-clock.tick_of(duration) // clock.plc_ticks) * clock.plc_ticks
    bench.start(power=power)
    number = 0
    while bench.next_tick < end:
        ticks = min(blocks[number % len(blocks)] if blocks else bench.block_ticks, end - bench.next_tick)
        number += 1
        hand = swaying(bench.next_tick, ticks, amplitude, frequency, clock.tick_s)
        yield bench.advance([hand] * len(bench.axes))
        if bench.failure is not None:
            raise bench.failure
