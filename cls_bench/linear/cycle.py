"""The sampled side as linear forms: amplifier, PLC, field bus and the drive's cascade, each at its own cycle.

Within a tick, in this order: the samples; the speed filter; at a cycle of the bus the drive's frame to the PLC; the
PLC; at a cycle of the bus its frame to the drive; position, velocity and current controller; the voltage, which reaches
the terminals ``drive.voltage_latency`` ticks later; then the plant moves on by a tick, exactly.

What belongs to the controller (gains, kinematics, weights of its cell) is from ``nameplate``, ``drive``, ``plc`` and
``feel``; what belongs to the plant is the plant's.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from cls_bench.analysis.quasi_static import balanced
from cls_bench.feel_laws import COLUMN, Laws
from cls_bench.linear.forms import Forms, Lifted, delayed
from cls_bench.linear.linkage import Levers, four_bar
from cls_bench.linear.plant import MOTOR, Plant
from cls_bench.parameters import Feel, Nameplate, Parameters

Array = NDArray[np.float64]

INPUTS = ("torque", "angle", "velocity", "hand")
"""Where the model can be excited: torque at the feel model's input [N·m], set angle and set velocity of the column at
the PLC's output [rad, rad/s] (all held for a PLC cycle), torque on the limb [N·m] (held for a tick)."""

_FRAME = ("position", "velocity", "acceleration", "torque")
"""What the bus carries to the drive, at the motor."""


@dataclass(frozen=True)
class Compensation:
    """Post-sensor inertia compensation: T̃ = T_meas + inertia · φ̈, φ̈ from the encoder (thesis Eq. 3.10)."""

    inertia: float
    """[kg·m²]"""
    filter_time: float
    """time constant of the low pass on φ̈ [s]"""


def period(
    p: Parameters, plant: Plant, compensation: Compensation | None = None, *, closed: bool = True, model: bool = True
) -> Lifted:
    """One period of bench ``p`` about ``plant``: the least common multiple of all its cycles.

    ``closed``: whether the load cell's torque reaches the feel model; open for the loop gain. ``model``: whether there
    is a feel model at all, or set values from outside alone; without it for the inner loop.
    """
    return _Period(p, plant, compensation, closed, model).lifted()


def _levers(plate: Nameplate) -> Levers:
    """Levers of the linkage that the PLC believes in."""
    if plate.linkage == "none":
        return Levers(plate.arm, plate.arm, 0.0)
    return four_bar(plate.crank, plate.arm, plate.crank_angle, plate.rod_angle, plate.arm_angle)


def _low_pass(time: float, cycle: float) -> float:
    """Weight of a new sample in a first-order low pass of time constant ``time``, sampled every ``cycle`` [s]."""
    return 1.0 - math.exp(-cycle / time) if time > 0.0 else 1.0


@dataclass(frozen=True)
class _Answer:
    """The feel model over a PLC cycle with the torque held: state⁺ = transition · state + response · torque.

    The state is angle and velocity of the body at the column, and of the aft body where there are two.
    """

    transition: Array
    response: Array
    acceleration: Array
    """of the body at the column, over the state"""
    of_torque: float
    """and over the torque [1/(kg·m²)]"""


def _answer(feel: Feel, cycle: float) -> _Answer:
    """Exact for small motion about the trimmed position, by the matrix exponential.

    Everything that has a slope there takes part: springs, detents, hinge moment, unbalance, servo, dampers, linkage. A
    linkage with backlash is taken as in contact, as the meshes of the gearbox are; friction and a jammed body's motion
    are none.
    """
    laws = Laws(feel)
    count = 2 if laws.two else 1
    aft = balanced(laws, feel.neutral) if laws.two else feel.neutral
    at = laws.slopes(feel.neutral, aft)
    stiffness = np.array([[at.column + at.link, -at.link], [-at.link, at.aft + at.link]])
    damping = np.array([
        [at.column_damping + at.link_damping, -at.link_damping],
        [-at.link_damping, at.aft_damping + at.link_damping],
    ])
    a = np.zeros((2 * count + 1, 2 * count + 1))
    for body in range(count):
        if not laws.jammed[body]:
            angle, velocity = 2 * body, 2 * body + 1
            a[angle, velocity] = 1.0
            a[velocity, 0:-1:2] = -stiffness[body, :count] / laws.inertia[body]
            a[velocity, 1:-1:2] = -damping[body, :count] / laws.inertia[body]
    if not laws.jammed[COLUMN]:
        a[1, -1] = 1.0 / feel.inertia
    block = expm(a * cycle)
    return _Answer(block[:-1, :-1], block[:-1, -1], a[1, :-1], float(a[1, -1]))


