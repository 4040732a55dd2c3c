"""Gearbox: efficiency both ways, stiction, backlash, stiffness, ripple and transmission error."""

import math

import numpy as np
import pytest

from cls_bench.kinematics import crank_from_column, crank_ratio
from cls_bench.parameters import ARCMIN, DEG, Parameters
from cls_bench.plant.gearbox import update_stage
from tests.plant_rig import Element, Run, parameters

BOX = Parameters().gearbox


class GearboxOnly:
    """Both stages from the motor shaft to the crank, as :func:`cls_bench.plant.model.update` wires them."""

    def __init__(self, p: Parameters):
        joints, parts = ("motor", "carrier1", "crank"), ("stage1", "stage2", "stage1_friction", "stage2_friction")
        self.rig = Element(p, joints, parts)
        self.box, self.loss = self.rig.record.gearbox, p.gearbox.mesh_loss
        self.qpos, self.qvel, self.applied = self.rig.data.qpos, self.rig.data.qvel, self.rig.data.qfrc_applied

    def step(self) -> tuple[float, float, float, float]:
        """One plant step; returns twist and torque of stage 1 and of stage 2."""
        plant, d = self.rig.plant, self.rig.dampings
        one = update_stage(plant, self.box, self.box.stage1, self.loss, d.stage1, 0, 0, 0, 0, 1)
        two = update_stage(plant, self.box, self.box.stage2, self.loss, d.stage2, 1, 1, 1, 1, 2)
        self.rig.step()
        return (*one, *two)

    def friction(self) -> np.ndarray:
        """Friction torques of both stages [N·m], opposing motion."""
        return -self.rig.data.actuator_force

    def settle(self, crank_torque: float, seconds: float = 0.15) -> float:
        """Crank angle under a torque that is run up smoothly [rad]; the crank is damped to come to rest."""
        steps = round(seconds / self.rig.model.opt.timestep)
        start = self.applied[2] + 0.5 * self.qvel[2]
        for k in range(steps):
            share = min(2.0 * k / steps, 1.0)
            self.applied[2] = start + (crank_torque - start) * share - 0.5 * self.qvel[2]
            self.step()
        return float(self.qpos[2])


def test_total_backlash_at_the_output_is_under_5_arcmin():
    """Motor shaft held, crank turned to and fro: the play left when the elastic twist is extrapolated away."""
    gears = GearboxOnly(Parameters())
    gears.rig.load(0, 1e3)
    lost = {}
    for torque in (2.0, 4.0, 8.0):
        gears.settle(-torque)
        aft = gears.settle(-torque)
        forward = gears.settle(torque)
        lost[torque] = (forward - aft) / ARCMIN
    play = 2 * lost[4.0] - lost[8.0]
    assert play == pytest.approx(4.0, abs=0.3)
    assert play < 5.0
    # What is left is elastic: 6 N·m/arcmin behind 25 × 1.2 N·m/arcmin, both ways.
    stiffness = 1 / (1 / 6.0 + 1 / 30.0)
    assert lost[8.0] - lost[4.0] == pytest.approx(2 * 4.0 / stiffness, rel=0.05)


def test_the_play_transmits_nothing():
    """Within the dead zone the crank swings freely while the motor side rests."""
    gears = GearboxOnly(Parameters())
    gears.rig.load(0, 1e3)
    gears.qvel[2] = 0.5 * ARCMIN / 0.01
    for _ in range(200):  # half an arc minute in 10 ms
        *_, torque = gears.step()
        assert torque == 0.0
    assert gears.qvel[2] == pytest.approx(0.5 * ARCMIN / 0.01, rel=1e-9)


