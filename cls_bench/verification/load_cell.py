"""Load cell: static gain, resolution, saturation, filter, and the spring it is."""

import math
from collections.abc import Iterator

import numpy as np

from cls_bench.parameters import GRAVITY, Column, Linkage, Parameters
from cls_bench.plant import sensors
from cls_bench.verification.reading import Array, crossings
from cls_bench.verification.row import Row
from cls_bench.verification.subject import Specimen, Subject

GROUP = "load cell"

COUNT = 2.0 * 50.0 * GRAVITY / 2.0**24
"""What the PLC takes a count for [N]: ± the cell's 50 kg over the converter's 24 bits (thesis table 3.4)."""


def _cell(subject: Subject, p: Parameters | None = None) -> Specimen:
    """The column alone on the cell's spring, crank held; without friction and gravity."""
    return subject.element(p or Parameters(), ("column",), ("bearing", "weight"))


def _weighed(specimen: Specimen, forces: Array, *, settled: bool = False) -> Array:
    """Converter counts, one sample a tick, for forces at the strain gauge [N], without noise or spikes.

    ``settled``: each after it has lasted for good.
    """
    truth = specimen.truth
    counts = []
    for force in forces:
        if settled:
            truth.body.amplified = force
        counts.append(sensors.weigh(truth.parameters.load_cell, truth.mechanism, truth.body, force, 0.0, 1.0))
    return np.array(counts)


def static(subject: Subject) -> Iterator[Row]:
    """Gain, resolution and range of cell and converter at rest."""
    arm = Parameters().linkage.arm
    specimen = _cell(subject)
    record = specimen.run(specimen.times(0.5), {"column": 100.0 * arm})
    counts = _weighed(specimen, record.signal["rod_force"])
    yield Row(GROUP, "reading at rest under 100 N", "N", 100.0, "equilibrium of forces", counts[-1] * COUNT, 1e-3)
    yield Row(GROUP, "give under 100 N", "m", 100.0 / 3.0e6, "assumed stiffness of 3e6 N/m",
              arm * specimen.final("column"), 1e-3)  # fmt: skip
    forces = 10.0 + np.linspace(0.0, 100.0 * COUNT, 5001)
    steps = int(np.count_nonzero(np.diff(_weighed(specimen, forces, settled=True))))
    yield Row(GROUP, "resolution", "N", COUNT, "50 kg both ways over 24 bits, thesis table 3.4",
              float(forces[-1] - forces[0]) / steps, 0.02)  # fmt: skip
    high, low = _weighed(specimen, np.array([800.0, -800.0]), settled=True) * COUNT
    for sign, value in (("tension", high), ("compression", -low)):
        yield Row(GROUP, f"reading under 800 N of {sign}", "N", 50.0 * GRAVITY, "range of 50 kg, thesis 3.2.3", value,
                  1e-3)  # fmt: skip


def filter_step(subject: Subject) -> Iterator[Row]:
    """Step response of the input filter, at its bandwidth and slowed down tenfold."""
    for bandwidth, samples in ((5000.0, (1, 2, 3)), (500.0, (4, 8, 16))):
        p = Parameters()
        cell = p.load_cell.model_copy(update={"filter_bandwidth": bandwidth})
        specimen = _cell(subject, p.model_copy(update={"load_cell": cell}))
        counts = _weighed(specimen, np.full(max(samples), 100.0)) * COUNT / 100.0
        for n in samples:
            time = n * p.rates.clock.tick_s
            yield Row(GROUP, f"{bandwidth:g} Hz filter {time * 1e3:g} ms after a unit step", "1",
                      -math.expm1(-2.0 * math.pi * bandwidth * time), "closed form, first order", counts[n - 1],
                      1e-3)  # fmt: skip


def ringing(subject: Subject) -> Iterator[Row]:
    """Free oscillation on the cell: of the rod end alone, as good as no column on it, and of the column."""
    p = Parameters()
    feather = Column(inertia=1e-5, mass=1e-3, mass_height=0.0)
    end_alone = p.model_copy(update={"column": feather})
    for what, bench in (("rod end", end_alone), ("column", p)):
        specimen = _cell(subject, bench)
        specimen.place(column=1e-5 / bench.linkage.arm)
        mass = bench.linkage.rod_end_mass + bench.column.inertia / bench.linkage.arm**2
        natural = math.sqrt(bench.load_cell.stiffness / mass)
        damped = natural * math.sqrt(1.0 - bench.load_cell.damping_ratio**2)
        time = specimen.times(14.2 * 2.0 * math.pi / damped)
        zeros = crossings(time, specimen.run(time).angle["column"])
        yield Row(GROUP, f"frequency of the {what} on the cell", "Hz", damped / (2.0 * math.pi),
                  "closed form, damped", 0.5 * (len(zeros) - 1) / float(zeros[-1] - zeros[0]), 0.01)  # fmt: skip


def torque_cell(subject: Subject) -> Iterator[Row]:
    """Without a linkage the cell is a shaft: its reading at rest, and its twist."""
    p = Parameters(linkage=Linkage(kind="none"))
    arm = p.linkage.arm
    specimen = _cell(subject, p)
    record = specimen.run(specimen.times(0.5), {"column": 100.0 * arm})
    counts = _weighed(specimen, record.signal["rod_force"])
    source = "equilibrium of torques"
    yield Row(GROUP, "no linkage: reading at rest under 17.5 N·m", "N·m", 100.0 * arm, source,
              arm * counts[-1] * COUNT, 1e-3)  # fmt: skip
    yield Row(GROUP, "no linkage: twist under 17.5 N·m", "rad", 100.0 / (p.load_cell.stiffness * arm), source,
              specimen.final("column"), 1e-3)  # fmt: skip
