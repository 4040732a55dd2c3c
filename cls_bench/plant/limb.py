"""The pilot's limb: arm impedance, forearm mass, and the grip as spring and damper that follow the squeeze.

All about the column's axis: a force F at the grip is a torque F h with the grip's height h, a stiffness k is k h².
"""

import math
from typing import Any

from cls_bench.compiled import compiled
from cls_bench.plant.state import ARM, ARM_FORCE, ARM_POSITION, ARM_VELOCITY, COLUMN, GRIP, LIMB


@compiled
def grip_force(plant: Any, grip: int = GRIP, hand: int = LIMB, column: int = COLUMN) -> float:
    """Torque [N·m] of the grip on the column."""
    stretch = plant.qpos[hand] - plant.qpos[column] - plant.tendon_spring[grip, 0]
    rate = plant.qvel[hand] - plant.qvel[column]
    return float(plant.tendon_stiffness[grip] * stretch + plant.tendon_damping[grip] * rate)


@compiled
def _between(loose: float, tight: float, squeeze: float) -> float:
    """Logarithmic between ``loose`` and ``tight``; linear where one of them is zero and has no logarithm."""
    if 0.0 < squeeze < 1.0 and loose > 0.0 and tight > 0.0:
        return loose * math.pow(tight / loose, squeeze)
    return loose + squeeze * (tight - loose)


@compiled
def update_grip(
    plant: Any, limb: Any, height: float, attached: bool, squeeze: float,
    grip: int = GRIP, hand: int = LIMB, column: int = COLUMN,
) -> None:  # fmt: skip
    """Set stiffness and damping of the grip for ``squeeze`` 0…1, or let go.

    Between loose and tight both run on a logarithmic scale. The spring's rest length moves such that the force does
    not change while the hand squeezes or loosens, and is zero at the moment it grabs.
    """
    if not attached:
        plant.tendon_stiffness[grip] = 0.0
        plant.tendon_damping[grip] = 0.0
        return
    area = height * height
    stiffness = area * _between(limb.loose_stiffness, limb.tight_stiffness, squeeze)
    damping = area * _between(limb.loose_damping, limb.tight_damping, squeeze)
    if stiffness != plant.tendon_stiffness[grip] or damping != plant.tendon_damping[grip]:
        offset = plant.qpos[hand] - plant.qpos[column]
        rate = plant.qvel[hand] - plant.qvel[column]
        rest = offset - (grip_force(plant, grip, hand, column) - damping * rate) / stiffness
        plant.tendon_spring[grip, 0] = rest
        plant.tendon_spring[grip, 1] = rest
        plant.tendon_stiffness[grip] = stiffness
        plant.tendon_damping[grip] = damping


@compiled
def move_arm(
    plant: Any, limb: Any, height: float, motion: bool, angle: float, velocity: float, force: float
) -> None:
    """Drive the forearm: with its impedance towards ``angle`` [rad], or by ``force`` [N] alone."""
    area = height * height
    stiffness = area * limb.arm_stiffness if motion else 0.0
    damping = area * limb.arm_damping if motion else 0.0
    # MuJoCo's pid element keeps its gains in the affine bias: force = kp (u_pos − q) + kd (u_vel − q̇) + u_ff.
    plant.biasprm[ARM, 1] = -stiffness
    plant.biasprm[ARM, 2] = -damping
    plant.ctrl[ARM_POSITION] = angle
    plant.ctrl[ARM_VELOCITY] = velocity
    plant.ctrl[ARM_FORCE] = force * height
