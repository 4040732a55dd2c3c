"""The outer loop in the PLC: torque measurement, kinematic chain, both architectures, safety."""

import math

import numpy as np
import pytest

from cls_bench.control import latch, plc
from cls_bench.control.kinematic_chain import column_from_motor, motor_from_column
from cls_bench.control.outer_loop import Command
from cls_bench.control.state import CONTROLLER, configure
from cls_bench.kinematics import (
    FourBar,
    column_from_crank,
    crank_curvature,
    crank_from_column,
    crank_ratio,
    fit_polynomials,
    joints,
    rod_angle,
)
from cls_bench.parameters import CONTROL, DEG, Parameters, Plc
from cls_bench.parameters.override import override
from cls_bench.parameters.record import values_of
from cls_bench.plant import sensors
from cls_bench.plant.sensors import SAMPLES
from tests.running import run

BAR = FourBar(0.100, 0.209, 0.175)
POLY = fit_polynomials(BAR, 24.0 * DEG, 9)
NEWTONS_PER_COUNT = 2 * 50.0 * 9.80665 / 2**24
TRAVEL = 20.0 * DEG
FITTED = 3.0 * (math.sin(TRAVEL) - TRAVEL * math.cos(TRAVEL)) / TRAVEL**3
"""Slope of the line that fits the sine best over the travel."""


def blank(dtype):
    return np.zeros(1, dtype=dtype).view(np.recarray)[0]


def plc_of(p):
    """Parameter record and what follows from it, as the bench makes them."""
    record = blank(CONTROLLER)
    for name in CONTROL:
        record.parameters[name] = values_of(getattr(p, name))
    configure(record.design, record.parameters, p)
    return record.parameters, record.design


def believing(**values):
    """The thesis's rig with another nameplate."""
    p = Parameters()
    return p.model_copy(update={"nameplate": p.nameplate.model_copy(update=values)})


class Stand:
    """Ramps the column to an angle and keeps it there."""

    def __init__(self, angle):
        self.angle = angle

    def step(self, inputs):
        x = min(inputs.time / 1.0, 1.0)
        return Command(self.angle * x**3 * (10 - 15 * x + 6 * x * x))


@pytest.mark.parametrize("angle", [-0.35, -0.1, 0.0, 0.2, 0.35])
@pytest.mark.parametrize("remove", [True, False])
def test_torque_from_counts_and_encoder(angle, remove):
    """T_meas = r F cos(φ − φ_co) − U φ, from the exact kinematics (thesis 3.6.2)."""
    p, design = plc_of(believing(unbalance=1.5).model_copy(
        update={"plc": Plc(feedback_latency=0, remove_unbalance=remove)}
    ))  # fmt: skip
    crank = crank_from_column(BAR, angle)
    bus = np.zeros((latch.DEPTH, 2))
    # 25 is the gearbox's ratio, 3600 PLCopen units make a revolution of the motor (thesis table 3.5).
    latch.write(bus, 0, plc.FEEDBACK_POSITION, 25.0 * crank / (2 * math.pi) * 3600.0)
    latch.write(bus, 0, plc.FEEDBACK_VELOCITY, 43.0 / (2 * math.pi) * 3600.0)
    samples, state = blank(SAMPLES), blank(plc.STATE)
    samples.load_cell = 1_000_000.0
    plc.measure(p, design, samples, bus, 0, state)
    assert state.force == pytest.approx(1_000_000 * NEWTONS_PER_COUNT)
    assert state.angle == pytest.approx(angle, abs=1e-5)
    assert state.velocity == pytest.approx(43.0 / 25.0 / crank_ratio(BAR, crank, angle), rel=1e-4)
    torque = 0.175 * state.force * math.cos(angle - rod_angle(BAR, crank, angle))
    assert state.torque == pytest.approx(torque - (1.5 * angle if remove else 0.0), abs=1e-4)


