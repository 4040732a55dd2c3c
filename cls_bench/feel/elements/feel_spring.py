"""Feel spring: c_fcs about the trimmed position, with the part that follows dynamic pressure (thesis 2.2.2, 3.5.2).

    T = (stiffness + min(gradient · ½ρv², most)) · (φ − φ_0)

``feel.stiffness`` stands for the spring feel unit, or for aerodynamic loads at a fixed speed; the gradient is a q-feel
unit. Hydraulics that fail take their share of both (:mod:`cls_bench.feel.elements.hydraulics`).
"""

from typing import Any

from cls_bench.compiled import compiled
from cls_bench.feel.element import Element, spring
from cls_bench.feel.elements.hydraulics import of_feel_unit
from cls_bench.quantity import quantity


@compiled
def stiffness(feel: Any) -> float:
    """Stiffness [N·m/rad] of the feel unit's springs in this flight condition."""
    q_feel = min(feel.q_feel.gradient * feel.flight.dynamic_pressure, feel.q_feel.most)
    return float(of_feel_unit(feel) * (feel.stiffness + q_feel))


@compiled
def _act(feel: Any, state: Any, piece: Any) -> None:
    if not feel.trim.released:
        spring(piece, piece.aft, stiffness(feel), state.trim.zero)


@compiled
def _show(feel: Any, state: Any) -> None:
    if not feel.trim.released:
        state.surface.feel_torque += stiffness(feel) * (state.seat_angle - state.trim.zero)


class QFeel(Element):
    """The part of the feel spring's stiffness that grows with dynamic pressure."""

    gradient: float = quantity(
        0.0, "N·m/rad/Pa", "stiffness for each pascal of dynamic pressure", "thesis 2.2.2: c_fcs is proportional to it",
        ge=0, le=1e3, live=True,
    )
    most: float = quantity(
        1e5, "N·m/rad", "stiffness at which the unit ends", "assumed: no end before the greatest stiffness there is",
        ge=0, le=1e5, live=True,
    )

    act = staticmethod(_act)
    show = staticmethod(_show)
