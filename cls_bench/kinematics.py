"""Kinematics of the four-bar linkage: motor-side crank, connecting rod, control column (thesis 3.4.2).

Plane of motion x (forward) – z (up); all angles are positive when they turn z towards x and zero at neutral. There,
crank and column arm stand at angles γ and α from the vertical and the rod at ρ from the horizontal; on the thesis's rig
all three are zero, so the linkage ratio at neutral is exactly column arm / crank::

        C1 ───────── rod ───────── C2      C1 = A1 + crank · (sin(φc + γ), cos(φc + γ))
        │                          │       C2 = A2 + arm   · (sin(φ + α),  cos(φ + α))
        │ crank                    │ arm   |C2 − C1| = rod
        │                          │
        A1 (crank axis)            │       A2 = (0, 0),  A1 = what closes it at neutral
                                   A2 (column axis)

The closed form solves A cos ψ + B sin ψ + C = 0 (thesis Eq. 3.5, 3.6). It is written here on its own, for control,
plant and tests alike; the PLC runs :class:`Polynomials` fitted to it.
"""

import math
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cls_bench.compiled import compiled


class FourBar(NamedTuple):
    """A linkage: lengths [m], and angles at neutral [rad].

    Angles of crank and arm from the vertical, positive forward; of the rod from the horizontal, positive with its
    forward end lower. A ``rod`` of 0 is none: crank and column are one shaft, and what the load cell sees is the torque
    over ``arm``.
    """

    crank: float
    rod: float
    arm: float
    crank_angle: float = 0.0
    rod_angle: float = 0.0
    arm_angle: float = 0.0


@compiled
def crank_axis(bar: FourBar) -> tuple[float, float]:
    """Crank axis A1 as (x, z) from the column axis A2 [m]."""
    return (
        bar.arm * math.sin(bar.arm_angle) - bar.rod * math.cos(bar.rod_angle) - bar.crank * math.sin(bar.crank_angle),
        bar.arm * math.cos(bar.arm_angle) + bar.rod * math.sin(bar.rod_angle) - bar.crank * math.cos(bar.crank_angle),
    )


@compiled
def joints(bar: FourBar, crank: float, column: float) -> tuple[float, float, float, float]:
    """Positions C1 and C2 as (x1, z1, x2, z2) from the column axis [m]; crank and column need not fit each other."""
    x, z = crank_axis(bar)
    return (
        x + bar.crank * math.sin(crank + bar.crank_angle),
        z + bar.crank * math.cos(crank + bar.crank_angle),
        bar.arm * math.sin(column + bar.arm_angle),
        bar.arm * math.cos(column + bar.arm_angle),
    )


@compiled
def _closing_angle(px: float, pz: float, radius: float, rod: float, neutral_direction: float, neutral: float) -> float:
    """Angle [rad] from the vertical at which a link of ``radius`` ends ``rod`` away from (px, pz) [m] off its axis.

    Of the two assemblies the one that the linkage has at neutral; NaN where it cannot be closed.
    """
    distance = math.hypot(px, pz)
    cosine = (px * px + pz * pz + radius * radius - rod * rod) / (2.0 * radius * distance)
    if not -1.0 <= cosine <= 1.0:
        return math.nan
    side = 1.0 if math.sin(neutral - neutral_direction) > 0.0 else -1.0
    angle = math.atan2(px, pz) + side * math.acos(cosine)
    turns = math.floor((angle - neutral) / (2.0 * math.pi) + 0.5)
    return angle - 2.0 * math.pi * turns


@compiled
def column_from_crank(bar: FourBar, crank: float) -> float:
    """Column angle [rad] at crank angle ``crank`` [rad]; NaN where the linkage cannot be closed."""
    if bar.rod == 0.0:
        return crank
    x0, z0, _, _ = joints(bar, 0.0, 0.0)
    x, z, _, _ = joints(bar, crank, 0.0)
    return _closing_angle(x, z, bar.arm, bar.rod, math.atan2(x0, z0), bar.arm_angle) - bar.arm_angle


@compiled
def crank_from_column(bar: FourBar, column: float) -> float:
    """Crank angle [rad] at column angle ``column`` [rad]; NaN where the linkage cannot be closed."""
    if bar.rod == 0.0:
        return column
    ax, az = crank_axis(bar)
    _, _, x0, z0 = joints(bar, 0.0, 0.0)
    _, _, x, z = joints(bar, 0.0, column)
    direction = math.atan2(x0 - ax, z0 - az)
    return _closing_angle(x - ax, z - az, bar.crank, bar.rod, direction, bar.crank_angle) - bar.crank_angle


