"""Run a bench by the clock: a hand over time, and what is done to the bench at given times."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

from cls_bench.bench import Bench
from cls_bench.hand import HandSamples
from cls_bench.signals import Block

Hands = Callable[[int, int], HandSamples | Sequence[HandSamples]]
"""The hand, or that of each axis, in some ticks: from a first one on, how many."""


@dataclass(frozen=True)
class Change:
    """What is done to a bench at a time."""

    at: float
    """[s]; it is done with the next PLC cycle"""
    make: Callable[[Bench], None]


def run(
    bench: Bench, hands: Hands, changes: Iterable[Change], duration: float, *, power: bool = True
) -> Iterator[Block]:  # fmt: skip
    """Start a fresh ``bench`` and run it for ``duration`` [s], in whole PLC cycles; yields a block for every 0.2 s at
    most.

    Changes of one PLC cycle are made in the order of their times, then as given. Raises
    :class:`~cls_bench.bench.DivergedError` when a state leaves all bounds and
    :class:`~cls_bench.errors.ControllerError` when a user's outer loop fails, in both cases after the last good block
    was yielded with an error event in it.
    """
    clock = bench.clock
    waiting = [(clock.plc_cycle(change.at), change) for change in sorted(changes, key=lambda change: change.at)]
    end = clock.plc_cycle(duration)
    bench.start(power=power)
    while bench.next_tick < end:
        while waiting and waiting[0][0] <= bench.next_tick:
            waiting.pop(0)[1].make(bench)
        until = min(end, bench.next_tick + bench.block_ticks, *(tick for tick, _ in waiting[:1]))
        block = bench.advance(hands(bench.next_tick, until - bench.next_tick), last=until == end)
        if block.ticks or bench.failure is not None:
            yield block
        if bench.failure is not None:
            raise bench.failure
