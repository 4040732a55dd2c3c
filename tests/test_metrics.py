"""Metrics on signals whose value is known."""

import math
from collections.abc import Mapping

import numpy as np
import pytest

from cls_bench.analysis import metrics
from cls_bench.analysis.window import Array, Window
from cls_bench.errors import InputError
from cls_bench.parameters import Parameters
from cls_bench.scenario import Check
from cls_bench.signals import CLOCK, Clock, Column, Topic, topics

TIME = np.arange(0.0, 4.0, 0.0004)


class Signals:
    """A recording of given signals, all others zero, at the PLC's rate."""

    def __init__(self, clock: Clock = CLOCK, **signals: Array):
        self.clock, self.topics = clock, {topic.path: topic for topic in topics(clock)}
        self._signals = {"/" + name.replace("__", "."): values for name, values in signals.items()}
        self._rows = next((len(values) for values in self._signals.values()), len(TIME))

    def samples_at(self, signal: str, ticks: range) -> Column:
        assert ticks.step == self.clock.plc_ticks and ticks.start % ticks.step == 0
        at = np.array([tick for tick in ticks if tick < self._rows * ticks.step], np.int64)
        return Column(at, self._signals.get(signal, np.zeros(self._rows))[at // ticks.step])


def measured(
    metric: str, start: float = 0.0, end: float = 4.0, signal: str | None = None, *, idle: str = "",
    own_loop: bool = False, **rest: object,
) -> metrics.Measured:  # fmt: skip
    arguments = rest.pop("arguments", {})
    check = Check(name="x", metric=metric, window=(start, end), signal=signal, arguments=arguments)  # type: ignore[arg-type]
    metrics.validate(check)
    window = Window(Signals(**rest), start, end, Parameters(), idle=idle, own_loop=own_loop)  # type: ignore[arg-type]
    return metrics.evaluate(check, window)


def value(metric: str, *window: float, **rest: object) -> float:
    found = measured(metric, *window, **rest)  # type: ignore[arg-type]
    assert math.isnan(found.value) == bool(found.note)
    return found.value


def why_not(metric: str, *window: float, **rest: object) -> str:
    found = measured(metric, *window, **rest)  # type: ignore[arg-type]
    assert math.isnan(found.value), found.value
    return found.note


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
    for metric in ("tracking_amplitude_ratio", "tracking_phase_lag_ms"):
        assert "does not move at 2 Hz" in why_not(metric, **signals)  # type: ignore[arg-type]


def test_oscillation() -> None:
    x = 0.1 * np.sin(2 * math.pi * 1.0 * TIME) + math.radians(0.2) * np.sin(2 * math.pi * 48.0 * TIME)
    assert value("oscillation_amplitude_deg", column__angle=x) == pytest.approx(0.2, rel=0.03)
    assert value("oscillation_frequency_hz", column__angle=x) == pytest.approx(48.0, abs=0.3)


def test_rest_offset_is_from_the_models_neutral() -> None:
    assert value("rest_offset_deg", column__angle=np.full(len(TIME), 0.02)) == pytest.approx(math.degrees(0.02))


def test_a_window_without_samples_has_no_value() -> None:
    assert "samples; 64 are needed" in why_not("mean", 3.999, 4.0, signal="/column.angle")
    assert "the samples end at 3.9996 s, the window at 6 s" in why_not("mean", 3.0, 6.0, signal="/column.angle")
    assert "there are no samples from 5 to 6 s" in why_not("mean", 5.0, 6.0, signal="/column.angle")


# --- what cannot be measured is not given a number -------------------------------------------------------------------

SWEEP = 0.2 * np.sin(2 * math.pi * 0.5 * TIME)
RATE = np.gradient(SWEEP, 0.0004)


def loop(friction: float, damping: float, angle: Array = SWEEP, rate: Array = RATE) -> dict[str, Array]:
    torque = 35.0 * angle + friction * np.sign(rate) + damping * rate
    return {"column__angle": angle, "column__velocity": rate, "column__torque": torque}


def test_static_friction_leaves_the_known_viscosity_out() -> None:
    p = Parameters()
    known = p.feel.damping + p.column.viscous_friction
    for at in (0.0, 5.0, -8.0):
        found = value("static_friction", arguments={"at_deg": at}, **loop(0.3, known))
        assert found == pytest.approx(0.3, abs=0.01)
    # The loop is wider by far.
    wide = value("hysteresis", column__angle=SWEEP, load_cell__torque=loop(0.3, known)["column__torque"])
    assert wide > 1.0


def test_static_friction_finds_the_viscosity_from_two_speeds() -> None:
    angle = np.concatenate([SWEEP[:5000], -SWEEP[:5000:2], SWEEP[:5000:2]])
    signals = loop(0.3, 4.0, angle, np.gradient(angle, 0.0004))
    for other in ({}, {"own_loop": True}, {"idle": "off"}):
        assert value("static_friction", **signals, **other) == pytest.approx(0.3, abs=0.02)  # type: ignore[arg-type]


def test_static_friction_at_one_speed_needs_a_known_viscosity() -> None:
    assert "a user's own outer loop" in why_not("static_friction", own_loop=True, **loop(0.3, 1.0))
    assert "the drive is off" in why_not("static_friction", idle="the drive is off from 0 s", **loop(0.3, 1.0))
    assert "does not pass 30 deg both ways" in why_not("static_friction", arguments={"at_deg": 30.0}, **loop(0.3, 1.0))
    assert "does not pass 30 deg both ways" in why_not("hysteresis", arguments={"at_deg": 30.0}, column__angle=SWEEP)


def test_a_sample_that_is_not_finite_is_no_value() -> None:
    for bad in (math.nan, math.inf):
        x = SWEEP.copy()
        x[2500] = bad
        for metric in ("minimum", "maximum", "mean", "rms", "peak_to_peak", "ripple"):
            assert "/column.angle is not finite at 1.0000 s" in why_not(metric, signal="/column.angle", column__angle=x)
        for metric in ("hysteresis", "tracking_error_rms_deg", "oscillation_frequency_hz", "breakout_torque"):
            assert "/column.angle is not finite at 1.0000 s" in why_not(metric, column__angle=x)


def test_a_column_that_does_not_move_has_no_breakout() -> None:
    still = {"column__angle": 0.001 * SWEEP, "load_cell__torque": 10.0 * SWEEP}
    assert "does not break out: it moves by 0.0115 of 0.5 deg" in why_not("breakout_torque", **still)
    assert "moves already when the window starts" in why_not("breakout_torque", column__angle=SWEEP)


def test_a_window_holds_some_periods_of_what_is_filtered() -> None:
    x = {"column__angle": SWEEP}
    assert "fewer than 2 periods of 1 Hz" in why_not("ripple", 0.0, 1.0, signal="/column.angle", **x)
    assert "fewer than 2 periods of 30 Hz" in why_not("breakout_torque", 0.0, 0.05, **x)
    assert "fewer than 1 periods of 0.5 Hz" in why_not(
        "tracking_phase_lag_ms", 0.0, 1.0, arguments={"frequency": 0.5}, feel__angle=SWEEP, **x
    )


TRACKING = ("tracking_error_rms_deg", "tracking_error_max_deg", "tracking_ripple_deg", "tracking_lag_ms",
            "aligned_error_rms_deg")  # fmt: skip


def test_nothing_is_tracked_while_the_drive_is_off() -> None:
    on = {"column__angle": SWEEP, "feel__angle": SWEEP, "drive__voltage": np.ones(len(TIME))}
    tripped = on | {"drive__voltage": np.where(TIME < 2.0, 1.0, 0.0)}
    for metric in TRACKING:
        assert value(metric, **on) == pytest.approx(0.0, abs=1e-2)
        assert "the drive is off from 2.000 s" in why_not(metric, **tripped)
        assert "in mode torque" in why_not(metric, idle="the drive is in mode torque from 0 s to 9 s", **on)


def test_a_lag_at_the_end_of_what_is_looked_for_is_none() -> None:
    late = np.interp(TIME - 0.2, TIME, SWEEP)
    assert "lags by more than 50 ms" in why_not("tracking_lag_ms", feel__angle=SWEEP, column__angle=late)
    early = np.interp(TIME + 0.01, TIME, SWEEP)
    assert "moves ahead" in why_not("tracking_lag_ms", feel__angle=SWEEP, column__angle=early)
    assert "stands still" in why_not("tracking_lag_ms", column__angle=SWEEP)


def test_a_column_at_rest_has_no_frequency() -> None:
    assert "does not oscillate above 15 Hz" in why_not("oscillation_frequency_hz", column__angle=SWEEP)


def test_a_free_response_needs_a_release() -> None:
    free = {"pilot__squeeze": np.full(len(TIME), -1.0), "column__angle": 0.1 * np.cos(TIME)}
    moving = free | {"column__velocity": np.full(len(TIME), 0.3)}
    assert "the hand grips at 0.002 s" in why_not("part60_tolerance_used", column__angle=SWEEP)
    assert "moves already when it is released" in why_not("part60_tolerance_used", **moving)
    assert "released where it stays" in why_not("part60_tolerance_used", **free | {"column__angle": 0 * TIME})
    assert "own outer loop" in why_not("part60_tolerance_used", own_loop=True, **free)
    assert "does not rest" in why_not("rest_offset_deg", column__angle=SWEEP)
    assert "own outer loop" in why_not("rest_offset_deg", own_loop=True, column__angle=0 * TIME)


@pytest.mark.parametrize("check, problem", [
    ({"metric": "nonsense"}, "metric: \"nonsense\" is unknown; valid: minimum"),
    ({"metric": "ripple", "signal": "/column.angle", "arguments": {"above_hz": 0.0}}, "arguments.above_hz: 0 is not"),
    ({"metric": "ripple", "signal": "/column.angle", "arguments": {"above_hz": 1250.0}}, "≤ 1000 .Hz."),
    ({"metric": "breakout_torque", "arguments": {"below_hz": 1e9}}, "arguments.below_hz: 1e.09 is not valid"),
    ({"metric": "hysteresis", "arguments": {"at_deg": 1e9}}, "≥ -60 and ≤ 60 .deg."),
    ({"metric": "tracking_phase_lag_ms", "arguments": {"frequency": 0.0}}, "arguments.frequency: 0 is not valid"),
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


# --- what each metric reads -------------------------------------------------------------------------------------------


class Declared:
    """A source that hands out the signals that a check is said to read, and notes which it was asked for."""

    def __init__(self, source: Signals, allowed: frozenset[str]):
        self._source, self._allowed, self.asked = source, allowed, set[str]()

    @property
    def clock(self) -> Clock:
        return self._source.clock

    @property
    def topics(self) -> Mapping[str, Topic]:
        return self._source.topics

    def samples_at(self, signal: str, ticks: range) -> Column:
        assert signal in self._allowed, f"{signal} is read and not declared"
        self.asked.add(signal)
        return self._source.samples_at(signal, ticks)


_SWAY = {"column__angle": 0.2 * np.sin(2 * math.pi * (TIME - 0.005)), "feel__angle": 0.2 * np.sin(2 * math.pi * TIME)}
_RELEASED = {
    "pilot__squeeze": np.full(len(TIME), -1.0), "column__angle": 0.1 * np.exp(-3.0 * TIME) * np.cos(9.0 * TIME)
}  # fmt: skip
_RECORDINGS: dict[str, dict[str, Array]] = {
    "zero": {},
    "not finite": {"column__angle": np.full(len(TIME), np.nan)},
    "sway": _SWAY,
    "without power": _SWAY | {"drive__voltage": np.where(TIME < 2.0, 1.0, 0.0)},
    "loop": loop(0.3, 1.0),
    "two speeds": loop(0.3, 4.0, _TWO := np.concatenate([SWEEP[:5000], -SWEEP[:5000:2], SWEEP[:5000:2]]),
                       np.gradient(_TWO, 0.0004)),
    "shaking": {"column__angle": 0.01 * np.sin(2 * math.pi * 48.0 * TIME)},
    "released": _RELEASED,
    "at rest, then moved": {"column__angle": np.where(TIME < 2.0, 0.0, (TIME - 2.0) * 0.1)},
}  # fmt: skip


@pytest.mark.parametrize("name", metrics.METRICS)
def test_a_metric_reads_what_it_declares_and_all_of_it(name: str) -> None:
    metric = metrics.METRICS[name]
    arguments = {key: 1.0 if a.default is None else a.default for key, a in metric.arguments.items()}
    signal = "/drive.torque" if metric.of_signal else None
    check = Check(name="x", metric=name, window=(0.0, 4.0), signal=signal, arguments=arguments)
    asked, values = set[str](), []
    for signals in _RECORDINGS.values():
        for how in ({}, {"idle": "no power"}, {"own_loop": True}):
            source = Declared(Signals(**signals), metrics.signals_of(check))
            window = Window(source, 0.0, 4.0, Parameters(), **how)  # type: ignore[arg-type]
            values.append(metrics.evaluate(check, window).value)
            asked |= source.asked
    assert not all(map(math.isnan, values))  # it came to its end at least once
    assert asked == metrics.signals_of(check)


# --- at the grip -----------------------------------------------------------------------------------------------------

AT_GRIP = {
    "column__angle": 0.2 * np.sin(2 * math.pi * 0.5 * TIME),
    "column__velocity": 0.2 * math.pi * np.cos(2 * math.pi * 0.5 * TIME),
    # 35 N·m/rad, a centering of 1.2 N·m, friction of 0.6 N·m, at a grip of 0.3 m
    "column__torque": 35.0 * 0.2 * np.sin(2 * math.pi * 0.5 * TIME) + 1.2 * np.sign(np.sin(2 * math.pi * 0.5 * TIME))
    + 0.6 * np.sign(np.cos(2 * math.pi * 0.5 * TIME)),
}


def test_forces_at_the_grip_loading_and_unloading_either_way() -> None:
    def force(at_deg: float, **more: float) -> float:
        return value("grip_force", arguments={"at_deg": at_deg, **more}, **AT_GRIP)

    spring = 35.0 * math.radians(6.0)
    assert force(6.0) == pytest.approx((spring + 1.2 + 0.6) / 0.3, rel=0.003)
    assert force(6.0, unloading=1.0) == pytest.approx((spring + 1.2 - 0.6) / 0.3, rel=0.003)
    assert force(-6.0) == pytest.approx(-(spring + 1.2 + 0.6) / 0.3, rel=0.003)
    assert force(-6.0, unloading=1.0) == pytest.approx(-(spring + 1.2 - 0.6) / 0.3, rel=0.003)


def test_friction_at_the_grip_is_half_the_difference() -> None:
    for at in (-6.0, 6.0):
        assert value("grip_friction", arguments={"at_deg": at}, **AT_GRIP) == pytest.approx(0.6 / 0.3, rel=0.01)


def test_friction_that_pushes_the_hand_along_is_negative() -> None:
    forward = AT_GRIP | {"column__torque": -AT_GRIP["column__torque"]}
    for at in (-6.0, 6.0):
        assert value("grip_friction", arguments={"at_deg": at}, **forward) == pytest.approx(-0.6 / 0.3, rel=0.01)


def test_no_force_where_the_column_does_not_pass() -> None:
    assert "does not pass 20 deg away from neutral" in why_not("grip_force", arguments={"at_deg": 20.0}, **AT_GRIP)
    assert "is neutral, or next to it" in why_not("grip_force", arguments={"at_deg": 0.5}, **AT_GRIP)
    assert "both ways" in why_not("grip_friction", 0.0, 0.45, arguments={"at_deg": 6.0}, **AT_GRIP)


def test_breakout_at_the_grip() -> None:
    angle = np.where(TIME < 2.0, 0.0, -(TIME - 2.0) * 0.1)
    torque = np.where(TIME < 2.0, -2.0 * TIME, -1.0)
    found = value("grip_breakout", column__angle=angle, column__torque=torque)
    assert found == pytest.approx(4.0 / 0.3, rel=0.02)


def test_return_angle_has_a_sign_and_needs_a_release() -> None:
    signals = {"column__angle": np.full(len(TIME), -0.02), "pilot__squeeze": np.full(len(TIME), -1.0)}
    assert value("return_angle_deg", **signals) == pytest.approx(math.degrees(-0.02))  # type: ignore[arg-type]
    assert "still grips" in why_not("return_angle_deg", column__angle=signals["column__angle"])
    signals["column__angle"] = 0.1 * np.sin(TIME)
    assert "does not rest" in why_not("return_angle_deg", **signals)  # type: ignore[arg-type]


def test_free_play_is_the_travel_between_two_forces() -> None:
    """2 mm of play at a grip of 0.3 m, then 20 N/mm: 10 N lie 0.5 mm beyond each end."""
    travel = 3.0 * np.sin(2 * math.pi * 0.5 * TIME)  # mm
    force = 20.0 * np.sign(travel) * np.maximum(np.abs(travel) - 1.0, 0.0)
    signals = {"column__angle": travel * 1e-3 / 0.3, "column__torque": 0.3 * force}
    found = value("grip_play_mm", arguments={"force_N": 10.0}, **signals)
    assert found == pytest.approx(3.0, abs=0.01)
    assert "not beyond ±50 N" in why_not("grip_play_mm", arguments={"force_N": 50.0}, **signals)
