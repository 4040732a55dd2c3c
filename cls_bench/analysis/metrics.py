"""Metrics: what a scenario's checks measure over a time window, each a function of recorded signals alone."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cls_bench.analysis import free_response
from cls_bench.analysis.window import Window, split_signal, unit_of
from cls_bench.errors import InputError
from cls_bench.parameters import DEG
from cls_bench.scenario import Check
from cls_bench.signals import PLC_S, TOPIC

Array = NDArray[np.float64]

LONGEST_LAG = 0.05
"""Largest lag that is looked for [s]."""


class Argument(NamedTuple):
    """A number that a metric takes from ``[checks.arguments]``."""

    default: float | None
    """None: must be given"""
    unit: str
    meaning: str


@dataclass(frozen=True)
class Metric:
    """A named measure."""

    name: str
    unit: str
    """empty: that of the signal"""
    meaning: str
    function: Callable[..., float]
    """takes the window, the signal's samples if :attr:`of_signal`, and the arguments by name"""
    arguments: Mapping[str, Argument]
    of_signal: bool = False
    """whether the check names the signal to measure"""


METRICS: dict[str, Metric] = {}
"""All metrics by name."""


def _metric(
    unit: str, *, of_signal: bool = False, **arguments: Argument
) -> Callable[[Callable[..., float]], Callable[..., float]]:
    def add(function: Callable[..., float]) -> Callable[..., float]:
        name = function.__name__
        meaning = (function.__doc__ or "").strip().splitlines()[0].rstrip(".")
        METRICS[name] = Metric(name, unit, meaning, function, arguments, of_signal)
        return function

    return add


def validate(check: Check) -> None:
    """Raise InputError ``key: problem`` unless ``check`` names a metric and what it needs."""
    if check.metric not in METRICS:
        raise InputError(f'metric: "{check.metric}" is unknown; valid: {", ".join(METRICS)}')
    metric = METRICS[check.metric]
    if metric.of_signal and check.signal is None:
        raise InputError(f"signal: missing; {metric.name} needs one, such as /column.torque")
    if not metric.of_signal and check.signal is not None:
        raise InputError(f"signal: {metric.name} takes none")
    if check.signal is not None:
        try:
            split_signal(check.signal)
        except InputError as error:
            raise InputError(f"signal: {error}") from None
    for name in check.arguments:
        if name not in metric.arguments:
            valid = ", ".join(metric.arguments) or "none"
            raise InputError(f"arguments.{name}: {metric.name} takes no such argument; valid: {valid}")
    for name, argument in metric.arguments.items():
        if argument.default is None and name not in check.arguments:
            raise InputError(f"arguments.{name}: missing; {argument.meaning} [{argument.unit}]")


def unit(check: Check) -> str:
    """Unit of the check's metric."""
    return METRICS[check.metric].unit or unit_of(check.signal or "")


def evaluate(check: Check, window: Window) -> float:
    """Value of the check's metric; NaN if it cannot be measured, see :func:`measured`."""
    return measured(check, window)[0]


def measured(check: Check, window: Window) -> tuple[float, str]:
    """Value of the check's metric, and if it is NaN, why: the run ended before, or samples that it needs are lost."""
    metric = METRICS[check.metric]
    if window.rows < MIN_SAMPLES:
        return math.nan, f"the window holds fewer than {MIN_SAMPLES} samples"
    watched = window.watched()
    arguments = {name: check.arguments.get(name, argument.default) for name, argument in metric.arguments.items()}
    try:
        with np.errstate(all="ignore"):
            signals = [watched[check.signal or ""]] if metric.of_signal else []
            value = float(metric.function(watched, *signals, **arguments))
    except (ValueError, ArithmeticError, IndexError, np.linalg.LinAlgError, InputError) as error:
        value, reason = math.nan, str(error)
    else:
        reason = "these samples do not show it"
    if watched.flaws:
        return math.nan, watched.flaws[0]
    return value, reason if math.isnan(value) else ""


MIN_SAMPLES = 64
"""Fewest samples a window must hold (26 ms)."""


# --- statistics of any signal ----------------------------------------------------------------------------------------


@_metric("", of_signal=True)
def minimum(window: Window, signal: Array) -> float:
    """Least value of the signal."""
    return float(np.min(signal))


@_metric("", of_signal=True)
def maximum(window: Window, signal: Array) -> float:
    """Greatest value of the signal."""
    return float(np.max(signal))


