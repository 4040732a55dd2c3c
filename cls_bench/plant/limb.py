"""The pilot's limb: arm impedance, forearm mass, and the grip as spring and damper that follow the squeeze.

All about the column's axis: a force F at the grip is a torque F h with the grip's height h, a stiffness k is k h².
"""

import math
from typing import Any

from cls_bench.compiled import compiled
from cls_bench.plant.state import ARM, ARM_FORCE, ARM_POSITION, ARM_VELOCITY, COLUMN, GRIP, LIMB


@compiled
def grip_force(plant: Any) -> float:
    """Torque [N·m] of the grip on the column."""
    stretch = plant.qpos[LIMB] - plant.qpos[COLUMN] - plant.tendon_spring[GRIP, 0]
    rate = plant.qvel[LIMB] - plant.qvel[COLUMN]
    return float(plant.tendon_stiffness[GRIP] * stretch + plant.tendon_damping[GRIP] * rate)


@compiled
def update_grip(plant: Any, limb: Any, height: float, attached: bool, squeeze: float) -> None:
    """Set stiffness and damping of the grip for ``squeeze`` 0…1, or let go.

    Between loose and tight both run on a logarithmic scale. The spring's rest length moves such that the force does
    not change while the hand squeezes or loosens, and is zero at the moment it grabs.
    """
    if not attached:
        plant.tendon_stiffness[GRIP] = 0.0
        plant.tendon_damping[GRIP] = 0.0
        return
    area = height * height
    stiffness = area * limb.loose_stiffness * math.pow(limb.tight_stiffness / limb.loose_stiffness, squeeze)
    damping = area * (limb.loose_damping * math.pow(limb.tight_damping / limb.loose_damping, squeeze))
    before = plant.tendon_stiffness[GRIP]
    if stiffness == before:
        plant.tendon_damping[GRIP] = damping
        return
    offset = plant.qpos[LIMB] - plant.qpos[COLUMN]
    rest = offset - before * (offset - plant.tendon_spring[GRIP, 0]) / stiffness
    plant.tendon_spring[GRIP, 0] = rest
    plant.tendon_spring[GRIP, 1] = rest
    plant.tendon_stiffness[GRIP] = stiffness
    plant.tendon_damping[GRIP] = damping


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
