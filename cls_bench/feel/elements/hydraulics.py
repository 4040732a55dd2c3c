"""Hydraulics: what their failure takes away and adds (thesis 2.2.2; hydraulics off).

``pressure`` is a share of what it should be. With it go the boost of the surface's actuator and the hydraulic share of
the feel unit; as it fails, the actuator becomes a load: friction of valve and seals, damping of the oil that bypasses.
While there is pressure the actuator moves the surface at most at ``maximum_rate`` · √pressure, the speed of a valve
that is fully open; beyond, the pilot pushes against the oil, a damper of ``rate_damping`` · pressure: the bypass
opens as the pressure falls, so that a failure that takes its time ends where hydraulics that are off begin.
"""

import math
from typing import Any

from cls_bench.compiled import compiled
from cls_bench.feel.element import Element, condition, damper, restore
from cls_bench.quantity import quantity


@compiled
def of_feel_unit(feel: Any) -> float:
    """Share of the feel unit's torque that is left."""
    return float(1.0 - feel.hydraulics.feel_share * (1.0 - feel.hydraulics.pressure))


@compiled
def _act(feel: Any, state: Any, piece: Any) -> None:
    h = feel.hydraulics
    lost = 1.0 - h.pressure
    if lost > 0.0:
        piece.coulomb[piece.aft] += lost * h.off_friction
        piece.static[piece.aft] += lost * h.off_friction
        damper(piece, piece.aft, lost * h.off_damping)
    damping = h.pressure * h.rate_damping
    if h.maximum_rate > 0.0 and damping > 0.0:
        most = h.maximum_rate * math.sqrt(h.pressure)
        speed = piece.speed_ahead[piece.aft]
        if speed > most:
            damper(piece, piece.aft, damping)
            restore(piece, piece.aft, -damping * most)
            condition(piece, piece.aft, 0.0, 1.0, -most)
        elif speed < -most:
            damper(piece, piece.aft, damping)
            restore(piece, piece.aft, damping * most)
            condition(piece, piece.aft, 0.0, -1.0, -most)
        else:
            condition(piece, piece.aft, 0.0, -1.0, most)
            condition(piece, piece.aft, 0.0, 1.0, most)


class Hydraulics(Element):
    """Pressure of the hydraulic system, and what comes of its loss."""

    pressure: float = quantity(1.0, "1", "share of the full pressure: 1 whole, 0 off", "whole unless it fails", ge=0,
                               le=1, live=True)  # fmt: skip
    feel_share: float = quantity(
        1.0, "1", "share of the feel unit's torque that is hydraulic", "assumed: a q-feel unit is hydraulic as a whole",
        ge=0, le=1, live=True,
    )
    off_friction: float = quantity(0.0, "N·m", "friction of valve and actuator without pressure",
                                   "none unless an aircraft has it", ge=0, le=1e3, live=True)  # fmt: skip
    off_damping: float = quantity(0.0, "N·m·s/rad", "damping of the oil that bypasses without pressure",
                                  "none unless an aircraft has it", ge=0, le=1e4, live=True)  # fmt: skip
    maximum_rate: float = quantity(0.0, "rad/s", "greatest rate of the actuator at full pressure; 0 is none",
                                   "none unless an aircraft has it", ge=0, le=1e3, live=True)  # fmt: skip
    rate_damping: float = quantity(
        200.0, "N·m·s/rad", "damping beyond that rate at full pressure",
        "assumed: a hand cannot go beyond it by much", ge=0,
        le=1e4, live=True,
    )

    act = staticmethod(_act)
