"""Where the tick writes what is recorded: a row of named signals for each topic.

The fields are those of :data:`cls_bench.signals.TOPICS`. A row is written by signal name, so its column has no number
to mistake; what is not written stays NaN, and a NaN in a recording ends the run.
"""

from collections import namedtuple
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cls_bench.signals import POSE_TICKS, TOPICS

_FIELDS = [*(topic.path.strip("/") for topic in TOPICS), "poses"]
_make: Callable[..., Any] = namedtuple  # its fields follow from the table: more than a type checker can know
Trace = _make("Trace", _FIELDS)
"""Buffers of one block: an array of records for each topic, named like it, and the bodies' poses."""

_ROWS = {topic.path: np.dtype([(name, np.float64) for name in topic.names]) for topic in TOPICS}


def buffers(first_tick: int, ticks: int, bodies: int) -> Any:
    """A :class:`Trace` with room for ``ticks`` ticks from ``first_tick`` on, nothing in it written yet."""
    rows = [np.full(t.rows(first_tick, ticks), np.nan, _ROWS[t.path]).view(np.recarray) for t in TOPICS]
    poses = -(-(first_tick + ticks) // POSE_TICKS) - -(-first_tick // POSE_TICKS)
    return Trace(*rows, np.full((poses, bodies, 7), np.nan))


def tables(trace: Any, first_tick: int, ticks: int) -> Mapping[str, NDArray[np.float64]]:
    """The first ``ticks`` ticks of each topic as a table of its signals in column order, without a copy."""
    return {
        t.path: rows.view(np.float64, np.ndarray).reshape(-1, len(t.signals))[: t.rows(first_tick, ticks)]
        for t, rows in zip(TOPICS, trace, strict=False)
    }
