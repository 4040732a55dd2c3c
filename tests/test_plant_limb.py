"""Limb and grip: from loose to rigid, letting go and gripping again while the simulation runs."""

import numpy as np
import pytest

from cls_bench.parameters import DEG, Parameters
from cls_bench.plant.limb import grip_force, update_grip
from tests.plant_rig import Element, Run, parameters

P = Parameters()
AREA = P.column.grip_height**2

SHAKE = """
duration = 1.0
[drive]
power = "on"
[[hand]]
at = 0.0
kind = "sine"
amplitude_deg = 8.0
frequency = 2.0
fade = 0.2
"""


def grip_alone(p: Parameters = P) -> Element:
    """Forearm and column, coupled by the grip alone."""
    rig = Element(p, ("column", "limb"), ("grip",))
    rig.model.tendon_stiffness[0] = rig.model.tendon_damping[0] = 0.0
    return rig


def set_grip(rig: Element, squeeze: float, attached: bool = True) -> float:
    """Apply a squeeze; returns the torque on the column [N·m]."""
    update_grip(rig.plant, rig.record.limb, P.column.grip_height, attached, squeeze, 0, 1, 0)
    return grip_force(rig.plant, 0, 1, 0)


@pytest.mark.parametrize(
    ("squeeze", "stiffness", "damping"),
    [(0.0, 800.0, 10.0), (0.5, (800.0 * 2e6) ** 0.5, (10.0 * 150.0) ** 0.5), (1.0, 2.0e6, 150.0)],
)
def test_squeeze_runs_from_loose_to_tight(squeeze, stiffness, damping):
    rig = grip_alone()
    set_grip(rig, squeeze)
    assert rig.model.tendon_stiffness[0] == pytest.approx(stiffness * AREA)
    assert rig.model.tendon_damping[0] == pytest.approx(damping * AREA)
    rig.data.qpos[1] = 0.001
    assert grip_force(rig.plant, 0, 1, 0) == pytest.approx(0.001 * stiffness * AREA)


def test_a_damping_of_zero_is_allowed():
    rig = grip_alone(parameters(limb={"loose_damping": 0.0}))
    set_grip(rig, 0.0)
    assert rig.model.tendon_damping[0] == 0.0
    set_grip(rig, 0.5)
    assert rig.model.tendon_damping[0] == pytest.approx(75.0 * AREA)


def test_no_force_jumps_when_the_squeeze_does():
    """Grip stretched and moving: the force is the same before and after any jump of the squeeze, and in MuJoCo too."""
    rig = grip_alone()
    rig.model.dof_damping[:] = 0.0  # the bearing's
    assert set_grip(rig, 0.2) == 0.0
    rig.data.qpos[1], rig.data.qvel[:] = 0.02, (-0.1, 0.4)
    before = grip_force(rig.plant, 0, 1, 0)
    assert before > 1.0
    for squeeze in (1.0, 0.0, 0.7):
        assert set_grip(rig, squeeze) == pytest.approx(before, rel=1e-9)
    rig.step()
    assert rig.data.qfrc_passive[0] == pytest.approx(before, rel=1e-6)
    assert rig.data.qfrc_passive[1] == pytest.approx(-before, rel=1e-6)


def test_it_grabs_without_a_force_wherever_the_hand_is():
    rig = grip_alone()
    rig.data.qpos[:], rig.data.qvel[:] = (0.1, -0.2), (1.0, -1.0)
    assert set_grip(rig, 0.0, attached=False) == 0.0
    assert set_grip(rig, 0.8) == pytest.approx(0.0, abs=1e-9)


def test_loose_leaves_the_forearm_behind_and_tight_carries_it():
    """Amplitude of the forearm's mass, column shaken at 20 Hz: soft spring or rigid connection (thesis 3.4.4)."""
    moved = {}
    for squeeze in (0.0, 1.0):
        rig = grip_alone()
        set_grip(rig, squeeze)
        reach = []
        for k in range(10_000):
            rig.data.qpos[0] = 0.02 * np.sin(2 * np.pi * 20 * k * rig.model.opt.timestep)
            rig.data.qvel[0] = 0.02 * 2 * np.pi * 20 * np.cos(2 * np.pi * 20 * k * rig.model.opt.timestep)
            set_grip(rig, squeeze)
            rig.step()
            reach.append(rig.data.qpos[1])
        moved[squeeze] = np.ptp(reach[5_000:]) / 0.04
    assert moved[0.0] < 0.15
    assert moved[1.0] == pytest.approx(1.0, abs=0.05)


def test_squeezing_in_mid_run_is_smooth_and_ends_rigid():
    run = Run(SHAKE + "[[squeeze]]\nat = 0.5\nvalue = 1.0\n")
    torque = run["/column.torque"]
    at = round(0.5 / 5e-5)
    assert abs(torque[at] - torque[at - 1]) < 0.02  # in one tick, squeezed from 0 to 1 at once
    assert np.ptp(torque) > 2.0
    slip = run.during("/pilot.limb_angle", 0.6, 1.0) - run.during("/column.angle", 0.6, 1.0)[::4]
    assert np.ptp(slip) < 0.005 * DEG
    assert run["/pilot.squeeze"][[0, -1]] == pytest.approx([0.0, 1.0])


def test_letting_go_takes_the_force_away_at_once():
    run = Run(SHAKE + '[[hand]]\nat = 0.6\nkind = "release"\n[[hand]]\nat = 0.8\nkind = "hold"\n')
    assert np.abs(run.during("/column.torque", 0.5, 0.6)).max() > 0.5
    assert np.all(run.during("/column.torque", 0.6, 0.8) == 0.0)
    assert np.all(run.during("/pilot.squeeze", 0.6, 0.8) == -1.0)
    assert np.ptp(run.during("/column.angle", 0.6, 0.8)) > 1 * DEG  # it swings on by itself
    again = run.during("/column.torque", 0.8, 1.0)
    assert abs(again[0]) < 1e-9
    assert np.abs(again).max() > 0.01


def test_grip_can_change_while_the_simulation_runs():
    run = Run(SHAKE + '[[changes]]\nat = 0.5\nparameters = {"limb.loose_stiffness" = 8000.0}\n')
    torque = run["/column.torque"]
    at = round(0.5 / 5e-5)
    assert abs(torque[at] - torque[at - 1]) < 0.02
    assert run.bench.model.tendon_stiffness[1] == pytest.approx(8000.0 * AREA)


def test_the_forearms_mass_can_change_while_the_simulation_runs():
    """In the rigid grip, 0.6 s after the change: as if it had been so from the start."""
    shake = SHAKE + "[[squeeze]]\nat = 0.0\nvalue = 1.0\n"
    force = [
        run.during("/pilot.hand_force", 0.8, 1.0)
        for run in (
            Run(shake),
            Run(shake + '[[changes]]\nat = 0.2\nparameters = {"limb.mass" = 1.2}\n'),
            Run(shake, "limb.mass=1.2"),
        )
    ]
    assert np.std(force[1] - force[0]) > 0.02 * np.std(force[0])
    assert np.std(force[1] - force[2]) < 0.15 * np.std(force[1] - force[0])