@pytest.mark.parametrize("angle", [-0.3, 0.0, 0.3])
def test_torque_of_a_linkage_that_stands_askew(angle):
    """T_meas = r F cos(φ + α − φ_co): moment of a force along the rod at the arm's pin, by the cross product."""
    bar = FourBar(0.12, 0.25, 0.16, 0.2, -0.1, -0.15)
    p, design = plc_of(believing(
        crank=bar.crank, rod=bar.rod, arm=bar.arm, crank_angle=bar.crank_angle, rod_angle=bar.rod_angle,
        arm_angle=bar.arm_angle, gear_ratio=9.0, unbalance=0.0, load_cell_gain=1e-3,
    ))  # fmt: skip
    crank = crank_from_column(bar, angle)
    x1, z1, x2, z2 = joints(bar, crank, angle)
    bus = np.zeros((latch.DEPTH, 2))
    latch.write(bus, 0, plc.FEEDBACK_POSITION, 9.0 * crank / (2 * math.pi) * 3600.0)
    samples, state = blank(SAMPLES), blank(plc.STATE)
    samples.load_cell = 20_000.0  # 20 N of tension, which pulls the arm's pin towards the crank's
    plc.measure(p, design, samples, bus, 0, state)
    pull = 20.0 * (x1 - x2) / bar.rod, 20.0 * (z1 - z2) / bar.rod
    about_y = z2 * pull[0] - x2 * pull[1]  # of the linkage on the column; in equilibrium the hand's is its opposite
    assert state.angle == pytest.approx(angle, abs=1e-4)
    assert state.torque == pytest.approx(-about_y, rel=1e-4)


@pytest.mark.parametrize("angle", [-0.3, 0.0, 0.3])
def test_torque_of_a_rig_without_a_linkage(angle):
    """The cell sits in the shaft: torque is its force times the arm at which it is given, at any angle."""
    p, design = plc_of(believing(linkage="none", arm=0.3, gear_ratio=4.0, unbalance=2.0, load_cell_gain=0.01))
    bus = np.zeros((latch.DEPTH, 2))
    latch.write(bus, 0, plc.FEEDBACK_POSITION, 4.0 * angle / (2 * math.pi) * 3600.0)
    samples, state = blank(SAMPLES), blank(plc.STATE)
    samples.load_cell = 500.0
    plc.measure(p, design, samples, bus, 0, state)
    assert state.angle == pytest.approx(angle, abs=1e-9)
    assert state.torque == pytest.approx(0.3 * 5.0 - 2.0 * angle, abs=1e-9)


@pytest.mark.parametrize("angle", [-0.34, -0.2, 0.0, 0.1, 0.34])
def test_kinematic_chain_both_ways(angle):
    velocity, acceleration = 1.3, -7.0
    crank = crank_from_column(BAR, angle)
    ratio, curvature = crank_ratio(BAR, crank, angle), crank_curvature(BAR, crank, angle)
    motor = motor_from_column(POLY, 25.0, angle, velocity, acceleration)
    exact = 25.0 * crank, 25.0 * ratio * velocity, 25.0 * (curvature * velocity**2 + ratio * acceleration)
    assert motor == pytest.approx(exact, rel=2e-3, abs=2.5e-4)  # 1e-5 rad at the crank
    back = column_from_motor(POLY, 25.0, exact[0], exact[1])
    assert back == pytest.approx((column_from_crank(BAR, crank), velocity), rel=1e-3, abs=1e-4)


def test_plcopen_units():
    p, design = plc_of(Parameters())
    assert design.units_per_radian * 2 * math.pi == pytest.approx(3600.0)
    state, bus = blank(plc.STATE), np.zeros((latch.DEPTH, 4))
    state.set_angle, state.set_velocity, state.set_acceleration, state.set_torque = 0.1, 0.5, 3.0, 4.0
    state.torque = 9.0
    plc.command(p, design, state)
    plc.send(state, bus, 5)
    crank = crank_from_column(BAR, 0.1)
    ratio = 25.0 * crank_ratio(BAR, crank, 0.1)
    units = 3600.0 / (2 * math.pi)
    frame = bus[5]
    assert frame[plc.COMMAND_POSITION] == pytest.approx(25.0 * crank * units, abs=0.15)  # 1e-5 rad
    assert frame[plc.COMMAND_VELOCITY] == pytest.approx(ratio * 0.5 * units, rel=1e-4)
    acceleration = ratio * 3.0 + 25.0 * crank_curvature(BAR, crank, 0.1) * 0.25
    assert frame[plc.COMMAND_ACCELERATION] == pytest.approx(acceleration * units, rel=1e-3)
    assert frame[plc.COMMAND_TORQUE] == pytest.approx(4.0 / (25.0 * 1.75), rel=1e-3)  # measured angle is 0
    p.drive.feed_forward_pilot = 1
    plc.command(p, design, state)
    plc.send(state, bus, 6)
    assert bus[6][plc.COMMAND_TORQUE] == pytest.approx((4.0 - 9.0) / (25.0 * 1.75), rel=1e-3)
    assert (bus[5] == frame).all()


