"""Stick pusher: a torque that drives the column forward before a stall, against which the pilot can hold (2.2.2)."""

from typing import Any

import numpy as np

from cls_bench.compiled import compiled
from cls_bench.feel.element import COLUMN, Element, push, ramped
from cls_bench.quantity import quantity


@compiled
def _each_cycle(feel: Any, state: Any, time: float, cycle: float) -> None:
    k, s = feel.pusher, state.pusher
    if not k.engaged:
        s.since = 0.0
    wanted = k.torque if k.engaged and (k.longest == 0.0 or s.since < k.longest) else 0.0
    if k.engaged:
        s.since += cycle
    if k.torque != 0.0:
        s.full = abs(k.torque)
    # At the pace of the last torque that was asked for: it falls when that is taken away.
    s.level = ramped(s.level, wanted, s.full, k.ramp, cycle)
    push(state, COLUMN, s.level)


@compiled
def _forget(feel: Any, state: Any) -> None:
    state.pusher.level = 0.0


class StickPusher(Element):
    """A torque on the column that rises over ``ramp``, stays ``longest`` at most and falls again."""

    engaged: bool = quantity(False, "1", "whether it pushes", "a command", live=True)
    torque: float = quantity(0.0, "N·m", "its torque, forward positive", "thesis 2.2.2", ge=-1e3, le=1e3, live=True)
    ramp: float = quantity(0.1, "s", "time from none to all of it, and back", "assumed: as quick as a hand can tell",
                           ge=0, le=100, live=True)  # fmt: skip
    longest: float = quantity(0.0, "s", "longest time that it pushes, from its engagement; 0 is no end",
                              "assumed: as long as it is engaged", ge=0, le=1e4, live=True)  # fmt: skip

    remembers = (("level", np.float64), ("full", np.float64), ("since", np.float64))
    each_cycle = staticmethod(_each_cycle)
    forget = staticmethod(_forget)
