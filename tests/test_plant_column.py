"""Column: bearing, unbalance, limit switches, stop blocks."""

import mujoco
import numpy as np
import pytest

from cls_bench.parameters import DEG, GRAVITY, Parameters
from cls_bench.plant import friction
from cls_bench.plant.model import BEARING_STRIBECK, static_unbalance
from cls_bench.plant.play import set_play
from tests.plant_rig import Element, Run

P = Parameters()


class ColumnOnly:
    """The column on its bearing, between its stop blocks."""

    def __init__(self) -> None:
        self.rig = Element(P, ("column",), ("stop_blocks", "column_bearing"))
        self.qpos, self.qvel, self.applied = self.rig.data.qpos, self.rig.data.qvel, self.rig.data.qfrc_applied

    def step(self) -> float:
        """One plant step; returns the stop blocks' torque on the column [N·m]."""
        plant, c = self.rig.plant, P.column
        torque = set_play(plant, 0, self.qpos[0], self.qvel[0], -c.stop_angle, c.stop_angle, self.rig.dampings.stop)
        friction.set_level(
            plant, 0, 0, self.qvel[0], c.coulomb_friction, 1.0, self.rig.dampings.bearing, BEARING_STRIBECK
        )
        self.rig.step()
        return -torque


def test_bearing_slows_the_column_by_coulomb_and_viscous_friction():
    """I φ̈ = −μ − d φ̇ solved in closed form, from 1 rad/s at neutral."""
    column = ColumnOnly()
    column.qvel[0] = 1.0
    inertia, mu, d = P.column.inertia, P.column.coulomb_friction, P.column.viscous_friction
    for _ in range(4_000):
        column.step()
        column.qpos[0] = 0.0  # keeps clear of the stops
    exact = (1.0 + mu / d) * np.exp(-d / inertia * column.rig.data.time) - mu / d
    assert column.qvel[0] == pytest.approx(exact, rel=2e-3)


def test_bearing_sticks():
    column = ColumnOnly()
    for _ in range(10_000):  # brought to rest from outside: on its bristles alone it rings for seconds
        column.applied[0] = 0.9 * P.column.coulomb_friction - 2.0 * column.qvel[0]
        column.step()
    column.applied[0] = 0.9 * P.column.coulomb_friction
    before = column.qpos[0]
    for _ in range(4_000):
        column.step()
    assert abs(column.qpos[0] - before) / 0.2 < 1e-6
    column.applied[0] = 1.2 * P.column.coulomb_friction
    for _ in range(4_000):
        column.step()
    assert column.qvel[0] > 0.01


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_stop_blocks_hold_beyond_the_travel_and_never_pull(way):
    """Pushed with 90 N·m (300 N at the grip): free up to 22.5°, then the blocks' stiffness; thrown back, no pull."""
    column = ColumnOnly()
    stop, stiffness = P.column.stop_angle, P.column.stop_stiffness
    column.qpos[0] = way * 22.4 * DEG
    assert column.step() == 0.0
    column.applied[0] = way * 90.0
    for _ in range(20_000):
        assert column.step() * way <= 0.0
    reach = (90.0 - P.column.coulomb_friction * np.array([-1, 1])) / stiffness
    assert reach.min() - 1e-6 < abs(column.qpos[0]) - stop < reach.max() + 1e-6
    column.applied[0] = 0.0
    for _ in range(4_000):
        assert column.step() * way <= 0.0
    assert abs(column.qpos[0]) < stop


def test_order_of_travel_switches_and_stops():
    assert pytest.approx(P.column.travel) == 20 * DEG
    assert P.column.travel < P.column.switch_angle < P.column.stop_angle


def test_limit_switch_takes_the_torque_off():
    """Pushed past 21° against a soft feel model, the drive lets go; the column stops at the blocks."""
    run = Run(
        """
        duration = 1.2
        [drive]
        power = "on"
        [[squeeze]]
        at = 0.0
        value = 1.0
        [[hand]]
        at = 0.0
        kind = "ramp"
        to_deg = 25.0
        over = 0.8
        """,
        "limb.arm_stiffness=1e5", "limb.arm_damping=500.0", "feel.forward_limit.stiffness=0.0",
        "feel.aft_limit.stiffness=0.0", "plc.following_error_limit=1.0",
    )  # fmt: skip
    trips = [event for event in run.events if event.source == "safety"]
    assert [event.message for event in trips] == ["safe torque off: limit switch open"]
    angle = run["/column.angle"]
    at = angle[trips[0].tick]
    assert P.column.switch_angle <= at < P.column.switch_angle + 0.5 * DEG  # within a PLC cycle
    assert np.all(run.during("/drive.torque", trips[0].time + 1e-3, 1.2) == 0.0)
    assert P.column.stop_angle < angle.max() < 24 * DEG


def test_unbalance_is_what_gravity_does():
    """Torque that holds column and rod at an angle, from MuJoCo's gravity, against the line the PLC subtracts.

    The rod end and the rod's share at the column joint hang on the column; the crank carries the rest.
    """
    rig = Element(P, ("column",))
    rig.model.opt.gravity[2] = -GRAVITY
    hanging = P.linkage.rod_column_mass * P.linkage.arm * GRAVITY
    for angle in np.linspace(-20, 20, 9) * DEG:
        rig.data.qpos[0] = angle
        mujoco.mj_forward(rig.model, rig.data)
        total = -rig.data.qfrc_bias[0] + hanging * np.sin(angle)
        assert static_unbalance(P) * angle == pytest.approx(total, abs=0.01)


def test_the_plc_removes_the_unbalance():
    """Hands off, held by the drive 10° off neutral: what is left of the measured torque is the bearing's friction."""
    run = Run('duration = 1.5\n[drive]\npower = "on"\n', f"feel.neutral={10 * DEG}", "feel.friction=0.0")
    assert run.during("/column.angle", 1.4, 1.5).mean() == pytest.approx(10 * DEG, abs=0.2 * DEG)
    raw = run.during("/load_cell.force", 1.4, 1.5).mean() * P.linkage.arm
    assert abs(raw) > 0.25  # 0.3 N·m of unbalance, before
    assert abs(run.during("/load_cell.torque", 1.4, 1.5).mean()) < P.column.coulomb_friction + 0.02
