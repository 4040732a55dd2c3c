"""Metrics: what a scenario's checks measure over a time window, each a function of recorded signals alone."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cls_bench import signals
from cls_bench.analysis import free_response
from cls_bench.analysis.window import Window, on_axis, split_signal, unit_of
from cls_bench.errors import InputError
from cls_bench.input.faults import nearest, shown
from cls_bench.parameters import DEG
from cls_bench.scenario import Check
from cls_bench.text import escaped

Array = NDArray[np.float64]

LONGEST_LAG = 0.05
"""Largest lag that is looked for [s]."""


class Argument(NamedTuple):
    """A number that a metric takes from ``[checks.arguments]``."""

    default: float | None
    """None: must be given"""
    unit: str
    meaning: str
    least: float
    greatest: float


class Unmeasured(InputError):  # noqa: N818  (a finding, not a fault of the program)
    """A metric has no value in a window; says why."""


class Measured(NamedTuple):
    """What a metric found."""

    value: float
    """NaN if it could not be measured"""
    note: str = ""
    """why it could not"""


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
    signals: tuple[str, ...] = ()
    """all that the function may look up in the window"""
    of_signal: bool = False
    """whether the check names the signal to measure"""


METRICS: dict[str, Metric] = {}
"""All metrics by name."""


def _metric(
    unit: str, *, signals: tuple[str, ...] = (), of_signal: bool = False, **arguments: Argument
) -> Callable[[Callable[..., float]], Callable[..., float]]:
    def add(function: Callable[..., float]) -> Callable[..., float]:
        name = function.__name__
        meaning = (function.__doc__ or "").strip().splitlines()[0].rstrip(".")
        METRICS[name] = Metric(name, unit, meaning, function, arguments, signals, of_signal)
        return function

    return add


def validate(check: Check) -> None:
    """Raise InputError ``key: problem`` unless ``check`` names a metric and what it needs."""
    if check.metric not in METRICS:
        raise InputError(f"metric: {shown(check.metric)} is unknown; {nearest(check.metric, METRICS)}")
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
            raise InputError(f"arguments.{escaped(name)}: {metric.name} takes no such argument; valid: {valid}")
    for name, argument in metric.arguments.items():
        if argument.default is None and name not in check.arguments:
            raise InputError(f"arguments.{name}: missing; {argument.meaning} [{argument.unit}]")
        if name in check.arguments and not argument.least <= check.arguments[name] <= argument.greatest:
            raise InputError(
                f"arguments.{name}: {check.arguments[name]:g} is not valid; give a number ≥ {argument.least:g} and "
                f"≤ {argument.greatest:g} [{argument.unit}] ({argument.meaning})"
            )


def unit(check: Check) -> str:
    """Unit of the check's metric."""
    return METRICS[check.metric].unit or unit_of(check.signal or "")


def axis_of(check: Check) -> str:
    """Name of the axis that the check is about, as it says or as its signal does; empty if there is but one."""
    return str(getattr(check, "axis", "")) or signals.axis_of(check.signal or "")


def signals_of(check: Check) -> frozenset[str]:
    """All signals that the check may read: those of its metric, and the one that it names, on the check's axis."""
    names = {*METRICS[check.metric].signals, *([check.signal] if check.signal else [])}
    return frozenset(on_axis(name, axis_of(check)) for name in names)


def evaluate(check: Check, window: Window) -> Measured:
    """Value of the check's metric, or why it has none: the run ended before, samples are lost or not finite, …"""
    metric = METRICS[check.metric]
    if window.rows < MIN_SAMPLES:
        needed = f"{MIN_SAMPLES} are needed ({MIN_SAMPLES * window.period:g} s)"
        return Measured(math.nan, f"the window holds {window.rows} samples; {needed}")
    arguments = {name: check.arguments.get(name, argument.default) for name, argument in metric.arguments.items()}
    sound = _Sound(window)
    try:
        with np.errstate(all="ignore"):
            signal = (sound[check.signal or ""],) if metric.of_signal else ()
            value = float(metric.function(sound, *signal, **arguments))
    except (Unmeasured, InputError, ValueError, ArithmeticError, IndexError, np.linalg.LinAlgError) as reason:
        return Measured(math.nan, str(reason))
    return Measured(value) if math.isfinite(value) else Measured(math.nan, "the samples give no finite value")


