"""Self-check of the controller: every number it remembers or was given must be finite.

A value that is not finite spreads: comparisons with it are false, so a safety function that compares does not see it.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cls_bench.compiled import compiled


class Places(NamedTuple):
    """Floating-point numbers of a record: their names, and where they are in it, in 8-byte words."""

    names: tuple[str, ...]
    words: NDArray[np.int64]


def _numbers(
    kind: np.dtype[Any], slots: Mapping[str, Sequence[str]], prefix: str = ""
) -> Iterator[tuple[str, int]]:  # fmt: skip
    for name, (field, offset) in ((name, kind.fields[name][:2]) for name in kind.names or ()):  # type: ignore[index]
        word = offset // 8
        base, shape = field.subdtype or (field, ())
        for k in range(int(np.prod(shape, dtype=int))):
            if base.names:
                for inner, place in _numbers(base, slots, f"{prefix}{name}."):
                    yield inner, word + k * base.itemsize // 8 + place
            elif base == np.float64:
                columns = slots.get(name)
                yield prefix + name + (f".{columns[k % len(columns)]}" if columns else ""), word + k


def places(kind: np.dtype[Any], below: Sequence[str], slots: Mapping[str, Sequence[str]]) -> Places:
    """The numbers of a record of ``kind`` whose dotted names begin with one of ``below``; the names without it.

    ``slots`` are the names of the columns of those fields that are tables.
    """
    names, words = [], []
    for name, word in _numbers(kind, slots):
        for prefix in below:
            if name.startswith(prefix):
                names.append(name.removeprefix(prefix))
                words.append(word)
    return Places(tuple(names), np.array(words, np.int64))


@compiled
def first_invalid(words: Any, places: Any) -> int:
    """Position in ``places`` of the first number of the record ``words`` that is not finite; −1 if all are."""
    for k in range(places.shape[0]):
        if not abs(words[places[k]]) < np.inf:
            return k
    return -1


@compiled
def clear(words: Any, places: Any) -> None:
    """Put 0 in the place of every number that is not finite: what was lost starts anew."""
    for k in range(places.shape[0]):
        if not abs(words[places[k]]) < np.inf:
            words[places[k]] = 0.0
