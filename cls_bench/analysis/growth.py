"""Growth rate of an oscillation, fitted to recorded motion: the verdict on stability without any amplitude threshold.

The motion in a window is taken as a sum of damped or growing oscillations Σ c_k e^{s_k t}; the s_k come from the shift
invariance of the signal subspace (ESPRIT; Roy & Kailath 1989), the c_k from least squares. No start values, no
iteration, and a growth rate far below one per window is still resolved as long as the oscillation stands out of the
noise.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Mode:
    """One oscillation c e^{st} of a fit."""

    growth: float
    """growth rate, negative when it decays [1/s]"""
    frequency: float
    """[Hz]"""
    amplitude: float
    """in the middle of the window [unit of the signal]"""
    share: float
    """its part of the signal's energy in the window, 0 to 1"""


def modes(signal: Any, period: float, order: int = 6) -> list[Mode]:
    """The oscillations in ``signal``, sampled every ``period`` [s], strongest first; at most ``order`` / 2 of them.

    A signal that is zero throughout has none. Needs at least 4 · ``order`` samples (ValueError).
    """
    x: Array = np.asarray(signal, dtype=float)
    n = len(x)
    if n < 4 * order:
        raise ValueError(f"{n} samples are too few for {order} exponentials; at least {4 * order}")
    energy = float(np.dot(x, x))
    if energy == 0.0 or not math.isfinite(energy):
        return []
    rows = np.lib.stride_tricks.sliding_window_view(x, n // 2)
    _, basis = np.linalg.eigh(rows.T @ rows)
    signals = basis[:, -order:]
    z = np.linalg.eigvals(np.linalg.lstsq(signals[:-1], signals[1:], rcond=None)[0])
    z = z[(np.abs(z) > 0.05) & (np.abs(z) < 20.0)]  # what dies within a sample or two is no oscillation
    time = np.arange(n) - 0.5 * (n - 1)
    shapes = z[None, :] ** time[:, None]
    shapes /= np.linalg.norm(shapes, axis=0)
    weights = np.linalg.lstsq(shapes, x.astype(complex), rcond=None)[0]
    found = []
    for pole, weight, shape in zip(z, weights, shapes.T, strict=True):
        s = np.log(pole) / period
        if s.imag <= 0.0 or s.imag >= 0.999 * math.pi / period:
            continue
        part = 2.0 * (weight * shape).real
        found.append(
            Mode(
                float(s.real), float(s.imag / (2.0 * math.pi)), float(2.0 * abs(weight * shape[n // 2])),
                min(float(np.dot(part, part)) / energy, 1.0),
            )
        )  # fmt: skip
    return sorted(found, key=lambda mode: -mode.share)
