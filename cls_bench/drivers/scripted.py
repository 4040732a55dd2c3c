"""Run a scenario on a bench, block by block."""

from collections.abc import Iterator
from functools import partial

from cls_bench.bench import Bench
from cls_bench.drivers import timed
from cls_bench.pilot import HandTimeline
from cls_bench.scenario import Change, Scenario
from cls_bench.signals import Block


def run(bench: Bench, scenario: Scenario) -> Iterator[Block]:
    """Run ``scenario`` on a fresh ``bench``; yields and raises as :func:`cls_bench.drivers.timed.run`."""
    changes = [timed.Change(change.at, partial(_make, change)) for change in scenario.changes]
    power = scenario.drive.power == "on"
    return timed.run(bench, HandTimeline(scenario).sample, changes, scenario.duration, power=power)


def _make(change: Change, bench: Bench) -> None:
    after = change.apply(bench.parameters) if change.parameters else None
    bench.change(after, mode=change.mode, power=change.power)
