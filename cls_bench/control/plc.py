"""PLC: the outer loop. Load cell counts → pilot torque → feel model → kinematic chain → field bus (thesis 3.6.2)."""

import math
from typing import Any

import numpy as np

from cls_bench.compiled import compiled
from cls_bench.control import latch
from cls_bench.control.kinematic_chain import column_from_motor, motor_from_column
from cls_bench.feel import solver
from cls_bench.kinematics import polynomial
from cls_bench.parameters import Feel, Plc

COMMAND_POSITION, COMMAND_VELOCITY, COMMAND_ACCELERATION, COMMAND_TORQUE = range(4)
"""Slots of a command frame: PLCopen units, units/s, units/s², N·m at the motor."""

FEEDBACK_POSITION, FEEDBACK_VELOCITY = range(2)
"""Slots of a feedback frame: PLCopen units, units/s."""

SLOTS = {
    "commands": ("position", "velocity", "acceleration", "torque"),
    "feedback": ("position", "velocity"),
    "voltages": ("voltage",),
}
"""Names of the slots of all latches."""

TRIPS = ("none", "limit_switch", "following_error", "invalid_value")
"""Why the PLC switched the drive off, by name."""

NO_TRIP, LIMIT_SWITCH, FOLLOWING_ERROR, INVALID_VALUE = range(len(TRIPS))

STATE = np.dtype(
    [
        # measured
        ("force", np.float64),  # force in the rod [N]
        ("torque", np.float64),  # T_meas, unbalance removed [N·m]
        ("angle", np.float64),  # column angle from the encoder [rad]
        ("velocity", np.float64),  # column velocity from the encoder [rad/s]
        # asked for
        ("set_angle", np.float64),  # [rad]
        ("set_velocity", np.float64),  # [rad/s]
        ("set_acceleration", np.float64),  # [rad/s²]
        ("set_torque", np.float64),  # additional torque at the column [N·m]
        # what goes out with the next frame: PLCopen units, units/s, units/s², N·m at the motor
        ("command_position", np.float64),
        ("command_velocity", np.float64),
        ("command_acceleration", np.float64),
        ("command_torque", np.float64),
        # safety
        ("trip", np.int64),
    ]
)


def woken(p: Plc, f: Feel) -> dict[str, bool]:
    """Which sources of chance field bus and feel model depend on with these parameters."""
    lossy = p.frame_loss > 0.0
    return {"command_frame": lossy, "feedback_frame": lossy, "gust": f.gust.torque > 0.0}


@compiled
def measure(p: Any, design: Any, samples: Any, bus: Any, cycle: int, state: Any) -> None:
    """From counts and the encoder, as it arrives over the bus, to pilot torque and column angle.

    T_meas = r F cos(φ + α − φ_co) − T_stat(φ), T_stat = unbalance · φ, all as the nameplate has it
    """
    plate, poly = p.nameplate, design.polynomials
    delay = p.plc.feedback_latency
    motor = latch.read(bus, cycle, delay, FEEDBACK_POSITION) / design.units_per_radian
    motor_velocity = latch.read(bus, cycle, delay, FEEDBACK_VELOCITY) / design.units_per_radian
    state.angle, state.velocity = column_from_motor(poly, plate.gear_ratio, motor, motor_velocity)
    state.force = samples.load_cell * plate.load_cell_gain
    lever = plate.arm
    if design.shaft == 0:
        lever *= math.cos(state.angle + plate.arm_angle - polynomial(poly.rod, state.angle))
    state.torque = lever * state.force
    if p.plc.remove_unbalance:
        state.torque -= plate.unbalance * state.angle


@compiled
def supervise(p: Any, samples: Any, position_mode: bool, state: Any) -> None:
    """Safety functions: open limit switch, and following error where the drive is asked for a position.

    A trip stays until the drive is switched on again.
    """
    if samples.switch_forward == 0 or samples.switch_aft == 0:
        state.trip = LIMIT_SWITCH
    elif position_mode and abs(state.set_angle - state.angle) > p.plc.following_error_limit:
        state.trip = FOLLOWING_ERROR


@compiled
def follow(p: Any, state: Any, model: Any) -> None:
    """While the drive does not obey, set value and feel model follow the column: switching it on makes no jump."""
    solver.follow(p.feel, model, state.angle, state.velocity, state.torque)
    state.set_angle, state.set_velocity = state.angle, state.velocity
    state.set_acceleration, state.set_torque = 0.0, 0.0


@compiled
def admittance(
    p: Any, velocity_mode: bool, state: Any, model: Any, piece: Any, time: float, cycle: float
) -> None:
    """The built-in outer loop: the feel model answers to the pilot's torque and its own (thesis 3.5); ``piece`` is the
    solver's working memory.

    Position loop: angle, velocity and acceleration of the model are the set values. Velocity loop (Eq. 3.8), where
    the drive is in velocity mode: the model's springs act on the measured angle, its velocity is the set value.
    """
    if velocity_mode:
        model.angle = state.angle
    solver.step(p.feel, model, piece, state.torque, time, cycle)
    state.set_angle = model.angle
    state.set_velocity = model.velocity
    state.set_acceleration = model.acceleration


@compiled
def command(p: Any, design: Any, state: Any) -> None:
    """Through the kinematic chain to what the field bus takes next, with the pilot's torque as feed-forward if wanted.

    The set angle ends at the stop blocks (software limit), inside the range of the polynomials.
    """
    plate, poly = p.nameplate, design.polynomials
    limited = min(max(state.set_angle, -plate.stop_angle), plate.stop_angle)
    angle, velocity, acceleration = motor_from_column(
        poly, plate.gear_ratio, limited, state.set_velocity, state.set_acceleration
    )
    torque = state.set_torque
    if p.drive.feed_forward_pilot:
        torque -= state.torque
    state.command_position = angle * design.units_per_radian
    state.command_velocity = velocity * design.units_per_radian
    state.command_acceleration = acceleration * design.units_per_radian
    state.command_torque = torque / (plate.gear_ratio * polynomial(poly.ratio, state.angle))


@compiled
def send(state: Any, bus: Any, cycle: int) -> None:
    """Put the newest command on the field bus."""
    latch.write(bus, cycle, COMMAND_POSITION, state.command_position)
    latch.write(bus, cycle, COMMAND_VELOCITY, state.command_velocity)
    latch.write(bus, cycle, COMMAND_ACCELERATION, state.command_acceleration)
    latch.write(bus, cycle, COMMAND_TORQUE, state.command_torque)