@pytest.mark.parametrize("asked", [5.0, -5.0, 1e6])
def test_the_set_angle_ends_at_the_stop_blocks(asked):
    p, design = plc_of(Parameters())
    state = blank(plc.STATE)
    state.set_angle = asked
    plc.command(p, design, state)
    stop = 25.0 * crank_from_column(BAR, math.copysign(22.5 * DEG, asked)) * 3600.0 / (2 * math.pi)
    assert state.command_position == pytest.approx(stop, abs=0.15)  # 1e-5 rad at the crank


@pytest.mark.parametrize("angle_deg", [-18.0, -9.0, 0.0, 9.0, 18.0])
def test_without_a_pilot_the_torque_is_only_the_bearings_friction(angle_deg):
    """Held still, U φ taken out: the bearing's 0.05 N·m and the linear fit's error are left (thesis figure 3.37)."""
    r = run(controller=Stand(angle_deg * DEG), duration=1.6)
    torque = r.between("/load_cell.torque", 1.3, 1.6)
    assert r["/column.angle"][-1] / DEG == pytest.approx(angle_deg, abs=0.1)
    assert abs(torque.mean()) < 0.07
    assert np.abs(torque).max() < 0.07 + 6 * 0.16 * 0.175  # noise of the load cell


def test_the_unbalance_is_measured_unless_removed():
    r = run(controller=Stand(15.0 * DEG), duration=1.6, set=["plc.remove_unbalance=false"])
    # Column 0.9 kg at 0.12 m and the rod's 0.3755 kg at 0.175 m, and the line that fits the sine best over ±20°.
    expected = 9.80665 * (0.9 * 0.12 + 0.3755 * 0.175) * FITTED * 15.0 * DEG
    assert expected > 0.3
    assert r.between("/load_cell.torque", 1.3, 1.6).mean() == pytest.approx(expected, abs=0.07)


def test_the_pilots_torque_is_measured_with_its_sign():
    """Column asked to stand, hand pushes with 20 N: 6 N·m, tension positive."""
    r = run(
        'hand = [{at = 0.0, kind = "hold", angle_deg = 0.0}, {at = 0.1, kind = "ramp", to_N = 20.0, over = 0.3}]',
        controller=Stand(0.0), duration=1.2,
    )  # fmt: skip
    assert r.between("/pilot.hand_force", 1.0, 1.2).mean() == pytest.approx(20.0, rel=0.02)
    assert r.between("/column.torque", 1.0, 1.2).mean() == pytest.approx(6.0, rel=0.02)
    assert r.between("/load_cell.torque", 1.0, 1.2).mean() == pytest.approx(6.0, abs=0.1)
    assert r.between("/load_cell.force", 1.0, 1.2).mean() == pytest.approx(6.0 / 0.175, rel=0.03)


SWAY = """
hand = [
  {at = 0.0, kind = "hold", angle_deg = 0.0},
  {at = 0.1, kind = "ramp", to_deg = 8.0, over = 0.5, smooth = true},
  {at = 1.0, kind = "sine", amplitude_deg = 8.0, frequency = 0.8, phase_deg = 90.0},
  {at = 4.0, kind = "release"},
]
"""
FREE = ["feel.damping=4.0", "feel.friction=0.0"]


@pytest.mark.parametrize("loop", ["position", "velocity"])
def test_both_architectures_show_the_models_stiffness(loop):
    """Quasi-static with the hand on: torque over angle is the model's spring, to within friction."""
    r = run(
        'hand = [{at = 0.0, kind = "hold", angle_deg = 0.0}, '
        '{at = 0.1, kind = "ramp", to_deg = 20.0, over = 1.0, smooth = true}]',
        duration=3.0, set=[f'plc.outer_loop="{loop}"', *FREE],
    )  # fmt: skip
    angle = r.between("/column.angle", 2.5, 3.0).mean()
    assert angle > 5 * DEG
    assert r.between("/load_cell.torque", 2.5, 3.0).mean() == pytest.approx(35.0 * angle, abs=0.05)


