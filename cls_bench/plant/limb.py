"""The pilot's limb: arm impedance, forearm mass, and the grip as spring and damper that follow the squeeze.

All about the column's axis: a force F at the grip is a torque F h with the grip's height h, a stiffness k is k h².
"""

import math
from typing import Any

from cls_bench.compiled import compiled


@compiled
def _between(loose: float, tight: float, squeeze: float) -> float:
    """Logarithmic between ``loose`` and ``tight``; linear where one of them is zero and has no logarithm."""
    if 0.0 < squeeze < 1.0 and loose > 0.0 and tight > 0.0:
        return loose * math.pow(tight / loose, squeeze)
    return loose + squeeze * (tight - loose)


@compiled
def set_grip(plant: Any, limb: Any, height: float, joints: Any, body: Any, attached: bool, squeeze: float) -> None:
    """Set stiffness and damping of the grip for ``squeeze`` 0…1, or let go.

    Between loose and tight both run on a logarithmic scale. The spring's rest length moves such that the force does
    not change while the hand squeezes or loosens, and is zero at the moment it grabs.
    """
    if not attached:
        body.grip_stiffness = body.grip_damping = body.grip_torque = 0.0
        return
    area = height * height
    stiffness = area * _between(limb.loose_stiffness, limb.tight_stiffness, squeeze)
    damping = area * _between(limb.loose_damping, limb.tight_damping, squeeze)
    stretch = plant.qpos[joints.limb] - plant.qpos[joints.column]
    rate = plant.qvel[joints.limb] - plant.qvel[joints.column]
    if stiffness != body.grip_stiffness or damping != body.grip_damping:
        torque = body.grip_stiffness * (stretch - body.grip_rest) + body.grip_damping * rate
        body.grip_rest = stretch - (torque - damping * rate) / stiffness
        body.grip_stiffness, body.grip_damping = stiffness, damping
    body.grip_torque = stiffness * (stretch - body.grip_rest) + damping * rate


@compiled
def act(
    plant: Any, limb: Any, height: float, joints: Any, body: Any,
    motion: bool, angle: float, velocity: float, force: float,
) -> None:  # fmt: skip
    """Put the grip on limb and column, and drive the forearm.

    With its arm's impedance towards ``angle`` [rad] if ``motion``, and by ``force`` [N].
    """
    torque = force * height
    if motion:
        area = height * height
        torque += area * limb.arm_stiffness * (angle - plant.qpos[joints.limb])
        torque += area * limb.arm_damping * (velocity - plant.qvel[joints.limb])
    plant.force[joints.limb] += torque - body.grip_torque
    plant.force[joints.column] += body.grip_torque
