"""Sensors: all that control may know of the plant, with resolution, range, noise, filter and faults."""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cls_bench.compiled import compiled
from cls_bench.parameters import Parameters

SAMPLES = np.dtype(
    [
        ("encoder", np.float64),  # motor angle [rad], quantised
        ("current", np.float64),  # motor current [A]
        ("load_cell", np.float64),  # converter counts, filtered
        ("potentiometer", np.float64),  # column angle [rad], quantised
        ("switch_forward", np.int64),  # 1 while closed (within travel), 0 when open: wired fail-safe
        ("switch_aft", np.int64),
    ]
)
"""What control is given, and nothing else."""

NORMAL = ("encoder", "load_cell", "potentiometer")
"""Sources of normal noise; each has a random stream of its own."""

UNIFORM = ("spike", "command_frame", "feedback_frame")
"""Sources of chance, uniform in [0, 1); drawn only while something depends on them."""

TURBULENCE = ("gust",)
"""Sources of normal noise that are drawn only while something depends on them."""


def woken(p: Parameters) -> dict[str, bool]:
    """Which sources of chance the sensors depend on with these parameters."""
    return {"spike": p.load_cell.spike_rate > 0.0}


class Noise(NamedTuple):
    """The random numbers of a block, (ticks, axes) each; of :data:`UNIFORM`, :data:`TURBULENCE` they may be empty."""

    encoder: NDArray[np.float64]
    load_cell: NDArray[np.float64]
    potentiometer: NDArray[np.float64]
    spike: NDArray[np.float64]
    command_frame: NDArray[np.float64]
    feedback_frame: NDArray[np.float64]
    gust: NDArray[np.float64]


_SUPPLY_BROKEN, _SIGNAL_BROKEN = 1, 2  # places among the choices of load_cell.wire


def configure(mechanism: Any, p: Parameters) -> None:
    """Put what follows for the amplifier into the record ``mechanism``."""
    mechanism.count = p.load_cell.count
    mechanism.filter_blend = 1.0 - math.exp(-2.0 * math.pi * p.load_cell.filter_bandwidth * mechanism.tick)
    mechanism.creep_blend = 1.0 - math.exp(-mechanism.tick / p.load_cell.creep_time)


@compiled
def _quantised(value: float, step: float) -> float:
    return math.floor(value / step + 0.5) * step


@compiled
def is_saturated(cell: Any, counts: float) -> bool:
    """Whether the converter is at either end of its range."""
    full_scale = float(1 << (cell.adc_bits - 1))
    return bool(counts >= full_scale - 1.0 or counts <= -full_scale)


@compiled
def weigh(cell: Any, mechanism: Any, body: Any, force: float, noise: float, spike: float) -> float:
    """Converter counts of one sample of the load cell under ``force`` [N], tension positive.

    What the gauge shows is (1 + gain error) · (force + creep) + zero. The amplifier is a first-order low pass,
    discretised exactly for a force held over the tick; its converter saturates at the range. ``noise`` is a standard
    normal number, ``spike`` one in [0, 1), which is compared with the chance of a spike in a tick.
    """
    body.zero += cell.drift * mechanism.tick
    shown = force
    if cell.creep != 0.0:
        body.crept += mechanism.creep_blend * (cell.creep * force - body.crept)
        shown += body.crept
    shown = (1.0 + cell.gain_error) * shown + cell.offset + body.zero
    chance = cell.spike_rate * mechanism.tick
    if spike < chance:
        shown += cell.spike if spike < 0.5 * chance else -cell.spike
    full_scale = float(1 << (cell.adc_bits - 1))
    if cell.wire == _SUPPLY_BROKEN:
        shown = 0.0
    elif cell.wire == _SIGNAL_BROKEN:
        shown = full_scale * mechanism.count
    body.shown_force = shown
    body.amplified += mechanism.filter_blend * (shown - body.amplified)
    counts = math.floor((body.amplified + cell.noise * noise) / mechanism.count + 0.5)
    return float(min(max(counts, -full_scale), full_scale - 1.0))


@compiled
def sample(plant: Any, truth: Any, noise: Any, axis: int, row: int, samples: Any) -> None:
    """Take one sample of every sensor of the axis, with the random numbers of tick ``row`` of the block."""
    p, joints, body = truth.parameters, truth.joints, truth.body
    encoder = p.encoder
    step = 2.0 * math.pi / (encoder.counts * encoder.interpolation)
    turned = plant.qpos[joints.motor] + encoder.slip + encoder.noise * noise.encoder[row, axis]
    samples.encoder = _quantised(turned, step)
    samples.current = body.current

    spike = noise.spike[row, axis] if p.load_cell.spike_rate > 0.0 else 1.0
    samples.load_cell = weigh(
        p.load_cell, truth.mechanism, body, body.rod_force, noise.load_cell[row, axis], spike
    )  # fmt: skip

    column = plant.qpos[joints.column]
    pot = p.potentiometer
    pot_step = 2.0 * pot.range / (1 << pot.adc_bits)
    shown = _quantised(column + pot.noise * noise.potentiometer[row, axis], pot_step)
    samples.potentiometer = min(max(shown, -pot.range), pot.range)
    samples.switch_forward = 1 if column < p.column.switch_angle else 0
    samples.switch_aft = 1 if column > -p.column.switch_angle else 0
