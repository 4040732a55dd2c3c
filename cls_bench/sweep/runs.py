"""Evaluate a scenario at a point without writing a recording: only what the checks read is kept, in memory."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from cls_bench.analysis.memory import Memory
from cls_bench.bench import Bench, DivergedError
from cls_bench.errors import ControllerError
from cls_bench.experiment import CONTROLLER_FAILED, ending, make_controller, measure
from cls_bench.scenario import Check, Scenario, parse_scenario
from cls_bench.sweep.engine import Point, Value
from cls_bench.sweep.plan import Plan, override


def measure_in_memory(scenario: Scenario) -> dict[str, Value]:
    """Run ``scenario`` and return its status, what went wrong (``message``), and its checks' values by name.

    Checks whose window a run did not reach are NaN, all of them if its controller could not be made. Raises InputError
    if the bench cannot be built.
    """
    parameters = scenario.parameters_at_start()
    try:
        loop = make_controller(scenario, parameters)
    except ControllerError as error:  # no run came of it, so there is nothing to measure
        nothing = dict.fromkeys((check.name for check in scenario.checks), math.nan)
        return {"status": CONTROLLER_FAILED, "message": str(error), **nothing}
    bench = Bench(parameters, seed=scenario.seed, controller=loop)
    memory = Memory(scenario.checks)
    failure: DivergedError | ControllerError | None = None
    try:
        for block in bench.run(scenario):
            memory.keep(block)
    except (DivergedError, ControllerError) as error:
        failure = error
    results = measure(scenario, memory, own_loop=scenario.controller is not None)
    found = ending(scenario, bench.trips, failure).judged(results)
    values = {result.check.name: float(result.value) for result in results}
    return {"status": found.status, "message": found.message, **values}


@dataclass(frozen=True)
class ScenarioAt:
    """Evaluates a scenario at a point of a sweep."""

    source: bytes
    path: Path | None
    checks: tuple[Check, ...]
    samples: Mapping[str, bytes] | None
    """sample files as they were when the sweep began; None where an axis chooses them"""

    @classmethod
    def of(cls, plan: Plan) -> "ScenarioAt":
        """What evaluates the points of ``plan``."""
        chosen = any(axis.key.endswith(".file") for axis in plan.sweep.axes)
        samples = None if chosen else dict(plan.scenario.sample_files)
        return cls(plan.scenario.source, plan.scenario.path, plan.checks, samples)

    def __call__(self, point: Point) -> Mapping[str, Value]:
        """Status, message and metrics at ``point``."""
        overrides = [override(key, value) for key, value in point.items()]
        scenario = parse_scenario(self.source, path=self.path, set=overrides, sample_files=self.samples)
        return measure_in_memory(scenario.with_checks(self.checks))
