"""Sensors: all that control may know of the plant, with resolution, range, noise and filter."""

import math
from typing import Any

import numpy as np

from cls_bench.compiled import compiled
from cls_bench.plant.state import COLUMN, CURRENT, LOAD_CELL, MOTOR
from cls_bench.signals import TICK_S

SAMPLES = np.dtype(
    [
        ("encoder", np.float64),  # motor angle [rad], quantised
        ("current", np.float64),  # motor current [A]
        ("load_cell", np.float64),  # converter counts, filtered
        ("potentiometer", np.float64),  # column angle [rad], quantised
        ("switch_forward", np.int64),  # 1 while closed (within travel), 0 when open: wired fail-safe
        ("switch_aft", np.int64),
        ("strain_force", np.float64),  # force the strain gauge sees [N]: for the record, not for control
        ("filter_state", np.float64),  # amplifier output [N]: state of the filter, not for control
    ]
)

NOISES = 3
"""Independent normal random numbers a sample needs: encoder, load cell, potentiometer."""


@compiled
def _quantised(value: float, step: float) -> float:
    return math.floor(value / step + 0.5) * step


@compiled
def load_cell_count(cell: Any) -> float:
    """Force [N] of one converter count: the range, to both sides, over 2^bits."""
    return float(2.0 * cell.capacity / (1 << cell.adc_bits))


@compiled
def is_saturated(cell: Any, counts: float) -> bool:
    """Whether the converter is at either end of its range."""
    full_scale = float(1 << (cell.adc_bits - 1))
    return bool(counts >= full_scale - 1.0 or counts <= -full_scale)


@compiled
def weigh(cell: Any, force: float, noise: float, samples: Any) -> None:
    """Take one sample of the load cell under ``force`` [N], tension positive.

    The amplifier is a first-order low pass, discretised exactly for a force held over the tick; its converter
    saturates at the range. ``noise`` is a standard normal number.
    """
    samples.strain_force = force
    blend = 1.0 - math.exp(-2.0 * math.pi * cell.filter_bandwidth * TICK_S)
    samples.filter_state += blend * (force - samples.filter_state)
    amplified = samples.filter_state + cell.noise * noise
    full_scale = float(1 << (cell.adc_bits - 1))
    counts = math.floor(amplified / load_cell_count(cell) + 0.5)
    samples.load_cell = min(max(counts, -full_scale), full_scale - 1.0)


@compiled
def sample(plant: Any, p: Any, cell_damping: float, noise: Any, samples: Any) -> None:
    """Take one sample of every sensor; ``noise`` holds :data:`NOISES` standard normal numbers."""
    encoder = p.encoder
    step = 2.0 * math.pi / (encoder.counts * encoder.interpolation)
    samples.encoder = _quantised(plant.qpos[MOTOR] + encoder.noise * noise[0], step)
    samples.current = plant.act[CURRENT]

    cell = p.load_cell
    force = cell.stiffness * plant.qpos[LOAD_CELL] + cell_damping * plant.qvel[LOAD_CELL]
    weigh(cell, force, noise[1], samples)

    column = plant.qpos[COLUMN]
    pot = p.potentiometer
    pot_step = 2.0 * pot.range / (1 << pot.adc_bits)
    samples.potentiometer = min(max(_quantised(column + pot.noise * noise[2], pot_step), -pot.range), pot.range)
    samples.switch_forward = 1 if column < p.column.switch_angle else 0
    samples.switch_aft = 1 if column > -p.column.switch_angle else 0
