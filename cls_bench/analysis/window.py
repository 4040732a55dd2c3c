"""A time window of a recording, as the metrics read it."""

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from cls_bench.errors import InputError
from cls_bench.parameters import Parameters
from cls_bench.signals import PLC_S, PLC_TICKS, TICK_S, TOPIC

Array = NDArray[np.float64]


class Samples(Protocol):
    """Signals of one topic over time."""

    @property
    def values(self) -> Mapping[str, Array]:
        """Signal name -> samples."""
        ...


class Source(Protocol):
    """Where samples come from: a recording."""

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


class Window:
    """Signals from ``start`` to ``end`` [s], all at the PLC's rate of 2.5 kHz, and the parameters at ``start``.

    At that rate ten minutes of a signal take 12 MB, and all that a hand can feel is in it.
    """

    rate = 1.0 / PLC_S
    """Sampling rate [Hz]."""

    def __init__(
        self, source: Source, start: float, end: float, parameters: Parameters, *,
        idle: str = "", own_loop: bool = False,
    ):  # fmt: skip
        self._source = source
        self.start, self.end = start, end
        self.parameters = parameters
        self.idle = idle
        """why the column is not meant to follow the feel model, at least for a part; empty if it is"""
        self.own_loop = own_loop
        """whether a user's own outer loop ran instead of the feel model"""
        self._read: dict[str, Array] = {}

    def __getitem__(self, signal: str) -> Array:
        """Samples of a signal such as ``/column.angle`` in its SI unit, shape (rows,). Raises InputError."""
        if signal not in self._read:
            topic, name = split_signal(signal)
            series = self._source.read(topic, [name], self.start, self.end, PLC_TICKS // TOPIC[topic].ticks)
            self._read[signal] = series.values[name]
        return self._read[signal]

    @property
    def rows(self) -> int:
        """Samples of a signal if the run went on to the window's end."""
        return self._row(self.end) - self._row(self.start)

    @staticmethod
    def _row(time: float) -> int:
        return -(-round(time / TICK_S) // PLC_TICKS)

    @cached_property
    def time(self) -> Array:
        """Time since the start of the run, shape (rows,) [s]."""
        first = self._row(self.start)
        return PLC_S * np.arange(first, first + len(self["/feel.angle"]), dtype=np.float64)


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
