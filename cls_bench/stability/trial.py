"""One trial: does the bench, disturbed once, calm down? Decided by the growth rate of the recorded oscillation.

The standard trial has the hand on the column from the start, at the squeeze in question. Either it holds still, or it
moves the column from −10° to 10° at a constant rate (one that pushes with a force alone sways it): in motion the
gearbox slides all the time, so its friction does not hold an oscillation back as it does at rest (the pilot of thesis
4.4 pulls the column and then squeezes). Then a short torque pulse strikes the feel model, at the column's side where
it has two bodies, and from then on the oscillation of the column is fitted in windows of 0.12 s
(:mod:`cls_bench.analysis.growth`).

The run ends as soon as the windows agree: four in a row with growth rates that agree, or a safety trip. Where friction
or backlash make the growth rate depend on amplitude they may never agree; then the trend of the amplitude over the
second half of the trial decides, and a sustained oscillation (a limit cycle) counts as unstable.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cls_bench.analysis.growth import Mode, modes
from cls_bench.bench import Bench, DivergedError
from cls_bench.control.outer_loop import OuterLoop
from cls_bench.drivers.timed import Change
from cls_bench.errors import InputError
from cls_bench.linear.bench import SLOW
from cls_bench.linear.variation import Setup
from cls_bench.pilot import constant, ramp, sine
from cls_bench.signals import Block, Clock
from cls_bench.stability import driving
from cls_bench.stability.driving import Part, Script
from cls_bench.stability.loops import MakeLoop, Probe

PERIOD = 0.8e-3
"""About the sampling period of the motion that is fitted [s]: a whole number of ticks, averaged."""

WINDOW, HOP = 150, 50
"""Samples in a window of the fit (0.12 s: five periods at 40 Hz), and from one window to the next."""

BAND = (SLOW, 300.0)
"""Frequencies of the loop's oscillation [Hz]; slower ones where :attr:`Standard.slowest` asks for them."""

PUSH, PUSH_FREQUENCY = 8.0, 0.5
"""Force [N] of a hand that pushes with a force alone, and how often it goes to and fro [Hz]."""

_MOTION_AT = 0.32
"""When a moving hand starts on its way [s]."""

SETTLE = 0.03
"""Time after the pulse before the first window [s]: what else the pulse excites has died away."""

SUSTAINED = -1.0
"""Trend [1/s] above which an undecided oscillation counts as sustained: less than e-fold over a trial's second half."""

CLEAR = 0.15
"""Growth rate [1/s] below which agreeing windows do not decide: a limit cycle, or a fraction of a per cent from the
onset."""

KEPT, GONE = 0.3, 0.02
"""Amplitude, as a share of the swing that the pulse gives the feel model, above which an undecided oscillation may
count as sustained, and below which it is gone: what is left is vibration of the gears or noise. Above 1 it feeds
itself, however irregular it is."""


SWING = 310
"""Samples over which a swing slower than :data:`BAND` is looked for (0.25 s: two periods and a half at 10 Hz)."""

MOST_TRAVEL = 0.5
"""Share of the column's travel that the hand moves over; where that is less than asked for it moves more slowly."""


@dataclass(frozen=True)
class Standard:
    """How a trial is made."""

    pulse: float = 35.0
    """angular acceleration that the pulse gives the feel model [rad/s²]: its torque is I_fcs times that"""
    pulse_time: float = 0.01
    """its length [s]"""
    rate_deg: float = 20.0
    """rate at which the hand moves the column [deg/s]; 0 holds still. At 20 the teeth of the first stage pass at 35 Hz,
    and neither they nor their harmonics shake the loop where it tends to oscillate"""
    travel_deg: float = 10.0
    """where the motion begins and ends, to either side [deg]"""
    time: float = 1.0
    """longest observation after the pulse [s]"""
    seed: int = 0
    slowest: float = SLOW
    """slowest oscillation that is fitted [Hz]: where it is less than 10, windows and observation are as much longer"""

    @property
    def stretch(self) -> float:
        """How much longer windows are than those for 10 Hz."""
        return SLOW / self.slowest

    @property
    def pulse_at(self) -> float:
        """When the pulse comes [s]: once the hand is in its place, or on its way."""
        return 0.05 if self.rate_deg == 0 else 0.45

    @property
    def duration(self) -> float:
        """Longest run [s]: a moving hand is watched as long as it moves."""
        longest = self.pulse_at + self.pulse_time + SETTLE + self.time * self.stretch
        return longest if self.rate_deg == 0 else min(longest, _MOTION_AT + 2.0 * self.travel_deg / self.rate_deg)

    def __post_init__(self) -> None:
        needed = self.pulse_at + self.pulse_time + SETTLE + (WINDOW + 4 * HOP) * PERIOD * self.stretch
        if not self.duration > needed:
            raise InputError(
                f"a trial at {self.rate_deg:g} deg/s over ±{self.travel_deg:g}° ends too early to see "
                f"{self.slowest:g} Hz; move slower, or hold still with a rate of 0"
            )


