"""Samples of a run that stay in memory: what its checks read, where no recording holds it."""

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cls_bench.analysis.metrics import signals_of
from cls_bench.errors import InputError
from cls_bench.scenario import Check
from cls_bench.signals import Block, Clock, Column, Topic


class Memory:
    """What the checks of a run read, within their windows and at the PLC's rate: 20 kB for each signal and second.

    ``clock`` and ``topics`` are those of the run.
    """

    def __init__(self, checks: Sequence[Check], clock: Clock, topics: Iterable[Topic]):
        self.clock = clock
        """rates of the run"""
        self.topics = {topic.path: replace(topic, ticks=clock.plc_ticks) for topic in topics}
        """the topics as they are in memory, by path"""
        there = {f"{topic.path}.{name}" for topic in self.topics.values() for name in topic.names}
        self._wanted = [
            (clock.tick_of(check.window[0]), clock.tick_of(check.window[1]), signals_of(check) & there)
            for check in checks
        ]
        self._known = frozenset[str]().union(*(signals for *_, signals in self._wanted))
        self._blocks: list[tuple[range, dict[str, NDArray[np.float64]]]] = []

    def keep(self, block: Block) -> None:
        """Take over what the checks will read of ``block``. ValueError if it is of a run with another clock."""
        if block.clock != self.clock:
            raise ValueError(f"a block of {block.clock} for checks at {self.clock}")
        wanted: set[str] = set()
        for start, end, signals in self._wanted:
            if start < block.end_tick and block.first_tick < end:
                wanted |= signals
        if wanted:
            every = self.clock.plc_ticks
            first = -(-block.first_tick // every) * every
            columns = {signal: self._thinned(block, signal) for signal in wanted}
            self._blocks.append((range(first, block.end_tick, every), columns))

    def _thinned(self, block: Block, signal: str) -> NDArray[np.float64]:
        ticks = block.row_ticks(block.topic(signal.rpartition(".")[0]).ticks)
        column: NDArray[np.float64] = block[signal][ticks % self.clock.plc_ticks == 0]
        return column

    def samples_at(self, signal: str, ticks: range) -> Column:
        """As :meth:`cls_bench.analysis.window.Source.samples_at`; ``ticks`` are the PLC's.

        Raises KeyError for a signal that no check is said to read.
        """
        path, _, name = signal.rpartition(".")
        if path not in self.topics or name not in self.topics[path].names:
            raise InputError(f"the run has no {signal}; it has {', '.join(self.topics)}")
        if signal not in self._known:
            raise KeyError(f"no check reads {signal}")
        at: list[NDArray[np.int64]] = [np.zeros(0, np.int64)]
        parts: list[NDArray[np.float64]] = [np.zeros(0)]
        for rows, columns in self._blocks:
            if rows and rows[0] < ticks.stop and rows[-1] >= ticks.start and signal in columns:
                own = np.array(rows, np.int64)
                kept = (own >= ticks.start) & (own < ticks.stop)
                at.append(own[kept])
                parts.append(columns[signal][kept])
        return Column(np.concatenate(at), np.concatenate(parts))
