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
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cls_bench.analysis.frequency import FrequencyResponse
from cls_bench.linear.bench import LinearBench
from cls_bench.linear.variation import Setup
from cls_bench.bench import Bench
from cls_bench.errors import InputError, TrippedError
from cls_bench.scenario import parse_scenario
from cls_bench.signals import PLC_S, PLC_TICKS, TICK_S, TOPIC
from cls_bench.stability.loops import BuiltIn, MakeLoop, Probe

Array = NDArray[np.float64]

LOOPS = ("velocity-loop", "position-loop", "outer-loop", "rendered-admittance")
STEPPED, MULTISINE, CHIRP = "stepped-sine", "multisine", "chirp"

SETTLE = 0.3
"""Time given to transients before a spectrum is taken [s]."""

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
        if not 0.0 < self.low < self.high < 0.4 / PLC_S:
            raise InputError(
                f"frequencies from {self.low:g} to {self.high:g} Hz: must grow, above 0 and below {0.4 / PLC_S:g} Hz"
            )
        if not self.amplitude > 0.0:
            raise InputError(f"amplitude = {self.amplitude:g}: must be positive")


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
    if hand_excited:
        return _admittance(setup, excitation, make_loop)
    signal = _stepped(excitation) if excitation.kind == STEPPED else _multisine(excitation)
    return _probed(setup, loop, signal, make_loop)


@dataclass(frozen=True)
class _Signal:
    """An excitation of the column's angle over PLC cycles, and where its spectra are taken."""

    angle: Array
    """[rad], one value a cycle"""
    windows: tuple[tuple[int, int], ...]
    """first cycle and cycle after the last of each window"""
    frequencies: tuple[Array, ...]
    """excited frequencies in each window [Hz], whole numbers of periods in it"""

    @property
    def repeated(self) -> bool:
        """Whether all windows have the same frequencies."""
        return len(self.windows) > 1 and np.array_equal(self.frequencies[0], self.frequencies[1])


def _stepped(e: Excitation) -> _Signal:
    """One frequency after the other, each with time to settle; measured over 0.12 s and 4 periods at least."""
    angle: list[Array] = [np.zeros(round(SETTLE / PLC_S))]
    windows, frequencies = [], []
    at = len(angle[0])
    settle = round(SETTLE / PLC_S)
    for wanted in np.geomspace(e.low, e.high, e.points):
        periods = max(PERIODS, round(0.12 * wanted))
        cycles = round(periods / wanted / PLC_S)
        frequency = periods / (cycles * PLC_S)
        time = np.arange(settle + cycles) * PLC_S
        fade = np.minimum(time / (0.5 * SETTLE), 1.0)
        angle.append(np.radians(e.amplitude) * fade * np.sin(2.0 * np.pi * frequency * time))
        windows.append((at + settle, at + settle + cycles))
        frequencies.append(np.array([frequency]))
        at += settle + cycles
    return _Signal(np.concatenate(angle), tuple(windows), tuple(frequencies))


