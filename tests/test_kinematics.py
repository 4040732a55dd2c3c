"""Four-bar linkage: closed form against the constraint solved numerically, MuJoCo, and finite differences."""

import math

import mujoco
import numpy as np
import pytest
from scipy.optimize import brentq

from cls_bench.control.kinematic_chain import column_from_motor, motor_from_column
from cls_bench.kinematics import (
    FourBar,
    column_from_crank,
    crank_curvature,
    crank_from_column,
    crank_ratio,
    fit_polynomials,
    polynomial,
    rod_angle,
)
from cls_bench.parameters import DEG, Parameters
from tests.plant_rig import Element

BAR = Parameters().linkage.four_bar
TRAVEL = 20.0 * DEG
COLUMN = np.linspace(-TRAVEL, TRAVEL, 81)
POLY = fit_polynomials(BAR, 24.0 * DEG, Parameters().plc.polynomial_degree)


def gap(bar: FourBar, crank: float, column: float) -> float:
    """|C2 − C1| − rod (thesis Eq. 3.4)."""
    x = bar.arm * math.sin(column) + bar.rod - bar.crank * math.sin(crank)
    z = bar.arm * math.cos(column) - bar.arm + bar.crank - bar.crank * math.cos(crank)
    return math.hypot(x, z) - bar.rod


def test_linkage_ratio_is_1750_at_neutral():
    assert crank_from_column(BAR, 0.0) == pytest.approx(0.0, abs=1e-15)
    assert crank_ratio(BAR, 0.0, 0.0) == pytest.approx(1.750, abs=1e-12)


@pytest.mark.parametrize("bar", [BAR, FourBar(0.12, 0.30, 0.12), FourBar(0.15, 0.25, 0.10)])
def test_closed_form_solves_the_constraint(bar):
    """Against a root search on Eq. 3.4, which knows nothing of the closed form."""
    for column in np.linspace(-0.3, 0.3, 31):
        exact = brentq(lambda crank, column=column: gap(bar, crank, column), -1.1, 1.1, xtol=1e-14)
        assert crank_from_column(bar, column) == pytest.approx(exact, abs=1e-12)
        assert column_from_crank(bar, exact) == pytest.approx(column, abs=1e-12)


def test_a_linkage_that_cannot_close_is_nan():
    short = FourBar(0.05, 0.209, 0.175)  # the crank would have to pass its dead centre
    assert math.isnan(crank_from_column(short, 1.2))
    with pytest.raises(ValueError, match=r"cannot be closed over ±68\.8°"):
        fit_polynomials(short, 1.2, 9)


def test_derivatives_are_those_of_the_closed_form():
    h = 1e-5
    for x in COLUMN:
        crank = crank_from_column(BAR, x)
        before, after = crank_from_column(BAR, x - h), crank_from_column(BAR, x + h)
        assert crank_ratio(BAR, crank, x) == pytest.approx((after - before) / (2 * h), abs=1e-8)
        slope = (crank_ratio(BAR, after, x + h) - crank_ratio(BAR, before, x - h)) / (2 * h)
        assert crank_curvature(BAR, crank, x) == pytest.approx(slope, abs=1e-7)


def test_polynomials_stand_for_the_closed_form_both_ways():
    for x in COLUMN:
        crank = crank_from_column(BAR, x)
        ratio, curvature = crank_ratio(BAR, crank, x), crank_curvature(BAR, crank, x)
        assert polynomial(POLY.crank, x) == pytest.approx(crank, abs=1e-4)
        assert polynomial(POLY.column, crank) == pytest.approx(x, abs=1e-4)
        assert polynomial(POLY.rod, x) == pytest.approx(rod_angle(BAR, crank, x), abs=1e-4)
        assert polynomial(POLY.ratio, x) == pytest.approx(ratio, abs=1e-3)
        assert polynomial(POLY.inverse_ratio, crank) == pytest.approx(1 / ratio, abs=1e-3)
        assert polynomial(POLY.curvature, x) == pytest.approx(curvature, abs=2e-2)
        assert polynomial(POLY.inverse_curvature, crank) == pytest.approx(-curvature / ratio**3, abs=2e-2)


