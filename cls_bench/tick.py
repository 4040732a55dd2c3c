"""The compiled multi-rate loop: the one place where plant and control meet.

One tick, of every axis, in this order::

    plc cycle        parameters that move: their present values
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

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cls_bench import course
from cls_bench.compiled import call, compiled, mj_step
from cls_bench.control import controller, limits
from cls_bench.control.controller import Watched
from cls_bench.hand import HandSamples
from cls_bench.parameters import Parameters
from cls_bench.plant import limb, mechanism, sensors
from cls_bench.plant.state import Plant

BOUND = 1.0e4
"""Velocity [rad/s] that no joint of a sound run reaches: over eight times the thesis's motor at no load."""


def bound(axes: Iterable[Parameters]) -> float:
    """:data:`BOUND`, or with a faster motor among the ``axes`` eight times its speed at no load."""
    return max(BOUND, *(8.0 * p.drive.voltage_limit / p.motor.torque_constant for p in axes))


class Hand(NamedTuple):
    """The pilot of every axis in a block, (ticks, axes) each; see :class:`cls_bench.hand.HandSamples`."""

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
def first_unbounded(plant: Plant, limit: float) -> int:
    """Index of the first joint whose velocity is not finite or beyond ``limit`` [rad/s]; −1 if there is none.

    Whatever force is lost shows in a velocity at the next step.
    """
    for joint in range(plant.qvel.shape[0]):
        if not abs(plant.qvel[joint]) < limit:
            return joint
    return -1


@compiled
def _is_lost(bus: Any, chances: Any, watch: Any, row: int, a: int, cycles: Cycles) -> bool:
    """Whether the bus loses a frame; noted if so."""
    if bus.frame_loss > 0.0 and chances[row, a] < bus.frame_loss:
        limits.lose(watch, cycles.bus)
        return True
    return False


@compiled
def _note_limits(plant: Plant, axis: Any) -> None:
    truth, control, watch = axis.truth.parameters, axis.controller, axis.limits
    state = control.state
    s = state.servo
    if sensors.is_saturated(truth.load_cell, axis.samples.load_cell):
        limits.note(watch, limits.LOAD_CELL, abs(axis.truth.body.shown_force), truth.load_cell.capacity)
    limits.compare(watch, limits.TRAVEL, plant.qpos[axis.truth.joints.column], truth.column.travel)
    if controller.is_on(state):
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
    control, samples = axis.controller, axis.samples
    lost = due.bus and _is_lost(control.parameters.plc, noise.feedback_frame, axis.limits, row, a, cycles)
    controller.measure(control, samples, lost, tick, cycles, due)
    if due.plc:
        if control.parameters.feel.gust.torque > 0.0:
            control.state.feel.gust.white = noise.gust[row, a]
        if control.state.external != 0 and controller.is_on(control.state) and call(ask, number) != 0:
            return False
        controller.task(control, samples, watched, a, tick)
    if due.bus:
        lost = _is_lost(control.parameters.plc, noise.command_frame, axis.limits, row, a, cycles)
        controller.send(control, lost, tick // cycles.bus)
    controller.drive(control, samples, watched, a, tick, cycles, due)
    return True


@compiled
def _act(plant: Plant, axis: Any, hand: Hand, a: int, row: int, tick: int) -> None:
    """Forces of the present state of an axis."""
    control = axis.controller
    mechanism.act(
        plant, axis.truth, controller.is_on(control.state), controller.voltage(control, tick),
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
    courses: Any, pieces: Any, limit: float, warned: Any, first_tick: int, ticks: int, ask: int,
) -> int:  # fmt: skip
    """Run ``ticks`` ticks from ``first_tick`` on, the start of a PLC cycle; returns how many were run.

    Fewer are run only where a velocity is beyond ``limit`` [rad/s] or a state is not finite, MuJoCo warned
    (``warned[0]``) or ``ask`` refuses. ``hand``, ``noise`` and ``trace`` belong to these ticks; ``courses`` and their
    ``pieces`` (:mod:`cls_bench.course`) say which parameters move. Where a user's outer loop gives the set values of an
    axis (``state.external``), ``ask`` is called with tick · axes + axis, reads the measurement there and writes them;
    it returns 0, or anything else to stop.
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
        if due.plc:
            course.move(courses, pieces, watched.words, tick)
        for a in range(count):
            axis = axes[a]
            if due.plc and controller.is_on(axis.controller.state):
                controller.check_numbers(axis.controller.state, watched, a, tick)
            mechanism.arrive(plant, axis.truth)
            sensors.sample(plant, axis.truth, noise, a, row, axis.samples)
            sound = sound and mechanism.is_finite(axis.truth.body)
        if not sound or first_unbounded(plant, limit) >= 0:
            return row
        for a in range(count):
            axis = axes[a]
            if not _control(axis, watched, noise, a, row, tick, cycles, due, tick * count + a, ask):
                return row
            _note_limits(plant, axis)
            _grip(plant, axis, hand, a, row)
            _act(plant, axis, hand, a, row, tick)
            mechanism.show(plant, axis.truth, hand.attached[row, a], hand.squeeze[row, a])
            _trace(trace.values, trace.tick, watched.words, a, row)
            if tick == next_drive:
                _trace(trace.values, trace.drive, watched.words, a, drive_row)
            if due.plc:
                limits.close(axis.limits, cycles.plc)
                _trace(trace.values, trace.plc, watched.words, a, plc_row)
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
def _trace(values: Any, places: Any, words: Any, a: int, row: int) -> None:
    """Copy what a row takes of the record of axis ``a``; see :class:`cls_bench.trace.Trace`."""
    for k in range(places.shape[0]):
        values[places[k, 1] + row * places[k, 2] + a * places[k, 3]] = words[a, places[k, 0]]
