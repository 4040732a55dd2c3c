"""The plant under test: elements alone and the whole plant, with torques put straight on their joints."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from cls_bench.compiled import compiled, mj_step
from cls_bench.parameters import Parameters, record_of
from cls_bench.plant import model as plant_model
from cls_bench.plant import state
from cls_bench.plant.model import Dampings
from cls_bench.plant.state import Plant

Array = NDArray[np.float64]


def _unaltered(p: Parameters) -> Parameters:
    return p


class Specimen:
    """A compiled MuJoCo model, ready to be stepped by a loop of its own."""

    def __init__(self, spec: mujoco.MjSpec, p: Parameters):
        self.parameters = p
        self.record: Any = record_of(p)
        self.dampings = plant_model.dampings(p)
        self.model: Any = spec.compile()
        self.data: Any = mujoco.MjData(self.model)
        self.plant: Plant = state.memory(self.model, self.data)
        self.step: float = self.model.opt.timestep

    def times(self, duration: float) -> Array:
        """Times of the steps [s] from 0 up to and including ``duration``."""
        return np.asarray(np.arange(round(duration / self.step) + 1) * self.step, dtype=np.float64)

    @property
    def applied(self) -> Array:
        """Torques [N·m] that act on the joints from outside, to be set before each step."""
        torques: Array = self.data.qfrc_applied
        return torques


@dataclass(frozen=True)
class Subject:
    """Builds what the cases test, from the bench's own code.

    ``alter`` changes the parameters behind the cases' back: a bench with wrong parameters has to fall short.
    """

    alter: Callable[[Parameters], Parameters] = _unaltered

    def element(self, p: Parameters, joints: Sequence[str], parts: Sequence[str] = ()) -> Specimen:
        """An element alone, see :func:`cls_bench.plant.model.element_spec`."""
        p = self.alter(p)
        return Specimen(plant_model.element_spec(p, joints, parts), p)

    def plant(self, p: Parameters) -> Specimen:
        """The whole plant, motor open and hand off, to be run by :func:`run_plant`."""
        p = self.alter(p)
        specimen = Specimen(plant_model.build_spec(p, scene=False), p)
        state.view(specimen.model, specimen.data)  # raises if the model is not laid out as the loop expects
        specimen.plant.gainprm[state.MOTOR_DRIVE, 1] = 0.0
        specimen.plant.biasprm[state.ARM, 1:3] = 0.0
        return specimen


class Held(NamedTuple):
    """A soft spring and damper that hold the motor shaft at a moving set value, in a plant that stands on no other."""

    stiffness: float
    """[N·m/rad]"""
    damping: float
    """[N·m·s/rad]"""


FREE = Held(0.0, 0.0)


@compiled
def _run(
    plant: Plant, applied: Any, p: Any, mesh_loss: float, dampings: Dampings, held: Held, target: Any, rate: Any,
    motor: Any, hand: Any, positions: Any,
) -> None:  # fmt: skip
    for k in range(motor.shape[0]):
        motor[k] += held.stiffness * (target[k] - plant.qpos[state.MOTOR])
        motor[k] += held.damping * (rate[k] - plant.qvel[state.MOTOR])
        applied[state.MOTOR] = motor[k]
        applied[state.COLUMN] = hand[k]
        plant_model.update(plant, p, mesh_loss, dampings, False, 0.0)
        for joint in range(state.LIMB):
            positions[k, joint] = plant.qpos[joint]
        mj_step(plant.model, plant.data)


def run_plant(
    specimen: Specimen, motor: Array, hand: Array, *, held: Held = FREE, target: Array | None = None
) -> tuple[Array, Array]:
    """Put torques [N·m] on motor shaft and column, an entry a step; the shaft may be ``held`` at ``target`` [rad].

    Returns the torque that acted on the motor shaft, and the positions before each step; their columns are motor,
    carrier 1, crank, rod [rad], load cell [m], column [rad].
    """
    acted, positions = motor.copy(), np.empty((len(motor), state.LIMB))
    set_value = np.zeros(len(motor)) if target is None else target
    _run(
        specimen.plant, specimen.applied, specimen.record, specimen.parameters.gearbox.mesh_loss, specimen.dampings,
        held, set_value, np.gradient(set_value, specimen.step), acted, hand, positions,
    )  # fmt: skip
    return acted, positions
