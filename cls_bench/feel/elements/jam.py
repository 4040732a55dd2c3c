"""Jam: a body that is held where it is, whatever pulls at it."""

from typing import Any, Literal

from cls_bench.compiled import compiled
from cls_bench.feel.element import Element
from cls_bench.quantity import quantity

NONE, FORWARD, AFT = range(3)


@compiled
def _act(feel: Any, state: Any, piece: Any) -> None:
    if feel.jam.of == FORWARD:
        piece.held[0] = 1
    elif feel.jam.of == AFT:
        piece.held[piece.aft] = 1


class Jam(Element):
    """Which body is jammed; a single one is by either."""

    of: Literal["none", "forward", "aft"] = quantity("none", "1", "the body that is held", "a malfunction", live=True)

    act = staticmethod(_act)