STILL = Standard(pulse=5.0, rate_deg=0.0)
"""The trial for a bench without friction and backlash, whose growth rate is the same at any amplitude."""


@dataclass(frozen=True)
class Verdict:
    """What a trial showed."""

    stable: bool
    growth: float
    """growth rate on which the verdict rests [1/s]; NaN where there was too little of an oscillation to fit"""
    frequency: float
    """of the oscillation [Hz]"""
    amplitude_deg: float
    """amplitude of the column's oscillation at the end of the run [deg]"""
    simulated: float
    """length of the run [s]"""
    reason: str
    """``decays``, ``grows``, ``sustained``, ``dies out``, ``trip`` or ``diverged``"""


def script(setup: Setup, standard: Standard, *, pulse: bool = True) -> Script:
    """The trial: what the hand does, and the pulse on the feel model."""
    hand = setup.hand
    parts = []
    if hand.squeeze is not None and not hand.arm:
        parts.append(Part(0.0, sine(PUSH if standard.rate_deg > 0 else 0.0, PUSH_FREQUENCY, 0.0, 0.0)))
    elif hand.squeeze is not None:
        parts.append(Part(0.0, constant(0.0)))
        if standard.rate_deg > 0:
            over = 2.0 * standard.travel_deg / standard.rate_deg
            end = min(math.radians(standard.travel_deg), MOST_TRAVEL * setup.parameters.column.travel)
            parts.append(Part(0.001, ramp(0.0, -end, 0.3, smooth=True)))
            parts.append(Part(_MOTION_AT, ramp(-end, end, over)))
    changes = []
    if pulse:
        before, torque = setup.parameters.feel.down_spring.torque, standard.pulse * setup.parameters.feel.inertia
        start, end = standard.pulse_at, standard.pulse_at + standard.pulse_time
        changes = [Change(start, _pushed(before + torque)), Change(end, _pushed(before))]
    return Script(hand, standard.duration, parts, changes)


def _pushed(torque: float) -> Callable[[Bench], None]:
    """A constant torque on the feel model's body at the column, which is where a down-spring acts."""

    def make(bench: Bench) -> None:
        feel = bench.parameters.feel
        feel = feel.model_copy(update={"down_spring": feel.down_spring.model_copy(update={"torque": torque})})
        bench.change(bench.parameters.model_copy(update={"feel": feel}))

    return make


def run(
    setup: Setup, standard: Standard | None = None, *, make_loop: MakeLoop | None = None, follow: bool = False
) -> Verdict:
    """Make one trial of ``setup``.

    ``make_loop`` replaces the built-in outer loop by one of the user's own. ``follow``: run to the end even when
    decided, so that amplitude and frequency of a limit cycle are those it settles at.
    """
    standard = standard or Standard()
    loop: OuterLoop | None = None
    if make_loop is not None:
        loop = Probe(make_loop(setup.parameters.for_control), torque=_pulse(standard, setup.parameters.feel.inertia))
    bench = Bench(setup.parameters, seed=standard.seed, controller=loop, poses=False)
    watch = _Watch(standard, bench.clock)
    decided = None
    try:
        for block in driving.run(bench, script(setup, standard, pulse=loop is None)):
            if any(event.source == "safety" for event in block.events):
                return watch.verdict(False, "trip")
            watch.add(block)
            decided = decided or watch.decision()
            if decided is not None and not follow:
                return watch.verdict(*decided)
    except DivergedError:
        return watch.verdict(False, "diverged")
    return watch.verdict(*(decided or watch.last_decision()))


def _pulse(standard: Standard, inertia: float) -> Callable[[float], float]:
    start, end, torque = standard.pulse_at, standard.pulse_at + standard.pulse_time, standard.pulse * inertia
    return lambda time: torque if start <= time < end else 0.0


def _rest_of_parabola(values: NDArray[np.float64]) -> float:
    """Half the way from the least to the greatest of ``values``, once a parabola over them is taken away."""
    x = np.linspace(-1.0, 1.0, len(values))
    return 0.5 * float(np.ptp(values - np.polynomial.Polynomial.fit(x, values, 2)(x)))


@dataclass(frozen=True)
class _Fit:
    time: float
    mode: Mode


def _slope(fits: list[_Fit]) -> float:
    """Growth rate of the amplitude from fit to fit [1/s]; NaN for fewer than two."""
    if len(fits) < 2:
        return math.nan
    return float(np.polyfit([fit.time for fit in fits], [math.log(fit.mode.amplitude) for fit in fits], 1)[0])


