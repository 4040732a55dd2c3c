"""Backlash: Modelica's Backlash example on the gear stage and on the stop blocks, and the dead zone as measured."""

import math
from collections.abc import Iterator
from typing import Any

import mujoco
import numpy as np

from cls_bench.compiled import compiled, mj_step
from cls_bench.parameters import Column, Gearbox, GearStage, Parameters
from cls_bench.plant.gearbox import update_stage
from cls_bench.plant.play import set_play
from cls_bench.plant.state import Plant
from cls_bench.verification.gear import run_stage, stage_alone
from cls_bench.verification.reading import Array, at, crossing
from cls_bench.verification.row import Row
from cls_bench.verification.subject import Specimen, Subject

GROUP = "backlash"
DEMO = "Modelica Backlash"

INERTIA, STIFFNESS, DAMPING, GAP, START = 5.0, 2.0e4, 50.0, math.pi / 4.0, math.pi / 2.0
"""The example [kg·m², N·m/rad, N·m·s/rad, rad, rad]: an inertia released from rest against a spring with play."""


@compiled
def _run_stop(plant: Plant, gap: float, damping: float, out: Any) -> None:
    for k in range(out.shape[0]):
        angle, speed = plant.qpos[0], plant.qvel[0]
        out[k, 0], out[k, 1] = angle, speed
        set_play(plant, 0, angle, speed, -gap / 2.0, gap / 2.0, damping)
        mj_step(plant.model, plant.data)


def _demo_rows(what: str, scale: float, time: Array, angle: Array, speed: Array) -> Iterator[Row]:
    """The example's events in a motion whose angles are ``scale`` times those of the example.

    The contact ends where the damping takes up all of the spring's torque, before the gap is reached.
    """
    end = crossing(time, STIFFNESS * (angle - scale * GAP / 2.0) + DAMPING * speed)
    enter = crossing(time, angle, scale * GAP / 2.0)
    for quantity, expected, obtained in (
        ("contact ends", 0.02366, end),
        ("gap is entered", 0.02616, enter),
        ("gap is crossed", 0.03802, crossing(time, angle, -scale * GAP / 2.0)),
    ):
        yield Row(GROUP, f"{what}: time at which the {quantity}", "s", expected, DEMO, obtained, 1e-4, relative=False)
    note = DEMO if scale == 1.0 else f"{DEMO}, angles × {scale:g}"
    yield Row(GROUP, f"{what}: speed when the contact ends", "rad/s", -66.20 * scale, note, at(time, speed, end), 0.01)
    # From the motion, so it is the torque that really acted; limit: what rounding of the speeds makes of nothing.
    acted = INERTIA * np.diff(speed) / (time[1] - time[0])
    pull = float(np.max(np.sign(angle[:-1]) * acted))
    yield Row(GROUP, f"{what}: greatest pull of the contact", "N·m", 0.0, "a contact cannot pull", pull, 1e-6,
              relative=False)  # fmt: skip


def stop_block_demo(subject: Subject) -> Iterator[Row]:
    """The example on the stop blocks."""
    p = Parameters(
        column=Column(
            inertia=INERTIA, mass=1e-3, mass_height=0.0, viscous_friction=0.0, coulomb_friction=0.0,
            stop_angle=GAP / 2.0, stop_stiffness=STIFFNESS, stop_damping=DAMPING,
        )
    )  # fmt: skip
    stops = subject.element(p, ("column",), ("stop_blocks",))
    stops.data.qpos[0] = START
    time = stops.times(0.05)
    out = np.empty((len(time), 2))
    _run_stop(stops.plant, 2.0 * stops.parameters.column.stop_angle, stops.dampings.stop, out)
    yield from _demo_rows("stop blocks", 1.0, time, *out.T)


def _stage_parameters(scale: float) -> Parameters:
    """Stage 1 as the example's spring: its input is held by a great inertia, its output is the example's inertia."""
    great = 1e9
    damping_ratio = DAMPING / (2.0 * math.sqrt(STIFFNESS * INERTIA))
    stage = GearStage(stiffness=STIFFNESS, damping_ratio=damping_ratio, backlash=scale * GAP, drag=0.0, ripple=0.0)
    # A copy is not held to the bounds of a bench: the input stands for a wall.
    gearbox = Gearbox().model_copy(
        update={
            "input_inertia": great, "carrier1_inertia": INERTIA, "efficiency": 1.0, "stage1": stage, "stage2": stage,
        }
    )  # fmt: skip
    return Parameters().model_copy(update={"gearbox": gearbox})


def gear_demo(subject: Subject) -> Iterator[Row]:
    """The example on the meshes of stage 1; the law is homogeneous in the angles, so they are scaled to its range."""
    scale = 0.05
    stage = stage_alone(subject, _stage_parameters(scale))
    stage.data.qpos[1] = scale * START
    time = stage.times(0.05)
    out = run_stage(stage, np.zeros(len(time)), np.zeros(len(time)))
    yield from _demo_rows("gear stage", scale, time, out[:, 2], out[:, 3])


def dead_zone(subject: Subject) -> Iterator[Row]:
    """Play and stiffness of both gear stages, found by turning the output to and fro against a held input.

    The torque's two straight branches are extended to zero; their distance is the play.
    """
    p = Parameters()
    stages = {
        name: getattr(p.gearbox, name).model_copy(update={"transmission_error": 0.0}) for name in ("stage1", "stage2")
    }
    p = p.model_copy(update={"gearbox": p.gearbox.model_copy(update=stages)})
    for name, joints in (("stage1", ("motor", "carrier1")), ("stage2", ("carrier1", "crank"))):
        specimen = subject.element(p, joints, (name, f"{name}_friction"))
        declared: GearStage = getattr(p.gearbox, name)
        angles = np.linspace(-3.0, 3.0, 40) * declared.backlash
        torques = np.array([_held_torque(specimen, name, angle) for angle in angles])
        (slope, offset), (slope_back, offset_back) = (
            np.polyfit(angles[side], torques[side], 1) for side in (torques > 0.0, torques < 0.0)
        )
        what = f"stage {name[-1]}"
        yield Row(GROUP, f"dead zone of {what}", "rad", declared.backlash, "parameter",
                  abs(offset / slope - offset_back / slope_back), 0.01)  # fmt: skip
        yield Row(GROUP, f"stiffness of {what} beyond it", "N·m/rad", declared.stiffness, "parameter",
                  -0.5 * float(slope + slope_back), 0.01)  # fmt: skip


def _held_torque(specimen: Specimen, name: str, angle: float) -> float:
    """Torque [N·m] on a stage's output shaft at rest at ``angle`` [rad], as MuJoCo applies it."""
    specimen.data.qpos[:] = 0.0, angle
    box = specimen.record.gearbox
    update_stage(specimen.plant, box, getattr(box, name), 0.0, 0.0, 0, 0, 0, 0, 1)
    mujoco.mj_forward(specimen.model, specimen.data)
    return float(specimen.data.qfrc_passive[1])
