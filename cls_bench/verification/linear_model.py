"""The bench linearised at neutral, written down by hand: masses, springs and dampers in a row.

Coordinates θ (motor), α (carrier 1), ψ (crank), φ (column); ratios r of a stage, radii a and b of crank and arm. At
neutral, crank and arm stand across the rod, so to first order the rod moves along itself with a ψ and bears no part
in the column's motion but its own stretch b φ − a ψ::

    M = diag(J_M, J_1, J_C + (m_C + m_F) a², J_A + m_E b²)
    springs: c1 on θ/r − α,  c2 on α/r − ψ,  c on b φ − a ψ;  dampers beside them, and the bearing's on φ
    gravity: −m_C g a on ψ,  −(m h + (m_F + m_E) b) g on φ      (m_F: the rod's far mass hangs on the column)

Friction and backlash are left out; the meshes carry a load, or their dampers would not act in full.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cls_bench.parameters import GRAVITY, Parameters

Array = NDArray[np.float64]


class LinearModel(NamedTuple):
    """M q̈ + D q̇ + K q = torque, for q = (θ, α, ψ, φ)."""

    mass: Array
    damping: Array
    stiffness: Array

    def response(self, frequency: float) -> complex:
        """Column angle over motor torque [rad/(N·m)] at ``frequency`` [Hz]."""
        s = 2j * math.pi * frequency
        dynamic = self.mass * s**2 + self.damping * s + self.stiffness
        return complex(np.linalg.solve(dynamic, np.array([1.0, 0.0, 0.0, 0.0]))[3])

    def resonances(self) -> list[tuple[float, float]]:
        """Undamped frequency [Hz] and damping ratio of every oscillating mode, lowest first."""
        size = len(self.mass)
        inverse = np.linalg.inv(self.mass)
        first_order = np.block(
            [[np.zeros((size, size)), np.eye(size)], [-inverse @ self.stiffness, -inverse @ self.damping]]
        )
        roots = [root for root in np.linalg.eigvals(first_order) if root.imag > 1.0]
        return sorted((abs(root) / (2.0 * math.pi), -root.real / abs(root)) for root in roots)


def linear_model(p: Parameters) -> LinearModel:
    """The model of a bench with parameters ``p``."""
    box, link, column, cell = p.gearbox, p.linkage, p.column, p.load_cell
    a, b = link.crank, link.arm
    motor = p.motor.rotor_inertia + box.input_inertia
    crank = link.crank_inertia + box.carrier2_inertia
    far = link.rod_column_mass - link.rod_end_mass
    with_rod = crank + (link.rod_crank_mass + far) * a**2
    with_rod_end = column.inertia + link.rod_end_mass * b**2
    mass = np.diag([motor, box.carrier1_inertia, with_rod, with_rod_end])

    def damper(ratio: float, stiffness: float, one: float, other: float) -> float:
        return 2.0 * ratio * math.sqrt(stiffness * one * other / (one + other))

    stage1 = np.array([1.0 / box.ratio, -1.0, 0.0, 0.0])
    stage2 = np.array([0.0, 1.0 / box.ratio, -1.0, 0.0])
    rod = np.array([0.0, 0.0, -a, b])
    carried = link.rod_end_mass + column.inertia / b**2
    springs = (
        (stage1, box.stage1.stiffness,
         damper(box.stage1.damping_ratio, box.stage1.stiffness, motor * box.ratio**2, box.carrier1_inertia)),
        (stage2, box.stage2.stiffness,
         damper(box.stage2.damping_ratio, box.stage2.stiffness, box.carrier1_inertia * box.ratio**2, crank)),
        (rod, cell.stiffness, 2.0 * cell.damping_ratio * math.sqrt(cell.stiffness * carried)),
    )  # fmt: skip
    stiffness, damping = np.zeros((4, 4)), np.zeros((4, 4))
    for direction, spring, dash in springs:
        stiffness += spring * np.outer(direction, direction)
        damping += dash * np.outer(direction, direction)
    damping[3, 3] += column.viscous_friction
    stiffness[2, 2] -= link.rod_crank_mass * GRAVITY * a
    stiffness[3, 3] -= GRAVITY * (column.mass * column.mass_height + link.rod_column_mass * b)
    return LinearModel(mass, damping, stiffness)
