"""Bob-weight: a mass at the column that the load factor pulls forward, T = torque · n_z (thesis 2.2.2)."""

from typing import Any

from cls_bench.compiled import compiled
from cls_bench.feel.element import COLUMN, Element, push
from cls_bench.quantity import quantity


@compiled
def _each_cycle(feel: Any, state: Any, time: float, cycle: float) -> None:
    push(state, COLUMN, feel.bob_weight.torque * feel.flight.load_factor)


class BobWeight(Element):
    """A force for each g, against the pull that made it. Its inertia belongs to ``feel.inertia``."""

    torque: float = quantity(0.0, "N·m", "torque for each g of load factor, forward positive", "thesis 2.2.2", ge=-1e3,
                             le=1e3, live=True)  # fmt: skip

    each_cycle = staticmethod(_each_cycle)
