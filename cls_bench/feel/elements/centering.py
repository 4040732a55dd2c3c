"""Centering unit: a spring about the trimmed position that saturates at its breakout torque (thesis figure 3.30)."""

from typing import Any

from cls_bench.compiled import compiled
from cls_bench.feel.element import Element, saturating, within
from cls_bench.feel.elements.hydraulics import of_feel_unit
from cls_bench.quantity import quantity


@compiled
def _act(feel: Any, state: Any, piece: Any) -> None:
    if not feel.trim.released:
        share = of_feel_unit(feel)
        unit = feel.centering
        saturating(piece, piece.aft, share * unit.stiffness, state.trim.zero, share * unit.breakout)


@compiled
def _show(feel: Any, state: Any) -> None:
    if not feel.trim.released:
        unit = feel.centering
        torque = unit.stiffness * (state.seat_angle - state.trim.zero)
        state.surface.feel_torque += of_feel_unit(feel) * within(torque, unit.breakout)


class Centering(Element):
    """T = max(−breakout, min(breakout, stiffness · (φ − φ_0)))."""

    stiffness: float = quantity(
        0.0, "N·m/rad", "slope about neutral", "thesis 3.5.2", ge=0, le=1e5, live=True
    )
    breakout: float = quantity(0.0, "N·m", "torque at which it saturates", "thesis 3.5.2", ge=0, le=1e3, live=True)

    act = staticmethod(_act)
    show = staticmethod(_show)
