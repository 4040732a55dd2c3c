"""Frequency response of the running simulation: excite, record, compare spectra.

Four loops can be measured:

``velocity-loop``
    the drive's velocity controller: set to actual velocity (closed), actual velocity over error (open)
``position-loop``
    the whole inner loop P(jω): set to actual column angle (closed); in the drive, position over error (open). In the
    velocity architecture of the outer loop: set to actual column velocity
``outer-loop``
    the loop gain G(jω) = M F P: feel model's torque to −T_meas, with the loop cut between load cell and feel model, so
    that it can be measured beyond the onset too (open)
``rendered-admittance``
    what the pilot feels: torque on the column to its velocity, everything closed

The first three are excited through a :class:`~cls_bench.stability.loops.Probe` in the place of the outer loop, the
last one by the force of the hand. The bench is not linear, so each response belongs to an amplitude, and the coherence
says how much of the output the linear relation explains.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cls_bench.analysis.frequency import FrequencyResponse
from cls_bench.analysis.quasi_static import balanced
from cls_bench.bench import Bench
from cls_bench.errors import InputError, TrippedError
from cls_bench.feel_laws import AFT, Laws
from cls_bench.linear.bench import LinearBench
from cls_bench.linear.hand import Hand
from cls_bench.linear.prediction import HIGHEST
from cls_bench.linear.variation import Setup
from cls_bench.parameters import Feel
from cls_bench.pilot import chirp, constant, faded, sine
from cls_bench.signals import Clock
from cls_bench.stability import driving
from cls_bench.stability.driving import Part, Script
from cls_bench.stability.loops import BuiltIn, MakeLoop, Probe

Array = NDArray[np.float64]

LOOPS = ("velocity-loop", "position-loop", "outer-loop", "rendered-admittance")
STEPPED, MULTISINE, CHIRP = "stepped-sine", "multisine", "chirp"

SETTLE, LONGEST_SETTLE = 0.3, 4.0
"""Time given to transients before a spectrum is taken [s]; the longest where the feel model's own last longer."""

LEFT = 1e-3
"""What is to be left of them."""

LINES = 50
"""Frequencies asked of a multisine; fewer remain where its grid is coarser than their spacing."""

PERIODS = 4
"""Fewest periods of a stepped sine in its window."""


@dataclass(frozen=True)
class Excitation:
    """How a loop is excited.

    ``amplitude`` is the peak of the column's set angle [deg]; for the rendered admittance of the hand's force [N].
    """

    kind: str = MULTISINE
    amplitude: float = 1.0
    low: float = 4.0
    """lowest frequency [Hz]"""
    high: float = 250.0
    """highest frequency [Hz]"""
    points: int = 24
    """frequencies of a stepped sine"""
    realisations: int = 4
    """multisines with different phases, from which the coherence comes"""
    seed: int = 0

    def __post_init__(self) -> None:
        if not self.amplitude > 0.0:
            raise InputError(f"amplitude = {self.amplitude:g}: must be positive")

    def check(self, clock: Clock) -> None:
        """Raise InputError unless a PLC of this ``clock`` can excite it."""
        highest = HIGHEST / clock.plc_s
        if not 0.0 < self.low < self.high < highest:
            raise InputError(
                f"frequencies from {self.low:g} to {self.high:g} Hz: must grow, above 0 and below {highest:g} Hz"
            )


@dataclass(frozen=True)
class Measured:
    """What was measured of a loop, and the linear model's answer at the same frequencies."""

    loop: str
    closed: FrequencyResponse | None
    open: FrequencyResponse | None
    predicted_closed: FrequencyResponse | None
    predicted_open: FrequencyResponse | None
    simulated: float
    """length of the run [s]"""
    limited: tuple[str, ...] = ()
    """limits that were reached meanwhile: the response is that of a loop at its limit"""


