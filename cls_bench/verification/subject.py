"""The plant under test: the bench's own laws on the bench's own model, with torques put straight on its joints.

An element is tested alone by holding all joints but its own, and by taking away the forces of its neighbours
(``without``): what is left is stepped by the very code that steps the bench.
"""

import math
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from cls_bench.compiled import compiled, mj_step, records
from cls_bench.parameters import PLANT, Parameters
from cls_bench.parameters.record import values_of
from cls_bench.plant import limb, mechanism
from cls_bench.plant import model as plant_model
from cls_bench.plant.state import TRUTH, Plant, view

Array = NDArray[np.float64]

RECORDED = (
    "twist1", "torque1", "friction1", "twist2", "torque2", "friction2", "twist3", "torque3", "friction3",
    "rod_force", "current", "motor_torque", "temperature", "grip_torque",
)  # fmt: skip
"""What :class:`Record` has beside angles and velocities of the joints."""


class Record(NamedTuple):
    """What happened, an entry a step, all of the state before it."""

    time: Array
    angle: Mapping[str, Array]
    """by joint [rad]"""
    velocity: Mapping[str, Array]
    """by joint [rad/s]"""
    signal: Mapping[str, Array]
    """of :data:`RECORDED`; the stages' twist and torque at their output, friction at their input"""
    final: Mapping[str, tuple[float, float]]
    """angle and velocity of each joint after the last step"""


class Feedback(NamedTuple):
    """Torque on a joint that depends on its motion: a spring that follows a set value, and a brake."""

    stiffness: float = 0.0
    """[N·m/rad]"""
    damping: float = 0.0
    """[N·m·s/rad]"""


FREE = Feedback()


class Hand(NamedTuple):
    """The hand on the grip, or none."""

    squeeze: float = math.nan
    """0 … 1; NaN: off"""
    arm: bool = False
    """whether the arm holds the forearm at neutral by its impedance"""


OFF = Hand()


@compiled
def _run(
    plant: Plant, truths: Any, voltage: Any, torque: Any, target: Any, rate: Any, stiffness: Any, damping: Any,
    held: Any, squeeze: float, arm: bool, positions: Any, velocities: Any, signals: Any,
) -> None:  # fmt: skip
    truth = truths[0]
    joints, body = truth.joints, truth.body
    p = truth.parameters
    count = plant.qpos.shape[0]
    for k in range(torque.shape[0]):
        mechanism.arrive(plant, truth)
        limb.set_grip(plant, p.limb, p.column.grip_height, joints, body, not math.isnan(squeeze), squeeze)
        for j in range(count):
            positions[k, j], velocities[k, j] = plant.qpos[j], plant.qvel[j]
        connected = not math.isnan(voltage[k])
        signals[k, 10], signals[k, 12] = body.current, body.temperature
        mechanism.act(plant, truth, connected, voltage[k] if connected else 0.0, arm, 0.0, 0.0, 0.0)
        for stage in range(truth.mechanism.stages):
            signals[k, 3 * stage] = body.twist[stage]
            signals[k, 3 * stage + 1] = body.mesh_torque[stage]
            signals[k, 3 * stage + 2] = body.mesh_friction[stage]
        signals[k, 9], signals[k, 11], signals[k, 13] = body.rod_force, body.motor_torque, body.grip_torque
        for j in range(count):
            torque[k, j] += stiffness[j] * (target[k, j] - plant.qpos[j]) + damping[j] * (rate[k, j] - plant.qvel[j])
            plant.force[j] += torque[k, j]
            if held[j]:
                plant.force[j], plant.qvel[j] = 0.0, 0.0
        mj_step(plant.model, plant.data)
        for j in range(count):
            if held[j]:
                plant.qpos[j], plant.qvel[j] = positions[k, j], 0.0


