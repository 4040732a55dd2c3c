"""Linkage and load cell: statics against virtual work, the elastic rod, and its far mass against a closed linkage."""

import math
from itertools import pairwise

import mujoco
import numpy as np
import pytest

from cls_bench.kinematics import FourBar, crank_axis, crank_from_column, crank_ratio, joints, rod_angle
from cls_bench.parameters import DEG, GRAVITY, Gearbox, Linkage, Parameters, Simulation
from cls_bench.verification.rigs import BELOW, TILTED
from cls_bench.verification.subject import Feedback, Specimen

P = Parameters()
BAR = P.linkage.four_bar
LINKAGES = {"thesis": Linkage(), "tilted": TILTED, "below": BELOW, "shaft": Linkage(kind="none")}


def weightless(linkage: Linkage) -> Linkage:
    return linkage.model_copy(update=dict.fromkeys(("rod_crank_mass", "rod_column_mass", "rod_end_mass"), 0.0))


def loaded(linkage: Linkage, angle: float, torque: float) -> tuple[float, float, float, float]:
    """Column [rad], crank [rad], rod force [N] and torque that holds the crank [N·m], at rest under ``torque``.

    ``torque`` [N·m] is on the column, which the crank is held to have near ``angle``. No weights, no friction.
    """
    p = P.model_copy(update={"linkage": weightless(linkage)})
    rig = Specimen(p, ("crank", "column"), ("weight", "bearing", "stage1", "stage2"))
    crank = crank_from_column(linkage.four_bar, angle)
    rig.place(column=angle, crank=crank)
    time = rig.times(0.3)
    acted: dict[str, np.ndarray] = {}
    record = rig.run(
        time, {"column": torque * np.minimum(time / 0.1, 1.0)},
        feedback={"crank": Feedback(2e4, 5.0), "column": Feedback(0.0, 2.0)},
        target={"crank": np.full(len(time), crank)}, acted=acted,
    )  # fmt: skip
    return record.final["column"][0], record.final["crank"][0], record.signal["rod_force"][-1], acted["crank"][-1]


@pytest.mark.parametrize("degrees", [-20, -7, 0, 12, 20])
@pytest.mark.parametrize("name", LINKAGES)
def test_cell_and_crank_carry_what_virtual_work_says(name, degrees):
    """30 N·m on the column: rod force T / (r cos(φ + α − ρ)), crank torque T / i; a torque cell's at its arm."""
    linkage = LINKAGES[name]
    bar = linkage.four_bar
    column, crank, force, held = loaded(linkage, degrees * DEG, 30.0)
    lever = bar.arm * math.cos(column + bar.arm_angle - rod_angle(bar, crank, column)) if bar.rod else linkage.arm
    assert force == pytest.approx(30.0 / lever, rel=1e-3)
    assert -held == pytest.approx(30.0 / crank_ratio(bar, crank, column), rel=1e-3)


@pytest.mark.parametrize("degrees", [-20, 0, 20])
@pytest.mark.parametrize("name", LINKAGES)
def test_the_rod_is_as_much_longer_as_its_force_stretches_the_cell(name, degrees):
    """260 N·m at the column, as 6 N·m of the motor make: 1500 N in the thesis's rod, 0.5 mm."""
    linkage = LINKAGES[name]
    bar = linkage.four_bar
    column, crank, force, _ = loaded(linkage, degrees * DEG, 260.0)
    x1, z1, x2, z2 = joints(bar, crank, column)
    stretch = math.hypot(x2 - x1, z2 - z1) - bar.rod if bar.rod else linkage.arm * (column - crank)
    assert stretch == pytest.approx(force / 3.0e6, rel=1e-6)
    assert abs(force) > 1400.0


