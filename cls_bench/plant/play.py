"""Elastic contact with play: gear backlash, stop blocks."""

from cls_bench.compiled import compiled


@compiled
def contact_torque(deflection: float, rate: float, stiffness: float, damping: float) -> float:
    """Torque [N·m] of an elastic contact.

    ``deflection`` [rad] is what is left of the displacement once the play is taken up (0 within the play)::

        torque = c δ + d' δ̇,   d' = min(d, c |δ| / |δ̇|)

    The damping torque never exceeds the spring's, so a contact neither jumps on touch nor pulls on parting (the law
    of Modelica's ElastoBacklash).
    """
    spring = stiffness * deflection
    dashpot = damping * rate
    bound = abs(spring)
    return spring + min(max(dashpot, -bound), bound)


@compiled
def dead_zone(displacement: float, lower: float, upper: float) -> float:
    """How far ``displacement`` lies outside [``lower``, ``upper``] (0 inside)."""
    if displacement > upper:
        return displacement - upper
    if displacement < lower:
        return displacement - lower
    return 0.0
