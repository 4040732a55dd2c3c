"""Dry friction with true stiction: MuJoCo's LuGre element, and how its level follows the load.

LuGre (Canudas de Wit et al. 1995): friction = σ0 z + σ1 ż with ż = v − σ0 |v| z / g(v) and
g(v) = F_C + (F_S − F_C) exp(−(v/v_S)²). MuJoCo integrates the bristle deflection z exactly over a step, so it neither
creeps below breakaway nor rings at high speed.
"""

import math
from typing import Any

import mujoco

from cls_bench.compiled import compiled

STIFFNESS, DAMPING = 5, 6
"""Places in a LuGre actuator's ``dynprm``."""

COULOMB, STATIC = 3, 4
"""Places in its ``biasprm``."""


def configure(
    spec: mujoco.MjSpec, name: str, *, stiffness: float, damping: float, coulomb: float, static: float, stribeck: float
) -> None:
    """Set the LuGre element ``name``: [N·m/rad], [N·m·s/rad], [N·m], [N·m], [rad/s]."""
    spec.actuator(name).set_to_dcmotor(
        motorconst=[0.0, 0.0], resistance=1.0, lugre=[stiffness, damping, coulomb, static, stribeck],
        ctrlspec=int(mujoco.mjtCtrlInput.mjINPUT_NONE),
    )  # fmt: skip


_LEAST = 1e-9
"""Friction level [N·m] below which MuJoCo's element would divide by zero."""


@compiled
def set_level(
    plant: Any, actuator: int, bristle: int, velocity: float,
    coulomb: float, breakaway_ratio: float, damping: float, stribeck: float,
) -> None:  # fmt: skip
    """Set Coulomb friction [N·m] and presliding damping of a LuGre element for this step.

    A friction level that falls with the load must not leave bristles behind that are bent further than it can hold:
    the deflection is cut back to breakaway. The presliding damping σ1 fades out as exp(−(v/v_S)²) (Olsson et al. 1998)
    and its torque stays under the Coulomb friction: it is meant for sticking, it keeps the element passive, and a
    changing level causes no spurious σ1 ż.
    """
    level = max(coulomb, _LEAST)
    static = level * breakaway_ratio
    plant.biasprm[actuator, COULOMB] = level
    plant.biasprm[actuator, STATIC] = static
    bend = static / plant.dynprm[actuator, STIFFNESS]
    plant.act[bristle] = min(max(plant.act[bristle], -bend), bend)
    ratio = velocity / stribeck
    faded = damping * math.exp(-ratio * ratio)
    if faded * abs(velocity) > level:
        faded = level / abs(velocity)
    plant.dynprm[actuator, DAMPING] = faded
