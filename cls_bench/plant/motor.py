"""Servo motor: power-invariant DC equivalent of the synchronous machine.

    L di/dt = u − R i − K ω,   torque = K i + cogging,   winding: C dT/dt = R i² − T / R_th

The current acts when it flows: the torque of a step is that of the current at its start, and the current goes on in
closed form, for a voltage and a speed that are held over the step.
"""

import math
from typing import Any

from cls_bench.compiled import compiled


@compiled
def cogging(motor: Any, angle: float) -> float:
    """Cogging torque [N·m] at the rotor's ``angle`` [rad]."""
    if motor.cogging_amplitude == 0.0:
        return 0.0
    return float(motor.cogging_amplitude * math.sin(motor.cogging_periods * angle))


@compiled
def advance(motor: Any, mechanism: Any, body: Any, connected: bool, voltage: float, velocity: float) -> float:
    """Torque [N·m] of the present current; the current then goes on by a step with ``voltage`` [V] on the terminals.

    Not ``connected``, they are open: no current, no torque, the motor turns freely. (The drive's free-wheeling diodes
    would conduct above the no-load speed only.)
    """
    body.voltage = voltage if connected else 0.0
    if not connected:
        body.current = 0.0
    torque = motor.torque_constant * body.current
    heat = motor.resistance * body.current * body.current * motor.thermal_resistance
    body.temperature = heat + (body.temperature - heat) * mechanism.heat_decay
    if connected:
        final = (voltage - motor.torque_constant * velocity) / motor.resistance
        body.current = final + (body.current - final) * mechanism.current_decay
    return float(torque)
