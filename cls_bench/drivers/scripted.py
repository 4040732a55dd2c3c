"""Run a scenario on a bench, block by block."""

from collections.abc import Iterator

from cls_bench.bench import Bench
from cls_bench.pilot import HandTimeline
from cls_bench.scenario import Change, Scenario
from cls_bench.signals import Block, Clock


def run(bench: Bench, scenario: Scenario) -> Iterator[Block]:
    """Run ``scenario`` on a fresh ``bench``; yields a block for every 0.2 s at most.

    Raises :class:`~cls_bench.bench.DivergedError` when a state leaves all bounds and
    :class:`~cls_bench.errors.ControllerError` when a user's outer loop fails, in both cases after the last good block
    was yielded with an error event in it.
    """
    clock = bench.clock
    timeline = HandTimeline(scenario)
    changes = sorted(scenario.changes, key=lambda change: change.at)
    bench.start(power=scenario.drive.power == "on")
    end = -(-scenario.ticks // clock.plc_ticks) * clock.plc_ticks
    while bench.next_tick < end:
        while changes and _cycle_start(changes[0], clock) <= bench.next_tick:
            change = changes.pop(0)
            after = change.apply(bench.parameters) if change.parameters else None
            bench.change(after, mode=change.mode, power=change.power)
        until = min(end, bench.next_tick + bench.block_ticks, *(_cycle_start(change, clock) for change in changes[:1]))
        block = bench.advance(timeline.sample(bench.next_tick, until - bench.next_tick), last=until == end)
        if block.ticks or bench.failure is not None:
            yield block
        if bench.failure is not None:
            raise bench.failure


def _cycle_start(change: Change, clock: Clock) -> int:
    """Changes take effect with the next PLC cycle."""
    return -(-clock.tick_of(change.at) // clock.plc_ticks) * clock.plc_ticks
