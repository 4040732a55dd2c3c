"""The compiled multi-rate loop: the one place where plant and control meet.

One tick k (50 µs)::

    k % 8 == 0    PLC: self-check of its numbers
    sample        encoder, current, load cell, limit switches       what control may see
    k % 4 == 0    drive (200 µs): speed filter
    k % 8 == 0    drive (400 µs): position and velocity → field bus
    k % 8 == 0    PLC (400 µs): torque measurement, outer loop, safety, kinematic chain → field bus
    k % 8 == 0    drive (400 µs): position controller
    k % 4 == 0    drive (200 µs): velocity controller
    every tick    drive: current controller → voltage, through its latch
    limits        what was asked for beyond one
    trace         the state at time k · 50 µs
    mj_step       once, or ``simulation.substeps`` times

The order is written here once, and every delay is a latch with its length in the parameters.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cls_bench.compiled import compiled, mj_step
from cls_bench.control import feel, latch, limits, plc, servo
from cls_bench.control.kinematic_chain import units_per_radian
from cls_bench.control.tuning import Gains
from cls_bench.control.validity import Numbers, clear, first_invalid
from cls_bench.kinematics import FourBar, Polynomials
from cls_bench.pilot import HandSamples
from cls_bench.plant import model as plant_model
from cls_bench.plant import motor, sensors
from cls_bench.plant.limb import grip_force, move_arm
from cls_bench.plant.model import Dampings
from cls_bench.plant.state import COLUMN, LIMB, MOTOR_DRIVE, STAGE1_FRICTION, STAGE2_FRICTION, VOLTAGE, Plant
from cls_bench.signals import PLC_S, PLC_TICKS, POSE_TICKS, TICK_S, VELOCITY_S, VELOCITY_TICKS

STATE = np.dtype(
    [
        ("samples", sensors.SAMPLES),
        ("plc", plc.STATE),
        ("feel", feel.STATE),
        ("servo", servo.STATE),
        ("commands", np.float64, (latch.DEPTH, 4)),  # field bus, PLC → drive
        ("feedback", np.float64, (latch.DEPTH, 2)),  # field bus, drive → PLC
        ("voltages", np.float64, (latch.DEPTH, 1)),  # current controller → power stage
        ("power", np.int64),  # whether the drive is switched on
        ("trip_tick", np.int64),  # when the PLC last switched it off
        ("invalid", np.int64),  # what it found then, for INVALID_VALUE: place of a number, see Watched
        ("limits", limits.STATE),
        ("warned", np.int64),  # whether MuJoCo warned
    ]
)
"""Everything the sampled side remembers."""

BOUND = 1.0e4
"""Velocity [rad/s; m/s for the load cell] that no joint of a sound run reaches: eight times the motor at no load."""


class Constants(NamedTuple):
    """What follows from the parameters and is not changed by the loop."""

    gains: Gains
    dampings: Dampings
    bar: FourBar
    polynomials: Polynomials
    mesh_loss: float
    unbalance: float  # [N·m/rad]
    newtons_per_count: float
    voltage_limit: float  # [V]


class Hand(NamedTuple):
    """The pilot in a block, an entry a tick; see :class:`cls_bench.pilot.HandSamples`."""

    angle: NDArray[np.float64]
    velocity: NDArray[np.float64]
    force: NDArray[np.float64]
    motion: NDArray[np.bool_]
    attached: NDArray[np.bool_]
    squeeze: NDArray[np.float64]

    @classmethod
    def of(cls, samples: HandSamples) -> "Hand":
        """The same arrays, in the form compiled code takes."""
        return cls(samples.angle, samples.velocity, samples.force, samples.motion, samples.attached, samples.squeeze)


class Watched(NamedTuple):
    """What the controller's self-check looks at."""

    state: Numbers
    parameters: Numbers


@compiled
def first_unbounded(plant: Plant) -> int:
    """Index of the first joint whose velocity is not finite or beyond :data:`BOUND`; −1 if there is none.

    Whatever else is lost (a force, a current) shows in a velocity at the next step.
    """
    for joint in range(plant.qvel.shape[0]):
        if not abs(plant.qvel[joint]) < BOUND:
            return joint
    return -1


@compiled
def _measure(plant: Plant, p: Any, constants: Constants, state: Any, noise: Any, tick: int) -> None:
    """First part of a tick: sample the sensors, filter the speed; in a PLC tick put both on the bus and measure."""
    sensors.sample(plant, p, constants.dampings.load_cell, noise, state.samples)
    if tick % VELOCITY_TICKS == 0:
        servo.speed_filter(constants.gains, state.servo, state.samples.encoder, VELOCITY_S)
    if tick % PLC_TICKS == 0:
        cycle = tick // PLC_TICKS
        per_radian = units_per_radian(p.plc.units_per_revolution)
        latch.write(state.feedback, cycle, plc.FEEDBACK_POSITION, state.samples.encoder * per_radian)
        latch.write(state.feedback, cycle, plc.FEEDBACK_VELOCITY, state.servo.velocity * per_radian)
        plc.measure(
            p, constants.bar, constants.polynomials, constants.unbalance, constants.newtons_per_count,
            state.samples, state.feedback, cycle, state.plc,
        )  # fmt: skip


