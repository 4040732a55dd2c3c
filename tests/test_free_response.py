"""The expected free response and its judgement, against closed forms."""

import math
import time
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

from cls_bench.analysis import free_response
from cls_bench.analysis.free_response import damping, expected_response, forward_inertia, part60
from cls_bench.analysis.quasi_static import Led
from cls_bench.feel_laws import Laws
from cls_bench.parameters import Parameters
from cls_bench.parameters.override import override
from tests.feel_solver import MODELS, TWO, Model
from tests.running import run

TIMES = np.arange(0.0, 4.0, 0.0004)


def parameters(**feel: Any) -> Parameters:
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
    for viscous, friction in ((1.0, 0.2), (8.0, 0.2)):
        x = expected_response(parameters(damping=viscous, friction=friction), 0.1, TIMES)
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


# All elements, and two bodies


@pytest.mark.parametrize("name", MODELS)
def test_the_feel_model_that_runs_is_solved_alike(name: str) -> None:
    p = parameters(**MODELS[name])
    led = Led(Laws(p.feel), p.feel.neutral, p.feel.neutral)
    led.to(0.15)
    model = Model(MODELS[name], 0.15, led.aft, forward=forward_inertia(p))
    found = np.array([0.15, *(model.step() for _ in TIMES[1:])])
    expected = expected_response(p, 0.15, TIMES)
    assert found == pytest.approx(expected, abs=1e-7)
    # Where all is disconnected or let go, friction holds the column from the start.
    assert (np.ptp(expected) > 0.1) == (name not in ("disconnected", "force trim released"))


def test_two_bodies_without_friction_are_the_closed_form() -> None:
    wide = {"angle": 2.0, "stiffness": 0.0, "damping": 0.0}
    p = parameters(**MODELS["two without friction"], aft_limit=wide, forward_limit=wide)
    one, other, link, lost = 0.3 + forward_inertia(p), 0.35, 900.0, 1.0
    a = np.array([
        [0.0, 1.0, 0.0, 0.0], [-link / one, -(lost + 1.5) / one, link / one, lost / one],
        [0.0, 0.0, 0.0, 1.0], [link / other, lost / other, -(link + 35.0) / other, -(lost + 1.5) / other],
    ])  # fmt: skip
    start = 0.1 * link / (link + 35.0)
    exact = [(expm(a * t) @ [0.1, 0.0, start, 0.0])[0] for t in TIMES[::500]]
    assert expected_response(p, 0.1, TIMES)[::500] == pytest.approx(exact, abs=1e-9)
    apart = [(expm(a * t) @ [0.1, 0.0, 0.08, 0.0])[0] for t in TIMES[::500]]
    assert expected_response(p, 0.1, TIMES, aft=0.08)[::500] == pytest.approx(apart, abs=1e-8)


def test_a_jam_holds_and_the_linkage_swings() -> None:
    assert np.all(expected_response(parameters(jam={"of": "aft"}), 0.1, TIMES) == 0.1)
    p = parameters(**TWO, jam={"of": "aft"}, friction=0.0, damping=0.0, linkage={"damping": 0.0})
    frequency = math.sqrt(900.0 / (0.3 + forward_inertia(p)))
    assert expected_response(p, 0.1, TIMES) == pytest.approx(0.1 * np.cos(frequency * TIMES), abs=1e-5)


def test_damping_at_the_grip_is_that_of_the_share_that_moves() -> None:
    def at(angle: float, **feel: Any) -> float:
        return damping(parameters(damping=1.0, **feel), angle)

    assert at(0.05) == pytest.approx(1.0)
    assert at(0.05, hydraulics={"pressure": 0.5, "off_damping": 3.0}) == pytest.approx(2.5)
    beyond = {"aft_limit": {"angle": 0.1, "stiffness": 150.0, "damping": 2.0}}
    assert at(0.15, **beyond) == pytest.approx(3.0)
    follows = 900.0 / 935.0
    assert at(0.05, **TWO) == pytest.approx(1.0 + follows**2 * 1.5 + (1.0 - follows) ** 2, rel=1e-6)
    assert at(0.05, **TWO, linkage={"connected": False}) == pytest.approx(1.0)
    assert at(0.05, **TWO, jam={"of": "aft"}) == pytest.approx(2.0)


STIFF = {
    "aft damped": {"aft": {"inertia": 1e-3, "damping": 100.0}},
    "linkage damped": {"aft": {"inertia": 1e-3}, "linkage": {"damping": 500.0, "stiffness": 1e5}},
    "stiction": {"aft": {"inertia": 1e-3, "static_friction": 3.0, "damping": 50.0}},
}


@pytest.mark.parametrize("name", STIFF)
def test_a_body_with_next_to_no_inertia_takes_no_longer(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Damping that is great for an inertia: in well under a second, and as the short steps have it."""
    p = override(Parameters(), {"feel": {"bodies": "two", **STIFF[name]}})
    begun = time.process_time()
    found = expected_response(p, 0.1, np.linspace(0.0, 3.0, 1501), aft=0.1)
    assert time.process_time() - begun < 1.0  # measured 0.01 to 0.34; 2.5 to 4.9 in short steps
    monkeypatch.setattr(free_response, "STIFF", math.inf)
    exact = expected_response(p, 0.1, np.linspace(0.0, 0.5, 251), aft=0.1)
    assert np.ptp(exact) > 0.01  # the oil lets it go slowly
    np.testing.assert_allclose(found[:251], exact, rtol=0, atol=1e-7)


HELD = """
[[hand]]
at = 0.0
kind = "hold"
angle_deg = 0.0
[[hand]]
at = 0.2
kind = "ramp"
to_deg = {to}
over = 0.8
smooth = true
[[hand]]
at = 1.6
kind = "release"
[[squeeze]]
at = 0.0
value = 0.1
"""


@pytest.mark.parametrize(
    "feel",
    [
        "feel.friction=0.1 feel.damping=0.5 feel.aft.friction=0.15 feel.aft.damping=0.6",
        "feel.damping=4.0 feel.aft.damping=6.0 feel.linkage.stiffness=300.0 feel.linkage.backlash=0.004",
        "feel.linkage.stiffness=300.0 feel.linkage.pretension=3.0 feel.aft.static_friction=0.4",
    ],
)
def test_the_bench_moves_two_bodies_within_the_tolerances_of_part_60(feel: str) -> None:
    found = run(HELD.format(to=8.0), duration=4.6, set=['feel.bodies="two"', *feel.split()])
    angle = found.between("/column.angle", 1.6, 4.6)[::8]
    times = np.arange(len(angle)) * 8 * found.bench.clock.tick_s
    expected = expected_response(found.bench.parameters, float(angle[0]), times)
    worst = max(part60(times, angle, expected), key=lambda item: item.share)
    assert worst.share < 0.35, worst
    one = found.bench.parameters.feel.model_copy(update={"bodies": "one"})
    other = expected_response(found.bench.parameters.model_copy(update={"feel": one}), float(angle[0]), times)
    assert max(item.share for item in part60(times, angle, other)) > 1.0  # a single body would not pass for it
