"""Self-check of the controller: every number it remembers or was given must be finite.

A value that is not finite spreads: comparisons with it are false, so a safety function that compares does not see it.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cls_bench.compiled import compiled


class Number(NamedTuple):
    """A number in a record."""

    name: str
    """dotted: ``truth.body.twist.2``; the columns of a table have the names of their slots, else they are counted"""
    word: int
    """where it is, in 8-byte words"""
    kind: np.dtype[Any]


class Places(NamedTuple):
    """Floating-point numbers of a record: their names, and where they are in it, in 8-byte words."""

    names: tuple[str, ...]
    words: NDArray[np.int64]


def numbers(kind: np.dtype[Any], slots: Mapping[str, Sequence[str]], prefix: str = "") -> Iterator[Number]:
    """All numbers of a record of ``kind``; ``slots`` are the names of the columns of those fields that are tables."""
    for name, (field, offset) in ((name, kind.fields[name][:2]) for name in kind.names or ()):  # type: ignore[index]
        word = offset // 8
        base, shape = field.subdtype or (field, ())
        for k in range(int(np.prod(shape, dtype=int))):
            columns = slots.get(name)
            column = "" if not shape else f".{columns[k % len(columns)] if columns else k + 1}"
            if base.names:
                for inner in numbers(base, slots, f"{prefix}{name}{column}."):
                    yield inner._replace(word=inner.word + word + k * base.itemsize // 8)
            else:
                yield Number(f"{prefix}{name}{column}", word + k, base)


def places(kind: np.dtype[Any], below: Sequence[str], slots: Mapping[str, Sequence[str]]) -> Places:
    """The numbers of a record of ``kind`` whose dotted names begin with one of ``below``; the names without it.

    ``slots`` are the names of the columns of those fields that are tables.
    """
    names, words = [], []
    for name, word, of in numbers(kind, slots):
        for prefix in below:
            if of == np.float64 and name.startswith(prefix):
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
