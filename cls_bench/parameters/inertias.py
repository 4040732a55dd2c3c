"""Inertias as they act, and the damping that damping ratios and tenths of critical mean with them.

For use: by the plant, by the check of its step, by the rules of rigs. What is held against them has its own
(:mod:`cls_bench.linear`, :mod:`cls_bench.verification`, :mod:`cls_bench.analysis`).
"""

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from cls_bench.parameters import GearStage, Parameters


def shaft_inertias(p: "Parameters") -> list[float]:
    """Inertia [kg·m²] of each shaft from the motor's to the crank's, without what the rod adds."""
    inertias = [p.motor.rotor_inertia + p.gearbox.input_inertia, *(stage.inertia for stage in p.gearbox.in_use)]
    inertias[-1] += p.linkage.crank_inertia
    return inertias


def column_inertia(p: "Parameters") -> float:
    """Inertia [kg·m²] of the column with the rod end, without the rod's far mass."""
    return p.column.inertia + p.linkage.masses[2] * p.linkage.arm**2


def limb_inertia(p: "Parameters") -> float:
    """Inertia [kg·m²] of forearm and hand about the column's axis; their weight rests on the pilot's shoulder."""
    return p.limb.mass * p.column.grip_height**2


def mesh_damping(stage: "GearStage", input_inertia: float, output_inertia: float) -> float:
    """Damping [N·m·s/rad] of a mesh: the damping ratio against the two inertias it lies between, at its output."""
    a = input_inertia * stage.ratio**2
    reduced = a * output_inertia / (a + output_inertia)
    return 2.0 * stage.damping_ratio * math.sqrt(stage.stiffness * reduced)


def cell_damping(p: "Parameters") -> float:
    """Damping [N·s/m] of the load cell: its ratio against what it carries, rod end and column, seen at the pin."""
    carried = p.linkage.masses[2] + p.column.inertia / p.linkage.arm**2
    return 2.0 * p.load_cell.damping_ratio * math.sqrt(p.load_cell.stiffness * carried)


def bearing_damping(p: "Parameters") -> float:
    """Presliding damping [N·m·s/rad] of the column's bearing: a tenth of critical for the column.

    Enough to quiet the bristles, too little in sliding.
    """
    return 0.2 * math.sqrt(p.column.bristle_stiffness * column_inertia(p))
