"""Elastic contact with play: gear backlash, stop blocks."""

from typing import Any

from cls_bench.compiled import compiled


@compiled
def contact_torque(deflection: float, rate: float, stiffness: float, damping: float) -> tuple[float, float]:
    """Torque [N·m] of an elastic contact and the damping [N·m·s/rad] that acts in it.

    ``deflection`` [rad] is what is left of the displacement once the play is taken up (0 within the play)::

        torque = c δ + d' δ̇,   d' = min(d, c |δ| / |δ̇|)

    The damping torque never exceeds the spring's, so a contact neither jumps on touch nor pulls on parting (the law
    of Modelica's ElastoBacklash). Passing d' to MuJoCo keeps the damping implicit in its integrator.
    """
    spring = stiffness * deflection
    limited = damping
    if abs(spring) < damping * abs(rate):
        limited = abs(spring) / abs(rate)
    return spring + limited * rate, limited


@compiled
def dead_zone(displacement: float, lower: float, upper: float) -> float:
    """How far ``displacement`` lies outside [``lower``, ``upper``] (0 inside)."""
    if displacement > upper:
        return displacement - upper
    if displacement < lower:
        return displacement - lower
    return 0.0


@compiled
def set_play(
    plant: Any, tendon: int, displacement: float, rate: float, lower: float, upper: float, damping: float
) -> float:
    """Give a tendon its dead zone and its contact damping for this step; returns its torque [N·m]."""
    deflection = dead_zone(displacement, lower, upper)
    torque, limited = contact_torque(deflection, rate, plant.tendon_stiffness[tendon], damping)
    plant.tendon_spring[tendon, 0] = lower
    plant.tendon_spring[tendon, 1] = upper
    plant.tendon_damping[tendon] = limited
    return torque
