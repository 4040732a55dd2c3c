"""Limb and grip: from loose to rigid, letting go and gripping again while the simulation runs."""

import math

import numpy as np
import pytest

from cls_bench.parameters import DEG, Parameters
from cls_bench.plant import limb
from cls_bench.verification.subject import Feedback, Hand, Specimen
from tests.running import parameters, run

P = Parameters()
AREA = P.column.grip_height**2
FOREARM = 1.8 * 0.3**2
"""Inertia of the forearm about the column's axis [kg·m²]."""

SHAKE = 'hand = [{at = 0.0, kind = "sine", amplitude_deg = 8.0, frequency = 2.0, fade = 0.2}'
"""Beginning of a list of segments."""


def grip_alone(p: Parameters = P) -> Specimen:
    """Forearm and column, coupled by the grip alone."""
    return Specimen(p, ("column", "limb"), ("rod", "weight", "bearing"))


def set_grip(rig: Specimen, squeeze: float, attached: bool = True) -> float:
    """Apply a squeeze; returns the torque on the column [N·m]."""
    height = P.column.grip_height
    limb.set_grip(
        rig.plant, rig.truth.parameters.limb, height, rig.truth.joints, rig.truth.body, attached, squeeze
    )
    return float(rig.truth.body.grip_torque)


@pytest.mark.parametrize(
    ("squeeze", "stiffness", "damping"),
    [(0.0, 800.0, 10.0), (0.5, (800.0 * 2e6) ** 0.5, (10.0 * 150.0) ** 0.5), (1.0, 2.0e6, 150.0)],
)
def test_squeeze_runs_from_loose_to_tight(squeeze, stiffness, damping):
    """By the torque that it makes: of a displacement alone, and of a velocity alone."""
    rig = grip_alone()
    set_grip(rig, squeeze)
    rig.place(limb=0.001)
    assert set_grip(rig, squeeze) == pytest.approx(0.001 * stiffness * AREA)
    rig.place(limb=0.0)
    rig.push(limb=0.1)
    assert set_grip(rig, squeeze) == pytest.approx(0.1 * damping * AREA)


def test_a_damping_of_zero_is_allowed():
    rig = grip_alone(parameters({"limb.loose_damping": 0.0}))
    set_grip(rig, 0.0)
    rig.push(limb=0.1)
    assert set_grip(rig, 0.0) == 0.0
    set_grip(rig, 0.5)
    rig.push(limb=0.2)
    assert set_grip(rig, 0.5) == pytest.approx(0.1 * 75.0 * AREA)  # linear where there is no logarithm


def test_no_force_jumps_when_the_squeeze_does():
    """Grip stretched and moving: the force is the same before and after any jump of the squeeze, and acts both ways."""
    rig = grip_alone()
    assert set_grip(rig, 0.2) == 0.0
    rig.place(limb=0.02)
    rig.push(column=-0.1, limb=0.4)
    before = set_grip(rig, 0.2)
    assert before > 1.0
    for squeeze in (1.0, 0.0, 0.7):
        assert set_grip(rig, squeeze) == pytest.approx(before, rel=1e-9)
    record = rig.run(np.zeros(1), hand=Hand(0.7))
    gained = {name: record.final[name][1] - record.velocity[name][0] for name in ("column", "limb")}
    column = float(rig.model.joint("column").M0[0])
    assert gained["column"] * column / rig.step == pytest.approx(before, rel=1e-6)
    assert gained["limb"] * FOREARM / rig.step == pytest.approx(-before, rel=1e-6)


def test_it_grabs_without_a_force_wherever_the_hand_is():
    rig = grip_alone()
    rig.place(column=0.1, limb=-0.2)
    rig.push(column=1.0, limb=-1.0)
    assert set_grip(rig, 0.0, attached=False) == 0.0
    assert set_grip(rig, 0.8) == pytest.approx(0.0, abs=1e-9)


def test_the_grips_damper_resists_no_common_motion():
    """Column and forearm pushed alike run alike: a damper between them is no inertia of damping × step."""
    rig = grip_alone()
    column = float(rig.model.joint("column").M0[0])
    record = rig.run(rig.times(0.01), {"column": 10.0 * column, "limb": 10.0 * FOREARM}, hand=Hand(1.0))
    for name in ("column", "limb"):
        assert record.final[name][1] == pytest.approx(10.0 * (record.time[-1] + rig.step), rel=1e-9)


