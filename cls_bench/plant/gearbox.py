"""A gear stage: elastic mesh with backlash, transmission error, and friction that follows the load.

Twist and torque are taken at the output shaft, friction at the input shaft::

    twist    = input / r − output
    torque   = elastic contact beyond ± backlash/2 around the transmission error e sin ψ
    friction = (drag + μ |torque| / r) (1 + ripple sin ψ)

ψ is the mesh phase: teeth · input, of a planetary stage teeth · (input − output), as its planets turn with the carrier;
0 without teeth. Where the transmission error changes the twist, it changes the lever too: the contact's torque acts on
input and output by the derivatives of twist − e sin ψ, so that the spring gives back what it took and no more.

Drag and μ have a value for the motor driving the load and one for the load driving the motor (Modelica's LossyGear)::

    driving     μ = 1/η − 1      back-driven   μ = 1 − η'

so that a back-driving efficiency η' of 0 or less holds any load: self-locking. Which of the two is the case is told by
the friction's own direction, so it is defined at standstill too.

The mesh's share of the friction vanishes with the torque. The drag does not, so two different ones pass into each other
where the torque changes its way, in a straight line over as much torque at the input as they differ by, to either side.
There the friction changes by half of what the torque does: less than the whole, with which a gear would lock itself.
"""

import math
from typing import Any

from cls_bench.compiled import compiled
from cls_bench.parameters import Gearbox, Parameters
from cls_bench.parameters.inertias import mesh_damping, shaft_inertias
from cls_bench.plant import friction
from cls_bench.plant.play import contact_torque, dead_zone


def configure(mechanism: Any, p: Parameters) -> None:
    """Put the stages in use into the record ``mechanism``."""
    box: Gearbox = p.gearbox
    inertias = shaft_inertias(p)
    mechanism.stages = box.stages
    for k, stage in enumerate(box.in_use):
        row = mechanism.stage[k]
        row["ratio"], row["teeth"] = stage.ratio, stage.teeth
        row["carried"] = float(stage.carried)
        row["stiffness"], row["half_backlash"] = stage.stiffness, 0.5 * stage.backlash
        row["damping"] = mesh_damping(stage, inertias[k], inertias[k + 1])
        row["error"], row["ripple"] = stage.transmission_error, stage.ripple
        row["drag"], row["drag_backdriven"] = stage.drag, stage.drag * stage.drag_ratio
        row["loss"], row["loss_backdriven"] = 1.0 / stage.efficiency - 1.0, 1.0 - stage.backdrive_efficiency


@compiled
def friction_level(stage: Any, bristle: float, torque: float, mesh: float) -> float:
    """Coulomb friction [N·m] at the input shaft under the mesh's ``torque``; ``mesh`` is the sine of its phase.

    The ``bristle`` is bent the way in which the friction acts.
    """
    backdriven = bristle * torque < 0.0  # friction opposes the load's way
    loss = stage.loss_backdriven if backdriven else stage.loss
    drag, change = stage.drag, stage.drag_backdriven - stage.drag
    if change != 0.0:
        driving = (-abs(torque) if backdriven else abs(torque)) / stage.ratio
        drag += change * min(max(0.5 - 0.5 * driving / abs(change), 0.0), 1.0)
    return float((drag + loss * abs(torque) / stage.ratio) * (1.0 + stage.ripple * mesh))


@compiled
def advance(plant: Any, box: Any, joints: Any, mechanism: Any, body: Any, k: int) -> None:
    """Put torque and friction of stage ``k`` (0 … stages − 1) on its two shafts; its bristle goes on by a step."""
    stage = mechanism.stage[k]
    before, behind = joints.shafts[k], joints.shafts[k + 1]
    turned, output = plant.qpos[before], plant.qpos[behind]
    velocity = plant.qvel[before]
    twist = turned / stage.ratio - output
    mesh, slope = 0.0, 0.0
    if stage.teeth > 0.0:
        phase = stage.teeth * (turned - stage.carried * output)
        mesh = math.sin(phase)
        if stage.error != 0.0:
            slope = stage.error * stage.teeth * math.cos(phase)
    lever = 1.0 / stage.ratio - slope
    counter = stage.carried * slope - 1.0
    deflection = dead_zone(twist - stage.error * mesh, -stage.half_backlash, stage.half_backlash)
    torque = 0.0
    if deflection != 0.0:
        rate = lever * velocity + counter * plant.qvel[behind]
        torque = contact_torque(deflection, rate, stage.stiffness, stage.damping)

    level = friction_level(stage, body.bristle[k], torque, mesh)
    rubbed, body.bristle[k] = friction.advance(
        body.bristle[k], velocity, level, box.breakaway_ratio, box.bristle_stiffness, box.bristle_damping,
        box.stribeck_velocity, mechanism.step,
    )  # fmt: skip
    plant.force[before] -= lever * torque + rubbed
    plant.force[behind] -= counter * torque
    body.twist[k], body.mesh_torque[k], body.mesh_friction[k] = twist, torque, rubbed
