"""The least simulated inertia that is stable however the pilot grips, by the linear model."""

import math
from collections.abc import Sequence

import numpy as np
from scipy.optimize import brentq

from cls_bench.linear.bench import LinearBench
from cls_bench.linear.hand import Hand, forward_inertia
from cls_bench.linear.variation import changed
from cls_bench.parameters import Parameters
from cls_bench.parameters.override import bounds

GRIPS = (
    Hand(None),
    *(Hand(squeeze / 10.0, arm) for arm in (True, False) for squeeze in range(10, -1, -1)),
)
"""No hand, and every squeeze with an arm that holds its place and with one that pushes with a force alone."""

STEPS = 40
"""Steps in which the range is searched."""


def search_range(p: Parameters) -> tuple[float, float]:
    """I_fcs [kg·m²] between which a least one is searched: from far below the bare column's to far above the limb's.

    Not beyond what ``feel.inertia`` may be.
    """
    least, most = bounds("feel.inertia")
    return max(0.25 * forward_inertia(p, Hand(None)), least), min(20.0 * forward_inertia(p, Hand()), most)


def least_inertia(
    p: Parameters, grips: Sequence[Hand] = GRIPS, *, low: float | None = None, high: float | None = None
) -> tuple[float, Hand]:
    """Least I_fcs [kg·m²] above which every one of ``grips`` is stable, and the one that turns unstable there.

    Damping and stiffness of the feel model stay as they are, as when an onset over ``feel.inertia`` is searched. 0 if
    all of the range (:func:`search_range` unless given) is stable, inf if its upper end is not.
    """
    default = search_range(p)
    low, high = default[0] if low is None else low, default[1] if high is None else high
    values = [float(value) for value in np.clip(np.geomspace(high, low, STEPS), low, high)]
    worst, which = 0.0, grips[0]
    for hand in grips:
        if math.isinf(worst):
            break
        if (value := _onset(p, hand, values, worst)) > worst:
            worst, which = value, hand
    return worst, which


def _onset(p: Parameters, hand: Hand, values: Sequence[float], beyond: float) -> float:
    """Greatest unstable inertia of a grip that is ``beyond`` one, from the top of the falling ``values`` on; else 0."""

    def growth(inertia: float) -> float:
        return LinearBench(changed(p, "feel.inertia", inertia), hand).growth_rate

    if beyond > 0.0:
        values = [*(value for value in values if value > beyond), beyond]
    above: float | None = None
    for value in values:
        if growth(value) > 0.0:
            return math.inf if above is None else float(brentq(growth, value, above, rtol=1e-4))
        above = value
    return 0.0