@compiled
def rod_angle(bar: FourBar, crank: float, column: float) -> float:
    """Inclination φ_co [rad] of the connecting rod: 0 when horizontal, positive when its forward end is lower.

    Of a shaft: the column's own, so that a torque is the force times the arm.
    """
    if bar.rod == 0.0:
        return column + bar.arm_angle
    x1, z1, x2, z2 = joints(bar, crank, column)
    return math.atan2(z1 - z2, x2 - x1)


@compiled
def crank_ratio(bar: FourBar, crank: float, column: float) -> float:
    """First derivative dφc/dφ of the crank angle by the column angle: the linkage ratio i_fb.

    From the velocities of C1 and C2 along the rod being equal.
    """
    if bar.rod == 0.0:
        return 1.0
    co = rod_angle(bar, crank, column)
    return bar.arm * math.cos(column + bar.arm_angle - co) / (bar.crank * math.cos(crank + bar.crank_angle - co))


@compiled
def crank_curvature(bar: FourBar, crank: float, column: float) -> float:
    """Second derivative d²φc/dφ² of the crank angle by the column angle.

    Differentiates ln i = ln(arm cos(φ − co)) − ln(crank cos(φc − co)) once more, angles from the vertical.
    """
    if bar.rod == 0.0:
        return 0.0
    co = rod_angle(bar, crank, column)
    ratio = crank_ratio(bar, crank, column)
    of_arm, of_crank = column + bar.arm_angle - co, crank + bar.crank_angle - co
    # Velocity of C2 relative to C1 across the rod, per unit column speed.
    turn = (bar.arm * math.sin(of_arm) - bar.crank * ratio * math.sin(of_crank)) / bar.rod
    return ratio * (math.tan(of_crank) * (ratio - turn) - math.tan(of_arm) * (1.0 - turn))


@compiled
def polynomial(coefficients: Any, x: float) -> float:
    """Value of the polynomial with ascending ``coefficients`` at ``x`` (Horner)."""
    value = 0.0
    for k in range(coefficients.shape[0] - 1, -1, -1):
        value = value * x + coefficients[k]
    return value


class Polynomials(NamedTuple):
    """Polynomials fitted to the linkage over its travel, as a PLC runs them; ascending coefficients of radians."""

    crank: NDArray[np.float64]
    """crank angle over column angle"""
    ratio: NDArray[np.float64]
    """dφc/dφ over column angle"""
    curvature: NDArray[np.float64]
    """d²φc/dφ² over column angle"""
    rod: NDArray[np.float64]
    """inclination of the connecting rod over column angle"""
    column: NDArray[np.float64]
    """column angle over crank angle"""
    inverse_ratio: NDArray[np.float64]
    """dφ/dφc over crank angle"""
    inverse_curvature: NDArray[np.float64]
    """d²φ/dφc² over crank angle"""


@lru_cache(maxsize=32)
def fit_polynomials(bar: FourBar, travel: float, degree: int) -> Polynomials:
    """Least-squares polynomials of ``degree`` over ±``travel`` [rad] of the column (Chebyshev nodes, near-minimax).

    A linkage is fitted once: most benches have the same. Raises ValueError if the linkage cannot be closed over the
    travel.
    """
    order = 8 * (degree + 1)
    nodes = np.cos(np.pi * (np.arange(order) + 0.5) / order)
    column = travel * nodes
    crank = np.array([crank_from_column(bar, x) for x in column])
    if not np.all(np.isfinite(crank)):
        raise ValueError(f"the linkage cannot be closed over ±{math.degrees(travel):.3g}°")
    pairs = list(zip(crank, column, strict=True))
    ratio = np.array([crank_ratio(bar, c, x) for c, x in pairs])
    curvature = np.array([crank_curvature(bar, c, x) for c, x in pairs])
    rod = np.array([rod_angle(bar, c, x) for c, x in pairs])

    def fit(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
        scale = float(np.max(np.abs(x)))
        series = np.polynomial.Chebyshev.fit(x, y, degree, domain=[-scale, scale])
        return np.ascontiguousarray(series.convert(kind=np.polynomial.Polynomial).coef)

    return Polynomials(
        crank=fit(column, crank),
        ratio=fit(column, ratio),
        curvature=fit(column, curvature),
        rod=fit(column, rod),
        column=fit(crank, column),
        inverse_ratio=fit(crank, 1.0 / ratio),
        # d²φ/dφc² = −(d²φc/dφ²) / i³
        inverse_curvature=fit(crank, -curvature / ratio**3),
    )
