"""Down-spring: a long spring that pulls the column forward with a torque that hardly changes, taken as constant."""

from typing import Any

from cls_bench.compiled import compiled
from cls_bench.feel.element import COLUMN, Element, push
from cls_bench.quantity import quantity


@compiled
def _each_cycle(feel: Any, state: Any, time: float, cycle: float) -> None:
    push(state, COLUMN, feel.down_spring.torque)


class DownSpring(Element):
    """A constant torque on the column."""

    torque: float = quantity(0.0, "N·m", "its torque, forward positive", "none unless an aircraft has it", ge=-1e3,
                             le=1e3, live=True)  # fmt: skip

    each_cycle = staticmethod(_each_cycle)
