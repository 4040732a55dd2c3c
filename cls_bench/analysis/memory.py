"""Samples of a run that stay in memory: what its checks read, where no recording holds it."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cls_bench.analysis.metrics import signals_of
from cls_bench.analysis.window import split_signal
from cls_bench.scenario import Check, tick_of
from cls_bench.signals import PLC_TICKS, TICK_S, TOPIC, Block


class Samples(NamedTuple):
    """Signals of one topic over time."""

    time: NDArray[np.float64]
    values: Mapping[str, NDArray[np.float64]]


class Memory:
    """What the checks of a run read, within their windows and at the PLC's rate: 20 kB for each signal and second."""

    def __init__(self, checks: Sequence[Check]):
        self.topics = {path: replace(topic, ticks=PLC_TICKS) for path, topic in TOPIC.items()}
        """the topics as they are in memory, by path"""
        self._wanted = [(tick_of(check.window[0]), tick_of(check.window[1]), signals_of(check)) for check in checks]
        self._known = frozenset[str]().union(*(signals for *_, signals in self._wanted))
        self._blocks: list[tuple[range, dict[str, NDArray[np.float64]]]] = []

    def keep(self, block: Block) -> None:
        """Take over what the checks will read of ``block``."""
        wanted: set[str] = set()
        for start, end, signals in self._wanted:
            if start < block.end_tick and block.first_tick < end:
                wanted |= signals
        if wanted:
            first = -(-block.first_tick // PLC_TICKS) * PLC_TICKS
            columns = {signal: self._thinned(block, signal) for signal in wanted}
            self._blocks.append((range(first, block.end_tick, PLC_TICKS), columns))

    @staticmethod
    def _thinned(block: Block, signal: str) -> NDArray[np.float64]:
        every = TOPIC[split_signal(signal)[0]].ticks
        column: NDArray[np.float64] = block[signal][block.row_ticks(every) % PLC_TICKS == 0]
        return column

    def read(
        self,
        topic: str,
        signals: Sequence[str] | None = None,
        start: float | None = None,
        end: float | None = None,
        every: int = 1,
    ) -> Samples:
        """As :meth:`cls_bench.analysis.window.Source.read`, at the PLC's rate.

        Raises KeyError for a signal that no check is said to read.
        """
        if every != 1:
            raise ValueError("what is in memory is read whole")
        names = self.topics[topic].names if signals is None else signals
        paths = [f"{topic}.{name}" for name in names]
        if not self._known.issuperset(paths):
            raise KeyError(f"no check reads {', '.join(sorted({*paths} - self._known))}")
        first = -np.inf if start is None else tick_of(start)
        last = np.inf if end is None else tick_of(end)
        times: list[NDArray[np.float64]] = [np.zeros(0)]
        parts: list[list[NDArray[np.float64]]] = [[np.zeros(0)] for _ in paths]
        for rows, columns in self._blocks:
            if rows and rows[0] < last and rows[-1] >= first and columns.keys() >= {*paths}:
                ticks = np.arange(rows.start, rows.stop, rows.step, dtype=np.int64)
                kept = (ticks >= first) & (ticks < last)
                times.append(np.asarray(ticks[kept] * TICK_S, np.float64))
                for path, part in zip(paths, parts, strict=True):
                    part.append(columns[path][kept])
        return Samples(
            np.concatenate(times), {name: np.concatenate(part) for name, part in zip(names, parts, strict=True)}
        )
