"""Load cell: static gain, resolution, saturation, filter, and the spring it is."""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from cls_bench.compiled import compiled, mj_step
from cls_bench.parameters import GRAVITY, Parameters
from cls_bench.plant import sensors
from cls_bench.plant.state import Plant
from cls_bench.signals import TICK_S
from cls_bench.verification.reading import Array, crossings
from cls_bench.verification.row import Row
from cls_bench.verification.subject import Specimen, Subject

GROUP = "load cell"


@compiled
def _run(plant: Plant, applied: Any, cell: Any, damping: float, force: Any, samples: Any, out: Any) -> None:
    for k in range(force.shape[0]):
        sensors.weigh(cell, cell.stiffness * plant.qpos[0] + damping * plant.qvel[0], 0.0, samples)
        out[k, 0], out[k, 1], out[k, 2] = samples.strain_force, samples.load_cell, plant.qpos[0]
        applied[0] = force[k]
        mj_step(plant.model, plant.data)


def _cell(subject: Subject) -> Specimen:
    """The rod end alone on the cell's spring, the rod held."""
    return subject.element(Parameters(), ("load_cell",))


def _run_under(specimen: Specimen, force: Array) -> Array:
    """Pull the rod end with ``force`` [N], an entry a tick; columns: strain force [N], counts, give [m]."""
    samples: Any = np.zeros(1, dtype=sensors.SAMPLES).view(np.recarray)[0]
    out = np.empty((len(force), 3))
    _run(specimen.plant, specimen.applied, specimen.record.load_cell, specimen.dampings.load_cell, force, samples, out)
    return out


def _counts(subject: Subject, forces: Array) -> Array:
    """Converter counts under constant forces at the strain gauge [N], without noise, settled."""
    cell: Any = subject.element(Parameters(), ("load_cell",)).record.load_cell
    samples: Any = np.zeros(1, dtype=sensors.SAMPLES).view(np.recarray)[0]
    counts = []
    for force in forces:
        samples.filter_state = force
        sensors.weigh(cell, force, 0.0, samples)
        counts.append(float(samples.load_cell))
    return np.array(counts)


def static(subject: Subject) -> Iterator[Row]:
    """Gain, resolution and range of cell and converter at rest."""
    # What the PLC takes a count for: ± the cell's 50 kg over the converter's 24 bits (thesis table 3.4).
    count = 2.0 * 50.0 * GRAVITY / 2.0**24
    specimen = _cell(subject)
    out = _run_under(specimen, np.full(4000, 100.0))
    yield Row(GROUP, "reading at rest under 100 N", "N", 100.0, "equilibrium of forces", out[-1, 1] * count, 1e-3)
    yield Row(GROUP, "give under 100 N", "m", 100.0 / 3.0e6, "assumed stiffness of 3e6 N/m",
              float(out[-1, 2]), 1e-3)  # fmt: skip
    forces = 10.0 + np.linspace(0.0, 100.0 * count, 5001)
    steps = int(np.count_nonzero(np.diff(_counts(subject, forces))))
    yield Row(GROUP, "resolution", "N", count, "50 kg both ways over 24 bits, thesis table 3.4",
              float(forces[-1] - forces[0]) / steps, 0.02)  # fmt: skip
    high, low = _counts(subject, np.array([800.0, -800.0])) * count
    for sign, value in (("tension", high), ("compression", -low)):
        yield Row(GROUP, f"reading under 800 N of {sign}", "N", 50.0 * GRAVITY, "range of 50 kg, thesis 3.2.3", value,
                  1e-3)  # fmt: skip


def filter_step(subject: Subject) -> Iterator[Row]:
    """Step response of the input filter, at its bandwidth and slowed down tenfold."""
    for bandwidth, samples in ((5000.0, (1, 2, 3)), (500.0, (4, 8, 16))):
        p = Parameters()
        cell = p.load_cell.model_copy(update={"filter_bandwidth": bandwidth})
        record: Any = subject.element(p.model_copy(update={"load_cell": cell}), ("load_cell",)).record.load_cell
        state: Any = np.zeros(1, dtype=sensors.SAMPLES).view(np.recarray)[0]
        response = []
        for _ in range(max(samples)):
            sensors.weigh(record, 1.0, 0.0, state)
            response.append(float(state.filter_state))
        for n in samples:
            expected = -math.expm1(-2.0 * math.pi * bandwidth * n * TICK_S)
            yield Row(GROUP, f"{bandwidth:g} Hz filter {n * TICK_S * 1e3:g} ms after a unit step", "1", expected,
                      "closed form, first order", response[n - 1], 1e-3)  # fmt: skip


def ringing(subject: Subject) -> Iterator[Row]:
    """Free oscillation of the rod end on the cell."""
    specimen = _cell(subject)
    specimen.data.qpos[0] = 1e-5
    time = specimen.times(0.02)
    zeros = crossings(time, _run_under(specimen, np.zeros(len(time)))[:, 2])
    p = Parameters()
    mass = p.linkage.rod_end_mass
    natural = math.sqrt(p.load_cell.stiffness / mass)
    # The damping ratio is meant for rod end and column together.
    carried = mass + p.column.inertia / p.linkage.arm**2
    ratio = p.load_cell.damping_ratio * math.sqrt(carried / mass)
    yield Row(GROUP, "frequency of the rod end on the cell", "Hz", natural * math.sqrt(1 - ratio**2) / (2.0 * math.pi),
              "closed form, damped", 0.5 * (len(zeros) - 1) / float(zeros[-1] - zeros[0]), 0.01)  # fmt: skip
