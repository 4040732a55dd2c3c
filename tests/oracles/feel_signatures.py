"""Signatures of a two-body model: torque at the column over its angle, as published references show it in kind.

The numbers are of a reference integration (J 0.15 and 0.35 kg·m², cable 900 N·m/rad, surface stop at 12°), swept slowly
forward and back. What it was run with beyond that is deduced from them:

* forward friction 0.2 N·m: what is left when the linkage is disconnected;
* aft friction 0.3: half of what lies between the two directions, 0.5, less that;
* slope between 5° and 10°: 2.9 N·m in 5°, which is 35 N·m/rad behind the cable; with dynamic pressure 2.5 times as high
  6.95 N·m, which is 87.5 = 2.5 · 35: so all of it is q-feel;
* breakout 2 N·m: what both lines have at 0°; it does not follow the pressure;
* surface stop 8000 N·m/rad: 29.2 N·m at 14° are 1.86° of stretch, so 0.14° of indentation under 19.8 N·m;
* slack 1° from end to end: 0.3 N·m less at 5° and 10°, 7.1 at 14°, which is half of it at each of these.

Not in the numbers, and assumed: slope of the centering unit, stiff enough to be saturated at 5°; light damping; servo
stiffness such that the clutch slips at 5°.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from cls_bench.quantity import DEG

BASE: Mapping[str, Any] = {
    "bodies": "two", "inertia": 0.15, "damping": 0.2, "friction": 0.2, "stiffness": 0.0,
    "aft.inertia": 0.35, "aft.damping": 0.5, "aft.friction": 0.3,
    "linkage.stiffness": 900.0, "linkage.damping": 1.0,
    "q_feel.gradient": 0.007, "flight.dynamic_pressure": 5000.0, "centering.stiffness": 400.0,
    "centering.breakout": 2.0, "aft_limit.angle": 12.0 * DEG, "aft_limit.stiffness": 8000.0, "aft_limit.damping": 40.0,
    "forward_limit.angle": 17.0 * DEG,
}  # fmt: skip
"""Normal, keys below ``feel``."""

ANGLES = (5.0, 10.0, 14.0)
"""Where torques are read [°]."""


@dataclass(frozen=True)
class Signature:
    """What is changed of :data:`BASE`, and torques [N·m] at :data:`ANGLES` on the way forward and on the way back."""

    changes: Mapping[str, Any]
    forward: tuple[float, float, float]
    back: tuple[float, float, float] | None = None
    rounding: float = 0.05
    """half of the last figure that is given [N·m]"""


SIGNATURES: Mapping[str, Signature] = {
    "normal": Signature({}, (5.4, 8.3, 29.5), (4.4, 7.3, 28.9)),
    "q 2.5": Signature({"flight.dynamic_pressure": 12500.0}, (9.3, 16.2, 30.6), (8.3, 15.3, 30.0)),
    "jammed": Signature({"jam.of": "aft"}, (78.8, 157.0, 220.0), rounding=0.5),
    "override": Signature({"jam.of": "aft", "linkage.override": 40.0}, (40.0, 40.0, 40.0), rounding=0.5),
    "disconnected": Signature({"linkage.connected": False}, (0.2, 0.2, 0.2), (-0.2, -0.2, -0.2)),
    "autopilot": Signature({"autopilot.engaged": True, "autopilot.clutch": 8.0}, (13.1, 16.0, 30.3)),
    "slack": Signature({"linkage.backlash": 1.0 * DEG}, (5.1, 8.0, 22.4)),
}  # fmt: skip