def measure(
    setup: Setup, loop: str, excitation: Excitation | None = None, *, make_loop: MakeLoop | None = None
) -> Measured:
    """Measure ``loop`` of ``setup``; ``make_loop`` replaces the built-in outer loop by the user's own.

    Raises InputError for an unknown loop or excitation, TrippedError if the bench trips while it is excited.
    """
    excitation = excitation or Excitation()
    if loop not in LOOPS:
        raise InputError(f'loop "{loop}": must be {", ".join(LOOPS)}')
    hand_excited = loop == "rendered-admittance"
    kinds = (STEPPED, CHIRP) if hand_excited else (STEPPED, MULTISINE)
    if excitation.kind not in kinds:
        raise InputError(f'excitation "{excitation.kind}" of the {loop}: must be {" or ".join(kinds)}')
    clock = setup.parameters.rates.clock
    excitation.check(clock)
    if hand_excited:
        return _admittance(setup, excitation, make_loop)
    settle = _settle(setup) if loop == "outer-loop" and make_loop is None else SETTLE
    signal = (_stepped if excitation.kind == STEPPED else _multisine)(excitation, _Grid.of(clock), settle)
    return _probed(setup, loop, signal, make_loop)


def _settle(setup: Setup) -> float:
    """Time in which a feel model's linkage has swung out, with the loop cut [s]."""
    rate = -LinearBench(setup.parameters, setup.hand, closed=False).growth_rate
    return max(SETTLE, min(-math.log(LEFT) / rate, LONGEST_SETTLE)) if rate > 0.0 else SETTLE


@dataclass(frozen=True)
class _Grid:
    """The period after which everything sampled falls together again, of which windows have whole numbers."""

    clock: Clock
    ticks: int

    @classmethod
    def of(cls, clock: Clock) -> "_Grid":
        return cls(clock, math.lcm(clock.plc_ticks, clock.position_ticks, clock.velocity_ticks))

    @property
    def period(self) -> float:
        """[s]"""
        return self.ticks * self.clock.tick_s

    def time(self, first: int, end: int) -> Array:
        """Times of the PLC cycles in periods ``first`` to ``end`` [s]."""
        cycles = self.ticks // self.clock.plc_ticks
        return np.arange(first * cycles, end * cycles, dtype=np.float64) * self.clock.plc_s


@dataclass(frozen=True)
class _Signal:
    """An excitation of the column's angle over PLC cycles, and where its spectra are taken."""

    grid: _Grid
    angle: Array
    """[rad], one value a PLC cycle"""
    windows: tuple[tuple[int, int], ...]
    """first period of the grid and the one after the last of each window"""
    frequencies: tuple[Array, ...]
    """excited frequencies in each window [Hz], whole numbers of periods in it"""

    @property
    def repeated(self) -> bool:
        """Whether all windows have the same frequencies."""
        return len(self.windows) > 1 and np.array_equal(self.frequencies[0], self.frequencies[1])


def _stepped(e: Excitation, grid: _Grid, settle_s: float) -> _Signal:
    """One frequency after the other, each with time to settle; measured over 0.12 s and 4 periods at least."""
    settle = round(settle_s / grid.period)
    angle: list[Array] = [np.zeros(len(grid.time(0, settle)))]
    windows, frequencies = [], []
    at = settle
    for wanted in np.geomspace(e.low, e.high, e.points):
        whole = max(PERIODS, round(0.12 * wanted))
        count = round(whole / wanted / grid.period)
        frequency = whole / (count * grid.period)
        time = grid.time(0, settle + count)
        fade = np.minimum(time / (0.5 * settle_s), 1.0)
        angle.append(np.radians(e.amplitude) * fade * np.sin(2.0 * np.pi * frequency * time))
        windows.append((at + settle, at + settle + count))
        frequencies.append(np.array([frequency]))
        at += settle + count
    return _Signal(grid, np.concatenate(angle), tuple(windows), tuple(frequencies))


def _multisine(e: Excitation, grid: _Grid, settle_s: float) -> _Signal:
    """Sums of sines of random phase with amplitudes ∝ 1/f, about logarithmically spaced on a grid of one period.

    Each realisation is scaled to the peak amplitude, led in by a part of its own period, then measured over two of
    them: with a Hann window, lines and what is left of transients then do not spill into each other.
    """
    period = max(0.5, math.ceil(2.0 / e.low) / 2.0)
    count = round(period / grid.period)
    lines = np.unique(np.round(np.geomspace(math.ceil(e.low * period - 1e-9), e.high * period, LINES)).astype(int))
    frequencies = lines / (count * grid.period)
    lead = round(settle_s / grid.period)
    rng = np.random.default_rng(e.seed)
    time = grid.time(-lead, 2 * count)
    led_in = len(grid.time(0, lead)) // 2
    parts: list[Array] = [np.zeros(len(grid.time(0, lead)))]
    windows = []
    at = lead
    for _ in range(e.realisations):
        phases = rng.uniform(0.0, 2.0 * np.pi, len(lines))
        x = np.sin(2.0 * np.pi * np.outer(time, frequencies) + phases) @ (1.0 / frequencies)
        x *= np.radians(e.amplitude) / np.max(np.abs(x))
        fade = np.linspace(0.0, 1.0, led_in)  # from where the last realisation has ended
        x[:led_in] = fade * x[:led_in] + (1.0 - fade) * parts[-1][-1]
        parts.append(x)
        windows.append((at + lead, at + lead + 2 * count))
        at += lead + 2 * count
    return _Signal(grid, np.concatenate(parts), tuple(windows), (frequencies,) * e.realisations)