class _Sound(Window):
    """A window that hands out signals without a flaw only."""

    def __init__(self, window: Window):
        self.__dict__.update(window.__dict__)  # shares what was read
        self.flaws = []

    def __getitem__(self, signal: str) -> Array:
        samples = super().__getitem__(signal)
        if self.flaws:
            raise Unmeasured(self.flaws[-1])
        return samples


MIN_SAMPLES = 64
"""Fewest samples a window must hold (26 ms at 2.5 kHz)."""


def _rows(window: Window, time: float) -> int:
    """Samples in ``time`` [s], one at least."""
    return max(round(time * window.rate), 1)


def _periods(window: Window, frequency: float, periods: float) -> None:
    """Unmeasured unless the window holds some periods of ``frequency`` [Hz], which its samples can tell: a filter or
    fit needs them.
    """
    if frequency >= 0.5 * window.rate:
        raise Unmeasured(f"{frequency:g} Hz cannot be told from {window.rate:g} samples a second")
    length = window.rows * window.period
    if length * frequency < periods:
        raise Unmeasured(f"a window of {length:g} s holds fewer than {periods:g} periods of {frequency:g} Hz")


_LEADING = ("/drive.voltage", "/drive.current")
"""What :func:`_leading` reads."""


def _leading(window: Window) -> None:
    """Unmeasured unless the column was made to follow the feel model in the whole window."""
    if window.idle:
        raise Unmeasured(f"the column does not follow the feel model: {window.idle}")
    still = (window["/drive.voltage"] == 0.0) & (window["/drive.current"] == 0.0)
    if not np.all(still) and (first := _first_run(still, _rows(window, OFF_S))) is not None:
        raise Unmeasured(f"the column does not follow the feel model: the drive is off from {window.time[first]:.3f} s")


OFF_S = 0.02
"""Time without voltage and current that tells a drive that is switched off [s]."""


def _first_run(mask: NDArray[np.bool_], length: int) -> int | None:
    """Where the first ``length`` true values in a row begin."""
    counts = np.concatenate([[0], np.cumsum(mask)])
    begins = np.flatnonzero(counts[length:] - counts[:-length] == length)
    return int(begins[0]) if len(begins) else None


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


_ABOVE = Argument(1.0, "Hz", "slower motion is left out", 0.05, 1000.0)


@_metric("", of_signal=True, above_hz=_ABOVE)
def ripple(window: Window, signal: Array, above_hz: float) -> float:
    """Root mean square of the signal's content above a frequency."""
    return float(np.std(_above(signal, above_hz, window)))


# --- friction --------------------------------------------------------------------------------------------------------

_AT = Argument(0.0, "deg", "column angle at which the loop's width is taken", -60.0, 60.0)

AT_REST = 1.0 * DEG
"""Speed [rad/s] under which the column counts as resting."""


_THRESHOLD = Argument(0.5, "deg", "how far the column must have moved to count as moving", 0.001, 60.0)
_GAUGE = Argument(
    30.0, "Hz", "faster changes are left out, as by a force gauge: blows within the backlash", 0.5, 1000.0
)


@_metric("N·m", signals=("/column.angle", "/load_cell.torque"), threshold_deg=_THRESHOLD, below_hz=_GAUGE)
def breakout_torque(window: Window, threshold_deg: float, below_hz: float) -> float:
    """Largest torque at the load cell before the column moves, from the window's start."""
    return _breakout(window, "/load_cell.torque", threshold_deg, below_hz)


def _breakout(window: Window, signal: str, threshold_deg: float, below_hz: float) -> float:
    """Largest magnitude of a torque [N·m] before the column has moved by a threshold."""
    angle = window["/column.angle"]
    _periods(window, below_hz, 2.0)
    first = angle[: _rows(window, 0.02)]
    if abs(first[-1] - first[0]) > 0.02 * AT_REST:
        raise Unmeasured("the column moves already when the window starts")
    moved = np.flatnonzero(np.abs(angle - angle[0]) > threshold_deg * DEG)
    if not len(moved):
        most = float(np.max(np.abs(angle - angle[0]))) / DEG
        raise Unmeasured(f"the column does not break out: it moves by {most:.3g} of {threshold_deg:g} deg")
    from scipy.signal import sosfiltfilt  # takes longer to import than a short run to simulate

    sos = _filter(2, below_hz, "lowpass", window.rate)
    torque = sosfiltfilt(sos, window[signal])[: int(moved[0]) + 1]
    return float(np.max(np.abs(torque)))


