"""Plant and sampled side together: does it oscillate, how fast does that grow, what is the loop gain.

* stability: the eigenvalues of the map from one period to the next, no approximation by continuous delays;
* the loop gain G from the feel model's torque to −T_meas, sampled as it is, for Nyquist's criterion;
* frequency responses between any two signals, each at the instants at which it is sampled or recorded
  (:meth:`~cls_bench.linear.forms.Lifted.spectrum`).
"""

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from cls_bench.linear.cycle import Compensation, period
from cls_bench.linear.forms import Array, ComplexArray, Lifted
from cls_bench.linear.hand import Hand
from cls_bench.linear.plant import Plant, plant
from cls_bench.parameters import Parameters

SLOW = 10.0
"""Where the loop's own oscillations begin [Hz]; voluntary motion and the arm on its stiffness stay below."""

DRIFT = 1e-3
"""Growth rate [1/s] below which slow motion counts as drift, not as unstable."""


@dataclass(frozen=True)
class LinearBench:
    """The bench with parameters ``p``, linear about neutral, in position or velocity architecture.

    ``closed``: whether the load cell's torque reaches the feel model; open for the loop gain. ``model``: whether there
    is a feel model at all, or set values from outside alone; without it for the inner loop.
    """

    p: Parameters
    hand: Hand = field(default_factory=Hand)
    compensation: Compensation | None = None
    closed: bool = True
    model: bool = True

    @cached_property
    def plant(self) -> Plant:
        """The continuous part."""
        return plant(self.p, self.hand)

    @cached_property
    def lifted(self) -> Lifted:
        """One period of everything."""
        return period(self.p, self.plant, self.compensation, closed=self.closed, model=self.model)

    @cached_property
    def _top(self) -> tuple[complex, complex]:
        """Growth rate + j · angular frequency of the fastest growing oscillation, and its factor over a period.

        The frequency is known only up to a multiple of one over the period.
        """
        values = self.lifted.eigenvalues
        values = values[np.abs(values) > 1e-9]
        s = np.log(values) / self.lifted.period
        counted = (np.abs(s.imag) > 2.0 * math.pi * SLOW) | (s.real > DRIFT)
        top = int(np.argmax(np.where(counted, s.real, -np.inf)))
        return complex(s[top]), complex(values[top])

    @property
    def growth_rate(self) -> float:
        """Growth rate of the fastest growing (or slowest decaying) oscillation [1/s].

        Motion slower than :data:`SLOW` is left out unless it grows: the hand's and the feel model's own, which has
        nothing to do with the loop's stability limit.
        """
        return self._top[0].real

    @cached_property
    def growth(self) -> complex:
        """:attr:`growth_rate`, and j · the angular frequency of that oscillation [1/s, rad/s]."""
        rate, factor = self._top
        return complex(rate.real, self._turn(factor) / self.lifted.period)

    def _turn(self, factor: complex) -> float:
        """Angle by which the oscillation whose ``factor`` over a period is given goes round in a period [rad].

        Followed from tick to tick at the column, so that it may be more than half a turn.
        """
        a = self.lifted.transition
        shape: Any = np.random.default_rng(0).standard_normal(len(a)).astype(complex)
        shifted = a - factor * (1.0 + 1e-8) * np.eye(len(a))
        for _ in range(3):
            shape = np.linalg.solve(shifted, shape)
            shape /= np.linalg.norm(shape)
        seen = np.array([row @ shape for _, row, _ in self.lifted.signals["column_velocity"]])
        turns = np.angle(np.append(seen[1:], factor * seen[0]) / seen)
        return abs(float(np.sum(turns)))

    @property
    def stable(self) -> bool:
        """Whether every oscillation decays."""
        return self.growth_rate < 0.0

    def open_loop(self) -> tuple[Array, Array, Array, Array]:
        """G(z) from the feel model's torque to −T_meas as (A, B, C, D) over a period, all PLC cycles of it at once."""
        opened = LinearBench(self.p, self.hand, self.compensation, closed=False).lifted
        a, b, c, d = opened.between("torque", "measured_torque")
        return a, b, -c, -d

    def encirclements(self) -> int:
        """How often G goes round −1, clockwise: unstable poles that closing the loop adds (Nyquist's criterion).

        With several PLC cycles in a period it is det(1 + G) round 0. What grows more slowly than :data:`DRIFT` is not
        counted: an integrator stands on the circle itself.
        """
        return -winding(*self.open_loop(), radius=math.exp(DRIFT * self.lifted.period))


def winding(a: Array, b: Array, c: Array, d: Array, *, radius: float = 1.0, largest: float = 0.5) -> int:
    """How often det(1 + G(z)), G = C (z − A)⁻¹ B + D, goes round 0 while z goes round the circle of ``radius``.

    Points are added until det turns by no more than ``largest`` [rad] from one to the next.
    """
    eye, one = np.eye(len(a)), np.eye(len(d))

    def value(angle: Array) -> ComplexArray:
        z = radius * np.exp(1j * angle)[:, None, None]
        inner = np.linalg.solve(z * eye - a, np.broadcast_to(b, (len(angle), *b.shape)))
        return np.asarray(np.linalg.det(one + c @ inner + d))

    # The upper half: the lower mirrors it. Slow poles lie close to z = 1.
    angle = np.concatenate([[0.0], np.geomspace(1e-7, 0.02, 200), np.linspace(0.02, math.pi, 500)[1:]])
    found = value(angle)
    for _ in range(30):
        turns = np.angle(found[1:] / found[:-1])
        wide = np.flatnonzero(np.abs(turns) > largest)
        if len(wide) == 0:
            break
        between = 0.5 * (angle[wide] + angle[wide + 1])
        order = np.argsort(np.concatenate([angle, between]), kind="stable")
        angle = np.concatenate([angle, between])[order]
        found = np.concatenate([found, value(between)])[order]
    return round(2.0 * float(np.sum(np.angle(found[1:] / found[:-1]))) / (2.0 * math.pi))
