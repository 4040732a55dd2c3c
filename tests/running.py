"""Runs a scenario text and hands out its signals as whole arrays; for tests only."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cls_bench.bench import Bench, OuterLoop
from cls_bench.scenario import parse_scenario
from cls_bench.signals import TICK_S, TOPIC, TOPICS, Event


class Run(NamedTuple):
    """What a run left: signals by name such as "/column.angle", events, and the bench itself."""

    signals: dict[str, NDArray[np.float64]]
    events: list[Event]
    bench: Bench
    error: Exception | None

    def __getitem__(self, name: str) -> NDArray[np.float64]:
        return self.signals[name]

    def time(self, topic: str) -> NDArray[np.float64]:
        """Times of a topic's rows [s]."""
        rows = len(self.signals[f"{topic}.{TOPIC[topic].names[0]}"])
        return np.arange(rows) * TOPIC[topic].ticks * TICK_S

    def between(self, name: str, start: float, end: float) -> NDArray[np.float64]:
        """The part of a signal with start ≤ t < end [s]."""
        t = self.time(name.partition(".")[0])
        return self.signals[name][(t >= start - 1e-9) & (t < end - 1e-9)]

    def same_samples(self, other: "Run") -> bool:
        """Whether all signals agree bit for bit."""
        return all(np.array_equal(self.signals[name], other.signals[name]) for name in self.signals)


def run(
    toml: str = "", *, duration: float = 0.2, set: Sequence[str] = (), seed: int | None = None,
    controller: OuterLoop | Any = None,
) -> Run:  # fmt: skip
    """Run the scenario of title, ``duration`` and ``toml``; an error that ends the run is kept in the result."""
    text = f'title = "test"\nduration = {duration!r}\n{toml}'
    scenario = parse_scenario(text, set=set, seed=seed)
    bench = Bench(scenario.parameters_at_start(), seed=scenario.seed, controller=controller)
    rows: dict[str, list[NDArray[np.float64]]] = {topic.path: [] for topic in TOPICS}
    events: list[Event] = []
    failure = None
    try:
        for block in bench.run(scenario):
            for topic, values in block:
                rows[topic.path].append(values)
            events += block.events
    except Exception as error:
        failure = error
    signals = {}
    for path, parts in rows.items():
        table = np.concatenate(parts) if parts else np.zeros((0, len(TOPIC[path].names)))
        signals |= {f"{path}.{name}": table[:, k] for k, name in enumerate(TOPIC[path].names)}
    return Run(signals, events, bench, failure)
