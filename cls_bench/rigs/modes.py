"""A rig as a chain of shafts: motor, gear stages, crank, control; its resonances, and what the motor finds of it."""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cls_bench.parameters import Parameters
from cls_bench.parameters.inertias import cell_damping, column_inertia, mesh_damping, shaft_inertias

Array = NDArray[np.float64]


class Resonances(NamedTuple):
    """Lowest resonances at neutral, hand off [Hz]."""

    free: float
    """of motor and control against each other"""
    held: float
    """of the control on gears and load cell, with the motor held"""


class Chain(NamedTuple):
    """Shafts from motor to control, play taken up, all seen from the control's axis; weight is left out."""

    inertias: Array
    """of the shafts [kg·m²]"""
    springs: Array
    """between them [N·m/rad]"""
    dampers: Array
    """likewise [N·m·s/rad]"""
    ratio: float
    """turns of the motor for one of the control"""

    def coupled(self, values: Array) -> Array:
        """Matrix of the springs or dampers ``values`` between the shafts."""
        matrix = np.diag(np.append(values, 0.0) + np.append(0.0, values))
        return np.asarray(matrix - np.diag(values, 1) - np.diag(values, -1))

    def mobility(self, frequencies: Any) -> NDArray[np.complex128]:
        """Speed of the motor for a torque of 1 N·m on it, at ``frequencies`` [Hz]."""
        s = 2j * math.pi * np.asarray(frequencies)[:, None, None]
        impedance = s * np.diag(self.inertias) + self.coupled(self.dampers) + self.coupled(self.springs) / s
        torque = np.zeros((len(s), len(self.inertias), 1))
        torque[:, 0] = 1.0
        return np.asarray(np.linalg.solve(impedance, torque)[:, 0, 0] * self.ratio**2)

    @property
    def modes(self) -> Array:
        """Undamped frequencies [Hz], lowest first: that of the rigid body, zero, and the resonances."""
        return _frequencies(self.inertias, self.coupled(self.springs))


def resonances(p: Parameters) -> Resonances:
    """Undamped, play taken up."""
    found = chain(p)
    held = _frequencies(found.inertias[1:], found.coupled(found.springs)[1:, 1:])[0]
    return Resonances(float(found.modes[1]), float(held))


def chain(p: Parameters) -> Chain:
    """The shafts of a rig at neutral."""
    link, cell = p.linkage, p.load_cell
    at_crank, far, _ = link.masses
    lever, shafts = link.levers, shaft_inertias(p)
    behind = ratio = p.gearbox.ratio * lever.ratio
    inertias, springs, dampers = [shafts[0] * behind**2], [], []
    for stage, before, after in zip(p.gearbox.in_use, shafts, shafts[1:], strict=False):
        behind /= stage.ratio
        inertias.append(after * behind**2)
        springs.append(stage.stiffness * behind**2)
        dampers.append(mesh_damping(stage, before, after) * behind**2)
    # The rod's far mass moves along the rod with the crank, across it with the control.
    inertias[-1] += (at_crank * link.crank**2 + far * lever.crank**2) * lever.ratio**2
    inertias.append(column_inertia(p) + far * lever.across**2)
    springs.append(cell.stiffness * lever.column**2)
    dampers.append(cell_damping(p) * lever.column**2)
    return Chain(np.array(inertias), np.array(springs), np.array(dampers), ratio)


def _frequencies(inertias: Array, stiffness: Array) -> Array:
    root = 1.0 / np.sqrt(inertias)
    squares = np.linalg.eigvalsh(root[:, None] * stiffness * root[None, :])
    return np.asarray(np.sqrt(np.maximum(squares, 0.0)) / (2.0 * math.pi))
