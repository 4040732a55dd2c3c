"""The compiled multi-rate loop: the one place where plant and control meet.

One tick, of every axis, in this order::

    plc cycle        PLC: self-check of its numbers
    every tick       sample: encoder, current, load cell, potentiometer, limit switches
    velocity cycle   drive: speed filter
    bus cycle        field bus: position and velocity of the drive → PLC
    plc cycle        PLC: torque measurement, outer loop, safety, kinematic chain
    bus cycle        field bus: newest command of the PLC → drive
    position cycle   drive: position controller
    velocity cycle   drive: velocity controller
    every tick       drive: current controller → voltage, through its latch
    every tick       limits: what was asked for beyond one
    every tick       plant: forces of the present state
    every tick       trace: the state at the tick's time
    every tick       mj_step; forces and mj_step again for each further one of simulation.substeps

The order is written here once, and every delay is a latch with its length in the parameters. :func:`advance` carries it
out; ``docs/architecture.md`` repeats it, and a test compares.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cls_bench.compiled import call, compiled, mj_step
from cls_bench.control import latch, limits, plc, servo, validity
from cls_bench.hand import HandSamples
from cls_bench.plant import limb, mechanism, sensors
from cls_bench.plant.state import Plant

BOUND = 1.0e4
"""Velocity [rad/s] that no joint of a sound run reaches: eight times the motor at no load."""


class Hand(NamedTuple):
    """The pilot of every axis in a block, (ticks, axes) each; see :class:`cls_bench.pilot.HandSamples`."""

    angle: NDArray[np.float64]
    velocity: NDArray[np.float64]
    force: NDArray[np.float64]
    motion: NDArray[np.bool_]
    attached: NDArray[np.bool_]
    squeeze: NDArray[np.float64]

    @classmethod
    def of(cls, hands: Sequence[HandSamples]) -> "Hand":
        """The hands of all axes, in the one form that the loop is compiled for; of a single axis without a copy."""
        fields: list[Any] = []
        for name in cls._fields:
            each = [getattr(hand, name) for hand in hands]
            values = each[0][:, None] if len(each) == 1 else np.stack(each, axis=1)
            kind = np.bool_ if name in ("motion", "attached") else np.float64
            if not values.flags.carray or values.dtype != kind:  # strided, read-only, of another type
                values = np.array(values, kind, order="C")
            fields.append(values)
        return cls(*fields)

    def part(self, first: int, ticks: int) -> "Hand":
        """Some consecutive ticks of it, without a copy."""
        fields: list[Any] = [values[first : first + ticks] for values in self]
        return Hand(*fields)


class Watched(NamedTuple):
    """What the controller's self-check looks at."""

    words: NDArray[np.float64]  # the axes' records as numbers, (axes, words)
    parameters: NDArray[np.int64]  # places in a record
    state: NDArray[np.int64]


class Bodies(NamedTuple):
    """How the drawn bodies lie, for the recorded poses: an entry a body."""

    axis: NDArray[np.int64]
    angle: NDArray[np.int64]  # what turns it, of :data:`cls_bench.plant.mechanism.ANGLES`; −1: nothing
    place: NDArray[np.float64]  # (bodies, 3), at neutral [m]
    turn: NDArray[np.float64]  # (bodies, 4), at neutral: quaternion w, x, y, z


class Cycles(NamedTuple):
    """Lengths of the cycles, and between recorded rows [ticks]."""

    velocity: int
    position: int
    bus: int
    plc: int
    drive: int  # of a recorded row of /drive and /pilot
    pose: int
    substeps: int


class Due(NamedTuple):
    """Which cycles begin with a tick."""

    velocity: bool
    position: bool
    bus: bool
    plc: bool


@compiled
def first_unbounded(plant: Plant) -> int:
    """Index of the first joint whose velocity is not finite or beyond :data:`BOUND`; −1 if there is none.

    Whatever force is lost shows in a velocity at the next step.
    """
    for joint in range(plant.qvel.shape[0]):
        if not abs(plant.qvel[joint]) < BOUND:
            return joint
    return -1


