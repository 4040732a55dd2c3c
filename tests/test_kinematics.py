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
from cls_bench.resources import model_folder
from cls_bench.verification.subject import Feedback, Specimen
from tests.running import parameters

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
def linkage() -> Specimen:
    """Crank and column as they are stepped, coupled by the rod alone; without damping its force is its stretch."""
    return Specimen(parameters({"load_cell.damping_ratio": 0.0}), ("crank", "column"), ("stage1", "stage2", "bearing"))


def column_of_stretched_rod(crank: float, stretch: float) -> float:
    """Column angle with the rod longer by the load cell's deflection [m], the axes staying where they are."""

    def open_by(column: float) -> float:
        x = BAR.arm * math.sin(column) + BAR.rod - BAR.crank * math.sin(crank)
        z = BAR.arm * math.cos(column) - BAR.arm + BAR.crank - BAR.crank * math.cos(crank)
        return math.hypot(x, z) - (BAR.rod + stretch)

    return float(brentq(open_by, -0.6, 0.6, xtol=1e-15))


def test_the_drawn_model_closes_at_the_closed_form():
    """The model that viewers open, over the travel: its closing constraint is met."""
    model = mujoco.MjModel.from_xml_path(str(model_folder() / "scene.xml"))
    data = mujoco.MjData(model)
    for x in COLUMN:
        crank = crank_from_column(BAR, x)
        data.joint("crank").qpos, data.joint("column").qpos = crank, x
        data.joint("rod").qpos = rod_angle(BAR, crank, x) - crank
        mujoco.mj_forward(model, data)
        assert np.abs(data.efc_pos[: data.nefc]).max() < 1e-12


@pytest.mark.parametrize(("frequency", "load"), [(0.5, 0.0), (0.5, 260.0), (2.0, 0.0)])
def test_the_stepped_linkage_agrees_with_the_closed_form_while_moving(linkage, frequency, load):
    """Over the whole travel, slowly, under peak load (260 N·m at the column) and at 2 Hz: crank, stretch and column."""
    time = linkage.times(1 / frequency)
    grown = np.minimum(time / 0.05, 1.0)
    crank = grown * [crank_from_column(BAR, x) for x in TRAVEL * np.sin(2 * math.pi * frequency * time)]
    record = linkage.run(
        time, {"column": grown * load},
        feedback={"crank": Feedback(2e4, 5.0), "column": Feedback(0.0, 2.0 if load else 0.0)}, target={"crank": crank},
    )  # fmt: skip
    column, stretch = record.angle["column"], record.signal["rod_force"] / Parameters().load_cell.stiffness
    for k in range(50, len(time) - 1, 50):
        assert column[k] == pytest.approx(column_of_stretched_rod(record.angle["crank"][k], stretch[k]), abs=1e-9)
    assert np.abs(record.angle["crank"] - crank).max() < 0.02
    assert column.max() > 0.9 * TRAVEL
    assert column.min() < -0.9 * TRAVEL
