"""Servo motor: MuJoCo's DC motor as power-invariant equivalent of the synchronous machine.

    L di/dt = u − R i − K ω,   torque = K i,   winding: C dT/dt = R i² − T / R_th
"""

from typing import Any

import mujoco

from cls_bench.compiled import compiled
from cls_bench.parameters import Motor
from cls_bench.plant.state import CURRENT, MOTOR_DRIVE, VOLTAGE

_CONSTANT = 1  # place of the motor constant in gainprm
_AMBIENT = 20.0  # °C; without a temperature coefficient of resistance it is only a reference


def configure(spec: mujoco.MjSpec, motor: Motor) -> None:
    """Set the electrical and thermal constants."""
    spec.actuator("motor").set_to_dcmotor(
        motorconst=[motor.torque_constant, 0.0],
        resistance=motor.resistance,
        inductance=[motor.inductance, 0.0],
        thermal=[motor.thermal_resistance, 0.0, motor.thermal_time_constant, 0.0, _AMBIENT, _AMBIENT],
        cogging=[motor.cogging_amplitude, float(motor.cogging_periods), 0.0],
        ctrlspec=int(mujoco.mjtCtrlInput.mjINPUT_VOLTAGE),
    )


@compiled
def apply_voltage(plant: Any, motor: Any, connected: bool, voltage: float) -> None:
    """Put ``voltage`` [V] on the terminals, or open them: no current, no torque, the motor turns freely.

    An open circuit is a motor whose constant is zero: no back-EMF drives a current, and no current makes torque. (The
    drive's free-wheeling diodes would conduct above the no-load speed only.)
    """
    if connected:
        plant.gainprm[MOTOR_DRIVE, _CONSTANT] = motor.torque_constant
        plant.ctrl[VOLTAGE] = voltage
    else:
        plant.gainprm[MOTOR_DRIVE, _CONSTANT] = 0.0
        plant.ctrl[VOLTAGE] = 0.0
        plant.act[CURRENT] = 0.0