def _multisine(e: Excitation) -> _Signal:
    """Sums of sines of random phase with amplitudes ∝ 1/f, about logarithmically spaced on a grid of one period.

    Each realisation is scaled to the peak amplitude, led in by a part of its own period, then measured over two of
    them: with a Hann window, lines and what is left of transients then do not spill into each other.
    """
    period = max(0.5, math.ceil(2.0 / e.low) / 2.0)
    cycles = round(period / PLC_S)
    lines = np.unique(np.round(np.geomspace(math.ceil(e.low * period - 1e-9), e.high * period, LINES)).astype(int))
    frequencies = lines / (cycles * PLC_S)
    lead = round(SETTLE / PLC_S)
    rng = np.random.default_rng(e.seed)
    time = np.arange(-lead, 2 * cycles) * PLC_S
    parts: list[Array] = [np.zeros(lead)]
    windows = []
    at = lead
    for _ in range(e.realisations):
        phases = rng.uniform(0.0, 2.0 * np.pi, len(lines))
        x = np.sin(2.0 * np.pi * np.outer(time, frequencies) + phases) @ (1.0 / frequencies)
        x *= np.radians(e.amplitude) / np.max(np.abs(x))
        fade = np.linspace(0.0, 1.0, lead // 2)  # from where the last realisation has ended
        x[: lead // 2] = fade * x[: lead // 2] + (1.0 - fade) * parts[-1][-1]
        parts.append(x)
        windows.append((at + lead, at + lead + 2 * cycles))
        at += lead + 2 * cycles
    return _Signal(np.concatenate(parts), tuple(windows), (frequencies,) * e.realisations)


def _probed(setup: Setup, loop: str, signal: _Signal, make_loop: MakeLoop | None) -> Measured:
    p = setup.parameters
    velocity_mode = p.plc.outer_loop == "velocity"
    cycles = len(signal.angle)

    def over_time(values: Array) -> Callable[[float], float]:
        return lambda time: float(values[min(round(time / PLC_S), cycles - 1)])

    if loop == "outer-loop":
        # Torque that makes the feel model move by about the wanted angle: T = I φ̈ + d φ̇ + c φ.
        feel = p.feel
        rate = np.gradient(signal.angle, PLC_S)
        torque = feel.inertia * np.gradient(rate, PLC_S) + feel.damping * rate + feel.stiffness * signal.angle
        probe = Probe((make_loop or BuiltIn)(p), torque=over_time(torque), opened=True)
        source = "torque"
    elif velocity_mode:
        probe = Probe(None, velocity=over_time(np.gradient(signal.angle, PLC_S)))
        source = "velocity"
    else:
        probe = Probe(None, angle=over_time(signal.angle), velocity=over_time(np.gradient(signal.angle, PLC_S)))
        source = "angle"
    recorded, limited = _run(setup, _holding(setup, cycles * PLC_S), probe)
    drive = {name: recorded[f"/drive.{name}"] for name in TOPIC["/drive"].names}
    half = TOPIC["/drive"].ticks
    signals: dict[str, tuple[Array, int]] = {
        "set_angle": (np.array([c.angle for c in probe.asked]), PLC_TICKS),
        "asked_velocity": (np.array([c.velocity for c in probe.asked]), PLC_TICKS),
        "measured_torque": (np.array(probe.measured), PLC_TICKS),
        "model_torque": (np.array(probe.applied), PLC_TICKS),
        "column_angle": (recorded["/column.angle"], 1),
        "column_velocity": (recorded["/column.velocity"], 1),
        "position": (drive["position"][::2], PLC_TICKS),
        "position_error": ((drive["set_position"] - drive["position"])[::2], PLC_TICKS),
        "velocity": (drive["velocity"], half),
        "set_velocity": (drive["set_velocity"], half),
        "velocity_error": (drive["set_velocity"] - drive["velocity"], half),
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
    return Measured(loop, c, o, pc, po, cycles * PLC_S, limited)


def _holding(setup: Setup, duration: float) -> str:
    """A scenario in which the hand holds the column at neutral, or does not touch it."""
    text = f'title = "frequency response"\nduration = {duration + 1e-9}\n'
    if setup.hand.squeeze is not None:
        text += "[[hand]]\nkind = \"hold\"\nat = 0.0\n" + ("angle_deg = 0.0\n" if setup.hand.arm else "force_N = 0.0\n")
        text += _squeeze(setup)
    return text


def _squeeze(setup: Setup) -> str:
    return f"[[squeeze]]\nat = 0.0\nvalue = {float(setup.hand.squeeze or 0.0)}\nover = 0.0\n"


def _run(setup: Setup, text: str, controller: Any) -> tuple[Mapping[str, Array], tuple[str, ...]]:
    """All signals by name, and what the log says of limits that were reached."""
    bench = Bench(setup.parameters, controller=controller)
    parts: dict[str, list[Array]] = {}
    limited: list[str] = []
    for block in bench.run(parse_scenario(text)):
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
    x = [_spectrum(*input_, window, f) for window, f in zip(signal.windows, signal.frequencies, strict=True)]
    y = [_spectrum(*output, window, f) for window, f in zip(signal.windows, signal.frequencies, strict=True)]
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


def _spectrum(values: Array, ticks: int, window: tuple[int, int], frequencies: Array) -> tuple[Any, float]:
    """Fourier coefficients at ``frequencies``, and the power of all that is not constant; with a Hann window."""
    per_cycle = PLC_TICKS // ticks
    start, end = window[0] * per_cycle, window[1] * per_cycle
    time = np.arange(start, end) * ticks * TICK_S
    hann = 1.0 - np.cos(2.0 * np.pi * np.arange(end - start) / (end - start))
    part = values[start:end] - np.mean(values[start:end] * hann)  # the window's mean is 1
    coefficients = np.exp(-2j * np.pi * np.outer(frequencies, time)) @ (part * hann) / len(part)
    return coefficients, float(np.sum((part * hann) ** 2) / np.sum(hann**2))


def _admittance(setup: Setup, e: Excitation, make_loop: MakeLoop | None) -> Measured:
    """Torque on the column to its velocity; the hand shakes with a force alone, its arm lets the limb's mass go."""
    from scipy import signal as sp

    if setup.hand.squeeze is None:
        raise InputError("the rendered admittance is measured through the hand, which must grip; give a squeeze")
    segments, windows, frequencies = _force_sines(e) if e.kind == STEPPED else _force_chirp(e)
    text = f'title = "rendered admittance"\nduration = {windows[-1][1] + 1e-9}\n' + segments + _squeeze(setup)
    recorded, limited = _run(setup, text, make_loop(setup.parameters) if make_loop else None)
    velocity, torque = recorded["/column.velocity"], recorded["/column.torque"]
    if e.kind == STEPPED:
        cut = [(round(a / PLC_S), round(b / PLC_S)) for a, b in windows]
        stepped = _Signal(np.zeros(0), tuple(cut), tuple(np.array([f]) for f in frequencies))
        measured = _ratio("Y", (velocity, 1), (torque, 1), stepped, 1.0)
    else:
        start, end = (round(t / TICK_S) for t in windows[0])
        # 2.5 kHz holds all that matters; segments of 0.8 s resolve 1.25 Hz.
        x, y = (sp.decimate(s[start:end], PLC_TICKS, ftype="fir") for s in (torque, velocity))
        length = round(0.8 / PLC_S)
        f, cross = sp.csd(x, y, 1.0 / PLC_S, nperseg=length)
        _, power = sp.welch(x, 1.0 / PLC_S, nperseg=length)
        _, coherence = sp.coherence(x, y, 1.0 / PLC_S, nperseg=length)
        keep = (f >= 1.1 * e.low) & (f <= 0.9 * e.high)
        amplitude = np.sqrt(2.0 * power[keep] * f[1])
        measured = FrequencyResponse("Y", f[keep], cross[keep] / power[keep], coherence[keep], amplitude)
    predicted = None
    if make_loop is None:
        from dataclasses import replace

        spectrum = LinearBench(setup.parameters, replace(setup.hand, arm=False)).lifted.spectrum(
            "hand", measured.frequency
        )
        value = spectrum["column_velocity"] / spectrum["grip_torque"]
        predicted = FrequencyResponse("Y", measured.frequency, value)
    return Measured("rendered-admittance", measured, None, predicted, None, windows[-1][1], limited)


def _force_sines(e: Excitation) -> tuple[str, list[tuple[float, float]], list[float]]:
    text, at, windows, frequencies = "", 0.0, [], []
    for wanted in np.geomspace(e.low, e.high, e.points):
        periods = max(PERIODS, round(0.12 * wanted))
        cycles = round(periods / wanted / PLC_S)
        frequency = periods / (cycles * PLC_S)
        text += (
            f'[[hand]]\nkind = "sine"\nat = {at}\namplitude_N = {e.amplitude}\nfrequency = {frequency}\nfade = 0.2\n'
        )
        settle = max(SETTLE, 1.0)
        windows.append((at + settle, at + settle + cycles * PLC_S))
        frequencies.append(frequency)
        at = round((at + settle) / PLC_S + cycles) * PLC_S
    return text, windows, frequencies


def _force_chirp(e: Excitation) -> tuple[str, list[tuple[float, float]], list[float]]:
    over = 12.0
    text = (
        f'[[hand]]\nkind = "chirp"\nat = {SETTLE}\namplitude_N = {e.amplitude}\nfrom_hz = {e.low}\nto_hz = {e.high}\n'
        f'over = {over}\nsweep = "log"\nfade = 0.2\n'
    )
    return text, [(SETTLE, SETTLE + over)], []