def _probed(setup: Setup, loop: str, signal: _Signal, make_loop: MakeLoop | None) -> Measured:
    p, clock = setup.parameters, signal.grid.clock
    velocity_mode = p.plc.outer_loop == "velocity"
    cycles, plc_s = len(signal.angle), clock.plc_s

    def over_time(values: Array) -> Callable[[float], float]:
        return lambda time: float(values[min(round(time / plc_s), cycles - 1)])

    rate = np.gradient(signal.angle, plc_s)
    if loop == "outer-loop":
        torque = _torque_for(p.feel, signal.angle, plc_s)
        probe = Probe((make_loop or BuiltIn)(p.for_control), torque=over_time(torque), opened=True)
        source = "torque"
    elif velocity_mode:
        probe = Probe(None, velocity=over_time(rate))
        source = "velocity"
    else:
        probe = Probe(None, angle=over_time(signal.angle), velocity=over_time(rate))
        source = "angle"
    recorded, limited = _run(setup, _holding(setup.hand, cycles * plc_s), probe)

    def drive(name: str, ticks: int) -> Array:
        """Rows of the drive at ``ticks`` of its controllers."""
        return recorded[f"/drive.{name}"][:: ticks // clock.drive_ticks]

    at_plc, at_position, at_velocity = clock.plc_ticks, clock.position_ticks, clock.velocity_ticks
    position, velocity = drive("position", at_position), drive("velocity", at_velocity)
    set_velocity = drive("set_velocity", at_velocity)
    signals: dict[str, tuple[Array, int]] = {
        "set_angle": (np.array([c.angle for c in probe.asked]), at_plc),
        "asked_velocity": (np.array([c.velocity for c in probe.asked]), at_plc),
        "measured_torque": (np.array(probe.measured), at_plc),
        "model_torque": (np.array(probe.applied), at_plc),
        "column_angle": (recorded["/column.angle"], 1),
        "column_velocity": (recorded["/column.velocity"], 1),
        "position": (position, at_position),
        "position_error": (drive("set_position", at_position) - position, at_position),
        "velocity": (velocity, at_velocity),
        "set_velocity": (set_velocity, at_velocity),
        "velocity_error": (set_velocity - velocity, at_velocity),
    }
    pairs: dict[str, tuple[tuple[str, str, float] | None, tuple[str, str, float] | None]] = {
        "velocity-loop": (("velocity", "set_velocity", 1.0), ("velocity", "velocity_error", 1.0)),
        "position-loop": (("column_angle", "set_angle", 1.0), ("position", "position_error", 1.0)),
        "outer-loop": (None, ("measured_torque", "model_torque", -1.0)),
    }
    closed, opened = pairs[loop]
    if velocity_mode and loop == "position-loop":
        closed, opened = ("column_velocity", "asked_velocity", 1.0), None
    linear = None
    if make_loop is None:
        linear = LinearBench(p, setup.hand, closed=False, model=loop == "outer-loop").lifted

    def response(pair: tuple[str, str, float] | None, name: str) -> tuple[Any, Any]:
        if pair is None:
            return None, None
        output, input_, sign = pair
        measured = _ratio(name, signals[output], signals[input_], signal, sign)
        if linear is None:
            return measured, None
        spectrum = linear.spectrum(source, measured.frequency)
        below = 1.0 if input_ == "asked_velocity" else spectrum[input_]
        return measured, FrequencyResponse(name, measured.frequency, sign * spectrum[output] / below)

    names = {"velocity-loop": ("T_v", "L_v"), "position-loop": ("P", "L_p"), "outer-loop": ("", "G")}[loop]
    (c, pc), (o, po) = response(closed, names[0]), response(opened, names[1])
    return Measured(loop, c, o, pc, po, cycles * plc_s, limited)


def _torque_for(feel: Feel, angle: Array, cycle: float) -> Array:
    """Torque that makes the feel model's column move by about ``angle``: T = I φ̈ + d φ̇ + c φ, and the linkage's."""
    from scipy.signal import StateSpace, lsim

    laws = Laws(feel)
    at = laws.slopes(feel.neutral, balanced(laws, feel.neutral) if laws.two else feel.neutral)
    rate = np.gradient(angle, cycle)
    torque = feel.inertia * np.gradient(rate, cycle) + at.column_damping * rate + at.column * angle
    if at.link == 0.0:
        return torque
    aft = np.zeros_like(angle)
    aft_rate = np.zeros_like(angle)
    if not laws.jammed[AFT]:
        a = np.array([[0.0, 1.0], [-(at.aft + at.link), -(at.aft_damping + at.link_damping)]])
        b = np.array([[0.0, 0.0], [at.link, at.link_damping]])
        a[1], b[1] = a[1] / feel.aft.inertia, b[1] / feel.aft.inertia
        model = StateSpace(a, b, np.eye(2), np.zeros((2, 2)))
        _, moved, _ = lsim(model, np.stack([angle, rate], axis=1), cycle * np.arange(len(angle)))
        aft, aft_rate = moved[:, 0], moved[:, 1]
    return np.asarray(torque + at.link * (angle - aft) + at.link_damping * (rate - aft_rate))


def _holding(hand: Hand, duration: float) -> Script:
    """The hand holds the column at neutral, or does not touch it."""
    return Script(hand, duration, [] if hand.squeeze is None else [Part(0.0, constant(0.0))])


def _run(setup: Setup, script: Script, controller: Any) -> tuple[Mapping[str, Array], tuple[str, ...]]:
    """All signals by name, and what the log says of limits that were reached."""
    bench = Bench(setup.parameters, controller=controller, poses=False)
    parts: dict[str, list[Array]] = {}
    limited: list[str] = []
    for block in driving.run(bench, script):
        for trip in bench.trips:
            raise TrippedError(f"{trip.message} at {trip.time:.2f} s, while measuring; choose a smaller amplitude")
        limited += [f"t = {e.time:.2f} s: {e.source}: {e.message}" for e in block.events if e.level == "warning"]
        for topic, _ in block:
            for name in topic.names:
                parts.setdefault(f"{topic.path}.{name}", []).append(block[f"{topic.path}.{name}"])
    return {signal: np.concatenate(rows) for signal, rows in parts.items()}, tuple(limited)


def _ratio(
    name: str, output: tuple[Array, int], input_: tuple[Array, int], signal: _Signal, sign: float
) -> FrequencyResponse:
    """Output over input at the excited frequencies, with coherence and the input's amplitude."""
    x, y = (
        [_spectrum(*of, signal.grid, *each) for each in zip(signal.windows, signal.frequencies, strict=True)]
        for of in (input_, output)
    )
    if signal.repeated:
        xs, ys = np.array([a for a, _ in x]), np.array([a for a, _ in y])
        cross, power = np.sum(ys * xs.conj(), axis=0), np.sum(np.abs(xs) ** 2, axis=0)
        coherence = np.abs(cross) ** 2 / (power * np.sum(np.abs(ys) ** 2, axis=0))
        amplitude = 2.0 * np.sqrt(power / len(xs))
        return FrequencyResponse(name, signal.frequencies[0], sign * cross / power, coherence, amplitude)
    xs, ys = np.array([a[0] for a, _ in x]), np.array([a[0] for a, _ in y])
    coherence = np.array([2.0 * abs(a[0]) ** 2 / power for a, power in y])
    frequencies = np.concatenate(signal.frequencies)
    return FrequencyResponse(name, frequencies, sign * ys / xs, np.minimum(coherence, 1.0), 2.0 * np.abs(xs))


def _spectrum(
    values: Array, ticks: int, grid: _Grid, window: tuple[int, int], frequencies: Array
) -> tuple[Any, float]:
    """Fourier coefficients at ``frequencies``, and the power of all that is not constant; with a Hann window."""
    in_period = grid.ticks // ticks
    start, end = window[0] * in_period, window[1] * in_period
    time = np.arange(start, end) * ticks * grid.clock.tick_s
    hann = 1.0 - np.cos(2.0 * np.pi * np.arange(end - start) / (end - start))
    part = values[start:end] - np.mean(values[start:end] * hann)  # the window's mean is 1
    coefficients = np.exp(-2j * np.pi * np.outer(frequencies, time)) @ (part * hann) / len(part)
    return coefficients, float(np.sum((part * hann) ** 2) / np.sum(hann**2))


def _admittance(setup: Setup, e: Excitation, make_loop: MakeLoop | None) -> Measured:
    """Torque on the column to its velocity; the hand shakes with a force alone, its arm lets the limb's mass go."""
    from scipy import signal as sp

    if setup.hand.squeeze is None:
        raise InputError("the rendered admittance is measured through the hand, which must grip; give a squeeze")
    hand = replace(setup.hand, arm=False)
    grid = _Grid.of(setup.parameters.rates.clock)
    script, windows, frequencies = (_force_sines if e.kind == STEPPED else _force_chirp)(e, hand, grid)
    recorded, limited = _run(setup, script, make_loop(setup.parameters.for_control) if make_loop else None)
    velocity, torque = recorded["/column.velocity"], recorded["/column.torque"]
    if e.kind == STEPPED:
        stepped = _Signal(grid, np.zeros(0), tuple(windows), tuple(np.array([f]) for f in frequencies))
        measured = _ratio("Y", (velocity, 1), (torque, 1), stepped, 1.0)
    else:
        start, end = (at * grid.ticks for at in windows[0])
        # The PLC's rate holds all that matters; segments of 0.8 s resolve 1.25 Hz.
        plc_s = grid.clock.plc_s
        x, y = (sp.decimate(s[start:end], grid.clock.plc_ticks, ftype="fir") for s in (torque, velocity))
        length = round(0.8 / plc_s)
        f, cross = sp.csd(x, y, 1.0 / plc_s, nperseg=length)
        _, power = sp.welch(x, 1.0 / plc_s, nperseg=length)
        _, coherence = sp.coherence(x, y, 1.0 / plc_s, nperseg=length)
        keep = (f >= 1.1 * e.low) & (f <= 0.9 * e.high)
        amplitude = np.sqrt(2.0 * power[keep] * f[1])
        measured = FrequencyResponse("Y", f[keep], cross[keep] / power[keep], coherence[keep], amplitude)
    predicted = None
    if make_loop is None:
        spectrum = LinearBench(setup.parameters, hand).lifted.spectrum("hand", measured.frequency)
        value = spectrum["column_velocity"] / spectrum["grip_torque"]
        predicted = FrequencyResponse("Y", measured.frequency, value)
    return Measured("rendered-admittance", measured, None, predicted, None, script.duration, limited)


_Shaken = tuple[Script, list[tuple[int, int]], list[float]]
"""What the hand does, windows in periods of the grid, and the frequency in each [Hz]."""


def _force_sines(e: Excitation, hand: Hand, grid: _Grid) -> _Shaken:
    parts: list[Part] = []
    windows, frequencies = [], []
    at, settle = 0, round(max(SETTLE, 1.0) / grid.period)
    before = constant(0.0)
    for wanted in np.geomspace(e.low, e.high, e.points):
        whole = max(PERIODS, round(0.12 * wanted))
        count = round(whole / wanted / grid.period)
        frequency = whole / (count * grid.period)
        start = at * grid.period
        reached = float(before(np.array([start - parts[-1].at if parts else 0.0]))[0][0])
        before = faded(sine(e.amplitude, frequency, 0.0, 0.0), reached, 0.2)
        parts.append(Part(start, before))
        windows.append((at + settle, at + settle + count))
        frequencies.append(frequency)
        at += settle + count
    return Script(hand, at * grid.period, parts), windows, frequencies


def _force_chirp(e: Excitation, hand: Hand, grid: _Grid) -> _Shaken:
    over = 12.0
    first, last = round(SETTLE / grid.period), round((SETTLE + over) / grid.period)
    sweep = faded(chirp(e.amplitude, e.low, e.high, over, 0.0, log=True), 0.0, 0.2)
    parts = [Part(0.0, constant(0.0)), Part(first * grid.period, sweep)]
    return Script(hand, last * grid.period, parts), [(first, last)], []
