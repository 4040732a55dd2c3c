"""Run a scenario on a bench, block by block."""

from collections.abc import Iterator, Mapping
from functools import partial
from typing import Any

from cls_bench.bench import Bench
from cls_bench.drivers import timed
from cls_bench.parameters.moving import STEPPED
from cls_bench.parameters.override import override
from cls_bench.pilot import HandTimeline
from cls_bench.scenario import Scenario
from cls_bench.signals import Block


def run(bench: Bench, scenario: Scenario) -> Iterator[Block]:
    """Run ``scenario`` on a fresh ``bench``; yields and raises as :func:`cls_bench.drivers.timed.run`."""
    bench.follow({key: course for key, course in scenario.courses.items() if key not in STEPPED})
    changes = [*_switches(scenario), *_steps(scenario)]
    changes += [
        timed.Change(change.at, partial(Bench.change, mode=change.mode, power=change.power))
        for change in scenario.changes if change.mode is not None or change.power is not None
    ]  # fmt: skip
    power = scenario.drive.power == "on"
    yield from timed.run(bench, HandTimeline(scenario).sample, changes, scenario.duration, power=power)


def _switches(scenario: Scenario) -> Iterator[timed.Change]:
    """Changes of what is no number."""
    for switch in scenario.switches:
        yield timed.Change(switch.at, partial(_set, switch.values, None))


def _steps(scenario: Scenario) -> Iterator[timed.Change]:
    """Changes of numbers from which more follows than their own value."""
    for key, course in scenario.courses.items():
        if key in STEPPED:
            said: dict[int, str] = {}
            for tick, line in course.said:
                said[tick] = f"{said[tick]}; {line}" if tick in said else line
            for tick, value in zip(course.pieces["begin"].tolist(), course.pieces["end"].tolist(), strict=True):
                at = scenario.clock.time(int(tick))
                yield timed.Change(at, partial(_set, {key: value}, said.get(int(tick), "")))


def _set(values: Mapping[str, Any], said: str | None, bench: Bench) -> None:
    bench.change(override(bench.parameters, values, live_only=True), said=said)
