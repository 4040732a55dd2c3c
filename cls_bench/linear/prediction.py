"""Prediction of the outer loop's stability from the linear model, and the thesis's rule beside it (thesis 3.6.2).

With the loop cut at the feel model's input the loop gain is G = M F P: F the feel model, P the closed inner loop from
set to actual column angle, M what column and limb demand of the load cell. The thesis's rule, Eq. 3.16, puts
M F ≈ I_fwd / I_fcs and asks for I_fwd / I_fcs · |P| < 1 at the phase crossover of P. It leaves out that a limb held
tight also slows P down, that the load cell's signal is late, that damping and grip turn the phase of M and F.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import brentq

from cls_bench.analysis.frequency import FrequencyResponse
from cls_bench.linear.bench import SLOW, LinearBench
from cls_bench.linear.cycle import Compensation
from cls_bench.linear.hand import Hand, forward_inertia
from cls_bench.linear.variation import Setup, Variation
from cls_bench.parameters import Parameters

HIGHEST = 0.4
"""Highest frequency that is looked at, over the rate of the PLC: beyond all crossovers, below what aliases."""


@dataclass(frozen=True)
class Rule:
    """The thesis's criterion, Eq. 3.16: 20 log(I_fwd / I_fcs) + M_P180 < 0."""

    crossover: float
    """f_180, where the phase of P passes −180° [Hz]; NaN if it does not below :data:`HIGHEST`"""
    magnitude: float
    """|P| there, M_P180 as a factor"""
    ratio: float
    """I_fwd / I_fcs of the setup"""

    @property
    def critical_ratio(self) -> float:
        """I_fwd / I_fcs at which the rule sees the onset."""
        return 1.0 / self.magnitude

    @property
    def stable(self) -> bool:
        """What the rule says of the setup."""
        return self.ratio < self.critical_ratio


@dataclass(frozen=True)
class Prediction:
    """What the linear model says of a setup."""

    stable: bool
    growth: float
    """growth rate of the least damped oscillation of the loop [1/s]"""
    frequency: float
    """its frequency [Hz]"""
    gain_margin: float
    """factor on the loop gain to the onset; inf if there is none"""
    phase_margin: float
    """[rad]; inf if the loop gain never passes 1"""
    phase_crossover: float
    """frequency of the gain margin [Hz]"""
    gain_crossover: float
    """frequency of the phase margin [Hz]"""
    encirclements: int
    """of −1 by G, clockwise: by Nyquist's criterion the unstable poles of the closed loop, less those of G itself (none
    but with a pilot's torque fed forward too late)"""
    rule: Rule


def inner_loop(p: Parameters, hand: Hand, frequencies: Any) -> FrequencyResponse:
    """P(jω): set column angle (in the velocity architecture its velocity) to the column's, outer loop open."""
    velocity = p.plc.outer_loop == "velocity"
    source, signal = ("velocity", "column_velocity") if velocity else ("angle", "column_angle")
    spectrum = LinearBench(p, hand, closed=False, model=False).lifted.spectrum(source, frequencies)
    return FrequencyResponse("P", frequencies, spectrum[signal])


def rule(setup: Setup) -> Rule:
    """Eq. 3.16 for ``setup``, with P of the bare column as its tuning has left it."""
    p = setup.parameters
    response = inner_loop(p, Hand(None), np.geomspace(1.0, HIGHEST / p.rates.plc_cycle, 400))
    crossover, magnitude = response.phase_crossover()
    return Rule(crossover, magnitude, forward_inertia(p, setup.hand) / p.feel.inertia)


def predict(setup: Setup, compensation: Compensation | None = None) -> Prediction:
    """Verdict, margins and the rule for ``setup``."""
    bench = LinearBench(setup.parameters, setup.hand, compensation)
    gain_margin, phase_crossover, phase_margin, gain_crossover = loop_gain(
        setup, np.geomspace(SLOW, HIGHEST / setup.parameters.rates.plc_cycle, 600), compensation
    ).margins()
    growth = bench.growth
    return Prediction(
        bench.stable, growth.real, growth.imag / (2.0 * math.pi), gain_margin, phase_margin, phase_crossover,
        gain_crossover, bench.encirclements(), rule(setup),
    )  # fmt: skip


def loop_gain(setup: Setup, frequencies: Any, compensation: Compensation | None = None) -> FrequencyResponse:
    """G(jω) of the outer loop, cut at the feel model's input; −1 is the critical point."""
    bench = LinearBench(setup.parameters, setup.hand, compensation, closed=False)
    spectrum = bench.lifted.spectrum("torque", frequencies)
    return FrequencyResponse("G", frequencies, -spectrum["measured_torque"] / spectrum["model_torque"])


def growth_rate(setup: Setup, compensation: Compensation | None = None) -> float:
    """Growth rate of the least damped oscillation [1/s]."""
    return LinearBench(setup.parameters, setup.hand, compensation).growth_rate


def critical(
    setup: Setup, vary: Variation, compensation: Compensation | None = None, *, points: int = 60
) -> float | None:
    """Value of ``vary`` at which the loop's stability changes, coming from the stable side; None if it does not.

    The range is scanned at ``points`` (whole numbers: all of them), so a stable island is not jumped over unless it
    is narrower than that. Of several changes the one next to the lowest growth rate counts. For whole numbers: the
    first value past the change.
    """
    if vary.whole:
        values = np.arange(math.ceil(vary.low), math.floor(vary.high) + 1, dtype=float)
    elif vary.low > 0:
        values = np.geomspace(vary.low, vary.high, points)
    else:
        values = np.linspace(vary.low, vary.high, points)

    def growth(value: float) -> float:
        return growth_rate(vary.apply(setup, float(value)), compensation)

    rates = np.array([growth(value) for value in values])
    changes = np.flatnonzero((rates[:-1] < 0) != (rates[1:] < 0))
    if len(changes) == 0:
        return None
    calm = int(np.argmin(rates))
    at = int(changes[np.argmin(np.abs(changes + 0.5 - calm))])
    if vary.whole:
        return float(values[at + 1] if rates[at] < 0 else values[at])
    return float(brentq(growth, values[at], values[at + 1], rtol=1e-4))
