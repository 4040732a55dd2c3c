"""Disturbances T_dis: a torque, and a vibration (thesis 3.5.2). Gusts are in ``gust.py``."""

import math
from typing import Any

import numpy as np

from cls_bench.compiled import compiled
from cls_bench.feel.element import Element, push
from cls_bench.quantity import quantity


@compiled
def _each_cycle(feel: Any, state: Any, time: float, cycle: float) -> None:
    k, s = feel.disturbance, state.disturbance
    torque = k.torque
    if k.vibration > 0.0:
        torque += k.vibration * math.sin(2.0 * math.pi * s.phase)
    s.phase = (s.phase + k.frequency * cycle) % 1.0
    push(state, 1, torque)


class Disturbance(Element):
    """T = torque + vibration · sin(2π ∫ f dt) on the aft body."""

    torque: float = quantity(0.0, "N·m", "T_dis", "thesis 3.5.2", ge=-1e3, le=1e3, live=True)
    vibration: float = quantity(0.0, "N·m", "amplitude of a vibration", "none unless an aircraft has it", ge=0, le=1e3,
                                live=True)  # fmt: skip
    frequency: float = quantity(15.0, "Hz", "its frequency", "assumed: a propeller at 900 r.p.m.", ge=0.1, lt=1000,
                                live=True)  # fmt: skip

    remembers = (("phase", np.float64),)  # in turns
    each_cycle = staticmethod(_each_cycle)