@_metric("", of_signal=True)
def mean(window: Window, signal: Array) -> float:
    """Mean of the signal."""
    return float(np.mean(signal))


@_metric("", of_signal=True)
def rms(window: Window, signal: Array) -> float:
    """Root mean square of the signal."""
    return float(np.sqrt(np.mean(signal**2)))


@_metric("", of_signal=True)
def peak_to_peak(window: Window, signal: Array) -> float:
    """Greatest less least value of the signal."""
    return float(np.ptp(signal))


_ABOVE = Argument(1.0, "Hz", "slower motion is left out")


@_metric("", of_signal=True, above_hz=_ABOVE)
def ripple(window: Window, signal: Array, above_hz: float) -> float:
    """Root mean square of the signal's content above a frequency."""
    return float(np.std(_above(signal, above_hz, window)))


# --- friction --------------------------------------------------------------------------------------------------------


@_metric(
    "N·m",
    threshold_deg=Argument(0.5, "deg", "how far the column must have moved to count as moving"),
    below_hz=Argument(30.0, "Hz", "faster changes are left out, as by a force gauge: blows within the backlash"),
)
def breakout_torque(window: Window, threshold_deg: float, below_hz: float) -> float:
    """Largest torque at the load cell before the column moves, from the window's start."""
    angle = window["/column.angle"]
    moved = np.flatnonzero(np.abs(angle - angle[0]) > threshold_deg * DEG)
    until = int(moved[0]) + 1 if len(moved) else len(angle)
    from scipy.signal import butter, sosfiltfilt  # takes longer to import than a short run to simulate

    sos = butter(2, below_hz, fs=window.rate, output="sos")
    torque = sosfiltfilt(sos, window["/load_cell.torque"])[:until]
    return float(np.max(np.abs(torque)))


@_metric("N·m", at_deg=Argument(0.0, "deg", "column angle at which the loop's width is taken"))
def hysteresis(window: Window, at_deg: float) -> float:
    """Half the width of the torque-displacement loop at the load cell: the static friction."""
    angle, torque = window["/column.angle"] - at_deg * DEG, window["/load_cell.torque"]
    up = np.flatnonzero((angle[:-1] < 0) & (angle[1:] >= 0))
    down = np.flatnonzero((angle[:-1] > 0) & (angle[1:] <= 0))
    if not len(up) or not len(down):
        return math.nan
    around = int(0.01 * window.rate)  # the mean over 20 ms about a crossing

    def level(crossings: NDArray[np.intp]) -> float:
        return float(np.mean([np.mean(torque[max(k - around, 0) : k + around]) for k in crossings]))

    return 0.5 * (level(up) - level(down))


# --- tracking of the feel model --------------------------------------------------------------------------------------


def _error(window: Window) -> Array:
    return window["/column.angle"] - window["/feel.angle"]


@_metric("deg")
def tracking_error_rms_deg(window: Window) -> float:
    """Root mean square of the column's angle less the feel model's."""
    return float(np.sqrt(np.mean(_error(window) ** 2))) / DEG


@_metric("deg")
def tracking_error_max_deg(window: Window) -> float:
    """Largest difference between the column's angle and the feel model's."""
    return float(np.max(np.abs(_error(window)))) / DEG


@_metric("deg", above_hz=_ABOVE)
def tracking_ripple_deg(window: Window, above_hz: float) -> float:
    """Root mean square of the tracking error's content above a frequency: what the gearbox lets through."""
    return float(np.std(_above(_error(window), above_hz, window))) / DEG


def _lagged_error(window: Window, lag: float) -> Array:
    """Column against the feel model of ``lag`` [s] ago, where there was one."""
    time, model = window.time, window["/feel.angle"]
    first = math.ceil(LONGEST_LAG * window.rate)
    return window["/column.angle"][first:] - np.interp(time[first:] - lag, time, model)


def _lag(window: Window) -> float:
    from scipy.optimize import minimize_scalar

    best = minimize_scalar(
        lambda lag: float(np.mean(_lagged_error(window, lag) ** 2)),
        bounds=(0.0, LONGEST_LAG), method="bounded", options={"xatol": 1e-5},
    )  # fmt: skip
    return float(best.x)


@_metric("ms")
def tracking_lag_ms(window: Window) -> float:
    """Delay of the column behind the feel model: the one that leaves the least error."""
    return 1e3 * _lag(window)


