"""Unbalance: the weight of a surface or of masses in the linkage (thesis 3.5.2).

    T = n_z · (torque + gradient · (φ − φ_level))

A gradient above 0 lets the control fall to its stops; it is felt as far as the springs let it.
"""

from typing import Any

from cls_bench.compiled import compiled
from cls_bench.feel.element import Element, restore, spring
from cls_bench.quantity import WIDEST, quantity


@compiled
def _act(feel: Any, state: Any, piece: Any) -> None:
    u = feel.unbalance
    if u.torque != 0.0 or u.gradient != 0.0:
        restore(piece, piece.aft, -feel.flight.load_factor * u.torque)
        spring(piece, piece.aft, -feel.flight.load_factor * u.gradient, u.level)


class Unbalance(Element):
    """Torque of weights, in level flight; the load factor multiplies it."""

    torque: float = quantity(0.0, "N·m", "constant part, forward positive", "thesis 3.5.2", ge=-1e3, le=1e3, live=True)
    gradient: float = quantity(0.0, "N·m/rad", "part that grows with the angle: above 0 it topples", "thesis 3.5.2",
                               ge=-1e4, le=1e4, live=True)  # fmt: skip
    level: float = quantity(0.0, "rad", "angle at which the growing part is zero", "thesis 3.5.2", gt=-WIDEST,
                            lt=WIDEST, live=True)  # fmt: skip

    act = staticmethod(_act)