@compiled
def _trip(state: Any, tick: int, reason: int) -> None:
    state.plc.trip = reason
    state.power = 0
    state.trip_tick = tick


@compiled
def _check_numbers(state: Any, watched: Watched, a: int, tick: int) -> None:
    """Switch the drive off if a number of the controller is not finite; say which in ``state.invalid``.

    Its memory is cleared of them, so that nothing else is lost; a parameter stays as it is and trips again.
    """
    words = watched.words[a]
    found = validity.first_invalid(words, watched.parameters)
    if found < 0:
        found = validity.first_invalid(words, watched.state)
        if found >= 0:
            found += watched.parameters.shape[0]
    if found >= 0:
        validity.clear(words, watched.state)
        state.invalid = found
        _trip(state, tick, plc.INVALID_VALUE)


@compiled
def _is_on(state: Any) -> bool:
    return bool(state.power != 0 and state.servo.mode != servo.OFF)


@compiled
def _measure(axis: Any, noise: Any, a: int, row: int, tick: int, cycles: Cycles, due: Due) -> None:
    """The drive filters its speed; the bus carries position and velocity to the PLC, which measures."""
    samples, control = axis.samples, axis.controller
    state, design = control.state, control.design
    if due.velocity:
        servo.speed_filter(design.gains, state.servo, samples.encoder, design.velocity_cycle)
    if due.bus:
        cycle = tick // cycles.bus
        loss = control.parameters.plc.frame_loss
        if loss > 0.0 and noise.feedback_frame[row, a] < loss:
            latch.repeat(state.feedback, cycle)
        else:
            latch.write(state.feedback, cycle, plc.FEEDBACK_POSITION, samples.encoder * design.units_per_radian)
            latch.write(state.feedback, cycle, plc.FEEDBACK_VELOCITY, state.servo.velocity * design.units_per_radian)
    if due.plc:
        plc.measure(control.parameters, design, samples, state.feedback, tick // cycles.bus, state.plc)


@compiled
def _plc_task(axis: Any, watched: Watched, a: int, tick: int) -> None:
    control = axis.controller
    p, design, state = control.parameters, control.design, control.state
    mode = state.servo.mode
    if _is_on(state):
        if state.external == 0 and mode != servo.TORQUE:
            plc.admittance(p, mode == servo.VELOCITY, state.plc, state.feel, tick * design.tick, design.plc_cycle)
        plc.supervise(p, axis.samples, mode == servo.POSITION, state.plc)
        if state.plc.trip != plc.NO_TRIP:
            _trip(state, tick, state.plc.trip)
    s = state.plc
    if not abs(s.torque + s.angle + s.set_angle + s.set_velocity + s.set_acceleration + s.set_torque) < np.inf:
        if _is_on(state):
            _check_numbers(state, watched, a, tick)
        else:  # a parameter that trips again at every switching on
            validity.clear(watched.words[a], watched.state)
    if not _is_on(state) or (mode == servo.TORQUE and state.external == 0):
        plc.follow(state.plc, state.feel)
    plc.command(p, design, state.plc)


@compiled
def _drive(axis: Any, tick: int, cycles: Cycles, due: Due) -> None:
    control, encoder, current = axis.controller, axis.samples.encoder, axis.samples.current
    p, design, state = control.parameters, control.design, control.state
    drive, gains, s = p.drive, design.gains, state.servo
    if not _is_on(state):
        servo.reset(s, encoder)
        servo.current_limit(drive, s, current, p.nameplate.thermal_time_constant, design.tick)
        return
    if due.position:
        cycle, delay = tick // cycles.bus, p.plc.command_latency
        set_position = latch.read(state.commands, cycle, delay, plc.COMMAND_POSITION) / design.units_per_radian
        set_velocity = latch.read(state.commands, cycle, delay, plc.COMMAND_VELOCITY) / design.units_per_radian
        acceleration = latch.read(state.commands, cycle, delay, plc.COMMAND_ACCELERATION) / design.units_per_radian
        s.feed_forward = latch.read(state.commands, cycle, delay, plc.COMMAND_TORQUE)
        if s.mode == servo.POSITION:
            servo.position_controller(drive, gains, s, encoder, set_position, set_velocity, design.position_cycle)
        elif s.mode == servo.VELOCITY:
            servo.velocity_command(drive, s, encoder, set_velocity)
        else:
            servo.torque_command(drive, s, encoder)
        if drive.feed_forward_inertia:
            s.feed_forward += p.nameplate.load_inertia * acceleration
    if due.velocity and s.mode != servo.TORQUE:
        servo.interpolate(s, (tick % cycles.position // cycles.velocity + 1) * cycles.velocity / cycles.position)
        servo.velocity_controller(drive, gains, s, design.velocity_cycle)
    servo.current_controller(drive, p.nameplate, gains, s, current, design.voltage_limit, design.tick)


@compiled
def _note_limits(plant: Plant, axis: Any) -> None:
    truth, control, watch = axis.truth.parameters, axis.controller, axis.limits
    state = control.state
    s = state.servo
    if sensors.is_saturated(truth.load_cell, axis.samples.load_cell):
        limits.note(watch, limits.LOAD_CELL, abs(axis.truth.body.shown_force), truth.load_cell.capacity)
    limits.compare(watch, limits.TRAVEL, plant.qpos[axis.truth.joints.column], truth.column.travel)
    if _is_on(state):
        drive = control.parameters.drive
        limits.compare(watch, limits.SET_ANGLE, state.plc.set_angle, control.parameters.nameplate.stop_angle)
        limits.compare(watch, limits.SPEED, s.asked_velocity, drive.speed_limit)
        limits.compare(watch, limits.TORQUE, s.asked_torque, drive.torque_limit)
        limits.compare(watch, limits.CURRENT, s.asked_current, s.allowed_current)
        limits.compare(watch, limits.VOLTAGE, s.asked_voltage, control.design.voltage_limit)


@compiled
def _control(
    axis: Any, watched: Watched, noise: Any, a: int, row: int, tick: int, cycles: Cycles, due: Due, number: int,
    ask: int,
) -> bool:  # fmt: skip
    """PLC, bus and drive of an axis in a tick; whether a user's outer loop went along."""
    state = axis.controller.state
    _measure(axis, noise, a, row, tick, cycles, due)
    if due.plc:
        if state.external != 0 and _is_on(state) and call(ask, number) != 0:
            return False
        _plc_task(axis, watched, a, tick)
    if due.bus:
        loss = axis.controller.parameters.plc.frame_loss
        if loss > 0.0 and noise.command_frame[row, a] < loss:
            latch.repeat(state.commands, tick // cycles.bus)
        else:
            plc.send(state.plc, state.commands, tick // cycles.bus)
    _drive(axis, tick, cycles, due)
    if not abs(state.servo.voltage) < np.inf:  # the power stage waits for no PLC
        _check_numbers(state, watched, a, tick)
        servo.reset(state.servo, axis.samples.encoder)
    latch.write(state.voltages, tick, 0, state.servo.voltage)
    return True


@compiled
def _act(plant: Plant, axis: Any, hand: Hand, a: int, row: int, tick: int) -> None:
    """Forces of the present state of an axis."""
    truth, control = axis.truth, axis.controller
    voltage = latch.read(control.state.voltages, tick, control.parameters.drive.voltage_latency, 0)
    connected = _is_on(control.state)
    mechanism.act(
        plant, truth, connected, voltage,
        hand.motion[row, a], hand.angle[row, a], hand.velocity[row, a], hand.force[row, a],
    )  # fmt: skip


@compiled
def _grip(plant: Plant, axis: Any, hand: Hand, a: int, row: int) -> None:
    truth = axis.truth
    height = truth.parameters.column.grip_height
    limb.set_grip(
        plant, truth.parameters.limb, height, truth.joints, truth.body, hand.attached[row, a], hand.squeeze[row, a]
    )


@compiled
def advance(
    plant: Plant, axes: Any, watched: Watched, hand: Hand, noise: Any, trace: Any, bodies: Bodies, cycles: Cycles,
    warned: Any, first_tick: int, ticks: int, ask: int,
) -> int:  # fmt: skip
    """Run ``ticks`` ticks from ``first_tick`` on, the start of a PLC cycle; returns how many were run.

    Fewer are run only where a state left all bounds, MuJoCo warned (``warned[0]``) or ``ask`` refuses. ``hand``,
    ``noise`` and ``trace`` belong to these ticks. Where a user's outer loop gives the set values of an axis
    (``state.external``), ``ask`` is called with tick · axes + axis, reads the measurement there and writes them; it
    returns 0, or anything else to stop.
    """
    count = axes.shape[0]
    # The next tick of each cycle, and the rows that were written of it: cheaper than a remainder in every tick.
    next_velocity = -(-first_tick // cycles.velocity) * cycles.velocity
    next_position = -(-first_tick // cycles.position) * cycles.position
    next_bus = -(-first_tick // cycles.bus) * cycles.bus
    next_plc = -(-first_tick // cycles.plc) * cycles.plc
    next_drive = -(-first_tick // cycles.drive) * cycles.drive
    next_pose = -(-first_tick // cycles.pose) * cycles.pose
    drive_row = plc_row = pose_row = 0
    for row in range(ticks):
        tick = first_tick + row
        due = Due(tick == next_velocity, tick == next_position, tick == next_bus, tick == next_plc)
        sound = True
        for a in range(count):
            axis = axes[a]
            if due.plc and _is_on(axis.controller.state):
                _check_numbers(axis.controller.state, watched, a, tick)
            mechanism.arrive(plant, axis.truth)
            sensors.sample(plant, axis.truth, noise, a, row, axis.samples)
            sound = sound and mechanism.is_finite(axis.truth.body)
        if not sound or first_unbounded(plant) >= 0:
            return row
        for a in range(count):
            axis = axes[a]
            if not _control(axis, watched, noise, a, row, tick, cycles, due, tick * count + a, ask):
                return row
            _note_limits(plant, axis)
            _grip(plant, axis, hand, a, row)
            _act(plant, axis, hand, a, row, tick)
            squeeze = hand.squeeze[row, a] if hand.attached[row, a] else -1.0
            _trace_tick(plant, axis, trace, a, row)
            if tick == next_drive:
                _trace_drive(plant, axis, trace, a, drive_row, squeeze)
            if due.plc:
                _trace_plc(axis, trace, a, plc_row, cycles.plc)
        if tick == next_pose:
            _trace_poses(axes, bodies, plant, trace.poses, pose_row)
            pose_row, next_pose = pose_row + 1, next_pose + cycles.pose
        if tick == next_drive:
            drive_row, next_drive = drive_row + 1, next_drive + cycles.drive
        mj_step(plant.model, plant.data)
        for _ in range(1, cycles.substeps):
            for a in range(count):
                axis = axes[a]
                mechanism.arrive(plant, axis.truth)
                _grip(plant, axis, hand, a, row)
                _act(plant, axis, hand, a, row, tick)
            mj_step(plant.model, plant.data)
        if due.velocity:
            next_velocity += cycles.velocity
        if due.position:
            next_position += cycles.position
        if due.bus:
            next_bus += cycles.bus
        if due.plc:
            plc_row, next_plc = plc_row + 1, next_plc + cycles.plc
        if warned[0]:
            return row
    return ticks


@compiled
def _trace_poses(axes: Any, bodies: Bodies, plant: Plant, poses: Any, at: int) -> None:
    """Where the bodies are. Each turns about its own y axis; the rod's two ends go with their pins."""
    for body in range(bodies.axis.shape[0]):
        x, y, z = bodies.place[body, 0], bodies.place[body, 1], bodies.place[body, 2]
        turned = 0.0
        which = bodies.angle[body]
        if which >= 0:
            truth = axes[bodies.axis[body]].truth
            turned, dx, dz = mechanism.pose(plant, truth, which)
            x, z = x + dx, z + dz
        poses[at, body, 0], poses[at, body, 1], poses[at, body, 2] = x, y, z
        c, s = np.cos(0.5 * turned), np.sin(0.5 * turned)
        qw, qx, qy, qz = bodies.turn[body, 0], bodies.turn[body, 1], bodies.turn[body, 2], bodies.turn[body, 3]
        poses[at, body, 3], poses[at, body, 4] = qw * c - qy * s, qx * c - qz * s
        poses[at, body, 5], poses[at, body, 6] = qy * c + qw * s, qz * c + qx * s


@compiled
def _trace_tick(plant: Plant, axis: Any, trace: Any, a: int, row: int) -> None:
    joints, body = axis.truth.joints, axis.truth.body
    column = trace.column[row, a]
    column.angle, column.velocity = plant.qpos[joints.column], plant.qvel[joints.column]
    column.torque = body.grip_torque
    cell = trace.load_cell[row, a]
    cell.force, cell.torque = body.strain_force, axis.controller.state.plc.torque
    cell.counts = axis.samples.load_cell
    gearbox = trace.gearbox[row, a]
    stages = axis.truth.mechanism.stages
    if stages > 0:
        gearbox.stage1_twist, gearbox.stage1_torque = body.twist[0], body.mesh_torque[0]
        gearbox.stage1_friction = body.mesh_friction[0]
    if stages > 1:
        gearbox.stage2_twist, gearbox.stage2_torque = body.twist[1], body.mesh_torque[1]
        gearbox.stage2_friction = body.mesh_friction[1]
    if stages > 2:
        gearbox.stage3_twist, gearbox.stage3_torque = body.twist[2], body.mesh_torque[2]
        gearbox.stage3_friction = body.mesh_friction[2]


@compiled
def _trace_drive(plant: Plant, axis: Any, trace: Any, a: int, row: int, squeeze: float) -> None:
    truth, s = axis.truth, axis.controller.state.servo
    pilot = trace.pilot[row, a]
    pilot.hand_force = truth.body.grip_torque / truth.parameters.column.grip_height
    pilot.squeeze, pilot.limb_angle = squeeze, plant.qpos[truth.joints.limb]
    drive = trace.drive[row, a]
    drive.set_position, drive.position = s.set_position, axis.samples.encoder
    drive.set_velocity, drive.velocity = s.set_velocity, s.velocity
    drive.torque_command, drive.current = s.torque_command, axis.samples.current
    drive.voltage, drive.torque = truth.body.voltage, truth.body.motor_torque


@compiled
def _trace_plc(axis: Any, trace: Any, a: int, row: int, ticks: int) -> None:
    watch, body = axis.limits, axis.controller.state.feel
    model = trace.feel[row, a]
    model.torque, model.angle, model.velocity = body.torque, body.angle, body.velocity
    reached = trace.limits[row, a]
    reached.load_cell = limits.share(watch, limits.LOAD_CELL, ticks)
    reached.set_angle = limits.share(watch, limits.SET_ANGLE, ticks)
    reached.speed = limits.share(watch, limits.SPEED, ticks)
    reached.torque = limits.share(watch, limits.TORQUE, ticks)
    reached.current = limits.share(watch, limits.CURRENT, ticks)
    reached.voltage = limits.share(watch, limits.VOLTAGE, ticks)
    reached.travel = limits.share(watch, limits.TRAVEL, ticks)
