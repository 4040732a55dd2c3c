"""Stick shaker: a rotating unbalanced mass on the column, T_sw of thesis 3.5.2, with ramp and duty."""

import math
from typing import Any

import numpy as np

from cls_bench.compiled import compiled
from cls_bench.feel.element import COLUMN, Element, push, ramped
from cls_bench.quantity import quantity


@compiled
def _each_cycle(feel: Any, state: Any, time: float, cycle: float) -> None:
    k, s = feel.shaker, state.shaker
    wanted = k.torque
    if k.duty < 1.0 and time % k.period >= k.duty * k.period:
        wanted = 0.0
    if k.torque > 0.0:
        s.full = k.torque
    # At the pace of the last amplitude that was asked for: it falls when that is taken away.
    s.level = ramped(s.level, wanted, s.full, k.ramp, cycle)
    if s.level > 0.0:
        push(state, COLUMN, s.level * math.sin(2.0 * math.pi * s.phase))
    s.phase = (s.phase + k.frequency * cycle) % 1.0


@compiled
def _forget(feel: Any, state: Any) -> None:
    state.shaker.level = 0.0


class StickShaker(Element):
    """T = level · sin(2π ∫ f dt); the level follows ``torque`` while the shaker is on."""

    torque: float = quantity(0.0, "N·m", "amplitude; 0 is off", "thesis 3.5.2", ge=0, le=1e3, live=True)
    frequency: float = quantity(
        20.0, "Hz", "frequency", "assumed: usual for stick shakers, 10 to 30; no published figure was found",
        ge=0.1, lt=1000, live=True,
    )
    ramp: float = quantity(0.0, "s", "time from rest to the full amplitude, and back", "assumed: at once", ge=0, le=100,
                           live=True)  # fmt: skip
    duty: float = quantity(1.0, "1", "share of each period in which it shakes; 1 is without pause",
                           "assumed: without pause", ge=0, le=1, live=True)  # fmt: skip
    period: float = quantity(1.0, "s", "time from one burst to the next", "assumed: a burst a second", ge=0.01, le=100,
                             live=True)  # fmt: skip

    remembers = (("level", np.float64), ("full", np.float64), ("phase", np.float64))
    each_cycle = staticmethod(_each_cycle)
    forget = staticmethod(_forget)
