"""Column: bearing, unbalance, limit switches, stop blocks."""

import math

import numpy as np
import pytest

from cls_bench.kinematics import crank_from_column, joints
from cls_bench.parameters import DEG, GRAVITY, Parameters
from cls_bench.parameters.nameplate import static_unbalance
from cls_bench.verification.rigs import rigs
from cls_bench.verification.subject import Feedback, Specimen
from tests.running import run

P = Parameters()
INERTIA = P.column.inertia + P.linkage.rod_end_mass * P.linkage.arm**2


def column_alone(p: Parameters = P, *without: str) -> Specimen:
    """The column with the rod end on its bearing, between its stop blocks; the rod is off."""
    return Specimen(p, ("column",), ("rod", "weight", *without))


def test_bearing_slows_the_column_by_coulomb_and_viscous_friction():
    """I φ̈ = −μ − d φ̇ solved in closed form, from 1 rad/s through the travel."""
    column = column_alone()
    column.place(column=-20 * DEG)
    column.push(column=1.0)
    mu, d = P.column.coulomb_friction, P.column.viscous_friction
    record = column.run(column.times(0.35))
    exact = (1.0 + mu / d) * np.exp(-d / INERTIA * record.time) - mu / d
    sliding = record.time > 0.01  # bristles bent
    np.testing.assert_allclose(record.velocity["column"][sliding], exact[sliding], atol=2e-3)
    assert record.velocity["column"][-1] < 0.6


def test_bearing_sticks():
    column, mu = column_alone(), P.column.coulomb_friction
    time = column.times(0.5)
    # Brought to rest from outside: on its bristles alone it rings for seconds.
    column.run(time, {"column": 0.9 * mu}, feedback={"column": Feedback(damping=2.0)})
    still = column.run(column.times(0.2), {"column": 0.9 * mu})
    assert abs(still.final["column"][0] - still.angle["column"][0]) / 0.2 < 1e-6
    assert column.run(column.times(0.2), {"column": 1.2 * mu}).final["column"][1] > 0.01


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_stop_blocks_hold_beyond_the_travel_and_never_pull(way):
    """Pushed with 90 N·m (300 N at the grip): free up to 22.5°, then the blocks' stiffness; thrown back, no pull."""
    c = P.column
    column = column_alone(P, "bearing")

    def block(record) -> np.ndarray:
        """Torque of the stop blocks: what the motion says beside what was put on [N·m]."""
        speed = np.append(record.velocity["column"], record.final["column"][1])
        return np.diff(speed) * INERTIA / column.step

    column.place(column=way * 22.4 * DEG)
    assert np.abs(block(column.run(np.zeros(1)))).max() < 1e-8
    record = column.run(column.times(1.0), {"column": way * 90.0})
    assert ((block(record) - way * 90.0) * way <= 1e-8).all()
    assert abs(record.final["column"][0]) == pytest.approx(c.stop_angle + 90.0 / c.stop_stiffness, abs=1e-6)
    record = column.run(column.times(0.2))
    torque = block(record) * way
    assert (torque <= 1e-8).all() and torque.min() < -80.0
    assert abs(record.final["column"][0]) < c.stop_angle


def test_order_of_travel_switches_and_stops():
    assert pytest.approx(P.column.travel) == 20 * DEG
    assert P.column.travel < P.column.switch_angle < P.column.stop_angle


def test_limit_switch_takes_the_torque_off():
    """Pushed past 21° against a soft feel model, the drive lets go; the column stops at the blocks."""
    ran = run(
        'squeeze = [{at = 0.0, value = 1.0}]\nhand = [{at = 0.0, kind = "ramp", to_deg = 25.0, over = 0.8}]',
        duration=1.2, seed=3, set=[
            "limb.arm_stiffness=1e5", "limb.arm_damping=500.0", "feel.forward_limit.stiffness=0.0",
            "feel.aft_limit.stiffness=0.0", "plc.following_error_limit=1.0",
        ],
    )  # fmt: skip
    trips = [event for event in ran.events if event.source == "safety"]
    assert [event.message for event in trips] == ["safe torque off: limit switch open"]
    angle = ran["/column.angle"]
    at = angle[trips[0].tick]
    assert P.column.switch_angle <= at < P.column.switch_angle + 0.5 * DEG  # within a PLC cycle
    assert not ran.between("/drive.torque", trips[0].time + 1e-3, 1.2).any()
    assert P.column.stop_angle < angle.max() < 24 * DEG


@pytest.mark.parametrize("name", list(rigs()))
def test_unbalance_is_what_gravity_does(name):
    """Torque of all weights on the column at rest, by free-body statics, and the line the PLC subtracts for it.

    The far share of the rod's mass leans on the column's pin across the rod, and on the crank's pin along it. The PLC's
    line, and that it takes the whole of that weight as the column's, cost 0.021 N·m at full travel where arm and rod
    stand upright and level at neutral.
    """
    p = rigs()[name]
    bar, (_, far, end), c = p.linkage.four_bar, p.linkage.masses, p.column
    rig = Specimen(p, ("column",), ("bearing",))
    for angle in np.linspace(-1.0, 1.0, 9) * c.travel:
        crank = crank_from_column(bar, angle)
        rig.reset()
        rig.place(column=angle, crank=crank)
        record = rig.run(np.zeros(1))
        far_on_column = float(rig.plant.armature[rig.joints.index("column")])
        pushed = record.final["column"][1] / rig.step * float(rig.model.joint("column").M0[0] + far_on_column)
        rod = -float(record.signal["rod_force"][0]) * float(rig.truth.body.along_column)
        weights = pushed - rod
        arm = angle + bar.arm_angle
        expected = GRAVITY * (c.mass * c.mass_height * math.sin(angle) + end * bar.arm * math.sin(arm))
        if far:
            x1, z1, x2, z2 = joints(bar, crank, angle)
            across = np.array([z1 - z2, x2 - x1]) / math.hypot(x2 - x1, z2 - z1)  # upwards where the rod is level
            force = -far * GRAVITY * across[1] * across
            expected += z2 * force[0] - x2 * force[1]
        assert weights == pytest.approx(expected, abs=2e-4)
        if bar.arm_angle == bar.rod_angle == 0.0:
            assert static_unbalance(c, p.linkage) * angle == pytest.approx(weights, abs=0.022)


def test_the_plc_removes_the_unbalance():
    """Hands off, held by the drive 10° off neutral: what is left of the measured torque is the bearing's friction."""
    ran = run(duration=1.5, seed=3, set=[f"feel.neutral={10 * DEG}", "feel.friction=0.0"])
    assert ran.between("/column.angle", 1.4, 1.5).mean() == pytest.approx(10 * DEG, abs=0.2 * DEG)
    raw = ran.between("/load_cell.force", 1.4, 1.5).mean() * P.linkage.arm
    assert abs(raw) > 0.25  # 0.3 N·m of unbalance, before
    assert abs(ran.between("/load_cell.torque", 1.4, 1.5).mean()) < P.column.coulomb_friction + 0.02