class _Period:
    """Works through the ticks of a period."""

    def __init__(self, p: Parameters, plant: Plant, compensation: Compensation | None, closed: bool, model: bool):
        self._p, self._plant = p, plant
        self._compensation, self._closed, self._model = compensation, closed, model
        self._clock = clock = p.rates.clock
        self._ticks = math.lcm(clock.velocity_ticks, clock.position_ticks, clock.bus_ticks, clock.plc_ticks)
        n = plant.freedoms
        self._body = [*(f"q{k}" for k in range(n)), *(f"v{k}" for k in range(n)), "current"]
        held = ["torque", "angle", "velocity"]
        self._integral = p.plc.outer_loop == "position" and p.drive.position_integral_time > 0.0
        self._model_states = ["feel_angle", "feel_velocity"]
        if p.feel.bodies == "two":
            self._model_states += ["aft_angle", "aft_velocity"]
        self._forms = Forms(
            [
                *self._body, "amplifier", "encoder_before", "speed", "speed_integral", "output", "current_integral",
                *self._model_states,
                *(["position_integral"] if self._integral else []),
                *(["acceleration", "velocity_before"] if compensation is not None else []),
                *delayed(["voltage"], p.drive.voltage_latency),
                *delayed(_FRAME, p.plc.command_latency),
                *delayed(["angle", "rate"], p.plc.feedback_latency),
            ],
            [
                *((name, tick) for tick in range(0, self._ticks, clock.plc_ticks) for name in held),
                *(("hand", tick) for tick in range(self._ticks)),
            ],
        )  # fmt: skip
        lever = _levers(p.nameplate)
        self._arm = lever.column
        self._ratio = p.nameplate.gear_ratio * lever.ratio  # motor over column
        # What the PLC takes for a newton, over what it is.
        self._cell = (1.0 + p.load_cell.gain_error) * p.nameplate.load_cell_gain / p.load_cell.count
        self._feel = _answer(p.feel, clock.plc_s)
        self._step = plant.sampled(clock.tick_s)
        # What one part of a tick leaves to another. All of it is set anew at the period's first tick.
        self._arrived = dict.fromkeys(_FRAME, self._forms.zero())
        self._asked = dict(self._arrived)
        self._seen = self._seen_rate = self._ahead = self._before = self._torque = self._forms.zero()

    def lifted(self) -> Lifted:
        """The map over the period."""
        clock = self._clock
        for tick in range(self._ticks):
            self._sample(tick)
            if tick % clock.bus_ticks == 0:
                delay = self._p.plc.feedback_latency
                self._seen = self._forms.shift("angle", delay, self._encoder)
                self._seen_rate = self._forms.shift("rate", delay, self._forms.value["speed"])
            if tick % clock.plc_ticks == 0:
                self._plc(tick)
            if tick % clock.bus_ticks == 0:
                for name in _FRAME:
                    self._arrived[name] = self._forms.shift(name, self._p.plc.command_latency, self._asked[name])
            if tick % clock.position_ticks == 0:
                self._position_controller(tick)
            if tick % clock.velocity_ticks == 0:
                self._velocity_controller(tick)
            self._move(tick, self._current_controller())
        return self._forms.lifted(clock.tick_s, self._ticks)

    @property
    def _encoder(self) -> Array:
        return self._forms.value[f"q{MOTOR}"]

    def _sample(self, tick: int) -> None:
        v, clock, plant = self._forms.value, self._clock, self._plant
        state = np.array([v[name] for name in self._body[:-1]])
        force = plant.rod_force @ state
        weight = _low_pass(1.0 / (2.0 * math.pi * self._p.load_cell.filter_bandwidth), clock.tick_s)
        v["amplifier"] = v["amplifier"] + weight * (force - v["amplifier"])
        if tick % clock.velocity_ticks == 0:  # speed filter
            raw = (self._encoder - v["encoder_before"]) / clock.velocity_s
            v["encoder_before"] = self._encoder
            weight = _low_pass(self._p.drive.speed_filter_time, clock.velocity_s)
            v["speed"] = v["speed"] + weight * (raw - v["speed"])
        grip = self._forms.zero()
        if plant.limb is not None:
            limb, column = plant.limb, plant.column
            grip = plant.grip[0] * (v[f"q{limb}"] - v[f"q{column}"])
            grip = grip + plant.grip[1] * (v[f"v{limb}"] - v[f"v{column}"])
        self._forms.record(
            tick, column_angle=v[f"q{plant.column}"], column_velocity=v[f"v{plant.column}"], grip_torque=grip,
            rod_force=force,
        )  # fmt: skip

    def _plc(self, tick: int) -> None:
        f, v, p, ratio = self._forms, self._forms.value, self._p, self._ratio
        cycle = self._clock.plc_s
        seen, seen_rate = self._seen / ratio, self._seen_rate / ratio
        measured = self._arm * self._cell * v["amplifier"]
        if p.plc.remove_unbalance:
            measured = measured - p.nameplate.unbalance * seen
        torque = f.source["torque", tick] + (measured if self._closed else 0.0)
        if self._compensation is not None:
            weight = _low_pass(self._compensation.filter_time, cycle)
            raw = (seen_rate - v["velocity_before"]) / cycle
            v["acceleration"] = v["acceleration"] + weight * (raw - v["acceleration"])
            v["velocity_before"] = seen_rate
            if self._closed:
                torque = torque + self._compensation.inertia * v["acceleration"]
            measured = measured + self._compensation.inertia * v["acceleration"]
        if p.plc.outer_loop == "velocity":
            v["feel_angle"] = seen
        answer, before = self._feel, np.array([v[name] for name in self._model_states])
        after = answer.transition @ before + np.outer(answer.response, torque)
        v.update(zip(self._model_states, after, strict=True))
        angle, velocity = after[0], after[1]
        acceleration = answer.acceleration @ after + answer.of_torque * torque
        if not self._model:
            angle, velocity, acceleration = f.zero(), f.zero(), f.zero()
        set_angle = angle + f.source["angle", tick]
        set_velocity = velocity + f.source["velocity", tick]
        self._asked = {
            "position": ratio * set_angle,
            "velocity": ratio * set_velocity,
            "acceleration": ratio * acceleration,
            "torque": -measured / ratio if p.drive.feed_forward_pilot else f.zero(),
        }
        f.record(tick, measured_torque=measured, model_torque=torque, set_angle=set_angle)

    def _position_controller(self, tick: int) -> None:
        v, drive, asked = self._forms.value, self._p.drive, self._arrived
        self._before = v["output"]
        set_position = self._encoder
        if self._p.plc.outer_loop == "velocity":
            v["output"] = asked["velocity"]
        else:
            set_position = asked["position"]
            gain = 2.0 * math.pi * drive.position_bandwidth
            error = set_position - self._encoder
            v["output"] = gain * error
            if self._integral:
                share = gain * self._clock.position_s / drive.position_integral_time
                v["position_integral"] = v["position_integral"] + share * error
                v["output"] = v["output"] + v["position_integral"]
            if drive.feed_forward_velocity:
                v["output"] = v["output"] + asked["velocity"]
        self._ahead = asked["torque"]
        if drive.feed_forward_inertia:
            self._ahead = self._ahead + self._p.nameplate.load_inertia * asked["acceleration"]
        self._forms.record(
            tick, set_position=set_position, position=self._encoder, position_error=set_position - self._encoder
        )

    def _velocity_controller(self, tick: int) -> None:
        """With the set velocity on a straight line from the last output of the position controller to the newest."""
        v, drive, clock = self._forms.value, self._p.drive, self._clock
        count = clock.position_ticks // clock.velocity_ticks
        share = (tick % clock.position_ticks // clock.velocity_ticks + 1) / count
        set_velocity = self._before + share * (v["output"] - self._before)
        error = set_velocity - v["speed"]
        gain = 2.0 * math.pi * drive.velocity_bandwidth * self._p.nameplate.load_inertia
        v["speed_integral"] = (
            v["speed_integral"] + gain * clock.velocity_s / drive.velocity_integral_time * error
        )
        self._torque = gain * error + v["speed_integral"] + self._ahead
        self._forms.record(tick, set_velocity=set_velocity, velocity=v["speed"], velocity_error=error)

    def _current_controller(self) -> Array:
        """The voltage it asks for."""
        v, plate = self._forms.value, self._p.nameplate
        bandwidth = 2.0 * math.pi * self._p.drive.current_bandwidth
        error = self._torque / plate.torque_constant - v["current"]
        v["current_integral"] = v["current_integral"] + bandwidth * plate.resistance * self._clock.tick_s * error
        emf = plate.torque_constant * v["speed"]
        return np.asarray(bandwidth * plate.inductance * error + v["current_integral"] + emf)

    def _move(self, tick: int, voltage: Array) -> None:
        v = self._forms.value
        reaching = self._forms.shift("voltage", self._p.drive.voltage_latency, voltage)
        transition, response = self._step
        state = np.array([v[name] for name in self._body])
        state = transition @ state + response @ np.array([reaching, self._forms.source["hand", tick]])
        v.update(zip(self._body, state, strict=True))

