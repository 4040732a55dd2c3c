"""Samples of a run that stay in memory: what its checks read, where no recording holds it."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cls_bench.scenario import Check, tick_of
from cls_bench.signals import PLC_TICKS, TICK_S, TOPIC, Block


class Samples(NamedTuple):
    """Signals of one topic over time."""

    time: NDArray[np.float64]
    values: Mapping[str, NDArray[np.float64]]


class Memory:
    """The signals of a run at the PLC's rate, within the windows of its checks: 0.5 MB for each second."""

    def __init__(self, checks: Sequence[Check]):
        self.topics = {path: replace(topic, ticks=PLC_TICKS) for path, topic in TOPIC.items()}
        """the topics as they are in memory, by path"""
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
        if every != 1:
            raise ValueError("what is in memory is read whole")
        known = self.topics[topic]
        names = known.names if signals is None else signals
        columns = [known.names.index(name) for name in names]
        first = -np.inf if start is None else tick_of(start)
        last = np.inf if end is None else tick_of(end)
        inside = [(ticks, rows[topic], (ticks >= first) & (ticks < last)) for ticks, rows in self._blocks]
        time = np.concatenate([np.zeros(0), *(ticks[kept] * TICK_S for ticks, _, kept in inside)])
        table = np.concatenate([np.zeros((0, len(columns))), *(rows[kept][:, columns] for _, rows, kept in inside)])
        return Samples(time, {name: np.ascontiguousarray(table[:, k]) for k, name in enumerate(names)})
