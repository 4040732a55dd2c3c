"""Dry friction with true stiction (LuGre), and how its level follows the load.

LuGre (Canudas de Wit et al. 1995): friction = σ0 z + σ1 ż with ż = v − σ0 |v| z / g(v) and
g(v) = F_C + (F_S − F_C) exp(−(v/v_S)²). The bristle deflection z is integrated in closed form over a step, for a speed
that is held, so it neither creeps below breakaway nor rings at high speed.
"""

import math

from cls_bench.compiled import compiled

_LEAST = 1e-9
"""Friction level [N·m] below which there is none."""


@compiled
def advance(
    bristle: float, velocity: float, coulomb: float, breakaway_ratio: float, stiffness: float, damping: float,
    stribeck: float, step: float,
) -> tuple[float, float]:  # fmt: skip
    """Friction torque [N·m] against the motion in the present state, and the bristle's deflection there [rad].

    ``bristle`` is the deflection a ``step`` before: the velocity, that of the step which led here, has moved the joint
    already, so it bends the bristle before the bristle pulls. The other way round the torque is a step late, and a
    bristle that σ1 no longer damps pumps: with friction that follows the load, up to divergence.

    A friction level that falls with the load must not leave bristles behind that are bent further than it can hold:
    the deflection is cut back to breakaway. The presliding damping σ1 fades out as exp(−(v/v_S)²) (Olsson et al. 1998)
    and its torque stays under the Coulomb friction: it is meant for sticking, it keeps the element passive, and a
    changing level causes no spurious σ1 ż.
    """
    level = max(coulomb, _LEAST)
    bend = level * breakaway_ratio / stiffness
    z = min(max(bristle, -bend), bend)
    ratio = velocity / stribeck
    fade = math.exp(-ratio * ratio) if abs(ratio) < 8.0 else 0.0
    speed = abs(velocity)
    decay = stiffness * speed / (level * (1.0 + (breakaway_ratio - 1.0) * fade))
    rate = velocity - decay * z
    if decay * step > 1e-9:
        z += -math.expm1(-decay * step) / decay * rate
    else:
        z += step * rate
    damped = damping * fade
    if damped * speed > level:
        damped = level / speed
    torque = stiffness * z + damped * (velocity - decay * z)
    return torque, z
