"""Outer loops for the laboratory: the built-in one as an object, and others wrapped around any outer loop."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from cls_bench.control import plc
from cls_bench.control.outer_loop import Command, Inputs, OuterLoop
from cls_bench.feel.element import PIECE
from cls_bench.feel.model import STATE
from cls_bench.linear.cycle import Compensation
from cls_bench.parameters import ControlParameters, record_of

MakeLoop = Callable[[ControlParameters], OuterLoop]
"""Makes a new outer loop for one run, of what a controller may know of the bench."""


class BuiltIn:
    """The PLC's own outer loop as an object that can be wrapped; runs the same law as the tick, sample by sample."""

    def __init__(self, parameters: ControlParameters):
        self._record = record_of(parameters)
        self._velocity = parameters.plc.outer_loop == "velocity"
        self._cycle = parameters.rates.clock.plc_s
        self._feel: Any = np.zeros(1, dtype=STATE).view(np.recarray)[0]
        self._piece: Any = np.zeros(1, dtype=PIECE).view(np.recarray)[0]
        self._plc: Any = np.zeros(1, dtype=plc.STATE).view(np.recarray)[0]

    def step(self, inputs: Inputs) -> Command:
        """One PLC cycle of the feel model."""
        s = self._plc
        s.torque, s.angle, s.velocity = inputs.torque, inputs.angle, inputs.velocity
        plc.admittance(self._record, self._velocity, s, self._feel, self._piece, inputs.time, self._cycle)
        return Command(float(s.set_angle), float(s.set_velocity), float(s.set_acceleration))


class InertiaCompensated:
    """Post-sensor inertia compensation around another loop: T̃ = T_meas + I φ̈ (thesis Eq. 3.10, a).

    φ̈ is the difference quotient of the column velocity from the encoder over a ``cycle`` of the PLC [s], through a
    first-order low pass.
    """

    def __init__(self, inner: OuterLoop, compensation: Compensation, cycle: float):
        self._inner = inner
        self._inertia, self._cycle = compensation.inertia, cycle
        self._weight = 1.0 - math.exp(-cycle / compensation.filter_time)
        self._velocity: float | None = None
        self._acceleration = 0.0

    def step(self, inputs: Inputs) -> Command:
        """One PLC cycle: what the column's and limb's inertia took out of the measured torque is put back in."""
        before = inputs.velocity if self._velocity is None else self._velocity
        self._velocity = inputs.velocity
        self._acceleration += self._weight * ((inputs.velocity - before) / self._cycle - self._acceleration)
        return self._inner.step(inputs._replace(torque=inputs.torque + self._inertia * self._acceleration))


@dataclass
class Probe:
    """Excites an outer loop and keeps what went in and out, one entry a PLC cycle.

    ``torque`` [N·m] is added at the loop's input, ``angle`` [rad] and ``velocity`` [rad/s] at its output, each given
    over time [s]. With ``opened`` the measured torque does not reach the loop, and without an ``inner`` loop the set
    values are the excitation alone.
    """

    inner: OuterLoop | None
    torque: Callable[[float], float] | None = None
    angle: Callable[[float], float] | None = None
    velocity: Callable[[float], float] | None = None
    opened: bool = False
    measured: list[float] = field(default_factory=list)
    """torque from the load cell [N·m]"""
    applied: list[float] = field(default_factory=list)
    """torque that the loop was given [N·m]"""
    asked: list[Command] = field(default_factory=list)
    """set values"""

    def step(self, inputs: Inputs) -> Command:
        """One PLC cycle."""
        torque = 0.0 if self.opened else inputs.torque
        if self.torque is not None:
            torque += self.torque(inputs.time)
        command = Command(0.0) if self.inner is None else self.inner.step(inputs._replace(torque=torque))
        if self.angle is not None:
            command = command._replace(angle=command.angle + self.angle(inputs.time))
        if self.velocity is not None:
            command = command._replace(velocity=command.velocity + self.velocity(inputs.time))
        self.measured.append(inputs.torque)
        self.applied.append(torque)
        self.asked.append(command)
        return command
