"""What the compiled plant laws read and write: MuJoCo's own memory, and where in it each element lies."""

from typing import Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from cls_bench.compiled import handle

Array = NDArray[np.float64]

JOINTS = ("motor", "carrier1", "crank", "rod", "load_cell", "column", "limb")
TENDONS = ("stop_blocks", "grip", "stage1", "stage2")
ACTUATORS = ("motor", "stage1_friction", "stage2_friction", "column_bearing", "arm")
MOTOR, CARRIER1, CRANK, ROD, LOAD_CELL, COLUMN, LIMB = range(7)
STOP_BLOCKS, GRIP, STAGE1, STAGE2 = range(4)
MOTOR_DRIVE, STAGE1_FRICTION, STAGE2_FRICTION, COLUMN_BEARING, ARM = range(5)
VOLTAGE, ARM_POSITION, ARM_VELOCITY, ARM_FORCE = range(4)
"""Places in ``ctrl``: the motor's voltage, then the three inputs of the arm."""


class Plant(NamedTuple):
    """Views of MuJoCo's memory (no copies), in the order of :data:`JOINTS`, :data:`TENDONS`, :data:`ACTUATORS`.

    The model is written to as well: friction levels, contact damping and grip change from step to step.
    """

    model: Any  # for mj_step
    data: Any  # for mj_step
    qpos: Array  # (7,) [rad], load cell [m]
    qvel: Array  # (7,) [rad/s], load cell [m/s]
    ctrl: Array  # (4,) voltage [V], arm angle [rad], arm velocity [rad/s], arm torque [N·m]
    act: Array  # winding temperature rise [K], motor current [A], three bristle deflections [rad]
    actuator_force: Array  # (5,) [N·m]
    xpos: Array  # (bodies, 3) [m]
    xquat: Array  # (bodies, 4)
    joint_damping: Array  # (7,) [N·m·s/rad]
    tendon_stiffness: Array  # (4,) [N·m/rad]
    tendon_damping: Array  # (4,) [N·m·s/rad]
    tendon_spring: Array  # (4, 2) lower and upper end of the dead zone [rad]
    tendon_start: NDArray[np.int32]  # (4,) place of a tendon's first joint in tendon_lever
    tendon_lever: Array  # (7,) coefficients of the tendons' joints
    gainprm: Array  # (5, 10)
    biasprm: Array  # (5, 10)
    dynprm: Array  # (5, 10)


TEMPERATURE, CURRENT, BRISTLE1, BRISTLE2, BRISTLE_COLUMN = range(5)
"""Places in ``act``."""


def view(model: mujoco.MjModel, data: mujoco.MjData) -> Plant:
    """The :class:`Plant` of a compiled model; raises ValueError if the model is not laid out as the laws expect."""
    for what, expected, kind in (
        ("joints", JOINTS, mujoco.mjtObj.mjOBJ_JOINT),
        ("tendons", TENDONS, mujoco.mjtObj.mjOBJ_TENDON),
        ("actuators", ACTUATORS, mujoco.mjtObj.mjOBJ_ACTUATOR),
    ):
        found = tuple(mujoco.mj_id2name(model, kind, i) for i in range(len(expected)))
        if found != expected:
            raise ValueError(f"the model's {what} are {found}, expected {expected}")
    if model.na != 5 or model.nu != 4:
        raise ValueError(f"the model has {model.na} activations and {model.nu} controls, expected 5 and 4")
    return memory(model, data)


def memory(model: mujoco.MjModel, data: mujoco.MjData) -> Plant:
    """The :class:`Plant` of a compiled model of any layout, such as an element alone."""
    return Plant(
        handle(model), handle(data),
        data.qpos, data.qvel, data.ctrl, data.act, data.actuator_force, data.xpos, data.xquat,
        model.dof_damping, model.tendon_stiffness, model.tendon_damping, model.tendon_lengthspring,
        model.tendon_adr, model.wrap_prm,
        model.actuator_gainprm, model.actuator_biasprm, model.actuator_dynprm,
    )  # fmt: skip