@compiled
def _trip(state: Any, tick: int, reason: int) -> None:
    state.plc.trip = reason
    state.power = 0
    state.trip_tick = tick


@compiled
def _check_numbers(state: Any, watched: Watched, tick: int) -> None:
    """Switch the drive off if a number of the controller is not finite; say which in ``state.invalid``.

    Its memory is cleared of them, so that nothing else is lost; a parameter stays as it is and trips again.
    """
    found = first_invalid(watched.parameters)
    if found >= 0:
        found += watched.state.places.shape[0]
    else:
        found = first_invalid(watched.state)
    if found >= 0:
        state.invalid = found
        _trip(state, tick, plc.INVALID_VALUE)
        clear(watched.state)


@compiled
def _plc_task(p: Any, constants: Constants, state: Any, watched: Watched, tick: int, external: bool) -> None:
    mode = state.servo.mode
    if state.power and mode != servo.OFF:
        if not external and mode != servo.TORQUE:
            plc.admittance(p, mode == servo.VELOCITY, state.plc, state.feel, tick * TICK_S, PLC_S)
        plc.supervise(p, state.samples, mode == servo.POSITION, state.plc)
        if state.plc.trip != plc.NO_TRIP:
            _trip(state, tick, state.plc.trip)
        s = state.plc
        if not abs(s.set_angle + s.set_velocity + s.set_acceleration + s.set_torque) < np.inf:
            _check_numbers(state, watched, tick)
    if not state.power or mode == servo.OFF or (mode == servo.TORQUE and not external):
        plc.follow(state.plc, state.feel)
    plc.command(p, constants.polynomials, state.plc, state.commands, tick // PLC_TICKS)


@compiled
def _drive(p: Any, constants: Constants, state: Any, tick: int) -> None:
    drive, gains, s, encoder = p.drive, constants.gains, state.servo, state.samples.encoder
    if not state.power or s.mode == servo.OFF:
        servo.reset(s, encoder)
        servo.current_limit(drive, s, state.samples.current, p.motor.thermal_time_constant, TICK_S)
        return
    if tick % PLC_TICKS == 0:
        cycle, delay = tick // PLC_TICKS, p.plc.command_latency
        per_radian = units_per_radian(p.plc.units_per_revolution)
        set_position = latch.read(state.commands, cycle, delay, plc.COMMAND_POSITION) / per_radian
        set_velocity = latch.read(state.commands, cycle, delay, plc.COMMAND_VELOCITY) / per_radian
        acceleration = latch.read(state.commands, cycle, delay, plc.COMMAND_ACCELERATION) / per_radian
        s.feed_forward = latch.read(state.commands, cycle, delay, plc.COMMAND_TORQUE)
        if s.mode == servo.POSITION:
            servo.position_controller(drive, gains, s, encoder, set_position, set_velocity, PLC_S)
        elif s.mode == servo.VELOCITY:
            servo.velocity_command(drive, s, encoder, set_velocity)
        else:
            servo.torque_command(drive, s, encoder)
        if drive.feed_forward_inertia:
            s.feed_forward += drive.load_inertia * acceleration
    if tick % VELOCITY_TICKS == 0 and s.mode != servo.TORQUE:
        servo.interpolate(s, tick % PLC_TICKS == 0)
        servo.velocity_controller(drive, gains, s, VELOCITY_S)
    servo.current_controller(drive, p.motor, gains, s, state.samples.current, constants.voltage_limit, TICK_S)


@compiled
def _note_limits(plant: Plant, p: Any, constants: Constants, state: Any) -> None:
    watch, s, samples = state.limits, state.servo, state.samples
    if sensors.is_saturated(p.load_cell, samples.load_cell):
        limits.note(watch, limits.LOAD_CELL, abs(samples.strain_force), p.load_cell.capacity)
    limits.compare(watch, limits.TRAVEL, plant.qpos[COLUMN], p.column.travel)
    if state.power and s.mode != servo.OFF:
        limits.compare(watch, limits.SET_ANGLE, state.plc.set_angle, p.column.stop_angle)
        limits.compare(watch, limits.SPEED, s.asked_velocity, p.drive.speed_limit)
        limits.compare(watch, limits.TORQUE, s.asked_torque, p.drive.torque_limit)
        limits.compare(watch, limits.CURRENT, s.asked_current, s.allowed_current)
        limits.compare(watch, limits.VOLTAGE, s.asked_voltage, constants.voltage_limit)


@compiled
def advance(
    plant: Plant, p: Any, constants: Constants, state: Any, watched: Watched, hand: Hand, noise: Any, trace: Any,
    first_tick: int, ticks: int, external: bool, ask: Callable[[int], int],
) -> int:  # fmt: skip
    """Run ``ticks`` ticks from ``first_tick`` on, a PLC tick; returns how many were run.

    Fewer are run only where a state left all bounds, MuJoCo warned (``state.warned``) or ``ask`` refuses. ``hand``,
    ``noise`` and ``trace`` belong to these ticks. With ``external`` the set values in ``state.plc`` come from a user's
    outer loop: ``ask`` is called with the tick's number, reads the measurement there and writes them; it returns 0, or
    anything else to stop.
    """
    for row in range(ticks):
        tick = first_tick + row
        if tick % PLC_TICKS == 0 and state.power and state.servo.mode != servo.OFF:
            _check_numbers(state, watched, tick)
        _measure(plant, p, constants, state, noise[row], tick)
        if first_unbounded(plant) >= 0:
            return row
        if tick % PLC_TICKS == 0:
            if external and state.power and state.servo.mode != servo.OFF and ask(tick) != 0:
                return row
            _plc_task(p, constants, state, watched, tick, external)
        _drive(p, constants, state, tick)
        if not abs(state.servo.voltage) < np.inf:  # the power stage waits for no PLC
            _check_numbers(state, watched, tick)
            servo.reset(state.servo, state.samples.encoder)
        latch.write(state.voltages, tick, 0, state.servo.voltage)
        voltage = latch.read(state.voltages, tick, p.drive.voltage_latency, 0)
        _note_limits(plant, p, constants, state)
        connected = state.power != 0 and state.servo.mode != servo.OFF
        motor.apply_voltage(plant, p.motor, connected, voltage)

        attached, squeeze, height = hand.attached[row], hand.squeeze[row], p.column.grip_height
        move_arm(plant, p.limb, height, hand.motion[row], hand.angle[row], hand.velocity[row], hand.force[row])
        twist1, torque1, twist2, torque2 = plant_model.update(
            plant, p, constants.mesh_loss, constants.dampings, attached, squeeze
        )
        _trace_state(plant, state, trace, tick, row, grip_force(plant), height, squeeze if attached else -1.0)
        mj_step(plant.model, plant.data)
        # The forces of this state are known once MuJoCo has stepped from it.
        gearbox = trace.gearbox[row]
        gearbox.stage1_twist, gearbox.stage1_torque = twist1, torque1
        gearbox.stage1_friction = -plant.actuator_force[STAGE1_FRICTION]
        gearbox.stage2_twist, gearbox.stage2_torque = twist2, torque2
        gearbox.stage2_friction = -plant.actuator_force[STAGE2_FRICTION]
        if tick % VELOCITY_TICKS == 0:
            trace.drive[row // VELOCITY_TICKS].torque = plant.actuator_force[MOTOR_DRIVE]
        if tick % POSE_TICKS == 0:
            at = tick // POSE_TICKS - (first_tick + POSE_TICKS - 1) // POSE_TICKS
            _trace_poses(plant, trace.poses, at)
        for _ in range(1, p.simulation.substeps):
            plant_model.update(plant, p, constants.mesh_loss, constants.dampings, attached, squeeze)
            mj_step(plant.model, plant.data)
        if state.warned:
            return row
    return ticks


@compiled
def _trace_poses(plant: Plant, poses: NDArray[np.float64], at: int) -> None:
    for body in range(plant.xpos.shape[0]):
        for k in range(3):
            poses[at, body, k] = plant.xpos[body, k]
        for k in range(4):
            poses[at, body, 3 + k] = plant.xquat[body, k]


@compiled
def _trace_state(
    plant: Plant, state: Any, trace: Any, tick: int, row: int, grip: float, height: float, squeeze: float
) -> None:
    column = trace.column[row]
    column.angle, column.velocity, column.torque = plant.qpos[COLUMN], plant.qvel[COLUMN], grip
    cell = trace.load_cell[row]
    cell.force, cell.torque, cell.counts = state.samples.strain_force, state.plc.torque, state.samples.load_cell
    if tick % VELOCITY_TICKS == 0:
        at, s = row // VELOCITY_TICKS, state.servo
        pilot = trace.pilot[at]
        pilot.hand_force, pilot.squeeze, pilot.limb_angle = grip / height, squeeze, plant.qpos[LIMB]
        drive = trace.drive[at]
        drive.set_position, drive.position = s.set_position, state.samples.encoder
        drive.set_velocity, drive.velocity = s.set_velocity, s.velocity
        drive.torque_command, drive.current = s.torque_command, state.samples.current
        drive.voltage = plant.ctrl[VOLTAGE]
    if tick % PLC_TICKS == 0:
        at, watch, body = row // PLC_TICKS, state.limits, state.feel
        model = trace.feel[at]
        model.torque, model.angle, model.velocity = body.torque, body.angle, body.velocity
        reached = trace.limits[at]
        reached.load_cell = limits.share(watch, limits.LOAD_CELL, PLC_TICKS)
        reached.set_angle = limits.share(watch, limits.SET_ANGLE, PLC_TICKS)
        reached.speed = limits.share(watch, limits.SPEED, PLC_TICKS)
        reached.torque = limits.share(watch, limits.TORQUE, PLC_TICKS)
        reached.current = limits.share(watch, limits.CURRENT, PLC_TICKS)
        reached.voltage = limits.share(watch, limits.VOLTAGE, PLC_TICKS)
        reached.travel = limits.share(watch, limits.TRAVEL, PLC_TICKS)
