"""The mechanism of an axis: all that acts on its shafts, column and limb in one plant step."""

import math
from typing import Any

from cls_bench.compiled import compiled
from cls_bench.parameters import MOST_STAGES, Parameters
from cls_bench.parameters.inertias import bearing_damping
from cls_bench.plant import column, gearbox, limb, motor, rod, sensors


def configure(mechanism: Any, p: Parameters) -> None:
    """Put all that follows from the parameters into the record ``mechanism``."""
    tick = p.rates.clock.tick_s
    step = tick / p.simulation.substeps
    mechanism.tick, mechanism.step = tick, step
    gearbox.configure(mechanism, p)
    rod.configure(mechanism, p)
    mechanism.bearing_damping = bearing_damping(p)
    mechanism.current_decay = math.exp(-step * p.motor.resistance / p.motor.inductance)
    mechanism.heat_decay = math.exp(-step / p.motor.thermal_time_constant)
    sensors.configure(mechanism, p)


@compiled
def arrive(plant: Any, truth: Any) -> None:
    """After a step: what is not MuJoCo's arrives at the present state too, and the rod is strained as it lies."""
    joints, body = truth.joints, truth.body
    motor.flow(truth.parameters.motor, truth.mechanism, body, plant.qvel[joints.motor])
    rod.strain(plant, joints, truth.mechanism, body)


@compiled
def act(
    plant: Any, truth: Any, connected: bool, voltage: float,
    motion: bool, angle: float, velocity: float, force: float,
) -> None:  # fmt: skip
    """Put all forces of the present state on the joints, after :func:`arrive`.

    ``voltage`` [V] is on the motor if it is ``connected``; the arm pulls towards ``angle`` [rad] at ``velocity``
    [rad/s] if there is a ``motion``, and ``force`` [N] acts on the forearm. The grip is as
    :func:`cls_bench.plant.limb.set_grip` left it.
    """
    p, joints, mechanism, body = truth.parameters, truth.joints, truth.mechanism, truth.body
    plant.force[joints.column] = plant.force[joints.limb] = 0.0
    for k in range(mechanism.stages + 1):
        plant.force[joints.shafts[k]] = 0.0
    shaft = joints.motor
    body.motor_torque = motor.torque(p.motor, body, connected, voltage)
    plant.force[shaft] += body.motor_torque + motor.cogging(p.motor, plant.qpos[shaft])
    for k in range(mechanism.stages):
        gearbox.advance(plant, p.gearbox, joints, mechanism, body, k)
    rod.act(plant, joints, mechanism, body)
    column.act(plant, p.column, joints.column, mechanism, body)
    limb.act(plant, p.limb, p.column.grip_height, joints, body, motion, angle, velocity, force)


REMEMBERED = ("current", "temperature", "zero", "crept", "amplified")
"""What the plant remembers besides MuJoCo's motion, and may lose without losing that where the drive trips of it."""


@compiled
def is_finite(body: Any) -> bool:
    """Whether all of :data:`REMEMBERED` is."""
    return bool(abs(body.current + body.temperature + body.amplified + body.zero + body.crept) < math.inf)


@compiled
def show(plant: Any, truth: Any, attached: bool, squeeze: float) -> None:
    """Put what is to be seen of the present state, and of the hand, into the record."""
    joints, shown = truth.joints, truth.shown
    shown.column_angle, shown.column_velocity = plant.qpos[joints.column], plant.qvel[joints.column]
    shown.limb_angle = plant.qpos[joints.limb]
    shown.hand_force = truth.body.grip_torque / truth.parameters.column.grip_height
    shown.squeeze = squeeze if attached else -1.0


ANGLES = ("column", "limb", *(f"shaft{k}" for k in range(MOST_STAGES + 1)), "rod", "rod_end")
"""What a drawn body can move with: the places that :func:`pose` knows. ``shaft0`` is the motor."""


@compiled
def pose(plant: Any, truth: Any, which: int) -> tuple[float, float, float]:
    """Angle about y [rad] and displacement (x, z) [m] from neutral of what moves with place ``which``."""
    joints, m = truth.joints, truth.mechanism
    rod_place = 2 + joints.shafts.shape[0]
    if which == 0:
        return plant.qpos[joints.column], 0.0, 0.0
    if which == 1:
        return plant.qpos[joints.limb], 0.0, 0.0
    if which < rod_place:
        return plant.qpos[joints.shafts[which - 2]], 0.0, 0.0
    crank, column = plant.qpos[joints.crank] + m.crank_angle, plant.qpos[joints.column] + m.arm_angle
    r1x, r1z = m.crank * math.sin(crank), m.crank * math.cos(crank)
    r2x, r2z = m.arm * math.sin(column), m.arm * math.cos(column)
    turned = math.atan2(m.axis_z + r1z - r2z, r2x - m.axis_x - r1x) - m.rod_angle
    if which == rod_place:
        return turned, r1x - m.crank * math.sin(m.crank_angle), r1z - m.crank * math.cos(m.crank_angle)
    return turned, r2x - m.arm * math.sin(m.arm_angle), r2z - m.arm * math.cos(m.arm_angle)
