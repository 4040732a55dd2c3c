"""Units of an aircraft's numbers: those of the grip become torques and angles by the rig's own grip.

A force F at the grip is a torque F · r about the control's axis with r = ``column.grip_height`` of the rig; a travel s
along the grip's arc is the angle s / r, a mass m there the inertia m · r². ``force_scale`` and ``angle_scale`` make the
rig's forces and angles smaller than the aircraft's: a stiffness goes with their ratio, and so do inertia and damping,
so that natural frequency and damping ratio stay.
"""

import math
from collections.abc import Mapping
from typing import NamedTuple

from cls_bench.atmosphere import KNOT
from cls_bench.quantity import DEG, GRAVITY

POUND = 0.45359237 * GRAVITY
"""One pound-force [N] (exact by definition)."""

INCH = 0.0254
"""One inch [m] (exact by definition)."""


class Unit(NamedTuple):
    """What a unit means: value · factor · r^grip · force_scale^force · angle_scale^angle, in ``si``."""

    si: str
    """unit of the parameters that may be given in it"""
    factor: float
    grip: int = 0
    """power of the grip's radius r [m]"""
    force: int = 0
    """power of the force scale"""
    angle: int = 0
    """power of the angle scale"""

    def converted(self, value: float, grip: float, scale: "Scale", *, of_control: bool = True) -> float:
        """``value`` in SI on a rig with this grip; the angle scale is that of the control, of nothing else."""
        angle = self.angle if of_control else 0
        return value * self.factor * grip**self.grip * scale.force**self.force * scale.angle**angle


class Scale(NamedTuple):
    """How much smaller forces and angles are on the rig than in the aircraft."""

    force: float = 1.0
    angle: float = 1.0


UNITS: Mapping[str, Unit] = {
    # torques, by the force at the grip or as they are
    "N·m": Unit("N·m", 1.0, 0, 1), "N": Unit("N·m", 1.0, 1, 1), "daN": Unit("N·m", 10.0, 1, 1),
    "lbf": Unit("N·m", POUND, 1, 1), "kgf": Unit("N·m", GRAVITY, 1, 1),
    # stiffnesses
    "N·m/rad": Unit("N·m/rad", 1.0, 0, 1, -1), "N·m/deg": Unit("N·m/rad", 1.0 / DEG, 0, 1, -1),
    "N/deg": Unit("N·m/rad", 1.0 / DEG, 1, 1, -1), "lbf/deg": Unit("N·m/rad", POUND / DEG, 1, 1, -1),
    "N/mm": Unit("N·m/rad", 1e3, 2, 1, -1), "lbf/in": Unit("N·m/rad", POUND / INCH, 2, 1, -1),
    "N/deg/Pa": Unit("N·m/rad/Pa", 1.0 / DEG, 1, 1, -1), "N·m/rad/Pa": Unit("N·m/rad/Pa", 1.0, 0, 1, -1),
    # angles, also as travel along the grip's arc
    "rad": Unit("rad", 1.0, 0, 0, 1), "deg": Unit("rad", DEG, 0, 0, 1),
    "mm": Unit("rad", 1e-3, -1, 0, 1), "in": Unit("rad", INCH, -1, 0, 1),
    "rad/s": Unit("rad/s", 1.0, 0, 0, 1), "deg/s": Unit("rad/s", DEG, 0, 0, 1),
    # inertias and dampings
    "kg·m²": Unit("kg·m²", 1.0, 0, 1, -1), "kg": Unit("kg·m²", 1.0, 2, 1, -1),
    "N·m·s/rad": Unit("N·m·s/rad", 1.0, 0, 1, -1), "N·s/m": Unit("N·m·s/rad", 1.0, 2, 1, -1),
    # the surface: R = dδ/dφ is rad a metre of the grip's travel times r; S takes the scales of its torque R · H
    "rad/m": Unit("1", 1.0, 1, 0, -1), "m²": Unit("m²", 1.0, 0, 1, 1),
    # what no scale touches
    "1": Unit("1", 1.0), "m": Unit("m", 1.0), "1/rad": Unit("1/rad", 1.0), "s": Unit("s", 1.0),
    "Hz": Unit("Hz", 1.0), "Pa": Unit("Pa", 1.0), "mbar": Unit("Pa", 100.0), "m/s": Unit("m/s", 1.0),
    "kt": Unit("m/s", KNOT),
}  # fmt: skip
"""What each unit of a file means."""

LOCAL = ("surface.deflection", "flight.angle_of_attack", "flight.tab")
"""Angles that are not the control's."""


def units_for(si: str) -> list[str]:
    """Units in which a parameter with the unit ``si`` may be given."""
    return [name for name, unit in UNITS.items() if unit.si == si]


def find_unit(name: str, si: str) -> Unit | None:
    """What the unit ``name`` means for a parameter with the unit ``si``; None if it means nothing."""
    found = UNITS.get(name)
    return found if found is not None and found.si == si else None


def at_grip(value: float, unit: str, grip: float, scale: Scale) -> float:
    """A force of the aircraft, or a torque about its control, as a force at the rig's grip [N]."""
    found = find_unit(unit, "N·m")
    if found is None:
        raise ValueError(f"{unit} is no unit of a force")
    return found.converted(value, grip, scale) / grip


def angle_deg(value: float, unit: str, grip: float, scale: Scale) -> float:
    """An angle of the aircraft's control, or a travel of its grip, as an angle of the rig's control [deg]."""
    found = find_unit(unit, "rad")
    if found is None:
        raise ValueError(f"{unit} is no unit of an angle or travel")
    return math.degrees(found.converted(value, grip, scale))
