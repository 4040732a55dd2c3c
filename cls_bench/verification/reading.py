"""Reading times and values off a sampled signal."""

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def crossing(time: Array, signal: Array, level: float = 0.0, *, after: float = -math.inf) -> float:
    """First time [s] after ``after`` at which ``signal`` passes ``level``, linearly interpolated; NaN if never."""
    above = signal > level
    hits = np.flatnonzero((above[1:] != above[:-1]) & (time[:-1] >= after))
    if not hits.size:
        return math.nan
    k = hits[0]
    share = (level - signal[k]) / (signal[k + 1] - signal[k])
    return float(time[k] + share * (time[k + 1] - time[k]))


def crossings(time: Array, signal: Array) -> Array:
    """All times [s] at which ``signal`` passes zero, linearly interpolated."""
    k = np.flatnonzero((signal[1:] > 0) != (signal[:-1] > 0))
    return np.asarray(time[k] - signal[k] * (time[k + 1] - time[k]) / (signal[k + 1] - signal[k]))


def at(time: Array, signal: Array, when: float) -> float:
    """Value of ``signal`` at ``when`` [s], linearly interpolated; NaN outside the record."""
    if not time[0] <= when <= time[-1]:
        return math.nan
    return float(np.interp(when, time, signal))


def start(time: Array, speed: Array, level: float, *, after: float = -math.inf) -> float:
    """When a motion [s] began whose torque grows linearly from zero, so that its speed grows with the square of time.

    ``level`` [rad/s] is where the speed is read first; the second reading is at four times that.
    """
    first, second = (crossing(time, speed, factor * level, after=after) for factor in (1.0, 4.0))
    return 2.0 * first - second