class Specimen:
    """A compiled plant of one axis, to be stepped by :meth:`run`.

    ``free`` are the joints that may move, by default all. ``without`` are elements whose forces are left out: "rod",
    "stage1" …, "bearing", "weight".
    """

    def __init__(self, p: Parameters, free: Collection[str] | None = None, without: Collection[str] = ()):
        self.parameters = p
        self.model: Any = plant_model.build({"": p})
        self.data: Any = mujoco.MjData(self.model)
        self.plant: Plant = view(self.model, self.data)
        self.step: float = self.model.opt.timestep
        self.joints = tuple(self.model.joint(k).name for k in range(self.model.njnt))
        """names of the joints; without a stage the motor is the ``crank``"""
        self.shafts = tuple(plant_model.shaft_names(p.gearbox.stages))
        """those from the motor to the crank"""
        truth = np.zeros(1, TRUTH)
        self.truth: Any = truth.view(np.recarray)[0]
        self._memory = records(truth)
        for name in PLANT:
            self.truth.parameters[name] = values_of(getattr(p, name))
        mechanism.configure(self.truth.mechanism, p)
        plant_model.find_joints(self.model, "", p.gearbox.stages, self.truth.joints)
        known = self.joints if free is None else free
        if unknown := set(known) - set(self.joints):
            raise ValueError(f"the plant has no joint {', '.join(sorted(unknown))}; it has {', '.join(self.joints)}")
        self._held = np.array([name not in known for name in self.joints])
        for element in without:
            self._leave_out(element)
        mujoco.mj_forward(self.model, self.data)

    def _leave_out(self, element: str) -> None:
        m = self.truth.mechanism
        if element == "rod":
            m.cell_stiffness = m.cell_damping = m.far_mass = 0.0
        elif element == "bearing":
            self.truth.parameters.column.coulomb_friction = self.truth.parameters.column.viscous_friction = 0.0
        elif element == "weight":
            self.model.opt.gravity[:] = 0.0
        elif element.startswith("stage"):
            stage = m.stage[int(element[-1]) - 1]
            stage.stiffness = stage.damping = stage.drag = stage.drag_backdriven = 0.0
        else:
            raise ValueError(f"no element {element!r}")

    def place(self, **angles: float) -> None:
        """Put joints at angles [rad]."""
        for name, angle in angles.items():
            self.data.qpos[self.joints.index(name)] = angle

    def push(self, **velocities: float) -> None:
        """Give joints velocities [rad/s]."""
        for name, velocity in velocities.items():
            self.data.qvel[self.joints.index(name)] = velocity

    def final(self, joint: str) -> float:
        """Angle of a joint now [rad]."""
        return float(self.data.qpos[self.joints.index(joint)])

    def reset(self) -> None:
        """Rest at neutral."""
        mujoco.mj_resetData(self.model, self.data)
        self.truth.body = np.zeros((), self.truth.body.dtype)

    def times(self, duration: float) -> Array:
        """Times of the steps [s] from 0 up to and including ``duration``."""
        return np.asarray(np.arange(round(duration / self.step) + 1) * self.step, dtype=np.float64)

    def run(
        self, time: Array, torque: Mapping[str, Array | float] | None = None, *, voltage: Array | float = math.nan,
        feedback: Mapping[str, Feedback] | None = None, target: Mapping[str, Array] | None = None, hand: Hand = OFF,
        acted: dict[str, Array] | None = None,
    ) -> Record:  # fmt: skip
        """A step for each entry of ``time``, under ``torque`` on joints by name [N·m].

        The motor's terminals are open unless there is a ``voltage`` [V]. ``feedback`` adds torques that pull joints
        towards ``target`` [rad], which is 0 unless given; ``acted`` receives the torques that acted in all.
        """
        steps, count = len(time), len(self.joints)
        pushed, wanted = np.zeros((steps, count)), np.zeros((steps, count))
        for name, values in (torque or {}).items():
            pushed[:, self.joints.index(name)] = values
        for name, values in (target or {}).items():
            wanted[:, self.joints.index(name)] = values
        springs = np.zeros((2, count))
        for name, law in (feedback or {}).items():
            springs[:, self.joints.index(name)] = law
        positions, velocities = np.empty((steps, count)), np.empty((steps, count))
        signals = np.zeros((steps, len(RECORDED)))
        rates = np.gradient(wanted, self.step, axis=0) if target else np.zeros_like(wanted)
        _run(
            self.plant, self._memory, np.full(steps, 1.0) * voltage, pushed, wanted, rates, springs[0], springs[1],
            self._held, hand.squeeze, hand.arm, positions, velocities, signals,
        )  # fmt: skip
        if acted is not None:
            acted.update({name: pushed[:, k] for k, name in enumerate(self.joints)})
        return Record(
            time,
            {name: positions[:, k] for k, name in enumerate(self.joints)},
            {name: velocities[:, k] for k, name in enumerate(self.joints)},
            {name: signals[:, k] for k, name in enumerate(RECORDED)},
            {name: (float(self.data.qpos[k]), float(self.data.qvel[k])) for k, name in enumerate(self.joints)},
        )  # fmt: skip


def _unaltered(p: Parameters) -> Parameters:
    return p


@dataclass(frozen=True)
class Subject:
    """Builds what the cases test, from the bench's own code.

    ``alter`` changes the parameters behind the cases' back: a bench with wrong parameters has to fall short.
    """

    alter: Callable[[Parameters], Parameters] = _unaltered

    def element(self, p: Parameters, free: Collection[str], without: Collection[str] = ()) -> Specimen:
        """An element alone."""
        return Specimen(self.alter(p), free, without)

    def plant(self, p: Parameters) -> Specimen:
        """The whole plant, motor open and hand off."""
        return Specimen(self.alter(p))
