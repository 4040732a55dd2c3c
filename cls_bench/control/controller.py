"""Drive and PLC of an axis in a tick: from the sensors' samples to the motor voltage.

:func:`measure`, a user's outer loop if there is one, :func:`task`, :func:`send`, :func:`drive`. The tick calls them in
that order and says which cycles begin; each is given the axis's :data:`cls_bench.control.state.CONTROLLER` and samples.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cls_bench.compiled import compiled
from cls_bench.control import latch, plc, servo, validity
from cls_bench.feel import solver


class Watched(NamedTuple):
    """What the controller's self-check looks at."""

    words: NDArray[np.float64]  # the axes' records as numbers, (axes, words)
    parameters: NDArray[np.int64]  # places in a record
    state: NDArray[np.int64]


@compiled
def is_on(state: Any) -> bool:
    """Whether the drive is switched on and in a mode in which it works."""
    return bool(state.power != 0 and state.servo.mode != servo.OFF)


@compiled
def _trip(state: Any, tick: int, reason: int) -> None:
    state.plc.trip = reason
    state.power = 0
    state.trip_tick = tick


@compiled
def check_numbers(state: Any, watched: Watched, a: int, tick: int) -> None:
    """Switch the drive of axis ``a`` off if a number of its controller is not finite; say which in ``state.invalid``.

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
def measure(control: Any, samples: Any, lost: bool, tick: int, cycles: Any, due: Any) -> None:
    """The drive filters its speed; the bus carries position and velocity to the PLC, which measures.

    ``lost``: the bus loses that frame.
    """
    state, design = control.state, control.design
    if due.velocity:
        servo.speed_filter(design.gains, state.servo, samples.encoder, design.velocity_cycle)
    cycle = tick // cycles.bus
    if due.bus:
        if lost:
            latch.repeat(state.feedback, cycle)
        else:
            latch.write(state.feedback, cycle, plc.FEEDBACK_POSITION, samples.encoder * design.units_per_radian)
            latch.write(state.feedback, cycle, plc.FEEDBACK_VELOCITY, state.servo.velocity * design.units_per_radian)
    if due.plc:
        plc.measure(control.parameters, design, samples, state.feedback, cycle, state.plc)


@compiled
def task(control: Any, samples: Any, watched: Watched, a: int, tick: int) -> None:
    """The PLC's task: outer loop, safety functions, and through the kinematic chain what goes out next."""
    p, design, state = control.parameters, control.design, control.state
    mode, s = state.servo.mode, state.plc
    if is_on(state):
        if state.external != 0:  # the feel model goes along with what is asked for: its surface is recorded
            solver.follow(p.feel, state.feel, state.feel.angle, state.feel.velocity, s.torque)
        elif mode != servo.TORQUE:
            time = tick * design.tick
            plc.admittance(p, mode == servo.VELOCITY, s, state.feel, control.piece, time, design.plc_cycle)
        plc.supervise(p, samples, mode == servo.POSITION, s)
        if s.trip != plc.NO_TRIP:
            _trip(state, tick, s.trip)
    if not abs(s.torque + s.angle + s.set_angle + s.set_velocity + s.set_acceleration + s.set_torque) < np.inf:
        if is_on(state):
            check_numbers(state, watched, a, tick)
        else:  # a parameter that trips again at every switching on
            validity.clear(watched.words[a], watched.state)
    if not is_on(state) or (mode == servo.TORQUE and state.external == 0):
        plc.follow(p, s, state.feel)
    plc.command(p, design, s)


@compiled
def send(control: Any, lost: bool, cycle: int) -> None:
    """The newest command on the field bus, in this ``cycle`` of it, unless it loses that frame."""
    if lost:
        latch.repeat(control.state.commands, cycle)
    else:
        plc.send(control.state.plc, control.state.commands, cycle)


@compiled
def drive(control: Any, samples: Any, watched: Watched, a: int, tick: int, cycles: Any, due: Any) -> None:
    """The drive's controllers, from the command that has arrived to the voltage that it asks of its power stage."""
    state = control.state
    if is_on(state):
        _regulate(control, samples, tick, cycles, due)
    else:
        servo.reset(state.servo, samples.encoder)
        heating = control.parameters.nameplate.thermal_time_constant
        servo.current_limit(control.parameters.drive, state.servo, samples.current, heating, control.design.tick)
    if not abs(state.servo.voltage) < np.inf:  # the power stage waits for no PLC
        check_numbers(state, watched, a, tick)
        servo.reset(state.servo, samples.encoder)
    latch.write(state.voltages, tick, 0, state.servo.voltage)


@compiled
def _regulate(control: Any, samples: Any, tick: int, cycles: Any, due: Any) -> None:
    p, design, state, encoder = control.parameters, control.design, control.state, samples.encoder
    gains, s = design.gains, state.servo
    if due.position:
        cycle, delay = tick // cycles.bus, p.plc.command_latency
        set_position = latch.read(state.commands, cycle, delay, plc.COMMAND_POSITION) / design.units_per_radian
        set_velocity = latch.read(state.commands, cycle, delay, plc.COMMAND_VELOCITY) / design.units_per_radian
        acceleration = latch.read(state.commands, cycle, delay, plc.COMMAND_ACCELERATION) / design.units_per_radian
        s.feed_forward = latch.read(state.commands, cycle, delay, plc.COMMAND_TORQUE)
        if s.mode == servo.POSITION:
            servo.position_controller(p.drive, gains, s, encoder, set_position, set_velocity, design.position_cycle)
        elif s.mode == servo.VELOCITY:
            servo.velocity_command(p.drive, s, encoder, set_velocity)
        else:
            servo.torque_command(p.drive, s, encoder)
        if p.drive.feed_forward_inertia:
            s.feed_forward += p.nameplate.load_inertia * acceleration
    if due.velocity and s.mode != servo.TORQUE:
        servo.interpolate(s, (tick % cycles.position // cycles.velocity + 1) * cycles.velocity / cycles.position)
        servo.velocity_controller(p.drive, gains, s, design.velocity_cycle)
    servo.current_controller(p.drive, p.nameplate, gains, s, samples.current, design.voltage_limit, design.tick)


@compiled
def voltage(control: Any, tick: int) -> float:
    """What the power stage puts on the motor in this tick [V]."""
    return latch.read(control.state.voltages, tick, control.parameters.drive.voltage_latency, 0)
