"""Servo motor: power-invariant DC equivalent of the synchronous machine.

    L di/dt = u − R i − K ω,   torque = K i + cogging,   winding: C dT/dt = R i² − T / R_th

The current acts when it flows: the torque of a step is that of the current at its start. Over the step the current goes
on in closed form, for a voltage and a speed that are held.
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
def flow(motor: Any, mechanism: Any, body: Any, velocity: float) -> None:
    """Current and temperature after the step which led here, with the voltage that :func:`torque` left.

    ``velocity`` is the one that has moved the rotor over that step, so the back-EMF takes from the circuit what the
    torque gives to the shaft.
    """
    heat = motor.resistance * body.current * body.current * motor.thermal_resistance
    body.temperature = heat + (body.temperature - heat) * mechanism.heat_decay
    if body.connected != 0.0:
        final = (body.voltage - motor.torque_constant * velocity) / motor.resistance
        body.current = final + (body.current - final) * mechanism.current_decay


@compiled
def torque(motor: Any, body: Any, connected: bool, voltage: float) -> float:
    """Torque [N·m] of the present current; ``voltage`` [V] is on the terminals from now on.

    Not ``connected``, they are open: no current, no torque, the motor turns freely. (The drive's free-wheeling diodes
    would conduct above the no-load speed only.)
    """
    body.connected = 1.0 if connected else 0.0
    body.voltage = voltage if connected else 0.0
    if not connected:
        body.current = 0.0
    return float(motor.torque_constant * body.current)
