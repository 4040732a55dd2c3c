"""Metrics on signals whose value is known."""

import math
from collections.abc import Mapping, Sequence
from types import SimpleNamespace

import numpy as np
import pytest

from cls_bench.analysis import metrics
from cls_bench.analysis.window import Array, Window
from cls_bench.errors import InputError
from cls_bench.parameters import Parameters
from cls_bench.scenario import Check

TIME = np.arange(0.0, 4.0, 0.0004)


class Signals:
    """A recording of given signals at 2.5 kHz."""

    def __init__(self, **signals: Array):
        self._signals = {"/" + name.replace("__", "."): values for name, values in signals.items()}

    def read(
        self, topic: str, signals: Sequence[str] | None = None, start: float | None = None, end: float | None = None,
        every: int = 1,
    ) -> SimpleNamespace:  # fmt: skip
        rows = slice(round((start or 0.0) / 0.0004), None if end is None else round(end / 0.0004))
        values: Mapping[str, Array] = {
            name: self._signals.get(f"{topic}.{name}", np.zeros(len(TIME)))[rows] for name in signals or ()
        }
        return SimpleNamespace(values=values)


def value(metric: str, start: float = 0.0, end: float = 4.0, signal: str | None = None, **rest: object) -> float:
    arguments = rest.pop("arguments", {})
    check = Check(name="x", metric=metric, window=(start, end), signal=signal, arguments=arguments)  # type: ignore[arg-type]
    metrics.validate(check)
    return metrics.evaluate(check, Window(Signals(**rest), start, end, Parameters()))  # type: ignore[arg-type]


def test_statistics() -> None:
    x = 2.0 + 3.0 * np.sin(2 * math.pi * 2.0 * TIME)
    for name, expected in (("minimum", -1.0), ("maximum", 5.0), ("mean", 2.0), ("peak_to_peak", 6.0)):
        assert value(name, signal="/column.torque", column__torque=x) == pytest.approx(expected, abs=1e-3)
    assert value("rms", signal="/column.torque", column__torque=x) == pytest.approx(math.sqrt(4 + 4.5), abs=1e-3)


def test_ripple_leaves_slow_motion_out() -> None:
    x = 5.0 * np.sin(2 * math.pi * 0.1 * TIME) + 0.3 * np.sin(2 * math.pi * 20.0 * TIME)
    found = value("ripple", signal="/load_cell.torque", load_cell__torque=x)
    assert found == pytest.approx(0.3 / math.sqrt(2), rel=0.02)


def test_breakout_is_the_peak_before_the_column_moves() -> None:
    angle = np.where(TIME < 2.0, 0.0, (TIME - 2.0) * 0.1)
    torque = np.where(TIME < 2.0, 2.0 * TIME, 1.0)
    torque[TIME > 3.0] = 50.0  # later peaks do not count
    found = value("breakout_torque", column__angle=angle, load_cell__torque=torque)
    assert found == pytest.approx(4.0, rel=0.02)


def test_hysteresis_is_half_the_loops_width() -> None:
    angle = 0.2 * np.sin(2 * math.pi * 0.5 * TIME)
    torque = 35.0 * angle + 0.7 * np.sign(np.cos(2 * math.pi * 0.5 * TIME))
    for at in (0.0, 5.0):
        found = value("hysteresis", column__angle=angle, load_cell__torque=torque, arguments={"at_deg": at})
        assert found == pytest.approx(0.7, abs=0.02)


def test_tracking_error_lag_and_what_is_left() -> None:
    model = 0.1 * np.sin(2 * math.pi * 2.0 * TIME)
    column = 0.1 * np.sin(2 * math.pi * 2.0 * (TIME - 0.006)) + 0.001 * np.sin(2 * math.pi * 50.0 * TIME)
    signals = {"column__angle": column, "feel__angle": model}
    assert value("tracking_lag_ms", **signals) == pytest.approx(6.0, abs=0.05)  # type: ignore[arg-type]
    left = math.degrees(0.001 / math.sqrt(2))
    assert value("aligned_error_rms_deg", **signals) == pytest.approx(left, rel=0.02)  # type: ignore[arg-type]
    error = math.degrees(float(np.sqrt(np.mean((column - model) ** 2))))
    assert value("tracking_error_rms_deg", **signals) == pytest.approx(error)  # type: ignore[arg-type]
    assert value("tracking_error_max_deg", **signals) == pytest.approx(  # type: ignore[arg-type]
        math.degrees(float(np.max(np.abs(column - model))))
    )


def test_amplitude_ratio_and_phase_lag() -> None:
    model = 0.1 * np.sin(2 * math.pi * 2.0 * TIME) + 0.05
    column = 0.097 * np.sin(2 * math.pi * 2.0 * (TIME - 0.006))
    signals = {"column__angle": column, "feel__angle": model, "arguments": {"frequency": 2.0}}
    assert value("tracking_amplitude_ratio", **signals) == pytest.approx(0.97, abs=1e-4)  # type: ignore[arg-type]
    assert value("tracking_phase_lag_ms", **signals) == pytest.approx(6.0, abs=0.01)  # type: ignore[arg-type]


def test_a_model_that_stands_still_has_no_amplitude_ratio() -> None:
    signals = {"column__angle": np.sin(2 * math.pi * 2.0 * TIME), "arguments": {"frequency": 2.0}}
    assert math.isnan(value("tracking_amplitude_ratio", **signals))  # type: ignore[arg-type]
    assert math.isnan(value("tracking_phase_lag_ms", **signals))  # type: ignore[arg-type]


def test_oscillation() -> None:
    x = 0.1 * np.sin(2 * math.pi * 1.0 * TIME) + math.radians(0.2) * np.sin(2 * math.pi * 48.0 * TIME)
    assert value("oscillation_amplitude_deg", column__angle=x) == pytest.approx(0.2, rel=0.03)
    assert value("oscillation_frequency_hz", column__angle=x) == pytest.approx(48.0, abs=0.3)


def test_rest_offset_is_from_the_models_neutral() -> None:
    assert value("rest_offset_deg", column__angle=np.full(len(TIME), 0.02)) == pytest.approx(math.degrees(0.02))


def test_a_window_without_samples_has_no_value() -> None:
    assert math.isnan(value("mean", 3.999, 4.0, signal="/column.angle"))


@pytest.mark.parametrize("check, problem", [
    ({"metric": "nonsense"}, "metric: \"nonsense\" is unknown; valid: minimum"),
    ({"metric": "mean"}, "signal: missing"),
    ({"metric": "hysteresis", "signal": "/column.angle"}, "signal: hysteresis takes none"),
    ({"metric": "tracking_phase_lag_ms"}, "arguments.frequency: missing"),
    ({"metric": "hysteresis", "arguments": {"at": 1.0}}, "arguments.at: hysteresis takes no such argument"),
])  # fmt: skip
def test_what_a_check_lacks_is_named(check: dict[str, object], problem: str) -> None:
    with pytest.raises(InputError, match=problem.replace("(", r"\(")):
        metrics.validate(Check(name="x", window=(0.0, 1.0), **check))  # type: ignore[arg-type]


def test_every_metric_says_what_it_measures() -> None:
    for metric in metrics.METRICS.values():
        assert metric.meaning, metric.name
        assert all(argument.meaning and argument.unit for argument in metric.arguments.values())
