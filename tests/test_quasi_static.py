"""Torque over angle in an infinitely slow sweep: closed forms, and the compiled feel model led slowly."""

import math
import time
from typing import Any

import numpy as np
import pytest

from cls_bench.analysis.quasi_static import static_curve
from cls_bench.parameters import Feel, Parameters
from cls_bench.parameters.override import override
from tests.feel_solver import MODELS, TWO, Model

OUT = np.linspace(0.0, 0.3, 301)
AND_BACK = np.concatenate([OUT, OUT[::-1][1:]])


def model(**feel: Any) -> Feel:
    return override(Parameters(), {"feel": feel}).feel


def test_one_body_is_its_springs_with_friction_both_ways() -> None:
    f = model(friction=0.4, centering={"stiffness": 60.0, "breakout": 0.9}, neutral=0.02)
    x, wanted = OUT - 0.02, 35.0 * (OUT - 0.02)
    wanted += np.clip(60.0 * x, -0.9, 0.9)
    wanted += 150.0 * np.maximum(OUT - f.aft_limit.angle, 0.0) + 1500.0 * np.maximum(OUT - f.forward_limit.angle, 0.0)
    curve = static_curve(f, AND_BACK)
    assert curve[:301] == pytest.approx(wanted + 0.4, abs=1e-9)
    assert curve[301:] == pytest.approx(wanted[::-1][1:] - 0.4, abs=1e-9)


def test_thesis_figure_3_22_kink_at_the_aft_limit_then_the_cable_then_the_stop() -> None:
    cable, spring, end, stop = 300.0, 35.0, 0.15, 1500.0
    f = model(
        **TWO, friction=0.0, aft={"friction": 0.0}, linkage={"stiffness": cable},
        aft_limit={"angle": end, "stiffness": 1e6}, forward_limit={"angle": 0.25, "stiffness": stop},
    )  # fmt: skip
    curve = static_curve(f, OUT)
    slope = np.diff(curve) / np.diff(OUT)
    kink = end * (1.0 + spring / cable)  # where the aft body is at its limit
    before, between, beyond = OUT[1:] < kink, (OUT[:-1] > kink) & (OUT[1:] <= 0.25), OUT[:-1] >= 0.25
    assert slope[before] == pytest.approx(cable * spring / (cable + spring), rel=1e-6)
    assert slope[between] == pytest.approx(cable, rel=1e-3)
    assert slope[beyond] == pytest.approx(cable + stop, rel=1e-3)
    assert curve[np.searchsorted(OUT, kink)] == pytest.approx(spring * end, rel=0.05)


def test_friction_of_both_bodies_makes_the_loop_and_the_cable_its_corners() -> None:
    cable, spring = 300.0, 35.0
    f = model(**TWO, friction=0.2, aft={"friction": 0.5}, linkage={"stiffness": cable},
              aft_limit={"angle": 1.0}, forward_limit={"angle": 1.0})  # fmt: skip
    curve = static_curve(f, AND_BACK)
    forth, back = curve[:301], curve[300:][::-1]
    # Sliding, the aft body is where the cable carries spring and friction.
    whole = cable / (cable + spring)
    assert forth[100] == pytest.approx(0.2 + whole * (spring * OUT[100] + 0.5), abs=1e-9)
    assert back[100] == pytest.approx(-0.2 + whole * (spring * OUT[100] - 0.5), abs=1e-9)
    # After the reversal it stays until the cable has given back twice its friction.
    turned = curve[301:] - (forth[300] - 2.0 * 0.2)
    stays = OUT[::-1][1:] > 0.3 - 2.0 * 0.5 / cable + 1e-9
    assert turned[stays] == pytest.approx(cable * (OUT[::-1][1:][stays] - 0.3), abs=1e-9)
    assert np.count_nonzero(stays) == 3


def test_backlash_is_crossed_without_torque() -> None:
    f = model(**TWO, friction=0.0, aft={"friction": 0.3}, linkage={"backlash": 0.04})
    curve = static_curve(f, AND_BACK)
    assert curve[:20] == pytest.approx(0.0, abs=1e-12)
    assert np.count_nonzero(np.abs(curve[:301]) < 1e-9) == 21
    # On the way back its spring keeps the aft body in contact, until friction holds it.
    free = OUT < 0.3 / 35.0 + 0.02
    assert np.array_equal(np.abs(curve[300:][::-1]) < 1e-9, free)


