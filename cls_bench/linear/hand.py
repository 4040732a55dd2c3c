"""The hand at an operating point: how it grips, and what inertia lies forward of the load cell with it."""

from dataclasses import dataclass

from cls_bench.linear.linkage import levers
from cls_bench.parameters import Parameters


@dataclass(frozen=True)
class Hand:
    """The hand at the operating point."""

    squeeze: float | None = 1.0
    """how tightly it grips, 0 loose to 1 tight; None when it has let go"""
    arm: bool = True
    """whether the arm holds its place with its impedance; otherwise the limb's mass is free, as under a given force"""

    def __str__(self) -> str:
        """In words."""
        if self.squeeze is None:
            return "hand off"
        return f"squeeze {self.squeeze:g}" + ("" if self.arm else ", driven by a force")


def grip(p: Parameters, squeeze: float) -> tuple[float, float]:
    """Stiffness [N·m/rad] and damping [N·m·s/rad] of the grip about the column's axis."""
    area = p.column.grip_height**2
    return (
        area * _between(p.limb.loose_stiffness, p.limb.tight_stiffness, squeeze),
        area * _between(p.limb.loose_damping, p.limb.tight_damping, squeeze),
    )


def _between(loose: float, tight: float, squeeze: float) -> float:
    """A grip value at ``squeeze``: on a logarithmic scale, or straight where one end is zero."""
    if loose > 0.0 and tight > 0.0:
        return float(loose ** (1.0 - squeeze) * tight**squeeze)
    return loose + squeeze * (tight - loose)


def forward_inertia(p: Parameters, hand: Hand) -> float:
    """I_fwd [kg·m²]: column, what moves with it without the strain gauge's help, and a limb as if gripped rigidly."""
    _, far, end = p.linkage.masses
    limb = 0.0 if hand.squeeze is None else p.limb.mass * p.column.grip_height**2
    return p.column.inertia + end * p.linkage.arm**2 + far * levers(p.linkage).column_across**2 + limb


def limb_mass_for(p: Parameters, inertia: float) -> float:
    """Limb mass [kg] with which a rigid grip makes I_fwd ``inertia`` [kg·m²]; negative below the bare column's."""
    return (inertia - forward_inertia(p, Hand(None))) / p.column.grip_height**2
