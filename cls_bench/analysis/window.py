"""A time window of a recording, as the metrics read it."""

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from cls_bench.errors import InputError
from cls_bench.parameters import Parameters
from cls_bench.signals import PLC_S, PLC_TICKS, TICK_S, TOPIC, Topic

Array = NDArray[np.float64]


class Samples(Protocol):
    """Signals of one topic over time."""

    @property
    def values(self) -> Mapping[str, Array]:
        """Signal name -> samples."""
        ...


class Source(Protocol):
    """Where samples come from: a recording."""

    @property
    def topics(self) -> Mapping[str, Topic]:
        """The topics there are, by path, with the signals and ticks they were recorded with."""
        ...

    def read(
        self,
        topic: str,
        signals: Sequence[str] | None = None,
        start: float | None = None,
        end: float | None = None,
        every: int = 1,
    ) -> Samples:
        """Samples with start ≤ time < end [s]; ``every`` keeps one row of so many."""
        ...


class MissingSignalError(InputError):
    """A signal that is needed was not recorded, or not often enough."""


def holds_all(topics: Mapping[str, Topic]) -> bool:
    """Whether every signal there is was recorded at the rate of a :class:`Window`."""
    return all(
        path in topics and topics[path].names == topic.names and PLC_TICKS % topics[path].ticks == 0
        for path, topic in TOPIC.items()
    )


class Window:
    """Signals from ``start`` to ``end`` [s], all at the PLC's rate of 2.5 kHz, and the parameters at ``start``.

    A signal that was recorded less often, or not at all, is a :class:`MissingSignalError` when it is asked for.

    At that rate ten minutes of a signal take 12 MB, and all that a hand can feel is in it.
    """

    rate = 1.0 / PLC_S
    """Sampling rate [Hz]."""

    def __init__(self, source: Source, start: float, end: float, parameters: Parameters):
        self._source = source
        self.start, self.end = start, end
        self.parameters = parameters
        self._read: dict[str, Array] = {}

    def __getitem__(self, signal: str) -> Array:
        """Samples of a signal such as ``/column.angle`` in its SI unit, shape (rows,). Raises InputError."""
        if signal not in self._read:
            topic, name = split_signal(signal)
            recorded = self._source.topics.get(topic)
            if recorded is None or name not in recorded.names or PLC_TICKS % recorded.ticks:
                raise MissingSignalError(f"{signal} was not recorded at {self.rate:g} Hz")
            series = self._source.read(topic, [name], self.start, self.end, PLC_TICKS // recorded.ticks)
            self._read[signal] = series.values[name]
        return self._read[signal]

    @cached_property
    def time(self) -> Array:
        """Time since the start of the run, shape (rows,) [s]."""
        first = -(-round(self.start / TICK_S) // PLC_TICKS)
        return PLC_S * np.arange(first, first + self._rows(), dtype=np.float64)

    def _rows(self) -> int:
        for path, topic in self._source.topics.items():
            if PLC_TICKS % topic.ticks == 0:
                return len(self[f"{path}.{topic.names[0]}"])
        raise MissingSignalError(f"nothing was recorded at {self.rate:g} Hz")


def split_signal(signal: str) -> tuple[str, str]:
    """Topic and name of ``/topic.name``; InputError that lists what is valid."""
    topic, _, name = signal.rpartition(".")
    if topic not in TOPIC:
        raise InputError(f'"{signal}" names no topic; valid: {", ".join(f"{path}.…" for path in TOPIC)}')
    if name not in TOPIC[topic].names:
        raise InputError(f'{topic} has no signal "{name}"; valid: {", ".join(TOPIC[topic].names)}')
    return topic, name


def unit_of(signal: str) -> str:
    """SI unit of ``/topic.name``."""
    topic, name = split_signal(signal)
    return next(s.unit for s in TOPIC[topic].signals if s.name == name)
