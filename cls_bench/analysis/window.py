"""A time window of a recording, as the metrics read it."""

import copy
from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from cls_bench.errors import InputError
from cls_bench.parameters import Parameters
from cls_bench.signals import MOST_STAGES, Clock, Column, Topic, axes_of, axis_of, is_axis, topics

Array = NDArray[np.float64]


class Source(Protocol):
    """Where samples come from: a recording, or what was kept in memory."""

    @property
    def clock(self) -> Clock:
        """Rates of the run."""
        ...

    @property
    def topics(self) -> Mapping[str, Topic]:
        """The topics as they are there, by path: with the signals that were kept, and how often."""
        ...

    def samples_at(self, signal: str, ticks: range) -> Column:
        """Samples of ``/topic.name`` at ``ticks``, multiples of their step; those that are lost are left out.

        Raises InputError if there is no such signal.
        """
        ...


LARGEST = 1e12
"""Greatest magnitude of a sample [SI] that is measured; no signal of a bench comes near it."""

MOST_ROWS = 9_000_001
"""Samples that a window may hold (72 MB a signal): at 2.5 kHz as long as a run can last, an hour."""


class Window:
    """Signals from ``start`` to ``end`` [s], all at the PLC's rate (thesis: 2.5 kHz), and the parameters at ``start``.

    At that rate ten minutes of a signal take 12 MB, and all that a hand can feel is in it. Samples that are not there,
    because the run ended before or they were lost, are NaN, and so are those beyond :data:`LARGEST`; :attr:`flaws` says
    so of the signals that were looked at. Of several axes ``axis`` is the one that ``/column.angle`` belongs to; a
    signal that names its axis, as ``/pitch/column.angle``, is looked up as it is.
    """

    def __init__(
        self, source: Source, start: float, end: float, parameters: Parameters, *,
        idle: str = "", own_loop: bool = False, axis: str = "", moving: Sequence[str] = (),
    ):  # fmt: skip
        self._source = source
        self.start, self.end = start, end
        self.parameters = parameters
        self.idle = idle
        """why the column is not meant to follow the feel model, at least for a part; empty if it is"""
        self.own_loop = own_loop
        """whether a user's own outer loop ran instead of the feel model"""
        self.moving = tuple(moving)
        """keys of parameters that change within the window"""
        self.axis = axis
        """name of the axis; empty if there is but one"""
        self.flaws: list[str] = []
        """what is wrong with the signals that were looked at, a line each"""
        self.clock = source.clock
        """rates of the run"""
        every = self.clock.plc_ticks
        first, last = (-(-self.clock.tick_of(time) // every) * every for time in (start, end))
        self._ticks = range(first, max(last, first), every)
        self.rows = len(self._ticks)
        """number of samples of each signal"""
        self._read: dict[str, tuple[Array, str]] = {}

    @property
    def period(self) -> float:
        """Time between two samples [s]."""
        return self.clock.time(self.clock.plc_ticks)

    @property
    def rate(self) -> float:
        """Sampling rate [Hz]."""
        return 1.0 / self.period

    def watched(self) -> "Window":
        """The same window, its :attr:`flaws` empty: those of the signals that are looked at from now on."""
        other = copy.copy(self)
        other.flaws = []
        return other

    def __getitem__(self, signal: str) -> Array:
        """Samples of a signal such as ``/column.angle`` in its SI unit, shape (rows,).

        Raises InputError if there is no such signal, if it was not recorded at the PLC's rate, or if there are more
        than :data:`MOST_ROWS` samples.
        """
        if signal not in self._read:
            self._read[signal] = self._look_up(signal)
        values, flaw = self._read[signal]
        if flaw and flaw not in self.flaws:
            self.flaws.append(flaw)
        return values

    @cached_property
    def time(self) -> Array:
        """Time since the start of the run, shape (rows,) [s]. InputError beyond :data:`MOST_ROWS`."""
        self._require_room()
        return np.asarray(np.array(self._ticks, np.int64) * self.clock.tick_ns / 1e9, np.float64)

    def is_complete(self, *signals: str) -> bool:
        """Whether all samples of ``signals`` are there and are numbers that a bench may have."""
        watched = self.watched()
        for signal in signals:
            watched[signal]
        return not watched.flaws

    def _look_up(self, signal: str) -> tuple[Array, str]:
        """The samples, and what is wrong with them."""
        self._require_room()
        topic, name = split_signal(on_axis(signal, self.axis))
        here = self._source.topics
        if topic not in here and not axis_of(topic) and (axes := [axis for axis in axes_of(here.values()) if axis]):
            raise InputError(f"{topic} is there of {' and '.join(axes[:9])}: say which axis")
        if topic in here and self.clock.plc_ticks % here[topic].ticks:
            raise InputError(f"{topic} was recorded at {here[topic].rate:g} Hz, not at {self.rate:g} Hz")
        found = self._source.samples_at(f"{topic}.{name}", self._ticks)
        values = found.values
        there = np.ones(self.rows, np.bool_)
        if len(values) != self.rows:
            rows = (found.ticks - self._ticks.start) // self._ticks.step
            whole, there = np.full(self.rows, np.nan), np.zeros(self.rows, np.bool_)
            whole[rows], there[rows] = values, True
            values = whole
        sound = there & (np.abs(values) <= LARGEST)
        if sound.all():
            return values, ""
        return np.where(sound, values, np.nan), self._flaw(signal, values, there, sound)

    def _require_room(self) -> None:
        if self.rows > MOST_ROWS:
            span = f"{self.start:g} to {self.end:g} s"
            raise InputError(f"{span} are {self.rows} samples at {self.rate:g} Hz, {MOST_ROWS} at most")

    def _flaw(self, signal: str, values: Array, there: NDArray[np.bool_], sound: NDArray[np.bool_]) -> str:
        """What is wrong with samples of which some are not ``there``, or there but not ``sound``."""
        first = int(np.flatnonzero(~sound)[0])
        if not there.any():
            return f"there are no samples from {self.start:g} to {self.end:g} s"
        if not there[first:].any():
            ended = self.clock.time(self._ticks.start + (first - 1) * self._ticks.step)
            return f"the samples end at {ended:.4f} s, the window at {self.end:g} s"
        what = "missing" if not there[first] else "beyond all bounds" if np.isfinite(values[first]) else "not finite"
        lost = f"{np.count_nonzero(~sound)} of {self.rows} samples"
        return f"{signal} is {what} at {self.clock.time(self._ticks[first]):.4f} s, {lost}"


def holds_all(kept: Iterable[Topic], simulated: Iterable[Topic], clock: Clock) -> bool:
    """Whether of what was ``simulated`` every signal was ``kept``, at the rate of a :class:`Window` at least."""
    found = {topic.path: topic for topic in kept}
    return all(
        topic.path in found and found[topic.path].names == topic.names
        and clock.plc_ticks % found[topic.path].ticks == 0
        for topic in simulated
    )  # fmt: skip


_ANY = {topic.path: topic for topic in topics(stages=MOST_STAGES)}
"""The topics that an axis can have, by path."""


def split_signal(signal: str) -> tuple[str, str]:
    """Topic and name of ``/topic.name`` or ``/axis/topic.name``, of any rig; InputError that lists what is valid."""
    path, _, name = signal.rpartition(".")
    axis = axis_of(path)
    topic = _ANY.get(path.removeprefix(f"/{axis}") if is_axis(axis) else path)
    if topic is None:
        raise InputError(f'"{signal}" names no topic; valid: {", ".join(f"{path}.…" for path in _ANY)}')
    if name not in topic.names:
        raise InputError(f'{path} has no signal "{name}"; valid: {", ".join(topic.names)}')
    return path, name


def on_axis(signal: str, axis: str) -> str:
    """``/pitch/column.angle`` of ``/column.angle`` for the axis ``pitch``; a signal that names an axis as it is."""
    return f"/{axis}{signal}" if axis and not axis_of(signal) else signal


def unit_of(signal: str) -> str:
    """SI unit of ``/topic.name``."""
    path, name = split_signal(signal)
    topic = _ANY[path.removeprefix(f"/{axis_of(path)}") if axis_of(path) else path]
    return next(s.unit for s in topic.signals if s.name == name)
