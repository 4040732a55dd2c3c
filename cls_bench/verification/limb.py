"""Limb: the two masses that the grip couples, over the squeeze."""

import math
from collections.abc import Iterator

import numpy as np

from cls_bench.parameters import Linkage, Parameters
from cls_bench.verification.reading import crossings
from cls_bench.verification.row import Row
from cls_bench.verification.subject import Hand, Specimen, Subject

GROUP = "limb"


def _two_masses(subject: Subject) -> Specimen:
    """Column and limb alone, coupled by the grip; without rod, gravity, friction and stops, which are the column's."""
    p = Parameters(linkage=Linkage(kind="none"))  # so that no rod end hangs on the column
    # A copy is not held to the bounds of a bench.
    column = p.column.model_copy(update={"stop_angle": 1e6})
    return subject.element(p.model_copy(update={"column": column}), ("column", "limb"), ("rod", "bearing", "weight"))


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
        specimen.run(np.zeros(1), hand=Hand(squeeze))  # grip, then push apart
        specimen.push(column=1.0 / column, limb=-1.0 / hand)
        time = specimen.times(2.6 * math.pi / damped)
        angle = specimen.run(time, hand=Hand(squeeze)).angle
        zeros = crossings(time[1:], (angle["column"] - angle["limb"])[1:])
        period = 2.0 * float(zeros[-1] - zeros[0]) / (len(zeros) - 1) if len(zeros) > 1 else math.nan
        yield Row(GROUP, f"two-mass resonance at squeeze {squeeze:g}", "Hz", damped / (2.0 * math.pi),
                  "closed form, damped", 1.0 / period, 0.01)  # fmt: skip


def rigid(subject: Subject) -> Iterator[Row]:
    """Squeeze 1 as good as rigid: the give of the grip under 100 N, and a common motion of both masses."""
    p = Parameters()
    height = p.column.grip_height
    specimen = _two_masses(subject)
    time = specimen.times(0.2)
    angle = specimen.run(time, {"limb": 100.0 * height}, hand=Hand(1.0)).angle
    # Both masses accelerate together; the grip carries the column's share.
    column, hand = p.column.inertia, p.limb.mass * height**2
    share = column / (column + hand)
    give = float(angle["limb"][-1] - angle["column"][-1]) * height
    yield Row(GROUP, "give of the grip, 100 N on the hand at squeeze 1", "m", share * 100.0 / p.limb.tight_stiffness,
              "closed form", give, 0.01)  # fmt: skip
    acceleration = 100.0 * height / (column + hand)
    yield Row(GROUP, "column angle 0.2 s after it, as one rigid body", "rad", 0.5 * acceleration * time[-1] ** 2,
              "closed form", float(angle["column"][-1]), 0.01)  # fmt: skip
