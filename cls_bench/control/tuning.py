"""Gains of the cascade, designed from bandwidths, nameplate and the known inertia; one set for every scenario."""

import math
from typing import Any, NamedTuple

import numpy as np


class Gains(NamedTuple):
    """Gains of the drive's controllers."""

    current_proportional: float  # [V/A]
    current_integral: float  # [V/(A·s)]
    velocity_proportional: float  # [N·m·s/rad]
    velocity_integral_time: float  # [s]
    position_proportional: float  # [1/s]
    position_integral_time: float  # [s], 0: no integral
    speed_filter: float  # weight of a new speed sample [1]


GAINS = np.dtype([(name, np.float64) for name in Gains._fields])
"""The same as a record."""


def design(drive: Any, plate: Any, velocity_cycle: float) -> Gains:
    """Gains for the parameters of drive and nameplate; ``velocity_cycle`` [s].

    * current: ω_c (L + R/s) cancels the winding's pole, the loop becomes ω_c/s;
    * velocity: with k_p = J ω_v the loop is ω_v/s above 1/T_n;
    * position: with k_p = ω_p the loop is ω_p/s.
    """
    current = 2.0 * math.pi * drive.current_bandwidth
    velocity = 2.0 * math.pi * drive.velocity_bandwidth
    filter_time = drive.speed_filter_time
    return Gains(
        current_proportional=current * plate.inductance,
        current_integral=current * plate.resistance,
        velocity_proportional=plate.load_inertia * velocity,
        velocity_integral_time=drive.velocity_integral_time,
        position_proportional=2.0 * math.pi * drive.position_bandwidth,
        position_integral_time=drive.position_integral_time,
        speed_filter=1.0 if filter_time <= 0.0 else 1.0 - math.exp(-velocity_cycle / filter_time),
    )
