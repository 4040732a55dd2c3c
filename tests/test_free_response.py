"""The expected free response and its judgement, against closed forms."""

import math

import numpy as np
import pytest

from cls_bench.analysis.free_response import expected_response, forward_inertia, part60
from cls_bench.parameters import Parameters
from cls_bench.parameters.override import override

TIMES = np.arange(0.0, 4.0, 0.0004)


def parameters(**feel: float) -> Parameters:
    bearing = {"coulomb_friction": 0.0, "viscous_friction": 0.0}
    return override(Parameters(), {"column": bearing, "feel": feel})


def test_linear_response_is_the_closed_form() -> None:
    p = parameters(inertia=0.3, damping=1.5, stiffness=35.0, friction=0.0)
    inertia = 0.3 + forward_inertia(p)
    decay, w = 1.5 / (2 * inertia), math.sqrt(35.0 / inertia - (1.5 / (2 * inertia)) ** 2)
    exact = 0.1 * np.exp(-decay * TIMES) * (np.cos(w * TIMES) + decay / w * np.sin(w * TIMES))
    assert np.allclose(expected_response(p, 0.1, TIMES), exact, atol=1e-7)


def test_coulomb_friction_takes_the_same_from_every_half_swing() -> None:
    p = parameters(inertia=0.3, damping=0.0, stiffness=35.0, friction=0.5)
    half = math.pi / math.sqrt(35.0 / (0.3 + forward_inertia(p)))
    x = expected_response(p, 0.1, TIMES)
    turns = [x[round(k * half / 0.0004)] for k in range(4)]
    band = 0.5 / 35.0
    assert turns == pytest.approx([0.1, -(0.1 - 2 * band), 0.1 - 4 * band, -(0.1 - 6 * band)], abs=1e-5)
    assert abs(x[-1]) <= band  # it stays where friction holds it
    assert x[-1] == x[-1000]


def test_it_stays_where_friction_holds_it_from_the_start() -> None:
    x = expected_response(parameters(stiffness=35.0, friction=5.0), 0.1, TIMES)
    assert np.all(x == 0.1)


def test_a_response_equals_itself_within_all_tolerances() -> None:
    for damping, friction in ((1.0, 0.2), (8.0, 0.2)):
        x = expected_response(parameters(damping=damping, friction=friction), 0.1, TIMES)
        items = part60(TIMES, x, x)
        assert len(items) >= 2
        assert max(item.share for item in items if item.name != "residual") == pytest.approx(0.0, abs=1e-9)


def test_the_periods_of_an_underdamped_response_are_judged() -> None:
    p = parameters(inertia=0.3, damping=1.0, friction=0.0)
    x = expected_response(p, 0.1, TIMES)
    names = [item.name for item in part60(TIMES, x, x)]
    assert {"time from 0.9 A to the first crossing", "period 1", "first overshoot", "overshoot 2"} <= set(names)
    slower = part60(TIMES, np.interp(TIMES / 1.15, TIMES, x), x)
    assert {item.name for item in slower if item.share > 1.0} >= {"time from 0.9 A to the first crossing"}
    assert next(item for item in slower if item.name == "period 1").share == pytest.approx(0.15 / 0.2, rel=0.02)


def test_overshoots_and_their_number_are_judged() -> None:
    p = parameters(inertia=0.3, damping=1.0, friction=0.0)
    x = expected_response(p, 0.1, TIMES)
    damped = expected_response(parameters(inertia=0.3, damping=2.0, friction=0.0), 0.1, TIMES)
    assert {item.name for item in part60(TIMES, damped, x) if item.share > 1.0} >= {"first overshoot"}
    lively = expected_response(parameters(inertia=0.3, damping=0.3, friction=0.0), 0.1, TIMES)
    assert {item.name for item in part60(TIMES, lively, x) if item.share > 1.0} >= {"number of overshoots"}


def test_an_overdamped_response_is_judged_by_its_fall() -> None:
    x = expected_response(parameters(inertia=0.3, damping=12.0, friction=0.0), 0.1, TIMES)
    slow = part60(TIMES, np.interp(TIMES / 1.2, TIMES, x), x)
    fall = next(item for item in slow if item.name == "time from 0.9 A to 0.1 A")
    assert fall.share == pytest.approx(2.0, rel=0.02)


def test_a_residual_outside_the_band_is_judged() -> None:
    x = expected_response(parameters(damping=12.0, friction=0.0), 0.1, TIMES)
    (residual,) = (item for item in part60(TIMES, x + 0.008 * (TIMES > 3.0), x) if item.name == "residual")
    assert residual.share == pytest.approx(0.08 / 0.05, rel=0.02)


def test_a_response_that_never_crosses_where_one_is_expected_fails() -> None:
    x = expected_response(parameters(damping=1.0, friction=0.0), 0.1, TIMES)
    assert max(item.share for item in part60(TIMES, np.abs(x) + 1e-6, x)) > 1.0
