"""Gear with losses: Modelica's LossyGearDemo1, the overall efficiency, and the load's way back through the gearbox."""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from cls_bench.compiled import compiled, mj_step
from cls_bench.parameters import Gearbox, GearStage, Motor, Parameters, Simulation
from cls_bench.plant.gearbox import update_stage
from cls_bench.plant.state import Plant
from cls_bench.verification.reading import Array, at, crossing, start
from cls_bench.verification.reduced_model import mesh_loss
from cls_bench.verification.row import Row
from cls_bench.verification.subject import Specimen, Subject

GROUP = "gear with losses"
DEMO = "Modelica LossyGearDemo1"


@compiled
def _run_stage(
    plant: Plant, applied: Any, box: Any, mesh_loss: float, damping: float, input_torque: Any, output_torque: Any,
    out: Any,
) -> None:  # fmt: skip
    for k in range(input_torque.shape[0]):
        applied[0], applied[1] = input_torque[k], output_torque[k]
        _, out[k, 4] = update_stage(plant, box, box.stage1, mesh_loss, damping, 0, 0, 0, 0, 1)
        out[k, 0], out[k, 1] = plant.qpos[0], plant.qvel[0]
        out[k, 2], out[k, 3] = plant.qpos[1], plant.qvel[1]
        mj_step(plant.model, plant.data)


def run_stage(stage: Specimen, input_torque: Array, output_torque: Array) -> Array:
    """Stage 1 alone under torques [N·m] on its shafts.

    Columns: input angle [rad] and speed [rad/s], output angle and speed, torque through the mesh [N·m].
    """
    out = np.empty((len(input_torque), 5))
    box = stage.parameters.gearbox
    _run_stage(
        stage.plant, stage.applied, stage.record.gearbox, box.mesh_loss, stage.dampings.stage1,
        input_torque, output_torque, out,
    )  # fmt: skip
    return out


def stage_alone(subject: Subject, p: Parameters) -> Specimen:
    """Stage 1 between two free shafts."""
    return subject.element(p, ("motor", "carrier1"), ("stage1", "stage1_friction"))


def demo_parameters() -> Parameters:
    """Inertias 1 and 1.5 kg·m² through a ratio of 2, mesh efficiency 0.5 both ways.

    The reference is rigid, so mesh and bristles are as stiff as the finest step carries: 1e-9 rad of give under the
    torques of the demo. In the bench's law, friction over torque carried on is 1/η − 1 when driving and 1 − η when
    driven back: 1 and 0.5.
    """
    stiffness = 3e9
    # Copies are not held to the bounds of a bench: the example's gears are a thousand times heavier.
    stage = GearStage().model_copy(
        update={"stiffness": stiffness, "damping_ratio": 0.5, "backlash": 0.0, "drag": 0.0, "ripple": 0.0}
    )
    tiny = 1e-9
    gearbox = Gearbox().model_copy(
        update={
            "ratio": 2.0, "input_inertia": tiny, "carrier1_inertia": 1.5, "efficiency": 0.25,
            "backdrive_loss_ratio": 0.5, "breakaway_ratio": 1.0, "stribeck_velocity": 1e-3,
            "bristle_stiffness": stiffness, "bristle_damping": math.sqrt(stiffness), "stage1": stage, "stage2": stage,
        }
    )  # fmt: skip
    motor = Motor().model_copy(update={"rotor_inertia": 1.0 - tiny})
    parts = {"motor": motor, "gearbox": gearbox, "simulation": Simulation(substeps=64)}
    return Parameters().model_copy(update=parts)


def lossy_gear_demo(subject: Subject) -> Iterator[Row]:
    """Sticking, breaking away and reversing at the times and places of the reference result."""
    stage = stage_alone(subject, demo_parameters())
    time = stage.times(0.5)
    out = run_stage(stage, 10.0 * np.sin(2.0 * np.pi * time), -10.0 + 2.5 * time)
    angle, speed = out[:, 2], out[:, 3]
    still = 2e-5  # rad/s; above what the bristles ring with after a stop
    first_stop = crossing(time, np.abs(speed), still, after=0.05)
    second_stop = crossing(time, np.abs(speed), still, after=0.3)
    for quantity, expected, obtained in (
        ("sticks", 0.0805, first_stop),
        ("breaks away", 0.1995, start(time, speed, 1e-4, after=0.1)),
        ("sticks again", 0.3713, second_stop),
        ("reverses", 0.4645, start(time, -speed, 1e-4, after=0.4)),
    ):
        yield Row(GROUP, f"time at which it {quantity}", "s", expected, DEMO, obtained, 0.5e-3, relative=False)
    for quantity, unit, expected, obtained in (
        ("load angle while it sticks", "rad", -1.117e-3, at(time, angle, 0.15)),
        ("load angle while it sticks again", "rad", 2.084e-4, at(time, angle, 0.43)),
        ("load angle at 0.5 s", "rad", 1.66e-5, float(angle[-1])),
        ("load speed at 0.5 s", "rad/s", -0.01626, float(speed[-1])),
    ):
        yield Row(GROUP, quantity, unit, expected, DEMO, obtained, 0.01)


