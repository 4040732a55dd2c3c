"""Resonances of a rig as a chain of shafts, from its parameters alone: motor, gear stages, crank, control."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cls_bench.parameters import Parameters
from cls_bench.parameters.nameplate import neutral_ratio


class Resonances(NamedTuple):
    """Lowest resonances at neutral, hand off [Hz]."""

    free: float
    """of motor and control against each other"""
    held: float
    """of the control on gears and load cell, with the motor held"""


def resonances(p: Parameters) -> Resonances:
    """Undamped, play taken up, in the coordinates of the control's axis."""
    inertias, springs = _chain(p)
    count = len(inertias)
    stiffness = np.zeros((count, count))
    for k, spring in enumerate(springs):
        stiffness[k : k + 2, k : k + 2] += spring * np.array([[1.0, -1.0], [-1.0, 1.0]])
    free = _frequencies(inertias, stiffness)[1]  # the first is the rigid body's, zero
    held = _frequencies(inertias[1:], stiffness[1:, 1:])[0]
    return Resonances(float(free), float(held))


def _chain(p: Parameters) -> tuple[NDArray[np.float64], list[float]]:
    """Inertias [kg·m²] from motor to control and stiffnesses [N·m/rad] between them, seen from the control's axis."""
    link, stages = p.linkage, p.gearbox.in_use
    ratio = neutral_ratio(link)
    at_crank, far, end = link.masses
    crank = link.crank_inertia + (at_crank + far) * link.crank**2  # the rod moves along itself with the crank
    shafts = [p.motor.rotor_inertia + p.gearbox.input_inertia, *(stage.inertia for stage in stages)]
    shafts[-1] += crank  # without a stage the motor is the crank
    behind = p.gearbox.ratio * ratio
    inertias, springs = [shafts[0] * behind**2], []
    for stage, inertia in zip(stages, shafts[1:], strict=True):
        behind /= stage.ratio
        inertias.append(inertia * behind**2)
        springs.append(stage.stiffness * behind**2)
    lever = link.arm if link.kind == "none" else link.arm * math.cos(link.arm_angle - link.rod_angle)
    springs.append(p.load_cell.stiffness * lever**2)
    inertias.append(p.column.inertia + end * link.arm**2)
    return np.array(inertias), springs


def _frequencies(inertias: NDArray[np.float64], stiffness: NDArray[np.float64]) -> NDArray[np.float64]:
    root = 1.0 / np.sqrt(inertias)
    squares = np.linalg.eigvalsh(root[:, None] * stiffness * root[None, :])
    return np.asarray(np.sqrt(np.maximum(squares, 0.0)) / (2.0 * math.pi))
