"""Signals as linear forms, and the exact map of one period of a sampled system that they lead to.

Everything that is sampled repeats after one period, the least common multiple of all cycles. A period is worked through
tick by tick with every signal as a *linear form*: a row of coefficients over (state at the start of the period, inputs
in it). What comes out is the exact map of one period to the next.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]


@dataclass(frozen=True)
class Lifted:
    """One period of the bench: x⁺ = A x + Σ B_k u_k, and signals y_j = C_j x + Σ D_jk u_k at their ticks."""

    transition: Array
    inputs: Mapping[str, Sequence[tuple[int, Array]]]
    """per input: (tick, column B_k)"""
    signals: Mapping[str, Sequence[tuple[int, Array, Mapping[str, Array]]]]
    """per signal: (tick, row C_j, per input the D_jk in the order of :attr:`inputs`)"""
    tick: float
    """length of a tick [s]"""
    ticks: int
    """length of the period in ticks"""

    @property
    def period(self) -> float:
        """Length of the period [s]."""
        return self.tick * self.ticks

    @cached_property
    def eigenvalues(self) -> ComplexArray:
        """Of the map from one period to the next."""
        return np.asarray(np.linalg.eigvals(self.transition), dtype=complex)

    def spectrum(self, source: str, frequencies: Any) -> dict[str, ComplexArray]:
        """Amplitude and phase of every signal for the input ``source`` = e^{jωt} at ``frequencies`` [Hz].

        Each as the discrete Fourier transform of the recorded signal would give it, at its own sampling rate.
        """
        omega = 2.0 * np.pi * np.atleast_1d(np.asarray(frequencies, dtype=float))
        result = {name: np.zeros(len(omega), dtype=complex) for name in self.signals}
        identity = np.eye(len(self.transition))
        for at, w in enumerate(omega):
            held = [np.exp(1j * w * tick * self.tick) for tick, _ in self.inputs[source]]
            drive = sum(h * b for h, (_, b) in zip(held, self.inputs[source], strict=True))
            x = np.linalg.solve(np.exp(1j * w * self.period) * identity - self.transition, drive)
            for name, samples in self.signals.items():
                for tick, c, d in samples:
                    value = c @ x + np.dot(d[source], held)
                    result[name][at] += value * np.exp(-1j * w * tick * self.tick) / len(samples)
        return result

    def between(self, source: str, signal: str) -> tuple[Array, Array, Array, Array]:
        """(A, B, C, D) from all samples of ``source`` in a period to all of ``signal``."""
        b = np.stack([column for _, column in self.inputs[source]], axis=1)
        c = np.stack([row for _, row, _ in self.signals[signal]])
        d = np.stack([direct[source] for _, _, direct in self.signals[signal]])
        return self.transition, b, c, d


class Forms:
    """Signals as rows of coefficients over (states at the start of the period, inputs during it)."""

    def __init__(self, states: Sequence[str], inputs: Sequence[tuple[str, int]]):
        self.size = len(states) + len(inputs)
        self.states = list(states)
        self.inputs = list(inputs)
        unit = np.eye(self.size)
        self.value: dict[str, Array] = {name: unit[k] for k, name in enumerate(states)}
        """present row of every state, by name"""
        self.source = {key: unit[len(states) + k] for k, key in enumerate(inputs)}
        """row of every input, by name and tick"""
        self._recorded: dict[str, list[tuple[int, Array]]] = {}

    def zero(self) -> Array:
        """A signal that is nothing."""
        return np.zeros(self.size, dtype=np.float64)

    def record(self, tick: int, **signals: Array) -> None:
        """Keep the ``signals`` as samples of this tick."""
        for name, row in signals.items():
            self._recorded.setdefault(name, []).append((tick, row.copy()))

    def shift(self, name: str, delay: int, newest: Array) -> Array:
        """Put ``newest`` into the delay line ``name``; returns what comes out, ``delay`` steps old.

        The line is the states ``name-1`` … ``name-delay``, see :func:`delayed`.
        """
        if delay == 0:
            return newest
        value = self.value
        oldest = value[f"{name}-{delay}"]
        for k in range(delay, 1, -1):
            value[f"{name}-{k}"] = value[f"{name}-{k - 1}"]
        value[f"{name}-1"] = newest
        return oldest

    def lifted(self, tick: float, ticks: int) -> Lifted:
        """The map over a period of ``ticks`` of length ``tick`` [s], from what the states have become."""
        n = len(self.states)
        end = np.array([self.value[name] for name in self.states])
        names = dict.fromkeys(name for name, _ in self.inputs)
        places = {name: [n + k for k, (other, _) in enumerate(self.inputs) if other == name] for name in names}
        return Lifted(
            end[:, :n],
            {
                name: [(at, end[:, n + k]) for k, (other, at) in enumerate(self.inputs) if other == name]
                for name in names
            },
            {
                name: [(at, row[:n], {i: row[places[i]] for i in names}) for at, row in rows]
                for name, rows in self._recorded.items()
            },
            tick,
            ticks,
        )


def delayed(names: Sequence[str], delay: int) -> list[str]:
    """The states of delay lines of ``delay`` steps."""
    return [f"{name}-{k}" for name in names for k in range(1, delay + 1)]
