"""Linkage and load cell in MuJoCo: statics against virtual work, and how far the closing joint opens."""

import math
from itertools import pairwise

import mujoco
import numpy as np
import pytest

from cls_bench.kinematics import crank_from_column, crank_ratio, rod_angle
from cls_bench.parameters import DEG, Parameters
from tests.plant_rig import Element

P = Parameters()
BAR = P.linkage.four_bar
CRANK, ROD, CELL, COLUMN = range(4)


def loaded(angle: float, torque: float) -> Element:
    """The linkage at rest at a column angle [rad], the crank held there, with ``torque`` [N·m] on the column."""
    rig = Element(P, ("crank", "rod", "load_cell", "column"), ("linkage_closure",))
    m, d = rig.model, rig.data
    crank = crank_from_column(BAR, angle)
    d.qpos[:] = crank, rod_angle(BAR, crank, angle) - crank, 0.0, angle
    m.dof_damping[CELL] = 2e3  # to come to rest soon
    for k in range(6_000):
        d.qfrc_applied[CRANK] = -1e5 * (d.qpos[CRANK] - crank) - 50.0 * d.qvel[CRANK]
        d.qfrc_applied[COLUMN] = min(k / 2_000, 1.0) * torque - 2.0 * d.qvel[COLUMN]
        mujoco.mj_step(m, d)
    return rig


@pytest.mark.parametrize("degrees", [-20, -7, 0, 12, 20])
def test_cell_and_crank_carry_what_virtual_work_says(degrees):
    """30 N·m on the column: rod force T / (r cos(φ − φ_co)), crank torque T / i."""
    rig = loaded(degrees * DEG, 30.0)
    d = rig.data
    column, crank = d.qpos[COLUMN], d.qpos[CRANK]
    inclination = d.qpos[ROD] + crank
    force = P.load_cell.stiffness * d.qpos[CELL]
    assert force == pytest.approx(30.0 / (BAR.arm * math.cos(column - inclination)), rel=1e-3)
    assert -d.qfrc_applied[CRANK] == pytest.approx(30.0 / crank_ratio(BAR, crank, column), rel=1e-3)


@pytest.mark.parametrize("degrees", [-20, 0, 20])
def test_the_closing_joint_opens_by_nanometres_under_peak_load(degrees):
    """260 N·m at the column, as 6 N·m of the motor make: 1500 N in the rod."""
    rig = loaded(degrees * DEG, 260.0)
    assert P.load_cell.stiffness * rig.data.qpos[CELL] > 1450.0
    mujoco.mj_forward(rig.model, rig.data)
    assert np.abs(rig.data.efc_pos[: rig.data.nefc]).max() < 1e-8


def test_load_cell_is_an_elastic_element_with_a_ringing_column():
    """Crank held, column struck: it rings on the cell at √(k r² / I), with 2 % of critical damping."""
    rig = Element(P, ("crank", "rod", "load_cell", "column"), ("linkage_closure",))
    rig.load(CRANK, 1e3)
    m, d = rig.model, rig.data
    m.dof_damping[COLUMN] = 0.0
    d.qvel[COLUMN] = 0.05
    d.qvel[CELL] = 0.05 * BAR.arm
    stretch = []
    for _ in range(4_000):
        rig.step()
        stretch.append(d.qpos[CELL])
    stretch = np.array(stretch)
    crossings = np.flatnonzero(np.diff(np.signbit(stretch)))
    period = 2 * (crossings[20] - crossings[0]) / 20 * m.opt.timestep
    inertia = P.column.inertia + P.linkage.rod_end_mass * BAR.arm**2
    exact = 2 * math.pi * math.sqrt(inertia / (P.load_cell.stiffness * BAR.arm**2))
    assert period == pytest.approx(exact, rel=0.01)
    peaks = [np.abs(stretch[a:b]).max() for a, b in pairwise(crossings)]
    ratio = -math.log(peaks[20] / peaks[0]) / 20 / math.pi
    assert ratio == pytest.approx(P.load_cell.damping_ratio, rel=0.1)
