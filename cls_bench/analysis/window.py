"""A time window of a recording, as the metrics read it."""

import copy
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from cls_bench.errors import InputError
from cls_bench.parameters import Parameters
from cls_bench.signals import PLC_S, PLC_TICKS, TICK_S, TOPIC, TOPICS, Topic

Array = NDArray[np.float64]


class Samples(Protocol):
    """Signals of one topic over time."""

    @property
    def time(self) -> Array:
        """Time since the start of the run [s]."""
        ...

    @property
    def values(self) -> Mapping[str, Array]:
        """Signal name -> samples."""
        ...


class Source(Protocol):
    """Where samples come from: a recording. One that has fewer samples than usual says so in ``topics``, by path."""

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


LARGEST = 1e12
"""Greatest magnitude of a sample [SI] that is measured; no signal of a bench comes near it."""

MOST_ROWS = round(3600.0 / PLC_S) + 1
"""Samples that a window may hold: as long as a run can last."""


class Window:
    """Signals from ``start`` to ``end`` [s], all at the PLC's rate of 2.5 kHz, and the parameters at ``start``.

    At that rate ten minutes of a signal take 12 MB, and all that a hand can feel is in it. Samples that are not there,
    because the run ended before or they were lost, are NaN, and so are those beyond :data:`LARGEST`; :attr:`flaws` says
    so of the signals that were looked at.
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
        self.flaws: list[str] = []
        """what is wrong with the signals that were looked at, a line each"""
        self._first, last = (-(-round(time / TICK_S) // PLC_TICKS) for time in (start, end))
        self.rows = max(last - self._first, 0)
        """number of samples of each signal"""
        if self.rows > MOST_ROWS:
            raise InputError(f"{start:g} to {end:g} s is longer than a run can last")
        self._read: dict[str, tuple[Array, str]] = {}

    def watched(self) -> "Window":
        """The same window, its :attr:`flaws` empty: those of the signals that are looked at from now on."""
        other = copy.copy(self)
        other.flaws = []
        return other

    def __getitem__(self, signal: str) -> Array:
        """Samples of a signal such as ``/column.angle`` in its SI unit, shape (rows,).

        Raises InputError if there is no such signal, or if it was not recorded at the PLC's rate.
        """
        if signal not in self._read:
            self._read[signal] = self._look_up(signal)
        values, flaw = self._read[signal]
        if flaw and flaw not in self.flaws:
            self.flaws.append(flaw)
        return values

    @cached_property
    def time(self) -> Array:
        """Time since the start of the run, shape (rows,) [s]."""
        return PLC_S * np.arange(self._first, self._first + self.rows, dtype=np.float64)

    def is_complete(self, *signals: str) -> bool:
        """Whether all samples of ``signals`` are there and are numbers that a bench may have."""
        watched = self.watched()
        for signal in signals:
            watched[signal]
        return not watched.flaws

    def _look_up(self, signal: str) -> tuple[Array, str]:
        """The samples, and what is wrong with them."""
        topic, name = split_signal(signal)
        topics: Mapping[str, Topic] = getattr(self._source, "topics", TOPIC)
        ticks = topics.get(topic, TOPIC[topic]).ticks
        if PLC_TICKS % ticks:
            raise InputError(f"{topic} was recorded at {1 / (ticks * TICK_S):g} Hz, not at {self.rate:g} Hz")
        series = self._source.read(topic, [name], self.start, self.end, PLC_TICKS // ticks)
        values = series.values[name]
        there = np.ones(self.rows, np.bool_)
        if len(values) != self.rows:
            rows = np.round(series.time / PLC_S).astype(np.int64) - self._first
            whole, there = np.full(self.rows, np.nan), np.zeros(self.rows, np.bool_)
            whole[rows], there[rows] = values, True
            values = whole
        sound = there & (np.abs(values) <= LARGEST)
        if sound.all():
            return values, ""
        return np.where(sound, values, np.nan), self._flaw(signal, values, there, sound)

    def _flaw(self, signal: str, values: Array, there: NDArray[np.bool_], sound: NDArray[np.bool_]) -> str:
        """What is wrong with samples of which some are not ``there``, or there but not ``sound``."""
        first = int(np.flatnonzero(~sound)[0])
        if not there[first:].any():
            ended = f"at {(self._first + first - 1) * PLC_S:.4f} s" if first else "before it began"
            return f"the samples end {ended}, the window at {self.end:g} s"
        what = "missing" if not there[first] else "beyond all bounds" if np.isfinite(values[first]) else "not finite"
        lost = f"{np.count_nonzero(~sound)} of {self.rows} samples"
        return f"{signal} is {what} at {(self._first + first) * PLC_S:.4f} s, {lost}"


def holds_all(topics: Sequence[Topic]) -> bool:
    """Whether ``topics`` have every signal there is, at the rate of a :class:`Window` at least."""
    found = {topic.path: topic for topic in topics}
    return all(
        topic.path in found and found[topic.path].names == topic.names and PLC_TICKS % found[topic.path].ticks == 0
        for topic in TOPICS
    )


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