def test_no_creep_below_breakaway_and_slip_above():
    """90 % of breakaway at the motor shaft: under 1e-6 rad/s; half as much again as both stages' friction: it runs."""
    breakaway = BOX.breakaway_ratio * BOX.stage1.drag
    gears = GearboxOnly(Parameters())
    gears.applied[0] = 0.9 * breakaway
    for _ in range(10_000):
        gears.step()
    before = gears.qpos.copy()
    for _ in range(4_000):
        gears.step()
    assert np.abs((gears.qpos - before) / (4_000 * gears.rig.model.opt.timestep)).max() < 1e-6
    assert np.abs(gears.qvel).max() < 1e-6
    gears.applied[0] = 1.5 * (breakaway + BOX.breakaway_ratio * BOX.stage2.drag / BOX.ratio)
    for _ in range(4_000):
        gears.step()
    assert gears.qvel[0] > 1.0


def test_back_driven_it_holds_below_breakout_and_yields_above():
    """At the crank, motor free: both stages' drag and losses have to be overcome."""
    stage1 = BOX.breakaway_ratio * BOX.stage1.drag
    at_stage2 = stage1 * BOX.ratio + BOX.breakaway_ratio * BOX.stage2.drag
    breakout = at_stage2 * BOX.ratio  # before the load-dependent part, which makes it more
    gears = GearboxOnly(Parameters())
    gears.settle(0.9 * breakout, 0.3)
    before = gears.qpos.copy()
    for _ in range(4_000):
        gears.step()
    assert np.abs((gears.qpos - before) / 0.2).max() < 1e-6
    gears.settle(1.6 * breakout, 0.1)
    assert gears.qvel[0] > 1.0


def steady(gears: GearboxOnly, speed: float, torque: float) -> tuple[float, float]:
    """Mean motor and crank torque [N·m] while the motor shaft turns at ``speed`` [rad/s] against ``torque``."""
    gears.rig.load(0, 1e4)
    gears.qvel[:] = speed, speed / 5, speed / 25
    gears.applied[2] = -torque
    taken, steps = [], round(2 * math.pi / abs(speed) / gears.rig.model.opt.timestep)
    for k in range(2 * steps):  # a revolution to settle, one to measure
        _, mesh, *_ = gears.step()
        if k >= steps:
            taken.append(mesh / 5 + gears.friction()[0])
    assert gears.qvel[0] == pytest.approx(speed, rel=1e-3)
    return float(np.mean(taken)), torque


def test_efficiency_is_085_driving_and_less_back_driven():
    """At 1.0 N·m of motor torque the crank gives 21.25 N·m; carrying as much back, the motor gets less than 85 %."""
    motor, crank = steady(GearboxOnly(Parameters()), 100.0, 21.25)
    assert motor == pytest.approx(1.0, rel=0.01)
    driving = crank / motor / 25
    assert driving == pytest.approx(0.85, rel=0.01)
    motor, crank = steady(GearboxOnly(Parameters()), -100.0, 21.25)
    back = motor * 25 / crank
    assert 0.7 < back < driving - 0.03


def test_efficiency_falls_at_part_load():
    """The drag costs the same at any load."""
    motor, crank = steady(GearboxOnly(Parameters()), 100.0, 4.0)
    assert crank / motor / 25 < 0.70


