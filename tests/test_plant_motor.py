"""Motor and power stage: the torque-speed envelope of thesis table 3.2 comes out of voltage, winding and limits."""

import math
from typing import Any

import mujoco
import numpy as np
import pytest

from cls_bench.axis import AXIS, set_parameters
from cls_bench.control import servo
from cls_bench.parameters import RPM, Parameters
from cls_bench.plant import mechanism
from cls_bench.verification.subject import Record, Specimen
from tests.running import parameters, run

P = Parameters()


def motor_alone(p: Parameters = P, *, inertia: float | None = None) -> Specimen:
    """The rotor on its own: stage 1 without drag, its mesh with a play that is never taken up.

    What is left of the friction are the 1e-9 N·m below which the law of friction does not go.
    With another ``inertia`` of the rotor [kg·m²] if given; copies are not held to the bounds of a bench.
    """
    stage = p.gearbox.stage1.model_copy(update={"backlash": 1e12, "drag": 0.0})
    p = p.model_copy(update={"gearbox": p.gearbox.model_copy(update={"stage1": stage})})
    if inertia is not None:
        p = p.model_copy(update={"motor": p.motor.model_copy(update={"rotor_inertia": inertia})})
    return Specimen(p, ("motor",))


class MotorOnDrive:
    """The motor alone on the drive's current controller, as the tick wires them: voltage one tick after the current."""

    def __init__(self, p: Parameters = P, *, inertia: float | None = None):
        self.motor = motor_alone(p, inertia=inertia)
        axis = np.zeros(1, AXIS).view(np.recarray)[0]
        set_parameters(axis, p)
        self.control = axis.controller
        self.servo = self.control.state.servo
        self.clock = p.rates.clock
        self.ticks = 0

    @property
    def current(self) -> float:
        return float(self.motor.truth.body.current)

    def run(self, torque: float, seconds: float) -> tuple[Any, Any]:
        """Ask for ``torque`` [N·m]; returns speed [rad/s] and air-gap torque [N·m] over the ticks."""
        m, p, design = self.motor, self.control.parameters, self.control.design
        joint = m.joints.index("motor")
        speed, made = [], []
        self.servo.torque_command = torque
        for _ in range(round(seconds / m.step)):
            mechanism.arrive(m.plant, m.truth)
            if self.ticks % self.clock.velocity_ticks == 0:
                servo.speed_filter(design.gains, self.servo, m.plant.qpos[joint], design.velocity_cycle)
            voltage = self.servo.voltage
            servo.current_controller(
                p.drive, p.nameplate, design.gains, self.servo, self.current, design.voltage_limit, design.tick
            )
            mechanism.act(m.plant, m.truth, True, voltage, False, 0.0, 0.0, 0.0)
            speed.append(m.plant.qvel[joint])
            made.append(float(m.truth.body.motor_torque))
            for other in range(len(m.joints)):
                if other != joint:
                    m.plant.force[other] = m.plant.qvel[other] = 0.0
            mujoco.mj_step(m.model, m.data)
            self.ticks += 1
        return np.array(speed), np.array(made)


def test_no_load_speed_is_11400_rpm():
    speed, torque = MotorOnDrive().run(6.0, 0.06)
    assert speed[-1] == pytest.approx(11400 * RPM, rel=0.005)
    assert speed.max() < 1.005 * 11400 * RPM
    assert torque[-1] == pytest.approx(0.0, abs=0.05)


def test_peak_torque_is_6_nm_at_20_38_a():
    """Whatever is asked for, the drive gives 20.38 A and the motor 6.0 N·m, without overshoot worth the name."""
    on = MotorOnDrive(inertia=0.1)
    _, torque = on.run(20.0, 0.02)
    assert on.current == pytest.approx(20.38, rel=1e-3)
    assert torque[-1] == pytest.approx(6.0, rel=1e-3)
    assert torque.max() < 1.05 * 6.0


