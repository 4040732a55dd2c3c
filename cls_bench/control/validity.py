"""Self-check of the controller: every number it remembers or was given must be finite.

A value that is not finite spreads: comparisons with it are false, so a safety function that compares does not see it.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cls_bench.compiled import compiled


class Numbers(NamedTuple):
    """The floating-point numbers of a record, in the record's own memory."""

    values: NDArray[np.float64]  # all 8-byte fields of the record
    places: NDArray[np.int64]  # of them, those that hold floating-point numbers


def names(kind: np.dtype[Any], prefix: str = "") -> list[tuple[str, int]]:
    """Dotted name and place, in 8-byte words, of each floating-point number in a record of ``kind``."""
    found: list[tuple[str, int]] = []
    for name, (field, offset) in ((name, kind.fields[name][:2]) for name in kind.names or ()):  # type: ignore[index]
        word = offset // 8
        base, shape = field.subdtype or (field, ())
        if base.names:
            found += [(inner, word + place) for inner, place in names(base, f"{prefix}{name}.")]
        elif base == np.float64:
            found += [(prefix + name, word + k) for k in range(int(np.prod(shape, dtype=int)))]
    return found


def numbers(memory: NDArray[Any]) -> Numbers:
    """The numbers of ``memory``, an array of one record."""
    return Numbers(memory.view(np.float64, np.ndarray), np.array([place for _, place in names(memory.dtype)], np.int64))


@compiled
def first_invalid(watched: Numbers) -> int:
    """Position in ``places`` of the first number that is not finite; −1 if all are."""
    for k in range(watched.places.shape[0]):
        if not abs(watched.values[watched.places[k]]) < np.inf:
            return k
    return -1


@compiled
def clear(watched: Numbers) -> None:
    """Put 0 in the place of every number that is not finite: what was lost starts anew."""
    for k in range(watched.places.shape[0]):
        if not abs(watched.values[watched.places[k]]) < np.inf:
            watched.values[watched.places[k]] = 0.0