def test_loose_leaves_the_forearm_behind_and_tight_carries_it():
    """Amplitude of the forearm's mass, column shaken at 20 Hz: soft spring or rigid connection (thesis 3.4.4)."""
    moved = {}
    for squeeze in (0.0, 1.0):
        rig = grip_alone()
        time = rig.times(0.5)
        shaken = 0.02 * np.sin(2 * np.pi * 20 * time)
        record = rig.run(time, feedback={"column": Feedback(2e5, 100.0)}, target={"column": shaken}, hand=Hand(squeeze))
        late = time > 0.25
        moved[squeeze] = np.ptp(record.angle["limb"][late]) / np.ptp(record.angle["column"][late])
    assert moved[0.0] < 0.15
    assert moved[1.0] == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize("squeeze", [0.3, 1.0])
def test_the_forearm_swings_on_the_grip_at_its_frequency(squeeze):
    """Column held: √(k h² / m h²), whatever the height."""
    p = parameters({"limb.loose_damping": 0.0, "limb.tight_damping": 0.0})
    rig = Specimen(p, ("limb",))
    rig.push(limb=0.5)
    record = rig.run(rig.times(0.5), hand=Hand(squeeze))
    swung = record.angle["limb"]
    crossings = np.flatnonzero(np.diff(np.signbit(swung[1:])))
    period = 2 * (crossings[-1] - crossings[0]) / (len(crossings) - 1) * rig.step
    stiffness = 800.0 * (2e6 / 800.0) ** squeeze
    assert period == pytest.approx(2 * math.pi * math.sqrt(1.8 / stiffness), rel=0.01)


def test_squeezing_in_mid_run_is_smooth_and_ends_rigid():
    ran = run(SHAKE + "]\nsqueeze = [{at = 0.5, value = 1.0}]\n", duration=1.0)
    torque = ran["/column.torque"]
    at = round(0.5 / 5e-5)
    assert abs(torque[at] - torque[at - 1]) < 0.02  # in one tick, squeezed from 0 to 1 at once
    assert np.ptp(torque) > 2.0
    slip = ran.between("/pilot.limb_angle", 0.6, 1.0) - ran.between("/column.angle", 0.6, 1.0)[::4]
    assert np.ptp(slip) < 0.005 * DEG
    assert ran["/pilot.squeeze"][[0, -1]] == pytest.approx([0.0, 1.0])


def test_letting_go_takes_the_force_away_at_once():
    ran = run(SHAKE + ', {at = 0.6, kind = "release"}, {at = 0.8, kind = "hold"}]', duration=1.0)
    assert np.abs(ran.between("/column.torque", 0.5, 0.6)).max() > 0.5
    assert not ran.between("/column.torque", 0.6, 0.8).any()
    assert (ran.between("/pilot.squeeze", 0.6, 0.8) == -1.0).all()
    assert np.ptp(ran.between("/column.angle", 0.6, 0.8)) > 1 * DEG  # it swings on by itself
    again = ran.between("/column.torque", 0.8, 1.0)
    assert abs(again[0]) < 1e-9
    assert np.abs(again).max() > 0.01


def test_grip_can_change_while_the_simulation_runs():
    ran = run(SHAKE + ']\nchanges = [{at = 0.5, parameters = {"limb.loose_stiffness" = 8000.0}}]\n', duration=1.0)
    torque = ran["/column.torque"]
    at = round(0.5 / 5e-5)
    assert abs(torque[at] - torque[at - 1]) < 0.02
    assert float(ran.bench.axes[0].record.truth.body.grip_stiffness) == pytest.approx(8000.0 * AREA)


def test_the_forearms_mass_can_change_while_the_simulation_runs():
    """In the rigid grip, 0.6 s after the change: as if it had been so from the start."""
    shake = SHAKE + "]\nsqueeze = [{at = 0.0, value = 1.0}]\n"
    change = 'changes = [{at = 0.2, parameters = {"limb.mass" = 1.2}}]\n'
    force = [
        ran.between("/pilot.hand_force", 0.8, 1.0)
        for ran in (
            run(shake, duration=1.0), run(shake + change, duration=1.0), run(shake, duration=1.0, set=["limb.mass=1.2"])
        )
    ]  # fmt: skip
    assert np.std(force[1] - force[0]) > 0.02 * np.std(force[0])
    assert np.std(force[1] - force[2]) < 0.15 * np.std(force[1] - force[0])
