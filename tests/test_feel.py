"""The single body of the feel model as it is by default, against solutions and laws written down here on their own."""

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from cls_bench.control import plc
from cls_bench.feel import solver
from cls_bench.feel.element import PIECE
from cls_bench.feel.elements.centering import Centering
from cls_bench.feel.model import STATE
from cls_bench.parameters import Feel, Parameters, record_of
from cls_bench.signals import CLOCK
from tests.oracles.feel_driver import blank

PLC_S = CLOCK.plc_s
_PIECE = blank(PIECE)
NO_LIMITS = {
    "aft_limit": dict(angle=0.5, stiffness=0.0, damping=0.0),
    "forward_limit": dict(angle=0.55, stiffness=0.0, damping=0.0),
}


def record(**values):
    return record_of(Parameters(feel=Feel(**values)))


def at(angle=0.0, velocity=0.0):
    state = blank(STATE)
    state.angle, state.velocity = angle, velocity
    return state


def step(f, state, torque: float, cycle: float, time: float = 0.0) -> None:
    solver.step(f, state, _PIECE, torque, time, cycle)


def energy(f: Feel, angle: float, velocity: float) -> float:
    """Kinetic energy and the springs' potential [J]."""
    x = angle - f.neutral
    total = 0.5 * f.inertia * velocity**2 + 0.5 * f.stiffness * x**2
    unit = f.centering
    if unit.stiffness > 0 and unit.breakout > 0:
        inner = min(abs(x), unit.breakout / unit.stiffness)
        total += 0.5 * unit.stiffness * inner**2 + unit.breakout * (abs(x) - inner)
    for limit in (f.aft_limit, f.forward_limit):
        total += 0.5 * limit.stiffness * max(abs(angle) - limit.angle, 0.0) ** 2
    return total


def torques(f: Feel, angle: float, velocity: float) -> float:
    """All torques of springs and dampers, friction left out (thesis 3.5.2)."""
    x = angle - f.neutral
    total = f.stiffness * x + f.damping * velocity
    total += max(-f.centering.breakout, min(f.centering.breakout, f.centering.stiffness * x))
    for limit in (f.aft_limit, f.forward_limit):
        beyond, side = abs(angle) - limit.angle, math.copysign(1.0, angle)
        if beyond > 0.0:
            total += side * max(0.0, limit.stiffness * beyond + limit.damping * side * velocity)
    return total


def integrate(f: Feel, angle, velocity, torque, duration):
    """Angle and velocity after ``duration`` under constant torque: solve_ivp between reversals, with stiction."""
    t = 0.0
    while t < duration - 1e-12:
        if velocity == 0.0:
            net = torque - torques(f, angle, 0.0)
            if abs(net) <= f.friction:
                return angle, 0.0
            way = math.copysign(1.0, net)
        else:
            way = math.copysign(1.0, velocity)

        def rate(_, y, way=way):
            return [y[1], (torque - torques(f, y[0], y[1]) - way * f.friction) / f.inertia]

        def stop(_, y, way=way, bias=1e-15 if velocity == 0.0 else 0.0):
            return y[1] * way + bias

        stop.terminal, stop.direction = True, -1.0
        solution = solve_ivp(rate, (t, duration), [angle, velocity], events=stop, rtol=1e-10, atol=1e-13, max_step=2e-3)
        t = solution.t[-1]
        angle, velocity = solution.y[:, -1]
        if solution.status == 1:
            velocity = 0.0
    return angle, velocity


FULL = {
    "inertia": 0.3, "damping": 1.5, "stiffness": 35.0, "friction": 0.25, "neutral": 0.03,
    "centering": Centering(stiffness=60.0, breakout=0.9),
    "aft_limit": dict(angle=0.15, stiffness=150.0, damping=2.0),
    "forward_limit": dict(angle=0.2, stiffness=1500.0, damping=15.0),
}  # fmt: skip


@pytest.mark.parametrize(
    "values",
    [
        {},
        {"damping": 0.0, "friction": 0.0},
        {"friction": 1.5},
        {"damping": 12.0, "stiffness": 20.0, "friction": 0.0},
        FULL,
        {**FULL, "friction": 0.0, "damping": 0.0},
        {**FULL, "inertia": 0.05},
        {**FULL, "stiffness": 0.0},
    ],
)
def test_agrees_with_an_ode_solver(values):
    f = Feel(**values)
    r = record(**values).feel
    state = at(0.02, 0.0)
    x, v = 0.02, 0.0
    for torque in (3.0, -2.0, 15.0, 15.0, -14.0, 0.0, 0.1, -0.3, 2.0, 0.0, 0.0):
        x, v = integrate(f, x, v, torque, 0.1)
        for _ in range(250):
            step(r, state, torque, PLC_S)
        assert state.angle == pytest.approx(x, abs=2e-7)
        assert state.velocity == pytest.approx(v, abs=2e-5)


@pytest.mark.parametrize(
    "values", [NO_LIMITS, {}, FULL, {**FULL, "centering": Centering(stiffness=60.0, breakout=3.0), "neutral": -0.05}]
)
def test_undamped_oscillation_neither_loses_nor_gains_energy(values):
    still = {"damping": 0.0, "friction": 0.0}
    for limit in ("aft_limit", "forward_limit"):
        given = getattr(Feel(**values), limit)
        still[limit] = dict(angle=given.angle, stiffness=given.stiffness, damping=0.0)
    f = Feel(**{**values, **still})
    r = record(**{**values, **still}).feel
    state = at(0.26, 0.5)
    start = energy(f, 0.26, 0.5)
    worst = 0.0
    for _ in range(75_000):  # half a minute
        step(r, state, 0.0, PLC_S)
        worst = max(worst, abs(energy(f, state.angle, state.velocity) / start - 1.0))
    assert worst < 1e-9


