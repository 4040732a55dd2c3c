"""Limb: the two masses that the grip couples, over the squeeze."""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from cls_bench.compiled import compiled, mj_step
from cls_bench.parameters import Parameters
from cls_bench.plant.limb import update_grip
from cls_bench.plant.state import Plant
from cls_bench.verification.reading import Array, crossings
from cls_bench.verification.row import Row
from cls_bench.verification.subject import Specimen, Subject

GROUP = "limb"


@compiled
def _run(
    plant: Plant, applied: Any, limb: Any, height: float, squeeze: float, torque: float, back: float, out: Any
) -> None:
    for k in range(out.shape[0]):
        applied[0], applied[1] = back * plant.qpos[0], torque
        update_grip(plant, limb, height, True, squeeze, 0, 1, 0)
        out[k, 0], out[k, 1] = plant.qpos[0], plant.qpos[1]
        mj_step(plant.model, plant.data)


def _two_masses(subject: Subject) -> Specimen:
    """Column and limb alone, coupled by the grip; without gravity and friction, which belong to the column."""
    p = Parameters()
    bare = {"mass_height": 0.0, "viscous_friction": 0.0}
    specimen = subject.element(
        p.model_copy(update={"column": p.column.model_copy(update=bare)}), ("column", "limb"), ("grip",)
    )
    specimen.plant.tendon_stiffness[0] = 0.0  # grips at rest, wherever the hand is
    return specimen


def _motion(specimen: Specimen, squeeze: float, steps: int, *, torque: float = 0.0, back: float = 0.0) -> Array:
    """Angles [rad] of column and limb; ``torque`` [N·m] on the limb, a spring ``back`` [N·m/rad] on the column."""
    out = np.empty((steps, 2))
    p = specimen.parameters
    _run(specimen.plant, specimen.applied, specimen.record.limb, p.column.grip_height, squeeze, torque, -back, out)
    return out


def resonance(subject: Subject) -> Iterator[Row]:
    """Two-mass resonance over the squeeze: ω² = c (1/J₁ + 1/J₂), damped."""
    p = Parameters()
    arm = p.column.grip_height**2
    column, hand = p.column.inertia, p.limb.mass * arm
    for squeeze in (0.0, 0.25, 0.5, 0.75, 1.0):
        stiffness = arm * p.limb.loose_stiffness ** (1.0 - squeeze) * p.limb.tight_stiffness**squeeze
        damping = arm * p.limb.loose_damping ** (1.0 - squeeze) * p.limb.tight_damping**squeeze
        inertia = column * hand / (column + hand)
        natural = math.sqrt(stiffness / inertia)
        ratio = damping / (2.0 * math.sqrt(stiffness * inertia))
        damped = natural * math.sqrt(1.0 - ratio**2)
        specimen = _two_masses(subject)
        _motion(specimen, squeeze, 1)  # grip, then push apart
        specimen.data.qvel[0], specimen.data.qvel[1] = 1.0 / column, -1.0 / hand
        steps = round(2.6 * math.pi / damped / specimen.step) + 2
        out = _motion(specimen, squeeze, steps)
        time = specimen.times((steps - 1) * specimen.step)
        zeros = crossings(time[1:], (out[:, 0] - out[:, 1])[1:])
        period = 2.0 * float(zeros[-1] - zeros[0]) / (len(zeros) - 1) if len(zeros) > 1 else math.nan
        yield Row(GROUP, f"two-mass resonance at squeeze {squeeze:g}", "Hz", damped / (2.0 * math.pi),
                  "closed form, damped", 1.0 / period, 0.01)  # fmt: skip


def rigid(subject: Subject) -> Iterator[Row]:
    """Squeeze 1 as good as rigid: the give of the grip under 100 N, and a common motion of both masses."""
    p = Parameters()
    height = p.column.grip_height
    specimen = _two_masses(subject)
    out = _motion(specimen, 1.0, 4000, torque=100.0 * height)
    # Both masses accelerate together; the grip carries the column's share.
    column, hand = p.column.inertia, p.limb.mass * height**2
    share = column / (column + hand)
    give = float(out[-1, 1] - out[-1, 0]) * height
    yield Row(GROUP, "give of the grip, 100 N on the hand at squeeze 1", "m", share * 100.0 / p.limb.tight_stiffness,
              "closed form", give, 0.01)  # fmt: skip
    acceleration = 100.0 * height / (column + hand)
    time = specimen.step * (len(out) - 1)
    yield Row(GROUP, "column angle 0.2 s after it, as one rigid body", "rad", 0.5 * acceleration * time**2,
              "closed form", float(out[-1, 0]), 0.01)  # fmt: skip
