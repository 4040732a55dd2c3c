"""Kinematic chain of the PLC: control column → crank → motor → PLCopen units, and back (thesis table 3.5)."""

from typing import Any

from cls_bench.compiled import compiled
from cls_bench.kinematics import polynomial


@compiled
def motor_from_column(
    poly: Any, ratio: float, angle: float, velocity: float, acceleration: float
) -> tuple[float, float, float]:
    """Motor angle [rad], velocity and acceleration for a motion of the column; ``ratio`` is the gearbox's (25)."""
    slope = polynomial(poly.ratio, angle)
    crank = polynomial(poly.crank, angle)
    crank_acceleration = polynomial(poly.curvature, angle) * velocity * velocity + slope * acceleration
    return ratio * crank, ratio * slope * velocity, ratio * crank_acceleration


@compiled
def column_from_motor(poly: Any, ratio: float, angle: float, velocity: float) -> tuple[float, float]:
    """Column angle [rad] and velocity that the motor's imply, were gearbox and linkage rigid."""
    crank = angle / ratio
    return polynomial(poly.column, crank), polynomial(poly.inverse_ratio, crank) * velocity / ratio