class _Watch:
    """Collects the column's motion and fits it window by window."""

    def __init__(self, standard: Standard, clock: Clock):
        self._standard = standard
        self._ticks = max(1, round(PERIOD * standard.stretch / clock.tick_s))
        self._period = self._ticks * clock.tick_s
        self._first = round((standard.pulse_at + standard.pulse_time + SETTLE) / self._period)
        self._velocity: NDArray[np.float64] = np.zeros(0)
        self._rest: NDArray[np.float64] = np.zeros(0)
        self._fits: list[_Fit] = []

    def add(self, block: Block) -> None:
        ticks = np.concatenate([self._rest, block["/column.velocity"]])
        whole = len(ticks) // self._ticks * self._ticks
        self._rest = ticks[whole:]
        self._velocity = np.concatenate([self._velocity, ticks[:whole].reshape(-1, self._ticks).mean(axis=1)])
        # The acceleration lifts the oscillation out of the slow motion.
        acceleration = np.diff(self._velocity) / self._period
        while (start := self._first + HOP * len(self._fits)) + WINDOW <= len(acceleration):
            found = [
                mode for mode in modes(acceleration[start : start + WINDOW], self._period)
                if BAND[0] < mode.frequency * self._standard.stretch < BAND[1]
            ]  # fmt: skip
            # Of several the one with the largest speed: not the fast hum of the gears, not a slow remainder.
            mode = max(found, key=lambda m: m.amplitude / m.frequency, default=Mode(-math.inf, math.nan, 0.0, 0.0))
            angle = mode.amplitude / (2.0 * math.pi * mode.frequency) ** 2 if found else 0.0
            self._fits.append(_Fit((start + WINDOW / 2) * self._period, replace(mode, amplitude=angle)))

    def decision(self) -> tuple[bool, str] | None:
        """(stable, reason) once the last four windows agree, or the oscillation is gone."""
        if len(self._fits) < 4:
            return None
        last = [fit.mode for fit in self._fits[-4:]]
        rates = np.array([mode.growth for mode in last])
        if not np.all(np.isfinite(rates)):
            return True, "dies out"
        frequencies = np.array([mode.frequency for mode in last])
        mean, spread = float(rates.mean()), float(np.ptp(rates))
        clear = min(mode.share for mode in last) > 0.7 and np.ptp(frequencies) < 0.05 * frequencies.mean()
        if clear and abs(mean) > CLEAR and spread < 0.3 * abs(mean):
            if mean > 0:
                return False, "grows"
            if self._kept(self._fits[-1]) < 1.0:  # a limit cycle larger than the pulse may breathe
                return True, "decays"
        if all(self._kept(fit) < GONE for fit in self._fits[-4:]) and not self.swings():
            return True, "dies out"
        return None

    def swings(self) -> bool:
        """Whether a swing goes on that is slower than the fits see: as a drive makes at the end of its torque.

        What a slow intended motion leaves after a parabola was taken away, in the last :data:`SWING` samples against
        the first after the pulse.
        """
        after = self._velocity[self._first :]
        if len(after) < SWING:
            return False
        speed = self._standard.pulse * self._standard.pulse_time
        early, late = _rest_of_parabola(after[:SWING]), _rest_of_parabola(after[-SWING:])
        return late > KEPT * speed and late > 0.8 * early

    def last_decision(self) -> tuple[bool, str]:
        """(stable, reason) at the end of the time, from the trend over the second half."""
        last = self._fits[-4:]
        kept = max(self._kept(fit) for fit in last[-2:])
        frequencies = [fit.mode.frequency for fit in last]
        steady = max(frequencies) < 1.2 * min(frequencies)  # noise shows another one in each window
        if kept > 1.0 or (kept > KEPT and steady and self.trend() > SUSTAINED) or self.swings():
            return False, "sustained"
        return True, "dies out"

    def trend(self) -> float:
        """Growth rate of the amplitude over the second half of the fits [1/s]."""
        return _slope([fit for fit in self._fits[len(self._fits) // 2 :] if fit.mode.amplitude > 0])

    def _kept(self, fit: _Fit) -> float:
        """Amplitude over the one with which the feel model alone would swing after the pulse at that frequency."""
        if fit.mode.amplitude == 0.0:
            return 0.0
        speed = self._standard.pulse * self._standard.pulse_time
        return fit.mode.amplitude * 2.0 * math.pi * fit.mode.frequency / speed

    def verdict(self, stable: bool, reason: str) -> Verdict:
        simulated = len(self._velocity) * self._period
        if not self._fits:
            return Verdict(stable, math.nan, math.nan, math.nan, simulated, reason)
        last = self._fits[-1].mode
        rates = [fit.mode.growth for fit in self._fits[-4:]]
        growth = float(np.mean(rates)) if reason in ("decays", "grows") else self.trend()
        if reason == "dies out":  # while there was something to see
            seen = [fit for fit in self._fits if self._kept(fit) > KEPT]
            growth = _slope(seen)
        return Verdict(stable, growth, last.frequency, math.degrees(last.amplitude), simulated, reason)
