"""The plant as coupled inertias, exact for small motion about neutral.

Coordinates q: the shafts from the motor to the crank (one where there is no stage, one more for each), the column, and
the limb while a hand grips [rad]::

    M q̈ + D q̇ + K q = e_motor · K_t i + e_limb · T_hand
    L di/dt = u − R i − K_t θ̇

The mesh of stage k is a spring k (q_k/r − q_{k+1})²/2 at its output, the load cell a spring between crank and column,

    force in the rod  F = c x + d ẋ,   x = lever · φ − lever_crank · φ_c

and the grip a spring and damper between column and limb. Gravity acts as the stiffness, mostly negative, of what stands
above or hangs below its axis. The mass of the rod's far end on the motor's side of the strain gauge moves along the
rod with the crank, the rest of it with the column (thesis 3.6.2: I_fwd is what lies forward of the gauge). A belt or a
worm is a stage like any other. Left out: all that is not linear (backlash, friction and with it self-locking, limits,
quantisation, noise).
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from cls_bench.linear.hand import Hand, grip
from cls_bench.linear.linkage import levers, weight
from cls_bench.parameters import Parameters

Array = NDArray[np.float64]

MOTOR = 0
"""The motor's place in q."""

OSCILLATION = 0.5
"""Where oscillations of the plant begin [Hz]; below it falls over or turns freely."""


@dataclass(frozen=True)
class Plant:
    """M q̈ + D q̇ + K q = …, the motor's electrical side and the force in the rod, all for small motion."""

    mass: Array
    damping: Array
    stiffness: Array
    rod_force: Array
    """force in the rod [N] over (q, q̇)"""
    crank: int
    """the crank's place in q; the column's is the next"""
    grip: tuple[float, float]
    """stiffness [N·m/rad] and damping [N·m·s/rad] of the grip about the column's axis"""
    motor: tuple[float, float, float]
    """torque constant [N·m/A], resistance [Ω], inductance [H]"""

    @property
    def freedoms(self) -> int:
        """Number of coordinates."""
        return len(self.mass)

    @property
    def column(self) -> int:
        """The column's place in q."""
        return self.crank + 1

    @property
    def limb(self) -> int | None:
        """The limb's place in q, if a hand grips."""
        return self.crank + 2 if self.freedoms > self.crank + 2 else None

    def sampled(self, period: float) -> tuple[Array, Array]:
        """Exact transition of (q, q̇, i) over ``period`` [s], and its response to voltage and hand torque held."""
        n = self.freedoms
        constant, resistance, inductance = self.motor
        inverse = np.linalg.inv(self.mass)
        a = np.zeros((2 * n + 1, 2 * n + 1))
        a[:n, n : 2 * n] = np.eye(n)
        a[n : 2 * n, :n] = -inverse @ self.stiffness
        a[n : 2 * n, n : 2 * n] = -inverse @ self.damping
        a[n : 2 * n, 2 * n] = inverse[:, MOTOR] * constant
        a[2 * n, n + MOTOR] = -constant / inductance
        a[2 * n, 2 * n] = -resistance / inductance
        b = np.zeros((2 * n + 1, 2))
        b[2 * n, 0] = 1.0 / inductance
        b[n : 2 * n, 1] = inverse[:, n - 1]  # on the limb; on the column when the hand is off
        block = expm(np.block([[a, b], [np.zeros((2, 2 * n + 3))]]) * period)
        return block[: 2 * n + 1, : 2 * n + 1], block[: 2 * n + 1, 2 * n + 1 :]

    @cached_property
    def modes(self) -> tuple[tuple[float, float], ...]:
        """Undamped frequency [Hz] and damping ratio of every oscillation with the motor switched off, lowest first."""
        n = self.freedoms
        inverse = np.linalg.inv(self.mass)
        first_order = np.block([[np.zeros((n, n)), np.eye(n)], [-inverse @ self.stiffness, -inverse @ self.damping]])
        roots = [root for root in np.linalg.eigvals(first_order) if root.imag > 2.0 * math.pi * OSCILLATION]
        return tuple(sorted((float(abs(root)) / (2.0 * math.pi), -float(root.real / abs(root))) for root in roots))