@pytest.mark.parametrize("loop", ["position", "velocity"])
def test_neither_loop_drifts(loop):
    """After some seconds of motion and a release the column is back at neutral, and stays (thesis Eq. 3.8)."""
    r = run(SWAY, duration=9.0, set=[f'plc.outer_loop="{loop}"', *FREE])
    assert np.abs(r.between("/column.angle", 1.0, 4.0)).max() > 5 * DEG
    # What is left is the bearing's friction over the spring, 0.05 / 35 rad, and the unbalance's fit.
    rest = r.between("/column.angle", 6.0, 9.0)
    assert np.abs(rest).max() < 0.15 * DEG
    # It may creep home, as the bearing gives way to the drive's small motions, but not away.
    early, late = (np.abs(r.between("/column.angle", t, t + 0.5)).mean() for t in (6.0, 8.5))
    assert late < early + 0.005 * DEG


def test_the_velocity_loop_tracks_its_own_model():
    r = run(SWAY, duration=5.0, set=['plc.outer_loop="velocity"', *FREE])
    model, column = r["/feel.angle"], r["/column.angle"][::8]
    assert np.sqrt(np.mean((model - column) ** 2)) < 0.1 * DEG
    assert not r.events


def test_an_open_limit_switch_is_a_safe_torque_off():
    """The outer loop asks for more travel than there is; at 21° the switch opens and the PLC takes the torque away."""
    r = run(controller=Stand(22.4 * DEG), duration=1.5)
    trip = [e for e in r.events if e.source == "safety"]
    assert [e.message for e in trip] == ["safe torque off: limit switch open"]
    at = trip[0].time
    angle = r.between("/column.angle", at - 0.001, at)[-1]
    assert angle == pytest.approx(21.0 * DEG, abs=0.05 * DEG)
    assert not r.between("/drive.torque", at + 1e-9, 1.5).any()


def test_a_large_following_error_is_a_safe_torque_off():
    """With 0.05 N·m of motor torque the column cannot be moved: the set angle runs away, the PLC gives up."""
    r = run(controller=Stand(15.0 * DEG), duration=1.5, set=["drive.torque_limit=0.05"])
    trip = [e for e in r.events if e.source == "safety"]
    assert [e.message for e in trip] == ["safe torque off: following error too large"]
    assert not r.between("/drive.torque", trip[0].time + 1e-9, 1.5).any()
    x = trip[0].time
    wanted = 15.0 * DEG * x**3 * (10 - 15 * x + 6 * x * x)
    assert wanted - r.between("/column.angle", x - 0.001, x)[-1] == pytest.approx(0.2, abs=0.01)


def test_after_a_trip_the_drive_stays_off_until_it_is_switched_on():
    r = run(
        """
        changes = [{at = 1.0, power = "on", parameters.drive.torque_limit = 6.0}]
        hand = [{at = 0.0, kind = "step", to_N = 60.0}, {at = 0.7, kind = "hold", angle_deg = 0.0}]
        """,
        duration=1.5, set=["drive.torque_limit=0.05", "plc.following_error_limit=0.1"],
    )  # fmt: skip
    trips = [e for e in r.events if e.source == "safety"]
    assert len(trips) == 1
    trip = trips[0].time
    assert not r.between("/drive.torque", trip + 1e-9, 1.0).any()
    assert r.between("/drive.torque", 1.0, 1.5).any()


# --- chance -----------------------------------------------------------------------------------------------------------


def test_each_source_of_chance_is_woken_by_its_own_parameter():
    """None by default: what nothing depends on is not drawn."""
    def woken(**changed):
        p = override(Parameters(), changed)
        return {**sensors.woken(p), **plc.woken(p.plc, p.feel)}

    assert woken() == dict.fromkeys((*sensors.UNIFORM, *sensors.TURBULENCE), False)
    assert [source for source, wakes in woken(**{"load_cell.spike_rate": 1.0}).items() if wakes] == ["spike"]
    assert {source for source, wakes in woken(**{"plc.frame_loss": 0.1}).items() if wakes} == {
        "command_frame", "feedback_frame",
    }  # fmt: skip
    assert [source for source, wakes in woken(**{"feel.gust.torque": 1.0}).items() if wakes] == ["gust"]
