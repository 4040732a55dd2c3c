"""Trim: where the feel unit's springs have their zero (thesis 3.5.2), at which rate it moves, and force-trim release.

The zero of all springs of the feel unit follows ``feel.neutral`` at ``rate`` at most; a runaway is a neutral far away
with the rate of the trim motor. While a helicopter's pilot holds the force-trim button (``released``), the springs let
go and the zero goes with the control; a damper takes their place. Afterwards it stays where the control was, and moves
from there as ``feel.neutral`` does.
"""

from typing import Any

import numpy as np

from cls_bench.compiled import compiled
from cls_bench.feel.element import Element, damper, within
from cls_bench.quantity import quantity


@compiled
def _each_cycle(feel: Any, state: Any, time: float, cycle: float) -> None:
    trim, s = feel.trim, state.trim
    if s.begun == 0.0 or trim.rate <= 0.0 or trim.released:  # nothing of an old way is left to go after the release
        s.position = feel.neutral
        s.begun = 1.0
    else:
        s.position += within(feel.neutral - s.position, trim.rate * cycle)
    if trim.released:
        s.offset = state.seat_angle - s.position
    s.zero = s.position + s.offset


@compiled
def _act(feel: Any, state: Any, piece: Any) -> None:
    if feel.trim.released:
        damper(piece, piece.aft, feel.trim.release_damping)


@compiled
def _show(feel: Any, state: Any) -> None:
    state.surface.trim = state.trim.zero if state.trim.begun != 0.0 else feel.neutral


class Trim(Element):
    """Rate of the trim, and force-trim release."""

    rate: float = quantity(0.0, "rad/s", "greatest rate at which the zero follows neutral; 0 is at once",
                           "assumed: no trim motor", ge=0, le=1e3, live=True)  # fmt: skip
    released: bool = quantity(False, "1", "whether the force-trim button is held: the springs let go", "a command",
                              live=True)  # fmt: skip
    release_damping: float = quantity(
        0.5, "N·m·s/rad", "damper of the force trim while it is released",
        "assumed: light, a third of the model's own", ge=0, le=1e4, live=True,
    )

    remembers = (("begun", np.float64), ("position", np.float64), ("offset", np.float64), ("zero", np.float64))
    each_cycle = staticmethod(_each_cycle)
    act = staticmethod(_act)
    show = staticmethod(_show)
