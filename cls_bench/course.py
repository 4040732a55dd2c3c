"""Courses: values of a parameter over time, as ramps, steps and straight lines between samples.

A course is a row of pieces. Each begins at a tick and goes from one value to another within a time, then stays there
until the next one begins. The tick (:mod:`cls_bench.tick`) writes the value of every PLC cycle into the axis's record,
by :func:`move`; :meth:`Course.at` is the same number outside of it.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cls_bench.compiled import compiled, records

STRAIGHT, SMOOTH = range(2)
"""Ways from a piece's start to its end: a line, or least jerk as the hand's smooth ramp."""

PIECE = np.dtype(
    [
        ("begin", np.float64), ("span", np.float64),  # [ticks]; a span of 0 is a step
        ("start", np.float64), ("end", np.float64),  # [unit of the parameter]; of a step, the value before and after
        ("way", np.int64),
    ]
)  # fmt: skip

COURSE = np.dtype(
    [
        ("axis", np.int64), ("word", np.int64),  # where the value goes: axis, and place in its record in 8-byte words
        ("first", np.int64), ("beyond", np.int64),  # its pieces
        ("reached", np.int64),  # the piece of the last PLC cycle
        # what is written keeps within low and high, and changes by no more than rate in a PLC cycle
        ("low", np.float64), ("high", np.float64), ("rate", np.float64),
        ("refused", np.int64),  # PLC cycles in which the value was none, or out of bounds
    ]
)  # fmt: skip


@compiled
def value(way: int, begin: float, span: float, start: float, end: float, tick: float) -> float:
    """Value of a piece at ``tick``, which is not before its beginning."""
    passed = tick - begin
    if passed >= span:
        return end
    x = passed / span
    if way == SMOOTH:
        x = x * x * x * (10.0 - 15.0 * x + 6.0 * x * x)
    return start + (end - start) * x


@compiled
def move(courses: Any, pieces: Any, words: Any, tick: int) -> None:
    """Write what every course has come to at ``tick``, the start of a PLC cycle, into the axes' records ``words``.

    A value that is no number is not written; one out of its bounds is written as the bound. Both are counted.
    """
    for c in range(courses.shape[0]):
        course = courses[c]
        k = course.reached
        while k + 1 < course.beyond and pieces[k + 1].begin <= tick:
            k += 1
        course.reached = k
        piece = pieces[k]
        if piece.begin > tick:
            continue
        wanted = value(piece.way, piece.begin, piece.span, piece.start, piece.end, tick)
        if not abs(wanted) < np.inf:
            course.refused += 1
            continue
        if wanted < course.low or wanted > course.high:
            course.refused += 1
            wanted = min(max(wanted, course.low), course.high)
        present = words[course.axis, course.word]
        if abs(wanted - present) > course.rate:
            wanted = present + (course.rate if wanted > present else -course.rate)
        words[course.axis, course.word] = wanted


_value: Any = getattr(value, "py_func", value)


@dataclass(frozen=True)
class Course:
    """What a parameter does from a tick on."""

    pieces: NDArray[Any]
    """:data:`PIECE`, at least one, in order of their beginnings; of those that begin at once the last one holds"""
    said: tuple[tuple[int, str], ...] = ()
    """what the log says of it, and at which ticks"""

    def at(self, tick: float) -> float | None:
        """Value at ``tick``; None before the course begins."""
        k = int(np.searchsorted(self.pieces["begin"], tick, side="right")) - 1
        if k < 0:
            return None
        begin, span, start, end, way = self.pieces[k].item()
        return float(_value(way, begin, span, start, end, tick))

    @property
    def end(self) -> float:
        """The tick from which on, at the latest, it stays where it is."""
        return float(np.max(self.pieces["begin"] + self.pieces["span"]))

    @property
    def low(self) -> float:
        """Least value that it takes."""
        return float(min(np.min(self.pieces["start"]), np.min(self.pieces["end"])))

    @property
    def high(self) -> float:
        """Greatest value that it takes."""
        return float(max(np.max(self.pieces["start"]), np.max(self.pieces["end"])))

    def moves(self, first: float, last: float) -> bool:
        """Whether its value changes after ``first``, up to ``last`` [ticks]."""
        p = self.pieces
        changing = p["start"] != p["end"]
        until = np.append(p["begin"][1:], np.inf)
        on_its_way = (p["begin"] < last) & (np.minimum(p["begin"] + p["span"], until) > first)
        jumps = (p["begin"] > first) & (p["begin"] <= last)
        return bool(np.any(changing & np.where(p["span"] > 0.0, on_its_way, jumps)))


def steps(ticks: ArrayLike, values: ArrayLike, *, start: float | None = None) -> NDArray[Any]:
    """Pieces that jump to each of ``values`` at its tick, to the first one from ``start`` if that is known."""
    ends = np.asarray(values, np.float64)
    starts = np.append(ends[0] if start is None else start, ends[:-1])
    return _pieces(ticks, np.zeros(len(ends)), starts, ends, STRAIGHT)


def ramp(begin: float, span: float, start: float, end: float, *, smooth: bool = False) -> NDArray[Any]:
    """One piece from ``start`` to ``end`` within ``span`` [ticks]."""
    return _pieces([begin], [span], [start], [end], SMOOTH if smooth else STRAIGHT)


def lines(ticks: ArrayLike, values: ArrayLike) -> NDArray[Any]:
    """Straight lines between values at growing ticks; where nothing changes, one piece for all of it."""
    t, v = np.asarray(ticks, np.float64), np.asarray(values, np.float64)
    if len(t) == 1:
        return steps(t, v)  # a value that stays
    found = _pieces(t[:-1], np.diff(t), v[:-1], v[1:], STRAIGHT)
    flat = found["start"] == found["end"]
    again = np.append(False, flat[1:] & flat[:-1])
    kept: NDArray[Any] = found[~again]
    return kept


def _pieces(begin: ArrayLike, span: ArrayLike, start: ArrayLike, end: ArrayLike, way: int) -> NDArray[Any]:
    columns = np.broadcast_arrays(*(np.asarray(c, np.float64) for c in (begin, span, start, end)))
    found = np.zeros(len(columns[0]), PIECE)
    for name, column in zip(("begin", "span", "start", "end"), columns, strict=True):
        found[name] = column
    found["way"] = way
    return found


@dataclass(frozen=True)
class Place:
    """Where the value of a course goes, and what it keeps to."""

    axis: int
    """number of the axis"""
    word: int
    """place in its record, in 8-byte words"""
    low: float
    high: float
    rate: float = math.inf
    """greatest change in a PLC cycle"""


def tables(courses: Sequence[tuple[Place, NDArray[Any]]]) -> tuple[Any, Any]:
    """Courses and their pieces as :func:`move` takes them."""
    found = np.zeros(len(courses), COURSE)
    first = 0
    for c, (place, pieces) in enumerate(courses):
        beyond = first + len(pieces)
        found[c] = place.axis, place.word, first, beyond, first, place.low, place.high, place.rate, 0
        first = beyond
    pieces = np.concatenate([pieces for _, pieces in courses]) if courses else np.zeros(0, PIECE)
    return records(found), records(pieces)