def plant(p: Parameters, hand: Hand) -> Plant:
    """The plant at neutral with the parameters ``p``."""
    link, column, limb, cell = p.linkage, p.column, p.limb, p.load_cell
    stages = p.gearbox.in_use
    at_crank, far, end = link.masses
    lever = levers(link)
    area = column.grip_height**2
    crank, arm = len(stages), len(stages) + 1
    n = arm + (1 if hand.squeeze is None else 2)

    shafts = np.array([p.motor.rotor_inertia + p.gearbox.input_inertia, *(stage.inertia for stage in stages)])
    shafts[crank] += link.crank_inertia
    inertias = np.zeros(n)
    inertias[: crank + 1] = shafts
    inertias[crank] += at_crank * link.crank**2 + far * lever.crank**2
    inertias[arm] = column.inertia + end * link.arm**2 + far * lever.column_across**2

    stiffness, damping = np.zeros((n, n)), np.zeros((n, n))
    for k, stage in enumerate(stages):
        # The damping ratio is a designer's number for the bare shafts, without the rod's masses.
        one, other = shafts[k] * stage.ratio**2, shafts[k + 1]
        critical = 2.0 * math.sqrt(stage.stiffness * one * other / (one + other))
        mesh = {k: 1.0 / stage.ratio, k + 1: -1.0}
        stiffness += _spring(n, stage.stiffness, mesh)
        damping += _spring(n, stage.damping_ratio * critical, mesh)
    stretch = {arm: lever.column, crank: -lever.crank}
    carried = end + column.inertia / link.arm**2
    cell_damping = cell.damping_ratio * 2.0 * math.sqrt(cell.stiffness * carried)
    stiffness += _spring(n, cell.stiffness, stretch)
    damping += _spring(n, cell_damping, stretch) + _spring(n, column.viscous_friction, {arm: 1.0})
    stiffness[crank : arm + 1, crank : arm + 1] += weight(link, column)

    held = (0.0, 0.0)
    if hand.squeeze is not None:
        held = grip(p, hand.squeeze)
        inertias[arm + 1] = limb.mass * area
        between = {arm + 1: 1.0, arm: -1.0}
        stiffness += _spring(n, held[0], between)
        damping += _spring(n, held[1], between)
        if hand.arm:
            stiffness[arm + 1, arm + 1] += area * limb.arm_stiffness
            damping[arm + 1, arm + 1] += area * limb.arm_damping
    along = np.zeros(n)
    along[arm], along[crank] = lever.column, -lever.crank
    return Plant(
        np.diag(inertias), damping, stiffness, np.concatenate([cell.stiffness * along, cell_damping * along]), crank,
        held, (p.motor.torque_constant, p.motor.resistance, p.motor.inductance),
    )  # fmt: skip


def rigid(p: Parameters) -> tuple[float, float]:
    """As if all were stiff, at neutral: turns of the motor for one of the column, and inertia at the motor [kg·m²]."""
    ratio = p.gearbox.ratio * levers(p.linkage).ratio
    turns = np.array([1.0, *(1.0 / np.cumprod([stage.ratio for stage in p.gearbox.in_use])), 1.0 / ratio])
    return ratio, float(turns @ plant(p, Hand(None)).mass @ turns)


def resonances(p: Parameters, hand: Hand | None = None) -> tuple[float, ...]:
    """Undamped frequencies of the plant [Hz] with the motor switched off, lowest first; hand off unless given."""
    return tuple(frequency for frequency, _ in plant(p, hand or Hand(None)).modes)


def _spring(n: int, value: float, coefficients: Mapping[int, float]) -> Array:
    """Matrix of a spring or damper over Σ coefficient · q."""
    row = np.zeros(n)
    for place, coefficient in coefficients.items():
        row[place] = coefficient
    return value * np.outer(row, row)