@_metric("N·m", signals=("/column.angle", "/load_cell.torque"), at_deg=_AT)
def hysteresis(window: Window, at_deg: float) -> float:
    """Half the width of the torque-displacement loop at the load cell: friction and viscosity behind it together."""
    angle, torque = window["/column.angle"] - at_deg * DEG, window["/load_cell.torque"]
    up = np.flatnonzero((angle[:-1] < 0) & (angle[1:] >= 0))
    down = np.flatnonzero((angle[:-1] > 0) & (angle[1:] <= 0))
    if not len(up) or not len(down):
        raise Unmeasured(f"the column does not pass {at_deg:g} deg both ways")
    around = _rows(window, 0.01)  # the mean over 20 ms about a crossing

    def level(crossings: NDArray[np.intp]) -> float:
        return float(np.mean([np.mean(torque[max(k - around, 0) : k + around]) for k in crossings]))

    return 0.5 * (level(up) - level(down))


class _Passage(NamedTuple):
    """The column passing an angle without stopping."""

    velocity: float
    """[rad/s]"""
    torque: float
    """at the grip [N·m]"""


BAND = 0.5 * DEG
"""Half width of the band about an angle over which a passage is averaged [rad]."""

SPEEDS = 1.5
"""Least ratio of speeds at which friction and damping can be told from each other."""


def _passages(window: Window, at: float) -> list[_Passage]:
    angle, velocity, torque = window["/column.angle"], window["/column.velocity"], window["/column.torque"]
    side = np.where(angle < at - BAND, -1, np.where(angle > at + BAND, 1, 0))
    outside = np.flatnonzero(side)
    found = []
    for k in np.flatnonzero(np.diff(side[outside])):
        first, last = int(outside[k]), int(outside[k + 1])
        way = float(side[last])
        if np.mean(velocity[first:last] * way > 0.0) > 0.8:  # it did not stop within
            speed = (angle[last] - angle[first]) / ((last - first) * window.period)
            found.append(_Passage(float(speed), float(np.mean(torque[first:last]))))
    return found


@_metric("N·m", signals=("/column.angle", "/column.velocity", "/column.torque"), at_deg=_AT)
def static_friction(window: Window, at_deg: float) -> float:
    """Dry friction at the grip: half the width of the torque-displacement loop there, less its viscous part.

    Each passage of the angle gives a torque T = s + F sign ω + d ω with the springs' s, the friction F and the damping
    d. From passages at one speed both ways F and d cannot be told from each other: then d is that of feel model and
    bearing. Where the speeds differ by half or more, d is fitted too. The inertia's torque is left out: it is the same
    both ways where the speeds are, and small in a slow sweep.
    """
    passages = _passages(window, at_deg * DEG)
    velocity = np.array([p.velocity for p in passages])
    torque = np.array([p.torque for p in passages])
    if not (np.any(velocity > 0.0) and np.any(velocity < 0.0)):
        raise Unmeasured(f"the column does not pass {at_deg:g} deg both ways without stopping")
    ways = (velocity[velocity > 0.0], -velocity[velocity < 0.0])
    columns = [np.ones_like(velocity), np.sign(velocity)]
    if any(np.max(way) >= SPEEDS * np.min(way) for way in ways):
        columns.append(velocity)
    elif why := window.idle or _own_damping(window) or _moving(window, "feel.", "column."):
        raise Unmeasured(f"friction and viscosity cannot be told apart at one speed: {why}")
    else:
        torque = torque - free_response.damping(window.parameters, at_deg * DEG) * velocity
    return float(np.linalg.lstsq(np.stack(columns, axis=1), torque, rcond=None)[0][1])


def _own_damping(window: Window) -> str:
    return "the damping of a user's own outer loop is not known" if window.own_loop else ""


def _moving(window: Window, *sections: str) -> str:
    """What of the parameters that a metric reads changes within the window; empty if nothing does."""
    found = [key for key in window.moving if key.startswith(sections)]
    return f"{', '.join(found)} changes within the window" if found else ""


# --- tracking of the feel model --------------------------------------------------------------------------------------