def test_jam_override_and_disconnection() -> None:
    x = np.linspace(0.0, 0.2, 101)
    jammed = static_curve(model(**TWO, jam={"of": "aft"}), x)
    assert jammed == pytest.approx(0.25 + 900.0 * x, abs=1e-9)
    overridden = static_curve(model(**TWO, jam={"of": "aft"}, linkage={"override": 8.0}), x)
    assert overridden == pytest.approx(0.25 + np.minimum(900.0 * x, 8.0), abs=1e-9)
    apart = static_curve(model(**TWO, linkage={"connected": False}), x)
    assert apart == pytest.approx(0.25, abs=1e-9)
    slack = static_curve(model(**TWO, jam={"of": "aft"}, linkage={"pretension": 9.0}), x)
    assert slack == pytest.approx(0.25 + np.where(x < 0.02, 900.0 * x, 9.0 + 450.0 * x), abs=1e-9)
    for feel in ({"jam": {"of": "aft"}}, {**TWO, "jam": {"of": "forward"}}):
        assert np.all(np.isnan(static_curve(model(**feel), x)))


def test_static_friction_breaks_away_at_its_own_torque_and_slips() -> None:
    f = model(**TWO, friction=0.0, stiffness=0.0, aft={"friction": 0.5, "static_friction": 2.0, "damping": 0.0},
              linkage={"stiffness": 100.0, "damping": 0.0})  # fmt: skip
    x = np.linspace(0.0, 0.2, 2001)
    curve = static_curve(f, x)
    # Without damping the cable swings as far below Coulomb's friction as it was above: 2 - 2 (2 - 0.5) = -1.
    assert curve.max() == pytest.approx(2.0, abs=0.011)
    falls = np.flatnonzero(np.diff(curve) < -1.0)
    assert len(falls) == 6
    late = x[falls] - (0.02 + 0.03 * np.arange(6))  # each by no more than a point of the path
    assert np.all((late >= -1e-9) & (late <= 1e-4 * np.arange(1, 7)))
    assert curve[falls + 1] == pytest.approx(-1.0, abs=0.02)
    steady = model(**TWO, friction=0.0, stiffness=0.0, linkage={"stiffness": 100.0, "damping": 30.0},
                   aft={"friction": 0.5, "static_friction": 2.0, "damping": 30.0})  # fmt: skip
    curve = static_curve(steady, x)  # it creeps to where Coulomb's friction is, and goes on sliding
    assert curve[x > 0.025] == pytest.approx(0.5, abs=1e-5)


def test_a_detent_lets_go_of_a_soft_cable_at_once() -> None:
    f = model(**TWO, friction=0.0, stiffness=0.0, aft={"friction": 0.01, "damping": 3.0}, linkage={"stiffness": 100.0},
              detents={"place": (0.0,), "width": (0.05,), "torque": (8.0,)})  # fmt: skip
    x = np.linspace(0.0, 0.2, 2001)
    curve = static_curve(f, x)
    falls = np.flatnonzero(np.diff(curve) < -1.0)
    assert len(falls) == 1
    # It goes where the sine falls as steeply as the cable: 8 w cos(w y) = -100, w = 2 pi / 0.05.
    w = 2.0 * math.pi / 0.05
    y = math.acos(-100.0 / (8.0 * w)) / w
    assert x[falls[0]] == pytest.approx(y + (8.0 * math.sin(w * y) + 0.01) / 100.0, abs=2e-4)


@pytest.mark.parametrize(
    "name", ["backlash", "slack cables", "jam aft with override", "detents aft", "surface", "limits to either side"]
)
def test_the_feel_model_that_runs_asks_for_the_same_in_a_slow_sweep(name: str) -> None:
    feel = dict(MODELS[name])
    if name == "surface":  # a step of the gearing under load is no place to be led slowly
        feel["surface"] = {k: v for k, v in feel["surface"].items() if k not in ("control_angle", "deflection")}
    # Dampers that a slow motion would feel are off; that of the linkage calms what has inertia.
    for part, lost in (("aft", 0.02), ("aft_limit", 0.02), ("forward_limit", 0.02), ("linkage", 4.0)):
        feel[part] = {**feel.get(part, {}), "damping": lost}
    feel["hydraulics"] = {**feel.get("hydraulics", {}), "off_damping": 0.0}
    feel["surface"] = {**feel.get("surface", {}), "hinge_rate": 0.0}
    led = Model({**feel, "damping": 0.0})
    angle, torque = led.swept(0.15, 0.06)
    away = np.abs(static_curve(led.feel, angle) - torque)[20:]  # the model begins at rest, out of balance
    whole = float(np.ptp(torque))
    assert np.median(away) < 0.004 * whole
    assert np.quantile(away, 0.9) < 0.02 * whole  # corners ring in what has inertia


def test_four_hundred_points_take_no_time() -> None:
    path = np.concatenate([np.linspace(0.0, 0.3, 100), np.linspace(0.3, -0.3, 200), np.linspace(-0.3, 0.0, 100)])
    f = model(**{**MODELS["surface"], **MODELS["detents aft"], "linkage": {"backlash": 0.01, "pretension": 5.0}})
    static_curve(f, path)
    taken = []
    for _ in range(3):
        begin = time.process_time()
        static_curve(f, path)
        taken.append(time.process_time() - begin)
    assert min(taken) < 0.2
