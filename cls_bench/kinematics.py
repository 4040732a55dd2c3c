"""Kinematics of the four-bar linkage: motor-side crank, connecting rod, control column (thesis 3.4.2).

Plane of motion x (forward) – z (up); all angles are positive when they turn z towards x and zero at neutral. At
neutral, crank and column arm are vertical and the connecting rod is horizontal, so the linkage ratio there is exactly
column arm / crank::

        C1 ───────── rod ───────── C2      C1 = A1 + crank · (sin φc, cos φc)
        │                          │       C2 = A2 + arm   · (sin φ,  cos φ)
        │ crank                    │ arm   |C2 − C1| = rod
        │                          │
        A1 (crank axis)            │       A2 = (0, 0),  A1 = (−rod, arm − crank)
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
    """Lengths of the linkage [m]."""

    crank: float
    rod: float
    arm: float


@compiled
def _other_angle(known: float, known_radius: float, dx: float, dz: float, other_radius: float, rod: float) -> float:
    """Angle [rad] of the link of ``other_radius`` whose axis lies at (dx, dz) from the known link's axis.

    Of the two assemblies the one near neutral is returned; NaN where the linkage cannot be closed.
    """
    px = known_radius * math.sin(known) - dx
    pz = known_radius * math.cos(known) - dz
    distance = math.hypot(px, pz)
    cosine = (px * px + pz * pz + other_radius * other_radius - rod * rod) / (2.0 * other_radius * distance)
    if not -1.0 <= cosine <= 1.0:
        return math.nan
    direction = math.atan2(px, pz)
    # The other joint lies to the side on which the rod extends: forward of the crank, aft of the column.
    side = 1.0 if dx > 0.0 else -1.0
    return direction + side * math.acos(cosine)


@compiled
def column_from_crank(bar: FourBar, crank: float) -> float:
    """Column angle [rad] at crank angle ``crank`` [rad]; NaN where the linkage cannot be closed."""
    return _other_angle(crank, bar.crank, bar.rod, bar.crank - bar.arm, bar.arm, bar.rod)


@compiled
def crank_from_column(bar: FourBar, column: float) -> float:
    """Crank angle [rad] at column angle ``column`` [rad]; NaN where the linkage cannot be closed."""
    return _other_angle(column, bar.arm, -bar.rod, bar.arm - bar.crank, bar.crank, bar.rod)


@compiled
def rod_angle(bar: FourBar, crank: float, column: float) -> float:
    """Inclination φ_co [rad] of the connecting rod: 0 when horizontal, positive when its forward end is lower."""
    x = bar.arm * math.sin(column) - (bar.crank * math.sin(crank) - bar.rod)
    z = bar.arm * math.cos(column) - (bar.crank * math.cos(crank) + bar.arm - bar.crank)
    return math.atan2(-z, x)


@compiled
def crank_ratio(bar: FourBar, crank: float, column: float) -> float:
    """First derivative dφc/dφ of the crank angle by the column angle: the linkage ratio i_fb.

    From the velocities of C1 and C2 along the rod being equal.
    """
    co = rod_angle(bar, crank, column)
    return bar.arm * math.cos(column - co) / (bar.crank * math.cos(crank - co))


@compiled
def crank_curvature(bar: FourBar, crank: float, column: float) -> float:
    """Second derivative d²φc/dφ² of the crank angle by the column angle.

    Differentiates ln i = ln(arm cos(φ − co)) − ln(crank cos(φc − co)) once more.
    """
    co = rod_angle(bar, crank, column)
    ratio = crank_ratio(bar, crank, column)
    # Velocity of C2 relative to C1 across the rod, per unit column speed.
    turn = (bar.arm * math.sin(column - co) - bar.crank * ratio * math.sin(crank - co)) / bar.rod
    return ratio * (math.tan(crank - co) * (ratio - turn) - math.tan(column - co) * (1.0 - turn))


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