_TRACKING = (*_LEADING, "/column.angle", "/feel.angle")


def _error(window: Window) -> Array:
    _leading(window)
    return window["/column.angle"] - window["/feel.angle"]


@_metric("deg", signals=_TRACKING)
def tracking_error_rms_deg(window: Window) -> float:
    """Root mean square of the column's angle less the feel model's."""
    return float(np.sqrt(np.mean(_error(window) ** 2))) / DEG


@_metric("deg", signals=_TRACKING)
def tracking_error_max_deg(window: Window) -> float:
    """Largest difference between the column's angle and the feel model's."""
    return float(np.max(np.abs(_error(window)))) / DEG


@_metric("deg", signals=_TRACKING, above_hz=_ABOVE)
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

    _leading(window)
    moved = float(np.ptp(window["/feel.angle"]))
    if moved < LEAST_MOTION:
        raise Unmeasured(f"the feel model stands still: it moves by {moved / DEG:.2g} deg")
    _periods(window, 1.0 / LONGEST_LAG, 4.0)

    def error(lag: float) -> float:
        return float(np.mean(_lagged_error(window, lag) ** 2))

    best = float(minimize_scalar(error, bounds=(0.0, LONGEST_LAG), method="bounded", options={"xatol": 1e-5}).x)
    if best > LONGEST_LAG - 1e-4:
        raise Unmeasured(f"the column lags by more than {1e3 * LONGEST_LAG:g} ms, or goes its own way")
    if best < 1e-4 and error(-1e-3) < 0.9 * error(best):
        raise Unmeasured("the column moves ahead of the feel model")
    return best


LEAST_MOTION = 0.01 * DEG
"""Motion of the feel model [rad] that is needed to measure how the column follows it."""


@_metric("ms", signals=_TRACKING)
def tracking_lag_ms(window: Window) -> float:
    """Delay of the column behind the feel model: the one that leaves the least error."""
    return 1e3 * _lag(window)


@_metric("deg", signals=_TRACKING)
def aligned_error_rms_deg(window: Window) -> float:
    """Root mean square of the tracking error once the lag is taken out."""
    return float(np.sqrt(np.mean(_lagged_error(window, _lag(window)) ** 2))) / DEG


_FREQUENCY = Argument(None, "Hz", "frequency of the motion", 0.02, 1000.0)


def _phasor(window: Window, signal: str, frequency: float) -> complex:
    """Least-squares amplitude and phase of a signal at ``frequency``."""
    angle = 2.0 * math.pi * frequency * window.time
    basis = np.stack([np.cos(angle), np.sin(angle), np.ones_like(angle)], axis=1)
    c, s, _ = np.linalg.lstsq(basis, window[signal], rcond=None)[0]
    return complex(c, -s)


def _response(window: Window, frequency: float) -> complex:
    """Phasor of the column over that of the feel model."""
    _leading(window)
    _periods(window, frequency, 1.0)
    model = _phasor(window, "/feel.angle", frequency)
    if abs(model) < 0.5 * LEAST_MOTION:
        raise Unmeasured(f"the feel model does not move at {frequency:g} Hz: {abs(model) / DEG:.2g} deg")
    return _phasor(window, "/column.angle", frequency) / model


@_metric("1", signals=_TRACKING, frequency=_FREQUENCY)
def tracking_amplitude_ratio(window: Window, frequency: float) -> float:
    """Amplitude of the column over that of the feel model, at a frequency."""
    return abs(_response(window, frequency))


@_metric("ms", signals=_TRACKING, frequency=_FREQUENCY)
def tracking_phase_lag_ms(window: Window, frequency: float) -> float:
    """Phase lag of the column behind the feel model as a time, at a frequency."""
    return -1e3 * float(np.angle(_response(window, frequency))) / (2.0 * math.pi * frequency)


# --- oscillation -----------------------------------------------------------------------------------------------------


@lru_cache(maxsize=64)  # all points of a sweep ask for the same
def _filter(order: int, frequency: float, kind: str, rate: float) -> Array:
    from scipy.signal import butter

    return np.asarray(butter(order, frequency, kind, fs=rate, output="sos"))


def _above(x: Array, frequency: float, window: Window) -> Array:
    """High pass without phase; Unmeasured in a window of less than two periods."""
    _periods(window, frequency, 2.0)
    from scipy.signal import sosfiltfilt

    sos = _filter(4, frequency, "highpass", window.rate)
    return np.asarray(sosfiltfilt(sos, x, padlen=min(len(x) - 1, int(2.0 * window.rate / frequency))))