@compiled
def _run_box(
    plant: Plant, applied: Any, box: Any, mesh_loss: float, damping1: float, damping2: float, motor_torque: float,
    crank_torque: float, motor_brake: float, crank_brake: float, velocities: Any,
) -> None:  # fmt: skip
    for k in range(velocities.shape[0]):
        applied[0] = motor_torque - motor_brake * plant.qvel[0]
        applied[2] = crank_torque - crank_brake * plant.qvel[2]
        update_stage(plant, box, box.stage1, mesh_loss, damping1, 0, 0, 0, 0, 1)
        update_stage(plant, box, box.stage2, mesh_loss, damping2, 1, 1, 1, 1, 2)
        velocities[k, 0], velocities[k, 1] = plant.qvel[0], plant.qvel[2]
        mj_step(plant.model, plant.data)


def _efficiency(subject: Subject, p: Parameters, torque: float, *, back: bool) -> float:
    """Power out over power in of the whole gearbox at a steady speed, against a brake on the other shaft."""
    box = subject.element(p, ("motor", "carrier1", "crank"), ("stage1", "stage2", "stage1_friction", "stage2_friction"))
    ratio = p.gearbox.ratio**2
    motor_speed = 100.0  # rad/s, far above the Stribeck velocity of every stage
    velocities = np.empty((round(0.3 / box.step), 2))
    # The brake is viscous and takes about what comes out, so the speed settles near motor_speed.
    brake = torque / (ratio * motor_speed) if back else torque * ratio**2 / motor_speed
    _run_box(
        box.plant, box.applied, box.record.gearbox, box.parameters.gearbox.mesh_loss, box.dampings.stage1,
        box.dampings.stage2, 0.0 if back else torque, torque if back else 0.0, brake if back else 0.0,
        0.0 if back else brake, velocities,
    )  # fmt: skip
    motor, crank = velocities[-400:].mean(axis=0)
    if back:
        return float(brake * motor**2 / (torque * crank))
    return float(brake * crank**2 / (torque * motor))


def _expected_driving(p: Parameters, torque: float) -> float:
    """Efficiency by the definition: each stage takes its drag, then its mesh loss from what is left."""
    box = p.gearbox

    def out(loss: float, t: float) -> float:
        for stage in (box.stage1, box.stage2):
            t = (t - stage.drag) / (1.0 + loss) * box.ratio
        return t

    loss = mesh_loss(p)
    return out(loss, torque) / (torque * box.ratio**2)


def _expected_back(p: Parameters, torque: float) -> float:
    box = p.gearbox
    loss, t = mesh_loss(p) * box.backdrive_loss_ratio, torque
    for stage in (box.stage2, box.stage1):
        t = t / box.ratio * (1.0 - loss) - stage.drag
    return t * box.ratio**2 / torque


def efficiency(subject: Subject) -> Iterator[Row]:
    """Efficiency of the whole gearbox both ways, over torque; without ripple and transmission error."""
    p = Parameters()
    stages = {
        name: getattr(p.gearbox, name).model_copy(update={"ripple": 0.0, "transmission_error": 0.0})
        for name in ("stage1", "stage2")
    }
    p = p.model_copy(update={"gearbox": p.gearbox.model_copy(update=stages)})
    group, law = "drive and back-drive", "definition, stage by stage"
    yield Row(group, "efficiency, motor drives at 1 N·m", "1", 0.85, "thesis 3.2.2",
              _efficiency(subject, p, 1.0, back=False), 0.005)  # fmt: skip
    for torque in (0.25, 0.5, 2.0, 4.0):
        yield Row(group, f"efficiency, motor drives at {torque:g} N·m", "1", _expected_driving(p, torque), law,
                  _efficiency(subject, p, torque, back=False), 0.005)  # fmt: skip
    for torque in (10.0, 25.0, 50.0, 100.0):
        yield Row(group, f"efficiency, {torque:g} N·m at the crank drives the motor", "1", _expected_back(p, torque),
                  law, _efficiency(subject, p, torque, back=True), 0.005)  # fmt: skip
