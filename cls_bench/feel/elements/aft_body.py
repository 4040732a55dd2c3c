"""Aft body: what the linkage moves, from the aft quadrant to the control surface (thesis 3.5.1).

It is a body of its own where ``feel.bodies`` is "two"; then springs, surface, autopilot, detents and gusts act on it,
and ``feel.inertia``, ``damping`` and ``friction`` are those of the column's side. With one body it is left out.
"""

from typing import Any

from cls_bench.compiled import compiled
from cls_bench.feel.element import Element, damper
from cls_bench.quantity import quantity


@compiled
def _act(feel: Any, state: Any, piece: Any) -> None:
    if piece.aft == 1:
        body = feel.aft
        piece.inertia[1] = body.inertia
        damper(piece, 1, body.damping)
        piece.coulomb[1] += body.friction
        piece.static[1] += max(body.friction, body.static_friction)
        piece.stribeck[1] = body.stribeck_velocity


class AftBody(Element):
    """Inertia, damping and friction of the aft body, at the control's axis."""

    inertia: float = quantity(0.35, "kg·m²", "its inertia", "assumed: a little more than the column's side", ge=1e-3,
                              le=100, live=True)  # fmt: skip
    damping: float = quantity(1.5, "N·m·s/rad", "its damping", "assumed: as d_fcs of thesis figure 4.2", ge=0, le=1e4,
                              live=True)  # fmt: skip
    friction: float = quantity(0.25, "N·m", "its Coulomb friction", "assumed: as μ_fcs of thesis figure 4.2", ge=0,
                               le=1e3, live=True)  # fmt: skip
    static_friction: float = quantity(0.0, "N·m", "its friction at rest; 0 is the Coulomb friction",
                                      "0: as in motion", ge=0, le=1e3, live=True)  # fmt: skip
    stribeck_velocity: float = quantity(
        0.0, "rad/s", "speed over which friction falls from that at rest; 0 is at once", "0: at once", ge=0, le=10,
        live=True,
    )

    act = staticmethod(_act)