def test_frequency_is_exact():
    """After a minute an undamped body is where its closed form says, to within rounding."""
    values = {"damping": 0.0, "friction": 0.0, **NO_LIMITS}
    r = record(**values).feel
    state = at(0.1)
    for _ in range(150_000):
        step(r, state, 0.0, PLC_S)
    omega = math.sqrt(35.0 / 0.3)
    assert state.angle == pytest.approx(0.1 * math.cos(omega * 60.0), abs=1e-9)


@settings(max_examples=150, deadline=None)
@given(
    inertia=st.floats(0.01, 2.0), damping=st.floats(0.0, 20.0), stiffness=st.floats(0.0, 200.0),
    friction=st.floats(0.0, 3.0), centering=st.floats(0.0, 5.0), neutral=st.floats(-0.1, 0.1),
    cycle=st.sampled_from([5e-5, 4e-4, 1e-2, 0.3]), angle=st.floats(-0.3, 0.3), velocity=st.floats(-5.0, 5.0),
)  # fmt: skip
@example(  # a spring of the least number there is
    inertia=1.0, damping=1.0, stiffness=5e-324, friction=0.0, centering=1.0, neutral=0.0, cycle=0.3, angle=0.0,
    velocity=1.0,
)  # fmt: skip
def test_is_passive_at_any_cycle(inertia, damping, stiffness, friction, centering, neutral, cycle, angle, velocity):
    values = {
        "inertia": inertia, "damping": damping, "stiffness": stiffness, "friction": friction, "neutral": neutral,
        "centering": Centering(stiffness=50.0, breakout=centering),
    }  # fmt: skip
    f, r, state = Feel(**values), record(**values).feel, at(angle, velocity)
    before = energy(f, angle, velocity)
    for _ in range(40):
        step(r, state, 0.0, cycle)
        after = energy(f, state.angle, state.velocity)
        assert after <= before + 1e-11
        before = after


@pytest.mark.parametrize("values", [{}, FULL, {**FULL, "friction": 0.0, "damping": 0.0, "inertia": 0.02}])
def test_the_cycle_time_does_not_matter(values):
    """The same torque, held for 12 ms each, sampled at 50 µs, 400 µs and 12 ms."""
    ends = []
    for cycle, count in ((5e-5, 240), (4e-4, 30), (1.2e-2, 1)):
        r, state, path = record(**values).feel, at(0.05, 0.2), []
        for k in range(60):
            for _ in range(count):
                step(r, state, 20.0 * math.sin(0.15 * k), cycle)
            path.append((state.angle, state.velocity))
        ends.append(np.array(path))
    assert np.ptp(ends[0][:, 0]) > 0.2  # into the travel limits
    np.testing.assert_allclose(ends[1], ends[0], rtol=0, atol=2e-10)
    np.testing.assert_allclose(ends[2], ends[0], rtol=0, atol=2e-10)


def test_stiction_holds_without_creep_and_breaks_away():
    r = record(friction=0.25).feel
    state = at(0.0)
    for _ in range(25_000):
        step(r, state, 0.2499, PLC_S)
    assert (state.angle, state.velocity, state.acceleration) == (0.0, 0.0, 0.0)
    step(r, state, 0.2501, PLC_S)
    assert state.angle > 0.0
    assert state.acceleration == pytest.approx(1e-4 / 0.3, rel=0.01)
    back = at(0.0)
    step(r, back, -0.2501, PLC_S)
    assert back.angle == pytest.approx(-state.angle, rel=1e-12)


def test_released_with_friction_it_comes_to_rest_inside_the_stiction_band():
    r = record(friction=2.0).feel
    state = at(0.2)
    for _ in range(25_000):
        step(r, state, 0.0, PLC_S)
    assert state.velocity == 0.0
    assert 0.0 < abs(35.0 * state.angle) <= 2.0


def test_static_torque_over_angle():
    """At rest under a torque, the springs answer with it: neutral offset, centering unit, both limits in series."""
    f = Feel(**{**FULL, "friction": 0.0, "damping": 10.0})
    r = record(**{**FULL, "friction": 0.0, "damping": 10.0}).feel
    for torque in (-60.0, -8.0, -1.0, -0.5, 0.0, 0.5, 1.0, 8.0, 60.0):
        state = at(0.0)
        for _ in range(12_000):
            step(r, state, torque, PLC_S)
        assert torques(f, state.angle, 0.0) == pytest.approx(torque, abs=1e-6)
        if torque == 0.0:
            assert state.angle == pytest.approx(f.neutral, abs=1e-9)
    assert state.angle > f.forward_limit.angle


def test_additional_torques_act_beside_the_pilots():
    p = record(autopilot={"torque": 0.7}, disturbance={"torque": -0.2}, shaker={"torque": 0.4, "frequency": 20.0})
    state = blank(plc.STATE)
    state.torque = 1.0
    model, expected, alone = at(), at(), record().feel
    for k in range(300):
        plc.admittance(p, False, state, model, _PIECE, k * PLC_S, PLC_S)
        torque = 1.0 + 0.7 - 0.2 + 0.4 * math.sin(2 * math.pi * 20.0 * k * PLC_S)
        step(alone, expected, torque, PLC_S)
        assert model.torque == pytest.approx(torque)
    assert (state.set_angle, state.set_velocity) == (model.angle, model.velocity)
    assert model.angle == pytest.approx(expected.angle, rel=1e-12)