_SHAKE = Argument(15.0, "Hz", "slower motion is left out; voluntary motion stays under 10 Hz", 0.05, 1000.0)


@_metric("deg", signals=("/column.angle",), above_hz=_SHAKE)
def oscillation_amplitude_deg(window: Window, above_hz: float) -> float:
    """Amplitude of a sine with the power of the column's motion above a frequency."""
    return math.sqrt(2.0) * float(np.std(_above(window["/column.angle"], above_hz, window))) / DEG


@_metric("Hz", signals=("/column.angle",), above_hz=_SHAKE)
def oscillation_frequency_hz(window: Window, above_hz: float) -> float:
    """Frequency with the greatest amplitude in the column's motion above a frequency."""
    x = window["/column.angle"]
    amplitude = oscillation_amplitude_deg(window, above_hz)
    if amplitude < LEAST_SHAKE_DEG:
        raise Unmeasured(f"the column does not oscillate above {above_hz:g} Hz: {amplitude:.2g} deg")
    spectrum = np.abs(np.fft.rfft((x - np.mean(x)) * np.hanning(len(x))))
    frequencies = np.fft.rfftfreq(len(x), window.period)
    return float(frequencies[np.argmax(np.where(frequencies >= above_hz, spectrum, 0.0))])


LEAST_SHAKE_DEG = 1e-4
"""Amplitude [deg] of an oscillation that has a frequency: a few steps of the encoder at the column."""


# --- free response ---------------------------------------------------------------------------------------------------


@_metric("1", signals=(*_LEADING, "/pilot.squeeze", "/column.velocity", "/column.angle"))
def part60_tolerance_used(window: Window) -> float:
    """Largest deviation from the expected free response over its Part 60 tolerance; up to 1 is within all of them.

    The window starts at the release. Expected is :func:`free_response.expected_response`.
    """
    _leading(window)
    if window.own_loop:
        raise Unmeasured("expected is the feel model's response, but a user's own outer loop ran")
    if why := _moving(window, "feel."):
        raise Unmeasured(f"expected is the response of one feel model, but {why}")
    grips, few = window["/pilot.squeeze"] >= 0.0, _rows(window, RELEASED_S)
    if np.any(grips[few:]):
        at = window.time[few + int(np.argmax(grips[few:]))]
        raise Unmeasured(f"the hand grips at {at:.3f} s; the window is to hold what follows a release")
    if abs(speed := window["/column.velocity"][0]) > 5.0 * AT_REST:
        raise Unmeasured(f"the column moves already when it is released, by {speed / DEG:.3g} deg/s")
    angle = window["/column.angle"]
    times = window.time - window.time[0]
    expected = free_response.expected_response(window.parameters, float(angle[0]), times)
    if abs(expected[0] - expected[-1]) < LEAST_MOTION:
        raise Unmeasured(f"the column is released where it stays, at {angle[0] / DEG:.3g} deg")
    return max(item.share for item in free_response.part60(times, angle, expected))


RELEASED_S = 0.002
"""Time after which a release at the window's start has happened [s]."""


@_metric("deg", signals=("/column.angle",))
def rest_offset_deg(window: Window) -> float:
    """Distance of the column from the feel model's neutral at the window's end (mean of 0.1 s)."""
    if window.own_loop:
        raise Unmeasured("neutral is the feel model's, but a user's own outer loop ran")
    if why := _moving(window, "feel.neutral"):
        raise Unmeasured(f"neutral is not one angle: {why}")
    return abs(_resting(window, _rows(window, 0.1)) - window.parameters.feel.neutral) / DEG


# --- at the grip, as a maintenance manual has it ----------------------------------------------------------------------

_GRIP = ("/column.angle", "/column.velocity", "/column.torque")
_AT_GRIP = Argument(None, "deg", "column angle at which the force is taken, forward positive", -170.0, 170.0)