@pytest.mark.parametrize("rpm", [0, 3000, 7000, 9000, 11000])
def test_the_envelope_bends_where_the_voltage_ends(rpm):
    """At constant speed: 6 N·m, or what the voltage left over by the back-EMF drives through the resistance."""
    m, drive = P.motor, P.drive
    on = MotorOnDrive(inertia=100.0)
    on.motor.push(motor=rpm * RPM)
    on.servo.velocity = rpm * RPM
    on.servo.encoder_before = -rpm * RPM * on.clock.velocity_s
    speed, torque = on.run(6.0, 0.02)
    left_over = (math.sqrt(1.5) * drive.modulation * 325.0 - m.torque_constant * rpm * RPM) / m.resistance
    assert torque[-1] == pytest.approx(min(6.0, m.torque_constant * left_over), rel=0.01)
    assert speed[-1] == pytest.approx(rpm * RPM, abs=0.01)


def test_stalled_motor_keeps_1_nm_for_good_and_is_100_k_warmer():
    """Time constant cut to 0.1 s: 1.0 N·m goes on, 3 N·m falls back to it; both end at the class F rise."""
    p = parameters({"motor.thermal_time_constant": 0.1}).with_nameplate()
    for asked in (1.0, 3.0):
        on = MotorOnDrive(p, inertia=1e4)
        _, torque = on.run(asked, 0.7)
        assert torque[100] == pytest.approx(asked, rel=0.01)
        assert torque[-1000:].mean() == pytest.approx(1.0, rel=0.01)
        assert float(on.motor.truth.body.temperature) == pytest.approx(100.0, rel=0.02)


def test_winding_is_a_resistance_and_an_inductance():
    """Locked rotor under 12 V: i = U/R (1 − exp(−t R/L)) to the last digits, torque = K i at the same instant."""
    record = motor_alone(inertia=1e9).run(np.arange(101) * 5e-5, voltage=12.0)
    m = P.motor
    exact = 12.0 / m.resistance * -np.expm1(-record.time * m.resistance / m.inductance)
    np.testing.assert_allclose(record.signal["current"], exact, rtol=1e-6)
    np.testing.assert_array_equal(record.signal["motor_torque"], m.torque_constant * record.signal["current"])


@pytest.mark.parametrize("substeps", [1, 2, 8])
def test_the_winding_is_the_same_in_shorter_steps(substeps):
    p = parameters({"simulation.substeps": substeps})
    record = motor_alone(p, inertia=1e9).run(np.arange(20 * substeps + 1) * 5e-5 / substeps, voltage=12.0)
    assert record.time[-1] == pytest.approx(1e-3)
    assert record.signal["current"][-1] == pytest.approx(2.0 * -math.expm1(-1.0), rel=1e-6)


def electrical(record: Record, voltage: Any) -> tuple[float, float]:
    """Energy [J] from the terminals and heat in the copper, with the current that flows within each step.

    Over a step of length h it is final + (start − final) exp(−t/τ).
    """
    m, h = P.motor, float(record.time[1] - record.time[0])
    tau = m.inductance / m.resistance
    start, speed = record.signal["current"][:-1], record.velocity["motor"][1:]  # the speed that moves it over the step
    final = (voltage - m.torque_constant * speed) / m.resistance
    rest = start - final
    one, two = -tau * np.expm1(-h / tau), -0.5 * tau * np.expm1(-2.0 * h / tau)
    charge = final * h + rest * one
    squared = final**2 * h + 2.0 * final * rest * one + rest**2 * two
    return float(np.sum(voltage * charge)), float(m.resistance * np.sum(squared))


