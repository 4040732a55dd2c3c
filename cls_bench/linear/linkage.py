"""The linkage at neutral: its levers, and the weight of what it carries, to second order.

Crank and column arm stand at γ and α from the vertical, the rod at ρ from the horizontal. With u along the rod, n
across it, and the joints C1 = A1 + crank (sin(φc + γ), cos(φc + γ)), C2 = arm (sin(φ + α), cos(φ + α))::

    u = (cos ρ, −sin ρ)    u·∂C1/∂φc = crank cos(γ − ρ)    u·∂C2/∂φ = arm cos(α − ρ)
    n = (sin ρ,  cos ρ)                                    n·∂C2/∂φ = −arm sin(α − ρ)

A rod that stretches carries the mass on the crank's side of its strain gauge at P = C1 + L u, a rod's length L from the
crank pin: along the rod that mass moves as the crank pin does, across it as the column's pin. u is perpendicular to n,
so the mass matrix stays diagonal.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cls_bench.parameters import GRAVITY, Column, Linkage


class Levers(NamedTuple):
    """Levers at neutral [m]."""

    crank: float
    """of the rod's force about the crank's axis"""
    column: float
    """of the rod's force about the column's axis"""
    column_across: float
    """of a force across the rod, at its forward joint, about the column's axis"""

    @property
    def ratio(self) -> float:
        """dφc/dφ."""
        return self.column / self.crank


def levers(link: Linkage) -> Levers:
    """Levers of the linkage; a shaft's torque cell is a force at ``arm`` on either side."""
    if link.kind == "none":
        return Levers(link.arm, link.arm, 0.0)
    return four_bar(link.crank, link.arm, link.crank_angle, link.rod_angle, link.arm_angle)


def four_bar(crank: float, arm: float, crank_angle: float, rod_angle: float, arm_angle: float) -> Levers:
    """Levers of a four-bar linkage [m, rad]."""
    return Levers(
        crank * math.cos(crank_angle - rod_angle), arm * math.cos(arm_angle - rod_angle),
        -arm * math.sin(arm_angle - rod_angle),
    )  # fmt: skip


def weight(link: Linkage, column: Column) -> NDArray[np.float64]:
    """Stiffness [N·m/rad] that weight gives crank and column, ∂²V/∂q² of V = g Σ m z at neutral; 2 × 2.

    The constant torques that an arm or crank off the vertical has there are left out, and so is what the rod, carrying
    them, adds in stiffness: drive and zero of the load cell take them.
    """
    of_column = np.diag([0.0, -column.mass * column.mass_height])
    if link.kind == "none":
        return GRAVITY * of_column
    at_crank, far, end = link.masses
    gamma, rho, alpha = link.crank_angle, link.rod_angle, link.arm_angle
    u = np.array([math.cos(rho), -math.sin(rho)])
    n = np.array([math.sin(rho), math.cos(rho)])
    # d = C2 − C1 over (φc, φ): first and second derivatives (the mixed one is zero).
    first = np.array([
        [-link.crank * math.cos(gamma), link.crank * math.sin(gamma)],
        [link.arm * math.cos(alpha), -link.arm * math.sin(alpha)],
    ])  # fmt: skip
    second = np.zeros((2, 2, 2))
    second[0, 0] = [link.crank * math.sin(gamma), link.crank * math.cos(gamma)]
    second[1, 1] = [-link.arm * math.sin(alpha), -link.arm * math.cos(alpha)]
    stretch, turn = first @ u, first @ n / link.rod
    height = np.array([-link.crank * math.cos(gamma), -link.arm * math.cos(alpha)])  # ∂²z/∂q² of C1 and of C2
    # ∂²(L u) = −L u ∂ω ∂ω + n (n·∂²d − ∂ω ∂s − ∂s ∂ω) at |d| = L, ω the rod's turn and s its stretch
    rod = -link.rod * u[1] * np.outer(turn, turn) + n[1] * (
        second @ n - np.outer(turn, stretch) - np.outer(stretch, turn)
    )
    c1, c2 = np.diag([height[0], 0.0]), np.diag([0.0, height[1]])
    return np.asarray(GRAVITY * (of_column + at_crank * c1 + end * c2 + far * (c1 + rod)))