def _passing(window: Window, at_deg: float) -> tuple[list[float], list[float]]:
    """Forces at the grip [N] in the passages of an angle: away from neutral, and back."""
    neutral = window.parameters.feel.neutral
    side = math.copysign(1.0, at_deg * DEG - neutral)
    found = _passages(window, at_deg * DEG)
    height = window.parameters.column.grip_height
    away = [passage.torque / height for passage in found if passage.velocity * side > 0.0]
    back = [passage.torque / height for passage in found if passage.velocity * side < 0.0]
    return away, back


@_metric(
    "N", signals=_GRIP, at_deg=_AT_GRIP,
    unloading=Argument(0.0, "1", "1: on the way back to neutral, 0: away from it", 0.0, 1.0),
)  # fmt: skip
def grip_force(window: Window, at_deg: float, unloading: float) -> float:
    """Force of the pilot at the grip while the column passes an angle away from neutral; forward positive."""
    if abs(at_deg * DEG - window.parameters.feel.neutral) < 2.0 * BAND:
        raise Unmeasured(f"{at_deg:g} deg is neutral, or next to it: there is no way from it and back")
    found = _passing(window, at_deg)[1 if unloading else 0]
    if not found:
        way = "towards neutral" if unloading else "away from neutral"
        raise Unmeasured(f"the column does not pass {at_deg:g} deg {way} without stopping")
    return float(np.mean(found))


@_metric("N", signals=_GRIP, at_deg=_AT_GRIP)
def grip_friction(window: Window, at_deg: float) -> float:
    """Half the difference of the forces at the grip at one angle both ways: friction as maintenance manuals have it.

    Negative where the control pushes the hand along.
    """
    away, back = _passing(window, at_deg)
    if not away or not back:
        raise Unmeasured(f"the column does not pass {at_deg:g} deg both ways without stopping")
    side = math.copysign(1.0, at_deg * DEG - window.parameters.feel.neutral)
    return 0.5 * side * (float(np.mean(away)) - float(np.mean(back)))


@_metric("N", signals=("/column.angle", "/column.torque"), threshold_deg=_THRESHOLD, below_hz=_GAUGE)
def grip_breakout(window: Window, threshold_deg: float, below_hz: float) -> float:
    """Largest force at the grip, either way, before the column has moved, from the window's start."""
    return _breakout(window, "/column.torque", threshold_deg, below_hz) / window.parameters.column.grip_height


@_metric("deg", signals=("/column.angle", "/pilot.squeeze"))
def return_angle_deg(window: Window) -> float:
    """Column angle, forward positive, at which it rests at the window's end after a release (mean of 0.1 s)."""
    rows = _rows(window, 0.1)
    if np.any(window["/pilot.squeeze"][-rows:] >= 0.0):
        raise Unmeasured("the hand still grips at the window's end")
    return _resting(window, rows) / DEG


def _resting(window: Window, rows: int) -> float:
    """Mean angle [rad] of the last samples; Unmeasured unless the column rests there."""
    last = window["/column.angle"][-rows:]
    if (moved := float(np.ptp(last))) > 0.1 * AT_REST:
        raise Unmeasured(f"the column does not rest at the window's end: it moves by {moved / DEG:.2g} deg in 0.1 s")
    return float(np.mean(last))


@_metric(
    "mm", signals=("/column.angle", "/column.torque"),
    force_N=Argument(None, "N", "force at the grip up to which the travel is taken, either way", 0.01, 1000.0),
)  # fmt: skip
def grip_play_mm(window: Window, force_N: float) -> float:
    """Travel of the grip between a force and the same one the other way: free play with the stretch behind it."""
    height = window.parameters.column.grip_height
    force, angle = window["/column.torque"] / height, window["/column.angle"]
    if np.max(force) < force_N or np.min(force) > -force_N:
        raise Unmeasured(f"the force goes from {np.min(force):.3g} to {np.max(force):.3g} N, not beyond ±{force_N:g} N")
    return float(np.ptp(angle[np.abs(force) <= force_N])) * height * 1e3


# --- limits ----------------------------------------------------------------------------------------------------------


def _share(limit: str, meaning: str) -> None:
    signal = f"/limits.{limit}"

    def share(window: Window) -> float:
        return float(np.mean(window[signal]))

    share.__name__ = f"{limit}_limited_share"
    share.__doc__ = f"Share of the window in which {meaning}."
    _metric("1", signals=(signal,))(share)


for _topic in signals.topics():
    for _signal in _topic.signals if _topic.path == "/limits" else ():
        _share(_signal.name, _signal.meaning)
