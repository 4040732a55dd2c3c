"""Evaluate a scenario at a point without writing a recording: only what the checks read is kept, in memory."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cls_bench.bench import Bench, DivergedError
from cls_bench.errors import ControllerError
from cls_bench.experiment import CONTROLLER_FAILED, DIVERGED, FAILED, PASSED, make_controller, measure
from cls_bench.scenario import Check, Scenario, parse_scenario, tick_of
from cls_bench.signals import PLC_TICKS, TOPIC, Block
from cls_bench.sweep.engine import Point, Value
from cls_bench.sweep.plan import Plan, override


class Samples(NamedTuple):
    """Signals of one topic over time."""

    values: Mapping[str, NDArray[np.float64]]


class Memory:
    """The signals of a run at the PLC's rate, within the windows of its checks: 0.5 MB for each second."""

    def __init__(self, checks: Sequence[Check]):
        self._windows = {(tick_of(check.window[0]), tick_of(check.window[1])) for check in checks}
        self._blocks: list[tuple[NDArray[np.int64], dict[str, NDArray[np.float64]]]] = []

    def keep(self, block: Block) -> None:
        """Take over what the checks will read of ``block``."""
        if any(start < block.end_tick and block.first_tick < end for start, end in self._windows):
            rows = {topic.path: self._thinned(block, topic.path) for topic in TOPIC.values()}
            self._blocks.append((block.row_ticks(PLC_TICKS), rows))

    @staticmethod
    def _thinned(block: Block, path: str) -> NDArray[np.float64]:
        every = TOPIC[path].ticks
        rows: NDArray[np.float64] = block.signals[path][block.row_ticks(every) % PLC_TICKS == 0]
        return rows

    def read(
        self,
        topic: str,
        signals: Sequence[str] | None = None,
        start: float | None = None,
        end: float | None = None,
        every: int = 1,
    ) -> Samples:
        """As :meth:`cls_bench.analysis.window.Source.read`, at the PLC's rate."""
        known = TOPIC[topic]
        if every * known.ticks != PLC_TICKS:
            raise ValueError(f"only rows every {PLC_TICKS} ticks are in memory")
        names = known.names if signals is None else signals
        columns = [known.names.index(name) for name in names]
        first = -np.inf if start is None else tick_of(start)
        last = np.inf if end is None else tick_of(end)
        parts = [rows[topic][(ticks >= first) & (ticks < last)][:, columns] for ticks, rows in self._blocks]
        table = np.concatenate(parts) if parts else np.zeros((0, len(columns)))
        return Samples({name: np.ascontiguousarray(table[:, k]) for k, name in enumerate(names)})


def measure_in_memory(scenario: Scenario) -> dict[str, Value]:
    """Run ``scenario`` and return its status, what went wrong (``message``), and its checks' values by name.

    Checks whose window a diverged run did not reach are NaN. Raises InputError if the bench cannot be built.
    """
    parameters = scenario.parameters_at_start()
    bench = Bench(parameters, seed=scenario.seed, controller=make_controller(scenario, parameters))
    memory, message, status = Memory(scenario.checks), "", ""
    try:
        for block in bench.run(scenario):
            memory.keep(block)
    except DivergedError as error:
        message, status = str(error), DIVERGED
    except ControllerError as error:
        message, status = str(error), CONTROLLER_FAILED
    results = measure(scenario, memory)
    status = status or (PASSED if all(result.passed for result in results) else FAILED)
    return {"status": status, "message": message, **{result.check.name: float(result.value) for result in results}}


@dataclass(frozen=True)
class ScenarioAt:
    """Evaluates a scenario at a point of a sweep."""

    source: bytes
    path: Path | None
    checks: tuple[Check, ...]

    @classmethod
    def of(cls, plan: Plan) -> "ScenarioAt":
        """What evaluates the points of ``plan``."""
        return cls(plan.scenario.source, plan.scenario.path, plan.checks)

    def __call__(self, point: Point) -> Mapping[str, Value]:
        """Status, message and metrics at ``point``."""
        overrides = [override(key, value) for key, value in point.items()]
        scenario = parse_scenario(self.source, path=self.path, set=overrides)
        return measure_in_memory(scenario.with_checks(self.checks))
