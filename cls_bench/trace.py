"""What is recorded: from where in an axis's record to where in the buffers.

:func:`cls_bench.signals.topics` declares each signal with its source. Here the names become places, once; the tick
copies numbers from the ones to the others and knows no signal. What is not written stays NaN, and a NaN in a recording
ends the run. The buffers have room for all stages that a gearbox can have, so that one set of places serves all; what
a rig does not have is not handed on.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cls_bench.axis import AXIS, SLOTS
from cls_bench.control import validity
from cls_bench.signals import CLOCK, MOST_STAGES, Clock, Topic, topics


class Trace(NamedTuple):
    """What is to be recorded of some ticks; a row of ``tick``, ``drive`` and ``plc`` for each signal of that cycle.

    The number in word [0] of the record of axis a belongs into ``values[[1] + row · [2] + a · [3]]``.
    """

    values: NDArray[np.float64]
    tick: NDArray[np.int64]
    drive: NDArray[np.int64]
    plc: NDArray[np.int64]
    poses: NDArray[np.float64]  # (rows, bodies, 7)


def words(kind: np.dtype[Any], declared: Iterable[Topic]) -> list[list[int]]:
    """Where in a record of ``kind`` the signals of each of the topics ``declared`` stand, in 8-byte words.

    ValueError that names the signal if there is no such number, if there are several or if it is none of floats.
    """
    known: dict[str, list[validity.Number]] = {}
    for number in validity.numbers(kind, SLOTS):
        known.setdefault(number.name, []).append(number)

    def word(signal: str, source: str) -> int:
        found = known.get(source, [])
        if len(found) != 1:
            there = f"{len(found)} times" if found else "nowhere"
            raise ValueError(f'{signal}: source "{source}" stands {there} in an axis\'s record')
        if found[0].kind != np.float64:
            raise ValueError(f'{signal}: source "{source}" is of {found[0].kind}, not of float64')
        return found[0].word

    return [[word(f"{topic.path}.{s.name}", s.source) for s in topic.signals] for topic in declared]


_TOPICS = topics(CLOCK, MOST_STAGES)
_WORDS = words(AXIS, _TOPICS)
_CYCLES = [(1, CLOCK.drive_ticks, CLOCK.plc_ticks).index(topic.ticks) for topic in _TOPICS]
"""In which cycle the tick writes a topic: its own, the drive's, the PLC's, which are of different lengths here."""


def _rows(every: int, first_tick: int, ticks: int) -> int:
    return -(-(first_tick + ticks) // every) - -(-first_tick // every)


class Buffers:
    """Room for ``ticks`` ticks from ``first_tick`` on, of ``axes`` and ``bodies``; nothing in it written yet."""

    def __init__(self, clock: Clock, axes: int, bodies: int, first_tick: int, ticks: int):
        self.first_tick, self.ticks = first_tick, ticks
        self._every = (1, clock.drive_ticks, clock.plc_ticks)
        shapes = [
            (_rows(self._every[cycle], first_tick, ticks), axes, len(places))
            for cycle, places in zip(_CYCLES, _WORDS, strict=True)
        ]
        ends = np.cumsum([0, *map(math.prod, shapes)]).tolist()
        self._values = np.full(ends[-1], np.nan)
        self._tables = {
            topic.path: (self._values[start:end].reshape(shape), self._every[cycle])
            for topic, start, end, shape, cycle in zip(_TOPICS, ends, ends[1:], shapes, _CYCLES, strict=False)
        }
        self._places = [
            np.array(
                [
                    (word, start + k, axes * len(places), len(places))
                    for places, start, cycle in zip(_WORDS, ends, _CYCLES, strict=False) if cycle == of
                    for k, word in enumerate(places)
                ], np.int64,
            ).reshape(-1, 4)
            for of in range(len(self._every))
        ]  # fmt: skip
        self._pose = clock.pose_ticks
        self._poses = np.full((_rows(self._pose, first_tick, ticks), bodies, 7), np.nan)

    def part(self, first: int, ticks: int) -> Trace:
        """The :class:`Trace` of some of the ticks, without a copy of the values."""
        before = first - self.first_tick
        tick, drive, plc = (places.copy() for places in self._places)
        for places, every in zip((tick, drive, plc), self._every, strict=True):
            places[:, 1] += _rows(every, self.first_tick, before) * places[:, 2]
        start = _rows(self._pose, self.first_tick, before)
        poses = self._poses[start : start + _rows(self._pose, first, ticks)]
        return Trace(self._values, tick, drive, plc, poses)

    def tables(
        self, axes: Sequence[Sequence[Topic]], first: int, ticks: int
    ) -> Mapping[str, NDArray[np.float64]]:
        """Some of the ticks of the topics of each axis as tables of their signals in column order, without copies."""
        found = {}
        for a, axis in enumerate(axes):
            for topic in axis:
                table, every = self._tables["/" + topic.path.rpartition("/")[2]]
                start = _rows(every, self.first_tick, first - self.first_tick)
                found[topic.path] = table[start : start + _rows(every, first, ticks), a, : len(topic.signals)]
        return found
