"""Servo drive: the cascade of position, velocity and current controller (thesis 3.6.1, figures 3.32 and 3.33).

It knows the motor's encoder and current and what arrives over the field bus; its only output is the motor voltage.
"""

from typing import Any

import numpy as np

from cls_bench.compiled import compiled
from cls_bench.control.tuning import Gains

POSITION, VELOCITY, TORQUE, OFF = range(4)
"""Modes; OFF is safe torque off."""

MODES = ("position", "velocity", "torque", "off")

STATE = np.dtype(
    [
        ("mode", np.int64),
        ("set_position", np.float64),  # motor shaft [rad]
        ("set_velocity", np.float64),  # what the velocity controller follows now [rad/s]
        ("position_output", np.float64),  # newest output of the position controller [rad/s]
        ("position_output_before", np.float64),  # and the one before, for the interpolation
        ("position_integral", np.float64),  # [rad/s]
        ("encoder_before", np.float64),  # [rad]
        ("velocity", np.float64),  # after the speed filter [rad/s]
        ("velocity_integral", np.float64),  # [N·m]
        ("feed_forward", np.float64),  # torque added to the velocity controller's [N·m]
        ("torque_command", np.float64),  # [N·m]
        ("current_integral", np.float64),  # [V]
        ("thermal_load", np.float64),  # I²t monitor: 1 at the continuous current for good
        ("voltage", np.float64),  # newest output of the current controller [V]
        # what was asked for before a limit, for the log alone
        ("asked_velocity", np.float64),  # [rad/s]
        ("asked_torque", np.float64),  # [N·m]
        ("asked_current", np.float64),  # [A]
        ("allowed_current", np.float64),  # [A]
        ("asked_voltage", np.float64),  # [V]
    ]
)


@compiled
def _limited(value: float, limit: float) -> float:
    return min(max(value, -limit), limit)


@compiled
def reset(state: Any, encoder: float) -> None:
    """Forget everything but the shaft's position, as at switch-on."""
    state.set_position = encoder
    state.set_velocity = 0.0
    state.position_output = 0.0
    state.position_output_before = 0.0
    state.position_integral = 0.0
    state.velocity_integral = 0.0
    state.feed_forward = 0.0
    state.torque_command = 0.0
    state.current_integral = 0.0
    state.voltage = 0.0
    state.asked_velocity = state.asked_torque = state.asked_current = state.asked_voltage = 0.0


@compiled
def position_controller(
    drive: Any, gains: Gains, state: Any, encoder: float, set_position: float, set_velocity: float, cycle: float
) -> None:
    """Each position cycle: PI position controller with velocity feed-forward, anti-windup by conditional integration.

    velocity = k_p (e + 1/T_n ∫ e dt) + set velocity, limited to the speed limit
    """
    state.set_position = set_position
    state.position_output_before = state.position_output
    error = set_position - encoder
    ahead = set_velocity if drive.feed_forward_velocity else 0.0
    integral = state.position_integral
    if gains.position_integral_time > 0.0:
        integral += gains.position_proportional * error * cycle / gains.position_integral_time
    else:
        integral = 0.0
    output = gains.position_proportional * error + integral + ahead
    state.asked_velocity = output
    state.position_output = _limited(output, drive.speed_limit)
    if output == state.position_output or (output > 0.0) != (error > 0.0):
        state.position_integral = integral


@compiled
def speed_filter(gains: Gains, state: Any, encoder: float, cycle: float) -> None:
    """Velocity from the encoder, each velocity cycle: difference over the cycle, first-order low pass."""
    raw = (encoder - state.encoder_before) / cycle
    state.encoder_before = encoder
    state.velocity += gains.speed_filter * (raw - state.velocity)


@compiled
def velocity_command(drive: Any, state: Any, encoder: float, set_velocity: float) -> None:
    """Each position cycle in velocity mode: the set velocity comes from the bus, the position controller rests."""
    state.set_position = encoder
    state.position_output_before = state.position_output
    state.asked_velocity = set_velocity
    state.position_output = _limited(set_velocity, drive.speed_limit)
    state.position_integral = 0.0


@compiled
def torque_command(drive: Any, state: Any, encoder: float) -> None:
    """Each position cycle in torque mode: ``set_torque`` and the bus's torque; only the current controller works.

    The controllers above it follow what happens, so that a later change of mode makes no jump.
    """
    state.asked_velocity = 0.0
    state.asked_torque = drive.set_torque + state.feed_forward
    state.torque_command = _limited(state.asked_torque, drive.torque_limit)
    state.set_position = encoder
    state.position_integral = 0.0
    state.set_velocity = state.position_output = state.velocity
    state.velocity_integral = state.torque_command - state.feed_forward


@compiled
def interpolate(state: Any, share: float) -> None:
    """Set velocity on the way from the last output of the position controller to the newest (thesis 3.6.1).

    ``share`` grows over the velocity cycles of a position cycle to 1: halfway, then the newest, where there are two.
    """
    state.set_velocity = (1.0 - share) * state.position_output_before + share * state.position_output


@compiled
def velocity_controller(drive: Any, gains: Gains, state: Any, cycle: float) -> None:
    """Each velocity cycle: PI velocity controller, figure 3.33, anti-windup by conditional integration.

    torque = k_p (e + 1/T_n ∫ e dt) + feed-forward, limited to the torque limit
    """
    error = state.set_velocity - state.velocity
    integral = state.velocity_integral + gains.velocity_proportional * error * cycle / gains.velocity_integral_time
    torque = gains.velocity_proportional * error + integral + state.feed_forward
    state.asked_torque = torque
    state.torque_command = _limited(torque, drive.torque_limit)
    if torque == state.torque_command or (torque > 0.0) != (error > 0.0):
        state.velocity_integral = integral


@compiled
def current_limit(drive: Any, state: Any, current: float, time_constant: float, tick: float) -> float:
    """Current [A] that the drive allows: its peak, or the continuous one while the I²t monitor is full.

    The monitor follows (i / i_continuous)² with the winding's time constant.
    """
    ratio = current / drive.continuous_current
    state.thermal_load += (ratio * ratio - state.thermal_load) * tick / time_constant
    return float(drive.peak_current if state.thermal_load < 1.0 else drive.continuous_current)


@compiled
def current_controller(
    drive: Any, plate: Any, gains: Gains, state: Any, current: float, voltage_limit: float, tick: float
) -> None:
    """Each tick: PI current controller with back-EMF decoupling and voltage limit, anti-windup by clamping.

    voltage = k_p e + k_i ∫ e dt + K ω
    """
    allowed = current_limit(drive, state, current, plate.thermal_time_constant, tick)
    state.asked_current, state.allowed_current = state.torque_command / plate.torque_constant, allowed
    error = _limited(state.asked_current, allowed) - current
    emf = plate.torque_constant * state.velocity
    integral = state.current_integral + gains.current_integral * error * tick
    wanted = gains.current_proportional * error + integral + emf
    state.asked_voltage = wanted
    state.voltage = _limited(wanted, voltage_limit)
    if wanted == state.voltage or (wanted > 0.0) != (error > 0.0):
        state.current_integral = integral
