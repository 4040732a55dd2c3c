"""Where the tick writes what is recorded: a row of named signals for each topic and axis.

The fields are those of :func:`cls_bench.signals.topics`. A row is written by signal name, so its column has no number
to mistake; what is not written stays NaN, and a NaN in a recording ends the run. The buffers have room for all stages
that a gearbox can have, so that one machine code serves all; what a rig does not have is not handed on.
"""

from collections import namedtuple
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cls_bench.compiled import records
from cls_bench.signals import CLOCK, MOST_STAGES, Clock, Topic, topics

_TOPICS = topics(CLOCK, MOST_STAGES)
_NAMES = [topic.path.strip("/") for topic in _TOPICS]
_ROWS = [np.dtype([(name, np.float64) for name in topic.names]) for topic in _TOPICS]

_make: Callable[..., Any] = namedtuple  # its fields follow from the table: more than a type checker can know
Trace = _make("Trace", [*_NAMES, "poses"])
"""Buffers: for each topic an array of records (rows, axes), named like it, and the bodies' poses (rows, bodies, 7)."""


def _rows(every: int, first_tick: int, ticks: int) -> int:
    return -(-(first_tick + ticks) // every) - -(-first_tick // every)


class Buffers:
    """Room for ``ticks`` ticks from ``first_tick`` on, of ``axes`` and ``bodies``; nothing in it written yet."""

    def __init__(self, clock: Clock, axes: int, bodies: int, first_tick: int, ticks: int):
        self.first_tick, self.ticks = first_tick, ticks
        self._every = [topic.ticks for topic in topics(clock, MOST_STAGES)]
        self._pose = clock.pose_ticks
        tables = [
            np.full((_rows(every, first_tick, ticks), axes, len(kind.names or ())), np.nan)
            for every, kind in zip(self._every, _ROWS, strict=True)
        ]
        self._topics = [records(table.view(kind)[:, :, 0]) for table, kind in zip(tables, _ROWS, strict=True)]
        self._tables = dict(zip(_NAMES, zip(tables, self._every, strict=True), strict=True))
        self._poses = np.full((_rows(self._pose, first_tick, ticks), bodies, 7), np.nan)

    def part(self, first: int, ticks: int) -> Any:
        """The :class:`Trace` of some of the ticks, without a copy."""

        def rows(array: Any, every: int) -> Any:
            start = _rows(every, self.first_tick, first - self.first_tick)
            return array[start : start + _rows(every, first, ticks)]

        parts = [rows(array, every) for array, every in zip(self._topics, self._every, strict=True)]
        return Trace(*parts, rows(self._poses, self._pose))

    def tables(
        self, axes: Sequence[Sequence[Topic]], first: int, ticks: int
    ) -> Mapping[str, NDArray[np.float64]]:
        """Some of the ticks of the topics of each axis as tables of their signals in column order, without copies."""
        found = {}
        for a, axis in enumerate(axes):
            for topic in axis:
                table, every = self._tables[topic.path.rpartition("/")[2]]
                start = _rows(every, self.first_tick, first - self.first_tick)
                found[topic.path] = table[start : start + _rows(every, first, ticks), a, : len(topic.signals)]
        return found