def test_friction_ripples_with_the_tooth_passing_frequency():
    """18 teeth, sun against carrier: 18 · 4/5 periods in a revolution of the motor shaft; ±25 % at stage 1."""
    gears = GearboxOnly(Parameters())
    gears.rig.load(0, 1e4)
    gears.rig.load(1, 1e4)
    gears.qvel[:] = 100.0, 20.0, 4.0
    steps = round(5 * 2 * math.pi / 100.0 / gears.rig.model.opt.timestep)  # 5 revolutions: 72 periods
    level = []
    for _ in range(steps):
        gears.step()
        level.append(gears.friction()[0])
    level = np.array(level[steps // 50 :])
    assert level.mean() == pytest.approx(BOX.stage1.drag, rel=0.02)
    assert (level.max() - level.min()) / 2 / level.mean() == pytest.approx(0.25, rel=0.05)
    spectrum = np.abs(np.fft.rfft(level - level.mean()))
    assert np.argmax(spectrum) / (len(level) / steps) == pytest.approx(72, abs=1)


def test_transmission_error_shows_at_the_output():
    """Without play and friction, turned slowly under load: the crank runs ahead and behind by the two errors."""
    quiet = {"backlash": 0.0, "drag": 0.0, "ripple": 0.0, "sun_teeth": 18}
    stages = {
        "stage1": {**quiet, "transmission_error": 0.4 * ARCMIN, "stiffness": 1.2 / ARCMIN},
        "stage2": {**quiet, "transmission_error": 0.0, "stiffness": 6.0 / ARCMIN},
    }
    gears = GearboxOnly(parameters(gearbox={**stages, "efficiency": 1.0}))
    gears.rig.load(0, 1e4)
    gears.qvel[:] = 50.0, 10.0, 2.0
    ahead = []
    for _ in range(5_000):
        gears.step()
        ahead.append(gears.qpos[0] / 25 - gears.qpos[2])
    ahead = np.array(ahead[2_500:])
    assert (ahead.max() - ahead.min()) / 2 == pytest.approx(0.4 * ARCMIN / 5, rel=0.1)


def test_a_gear_without_any_drag_is_finite():
    """Friction that vanishes with the load must neither divide by zero nor kick."""
    free = {"backlash": 3 * ARCMIN, "stiffness": 4000.0, "drag": 0.0}
    gears = GearboxOnly(parameters(gearbox={"stage1": free, "stage2": free}))
    for k in range(4_000):
        gears.applied[2] = 5.0 * math.sin(2 * math.pi * 10 * k * gears.rig.model.opt.timestep)
        gears.step()
        assert np.abs(gears.friction()).max() < 0.5
    assert np.isfinite(gears.qpos).all()


STATIC = """
duration = 7.0
[parameters.plc]
following_error_limit = 10.0
[parameters.limb]
arm_stiffness = 2e5
arm_damping = 400.0
[[squeeze]]
at = 0.0
value = 1.0
[[changes]]
at = 0.0
mode = "torque"
[[hand]]
at = 0.0
kind = "ramp"
to_deg = -5.0
over = 0.5
smooth = true
[[changes]]
at = 0.8
parameters = {"drive.set_torque" = 1.0}
[[hand]]
at = 1.0
kind = "ramp"
to_deg = 5.0
over = 2.5
[[hand]]
at = 4.0
kind = "ramp"
to_deg = -5.0
over = 2.5
"""


def test_at_stall_torque_the_column_gives_37_2_nm():
    """Thesis 3.2.2: 1.0 N·m · 25 · 0.85 · 1.75 = 37.19 N·m, 124.0 N at the grip, while the motor slowly drives."""
    run = Run(STATIC, "encoder.noise=0.0")  # whose noise is a dither of 1e-4 N·m at standstill
    assert not [event for event in run.events if event.level != "info"]
    assert run.during("/drive.torque", 1.0, 6.9) == pytest.approx(1.0, rel=0.01)
    bar = Parameters().linkage.four_bar

    def column_torque(start: float, end: float) -> float:
        """Mean torque on the hand, brought to the linkage ratio of neutral."""
        angle = run.during("/column.angle", start, end)
        ratio = [crank_ratio(bar, crank_from_column(bar, x), x) for x in angle[::20]]
        return float(np.mean(-run.during("/column.torque", start, end)[::20] / ratio) * 1.75)

    driving, back_driven = column_torque(1.2, 3.4), column_torque(4.2, 6.4)
    assert run.during("/column.velocity", 1.2, 3.4).mean() == pytest.approx(10 * DEG / 2.5, rel=0.01)
    assert driving == pytest.approx(37.2, rel=0.03)
    assert driving / 0.3 == pytest.approx(124.0, rel=0.03)
    assert -run.during("/pilot.hand_force", 1.2, 3.4).mean() == pytest.approx(124.0, rel=0.03)
    # Back-driven, the friction helps the motor to hold: efficiency below that of driving.
    assert 43.75 / back_driven < driving / 43.75 - 0.02
    # At standstill nothing creeps, and the torque may lie anywhere between the two.
    still = run.during("/column.velocity", 3.9, 4.0)
    assert np.abs(still).max() < 1e-6
    assert driving * 0.95 < -run.during("/column.torque", 3.9, 4.0).mean() < back_driven
