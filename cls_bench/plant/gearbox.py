"""Two-stage planetary gearbox: elastic meshes with backlash, transmission error and meshing friction.

A stage's twist and torque are taken at its output shaft, its friction at its input shaft::

    twist    = input / r − output
    torque   = elastic contact beyond ± backlash/2 around the transmission error e sin ψ
    friction = (drag + μ |torque| / r) (1 + ripple sin ψ)

ψ = sun teeth · (input − output) is the mesh phase: the sun's rotation relative to its carrier passes the teeth.
Where the transmission error changes the twist, it changes the lever too: the contact's torque acts on input and output
by the derivatives of twist − e sin ψ, so that the spring gives back what it took and no more.
μ is larger when the load drives the motor than when the motor drives the load. Which of the two holds is told by the
friction's own direction, so it is defined at standstill too.
"""

import math
from typing import Any

import mujoco

from cls_bench.compiled import compiled
from cls_bench.parameters import Gearbox, GearStage, Parameters
from cls_bench.plant import friction
from cls_bench.plant.play import set_play


def mesh_damping(stage: GearStage, input_inertia: float, output_inertia: float, ratio: float) -> float:
    """Damping [N·m·s/rad] of a mesh: the damping ratio against the two inertias it lies between, at its output."""
    a = input_inertia * ratio * ratio
    reduced = a * output_inertia / (a + output_inertia)
    return 2.0 * stage.damping_ratio * math.sqrt(stage.stiffness * reduced)


def mesh_dampings(parameters: Parameters) -> tuple[float, float]:
    """Damping of both meshes [N·m·s/rad]."""
    box = parameters.gearbox
    rotor = parameters.motor.rotor_inertia + box.input_inertia
    crank = parameters.linkage.crank_inertia + box.carrier2_inertia
    return (
        mesh_damping(box.stage1, rotor, box.carrier1_inertia, box.ratio),
        mesh_damping(box.stage2, box.carrier1_inertia, crank, box.ratio),
    )


def configure(spec: mujoco.MjSpec, box: Gearbox) -> None:
    """Set ratio, stiffness, backlash and friction of both stages."""
    for number, stage, joints in ((1, box.stage1, ("motor", "carrier1")), (2, box.stage2, ("carrier1", "crank"))):
        name = f"stage{number}"
        spec.delete(spec.tendon(name))  # a tendon's coefficients cannot be changed: made anew, in the same order
        tendon = spec.add_tendon(name=name, stiffness=[stage.stiffness, 0.0, 0.0])
        tendon.springlength = [-stage.backlash / 2, stage.backlash / 2]
        tendon.wrap_joint(joints[0], 1.0 / box.ratio)
        tendon.wrap_joint(joints[1], -1.0)
        friction.configure(
            spec, f"stage{number}_friction", stiffness=box.bristle_stiffness, damping=box.bristle_damping,
            coulomb=stage.drag, static=stage.drag * box.breakaway_ratio, stribeck=box.stribeck_velocity,
        )  # fmt: skip


@compiled
def update_stage(
    plant: Any, box: Any, stage: Any, mesh_loss: float, damping: float,
    tendon: int, actuator: int, bristle: int, input_joint: int, output_joint: int,
) -> tuple[float, float]:  # fmt: skip
    """Set a stage's dead zone, contact damping and friction level for this step; returns (twist, torque)."""
    ratio = box.ratio
    input_angle, output_angle = plant.qpos[input_joint], plant.qpos[output_joint]
    input_velocity = plant.qvel[input_joint]
    twist = input_angle / ratio - output_angle
    phase = stage.sun_teeth * (input_angle - output_angle)
    mesh = math.sin(phase)
    error = stage.transmission_error * mesh

    # The tendon's coefficients are its levers. Its length then says nothing; the dead zone is placed relative to it.
    slope = stage.transmission_error * stage.sun_teeth * math.cos(phase)
    input_lever, output_lever = 1.0 / ratio - slope, slope - 1.0
    first = plant.tendon_start[tendon]
    plant.tendon_lever[first], plant.tendon_lever[first + 1] = input_lever, output_lever
    length = input_lever * input_angle + output_lever * output_angle
    rate = input_lever * input_velocity + output_lever * plant.qvel[output_joint]
    middle = length - (twist - error)
    half = 0.5 * stage.backlash
    torque = set_play(plant, tendon, length, rate, middle - half, middle + half, damping)

    loss = mesh_loss
    if plant.act[bristle] * torque < 0.0:  # friction opposes the load's way: back-driven
        loss *= box.backdrive_loss_ratio
    level = (stage.drag + loss * abs(torque) / ratio) * (1.0 + stage.ripple * mesh)
    friction.set_level(
        plant, actuator, bristle, input_velocity, level, box.breakaway_ratio, box.bristle_damping, box.stribeck_velocity
    )
    return twist, torque