@pytest.mark.parametrize("substeps", [1, 4])
def test_electrical_energy_is_heat_magnetic_energy_and_work(substeps):
    """Driven to and fro by a varying voltage: nothing is lost between the circuit and the shaft, within 0.05 %."""
    p = parameters({"simulation.substeps": substeps})
    motor = motor_alone(p)
    time = motor.times(0.1)
    voltage = 80.0 + 150.0 * np.sin(2.0 * np.pi * 40.0 * time)
    record = motor.run(time, voltage=voltage)
    terminals, heat = electrical(record, voltage[:-1])
    speed, torque = record.velocity["motor"], record.signal["motor_torque"]
    work = float(np.sum(torque[:-1] * 0.5 * (speed[:-1] + speed[1:])) * motor.step)
    magnetic = 0.5 * P.motor.inductance * float(record.signal["current"][-1]) ** 2
    inertia = P.motor.rotor_inertia + P.gearbox.input_inertia
    assert work == pytest.approx(0.5 * inertia * float(speed[-1]) ** 2, rel=1e-6)
    turnover = P.motor.resistance * float(np.sum(record.signal["current"] ** 2)) * motor.step + abs(work)
    assert turnover > 1.0
    assert terminals - heat - magnetic - work == pytest.approx(0.0, abs=5e-4 * turnover)


def test_heat_follows_the_current():
    """C dT/dt = R i² − T/R_th, in closed form for a current that has settled; open terminals let the winding cool."""
    m = P.motor
    motor = motor_alone(inertia=1e9)
    time = motor.times(1.0)
    warm = motor.run(time, voltage=3.0 * m.resistance).signal["temperature"]
    final = m.resistance * 9.0 * m.thermal_resistance
    settled = time > 0.02
    exact = final + (warm[settled][0] - final) * np.exp(-(time - time[settled][0])[settled] / m.thermal_time_constant)
    np.testing.assert_allclose(warm[settled], exact, rtol=1e-6)
    cooling = motor.run(time).signal["temperature"]
    assert cooling[-1] == pytest.approx(cooling[0] * math.exp(-1.0 / m.thermal_time_constant), rel=1e-4)


def test_safe_torque_off_leaves_the_motor_free():
    """Open terminals: no torque and no braking, at any speed; shorted ones would brake within milliseconds."""
    open_, shorted = motor_alone(), motor_alone()
    for motor in (open_, shorted):
        motor.push(motor=500.0)
        motor.truth.body.current = 5.0
    record = open_.run(open_.times(0.1))
    assert not record.signal["motor_torque"].any()
    assert record.final["motor"][1] == pytest.approx(500.0, rel=1e-8)
    assert shorted.run(shorted.times(0.1), voltage=0.0).final["motor"][1] < 50.0


@pytest.mark.parametrize("periods", [24, 66])
@pytest.mark.parametrize("amplitude", [0.0, 0.02])
def test_cogging_is_off_unless_asked_for(amplitude, periods):
    """Torque over a revolution of the unpowered motor: none, or as many periods of the given amplitude."""
    p = parameters({"motor.cogging_amplitude": amplitude, "motor.cogging_periods": periods})
    inertia = 1e-3
    motor = motor_alone(p, inertia=inertia)
    motor.push(motor=50.0)
    record = motor.run(np.arange(round(2 * math.pi / 50.0 / motor.step) + 1) * motor.step)
    torque = np.diff(record.velocity["motor"]) * (inertia + p.gearbox.input_inertia) / motor.step
    assert np.abs(torque).max() == pytest.approx(amplitude, rel=5e-3, abs=2e-9)
    if amplitude:
        assert np.argmax(np.abs(np.fft.rfft(torque))) == periods
        turned = record.angle["motor"][:-1]
        np.testing.assert_allclose(torque, amplitude * np.sin(periods * turned), atol=2e-9)


def test_torque_mode_delivers_the_torque_asked_for():
    ran = run(
        """
        parameters.drive.set_torque = 0.5
        changes = [{at = 0.0, mode = "torque"}]
        squeeze = [{at = 0.0, value = 1.0}]
        hand = [{at = 0.0, kind = "hold", angle_deg = 0.0}]
        """,
        duration=0.3, set=["plc.following_error_limit=10.0"],
    )  # fmt: skip
    assert ran.between("/drive.torque", 0.2, 0.3).mean() == pytest.approx(0.5, rel=0.005)
    assert ran.between("/drive.current", 0.2, 0.3).mean() == pytest.approx(0.5 / 0.2944, rel=0.005)
