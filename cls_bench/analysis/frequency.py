"""A frequency response and the numbers a control engineer reads off it; algebra and margins by python-control."""

import csv
import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cls_bench.claims import replaced

Array = NDArray[np.float64]


@dataclass(frozen=True)
class FrequencyResponse:
    """Complex ratio of two signals over frequency.

    ``coherence`` is 1 where the output follows the input alone; backlash, friction and noise lower it. ``amplitude``
    is that of the input at each frequency, in the input's unit: a non-linear bench answers each amplitude differently.
    """

    name: str
    frequency: Array
    """[Hz], ascending"""
    value: NDArray[np.complex128]
    coherence: Array = field(default_factory=lambda: np.array([]))
    amplitude: Array = field(default_factory=lambda: np.array([]))

    def __post_init__(self) -> None:
        object.__setattr__(self, "frequency", np.atleast_1d(np.asarray(self.frequency, dtype=float)))
        object.__setattr__(self, "value", np.atleast_1d(np.asarray(self.value, dtype=complex)))
        for name, fallback in (("coherence", 1.0), ("amplitude", math.nan)):
            values = np.asarray(getattr(self, name), dtype=float)
            object.__setattr__(self, name, values if values.size else np.full(len(self.frequency), fallback))

    @property
    def decibel(self) -> Array:
        """Magnitude [dB]."""
        return np.asarray(20.0 * np.log10(np.abs(self.value)))

    @property
    def phase(self) -> Array:
        """Phase [rad], unwrapped from the lowest frequency on."""
        return np.unwrap(np.angle(self.value))

    def up_to(self, frequency: float) -> "FrequencyResponse":
        """The part up to ``frequency`` [Hz]."""
        keep = self.frequency <= frequency
        return FrequencyResponse(
            self.name, self.frequency[keep], self.value[keep], self.coherence[keep], self.amplitude[keep]
        )

    def _crossing(self, values: Array, level: float) -> tuple[float, float]:
        """First frequency [Hz] at which ``values`` fall through ``level``, and the magnitude there; NaN if never."""
        below = np.flatnonzero((values[:-1] >= level) & (values[1:] < level))
        if len(below) == 0:
            return math.nan, math.nan
        k = below[0]
        share = (values[k] - level) / (values[k] - values[k + 1])
        log_f = np.log(self.frequency[k]) + share * np.log(self.frequency[k + 1] / self.frequency[k])
        decibel = self.decibel[k] + share * (self.decibel[k + 1] - self.decibel[k])
        return float(np.exp(log_f)), float(10.0 ** (decibel / 20.0))

    def phase_crossover(self) -> tuple[float, float]:
        """f_180 [Hz], where the phase falls through −180°, and the magnitude there (M_P180 of P, as a factor)."""
        return self._crossing(self.phase, -math.pi)

    def bandwidth(self) -> float:
        """Frequency [Hz] at which the magnitude has fallen by 3 dB from its value at the lowest frequency."""
        return self._crossing(self.decibel, float(self.decibel[0]) - 20.0 * math.log10(math.sqrt(2.0)))[0]

    def resonance(self) -> tuple[float, float]:
        """Frequency [Hz] of the largest magnitude, and that magnitude over the one at the lowest frequency."""
        k = int(np.argmax(np.abs(self.value)))
        return float(self.frequency[k]), float(np.abs(self.value[k]) / np.abs(self.value[0]))

    def margins(self) -> tuple[float, float, float, float]:
        """Of an open loop: gain margin (factor), its frequency [Hz], phase margin [rad], its frequency [Hz]."""
        import control

        data = control.frd(self.value, 2.0 * np.pi * self.frequency, smooth=True)
        gain, phase, _, at_gain, at_phase, _ = control.stability_margins(data)
        return (
            float(gain), float(at_gain) / (2.0 * math.pi), math.radians(float(phase)), float(at_phase) / (2.0 * math.pi)
        )  # fmt: skip

    def write_csv(self, path: Path) -> None:
        """One line a frequency, with units in the header."""
        with replaced(path) as whole, whole.open("w", newline="", encoding="utf-8") as file:
            out = csv.writer(file)
            out.writerow(["frequency_Hz", "magnitude_dB", "phase_deg", "real", "imaginary", "coherence", "amplitude"])
            rows = zip(
                self.frequency, self.decibel, np.degrees(self.phase), self.value, self.coherence, self.amplitude,
                strict=True,
            )  # fmt: skip
            for f, db, phase, value, coherence, amplitude in rows:
                numbers = (f, db, phase, value.real, value.imag, coherence, amplitude)
                out.writerow([f"{number:.9g}" for number in numbers])


def compare(one: FrequencyResponse, other: FrequencyResponse) -> tuple[float, float]:
    """Greatest difference of two responses at the same frequencies: magnitude [dB], phase [rad]."""
    ratio: Any = one.value / other.value
    return float(np.max(np.abs(20.0 * np.log10(np.abs(ratio))))), float(np.max(np.abs(np.angle(ratio))))