@pytest.mark.parametrize("name", LINKAGES)
def test_load_cell_is_an_elastic_element_with_a_ringing_column(name):
    """Crank held, column struck: it rings on the cell at √(k r² / I), with 2 % of critical damping.

    r is the rod's lever about the column; the far mass adds what lies across the rod.
    """
    linkage = LINKAGES[name]
    p = P.model_copy(update={"linkage": linkage})
    rig = Specimen(p, ("column",), ("weight", "bearing"))
    rig.push(column=0.05)
    stretch = rig.run(np.arange(4_000) * rig.step).signal["rod_force"][1:]
    stretch = stretch - stretch[-500:].mean()  # weight of the far mass, across a rod that leans
    crossings = np.flatnonzero(np.diff(np.signbit(stretch)))
    period = 2 * (crossings[20] - crossings[0]) / 20 * rig.step
    _, far, end = linkage.masses
    leans = linkage.arm_angle - linkage.rod_angle if linkage.kind == "four_bar" else 0.0
    lever, across = linkage.arm * math.cos(leans), linkage.arm * math.sin(leans)
    inertia = P.column.inertia + end * linkage.arm**2 + far * across**2
    assert period == pytest.approx(2 * math.pi * math.sqrt(inertia / (3.0e6 * lever**2)), rel=0.01)
    peaks = [np.abs(stretch[a:b]).max() for a, b in pairwise(crossings)]
    ratio = -math.log(peaks[20] / peaks[0]) / 20 / math.pi
    carried = end + P.column.inertia / linkage.arm**2
    expected = 0.02 * math.sqrt(carried * lever**2 / inertia)  # the ratio is meant for an upright arm
    assert ratio == pytest.approx(expected, rel=0.1)


# --- the far mass ---

SWING = Parameters().column.model_copy(
    update={"stop_angle": 1e6, "viscous_friction": 0.0, "coulomb_friction": 0.0, "mass_height": 0.05}
)


def swing_rig(linkage: Linkage) -> Parameters:
    """Crank and column alone, coupled by a rod of a heavy far end that is as good as rigid; nothing rubs."""
    heavy = linkage.model_copy(update={"rod_crank_mass": 0.1, "rod_column_mass": 1.6, "rod_end_mass": 0.1})
    stiff = P.load_cell.model_copy(update={"stiffness": 3e8, "damping_ratio": 0.3})
    return P.model_copy(update={
        "gearbox": Gearbox(stages=0, input_inertia=0.0), "linkage": heavy, "load_cell": stiff, "column": SWING,
        "simulation": Simulation(substeps=16),
    })  # fmt: skip


def closed_linkage(p: Parameters) -> mujoco.MjModel:
    """The same in MuJoCo: a rigid rod with its masses, closed by a constraint."""
    bar, link = p.linkage.four_bar, p.linkage
    at_crank, far, end = link.masses
    x, z = crank_axis(bar)
    tilt = math.degrees(bar.rod_angle)
    crank_x, crank_z = bar.crank * math.sin(bar.crank_angle), bar.crank * math.cos(bar.crank_angle)
    arm_x, arm_z = bar.arm * math.sin(bar.arm_angle), bar.arm * math.cos(bar.arm_angle)
    step = p.rates.current_cycle / p.simulation.substeps
    c, point = p.column, 'diaginertia="1e-9 1e-9 1e-9"'
    spin = p.motor.rotor_inertia + link.crank_inertia
    balanced = c.inertia - c.mass * c.mass_height**2

    def mass(name: str, kilograms: float, at: str) -> str:
        return f'<body name="{name}" pos="{at}"><inertial pos="0 0 0" mass="{kilograms}" {point}/></body>'

    stiff = f'solref="{2 * step} 1" solimp="0.99999 0.99999 1e-3"'
    return mujoco.MjModel.from_xml_string(f"""
    <mujoco>
      <option timestep="{step}" gravity="0 0 -{GRAVITY}" integrator="Euler" tolerance="1e-14" iterations="50"/>
      <compiler angle="degree" autolimits="true" balanceinertia="true"/>
      <worldbody>
        <body name="crank" pos="{x} 0 {z}">
          <joint name="crank" axis="0 1 0"/>
          <inertial pos="0 0 0" mass="1e-6" diaginertia="{spin} {spin} {spin}"/>
          {mass("at_crank", at_crank, f"{crank_x} 0 {crank_z}")}
          <body name="rod" pos="{crank_x} 0 {crank_z}" euler="0 {tilt} 0">
            <joint name="rod" axis="0 1 0"/>
            <inertial pos="{bar.rod} 0 0" mass="{far}" {point}/>
          </body>
        </body>
        <body name="column">
          <joint name="column" axis="0 1 0"/>
          <inertial pos="0 0 {c.mass_height}" mass="{c.mass}" diaginertia="{balanced} {balanced} {balanced}"/>
          {mass("end", end, f"{arm_x} 0 {arm_z}")}
        </body>
      </worldbody>
      <equality>
        <connect body1="rod" body2="column" anchor="{bar.rod} 0 0" {stiff}/>
      </equality>
    </mujoco>
    """)


