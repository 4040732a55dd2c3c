"""Backlash: Modelica's Backlash example on the gear stage and on the stop blocks, and the dead zone as measured."""

import math
from collections.abc import Iterator

import numpy as np

from cls_bench.parameters import Column, Gearbox, GearStage, Limb, Linkage, Parameters
from cls_bench.verification.gear import stage_alone, with_stages
from cls_bench.verification.reading import Array, at, crossing
from cls_bench.verification.rigs import rigs
from cls_bench.verification.row import Row
from cls_bench.verification.subject import Specimen, Subject

GROUP = "backlash"
DEMO = "Modelica Backlash"

INERTIA, STIFFNESS, DAMPING, GAP, START = 5.0, 2.0e4, 50.0, math.pi / 4.0, math.pi / 2.0
"""The example [kg·m², N·m/rad, N·m·s/rad, rad, rad]: an inertia released from rest against a spring with play."""


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
        linkage=Linkage(kind="none"), limb=Limb(mass=1.0),
        column=Column(
            inertia=INERTIA, mass=1e-3, mass_height=0.0, viscous_friction=0.0, coulomb_friction=0.0,
            stop_angle=GAP / 2.0, stop_stiffness=STIFFNESS, stop_damping=DAMPING,
        ),
    )  # fmt: skip
    stops = subject.element(p, ("column",), ("rod",))
    stops.place(column=START)
    record = stops.run(stops.times(0.05))
    yield from _demo_rows("stop blocks", 1.0, record.time, record.angle["column"], record.velocity["column"])


def gear_demo(subject: Subject) -> Iterator[Row]:
    """The example on the meshes of stage 1; the law is homogeneous in the angles, so they are scaled to its range.

    The stage's input is held by a great inertia, its output is the example's inertia.
    """
    scale, great = 0.05, 1e9
    damping_ratio = DAMPING / (2.0 * math.sqrt(STIFFNESS * INERTIA))
    stage = GearStage(
        stiffness=STIFFNESS, damping_ratio=damping_ratio, backlash=scale * GAP, inertia=INERTIA, ripple=0.0
    )
    # A copy is not held to the bounds of a bench: the input stands for a wall.
    gearbox = Gearbox().model_copy(update={"input_inertia": great, "stage1": stage, "stage2": stage})
    alone = stage_alone(subject, Parameters().model_copy(update={"gearbox": gearbox}))
    alone.place(carrier1=scale * START)
    record = alone.run(alone.times(0.05))
    yield from _demo_rows("gear stage", scale, record.time, record.angle["carrier1"], record.velocity["carrier1"])


def dead_zone(subject: Subject) -> Iterator[Row]:
    """Play and stiffness of every stage, found by turning the output to and fro against a held input.

    The torque's two straight branches are extended to zero; their distance is the play.
    """
    for rig, p in rigs().items():
        if rig not in ("thesis", "three stages", "worm"):
            continue
        exact = with_stages(p, transmission_error=0.0)
        for number, declared in enumerate(exact.gearbox.in_use, 1):
            alone = stage_alone(subject, exact, number)
            angles = np.linspace(-3.0, 3.0, 40) * declared.backlash
            torques = np.array([_held_torque(alone, number, angle) for angle in angles])
            (slope, offset), (slope_back, offset_back) = (
                np.polyfit(angles[side], torques[side], 1) for side in (torques > 0.0, torques < 0.0)
            )
            what = f"stage {number}" if rig == "thesis" else f"stage {number} of the rig with {rig}" if (
                rig == "three stages") else "a worm"  # fmt: skip
            yield Row(GROUP, f"dead zone of {what}", "rad", declared.backlash, "parameter",
                      abs(offset / slope - offset_back / slope_back), 0.01)  # fmt: skip
            yield Row(GROUP, f"stiffness of {what} beyond it", "N·m/rad", declared.stiffness, "parameter",
                      -0.5 * float(slope + slope_back), 0.01)  # fmt: skip


def _held_torque(alone: Specimen, number: int, angle: float) -> float:
    """Torque [N·m] on a stage's output shaft at rest at ``angle`` [rad], as it acts."""
    alone.reset()
    output = alone.shafts[number]
    alone.place(**{output: angle})
    alone.run(np.zeros(1))
    return float(alone.data.qfrc_applied[alone.joints.index(output)])