def test_the_chain_transforms_position_velocity_and_acceleration():
    """A motion of the column through the chain, against finite differences of the exact motor angle."""
    h, ratio = 1e-4, 25.0

    def motion(t: float) -> tuple[float, float, float]:
        w = 2 * math.pi
        return 0.3 * math.sin(w * t), 0.3 * w * math.cos(w * t), -0.3 * w * w * math.sin(w * t)

    for t in np.linspace(0.0, 1.0, 41):
        angles = [ratio * crank_from_column(BAR, motion(t + k * h)[0]) for k in (-1, 0, 1)]
        velocity, acceleration = (angles[2] - angles[0]) / (2 * h), (angles[2] - 2 * angles[1] + angles[0]) / h**2
        at = motor_from_column(POLY, ratio, *motion(t))
        assert at[0] == pytest.approx(angles[1], abs=ratio * 1e-4)
        assert at[1] == pytest.approx(velocity, abs=0.02)  # of 82 rad/s
        assert at[2] == pytest.approx(acceleration, abs=1.0)  # of 540 rad/s²
        column, speed = column_from_motor(POLY, ratio, angles[1], velocity)
        assert (column, speed) == pytest.approx(motion(t)[:2], rel=1e-3, abs=1e-4)


def test_the_way_back_transforms_accelerations_too():
    h = 1e-4
    for crank in np.linspace(-0.55, 0.55, 23):
        before, here, after = (column_from_crank(BAR, crank + k * h) for k in (-1, 0, 1))
        assert polynomial(POLY.inverse_curvature, crank) == pytest.approx((after - 2 * here + before) / h**2, abs=1e-3)


@pytest.fixture
def linkage() -> Element:
    """Crank, rod, load cell and column, closed; without bearing friction."""
    return Element(Parameters(), ("crank", "rod", "load_cell", "column"), ("linkage_closure",))


def column_of_stretched_rod(crank: float, stretch: float) -> float:
    """Column angle with the rod longer by the load cell's deflection [m], the axes staying where they are."""

    def open_by(column: float) -> float:
        x = BAR.arm * math.sin(column) + BAR.rod - BAR.crank * math.sin(crank)
        z = BAR.arm * math.cos(column) - BAR.arm + BAR.crank - BAR.crank * math.cos(crank)
        return math.hypot(x, z) - (BAR.rod + stretch)

    return float(brentq(open_by, -0.6, 0.6, xtol=1e-15))


def test_mujoco_closes_the_linkage_at_the_closed_form(linkage):
    for x in COLUMN:
        crank = crank_from_column(BAR, x)
        linkage.data.qpos[:] = crank, rod_angle(BAR, crank, x) - crank, 0.0, x
        mujoco.mj_forward(linkage.model, linkage.data)
        assert np.abs(linkage.data.efc_pos[: linkage.data.nefc]).max() < 1e-12


@pytest.mark.parametrize(("frequency", "load"), [(0.5, 0.0), (0.5, 260.0), (2.0, 0.0)])
def test_mujoco_agrees_with_the_closed_form_while_moving(linkage, frequency, load):
    """Over the whole travel, slowly, under peak load (260 N·m at the column) and at 2 Hz: the connect's residual."""
    m, d = linkage.model, linkage.data
    reached: list[float] = []
    for k in range(round(1 / frequency / m.opt.timestep)):
        phase = min(k * m.opt.timestep / 0.05, 1.0)
        crank = phase * crank_from_column(BAR, TRAVEL * math.sin(2 * math.pi * frequency * k * m.opt.timestep))
        mujoco.mj_step1(m, d)
        d.qfrc_applied[0] = -1e5 * (d.qpos[0] - crank) - 40.0 * d.qvel[0]
        d.qfrc_applied[3] = phase * load - 2.0 * d.qvel[3] * (load > 0)
        if k % 50 == 0:
            assert d.qpos[3] == pytest.approx(column_of_stretched_rod(d.qpos[0], d.qpos[2]), abs=1e-6)
            reached.append(d.qpos[3])
        mujoco.mj_step2(m, d)
    assert max(reached) > 0.9 * TRAVEL
    assert min(reached) < -0.9 * TRAVEL
    assert d.warning.number.sum() == 0
