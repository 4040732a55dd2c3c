"""Evaluate a scenario at a point without writing a recording: only what the checks read is kept, in memory."""

import math
import threading
from collections.abc import Mapping
from dataclasses import dataclass

from cls_bench.analysis.memory import Memory
from cls_bench.bench import Bench, DivergedError
from cls_bench.control.outer_loop import OuterLoop
from cls_bench.drivers import scripted
from cls_bench.errors import ControllerError
from cls_bench.experiment import CONTROLLER_FAILED, ending, make_controller, measure
from cls_bench.parameters import Parameters
from cls_bench.rigs import Rig
from cls_bench.scenario import Scenario
from cls_bench.sweep.engine import Point, Value
from cls_bench.sweep.plan import Plan

_used = threading.local()
"""The bench that a thread's last point was run on."""


def _bench(parameters: Parameters, seed: int, loop: OuterLoop | None) -> Bench:
    """A bench at its start: the one that this thread has, if it is of the same shape, else a new one."""
    if loop is not None:
        return Bench(parameters, seed=seed, controller=loop, poses=False)
    bench: Bench | None = getattr(_used, "bench", None)
    try:
        if bench is not None:
            bench.reset(parameters, seed=seed)
            return bench
    except ValueError:  # other stages or rates
        pass
    _used.bench = None  # one at a time is kept
    _used.bench = Bench(parameters, seed=seed, poses=False)
    made: Bench = _used.bench
    return made


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
    bench = _bench(parameters, scenario.seed, loop)
    memory = Memory(scenario.checks, bench.clock, bench.topics)
    failure: DivergedError | ControllerError | None = None
    try:
        for block in scripted.run(bench, scenario):
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

    scenario: Scenario
    """with the checks that are collected, and its files as they were when the sweep began"""
    rigs: Mapping[str, Rig]
    """those that an axis chooses among, as they were then"""

    @classmethod
    def of(cls, plan: Plan) -> "ScenarioAt":
        """What evaluates the points of ``plan``."""
        return cls(plan.scenario.with_checks(plan.checks), plan.rigs)

    def __call__(self, point: Point) -> Mapping[str, Value]:
        """Status, message and metrics at ``point``."""
        rig = self.rigs.get(str(point["rig"])) if "rig" in point else None
        return measure_in_memory(self.scenario.changed(point, rig=rig))