@_metric("deg")
def aligned_error_rms_deg(window: Window) -> float:
    """Root mean square of the tracking error once the lag is taken out."""
    return float(np.sqrt(np.mean(_lagged_error(window, _lag(window)) ** 2))) / DEG


_FREQUENCY = Argument(None, "Hz", "frequency of the motion")


def _phasor(window: Window, signal: str, frequency: float) -> complex:
    """Least-squares amplitude and phase of a signal at ``frequency``."""
    angle = 2.0 * math.pi * frequency * window.time
    basis = np.stack([np.cos(angle), np.sin(angle), np.ones_like(angle)], axis=1)
    c, s, _ = np.linalg.lstsq(basis, window[signal], rcond=None)[0]
    return complex(c, -s)


def _response(window: Window, frequency: float) -> complex:
    """Phasor of the column over that of the feel model; NaN where the model stands still."""
    model = _phasor(window, "/feel.angle", frequency)
    return _phasor(window, "/column.angle", frequency) / model if model else complex(math.nan, math.nan)


@_metric("1", frequency=_FREQUENCY)
def tracking_amplitude_ratio(window: Window, frequency: float) -> float:
    """Amplitude of the column over that of the feel model, at a frequency."""
    return abs(_response(window, frequency))


@_metric("ms", frequency=_FREQUENCY)
def tracking_phase_lag_ms(window: Window, frequency: float) -> float:
    """Phase lag of the column behind the feel model as a time, at a frequency."""
    return -1e3 * float(np.angle(_response(window, frequency))) / (2.0 * math.pi * frequency)


# --- oscillation -----------------------------------------------------------------------------------------------------


def _above(x: Array, frequency: float, window: Window) -> Array:
    """High pass without phase; a window of a few periods at least is needed to be exact."""
    from scipy.signal import butter, sosfiltfilt

    sos = butter(4, frequency, "highpass", fs=window.rate, output="sos")
    return np.asarray(sosfiltfilt(sos, x, padlen=min(len(x) - 1, int(2.0 * window.rate / frequency))))


_SHAKE = Argument(15.0, "Hz", "slower motion is left out; voluntary motion stays under 10 Hz")


@_metric("deg", above_hz=_SHAKE)
def oscillation_amplitude_deg(window: Window, above_hz: float) -> float:
    """Amplitude of a sine with the power of the column's motion above a frequency."""
    return math.sqrt(2.0) * float(np.std(_above(window["/column.angle"], above_hz, window))) / DEG


@_metric("Hz", above_hz=_SHAKE)
def oscillation_frequency_hz(window: Window, above_hz: float) -> float:
    """Frequency with the greatest amplitude in the column's motion above a frequency."""
    x = window["/column.angle"]
    spectrum = np.abs(np.fft.rfft((x - np.mean(x)) * np.hanning(len(x))))
    frequencies = np.fft.rfftfreq(len(x), PLC_S)
    return float(frequencies[np.argmax(np.where(frequencies >= above_hz, spectrum, 0.0))])


# --- free response ---------------------------------------------------------------------------------------------------


@_metric("1")
def part60_tolerance_used(window: Window) -> float:
    """Largest deviation from the expected free response over its Part 60 tolerance; up to 1 is within all of them.

    The window starts at the release. Expected is :func:`free_response.expected_response`.
    """
    angle = window["/column.angle"]
    times = window.time - window.time[0]
    expected = free_response.expected_response(window.parameters, float(angle[0]), times)
    return max(item.share for item in free_response.part60(times, angle, expected))


@_metric("deg")
def rest_offset_deg(window: Window) -> float:
    """Distance of the column from the feel model's neutral at the window's end (mean of 0.1 s)."""
    last = window["/column.angle"][-int(0.1 * window.rate) :]
    return abs(float(np.mean(last)) - window.parameters.feel.neutral) / DEG


# --- limits ----------------------------------------------------------------------------------------------------------


def _share(limit: str, meaning: str) -> None:
    def share(window: Window) -> float:
        return float(np.mean(window[f"/limits.{limit}"]))

    share.__name__ = f"{limit}_limited_share"
    share.__doc__ = f"Share of the window in which {meaning}."
    _metric("1")(share)


for _signal in TOPIC["/limits"].signals:
    _share(_signal.name, _signal.meaning)
