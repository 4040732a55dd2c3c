"""What the plant remembers, and where: MuJoCo's own memory for the motion, a record for all else.

The mechanism of an axis is a chain of hinges, all about y: column, limb, and from the motor on one shaft for each gear
stage. MuJoCo holds their angles, velocities and inertias and steps them; what acts between them are the laws of this
package. Nothing outside knows a joint by its number: :data:`JOINTS` holds the places, found by name.
"""

from typing import Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from cls_bench.compiled import handle
from cls_bench.parameters import MOST_STAGES, PLANT, Parameters, kind_of

Array = NDArray[np.float64]


class Plant(NamedTuple):
    """Views of MuJoCo's memory (no copies), an entry a joint."""

    model: Any  # for mj_step
    data: Any  # for mj_step
    qpos: Array  # [rad]
    qvel: Array  # [rad/s]
    force: Array  # torques that are put on the joints [N·m]
    armature: Array  # inertia [kg·m²] on top of the bodies' own; MuJoCo looks at those of column and crank


JOINTS = np.dtype(
    [
        ("column", np.int64),
        ("limb", np.int64),
        ("motor", np.int64),
        ("crank", np.int64),
        ("shafts", np.int64, (MOST_STAGES + 1,)),  # from the motor to the crank, which is shaft number ``stages``
    ]
)
"""Places of an axis's joints in :class:`Plant`."""

STAGE = np.dtype(
    [
        ("ratio", np.float64),
        ("teeth", np.float64),  # of the input wheel
        ("carried", np.float64),  # 1 if the mesh turns with the output, as planets with their carrier; else 0
        ("stiffness", np.float64),  # [N·m/rad] at the output, as all below but drag
        ("damping", np.float64),  # [N·m·s/rad]
        ("half_backlash", np.float64),  # [rad]
        ("error", np.float64),  # transmission error [rad]
        ("ripple", np.float64),
        ("drag", np.float64),  # [N·m] at the input, motor driving
        ("drag_backdriven", np.float64),
        ("loss", np.float64),  # friction over torque handed on, both at the input, motor driving
        ("loss_backdriven", np.float64),
    ]
)

MECHANISM = np.dtype(
    [
        ("step", np.float64),  # of the plant [s]
        ("tick", np.float64),  # [s]
        ("stages", np.int64),
        ("stage", STAGE, (MOST_STAGES,)),
        ("crank", np.float64), ("rod", np.float64), ("arm", np.float64),  # [m]; rod 0: none
        ("crank_angle", np.float64), ("rod_angle", np.float64), ("arm_angle", np.float64),  # at neutral [rad]
        ("axis_x", np.float64), ("axis_z", np.float64),  # crank axis from the column's [m]
        ("far_mass", np.float64),  # of the rod, at its column end before the strain gauge [kg]
        ("cell_stiffness", np.float64), ("cell_damping", np.float64),  # [N/m], [N·s/m]
        ("bearing_damping", np.float64),  # presliding [N·m·s/rad]
        ("current_decay", np.float64),  # of the winding's current over a step
        ("heat_decay", np.float64),  # of the winding's temperature over a step
        ("filter_blend", np.float64),  # weight of a new sample in the amplifier's filter
        ("count", np.float64),  # force of one converter count as built [N]
        ("creep_blend", np.float64),
    ]
)  # fmt: skip
"""What follows from the parameters and does not change from step to step."""

BODY = np.dtype(
    [
        ("current", np.float64),  # [A]
        ("temperature", np.float64),  # rise of the winding's temperature [K]
        ("bristle", np.float64, (MOST_STAGES,)),  # deflection of the stages' friction [rad]
        ("bearing_bristle", np.float64),  # of the column's bearing [rad]
        ("grip_stiffness", np.float64),  # [N·m/rad]
        ("grip_damping", np.float64),  # [N·m·s/rad]
        ("grip_rest", np.float64),  # angle between limb and column at which the grip's spring is free [rad]
        # what acts in the present state
        ("voltage", np.float64),  # on the motor's terminals [V]
        ("connected", np.float64),  # 1 if the power stage is on them; 0: they are open
        ("motor_torque", np.float64),  # of the air gap [N·m]
        ("rod_force", np.float64),  # what the strain gauge sees, tension positive [N]
        ("along_crank", np.float64), ("along_column", np.float64),  # levers of the pins along the rod [m]
        ("across_column", np.float64),  # and across it [m]
        ("far_along", np.float64), ("far_across", np.float64),  # of the far mass, apart from its armatures [m/s²]
        ("grip_torque", np.float64),  # on the column [N·m]
        ("twist", np.float64, (MOST_STAGES,)),  # [rad]
        ("mesh_torque", np.float64, (MOST_STAGES,)),  # [N·m]
        ("mesh_friction", np.float64, (MOST_STAGES,)),  # at the input shaft, against its motion [N·m]
        # what the sensors remember
        ("amplified", np.float64),  # output of the load cell amplifier's filter [N]
        ("zero", np.float64),  # of the load cell [N]
        ("crept", np.float64),  # [N]
        ("shown_force", np.float64),  # what its amplifier is given, with all that is wrong with the cell [N]
    ]
)  # fmt: skip

SHOWN = np.dtype(
    [
        ("column_angle", np.float64),  # [rad]
        ("column_velocity", np.float64),  # [rad/s]
        ("limb_angle", np.float64),  # [rad]
        ("hand_force", np.float64),  # of the hand on the grip [N]
        ("squeeze", np.float64),  # −1 when the hand has let go
    ]
)
"""What is to be seen of MuJoCo's memory and of the hand; :func:`cls_bench.plant.mechanism.show` fills it in."""

TRUTH = np.dtype(
    [
        ("joints", JOINTS),
        ("parameters", [(name, kind_of(type(getattr(Parameters(), name)))) for name in PLANT]),
        ("mechanism", MECHANISM),
        ("body", BODY),
        ("shown", SHOWN),
    ]
)
"""The plant of one axis, all that MuJoCo does not hold. No function of control is given it."""


def view(model: mujoco.MjModel, data: mujoco.MjData) -> Plant:
    """The :class:`Plant` of a compiled model."""
    return Plant(handle(model), handle(data), data.qpos, data.qvel, data.qfrc_applied, model.dof_armature)