def swing_closed(p: Parameters, start: float, speed: float, seconds: float) -> np.ndarray:
    """Column angle [rad] of the closed linkage let go at a column angle and speed, an entry a step."""
    bar = p.linkage.four_bar
    model = closed_linkage(p)
    data = mujoco.MjData(model)
    crank = crank_from_column(bar, start)
    rod = rod_angle(bar, crank, start) - bar.rod_angle
    h = 1e-6
    after = crank_from_column(bar, start + h)
    ratio = crank_ratio(bar, crank, start)
    turning = (rod_angle(bar, after, start + h) - bar.rod_angle - rod) / h
    data.joint("crank").qpos, data.joint("rod").qpos, data.joint("column").qpos = crank, rod - crank, start
    data.joint("crank").qvel, data.joint("rod").qvel = ratio * speed, (turning - ratio) * speed
    data.joint("column").qvel = speed
    found = []
    for _ in range(round(seconds / model.opt.timestep)):
        found.append(float(data.joint("column").qpos[0]))
        mujoco.mj_step(model, data)
    assert data.warning.number.sum() == 0
    return np.array(found)


def swing_stepped(p: Parameters, start: float, speed: float, seconds: float) -> np.ndarray:
    bar = p.linkage.four_bar
    rig = Specimen(p, ("crank", "column"))
    crank = crank_from_column(bar, start)
    rig.place(column=start, crank=crank)
    rig.push(column=speed, crank=crank_ratio(bar, crank, start) * speed)
    return rig.run(np.arange(round(seconds / rig.step)) * rig.step).angle["column"]


@pytest.mark.parametrize("name", ["thesis", "tilted", "below"])
def test_the_far_mass_is_exact(name):
    """Let go at speed through the travel, against a rigid rod that a constraint closes; and lumping would not do.

    One and a half kilograms at the rod's far end, a third of all inertia: where it is taken as the crank's alone, the
    motion is off by more than a thousand times the limit.
    """
    p = swing_rig(LINKAGES[name])
    start, speed, seconds = -18 * DEG, 4.0, 0.12
    expected = swing_closed(p, start, speed, seconds)
    assert np.ptp(expected) > 20 * DEG
    found = swing_stepped(p, start, speed, seconds)
    assert np.abs(found - expected).max() < 2e-6
    at_crank, far, end = p.linkage.masses
    lumped = p.linkage.model_copy(update={"rod_crank_mass": at_crank + far, "rod_column_mass": end})
    off = swing_stepped(p.model_copy(update={"linkage": lumped}), start, speed, seconds) - expected
    assert np.abs(off).max() > 1000 * 2e-6


def test_neutral_is_drawn_closed():
    for linkage in LINKAGES.values():
        bar: FourBar = linkage.four_bar
        if bar.rod:
            x1, z1, x2, z2 = joints(bar, 0.0, 0.0)
            assert math.hypot(x2 - x1, z2 - z1) == pytest.approx(bar.rod, rel=1e-12)
