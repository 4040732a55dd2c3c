"""Motor and power stage: the torque-speed envelope of thesis table 3.2 comes out of voltage, winding and limits."""

import math

import numpy as np
import pytest

from cls_bench.control import servo, tuning
from cls_bench.parameters import RPM, Parameters
from cls_bench.plant import motor
from cls_bench.plant.state import CURRENT, TEMPERATURE
from cls_bench.signals import TICK_S, VELOCITY_S, VELOCITY_TICKS
from tests.plant_rig import Element, Run, parameters


class MotorOnDrive:
    """The motor alone on the drive's current controller, as the tick wires them: voltage one tick after the current."""

    def __init__(self, p: Parameters, *, load_inertia: float = 0.0):
        self.rig = Element(p, ("motor",), ("motor",))
        self.rig.load(0, load_inertia)
        self.p = self.rig.record
        self.gains = tuning.design(self.p.drive, self.p.motor, VELOCITY_S)
        self.servo = np.zeros(1, dtype=servo.STATE).view(np.recarray)[0]
        self.limit = p.drive.voltage_limit
        self.ticks = 0

    def run(self, torque: float, seconds: float) -> tuple[np.ndarray, np.ndarray]:
        """Ask for ``torque`` [N·m]; returns speed [rad/s] and air-gap torque [N·m] over the ticks."""
        speed, made = [], []
        plant = self.rig.plant
        self.servo.torque_command = torque
        for _ in range(round(seconds / TICK_S)):
            if self.ticks % VELOCITY_TICKS == 0:
                servo.speed_filter(self.gains, self.servo, plant.qpos[0], VELOCITY_S)
            voltage = self.servo.voltage
            servo.current_controller(
                self.p.drive, self.p.motor, self.gains, self.servo, plant.act[CURRENT], self.limit, TICK_S
            )
            motor.apply_voltage(plant, self.p.motor, True, voltage)
            speed.append(plant.qvel[0])
            self.rig.step()
            made.append(plant.actuator_force[0])
            self.ticks += 1
        return np.array(speed), np.array(made)


def test_no_load_speed_is_11400_rpm():
    speed, torque = MotorOnDrive(Parameters()).run(6.0, 0.06)
    assert speed[-1] == pytest.approx(11400 * RPM, rel=0.005)
    assert speed.max() < 1.005 * 11400 * RPM
    assert torque[-1] == pytest.approx(0.0, abs=0.05)


def test_peak_torque_is_6_nm_at_20_38_a():
    """Whatever is asked for, the drive gives 20.38 A and the motor 6.0 N·m, without overshoot worth the name."""
    on = MotorOnDrive(Parameters(), load_inertia=0.1)
    _, torque = on.run(20.0, 0.02)
    assert on.rig.plant.act[CURRENT] == pytest.approx(20.38, rel=1e-3)
    assert torque[-1] == pytest.approx(6.0, rel=1e-3)
    assert torque.max() < 1.05 * 6.0


@pytest.mark.parametrize("rpm", [0, 3000, 7000, 9000, 11000])
def test_the_envelope_bends_where_the_voltage_ends(rpm):
    """At constant speed: 6 N·m, or what the voltage left over by the back-EMF drives through the resistance."""
    p = Parameters()
    m, drive = p.motor, p.drive
    on = MotorOnDrive(p, load_inertia=100.0)
    on.rig.data.qvel[0] = rpm * RPM
    on.servo.velocity = rpm * RPM
    on.servo.encoder_before = -rpm * RPM * VELOCITY_S
    speed, torque = on.run(6.0, 0.02)
    left_over = (math.sqrt(1.5) * drive.modulation * 325.0 - m.torque_constant * rpm * RPM) / m.resistance
    assert torque[-1] == pytest.approx(min(6.0, m.torque_constant * left_over), rel=0.01)
    assert speed[-1] == pytest.approx(rpm * RPM, abs=0.01)


def test_stalled_motor_keeps_1_nm_for_good_and_is_100_k_warmer():
    """Time constant cut to 0.1 s: 1.0 N·m goes on, 3 N·m falls back to it; both end at the class F rise."""
    p = parameters(motor={"thermal_time_constant": 0.1})
    for asked, early in ((1.0, 1.0), (3.0, 3.0)):
        on = MotorOnDrive(p, load_inertia=1e4)
        _, torque = on.run(asked, 1.0)
        assert torque[100] == pytest.approx(early, rel=0.01)
        assert torque[-2000:].mean() == pytest.approx(1.0, rel=0.01)
        assert on.rig.plant.act[TEMPERATURE] == pytest.approx(100.0, rel=0.02)


def test_winding_is_a_resistance_and_an_inductance():
    """Locked rotor under 12 V: i = U/R (1 − exp(−t R/L)), torque = K i."""
    p = Parameters()
    rig = Element(p, ("motor",), ("motor",))
    rig.load(0, 1e6)
    motor.apply_voltage(rig.plant, rig.record.motor, True, 12.0)
    for k in range(1, 101):
        rig.step()
        exact = 12.0 / p.motor.resistance * (1 - math.exp(-k * TICK_S * p.motor.resistance / p.motor.inductance))
        assert rig.plant.act[CURRENT] == pytest.approx(exact, rel=0.03)
    torque = p.motor.torque_constant * rig.plant.act[CURRENT]
    rig.step()
    assert rig.plant.actuator_force[0] == pytest.approx(torque, rel=0.01)


def test_safe_torque_off_leaves_the_motor_free():
    """Open terminals: no torque and no braking, at any speed; shorted ones would brake within milliseconds."""
    rig = Element(Parameters(), ("motor",), ("motor",))
    rig.data.qvel[0] = 500.0
    rig.plant.act[CURRENT] = 5.0
    for _ in range(2000):
        motor.apply_voltage(rig.plant, rig.record.motor, False, 100.0)
        rig.step()
        assert rig.plant.actuator_force[0] == 0.0
    assert rig.data.qvel[0] == pytest.approx(500.0, rel=1e-9)


def test_cogging_is_off_unless_asked_for():
    """Torque over a revolution of the unpowered motor: none, or 24 periods of the given amplitude."""
    for amplitude in (0.0, 0.02):
        rig = Element(parameters(motor={"cogging_amplitude": amplitude}), ("motor",), ("motor",))
        rig.load(0, 1e6)
        rig.data.qvel[0] = 2 * math.pi / (4000 * TICK_S)
        torque = []
        for _ in range(4000):
            motor.apply_voltage(rig.plant, rig.record.motor, False, 0.0)
            rig.step()
            torque.append(rig.plant.actuator_force[0])
        assert np.abs(torque).max() == pytest.approx(amplitude, rel=1e-3)
        if amplitude:
            assert np.argmax(np.abs(np.fft.rfft(torque))) == 24


def test_torque_mode_delivers_the_torque_asked_for():
    run = Run(
        """
        duration = 0.3
        [parameters.drive]
        set_torque = 0.5
        [[changes]]
        at = 0.0
        mode = "torque"
        [[squeeze]]
        at = 0.0
        value = 1.0
        [[hand]]
        at = 0.0
        kind = "hold"
        angle_deg = 0.0
        """,
        "plc.following_error_limit=10.0",
    )
    assert run.during("/drive.torque", 0.2, 0.3).mean() == pytest.approx(0.5, rel=0.005)
    assert run.during("/drive.current", 0.2, 0.3).mean() == pytest.approx(0.5 / 0.2944, rel=0.005)
