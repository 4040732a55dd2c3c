"""Gusts: hinge moments of turbulence, coloured noise with a Dryden or von Kármán spectrum (MIL-F-8785C, vertical gust).

White noise goes through the form filter of the vertical gust, with L the scale of turbulence, v the airspeed, τ = L/v::

    Dryden       G(s) = √(τ/π) (1 + √3 τs) / (1 + τs)²
    von Kármán   G(s) = √(τ/π) (1 + 2.7478 τs + 0.3398 τ²s²) / (1 + 2.9958 τs + 1.9754 τ²s² + 0.1539 τ³s³)

The second is the usual rational form of an irrational spectrum; what its tail lacks of the variance, 3.8 %, is spread
over the whole, so that either has the r.m.s. torque asked for. They are integrated by one implicit midpoint step a
cycle, which keeps the variance at any cycle; the noise is the bench's own, seeded.
"""

import math
from typing import Any, Literal

import numpy as np

from cls_bench.compiled import compiled
from cls_bench.feel.element import Element, push
from cls_bench.quantity import quantity

DRYDEN, VON_KARMAN = range(2)

RATIONAL_RMS = 0.9809872131755
"""R.m.s. of the rational form of von Kármán's spectrum, from its Lyapunov equation."""


@compiled
def _each_cycle(feel: Any, state: Any, time: float, cycle: float) -> None:
    k, s = feel.gust, state.gust
    if k.torque <= 0.0 or feel.flight.airspeed <= 0.0:
        return
    # In the time t/τ: x'''·a3 = w − x − a1 x' − a2 x'', y = x + b1 x' + b2 x''.
    step = cycle * feel.flight.airspeed / k.length
    half = 0.5 * step
    white = s.white * math.sqrt(step)  # over the step, of a noise whose spectral density is that of √(τ/π) G
    if k.spectrum == DRYDEN:
        start = s.x1 + half * s.x2
        next2 = s.x2 + white - half * (s.x1 + 2.0 * s.x2)
        s.x2 = (next2 - half * start) / (1.0 + half * (2.0 + half))
        s.x1 = start + half * s.x2
        push(state, 1, k.torque * (s.x1 + math.sqrt(3.0) * s.x2))
        return
    third = 1.0 / 0.1539
    start1, start2 = s.x1 + half * s.x2, s.x2 + half * s.x3
    start3 = s.x3 + third * (white - half * (s.x1 + 2.9958 * s.x2 + 1.9754 * s.x3))
    pivot = 1.0 + half * third * (1.9754 + half * (2.9958 + half))
    s.x3 = (start3 - half * third * (start1 + half * start2 + 2.9958 * start2)) / pivot
    s.x2 = start2 + half * s.x3
    s.x1 = start1 + half * s.x2
    push(state, 1, k.torque / RATIONAL_RMS * (s.x1 + 2.7478 * s.x2 + 0.3398 * s.x3))


class Gust(Element):
    """Torque of turbulence on the aft body, while there is an airspeed."""

    torque: float = quantity(0.0, "N·m", "r.m.s. torque; 0 is calm air", "none unless asked for", ge=0, le=1e3,
                             live=True)  # fmt: skip
    spectrum: Literal["dryden", "von_karman"] = quantity("dryden", "1", "form of the spectrum", "MIL-F-8785C")
    length: float = quantity(533.4, "m", "scale of turbulence L_w", "MIL-F-8785C: 1750 ft from 2000 ft upwards", ge=1,
                             le=1e4)  # fmt: skip

    remembers = (("white", np.float64), ("x1", np.float64), ("x2", np.float64), ("x3", np.float64))
    each_cycle = staticmethod(_each_cycle)
