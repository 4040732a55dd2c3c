"""Random feel models over wide ranges: stiffnesses, inertias and frictions over two to four decades, parts left out."""

from collections.abc import Mapping
from typing import Any

import numpy as np


def broad(r: np.random.Generator) -> Mapping[str, Any]:
    """Keys below ``feel`` of a random model."""

    def wide(low: float, high: float) -> float:
        return float(np.exp(r.uniform(np.log(low), np.log(high))))

    def maybe(chance: float, low: float, high: float) -> float:
        return wide(low, high) if r.random() < chance else 0.0

    def one_of(*values: Any) -> Any:
        return values[r.integers(len(values))]

    body = {
        "inertia": wide(0.01, 2), "damping": maybe(0.7, 0.01, 50), "friction": maybe(0.7, 0.01, 10),
        "static_friction": maybe(0.5, 0.01, 20), "stribeck_velocity": maybe(0.5, 1e-4, 1),
        "aft.inertia": wide(0.01, 2), "aft.damping": maybe(0.7, 0.01, 50), "aft.friction": maybe(0.7, 0.01, 10),
        "aft.static_friction": maybe(0.5, 0.01, 20), "aft.stribeck_velocity": maybe(0.5, 1e-4, 1),
    }  # fmt: skip
    unit = {
        "stiffness": maybe(0.7, 0.1, 1e3), "neutral": r.uniform(-0.1, 0.1), "trim.rate": one_of(0.0, 0.3),
        "centering.stiffness": maybe(0.5, 1, 1e4), "centering.breakout": maybe(0.8, 0.1, 50),
        "flight.dynamic_pressure": 5000.0, "flight.airspeed": 80.0, "surface.area": one_of(0.0, 2.0),
        "surface.chord": 0.4, "surface.hinge_deflection": r.uniform(-0.05, 0.02), "surface.hinge_rate": -2.0,
        "hydraulics.pressure": one_of(1.0, 0.5, 0.0), "hydraulics.off_friction": maybe(0.5, 0.1, 10),
        "hydraulics.maximum_rate": maybe(0.4, 0.01, 2), "hydraulics.rate_damping": wide(1, 1e3),
        "autopilot.engaged": bool(r.random() < 0.4), "autopilot.reference": r.uniform(-0.1, 0.1),
        "autopilot.clutch": wide(0.1, 20), "autopilot.stiffness": wide(10, 1e4),
        "autopilot.damping": maybe(0.8, 0.1, 100), "unbalance.gradient": one_of(0.0, 0.0, r.uniform(-20, 20)),
    }  # fmt: skip
    rest = {
        "bodies": one_of("one", "two"), "jam.of": one_of("none", "none", "none", "aft", "forward"),
        "linkage.stiffness": wide(10, 1e5), "linkage.damping": maybe(0.7, 0.01, 100),
        "linkage.backlash": maybe(0.6, 1e-4, 0.1), "linkage.pretension": maybe(0.5, 0.1, 50),
        "linkage.override": maybe(0.4, 0.5, 50), "aft_limit.angle": 0.1, "aft_limit.back_angle": r.uniform(0.02, 0.1),
        "aft_limit.stiffness": wide(10, 1e5), "aft_limit.damping": maybe(0.7, 0.1, 300), "forward_limit.angle": 0.15,
        "forward_limit.stiffness": wide(10, 1e5), "forward_limit.damping": maybe(0.7, 0.1, 300),
    }  # fmt: skip
    if r.random() < 0.5:
        rest |= {"detents.place": [-0.05, 0.0, 0.05], "detents.width": [0.04, 0.03, 0.05],
                 "detents.torque": [wide(0.1, 10) for _ in range(3)]}  # fmt: skip
        if r.random() < 0.5:
            rest["detents.profile"] = one_of([1.0, -1.0], [0.0, 1.0, -1.0, 0.0], [0.0, -1.0, 1.0, 0.0],
                                             [1.0, -0.5, 0.3, -1.0])  # fmt: skip
    return {**body, **unit, **rest}
