"""Frequency response of the simulated plant from motor torque to column angle, against the linear model.

The linear model is :mod:`cls_bench.linear`, derived by hand from the book and from nothing of the simulation.
"""

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cls_bench.linear.hand import Hand
from cls_bench.linear.plant import MOTOR, Plant, plant, rigid
from cls_bench.linear.variation import ideal
from cls_bench.parameters import Parameters
from cls_bench.verification.rigs import rigs
from cls_bench.verification.row import Row
from cls_bench.verification.subject import Feedback, Subject

Array = NDArray[Any]

GROUP = "linearisation"
LAW = "linear model"

FREQUENCIES = (5, 10, 20, 50, 100, 150, 200, 250, 300)
"""Where gain and phase are compared [Hz]."""

TOP = 2000
"""Highest line of the excitation [Hz]; beyond the fastest mode of the thesis's train."""

LOAD, LIGHT = 10.0, 0.2
"""Constant torque on the column [N·m]. A rod that carries a load is a stiffness to a linkage which does not stand
upright; the linear model leaves it out, so the other rigs have a light one, and are shaken by as much less."""

LEAST = 3
"""Lowest line [Hz] at which the other rigs are compared: below, what the rod carries of the weights shows likewise."""


class Response(NamedTuple):
    """Column angle over motor torque [rad/(N·m)] at ``lines`` [Hz]."""

    lines: Array
    obtained: Array
    expected: Array
    model: Plant


def respond(subject: Subject, p: Parameters, load: float) -> Response:
    """Shake the plant of ``p``, made linear, and have the linear model say what comes of it.

    A multisine of 1 Hz lines shakes the motor; a soft spring and damper hold the shaft, a constant ``load`` [N·m] on
    the column keeps the meshes in contact. All of them are part of the torque that is measured, so the quotient of the
    spectra over one period, once the transients are gone, is the plant's own response.
    """
    p = ideal(p)
    specimen = subject.plant(p)
    motor = specimen.shafts[0]
    period = round(1.0 / specimen.step)
    time = np.asarray(np.arange(2 * period) * specimen.step, dtype=np.float64)
    lines = np.arange(1, TOP + 1)
    model = plant(p, Hand(squeeze=None))
    ratio, inertia = rigid(p)
    # Schroeder phases keep the peak of the sum low; growing with frequency, as the plant's gain falls.
    phases = -math.pi * lines * (lines - 1) / len(lines)
    spectrum = np.zeros(period // 2 + 1, dtype=complex)
    spectrum[lines] = 0.01 * load * inertia * (1.0 + lines / 20.0) * np.exp(1j * phases) * period / 2.0
    shake = np.tile(np.fft.irfft(spectrum, period), 2)
    build_up = np.minimum(time / 0.1, 1.0)
    acted: dict[str, Array] = {}
    record = specimen.run(
        time, {motor: shake + load / ratio * build_up, "column": -load * build_up},
        feedback={motor: Feedback(5000.0 * inertia, 100.0 * inertia)}, acted=acted,
    )  # fmt: skip
    torque, column = (np.fft.rfft(signal[period:]) for signal in (acted[motor], record.angle["column"]))
    expected = np.array([_transfer(model, float(line)) for line in lines])
    return Response(lines, column[lines] / torque[lines], expected, model)


def _transfer(model: Plant, frequency: float) -> complex:
    s = 2j * math.pi * frequency
    dynamic = model.mass * s**2 + model.damping * s + model.stiffness
    return complex(np.linalg.solve(dynamic, np.eye(model.freedoms)[MOTOR])[model.column])


def frequency_response(subject: Subject) -> Iterator[Row]:
    """Gain and phase up to 300 Hz, and the resonances."""
    found = respond(subject, Parameters(), LOAD)
    gains, phases = _deviations(found)
    for frequency in FREQUENCIES:
        at = frequency - 1
        gain, phase = 20.0 * math.log10(abs(found.expected[at])), math.degrees(np.angle(found.expected[at]))
        yield Row(GROUP, f"gain at {frequency} Hz", "dB", gain, LAW, gain + gains[at], 0.5, relative=False)
        yield Row(GROUP, f"phase at {frequency} Hz", "deg", phase, LAW, phase + phases[at], 3.0, relative=False)
    yield from _worst(found, "worst deviation in {} from 1 to 300 Hz, resonance included")
    yield from _resonances(found, "resonance {}")


def rigs_in_frequency(subject: Subject) -> Iterator[Row]:
    """The worst deviations, and the resonances, of the other rigs."""
    for name, p in rigs().items():
        if name != "thesis":
            found = respond(subject, p, LIGHT)
            yield from _worst(found, f"{name}: worst deviation in {{}} from {LEAST} to 300 Hz", LEAST)
            yield from _resonances(found, f"{name}: resonance {{}}")


def _deviations(found: Response) -> tuple[Array, Array]:
    """In gain [dB] and phase [deg], a line each."""
    quotient = found.obtained / found.expected
    return 20.0 * np.log10(np.abs(quotient)), np.degrees(np.angle(quotient))


def _worst(found: Response, said: str, least: int = 1) -> Iterator[Row]:
    within = (found.lines >= least) & (found.lines <= FREQUENCIES[-1])
    gains, phases = _deviations(found)
    for what, unit, deviations, limit in (("gain", "dB", gains, 0.5), ("phase", "deg", phases, 3.0)):
        worst = deviations[within][np.argmax(np.abs(deviations[within]))]
        yield Row(GROUP, said.format(what), unit, 0.0, LAW, float(worst), limit, relative=False)


def _resonances(found: Response, said: str) -> Iterator[Row]:
    """Of every oscillation that shows as a peak below the highest line."""
    for number, (frequency, damping) in enumerate(found.model.modes, start=1):
        near = np.abs(found.lines - frequency) < 0.1 * frequency
        if not near.any() or frequency > 0.9 * TOP or not _has_peak(found.expected[near]):
            continue
        # Above 1 kHz the step shows: 17 of them in a period of the thesis's third mode shift it by 2 %.
        limit = 0.01 if frequency < 1000.0 else 0.03
        yield Row(GROUP, f"{said.format(number)} (damping ratio {damping:.3f})", "Hz",
                  _peak(found.lines[near], found.expected[near]), LAW, _peak(found.lines[near], found.obtained[near]),
                  limit)  # fmt: skip


def _has_peak(response: Array) -> bool:
    return len(response) > 4 and 0 < int(np.argmax(np.abs(response))) < len(response) - 1


def _peak(lines: Array, response: Array) -> float:
    """Frequency [Hz] of the highest gain, by a parabola through the three highest lines."""
    gain = np.log(np.abs(response))
    k = min(max(int(np.argmax(gain)), 1), len(lines) - 2)
    low, top, high = gain[k - 1 : k + 2]
    return float(lines[k] + 0.5 * (low - high) / (low - 2.0 * top + high))
